"""What planning leaves out of materials."""

from pathlib import Path

import numpy as np
import pytest

import haptix
from haptix.materials import KINDS
from haptix.materials.held import DROPPABLE
from haptix.motion import Depends, Motion
from haptix.planning.materials import decide_materials
from haptix.scene import Scene

SLOW = {"kind": "moving", "velocity_mm_s": [1e-4, 0.0], "of": {"kind": "grating", "period_mm": 9.0}}
FAST = {**SLOW, "velocity_mm_s": [20.0, 0.0]}
FLAT = {"kind": "by-speed", "speed_mm_s": [0, 300], "share": [0.5, 0.51]}
STEEP = {**FLAT, "share": [0.0, 1.0]}
PRESSED = {"kind": "by-force", "normal_force_n": [0.2, 0.8], "share": [0.5, 0.502], "of": STEEP}


def scene(*materials, **fields):
    return Scene(
        finger="semi-wet", screen="3m-sct3250", normal_force_n=(0.3, 0.7),
        drive={"scheme": "carrier", "carrier_hz": 4000}, materials=materials, **fields,
    )  # fmt: skip


def test_what_changes_little_is_dropped_and_what_is_felt_is_kept(model):
    decisions, evaluators = decide_materials(scene(SLOW, FAST, FLAT, STEEP, PRESSED), model, 0.1)
    assert [(one.name.split()[-1], one.kept) for one in decisions] == [
        ("time", False), ("time", True), ("speed", False), ("speed", True),
        ("force", False), ("speed", True),
    ]  # fmt: skip
    assert [one.depends_on for one in evaluators] == [
        Depends.PLACE, Depends.PLACE | Depends.TIME, Depends.NOTHING, Depends.SPEED, Depends.SPEED,
    ]  # fmt: skip
    # Up to 90 of 300 mm/s from the middle of 20 to 200: 0.3 of a reach of 2.5 to 3 JND.
    assert decisions[3].effect.thresholds_max == pytest.approx(0.3 * 2.75, rel=0.15)
    assert all(one.effect.thresholds_max < 0.1 for one in decisions if not one.kept)
    motion = Motion.of(3.0, 4.0, [0.0, 0.225], 80.0)  # half a period of the fast one
    assert np.ptp(evaluators[0].wanted(motion)) == 0
    assert np.ptp(evaluators[1].wanted(motion)) == pytest.approx(np.sin(2 * np.pi / 3))


def test_a_budget_of_nothing_keeps_everything(model):
    decisions, _ = decide_materials(scene(SLOW, FLAT), model, 0.0)
    assert all(one.kept for one in decisions)


EXAMPLES = Path(haptix.__file__).parents[1] / "examples" / "materials"
OWN = sorted(kind for kind, of in KINDS.items() if of.__module__.startswith("haptix."))


@pytest.mark.parametrize("kind", OWN)
def test_every_kind_is_planned_and_loses_what_a_budget_allows(model, kind):
    """A boundless budget drops all that can be held: then no answer depends on it."""
    one = scene(haptix.materials.load(EXAMPLES / f"{kind}.toml"))
    found, (evaluator,) = decide_materials(one, model, 1e9)
    before = one.materials[0].evaluator.depends_on
    can = {flag for flag in DROPPABLE if flag & before}
    assert {row.name.split()[-1].upper() for row in found} == {flag.name for flag in can}
    assert not any(row.kept for row in found)
    assert not any(flag & evaluator.depends_on for flag in DROPPABLE)
    left, right, top, bottom = one.materials[0].extent_mm
    x, y = np.linspace(left, right, 50), (top + 2 * bottom) / 3
    one_answer, other = (
        evaluator.wanted(Motion.of(x, y, *changed).within(lambda force, _: (0 * force, 1 + force)))
        for changed in ((0.0, 60.0, 0.0, 0.3), (0.7, -40.0, 50.0, 0.6))
    )
    # A direction is that of the velocity, shorter near rest: by 1 part in 800 at 40 mm/s.
    np.testing.assert_allclose(one_answer, other, rtol=0, atol=2.5e-3)


@pytest.mark.parametrize("ending", ["toml", "json"])
def test_a_scene_is_read_back_with_its_materials(tmp_path, ending):
    (tmp_path / "flat.toml").write_text(
        'kind = "by-speed"\nspeed_mm_s = [0, 300]\nshare = [0.5, 0.51]\n'
    )
    read = scene(FAST, "flat.toml", folder=tmp_path)
    read.save(tmp_path / f"scene.{ending}")
    again = Scene.load(tmp_path / f"scene.{ending}")
    assert again.materials == read.materials == scene(FAST, FLAT).materials
