"""A surface and a path that are quickly simulated, a folder with files, and one demo."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from skimage.io import imsave

import haptix
from firmware_io import Device, open_device
from haptix.play.simulation import Setting, simulate
from haptix.play.virtual_finger import TouchPanel
from tests.command_line import CommandLine, CommandResult

CARRIER_HZ = 4000.0


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
    return haptix.feel.materials.Grating(period_mm=6.0, wave="sine", low=0.15, high=0.85)


@pytest.fixture(scope="session")
def setting(model, hills, path):
    return Setting(model, hills, path)


@pytest.fixture(scope="session")
def progress():
    """The shares that the simulation told."""
    return []


@pytest.fixture(scope="session")
def simulation(setting, surface, progress):
    """The stroke, felt with touches of a panel."""
    return simulate(setting, surface, TouchPanel(), on_progress=progress.append)


@pytest.fixture
def own_folder(own_folder, path, surface):
    """A folder to work in, with a path, photographs and a surface."""
    columns = (path.t_s, path.x_mm, path.y_mm, path.normal_force_n)
    header = "t_s,x_mm,y_mm,normal_force_n"
    np.savetxt("path.csv", np.column_stack(columns), "%.9g", ",", header=header, comments="")
    (own_folder / "backwards.csv").write_text(f"{header}\n1,1,1,1\n0,1,1,1\n")
    grey = (120 + 100 * np.sin(np.mgrid[0:40, 0:80][1] / 4)).astype(np.uint8)
    imsave("photo.png", grey, check_contrast=False)
    (own_folder / "file").write_text("x")
    (own_folder / "text.surface").write_text("x")
    surface.save("my.surface")
    return own_folder


@pytest.fixture
def undrawn(monkeypatch):
    """No picture, which takes longer than the rest: where other outputs are looked at."""
    draw = "haptix.play.simulation.folder.draw"
    monkeypatch.setattr(draw, lambda simulation, file, **_: file.write_bytes(b"no picture"))


DEMO_PATH = """t_s,x_mm,y_mm,normal_force_n
0.00,5,5,0.40
0.03,15,9,0.50
0.06,22,14,0.55
0.10,26,25,0.45
"""


@dataclass(frozen=True)
class DemoRun:
    """One run of ``haptix demo``: its inputs and outputs, its device, and the cache it filled."""

    inputs: Path
    folder: Path
    summary: dict[str, Any]
    device: Device
    cache: Path
    haptix_cli: CommandLine

    def again(self, folder: Path, *options: object) -> CommandResult:
        """Run it with other options."""
        given: tuple[object, ...] = ("--image", self.inputs / "photo.png", "--width-mm", 30)
        given += ("--trajectory", self.inputs / "path.csv", "--json")
        return self.haptix_cli("demo", "--out", folder, *given, *options)


@pytest.fixture(scope="session")
def demo(tmp_path_factory, haptix_cli):
    inputs, cache = tmp_path_factory.mktemp("demo-inputs"), tmp_path_factory.mktemp("demo-cache")
    rows, columns = np.mgrid[0:64, 0:64]
    grey = 127 + 60 * np.sin(columns / 5) + 60 * np.cos(rows / 7)
    imsave(inputs / "photo.png", grey.astype(np.uint8), check_contrast=False)
    (inputs / "path.csv").write_text(DEMO_PATH)
    folder = tmp_path_factory.mktemp("demo") / "deep" / "out"
    devices = []

    def opening(address):
        devices.append(open_device(address))
        return devices[-1]

    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("HAPTIX_CACHE", str(cache))
        patch.setattr("haptix.play.simulation.run.open_device", opening)
        done = DemoRun(inputs, folder, {}, None, cache, haptix_cli).again(folder)
    assert (done.code, done.err) == (0, "")
    (device,), (summary,) = devices, json.loads(done.out)
    return DemoRun(inputs, folder, summary, device, cache, haptix_cli)
