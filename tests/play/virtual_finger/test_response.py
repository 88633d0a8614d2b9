"""The first-order response, against an ODE solver and closed forms."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from haptix import ContactModel
from haptix.model.finger import FingerResponse
from haptix.play.virtual_finger import VirtualFinger

A_LENGTH = FingerResponse(1 / (2 * np.pi))  # 1/e is left after 1 mm

RESPONSE_HZ_PER_MM_PER_S = 13.8


def test_a_varying_speed_agrees_with_an_ode_solver():
    rate, seconds = 20_000.0, 0.5
    time = np.arange(int(rate * seconds) + 1) / rate

    def speed(t):
        return 40.0 * np.sin(2 * np.pi * 3.0 * t) ** 2 + 1.0

    def distance(t):
        return 21.0 * t - 20.0 * np.sin(4 * np.pi * 3.0 * t) / (4 * np.pi * 3.0)

    def drive(t):
        return 1.0 + np.sin(2 * np.pi * 90.0 * t) + 0.5 * np.cos(2 * np.pi * 400.0 * t)

    def slope(t, y):
        return 2 * np.pi * RESPONSE_HZ_PER_MM_PER_S * speed(t) * (drive(t) - y)

    oracle = solve_ivp(slope, (0, seconds), [3.0], "DOP853", time, rtol=1e-10, atol=1e-12)
    found = FingerResponse(RESPONSE_HZ_PER_MM_PER_S).follow(
        drive(time)[None], distance(time), np.array([3.0])
    )
    # Straight lines between samples: (2 pi f / rate)^2 / 8 = 0.2 % of the 400 Hz part, its half.
    np.testing.assert_allclose(found[0], oracle.y[0], atol=1.5e-3)


def test_a_line_in_distance_is_exact_whatever_the_steps():
    """``drive = a + b x`` is answered by ``a + b (x - 1) + c exp(-x)``: no error of a step."""
    steps = np.random.default_rng(7).exponential(0.3, 1000) * (np.arange(1000) % 3 > 0)
    depth = np.concatenate([[0.0], np.cumsum(steps)])
    found = A_LENGTH.follow((2.0 + 0.7 * depth)[None], depth, np.array([5.0]))
    exact = 2.0 + 0.7 * (depth - 1) + (5.0 - 1.3) * np.exp(-depth)
    np.testing.assert_allclose(found[0], exact, rtol=1e-12)


@settings(deadline=None)
@given(
    steps=st.lists(st.one_of(st.just(0.0), st.floats(1e-14, 1e4)), min_size=1, max_size=400),
    seed=st.integers(0, 2**32 - 1),
)
def test_the_response_equals_its_plain_loop_and_stays_within_the_drive(steps, seed):
    depth = np.concatenate([[0.0], np.cumsum(steps)])
    drive = np.random.default_rng(seed).uniform(0, 1, (2, len(depth)))
    before = np.array([0.0, 1.0])
    found = A_LENGTH.follow(drive, depth, before)
    plain = before.copy()
    for k, step in enumerate(np.diff(depth), 1):
        decay = np.exp(-step)
        share = -np.expm1(-step) / step if step > 1e-9 else 1 - step / 2
        plain = decay * plain + (share - decay) * drive[:, k - 1] + (1 - share) * drive[:, k]
        np.testing.assert_allclose(found[:, k], plain, rtol=1e-12, atol=1e-14)
    assert found.min() >= -1e-12
    assert found.max() <= 1 + 1e-12


@pytest.mark.parametrize("speed", [5.0, 20.0, 80.0])
def test_a_step_of_the_drive_is_felt_after_the_same_distance_at_any_speed(model, stroke, speed):
    rate = 48_000
    seconds = 0.8 / speed  # 35 lengths at either side of the step
    time = np.arange(int(seconds * rate)) / rate
    on = 0.5 * seconds
    amplitude = np.where(time >= on, 40.0, 0.0)
    felt = VirtualFinger(model).feel_carrier(
        amplitude, rate, 4000.0, **stroke(seconds, speed_mm_per_s=speed), output_rate_hz=rate
    )
    slid_mm = (felt.t_s - on) * speed
    off, end = felt.mu[0], felt.mu[-5]
    length_mm = 1 / (2 * np.pi * 13.8)
    expected = off + (end - off) * -np.expm1(-np.maximum(slid_mm, 0.0) / length_mm)
    # 40 V change friction by 2 %, in which it is linear within 2 %; the step's flank is one sample
    # wide, up to 0.15 lengths at the highest speed.
    inside = felt.t_s < seconds * 0.999
    assert np.abs(felt.mu - expected)[inside].max() < 0.1 * (end - off)


def test_the_ripple_is_down_by_3_db_at_the_cut_off(model, stroke):
    """A small sine on the squared amplitude at f_c = 13.8 Hz per mm/s."""
    rate, speed = 48_000, 10.0
    time = np.arange(rate) / rate

    def ripple(frequency):
        amplitude = 40.0 * np.sqrt(1 + 0.5 * np.sin(2 * np.pi * frequency * time))
        path = stroke(0.4, speed_mm_per_s=speed, start_s=0.2)  # a whole period of 4 Hz
        mu = VirtualFinger(model).feel_carrier(amplitude, rate, 4000.0, **path).mu
        return np.ptp(mu[1000:])

    # Against 4 Hz, which passes whole within (4/138)^2/2; friction's own curvature is some 1e-4.
    assert ripple(138.0) / ripple(4.0) == pytest.approx(np.sqrt(0.5), rel=5e-3)
    assert ripple(1380.0 / 5) / ripple(4.0) == pytest.approx(1 / np.sqrt(5.0), rel=5e-3)


def test_the_cut_off_is_that_of_the_finger(model, stroke):
    rate, speed, frequency = 48_000, 10.0, 138.0
    slow = ContactModel(model.finger.replace(response_hz_per_mm_per_s=6.9), model.screen)
    amplitude = 40.0 * np.sqrt(1 + 0.5 * np.sin(2 * np.pi * frequency * np.arange(rate) / rate))
    path = stroke(0.2, speed_mm_per_s=speed, start_s=0.2)
    usual, halved = (
        np.ptp(VirtualFinger(one).feel_carrier(amplitude, rate, 4000.0, **path).mu[1000:])
        for one in (model, slow)
    )
    # First order, at the cut-off and at twice the cut-off.
    assert halved / usual == pytest.approx(np.sqrt(2 / 5), rel=5e-3)


def test_a_standing_finger_keeps_what_it_had(model):
    """The drive comes on while the finger stands: nothing is felt of it before it slides."""
    rate = 48_000
    time = np.arange(3 * rate // 2) / rate
    drive = np.where(time > 0.6, 150.0, 0.0) * np.sin(2 * np.pi * 4000.0 * time)
    felt = VirtualFinger(model).feel(
        drive, rate, [0.0, 0.5, 1.0, 1.5], [0.0, 10.0, 10.0, 20.0], 0.0, 0.5
    )
    off, on = (float(model.solve(0.5, v, 4000.0).mu) for v in (0.0, 150.0))
    again = np.flatnonzero(felt.t_s >= 1.0)[0]
    # One sample at 20 mm/s is 0.17 lengths: the old friction is still there when sliding begins.
    assert felt.mu[again + 1] < off + 0.35 * (on - off)
    # 20 lengths on it is the new one.
    assert felt.mu[again + 115] == pytest.approx(on, rel=1e-4)
