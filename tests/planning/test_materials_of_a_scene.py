"""What planning leaves out of materials."""

import numpy as np
import pytest

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


@pytest.mark.parametrize("ending", ["toml", "json"])
def test_a_scene_is_read_back_with_its_materials(tmp_path, ending):
    (tmp_path / "flat.toml").write_text(
        'kind = "by-speed"\nspeed_mm_s = [0, 300]\nshare = [0.5, 0.51]\n'
    )
    read = scene(FAST, "flat.toml", folder=tmp_path)
    read.save(tmp_path / f"scene.{ending}")
    again = Scene.load(tmp_path / f"scene.{ending}")
    assert again.materials == read.materials == scene(FAST, FLAT).materials
