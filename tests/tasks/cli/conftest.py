"""Files that commands read."""

import numpy as np
import pytest
from skimage.io import imsave

import haptix


@pytest.fixture(autouse=True)
def in_own_folder(own_folder):
    """Every command works in an empty folder."""


@pytest.fixture(scope="session")
def surface_file(model, tmp_path_factory):
    """A surface without frequency, 0.2 to 1 N."""
    surface = haptix.FrictionSurface.build(model, {"normal_force_n": (0.2, 1.0)}, tolerance=0.01)
    path = tmp_path_factory.mktemp("surface") / "my.surface"
    surface.save(path)
    return path


@pytest.fixture
def things(own_folder):
    """Files that a person may have lying around."""
    texts = {
        "fragile.toml": 'name = "fragile"\nmax_voltage_v = 120',
        "soft.toml": (
            'name = "soft"\nyoungs_modulus_pa = 1e7\nbulk_modulus_pa = 1e4\n'
            "frictional_shear_stress_pa = 5e6"
        ),
        "short.csv": "t_s,x_mm,y_mm,normal_force_n\n0,5,5,0.5\n0.02,20,9,0.5\n",
        "file": "x",
    }
    for name, text in texts.items():
        (own_folder / name).write_text(text)
    columns = np.mgrid[0:32, 0:32][1]
    grey = (120 + 100 * np.sin(columns / 3)).astype(np.uint8)
    imsave(own_folder / "photo.png", grey, check_contrast=False)
    return own_folder
