"""A surface and a path that are quickly rehearsed, and a folder with files."""

import numpy as np
import pytest
from skimage.io import imsave

import haptix

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
    return haptix.texture.Grating(6.0, "sine", low=0.15, high=0.85)


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
