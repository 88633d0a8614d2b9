"""A small scene, traded off once for all tests through the command line."""

import json
from types import SimpleNamespace

import pytest

from haptix import Finger, Scene, Screen


@pytest.fixture(scope="session")
def scene():
    """A half-space: cheap, with a frequency that varies."""
    return Scene(
        name="small",
        finger=Finger(name="gel"),
        screen=Screen(),
        normal_force_n=(0.2, 1.0),
        drive={"scheme": "direct", "frequency_hz": (100.0, 400.0)},
        budget_jnd=0.4,
    )


@pytest.fixture(scope="session")
def folder(scene, haptix_cli, tmp_path_factory):
    """What ``haptix tradeoff scene.toml --quick`` leaves, and its JSON."""
    folder = tmp_path_factory.mktemp("tradeoff")
    scene.save(folder / "scene.toml")
    done = haptix_cli(
        "tradeoff", folder / "scene.toml", "--quick", "--out", folder / "out", "--json"
    )
    assert done.code == 0, done.err
    return SimpleNamespace(path=folder / "out", rows=json.loads(done.out))
