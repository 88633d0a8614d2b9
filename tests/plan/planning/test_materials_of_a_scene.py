"""What planning leaves out of materials."""

from pathlib import Path

import numpy as np
import pytest

import haptix
from haptix.feel.materials import KINDS
from haptix.feel.motion import Depends, Motion
from haptix.plan.planning import HOLDABLE, effects_of_materials, holding
from haptix.plan.scene import Scene

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


def test_what_is_felt_is_kept_and_what_is_not_is_told(model):
    found = dict(effects_of_materials(scene(SLOW, FAST, FLAT, STEEP, PRESSED), model))
    assert {name: effect.jnd_max > 0.1 for name, effect in found.items()} == {
        "materials.0 (moving) time": False, "materials.1 (moving) time": True,
        "materials.2 (by-speed) speed": False, "materials.3 (by-speed) speed": True,
        "materials.4 (by-force) speed": True, "materials.4 (by-force) force": False,
    }  # fmt: skip
    # Up to 90 of 300 mm/s from the middle of 20 to 200: 0.3 of a reach of 2.5 to 3 JND.
    felt = found["materials.3 (by-speed) speed"].jnd_max
    assert felt == pytest.approx(0.3 * 2.75, rel=0.15)


def test_what_is_held_never_changes():
    motion = Motion.of(3.0, 4.0, [0.0, 0.225], 80.0)  # half a period of the fast one
    (moving,) = scene(FAST).materials
    still = holding(motion, Depends.TIME, 110.0, 0.5)
    assert np.ptp(moving.evaluator.wanted(still)) == 0
    assert np.ptp(moving.evaluator.wanted(motion)) == pytest.approx(np.sin(2 * np.pi / 3))


@pytest.mark.slow
def test_a_plan_says_what_of_a_material_is_felt(plain_plan):
    assert [(row.name, row.kept) for row in plain_plan.rows if row.kind == "material"] == [
        ("materials.0 (by-speed) speed", False), ("materials.1 (by-speed) speed", True),
    ]  # fmt: skip


EXAMPLES = Path(haptix.__file__).parents[1] / "examples" / "materials"
OWN = sorted(kind for kind, of in KINDS.items() if of.__module__.startswith("haptix."))


@pytest.mark.parametrize("kind", OWN)
def test_every_kind_is_planned_and_can_be_held(model, kind):
    one = scene(haptix.feel.materials.load(EXAMPLES / f"{kind}.toml"))
    evaluator = one.materials[0].evaluator
    can = {flag for flag in HOLDABLE if flag & evaluator.depends_on}
    found = {name.split()[-1].upper() for name, _ in effects_of_materials(one, model)}
    assert found == {flag.name for flag in can}
    left, right, top, bottom = one.materials[0].extent_mm
    x, y = np.linspace(left, right, 50), (top + 2 * bottom) / 3
    answers = []
    for changed in ((0.0, 60.0, 0.0, 0.3), (0.7, -40.0, 50.0, 0.6)):
        motion = Motion.of(x, y, *changed, reachable=lambda n, _: (0 * n, 1 + n))
        for flag in can:
            motion = holding(motion, flag, 110.0, 0.5)
        answers.append(evaluator.wanted(motion))
    # A direction is that of the velocity, shorter near rest: by 1 part in 800 at 40 mm/s.
    one_answer, other = answers
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
