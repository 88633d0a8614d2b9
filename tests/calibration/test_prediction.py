"""The predictor of strokes against the contact model solved in time."""

import numpy as np
import pytest

import haptix
from calibration import StrokePredictor
from calibration.plan.predict import StrokeConditions
from haptix.model.finger import Roughness

FORCE, VOLTS = (a.ravel() for a in np.meshgrid([0.1, 0.5, 0.9], [1e-3, 100.0, 170.0]))
STROKES = StrokeConditions(FORCE, VOLTS, np.resize([125.0, 60.0, 500.0], 9), np.full(9, 50.0))
OTHER = {
    "youngs_modulus_pa": 55e6,
    "h_rms_m": 26e-6,
    "h0_m": 9e-8,
    "frictional_shear_stress_pa": 1e7,
    "apparent_area_at_1n_m2": 40e-6,
    "apparent_area_exponent": 0.2,
    "gap_resistivity_ohm_m": 1e8,
}


def in_time(finger, screen, index, h0_m):
    """Mean and ripple of one stroke by `ContactModel.over_period`."""
    period = haptix.ContactModel(finger, screen).over_period(
        FORCE[index], VOLTS[index], STROKES.frequency_hz[index], h0_m=h0_m
    )
    mu = period.mu.numpy()
    turn = np.exp(2j * 2 * np.pi * np.arange(len(mu)) / len(mu))
    return mu.mean(), 2 * abs((mu * turn).mean()) / mu.mean()


@pytest.mark.slow
def test_another_finger_is_the_same_table_scaled(predictor, parameters):
    # The response off: over_period has none. 1e13 Hz per mm/s follows at once.
    truth = parameters.known(gap_resistivity_ohm_m=(1e8, 1.0)).started_at(
        **OTHER, response_hz_per_mm_per_s=1e13
    )
    found = predictor(STROKES, truth.names, truth.log_values)
    finger = haptix.Finger(
        youngs_modulus_pa=55e6,
        bulk_modulus_pa=10e3 * 55 / 40,
        frictional_shear_stress_pa=1e7,
        theory="open-gaps",  # the predictor's
        apparent_area_at_1n_m2=40e-6,
        apparent_area_exponent=0.2,
        roughness=Roughness(h_rms_m=26e-6),
    )
    screen = haptix.Screen(gap_resistivity_ohm_m=1e8)
    for index in range(len(STROKES)):
        mean, ripple = in_time(finger, screen, index, 9e-8)
        # 24 instants of half a period, and cubic tables of ln p in steps of a tenth.
        assert np.exp(found.log_mu[index]) == pytest.approx(mean, rel=1e-6)
        assert found.ripple[index] == pytest.approx(ripple, rel=1e-5, abs=1e-9)
    assert found.is_light.all()


@pytest.mark.parametrize("terms", [{}, {"finite-size": True}])
def test_the_jacobian_is_the_derivative(predictor, parameters, finger, screen, terms):
    if terms:
        predictor = StrokePredictor(haptix.ContactModel(finger, screen, terms=terms), predictor)
    known = parameters.known(gap_resistivity_ohm_m=(1e8, 1.0))
    at = known.log_values
    found = predictor(STROKES, known.names, at)
    step = 1e-4
    for index, name in enumerate(known.names):
        up, down = (
            predictor(STROKES, known.names, at + side * step * np.eye(len(at))[index], False)
            for side in (1, -1)
        )
        # Curvature times the step squared, and the two tables' difference of 1e-8 over the step.
        for what in ("log_mu", "ripple"):
            expected = (getattr(up, what) - getattr(down, what)) / (2 * step)
            close = pytest.approx(expected, abs=2e-5)
            assert getattr(found, f"{what}_jacobian")[:, index] == close, name


def test_past_the_light_contact_is_said(predictor, parameters):
    thin = parameters.started_at(h0_m=2e-8)
    found = predictor(STROKES, thin.names, thin.log_values)
    assert found.is_light[VOLTS < 1].all()
    assert not found.is_light[VOLTS == 170].all()
    assert np.isfinite(found.log_mu).all()
    assert np.isfinite(found.log_mu_jacobian).all()


def test_the_finger_smooths_the_ripple(predictor, parameters):
    # First order on the pull: for a weak drive the ripple is its gain, the mean stays.
    force_n, voltage_v, frequency_hz = (np.array([v, v]) for v in (0.5, 10.0, 250.0))
    strokes = StrokeConditions(force_n, voltage_v, frequency_hz, np.array([20.0, 1e9]))
    slow_and_fast = predictor(strokes, parameters.names, parameters.log_values)
    gain = 1 / np.hypot(1, 500 / (13.8 * 20))
    slow, fast = slow_and_fast.ripple
    assert slow / fast == pytest.approx(gain, rel=1e-3)  # of a drive of 10 V: nearly linear
    assert slow_and_fast.log_mu[0] == pytest.approx(slow_and_fast.log_mu[1], abs=1e-6)


@pytest.mark.parametrize(
    ("finger", "options", "said"),
    [
        ("dry", {}, r"hardness.*not dry"),
        ("semi-wet", {"theory": "as-published"}, r"contact spots"),
        ("semi-wet", {"fidelity": "closed-form"}, r'expected a fidelity .*"mean-field"'),
    ],
)
def test_models_that_do_not_scale_are_refused(screen, finger, options, said):
    model = haptix.ContactModel(haptix.Finger.preset(finger), screen, **options)
    with pytest.raises(haptix.InputError, match=said):
        StrokePredictor(model)
