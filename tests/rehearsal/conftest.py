"""A model, a surface and a path that are quickly rehearsed, and the command line in a folder."""

import sys
from types import SimpleNamespace

import numpy as np
import pytest
from skimage.io import imsave

import haptix
from haptix.cli import main

CARRIER_HZ = 4000.0


@pytest.fixture(scope="session")
def model():
    return haptix.ContactModel(haptix.Finger.preset("semi-wet"), haptix.Screen.preset("3m-sct3250"))


@pytest.fixture(scope="session")
def surface(model):
    scene = {"normal_force_n": (0.3, 0.8), "frequency_hz": CARRIER_HZ}
    return haptix.FrictionSurface.build(model, scene, tolerance=2e-3)


@pytest.fixture(scope="session")
def path():
    """A stroke of 0.4 s that speeds up, with a force that changes."""
    t = np.linspace(0.0, 0.4, 41)
    x = 5 + 60 * t + 40 * t**2
    return haptix.Trajectory(t, x, 10 + 10 * t, 0.5 + 0.2 * np.sin(9 * t))


@pytest.fixture(scope="session")
def hills():
    """Smooth waves between 0.15 and 0.85 of what is reachable."""
    return haptix.texture.Grating(6.0, "sine", low=0.15, high=0.85)


@pytest.fixture
def own_folder(tmp_path, monkeypatch, path, surface):
    """An empty folder to work in, with a path, photographs and a surface."""
    folder = tmp_path / "work"
    folder.mkdir()
    monkeypatch.chdir(folder)
    monkeypatch.setenv("HAPTIX_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.setenv("NO_COLOR", "1")
    monkeypatch.setenv("TERM", "dumb")
    for name in ("FORCE_COLOR", "CLICOLOR_FORCE", "PY_COLORS"):
        monkeypatch.delenv(name, raising=False)
    columns = (path.t_s, path.x_mm, path.y_mm, path.normal_force_n)
    header = "t_s,x_mm,y_mm,normal_force_n"
    np.savetxt("path.csv", np.column_stack(columns), "%.9g", ",", header=header, comments="")
    (folder / "backwards.csv").write_text(f"{header}\n1,1,1,1\n0,1,1,1\n")
    grey = (120 + 100 * np.sin(np.mgrid[0:40, 0:80][1] / 4)).astype(np.uint8)
    imsave("photo.png", grey, check_contrast=False)
    (folder / "file").write_text("x")
    (folder / "text.surface").write_text("x")
    surface.save("my.surface")
    return folder


@pytest.fixture
def haptix_cli(monkeypatch, capsys):
    """Call ``haptix ARGUMENTS``; an exception that leaves main is a traceback for the user."""

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
