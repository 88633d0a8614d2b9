"""x and the waves of the roll-off under a contact, and what is said below the validated ones."""

from math import pi

import pytest
import torch

from haptix import ContactModel, Finger, Screen
from haptix.contact.meanfield import (
    VALIDATED_WAVES,
    VALIDATED_X,
    beyond_validation,
    shown_accuracy,
)


def test_a_state_says_how_lightly_it_is_loaded_and_by_how_many_waves() -> None:
    finger = Finger.preset("semi-wet").replace(bulk_modulus_pa=None)
    state = ContactModel(finger, Screen()).solve(torch.tensor([0.1, 0.9]), 100.0)
    # The paper's pressures, E* and slope of 0.91 in two digits; physics page, section 8.
    expected = [3e3 / (40e6 / 0.75 * 0.91), 20e3 / (40e6 / 0.75 * 0.91)]
    assert state.x.tolist() == pytest.approx(expected, rel=0.02)
    area = [0.1 / 3e3, 0.9 / 20e3]
    waves = [one * (3992.9 / (2 * pi)) ** 2 for one in area]
    assert state.rolloff_waves.tolist() == pytest.approx(waves, rel=0.02)
    assert state.warnings() == []
    # A touch of 5 mN, on a tenth of the area.
    small = finger.replace(apparent_area_at_1n_m2=finger.apparent_area_at_1n_m2 / 10)
    (load, count) = ContactModel(small, Screen()).solve(5e-4, 10.0).warnings()
    assert "validated from 5e-05" in load
    assert "validated from 4" in count


def test_the_accuracy_that_was_shown() -> None:
    (usual, light) = (shown_accuracy("corrected", x) for x in (6e-4, 6e-5))
    assert usual != light
    assert "28 %" in light
    assert shown_accuracy("corrected", 0.99 * VALIDATED_X) == ""
    assert shown_accuracy("open-gaps", 6e-4) == ""


def test_nothing_is_said_within_what_was_validated() -> None:
    assert beyond_validation(VALIDATED_X, VALIDATED_WAVES) == []
    assert len(beyond_validation(0.99 * VALIDATED_X, VALIDATED_WAVES)) == 1
    assert len(beyond_validation(VALIDATED_X, 0.99 * VALIDATED_WAVES)) == 1
