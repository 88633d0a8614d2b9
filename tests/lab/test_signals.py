"""Signals against closed forms, scipy and their own algebra, however they are cut into blocks."""

import json
import tempfile
from itertools import pairwise
from math import inf, pi

import numpy as np
import pytest
import soundfile
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import signal as scipy_signal

from haptix.base.errors import HaptixError, InputError
from haptix.feel import (
    Chirp,
    Constant,
    Path,
    Points,
    Pulse,
    Ramp,
    Recorded,
    Sine,
    Square,
    SteadySpeed,
    Step,
    Strokes,
    TimeNoise,
    grating,
    relief,
    signal_from,
)

RATE = 48_000.0

# One of each kind, finite and infinite, nested.
SIGNALS = {
    "constant": Constant(0.3),
    "step": Step(0.1, 0.4, at_s=0.003),
    "ramp": Ramp(-1.0, 2.0, 0.05),
    "pulse": Pulse(0.7, width_s=0.004, at_s=0.001, rest=0.1),
    "sine": Sine(0.5, 440.0, phase_rad=0.7, offset=1.0),
    "square": Square(2.0, 100.0, duty=0.3),
    "chirp": Chirp(1.0, 20.0, 2000.0, 0.2, law="logarithmic"),
    "points": Points((0.0, 0.01, 0.05), (0.0, 1.0, 0.5)),
    "noise": TimeNoise(1.0, (100.0, 900.0), seed=4),
    "grating": grating(0.2, 1.5, Strokes(30.0, 0.4), shape="square"),
    "relief": relief((0.0, 1.0, 4.0), (0.2, 0.3, 0.1), 50.0, length_s=0.06),
    "sum": Sine(1.0, 50.0, length_s=0.02) + Ramp(0.0, 1.0, 0.03) + 0.25,
    "product": 2 * Sine(1.0, 50.0) * Ramp(0.0, 1.0, 0.03),
    "then": Ramp(0.0, 1.0, 0.0101).then(Sine(1.0, 300.0, length_s=0.007), Constant(0.5)),
    "repeat": Ramp(0.0, 1.0, 0.0033).repeat(7),
    "forever": Pulse(1.0, 0.001, length_s=0.0031).repeat(),
    "window": (Sine(1.0, 300.0).lasting(0.04) + 1).window(0.01, 0.02, rest=0.5),
    "excerpt": TimeNoise(1.0, (10.0, 90.0), seed=2).lasting(0.05),
    "difference": -(Sine(1.0, 60.0) - 0.2).lasting(0.05),
    "rest": 1 - Ramp(0.0, 1.0, 0.04),
}


def whole(signal, count=3000):
    return signal.values(0, count, RATE)


@pytest.mark.parametrize("name", SIGNALS)
@given(cuts=st.lists(st.integers(1, 2999), max_size=6), start=st.integers(0, 2000))
@settings(max_examples=10, deadline=None)
def test_blocks_are_the_whole(name, cuts, start):
    """A value depends on its sample's number alone: to rounding for what is computed in blocks."""
    signal = SIGNALS[name]
    edges = sorted({start, 3000, *(cut for cut in cuts if cut > start)})
    parts = [signal.values(a, b - a, RATE) for a, b in pairwise(edges)]
    np.testing.assert_allclose(np.concatenate(parts), whole(signal)[start:], rtol=0, atol=1e-12)


@pytest.mark.parametrize("name", SIGNALS)
def test_descriptions_are_read_back(name):
    signal = SIGNALS[name]
    again = signal_from(json.loads(json.dumps(signal.describe())))
    assert again == signal
    assert again.describe() == signal.describe()
    assert np.array_equal(whole(again), whole(signal))


@pytest.mark.parametrize("name", SIGNALS)
def test_past_its_end_a_signal_is_zero(name):
    signal = SIGNALS[name]
    count = signal.samples(RATE)
    if count is None:
        assert signal.length_s == inf
        return
    assert abs(count / RATE - signal.length_s) <= 4 / RATE  # parts are rounded one by one
    assert not signal.values(count, 50, RATE).any()
    assert not signal.values(count + 12345, 5, RATE).any()


def test_closed_forms():
    n = np.arange(3000)
    t = n / RATE
    np.testing.assert_allclose(
        whole(SIGNALS["sine"]), 1 + 0.5 * np.sin(2 * pi * 440 * t + 0.7), atol=1e-13
    )
    assert np.array_equal(whole(SIGNALS["step"]), np.where(n < 144, 0.1, 0.4))
    ramp = np.where(n < 2400, -1 + 3 * n / 2400, 0)
    np.testing.assert_allclose(whole(SIGNALS["ramp"]), ramp, atol=1e-13)
    rest = np.where(n < 1920, 1 - n / 1920, 0)
    np.testing.assert_allclose(whole(SIGNALS["rest"]), rest, atol=1e-13)
    pulse = np.where((n >= 48) & (n < 240), 0.7, 0.1)
    assert np.array_equal(whole(SIGNALS["pulse"]), pulse)
    # 480 samples a period, of which 144 high.
    assert np.array_equal(whole(SIGNALS["square"]), np.where(n % 480 < 144, 2.0, -2.0))
    assert np.array_equal(
        whole(SIGNALS["forever"]), np.where(n % 149 < 48, 1.0, 0.0)
    )  # 3.1 ms are 148.8 samples: whole ones of each repetition


def test_chirps_are_scipys():
    t = np.arange(9600) / RATE
    for law, method in (("linear", "linear"), ("logarithmic", "logarithmic")):
        ours = Chirp(1.0, 20.0, 2000.0, 0.2, law=law, phase_rad=pi / 2).values(0, 9600, RATE)
        theirs = scipy_signal.chirp(t, 20.0, 0.2, 2000.0, method=method)
        np.testing.assert_allclose(ours, theirs, atol=1e-9)  # some 200 periods


def test_a_grating_is_what_a_moving_finger_meets():
    steady = grating(0.5, 2.0, SteadySpeed(40.0)).values(0, 4000, RATE)
    np.testing.assert_allclose(steady, whole(Sine(0.5, 20.0), 4000), atol=1e-12)
    assert grating(0.5, 2.0, 40.0) == grating(0.5, 2.0, SteadySpeed(40.0))
    # A stroke there and back meets the same in reverse.
    stroke = grating(1.0, 3.0, Strokes(30.0, 0.1)).values(0, 9601, RATE)
    np.testing.assert_allclose(stroke, stroke[::-1], atol=1e-9)
    # Along a path, place by place.
    path = Path((0.0, 0.1, 0.2), (0.0, 5.0, 1.0))
    values = relief((0.0, 5.0), (0.2, 0.7), path).values(0, 9600, RATE)
    x = np.interp(np.arange(9600) / RATE, path.t_s, path.x_mm)
    np.testing.assert_allclose(values, 0.2 + 0.1 * x, atol=1e-12)


def test_noise_has_its_variance_and_its_spectrum():
    """60 s: some 60,000 independent values of a 500 Hz band hold the rms to 0.6 %."""
    corners, density = (200.0, 400.0, 700.0), (1.0, 3.0, 0.0)
    values = TimeNoise(2.0, corners, seed=11, density=density, mean=1.0).values(0, 2_880_000, RATE)
    assert values.mean() == pytest.approx(1.0, abs=1e-2)
    assert values.std() == pytest.approx(2.0, rel=0.02)
    frequency, power = scipy_signal.welch(values, RATE, nperseg=48_000)
    wanted = np.interp(frequency, corners, density, left=0, right=0)
    wanted *= 4.0 / np.trapezoid(wanted, frequency)
    # 120 averages: each line is known to 9 %; the edges are smeared by the estimate's own lines.
    inside = (frequency > 205) & (frequency < 600)
    assert np.abs(power / np.where(wanted > 0, wanted, 1) - 1)[inside].max() < 0.5
    assert np.abs(power / np.where(wanted > 0, wanted, 1) - 1)[inside].mean() < 0.1
    outside = (frequency < 190) | (frequency > 720)
    assert power[outside].max() < 1e-4 * power.max()
    # Stationary: the overlap of pieces does not show (each hop's middle against its ends).
    hops = (values[: 43 * 65536] - 1).reshape(43, 8, -1)
    np.testing.assert_allclose((hops**2).mean((0, 2)), 4.0, rtol=0.15)


def test_noise_is_its_seed():
    one, same, other = (
        TimeNoise(1.0, (50.0, 500.0), seed=s).values(0, 2000, RATE) for s in (1, 1, 2)
    )
    assert np.array_equal(one, same)
    assert abs(np.corrcoef(one, other)[0, 1]) < 0.9
    sum_ = TimeNoise(1.0, (50.0, 500.0), seed=1) + TimeNoise(1.0, (50.0, 500.0), seed=2) * 3
    assert sum_.seeds == (1, 2)


def test_recordings_are_played_and_resampled(tmp_path):
    t = np.arange(4410) / 44_100
    soundfile.write(tmp_path / "a.wav", 0.5 * np.sin(2 * pi * 200 * t), 44_100, "FLOAT")
    signal = Recorded(str(tmp_path / "a.wav"), gain=2.0, offset=0.1)
    assert signal.length_s == pytest.approx(0.1)
    found = signal.values(0, 4800, RATE)
    exact = 0.1 + np.sin(2 * pi * 200 * np.arange(4800) / RATE)
    # The filter of the resampling rings at the cut ends.
    np.testing.assert_allclose(found[200:-200], exact[200:-200], atol=2e-3)
    assert not signal.values(4800, 10, RATE).any()
    assert signal_from(signal.describe()) == signal
    soundfile.write(tmp_path / "a.wav", 0.1 * t, 44_100, "FLOAT")
    with pytest.raises(HaptixError, match="not the recording"):
        signal_from(signal.describe())


@given(
    st.sampled_from([1000, 8000, 10_000, 44_100, 48_000, 96_000]),
    st.sampled_from([8000.0, 44_100.0, 48_000.0]),
    st.integers(5, 3000),
)
def test_a_constant_stays_one_at_every_rate_and_to_its_ends(rate, played_hz, count):
    with tempfile.TemporaryDirectory() as folder:
        path = f"{folder}/r.wav"
        soundfile.write(path, np.full(count, 0.3), rate, subtype="DOUBLE")
        signal = Recorded(path)
    values = signal.values(0, signal.samples(played_hz), played_hz)
    np.testing.assert_allclose(values, 0.3, rtol=1e-12)


def test_a_resampled_line_stays_one_within_its_filter(tmp_path):
    line = np.linspace(0.2, 0.6, 5000)
    soundfile.write(tmp_path / "r.wav", line, 10_000, subtype="DOUBLE")
    found = Recorded(str(tmp_path / "r.wav")).values(0, 24_000, RATE)
    exact = np.interp(np.arange(24_000) / RATE, np.arange(5000) / 10_000, line)
    # At the ends the line bends to a constant within the filter's ten samples.
    np.testing.assert_allclose(found, exact, atol=10 * (line[1] - line[0]))


def test_lists_and_numpys_numbers_are_numbers():
    ours = TimeNoise(np.float32(1.5), [100, 900], seed=4, density=np.array([1, 2]))
    assert ours == TimeNoise(1.5, (100.0, 900.0), 4, (1.0, 2.0))
    scaled = np.int64(2) * Points([0, 1], np.array([0.0, 3.0]))
    assert signal_from(json.loads(json.dumps(scaled.describe()))).describe() == scaled.describe()
    assert Path([0, 1], [0, 5]) == Path((0, 1), (0, 5))


WRONG = {
    "sine without frequency": ({"kind": "sine", "amplitude": 1}, "frequency_hz"),
    "unknown kind": ({"kind": "triangle"}, "kind.*sine.*triangle"),
    "unknown field": ({"kind": "sine", "amplitude": 1, "frequency_hz": 2, "hz": 3}, "hz.*no such"),
    "text": ("sine", "expected a table"),
    "text as number": ({"kind": "constant", "value": "high"}, "value.*'high'"),
    "nothing": ({"kind": "sum", "parts": []}, "parts.*at least 1"),
    "endless in front": (
        {"kind": "concatenation", "parts": [{"kind": "constant", "value": 1}, 2]},
        r"parts\[0\].*no end",
    ),
    "endless again": ({"kind": "repetition", "of": 1.0}, "no end"),
    "half a repetition": (
        {"kind": "repetition", "of": {"kind": "ramp", "start": 0, "end": 1, "length_s": 1},
         "times": 1.5},
        "whole number",
    ),
    "fades longer than it": (
        {"kind": "window", "of": {"kind": "ramp", "start": 0, "end": 1, "length_s": 1},
         "rise_s": 1, "fall_s": 1},
        "at most the signal's 1 s",
    ),
    "no speed": ({"kind": "grating", "amplitude": 1, "period_mm": 2}, "grating.*finger's speed"),
    "no such speed": (
        {"kind": "grating", "amplitude": 1, "period_mm": 2, "speed": {"kind": "fast"}},
        "fast",
    ),
    "no seed": ({"kind": "time-noise", "deviation": 1, "frequency_hz": [1, 2]}, "seed"),
    "empty spectrum": (
        {"kind": "time-noise", "deviation": 1, "frequency_hz": [1, 2], "density": [0, 0],
         "seed": 1},
        "some density",
    ),
    "no file": ({"kind": "recorded", "file": "missing.wav"}, r"missing\.wav"),
    "backwards": ({"kind": "points", "t_s": [0, 2, 1], "values_at": [0, 1, 0]}, "increasing"),
}  # fmt: skip


@pytest.mark.parametrize("name", WRONG)
def test_wrong_tables_say_where(name):
    table, pattern = WRONG[name]
    with pytest.raises(HaptixError, match=pattern):
        signal_from(table)


def test_what_the_rate_cannot_carry_is_refused():
    for signal in (Sine(1.0, 24_000.0), Chirp(1.0, 10.0, 3e4, 1.0), TimeNoise(1.0, (1.0, 3e4), 1)):
        with pytest.raises(InputError, match="half"):
            signal.values(0, 10, RATE)
    # 100 mm/s over 0.00208 mm are 48 077 Hz, which samples would show as 77 Hz.
    with pytest.raises(InputError, match=r"0.00208 mm at 100 mm/s is 48076.9 Hz.*0.00417 mm"):
        grating(0.1, 0.00208, 100.0).values(0, 10, RATE)
    with pytest.raises(InputError, match="half"):
        grating(0.1, 0.0059, Strokes(60.0, 1.0), shape="square").values(10_000, 4000, 24_000.0)
    # Harmonics of a square wave are sampled as they are.
    assert np.ptp(grating(0.1, 0.0059, 100.0, shape="square").values(0, 99, RATE)) == 0.2
    with pytest.raises(InputError, match="narrower"):
        TimeNoise(1.0, (100.01, 100.02), seed=1).values(0, 10, RATE)
    with pytest.raises(InputError, match="signal or a number"):
        Sine(1.0, 5.0) + "x"
