"""Two devices with a crystal each, and stamps of a computer instead of the instrument's times."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calibration import Stroke
from calibration.measure.clocks import even_times, sine_amplitude, sine_near
from calibration.measure.recording_checks import check_recording
from calibration.measure.reduction import reduce_stroke

STEP_S = 1e-4


def played(t_s, frequency_hz=4000.0, amplitude_v=182.0):
    return amplitude_v * np.sin(2 * np.pi * frequency_hz * t_s + 0.4) + 3.0


@given(
    st.sampled_from([125.0, 1000.0, 4000.0]), st.floats(-4000, 4000), st.sampled_from([0.7, 1.5, 6])
)
def test_a_drive_is_read_by_any_crystal(frequency_hz, ppm, lasts_s):
    t = np.arange(0, lasts_s, STEP_S)
    factor = 1 + 1e-6 * ppm
    found_hz, amplitude = sine_near(t * factor, played(t, frequency_hz), frequency_hz)
    # 0.02 % of the volts are a hundredth of what the checks tolerate.
    assert amplitude == pytest.approx(182.0, rel=2e-4)
    assert found_hz * factor == pytest.approx(frequency_hz, abs=0.01 / lasts_s)


def test_a_drive_of_another_frequency_is_not_taken():
    t = np.arange(0, 1.5, STEP_S)
    assert sine_amplitude(t, played(t, 4040.0), 4000.0) < 10


def test_too_few_periods_tell_no_clock():
    t = np.arange(0, 0.1, STEP_S)
    assert sine_near(t, played(t, 50.0), 50.0)[0] == 50.0


def in_bursts(t, length, apart_s):
    """Stamp each sample when its packet arrives: with the last one of `length`."""
    at = np.arange(len(t))
    arrived = t[np.minimum(at // length * length + length - 1, len(t) - 1)]
    return arrived + (at % length) * apart_s


def in_any_bursts(t, rng):
    """Stamp samples when the program looks, at one of 20 on average."""
    looks = np.flatnonzero(np.append(rng.random(len(t) - 1) < 0.05, True))
    return t[looks[np.searchsorted(looks, np.arange(len(t)))]]


def late(t):
    """A computer that was busy ten times, for 20 ms."""
    t = t.copy()
    for first in range(3000, len(t) - 3000, len(t) // 10):
        t[first : first + 200] = np.maximum(t[first : first + 200], t[first + 200])
    return t


STAMPS = {
    "bursts of 32 at one time": lambda t, rng: in_bursts(t, 32, 0.0),
    "bursts of 32, a microsecond apart": lambda t, rng: in_bursts(t, 32, 1e-6),
    "bursts of any length": lambda t, rng: in_any_bursts(t, rng),
    "milliseconds": lambda t, rng: np.round(t, 3),
    "jitter of three samples": lambda t, rng: t + rng.normal(0, 3 * STEP_S, len(t)),
    "a busy computer": lambda t, rng: late(t),
}  # fmt: skip


@pytest.mark.parametrize("stamped", STAMPS)
def test_uneven_stamps_lose_no_sample(stamped):
    t = np.arange(33_991) * STEP_S
    found = even_times(STAMPS[stamped](t, np.random.default_rng(3)))
    steps = np.diff(found)
    assert steps.min() == pytest.approx(STEP_S, rel=1e-4)
    assert steps.max() == pytest.approx(STEP_S, rel=1e-4)
    assert sine_amplitude(found, played(t), 4000.0) == pytest.approx(182.0, rel=1e-3)


@pytest.mark.parametrize(("lost", "burst"), [(1, 1), (3, 1), (1000, 1), (200, 32), (1000, 32)])
def test_where_samples_are_lost_no_line_is_laid_through_them(lost, burst):
    t = np.delete(np.arange(33_991) * STEP_S, slice(9000, 9000 + lost))
    stamps = in_bursts(t, burst, 0.0)
    assert even_times(stamps) is stamps


def test_samples_whenever_a_loop_comes_to_them_keep_their_times():
    t = np.cumsum(np.random.default_rng(0).uniform(0.5, 2.0, 20_000)) * STEP_S
    assert even_times(t) is t


def test_stamps_that_shake_lower_no_amplitude():
    t = np.arange(15_000) * STEP_S
    stamps = t + np.random.default_rng(1).normal(0, 1e-5, len(t))
    assert sine_near(stamps, played(t), 4000.0)[1] < 177
    assert sine_amplitude(stamps, played(t), 4000.0) == pytest.approx(182.0, rel=1e-4)


@pytest.mark.parametrize("ppm", [-100, 30, 50, 200])
def test_a_stroke_by_another_crystal_is_reduced_to_its_volts_and_ripple(recorded, ppm):
    stroke = Stroke(number=1, normal_force_n=0.5, voltage_v=150.0, frequency_hz=1500.0)
    made = recorded(stroke, ripple=0.05)
    other = replace(made, t_s=made.t_s * (1 + 1e-6 * ppm))
    point = reduce_stroke(other)
    assert point.outlier == ""
    assert point.voltage_v == pytest.approx(150.0, rel=1e-3)
    assert point.ripple == pytest.approx(0.05, rel=0.02)


@pytest.mark.parametrize("length", [7, 50])
def test_a_stroke_stamped_in_bursts_is_accepted_and_says_so(recorded, stroke, length, tmp_path):
    made = recorded(stroke)
    other = replace(made, t_s=in_bursts(made.t_s, length, 1e-6))
    assert check_recording(other, 0.3) == []
    point, plain = reduce_stroke(other), reduce_stroke(made)
    assert point.mu == pytest.approx(plain.mu, rel=1e-3)
    assert point.voltage_v == pytest.approx(100.0, rel=1e-3)
    assert other.assumed == ("t_s",)
    other.save(tmp_path / "s.h5")
    assert type(other).load(tmp_path / "s.h5").assumed == ("t_s",)


def test_bursts_that_lack_samples_are_refused(recorded, stroke):
    made = recorded(stroke)
    t_s = in_bursts(made.t_s + 0.05 * (made.t_s > 1.0), 32, 1e-6)
    (finding,) = check_recording(replace(made, t_s=t_s), 0.3)
    assert (finding.kind, finding.is_fatal) == ("wrong times", True)
    assert "bursts" in finding.message
