"""The figures of roughness and gaps, against moments and areas integrated here."""

from math import pi

import numpy as np
import pytest
import torch

from haptix import ContactModel, Finger, Screen
from haptix.figures import gap_distributions, roughness_spectra

# Last wave, roll-off and C0 of the three spectra, with h_rms 22 um, slope 0.91, H 0.86 for all.
SPECTRA = {
    "finger": (1e9, 3992.9, 4.6013e-18),
    "placeholder_q1_1e8": (1e8, 5981.5, 2.0170e-18),
    "placeholder_q1_1e7": (1e7, 9142.0, 8.570e-19),
}


@pytest.mark.parametrize("name", SPECTRA)
def test_the_spectra_have_the_three_numbers_of_the_finger(figures, name):
    columns = figures["roughness"].columns
    last, rolloff, plateau = SPECTRA[name]
    inside = ~np.isnan(columns[f"c_{name}_m4"])
    q, c = columns["wavenumber_per_m"][inside], columns[f"c_{name}_m4"][inside]
    assert (q[0], q[-1]) == (1e3, last)
    # The plateau is given to four digits at least.
    np.testing.assert_allclose(c[q <= rolloff], plateau, rtol=5e-4)
    steep = q >= rolloff
    exponent = np.diff(np.log(c[steep])) / np.diff(np.log(q[steep]))
    np.testing.assert_allclose(exponent, -2 * (1 + 0.86), rtol=1e-6)
    # Trapezoids in ln q, 60 a decade: (ln(10)/60)^2/12 times exponent^2 is their error, 2e-3.
    h_rms = np.sqrt(2 * pi * np.trapezoid(q**2 * c, np.log(q)))
    slope = np.sqrt(2 * pi * np.trapezoid(q**4 * c, np.log(q)))
    assert h_rms == pytest.approx(22e-6, rel=2e-3)
    # 0.91 in two digits.
    assert slope == pytest.approx(0.91, abs=0.005)
    up_to_q = columns[f"rms_slope_up_to_q_{name}"][inside]
    assert up_to_q[0] == 0
    assert up_to_q[-1] == pytest.approx(slope, rel=2e-3)
    half = len(q) // 2
    part = np.sqrt(2 * pi * np.trapezoid((q**4 * c)[:half], np.log(q[:half])))
    assert up_to_q[half - 1] == pytest.approx(part, rel=5e-3)


@pytest.mark.parametrize("form", ["plain", "combined"])
def test_the_gap_densities_hold_all_that_is_not_in_contact(figures, form):
    columns = figures["gaps"].columns
    contact = ContactModel(Finger.preset("semi-wet"), Screen.preset("3m-sct3250")).contact
    gap, peaks = columns["gap_um"], []
    for pressure_kpa in (3, 20, 200):
        density = columns[f"density_{form}_{pressure_kpa}kpa_per_um"]
        share = np.trapezoid(gap * density, np.log(gap))
        open_area = 1 - float(contact.area_fraction(torch.tensor(1e3 * pressure_kpa)))
        # What is missing lies below the first gap, 0.1 nm, where P falls no faster than u^-0.8:
        # u P/(1 - 0.8) at most. 1e-4 for the trapezoids, and for gaps beyond 0.3 mm.
        missing = open_area - share
        assert -1e-4 < missing < 5 * gap[0] * density[0] + 1e-4
        wide = gap > 5
        peaks.append(gap[wide][density[wide].argmax()])
    # The harder it is pressed, the closer the surfaces.
    assert peaks == sorted(peaks, reverse=True)


def test_the_two_forms_agree_where_the_mean_gap_is_wide(figures):
    columns = figures["gaps"].columns
    plain, combined = (columns[f"density_{f}_3kpa_per_um"] for f in ("plain", "combined"))
    top = np.where(columns["gap_um"] > 5, plain, 0).argmax()
    # Around the peak u1 is the gap, and the roughness left no more than h_rms, 22 um: combined, the
    # strips' normal distributions are narrower by sqrt(1 + (s/u1)^2), and as much higher.
    narrower = np.sqrt(1 + (22 / columns["gap_um"][top]) ** 2)
    assert narrower < 1.1
    assert 1 < combined[top] / plain[top] < narrower
    # Where gaps close u1 goes to zero, and combining narrows them onto zero; at a picometre, since
    # nothing is drawn below 0.1 nm.
    assert columns["gap_um"][0] == pytest.approx(1e-4)
    plain, combined = (
        ContactModel(
            Finger.preset("semi-wet"), Screen.preset("3m-sct3250"), gap_distribution=form
        ).contact.gap_density(3e3, 1e-12)
        for form in ("plain", "combined")
    )
    assert combined > plain


def test_captions_know_a_measured_finger():
    finger = Finger.preset("semi-wet")
    measured = finger.replace(
        roughness=finger.roughness.model_copy(update={"is_placeholder": False})
    )
    assert "No placeholders: all values are measured." in gap_distributions(measured).caption
    assert "the finger's own is measured" in roughness_spectra(measured).caption
