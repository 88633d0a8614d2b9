"""Scenes whose plans are known beforehand."""

from pathlib import Path

import pytest

import haptix
from haptix import Finger, Scene, Screen
from haptix.plan.planning import plan_scene

FLAT = {"kind": "by-speed", "speed_mm_s": [0, 300], "share": [0.5, 0.51]}
STEEP = {**FLAT, "share": [0.0, 1.0]}
EXAMPLES = Path(haptix.__file__).parents[1] / "examples" / "scenes"


@pytest.fixture(scope="session")
def carrier():
    """The example: one carrier on one screen."""
    return Scene.load(EXAMPLES / "carrier.toml")


@pytest.fixture(scope="session")
def plain():
    """A half-space without hardness: cheap, and four terms are possible.

    The apparent area does not grow, so that its term has no effect at all.
    """
    return Scene(
        name="plain",
        finger=Finger(name="gel", apparent_area_exponent=0.0),
        screen=Screen(),
        normal_force_n=(0.2, 1.0),
        drive={"scheme": "direct", "frequency_hz": (200.0, 220.0), "max_voltage_v": 60.0},
    )


@pytest.fixture(scope="session")
def plain_plan(plain):
    """Its plan, with a material whose speed is not felt and one whose speed is."""
    return plan_scene(plain.replace(materials=(FLAT, STEEP)), points=150)
