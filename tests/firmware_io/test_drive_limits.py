"""The safety limits on the host's side."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_io import ABSOLUTE_CEILING_V, DriveLimits, LimitError


def test_absolute_ceiling():
    assert ABSOLUTE_CEILING_V == 200.0
    assert DriveLimits().ceiling_v == 200.0


@pytest.mark.parametrize("ceiling_v", [math.nextafter(200.0, 300.0), 0.0, -1.0, np.nan, np.inf])
def test_impossible_ceilings(ceiling_v):
    with pytest.raises(LimitError, match="ceiling_v"):
        DriveLimits(ceiling_v=ceiling_v)


@pytest.mark.parametrize("slew", [0.0, -1.0, np.nan, np.inf])
def test_impossible_slews(slew):
    with pytest.raises(LimitError, match="max_slew_v_per_s"):
        DriveLimits(max_slew_v_per_s=slew)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_samples_that_are_not_finite(bad):
    with pytest.raises(LimitError, match=r"Sample 2 is .*finite"):
        DriveLimits().check(np.array([0.0, 1.0, bad, bad]), 0.0, 48e3)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_ceiling_is_exact(sign):
    limits = DriveLimits(ceiling_v=150.0)
    limits.check(np.array([sign * 150.0]), 0.0, 48e3)
    above = sign * math.nextafter(150.0, 200.0)
    with pytest.raises(LimitError, match=r"Sample 1 is .* above the ceiling of 150.0 V"):
        limits.check(np.array([0.0, above, above]), 0.0, 48e3)


def test_slew_by_hand():
    # 1000 V/s at 100 samples per second is 10 V per sample.
    limits = DriveLimits(max_slew_v_per_s=1000.0)
    limits.check(np.array([15.0, 25.0, 15.0]), 5.0, 100.0)
    with pytest.raises(LimitError, match=r"Sample 0 steps from 5 V to 15.01 V"):
        limits.check(np.array([15.01]), 5.0, 100.0)
    with pytest.raises(LimitError, match=r"Sample 2 steps from 25 V to 14.9 V.*10 V per sample"):
        limits.check(np.array([15.0, 25.0, 14.9]), 5.0, 100.0)


@pytest.mark.parametrize("rate", [48e3, 96e3, 192e3, 250e3])
def test_default_slew_admits_the_fastest_carrier(rate):
    t = np.arange(int(rate) // 10) / rate
    DriveLimits().check(200.0 * np.sin(2 * np.pi * 20e3 * t), 0.0, rate)


def test_default_slew_rejects_a_jump_at_a_high_rate():
    # At 250 kHz the carrier's steepest step is 2 * 200 * sin(pi * 20 / 250) = 99.5 V.
    with pytest.raises(LimitError, match="Sample 0 steps"):
        DriveLimits().check(np.array([120.0]), 0.0, 250e3)


def test_no_samples_break_no_limit():
    assert DriveLimits().check(np.empty(0), 200.0, 48e3) is None


@given(
    st.floats(-200.0, 200.0),
    st.floats(100.0, 500e3),
    st.floats(0.0, 0.01),
    st.floats(1e4, 1e8),
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
