"""The safety limits on the host's side."""

import math
from dataclasses import fields, replace
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_io import (
    ABSOLUTE_CEILING_V,
    Device,
    DriveLimits,
    LimitError,
    MockDriver,
    MockLink,
    volts_to_codes,
)
from firmware_io.drive_check import DriveCheck, DriveWindow
from firmware_io.limits import DEFAULT_MAX_SLEW_V_PER_S, RAMP_S
from firmware_io.protocol import Setup, StreamMode


def test_absolute_ceiling():
    assert ABSOLUTE_CEILING_V == 200.0
    assert DriveLimits().ceiling_v == 200.0


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_samples_that_are_not_finite(bad):
    with pytest.raises(LimitError, match=r"Sample 2 .*finite"):
        DriveLimits().check(np.array([0.0, 1.0, bad, bad]), 0.0, 48e3)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_ceiling_is_exact(sign):
    limits = DriveLimits(ceiling_v=150.0)
    limits.check(np.array([sign * 150.0]), 0.0, 8e3)
    above = sign * math.nextafter(150.0, 200.0)
    with pytest.raises(LimitError, match=r"Sample 1 .*ceiling of 150\.0 V"):
        limits.check(np.array([0.0, above, above]), 0.0, 8e3)


def test_slew_by_hand():
    # 1000 V/s at 100 samples per second is 10 V per sample.
    limits = DriveLimits(max_slew_v_per_s=1000.0)
    limits.check(np.array([15.0, 25.0, 15.0]), 5.0, 100.0)
    with pytest.raises(LimitError, match=r"Sample 0 .*15\.01 V"):
        limits.check(np.array([15.01]), 5.0, 100.0)
    with pytest.raises(LimitError, match=r"Sample 2 .*14\.9 V.*10 V per sample"):
        limits.check(np.array([15.0, 25.0, 14.9]), 5.0, 100.0)


# 0.7 mA / (2 pi f 150 pF), and never above the ceiling.
@pytest.mark.parametrize(
    ("carrier_hz", "highest_v"), [(1e3, 200.0), (4e3, 185.7), (10e3, 74.3), (20e3, 37.1)]
)
@pytest.mark.parametrize("rate", [250e3, 1e6])
def test_the_highest_amplitude_of_a_carrier(carrier_hz, highest_v, rate):
    limits = DriveLimits()
    assert limits.highest_sine_v(carrier_hz) == pytest.approx(highest_v, abs=0.05)
    wave = np.sin(2 * np.pi * carrier_hz * np.arange(int(rate) // 10) / rate)
    limits.check(limits.highest_sine_v(carrier_hz) * wave, 0.0, rate)
    # The steepest step is 2 sin(pi f / rate), 1 % less than the slope at 20 kHz in 250 kHz.
    with pytest.raises(LimitError, match=r"ceiling|slew"):
        limits.check(1.02 * highest_v * wave, 0.0, rate)
    envelope = np.full(9, limits.highest_sine_v(carrier_hz))
    limits.check_envelope(envelope, envelope[0], 16e3, carrier_hz)
    with pytest.raises(LimitError, match=r"ceiling|slew"):
        limits.check_envelope(1.001 * envelope, 1.001 * envelope[0], 16e3, carrier_hz)


def test_a_larger_capacitance_lowers_the_slew_and_a_smaller_one_is_refused():
    # An earthed person: 1 nF through 0.7 mA are 0.7 MV/s.
    limits = DriveLimits(capacitance_f=1e-9)
    assert limits.max_slew_v_per_s == pytest.approx(0.7e6)
    assert limits.highest_sine_v(1e3) == pytest.approx(111.4, abs=0.1)
    assert replace(limits, ceiling_v=100.0).max_slew_v_per_s == limits.max_slew_v_per_s
    assert DriveLimits(max_slew_v_per_s=1e5, capacitance_f=1e-9).max_slew_v_per_s == 1e5
    assert DriveLimits(max_peak_a=0.35e-3).max_slew_v_per_s == pytest.approx(2.333e6, rel=1e-3)
    with pytest.raises(LimitError, match=r"capacitance_f .*1\.5e-10"):
        DriveLimits(capacitance_f=149e-12)


def test_the_rms_of_the_current_by_hand():
    # A triangle of 0.6 mA: 150 pF at 4 V a microsecond, up and down; the limit is 0.5 mA, so that
    # (5 / 6)^2 = 0.694 of a second of it pass. A slower one, of 0.499 mA, passes for ever.
    rate = 48_000
    for slew, most in ((4e6, 0.6944), (0.499e-3 / 150e-12, 10.0)):
        step_v = slew / rate
        wave = step_v * np.resize([0.5, -0.5], 3 * rate)
        seen, passed = DriveWindow(DriveLimits(), rate), 0
        try:
            for block in np.split(wave, 3000):
                seen.check(block)
                seen.take(block)
                passed += block.size
        except LimitError as error:
            assert "0.5 mA rms through 150 pF, above the limit of 0.5 mA" in str(error)
        assert passed == pytest.approx(min(most, 3.0) * rate, abs=48)
    seen.rest(10)
    seen.check(np.zeros(10))


def test_no_samples_break_no_limit():
    assert DriveLimits().check(np.empty(0), 200.0, 48e3) is None


@given(
    st.floats(-200.0, 200.0),
    st.floats(100.0, 500e3),
    st.floats(0.0, 0.01),
    st.floats(1e4, DEFAULT_MAX_SLEW_V_PER_S),
)
def test_ramp_keeps_every_limit_and_ends_at_zero(last_v, rate, ramp_s, slew):
    limits = DriveLimits(max_slew_v_per_s=slew)
    ramp = limits.ramp_to_zero(last_v, rate, ramp_s)
    limits.check(ramp, last_v, rate)
    assert ramp[-1] == 0.0
    assert np.all(np.diff(np.abs(ramp), prepend=abs(last_v)) <= 0.0)


def test_ramp_by_hand():
    # 5 ms at 1 kHz are 5 samples.
    np.testing.assert_array_equal(
        DriveLimits().ramp_to_zero(100.0, 1e3), [80.0, 60.0, 40.0, 20.0, 0.0]
    )


@pytest.mark.parametrize(
    "raised",
    [
        {"max_rms_v": 1e9},
        {"max_rms_v": 142.9},
        {"max_dc_share": 0.051},
        {"window_s": 1.01},
        {"max_slew_v_per_s": 4.67e6},
        {"max_peak_a": 0.71e-3},
        {"max_rms_a": 0.501e-3},
        {"ceiling_v": math.nextafter(200.0, 300.0)},
    ],
    ids=str,
)
def test_no_limit_can_be_raised(raised):
    with pytest.raises(LimitError, match="cannot be raised"):
        DriveLimits(**raised)


@pytest.mark.parametrize("name", [field.name for field in fields(DriveLimits)])
@pytest.mark.parametrize("value", [0.0, -1.0, np.nan, np.inf])
def test_impossible_limits(name, value):
    with pytest.raises(LimitError, match=name):
        DriveLimits(**{name: value})


RATE = 1000.0  # one window of a second is 1000 samples


def window(**limits):
    return DriveWindow(DriveLimits(**limits), RATE)


def admit(window, volts):
    window.check(volts)
    window.take(volts)


@pytest.mark.parametrize("frequency_hz", [6.5, 10.0, 50.0, 125.0, 249.0])
@pytest.mark.parametrize("phase", [0.0, 1.0, np.pi / 2])
def test_a_tone_at_the_ceiling_passes_for_ever(frequency_hz, phase):
    # From 6.4 Hz on: a half period has the mean 2/pi over T/2, which is 5 % of a second there.
    # That is a bound for a tone begun at phase 0; begun elsewhere it is less.
    wave = 200.0 * np.sin(2 * np.pi * frequency_hz * np.arange(5000) / RATE + phase)
    seen = window()
    for block in np.split(wave, 100):
        admit(seen, block)


def test_energy_by_hand():
    # A square wave at the ceiling reaches 1.01 * 200 / sqrt(2) V over a second after
    # (1.01 / sqrt(2))**2 = 0.51005 of it: with the 511th sample.
    square = 200.0 * np.where(np.arange(2000) % 2, -1.0, 1.0)
    seen = window()
    admit(seen, square[:510])
    with pytest.raises(LimitError, match=r"sample 0 the rms .*142\.9"):
        seen.check(square[510:])
    # What was driven is forgotten a window later, not before.
    admit(seen, np.zeros(490))
    with pytest.raises(LimitError, match="rms"):
        seen.check(np.array([0.0, 200.0, -200.0, 200.0, 200.0, -200.0]) * np.sqrt(2))
    admit(seen, np.zeros(510))
    admit(seen, square[:510])


def test_a_mean_voltage_by_hand():
    # 5 % of a second of anything constant, high or low, is all that passes.
    for level_v in (190.0, 20.0, -20.0, 3.0):  # at 200 V the ramp behind it is too much
        seen = window()
        admit(seen, np.full(50, level_v))
        with pytest.raises(LimitError, match=r"sample 0 the mean .*5%"):
            seen.check(np.full(1, level_v))
        seen.check(np.full(10, -level_v))  # the way back
        seen.check(np.zeros(10))


def judged_by_hand(limits, history, size, begin, is_carried):
    """The first sample from `begin` on that breaks a limit, and which, each window in full."""
    padded = np.r_[np.zeros(size + 1), history]
    for index in range(begin, len(history)):
        value, seen = history[index], padded[index + 2 : index + 2 + size]
        if not value:
            continue
        if np.mean(seen**2) > limits.max_rms_v**2:
            return index, "rms"
        mean, largest = seen.mean(), np.abs(seen).max()
        if value * mean > 0 and abs(mean) > max(limits.max_dc_share * largest, 0.05):
            return index, "largest"
        stretches = np.sign(value) * np.cumsum(seen[::-1])
        ramp = 0.0 if is_carried else RAMP_S / 2 * RATE * abs(value)
        if stretches.max() + ramp > limits.max_dc_share * limits.ceiling_v * size:
            return index, "builds up"
        steps = np.diff(padded[index + 1 : index + 2 + size])
        if np.sqrt(np.mean(steps**2)) * RATE > limits.max_rms_slew_v_per_s:
            return index, "current"
    return None


volts_of_any = st.floats(-200.0, 200.0)
pieces = st.tuples(
    st.sampled_from([0.0, 199.3, -199.3, 148.9, -61.7, 20.3, 0.31]),
    st.integers(1, 45),
    st.sampled_from([1, 2, 3, 17]),  # samples in half of its period
)


@settings(max_examples=200, deadline=None)
@given(st.lists(pieces, min_size=1, max_size=12), st.booleans(), st.integers(1, 90))
def test_the_window_agrees_with_each_window_in_full(parts, is_carried, cut):
    """However the samples are cut: the first that breaks a limit, and the limit that it breaks."""
    # A window of 20 samples, limits that a few at the ceiling reach, and no number on a limit.
    limits = DriveLimits(window_s=0.02, max_rms_v=120.0, max_rms_a=0.02e-3)
    object.__setattr__(limits, "max_dc_share", 0.3137)
    shapes = [level * (-1.0) ** (np.arange(n) // half) for level, n, half in parts]
    history = np.concatenate(shapes)
    seen, at = DriveWindow(limits, RATE), 0
    while at < history.size:
        block = history[at : at + cut]
        expected = judged_by_hand(limits, history[: at + block.size], 20, at, is_carried)
        try:
            seen.check(block, is_carried=is_carried)
            found = None
        except LimitError as error:
            found = str(error)
        assert (found is None) == (expected is None)
        if expected is not None:
            assert f"sample {expected[0] - at} " in found
            assert expected[1] in found
            # Silence is the remedy; what was rejected was never driven.
            history = np.r_[history[:at], np.zeros(25), history[at + block.size :]]
            block = np.zeros(25)
        seen.take(block)
        at += block.size


def test_sums_of_weeks_do_not_drift():
    """Two windows that end with the same second agree, though one has counted for an hour."""
    rng = np.random.default_rng(0)
    old, new = window(), window()
    for _ in range(3600):
        old.take(rng.choice([-1.0, 1.0]) * rng.uniform(0, 200, 1000))
    last = 100.0 * np.sin(np.arange(1000))
    old.take(last)
    new.take(last)
    for level_v in (-60.0, 120.0, 190.0):
        probe = np.r_[np.full(200, level_v)]
        verdicts = []
        for each in (old, new):
            with pytest.raises(LimitError) as error:
                each.check(probe)
            verdicts.append(str(error.value))
        assert verdicts[0] == verdicts[1]


def codes_in_one_pass(volts, before_v, limits, rate_hz, full_scale_v):
    setup = Setup(StreamMode.WAVEFORM, 160, rate_hz, round(full_scale_v * 1e3), 200_000, 4_666_666)
    # The limits as they are, and not rounded to codes.
    with patch("firmware_io.drive_check.kept_limits", lambda limits, *_: limits):
        checks = DriveCheck(limits, setup, rate_hz)
    return checks.codes(volts, before_v)


@settings(max_examples=60)
@given(
    st.lists(st.one_of(volts_of_any, st.sampled_from([np.nan, np.inf, 0.5])), min_size=1),
    volts_of_any,
    st.sampled_from([200.0, 150.0, 3.3]),
    st.sampled_from([250.0, 200.0, 100.0]),
)
def test_codes_in_one_pass_are_those_that_pass_the_check(volts, before_v, ceiling_v, full_scale_v):
    volts, limits = np.array(volts), DriveLimits(ceiling_v=ceiling_v)
    for rate_hz in (8000, 48_000):
        try:
            limits.check(volts, before_v, rate_hz)
            expected = volts_to_codes(volts, full_scale_v, ceiling_v)
        except LimitError:
            with pytest.raises(LimitError):
                codes_in_one_pass(volts, before_v, limits, rate_hz, full_scale_v)
        else:
            codes = codes_in_one_pass(volts, before_v, limits, rate_hz, full_scale_v)
            assert np.array_equal(codes, expected)


def test_codes_in_one_pass_round_halves_to_even_and_stay_below_the_ceiling():
    limits, halves = DriveLimits(ceiling_v=150.0), (np.arange(-40, 41) + 0.5) / 32767 * 200
    for volts in (halves, np.nextafter(halves, -1e3), np.linspace(149.99, 150.0, 50)):
        codes = codes_in_one_pass(volts, float(volts[0]), limits, 48_000, 200.0)
        assert np.array_equal(codes, volts_to_codes(volts, 200.0, 150.0))


def test_the_device_rejects_a_mean_voltage_and_recovers_after_a_pause():
    now_s = 0.0
    device = Device(MockLink(MockDriver()), clock=lambda: now_s)
    device.arm()
    with pytest.raises(LimitError, match="mean voltage"):
        device.write(np.full(4800, 90.0))
    assert device.mock.samples_played == 0
    device.arm()
    device.write(np.full(2000, 90.0))
    with pytest.raises(LimitError, match="mean"):
        device.write(np.full(1000, 90.0))
    assert device.mock.played_codes[-1] == 0
    device.arm()
    with pytest.raises(LimitError, match="pause"):
        device.write(np.full(1000, 90.0))
    now_s = 1.0
    device.arm()
    device.write(np.full(2000, 90.0))
    device.stop()


def test_amplitudes_of_a_carrier():
    limits = DriveLimits(ceiling_v=150.0, max_slew_v_per_s=4e6)
    limits.check_envelope(np.array([130.0, 140.0, 150.0]), 130.0, 16e3, 4e3)
    limits.check_envelope(np.empty(0), 0.0, 16e3, 4e3)
    with pytest.raises(LimitError, match="Sample 1 is -1 V"):
        limits.check_envelope(np.array([0.0, -1.0]), 0.0, 16e3, 4e3)
    with pytest.raises(LimitError, match=r"150\.0 V"):
        limits.check_envelope(np.array([151.0]), 0.0, 16e3, 4e3)
    # 140 V at 4 kHz slew at 3.52 MV/s; a line to them adds 16,000 steps a second of 20 or 40 V.
    limits.check_envelope(np.array([140.0]), 120.0, 16e3, 4e3)
    with pytest.raises(LimitError, match="4000 Hz"):
        limits.check_envelope(np.array([140.0]), 100.0, 16e3, 4e3)
    # 150 V at 4.3 kHz slews at 2 pi 4300 150 = 4.05 MV/s.
    with pytest.raises(LimitError, match="4300 Hz"):
        limits.check_envelope(np.array([150.0]), 150.0, 16e3, 4.3e3)
