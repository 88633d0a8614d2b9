"""Small surfaces, each built once."""

import pytest

from haptix import ContactModel, Finger, FrictionSurface, Screen


@pytest.fixture(scope="session")
def plain(model: ContactModel) -> FrictionSurface:
    """Force and voltage alone, at one insulator."""
    scene = {"normal_force_n": (0.2, 1.0), "h0_m": 2e-7}
    return FrictionSurface.build(model, scene, tolerance=4e-3)


@pytest.fixture(scope="session")
def full(model: ContactModel) -> FrictionSurface:
    """All four axes."""
    scene = {
        "normal_force_n": (0.3, 0.9),
        "voltage_v": (0.0, 150.0),
        "frequency_hz": (60.0, 500.0),
        "h0_m": (1e-7, 3e-7),
    }
    return FrictionSurface.build(model, scene, tolerance=8e-3)


@pytest.fixture(scope="session")
def hungry() -> ContactModel:
    """A screen that may be driven past pull-in, in a theory where no other limit comes first."""
    screen = Screen(max_voltage_v=400.0)
    return ContactModel(Finger.preset("semi-wet"), screen, theory="corrected")


@pytest.fixture(scope="session")
def past_pull_in(hungry: ContactModel) -> FrictionSurface:
    scene = {"normal_force_n": (0.1, 0.5), "h0_m": 5e-8}
    return FrictionSurface.build(hungry, scene, tolerance=1e-2)
