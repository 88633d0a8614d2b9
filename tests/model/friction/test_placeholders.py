"""What unmeasured values leave open."""

from math import log

import pytest
import torch

from haptix import ContactModel, Finger, Screen
from haptix.model.electro import SKIN_DIELECTRICS
from haptix.model.finger import Roughness
from haptix.model.friction.placeholders import alike, placeholder_spread

SCREEN = Screen.preset("3m-sct3250")
SEMI_WET = Finger.preset("semi-wet")


def closed(finger: Finger) -> ContactModel:
    return ContactModel(finger, SCREEN, fidelity="closed-form")


def test_the_spread_of_the_dielectric_is_the_largest_difference() -> None:
    found = placeholder_spread(closed(SEMI_WET), 0.5, [100.0, 200.0], 125.0)["skin dielectric"]
    own, *others = [
        float(closed(SEMI_WET.replace(dielectric=name)).solve(0.5, 200.0, 125.0).mu)
        for name in SKIN_DIELECTRICS
    ]
    expected = max(abs(log(other / own)) for other in others) / 0.11
    assert float(found[1]) == pytest.approx(expected, rel=1e-12)  # rounding
    assert found[0] < found[1]


def test_without_a_frequency_or_with_measured_values_nothing_is_open() -> None:
    assert set(placeholder_spread(closed(SEMI_WET), 0.5, 200.0)) == {"roughness"}
    measured = SEMI_WET.replace(
        roughness=SEMI_WET.roughness.model_copy(update={"is_placeholder": False}),
        dielectric=SEMI_WET.dielectric.model_copy(update={"is_placeholder": False}),
    )
    assert placeholder_spread(closed(measured), 0.5, 200.0, 125.0) == {}


@pytest.mark.parametrize("roughness", [Roughness(), Roughness(h_rms_m=5e-6, hurst=0.7)])
def test_spectra_that_are_alike_have_the_same_three_numbers(roughness: Roughness) -> None:
    others = alike(roughness)
    assert {other.q1_per_m for other in others} == {1e7, 1e8}
    for other in others:
        for moment in (1, 3):  # of h_rms and of the slope, to brentq's tolerance
            one, two = (r.spectrum().moment(moment) for r in (roughness, other))
            torch.testing.assert_close(one, two, rtol=1e-7, atol=0.0)
        assert other.hurst == roughness.hurst


def test_the_spectra_of_the_physics_page() -> None:
    # Section 3, whose three numbers are printed to four digits.
    found = {log(r.q1_per_m, 10): r.q_rolloff_per_m for r in alike(Roughness())}
    assert found == pytest.approx({7: 9142.0, 8: 5981.5}, rel=1e-4)
