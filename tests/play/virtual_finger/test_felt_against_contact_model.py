"""What the virtual finger feels, against the contact model's own periods and steady states."""

import math

import numpy as np
import pytest

import haptix.play.virtual_finger.finger
from haptix import ContactModel, Finger, Screen, Status
from haptix.model.perception.thresholds import WEBER_FRACTION
from haptix.model.waves import Waveform
from haptix.play.virtual_finger import VirtualFinger

RATE = 48_000
FORCE, VOLTAGE = 0.5, 150.0
# The polynomial over the gaps holds the pull within 1e-4, whose share in friction is below 1; the
# finger's bins have their exact mean where the period's have the field at their middle (4e-4 of the
# pull at most, and most of the pull comes from where that is far less). The pull of the narrowest
# gaps, where both are least exact, counts about twice in the area. A fiftieth of a threshold is
# what the renderer's judge must keep: here a quarter of that.
CLOSE = 0.005 * WEBER_FRACTION
JUDGED = 0.02 * WEBER_FRACTION


def square(phase):
    return np.where(phase < 0.5, 1.0, -1.0)


def sine(phase):
    return np.cos(2 * np.pi * phase)


def modulated(phase):
    """A carrier 40 times the envelope's frequency, whose square is a pure copy of the envelope."""
    return np.sqrt((1 + 0.8 * np.cos(2 * np.pi * phase)) / 2) * np.sin(2 * np.pi * 40 * phase)


def with_mean(phase):
    return 0.5 + 0.5 * np.sin(2 * np.pi * phase)


SHAPES = {
    "sine": (sine, 120.0),
    "sine-1khz": (sine, 1000.0),
    "square": (square, 120.0),
    "modulated": (modulated, 100.0),
    "with-mean": (with_mean, 200.0),
}


def compare(model, shape, frequency_hz, voltage_v=VOLTAGE, force_n=FORCE):
    """Largest difference in mu, relative, over three periods; and the period."""
    samples = round(RATE / frequency_hz)
    waveform = Waveform.of_samples(shape(np.arange(samples) / samples))
    period_v = voltage_v * waveform.at(np.arange(samples) / samples)
    # Half a second of steady drive on both sides: more than the skin remembers.
    periods = math.ceil(1.1 * frequency_hz)
    at_s = round(0.5 * frequency_hz) / frequency_hz
    finger = VirtualFinger(model, has_response=False)
    felt = finger.feel(
        np.tile(period_v, periods),
        RATE,
        t_s=[at_s, at_s + 3 / frequency_hz],
        x_mm=[0.0, 1.0],
        y_mm=0.0,
        normal_force_n=force_n,
        output_rate_hz=4 * RATE,
    )
    wanted = model.over_period(force_n, voltage_v, frequency_hz, waveform, samples=samples)
    got = felt.mu[::4][: 3 * samples]
    return np.abs(got / np.tile(wanted.mu.numpy(), 3) - 1).max(), wanted, felt


@pytest.mark.parametrize("name", SHAPES)
def test_a_periodic_drive_is_felt_as_its_period_is_solved(model, name):
    difference, period, felt = compare(model, *SHAPES[name])
    assert difference < CLOSE
    # That is no comparison of constants, but for the square wave, whose ripple is dispersion's.
    assert float(period.mu.max() / period.mu.min()) > 1.2
    assert (felt.status == Status.OK).all()


VARIANTS = {
    "leaky-gap": ({}, {"gap_resistivity_ohm_m": 1e6}, {}),
    "as-published": ({}, {}, {"theory": "as-published"}),
    "finite-size": ({}, {}, {"terms": {"finite-size": True}}),
    "closed-form": ({}, {}, {"fidelity": "closed-form"}),
    "no-dielectric": ({}, {}, {"terms": {"skin-dielectric": False}}),
    "constant-area": ({}, {}, {"terms": {"apparent-area": False}}),
}


@pytest.mark.parametrize("name", VARIANTS)
def test_every_term_of_the_model_is_felt(name):
    finger, screen, settings = VARIANTS[name]
    model = ContactModel(Finger.preset("semi-wet").replace(**finger), Screen(**screen), **settings)
    # A square wave has frequencies enough for every insulator.
    difference, period, _ = compare(model, square, 120.0, voltage_v=60.0, force_n=0.3)
    assert difference < CLOSE
    assert not period.status.any()


@pytest.mark.parametrize("frequency", [60.0, 400.0, 1000.0])
def test_the_usual_rate_holds_every_direct_drive(model, stroke, frequency):
    """At 10 kHz the squared field passes to 2 kHz, the ripple of the highest direct drive."""
    time = np.arange(RATE) / RATE
    drive = VOLTAGE * np.cos(2 * np.pi * frequency * time)
    felt = VirtualFinger(model, has_response=False).feel(drive, RATE, **stroke(0.2))
    middle = np.abs(felt.t_s - 0.1) < 0.05
    # At the very instants of the result: the samples of one period of 100 us each or finer.
    samples = round(10_000 / frequency * 60)
    period = model.over_period(FORCE, VOLTAGE, frequency, samples=samples)
    place = felt.t_s[middle] * frequency % 1 * samples
    wanted = np.interp(place, np.arange(samples + 1), np.append(period.mu, period.mu[0]))
    # Straight lines at 96 kHz take 0.14 % of a ripple at 2 kHz, and those of `wanted` less.
    assert np.abs(felt.mu[middle] / wanted - 1).max() < JUDGED


def test_closed_form_light_contact_under_a_sine(stroke):
    """``mu = mu0 / (1 - 2 (V0/Vc)^2 cos^2(wt))`` without dispersion, for any force."""
    model = ContactModel(
        Finger.preset("semi-wet"),
        Screen.preset("3m-sct3250"),
        fidelity="closed-form",
        terms={"skin-dielectric": False},
    )
    time = np.arange(RATE // 2) / RATE
    drive = 100.0 * np.cos(2 * np.pi * 200.0 * time)
    felt = VirtualFinger(model, has_response=False).feel(
        drive, RATE, **stroke(0.5), output_rate_hz=4 * RATE
    )
    off = model.solve(FORCE, 0.0)
    # Light contact is said to end at 31 p0, which the formula reaches at (1 - 1/31) Vc^2.
    critical2 = float(off.pull_in_voltage_v) ** 2 / (1 - 1 / 31)
    share = 2 * 100.0**2 / critical2 * np.cos(2 * np.pi * 200.0 * felt.t_s) ** 2
    inside = np.abs(felt.t_s - 0.25) < 0.2
    # Straight lines at 4 * 192 kHz between samples at 96 kHz: (pi 400/96e3)^2/2 = 9e-5 of a ripple.
    expected = float(off.mu) / (1 - share)
    np.testing.assert_allclose(felt.mu[inside], expected[inside], rtol=1e-4)


@pytest.mark.parametrize("carrier", [3000.0, 4000.0, 12_000.0, 20_000.0])
def test_a_carrier_is_felt_as_its_amplitude_is_solved(model, stroke, carrier):
    time = np.arange(RATE) / RATE
    slow = 110.0 + 70.0 * np.sin(2 * np.pi * 2.0 * time)
    drive = slow * np.sin(2 * np.pi * carrier * time)
    # Where a drive begins or ends at once, the band's edge rings on for some 10 ms at 3 kHz.
    path = stroke(0.8, speed_mm_per_s=100.0, start_s=0.1)
    felt = VirtualFinger(model).feel(drive, RATE, **path)
    # The response lags 11.5 um behind, 0.12 ms here: the amplitude of that much earlier.
    lag = 1 / (2 * np.pi * 13.8 * 100.0)
    amplitude = 110.0 + 70.0 * np.sin(2 * np.pi * 2.0 * (felt.t_s - lag))
    wanted = model.solve(FORCE, amplitude, carrier).mu.numpy()
    # It begins without a past, and lags so only after a few times 11.5 um.
    begun = felt.t_s > 0.102
    assert np.abs(felt.mu / wanted - 1)[begun].max() < 0.1 * JUDGED


def test_an_ideal_carrier_is_the_sampled_one_without_its_modulation(model, stroke):
    time = np.arange(RATE) / RATE
    amplitude = 100.0 + 60.0 * np.sin(2 * np.pi * 40.0 * time)
    finger = VirtualFinger(model)
    path = stroke(0.9, start_s=0.05)
    ideal = finger.feel_carrier(amplitude, RATE, 4000.0, **path)
    sampled = finger.feel(amplitude * np.sin(2 * np.pi * 4000.0 * time), RATE, **path)
    # Sidebands 40 Hz from the carrier meet insulators that differ by less than 0.5 %.
    np.testing.assert_allclose(sampled.mu, ideal.mu, rtol=0.1 * JUDGED)
    assert ideal.mu.max() / ideal.mu.min() > 1.1


def test_no_drive_is_friction_without_voltage(model, stroke):
    felt = VirtualFinger(model).feel(np.zeros(4), RATE, **stroke(0.1, normal_force_n=0.3))
    np.testing.assert_allclose(felt.mu, float(model.solve(0.3, 0.0).mu), rtol=1e-9)
    np.testing.assert_allclose(felt.friction_force_n, 0.3 * felt.mu, rtol=1e-15)


def test_polarity_and_the_clock_do_not_matter(model, stroke):
    random = np.random.default_rng(3)
    drive = np.clip(random.normal(0, 60, 9600), -190, 190)
    finger = VirtualFinger(model)
    felt = finger.feel(drive, RATE, **stroke(0.2))
    turned = finger.feel(-drive, RATE, **stroke(0.2))
    np.testing.assert_allclose(turned.mu, felt.mu, rtol=1e-12)
    # A whole number of samples, so that the same instants are read; times of 1e3 s have 1e-13.
    later = finger.feel(drive, RATE, **stroke(0.2, start_s=1000.0), start_s=1000.0)
    np.testing.assert_allclose(later.mu, felt.mu, rtol=1e-7)
    np.testing.assert_allclose(later.t_s - 1000.0, felt.t_s, atol=1e-9)


def test_long_paths_are_felt_in_parts_without_seams(model, stroke, monkeypatch):
    random = np.random.default_rng(4)
    drive = np.clip(random.normal(0, 60, RATE), -190, 190)
    whole = VirtualFinger(model).feel(drive, RATE, **stroke(1.0, speed_mm_per_s=5.0))
    monkeypatch.setattr(haptix.play.virtual_finger.finger, "PART_S", 0.3)
    parts = VirtualFinger(model).feel(drive, RATE, **stroke(1.0, speed_mm_per_s=5.0))
    # Each part has half a second of the drive on both sides, faded out: what lies beyond, and the
    # slowest part of it, are forgotten. A ten-thousandth of a JND.
    np.testing.assert_allclose(parts.mu, whole.mu, rtol=2e-4 * WEBER_FRACTION)


def test_drive_before_and_after_the_path_counts_only_there(model, stroke):
    time = np.arange(RATE // 2) / RATE
    drive = VOLTAGE * np.sin(2 * np.pi * 4000.0 * time)
    off = float(model.solve(FORCE, 0.0).mu)
    felt = VirtualFinger(model).feel(drive, RATE, **stroke(1.0, start_s=-0.25))
    driven = (felt.t_s > 0.005) & (felt.t_s < 0.495)
    silent = (felt.t_s < -0.005) | (felt.t_s > 0.51)
    assert (felt.mu[driven] > 1.1 * off).all()
    # What the band's edge leaves 5 ms from a step, and the response's memory of 20 lengths.
    np.testing.assert_allclose(felt.mu[silent], off, rtol=1e-4)


def test_a_drive_past_the_light_contact_says_so(stroke):
    model = ContactModel(Finger.preset("semi-wet"), Screen(max_voltage_v=1e4))
    end = float(model.solve(FORCE, 0.0, 4000.0).pull_in_voltage_v)
    time = np.arange(RATE // 5) / RATE
    drive = 1.2 * end * time / time[-1] * np.sin(2 * np.pi * 4000.0 * time)
    felt = VirtualFinger(model).feel(drive, RATE, **stroke(0.2))
    snapped = felt.status == Status.PULL_IN
    # The amplitude rises to the end at 1/1.2 of the stroke, and the response is 0.2 ms late.
    assert felt.t_s[snapped.argmax()] == pytest.approx(0.2 / 1.2, abs=0.001)
    inside = snapped & (felt.t_s < 0.199)
    # As the model has it past the end: the values of the end, no NaN.
    at_end = model.solve(FORCE, 1.01 * end, 4000.0)
    np.testing.assert_allclose(felt.mu[inside], float(at_end.mu), rtol=1e-3)


def test_breakdown_is_said_where_that_term_is_on(stroke):
    model = ContactModel(
        Finger.preset("semi-wet"), Screen.preset("3m-sct3250"), terms={"breakdown": True}
    )
    limit = float(model.solve(FORCE, 0.0, 4000.0).breakdown_voltage_v)
    time = np.arange(RATE // 5) / RATE
    carrier = np.sin(2 * np.pi * 4000.0 * time)
    for drive, broken in ((0.98 * limit * carrier, False), (1.02 * limit * carrier, True)):
        felt = VirtualFinger(model).feel(drive, RATE, **stroke(0.1, start_s=0.05))
        assert ((felt.status == Status.BREAKDOWN) == broken).all()
    ideal = VirtualFinger(model).feel_carrier(
        np.full(4, 1.02 * limit), 10.0, 4000.0, **stroke(0.1, start_s=0.05)
    )
    assert (ideal.status == Status.BREAKDOWN).all()
