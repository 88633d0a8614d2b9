"""Errors by frequency against closed forms of sines."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from haptix.model.perception.thresholds import Channel, Perception, weighted_error

RATE = 8000.0
T = np.arange(8000) / RATE
EVERYWHERE = np.ones(T.size, bool)
LEAST_DB = 18.5  # of the package's channel, at 540 Hz
ROOT = np.sqrt(2.0)


def sine(hz, jnd=1.0):
    return jnd * np.sin(2 * np.pi * hz * T + 0.3)


@pytest.mark.parametrize(("hz", "threshold_db"), [(540, 18.5), (240, 24.5), (360, 18.8)])
def test_a_sine_counts_by_its_threshold(hz, threshold_db):
    found = weighted_error(sine(hz, 3.0), EVERYWHERE, RATE)
    # Twice the drive is four times the attraction. 2 %: of a sine's power a Hann window puts a
    # sixth 10 Hz to either side, where the steepest threshold has changed by 0.4 dB, its weight
    # by 8 %.
    weight = 10 ** (2 * (LEAST_DB - threshold_db) / 20)
    assert found.rms_jnd == pytest.approx(3.0 / ROOT * weight, rel=0.02)
    assert max(found.below_rms_jnd, found.above_rms_jnd) < 0.01
    assert found.share == 1.0 and (found.low_hz, found.high_hz) == (160.0, 800.0)


@pytest.mark.parametrize(("hz", "where"), [(60, "below_rms_jnd"), (2000, "above_rms_jnd")])
def test_beyond_the_data_nothing_is_weighed(hz, where):
    found = weighted_error(sine(hz), EVERYWHERE, RATE)
    assert getattr(found, where) == pytest.approx(1 / ROOT, rel=1e-3)
    assert found.rms_jnd < 1e-3


def test_the_mean_is_below():
    found = weighted_error(np.full(T.size, -0.4), EVERYWHERE, RATE)
    assert found.below_rms_jnd == pytest.approx(0.4, rel=1e-3)
    assert (
        found.rms_jnd < 1e-5
    )  # a Hann window falls with the cube of the distance in lines, here 16


@settings(max_examples=30, deadline=None)
@given(st.lists(st.tuples(st.sampled_from([20, 100, 1000, 3000]), st.floats(0, 5)), min_size=1))
def test_what_is_not_weighed_keeps_its_energy(parts):
    error = sum(sine(hz, size) for hz, size in parts)
    found = weighted_error(error, EVERYWHERE, RATE)
    total = np.hypot(found.below_rms_jnd, found.above_rms_jnd)
    # These sines have whole periods in a segment, so that the window changes no mean.
    assert total == pytest.approx(np.sqrt(np.mean(error**2)), rel=0.01, abs=1e-9)


def test_only_whole_usable_segments_count():
    usable = EVERYWHERE.copy()
    usable[3000:3010] = False
    error = np.where(usable, sine(540), 1e6)
    error[~usable] = np.nan
    found = weighted_error(error, usable, RATE)
    assert found.rms_jnd == pytest.approx(1 / ROOT, rel=0.02)  # as above
    # 800 samples in a segment, each 400 one: 0 to 2800, and from 3200 on.
    assert found.share == pytest.approx((2800 + 4800) / 7990)
    none = weighted_error(error[:500], usable[:500], RATE)
    assert none.share == 0.0 and np.isnan(none.rms_jnd)


def test_own_thresholds_weigh():
    flat = Channel(name="mine", felt_hz=(10.0, 1000.0), threshold_db=(20.0, 20.0),
                   is_placeholder=True)  # fmt: skip
    found = weighted_error(
        sine(60), EVERYWHERE, RATE, Perception.default().replace(channels=(flat,))
    )
    assert found.rms_jnd == pytest.approx(1 / ROOT, rel=1e-3)
    assert found.is_placeholder and found.low_hz == 10.0
