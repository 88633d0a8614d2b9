"""The paper's finger, solved once."""

import pytest
import torch

from haptix import ContactModel, Finger, Screen

# The arrays are small: on a busy machine threads that wait for each other cost ten times as much.
torch.set_num_threads(1)


@pytest.fixture(scope="session")
def semi_wet() -> ContactModel:
    """Semi-wet skin on a screen whose own limit lies far beyond pull-in."""
    return ContactModel(Finger.preset("semi-wet"), Screen(max_voltage_v=1e4))
