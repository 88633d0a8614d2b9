"""Scenes whose plans are known beforehand, and the command line."""

import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

import haptix
from haptix import Finger, Scene, Screen
from haptix.cli import main
from haptix.planning import plan_scene

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
    """Its plan."""
    return plan_scene(plain, points=150)


@pytest.fixture
def haptix_cli(monkeypatch, capsys):
    """Call ``haptix ARGUMENTS`` on a terminal of 80 columns."""
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.setenv("TERM", "dumb")

    def call(*arguments):
        monkeypatch.setattr(sys, "argv", ["haptix", *map(str, arguments)])
        code = 0
        try:
            main()
        except SystemExit as end:
            code = end.code or 0
        printed = capsys.readouterr()
        return SimpleNamespace(code=code, out=printed.out, err=printed.err)

    return call
