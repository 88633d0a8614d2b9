"""The paper's finger, solved once."""

import pytest

from haptix import ContactModel, Finger, Screen


@pytest.fixture(scope="session")
def semi_wet() -> ContactModel:
    """Semi-wet skin on a screen whose own limit lies far beyond pull-in."""
    return ContactModel(Finger.preset("semi-wet"), Screen(max_voltage_v=1e4))


@pytest.fixture(scope="session")
def published(semi_wet: ContactModel) -> ContactModel:
    """The same by the paper's area and gaps, for what is compared with published numbers."""
    return ContactModel(semi_wet.finger, semi_wet.screen, theory="open-gaps")
