"""A finger, a predictor of it, and recordings whose friction is known because it was put in."""

import numpy as np
import pytest

import haptix
from calibration import Parameters, Stroke, StrokePredictor, StrokeRecording
from calibration.measure.reduction import Point, Reduced
from calibration.plan.predict import StrokeConditions
from haptix.model.friction import in_theory


@pytest.fixture(scope="session")
def finger(finger):
    """In the theory that is solved 20 times as fast as the default; what a fit shows is the same.

    The default theory is fitted in test_fitting.py, and by the start page of technicians.
    """
    return in_theory(finger, "open-gaps")


@pytest.fixture(scope="session")
def screen(screen):
    return screen.replace(name="panel 7")


@pytest.fixture(scope="session")
def predictor(finger, screen):
    return StrokePredictor(haptix.ContactModel(finger, screen))


@pytest.fixture
def parameters(finger, screen):
    return Parameters.of(finger, screen)


@pytest.fixture
def stroke():
    return Stroke(number=1, normal_force_n=0.5, voltage_v=100.0, frequency_hz=125.0)


IDLE_S = 0.3


def record(stroke, mu=0.3, ripple=0.1, **faults):
    """A stroke of friction ``mu (1 + ripple cos(2 pi 2f t))``, with faults by name."""
    fault = {
        "noise_n": 2e-3,
        "drift_n_per_s": 0.0,
        "offset_n": 0.0,
        "crosstalk": 0.0,
        "tremor": 0.0,
        "force_share": 1.0,
        "speed_share": 1.0,
        "way_share": 1.0,
        "rate_hz": 10_000.0,
        "seed": 0,
    }
    assert set(faults) <= set(fault), faults
    fault |= faults
    rng = np.random.default_rng(fault["seed"])
    speed = stroke.speed_mm_per_s * fault["speed_share"]
    length = stroke.length_mm * fault["way_share"]
    slide = length / speed if length else stroke.length_mm / speed
    ways = 1 + stroke.there_and_back
    knots_t, knots_x = [0.0, IDLE_S + 0.2], [0.0, 0.0]
    for way in range(ways):
        knots_t += [knots_t[-1] + slide, knots_t[-1] + slide + 0.1]
        knots_x += [length * (1 - way)] * 2
    end = knots_t[-1]
    t = np.arange(0.0, end + 0.1 + IDLE_S, 1 / fault["rate_hz"])
    x = np.interp(t, knots_t, knots_x)
    touch = np.interp(t, [IDLE_S, IDLE_S + 0.05, end, end + 0.05], [0.0, 1.0, 1.0, 0.0])
    waves = np.sin(2 * np.pi * 4.3 * t + 1) + np.sin(2 * np.pi * 7.7 * t)
    force = stroke.normal_force_n * fault["force_share"] * touch * (1 + fault["tremor"] * waves)
    direction = np.sign(np.gradient(x, t))
    wave = 1 + ripple * np.cos(2 * np.pi * 2 * stroke.frequency_hz * t + 0.7)
    shear = direction * mu * force * wave
    drift = fault["offset_n"] + fault["drift_n_per_s"] * t
    return StrokeRecording(
        stroke,
        t_s=t,
        normal_force_n=force
        + fault["crosstalk"] * shear
        + drift
        + rng.normal(0, fault["noise_n"], len(t)),
        tangential_force_n=shear
        + fault["crosstalk"] * force
        + drift
        + rng.normal(0, fault["noise_n"], len(t)),
        x_mm=x,
        drive_v=stroke.voltage_v * np.sin(2 * np.pi * stroke.frequency_hz * t),
    )


@pytest.fixture(scope="session")
def recorded():
    return record


def synthetic(predictor, protocol, truth, rng, repeatability=0.01):
    """Reduced strokes of a protocol, as the model has them, with scatter put on."""
    strokes = list(protocol.strokes)
    planned = StrokeConditions.of(strokes)
    count = len(strokes)
    made = StrokeConditions(
        planned.normal_force_n * rng.normal(1, 0.05, count),
        planned.voltage_v,
        planned.frequency_hz,
        planned.speed_mm_per_s * rng.normal(1, 0.05, count),
    )
    found = predictor(made, truth.names, truth.log_values, jacobian=False)
    assert found.is_light.all()
    mu = np.exp(found.log_mu + rng.normal(0, repeatability, count))
    ripple = found.ripple * rng.normal(1, 0.01, count) + rng.normal(0, 1e-3, count)
    ripple[(planned.voltage_v == 0) | (planned.frequency_hz > 900)] = np.nan
    return Reduced(
        tuple(
            Point(
                one.number,
                **{name: float(column[i]) for name, column in vars(made).items()},
                mu=float(mu[i]),
                mu_sd=float(0.003 * mu[i]),
                ripple=float(ripple[i]),
                ripple_sd=float(np.hypot(1e-3, 0.01 * ripple[i])),
                held_out=one.held_out,
                contact_s=one.contact_s + 2.0,
                rise=0.0 if one.contact_s else np.nan,
                rise_sd=0.003 if one.contact_s else np.nan,
            )
            for i, one in enumerate(strokes)
        )
    )


@pytest.fixture(scope="session")
def reduced_of():
    return synthetic
