"""One surface for all tests of the renderer."""

import pytest

import haptix

CARRIER_HZ = 3000.0


@pytest.fixture(scope="session")
def surface(model):
    scene = {"normal_force_n": (0.2, 1.0), "frequency_hz": CARRIER_HZ}
    return haptix.FrictionSurface.build(model, scene, tolerance=2e-3)
