"""A small scene, traded off once for all tests through the command line."""

import contextlib
import io
import json
import sys
from types import SimpleNamespace

import pytest

from haptix import Finger, Scene, Screen
from haptix.cli import main


def call(*arguments):
    """Run ``haptix ARGUMENTS`` in this process."""
    out, err = io.StringIO(), io.StringIO()
    with (
        pytest.MonkeyPatch.context() as patch,
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(err),
    ):
        patch.setattr(sys, "argv", ["haptix", *map(str, arguments)])
        patch.setenv("COLUMNS", "80")
        patch.setenv("TERM", "dumb")
        code = 0
        try:
            main()
        except SystemExit as end:
            code = end.code or 0
    return SimpleNamespace(code=code, out=out.getvalue(), err=err.getvalue())


@pytest.fixture
def haptix_cli():
    """Call the command line."""
    return call


@pytest.fixture(scope="session")
def scene():
    """A half-space: cheap, with a frequency that varies."""
    return Scene(
        name="small",
        finger=Finger(name="gel"),
        screen=Screen(),
        normal_force_n=(0.2, 1.0),
        drive={"scheme": "direct", "frequency_hz": (100.0, 400.0)},
        budget_thresholds=0.4,
    )


@pytest.fixture(scope="session")
def folder(scene, tmp_path_factory):
    """What ``haptix tradeoff scene.toml --quick`` leaves, and its JSON."""
    folder = tmp_path_factory.mktemp("tradeoff")
    scene.save(folder / "scene.toml")
    done = call("tradeoff", folder / "scene.toml", "--quick", "--out", folder / "out", "--json")
    assert done.code == 0, done.err
    return SimpleNamespace(path=folder / "out", rows=json.loads(done.out))
