"""What a force sensor's bandwidth and another form of the model do to a fit, and what it says."""

import numpy as np
import pytest
import torch

import haptix
from calibration import Parameters, StrokePredictor, fit_strokes, short_protocol
from calibration.fit.fitting import other_forms, reported_within
from calibration.plan.predict import sensor_gain

H0_M = 1.6e-7


def test_the_sensor_s_gain_has_its_closed_form():
    values = {
        "sensor_pole_hz": torch.tensor(500.0),
        "sensor_resonance_hz": torch.tensor(1000.0),
        "sensor_quality": torch.tensor(8.0),
    }
    hertz = torch.tensor([0.0, 500.0, 1000.0], dtype=torch.float64)
    # At rest 1; at the pole 1/sqrt(2) of 1/|1 - 1/4 + i/16|; at the resonance the quality.
    expected = [1.0, 1 / np.sqrt(2) / abs(0.75 + 1j / 16), 8 / np.sqrt(5)]
    assert sensor_gain(values, hertz).numpy() == pytest.approx(expected, rel=1e-6)
    assert sensor_gain({}, hertz).tolist() == [1.0, 1.0, 1.0]


@pytest.fixture(scope="module")
def sensed(predictor, reduced_of, finger, screen):
    """Strokes of a sensor with a pole at 500 Hz, and their truth."""
    truth = Parameters.of(finger, screen).started_at(h0_m=H0_M).with_rig()
    truth = truth.started_at(
        sensor_pole_hz=500.0, sensor_resonance_hz=2e4, response_hz_per_mm_per_s=20.0
    )
    return truth, reduced_of(
        predictor,
        short_protocol(predictor, truth, max_voltage_v=150.0),
        truth,
        np.random.default_rng(5),
    )


def test_a_slow_sensor_leaves_the_intervals_right(sensed, predictor, finger, screen):
    truth, strokes = sensed
    start = Parameters.of(finger, screen).with_rig()
    fit = fit_strokes(strokes, predictor, start, bootstraps=0)
    for one in fit.estimates:
        # Of eleven 90 % intervals one may well miss: twice as wide they hold 99.9 %.
        middle, half = np.log(one.low * one.high) / 2, np.log(one.high / one.low) / 2
        assert abs(np.log(truth[one.name].value) - middle) <= 2 * half, one
    # A tap that measures the pole makes the response a number again.
    tapped = start.known(
        sensor_pole_hz=(500.0, 0.02), sensor_resonance_hz=(2e4, 0.05), sensor_quality=(8.0, 0.1)
    )
    known = fit_strokes(strokes, predictor, tapped, bootstraps=0)["response_hz_per_mm_per_s"]
    assert known.value == pytest.approx(20.0, rel=2 * reported_within(known.name))


@pytest.mark.slow
def test_another_gap_distribution_is_weighed_and_widens(predictor, reduced_of, finger, screen):
    other = StrokePredictor(haptix.ContactModel(finger, screen, gap_distribution="combined"))
    truth = Parameters.of(finger, screen).started_at(h0_m=H0_M)
    strokes = reduced_of(
        other, short_protocol(other, truth, max_voltage_v=150.0), truth, np.random.default_rng(6)
    )
    start = Parameters.of(finger, screen)
    forms = other_forms(predictor.model)
    alone = fit_strokes(strokes, predictor, start, bootstraps=0)
    fit = fit_strokes(strokes, predictor, start, bootstraps=0, forms=forms)
    combined, *theories = fit.forms
    assert [form.form for form in fit.forms] == [
        'gap distribution "combined"', 'theory "local"', 'theory "corrected"',
    ]  # fmt: skip
    # The true form fits best.
    assert combined.evidence < min(theory.evidence for theory in theories)
    away = np.log(combined.h0_ratio)
    # Bayes: before the strokes the default form is twice as likely as either other.
    odds = [0.5 * np.exp(-one.evidence / 2) for one in fit.forms]
    share = odds[0] / (1 + sum(odds))
    expected = np.sqrt(alone["h0_m"].spread ** 2 + share * away**2)
    assert fit["h0_m"].spread >= 0.99 * expected
    assert fit["h0_m"].low <= H0_M <= fit["h0_m"].high
