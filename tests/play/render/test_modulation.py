"""The carrier: amplitude to drive and back."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from haptix import InputError
from haptix.play.render import DirectWave, SineCarrier

RATE = 48_000.0
frequencies = st.floats(200.0, RATE / 4)


@settings(deadline=None)
@given(frequencies, st.lists(st.integers(0, 400), min_size=1, max_size=8), st.integers(0, 10**9))
def test_blocks_join_into_one_wave(frequency_hz, lengths, first):
    carrier = SineCarrier(frequency_hz)
    amplitude = np.random.default_rng(len(lengths)).uniform(0, 200, sum(lengths))
    starts = np.cumsum([0, *lengths])
    blocks = [carrier.modulate(amplitude[a:b], first + a, RATE) for a, b in pairwise(starts)]
    whole = carrier.modulate(amplitude, first, RATE)
    np.testing.assert_allclose(np.concatenate(blocks), whole, rtol=0, atol=1e-9)


def test_hours_of_samples_keep_their_phase():
    n = 10**9 + np.arange(1000)  # nearly six hours
    exact = np.sin(2 * np.pi * (n * 1700 % 48_000) / 48_000)  # the phase in integers
    drive = SineCarrier(1700.0).modulate(np.full(1000, 100.0), int(n[0]), RATE)
    # 3.5e7 turns with two roundings of 1.1e-16 each are off by 8e-9 turns, 5e-8 rad.
    np.testing.assert_allclose(drive, 100 * exact, rtol=0, atol=100 * 1e-7)


@pytest.mark.parametrize("frequency_hz", [125, 1234, 4000, 11_999])
def test_frequency_and_amplitude_by_fft(frequency_hz):
    # One second: bins of 1 Hz, so that the sine lies in a single bin.
    drive = SineCarrier(frequency_hz).modulate(np.full(48_000, 150.0), 0, RATE)
    spectrum = np.abs(np.fft.rfft(drive)) * 2 / 48_000
    expected = np.zeros_like(spectrum)
    expected[frequency_hz] = 150.0
    # Phases are off by up to 12,000 turns times 2e-16; 1e-9 V leaves room for the sum.
    np.testing.assert_allclose(spectrum, expected, rtol=0, atol=1e-9)


@pytest.mark.parametrize("frequency_hz", [125, 1700, 4000, 12_000])
def test_whole_periods_have_no_direct_voltage(frequency_hz):
    drive = SineCarrier(frequency_hz).modulate(np.full(48_000, 200.0), 0, RATE)
    # 48,000 samples of 200 V, each with an error of some 1e-11 of a turn at most.
    assert abs(drive.mean()) < 1e-8


@settings(deadline=None)
@given(frequencies, st.floats(0.001, 200.0), st.integers(0, 2000))
def test_a_constant_amplitude_comes_back(frequency_hz, amplitude_v, count):
    carrier = SineCarrier(frequency_hz)
    sample, found = carrier.demodulate(carrier.modulate(np.full(count, amplitude_v), 0, RATE), RATE)
    np.testing.assert_allclose(found, amplitude_v, rtol=1e-12)
    # Whole periods only: a last one may round up to a sample that is there.
    assert int(count * frequency_hz / RATE) in (len(found), len(found) + 1, len(found) - 1)
    assert (np.diff(sample) > 0).all()
    assert ((sample >= 0) & (sample <= count - 1)).all()


def test_places_of_whole_periods():
    carrier = SineCarrier(4000.0)  # 12 samples a period: 0 to 11, 12 to 23
    sample, found = carrier.demodulate(carrier.modulate(np.full(35, 3.0), 0, RATE), RATE)
    np.testing.assert_array_equal(sample, [5.5, 17.5])
    assert len(found) == 2


@pytest.mark.parametrize("count", [0, 1, 11])
def test_less_than_a_period_says_nothing(count):
    sample, found = SineCarrier(4000.0).demodulate(np.zeros(count), RATE)
    assert len(sample) == 0 == len(found)


@pytest.mark.parametrize("frequency_hz", [1000.0, 1700.0, 3777.7, 4000.0])
def test_a_slow_envelope_comes_back(frequency_hz):
    carrier = SineCarrier(frequency_hz)
    t = np.arange(9600) / RATE

    def envelope(t):
        return 100 + 50 * np.sin(2 * np.pi * 5 * t)

    sample, found = carrier.demodulate(carrier.modulate(envelope(t), 0, RATE), RATE)
    # Least squares is a mean of the envelope within the period, weighted by the sine squared. It
    # is off by at most the steepest slope times half a period, rounded up to whole samples.
    half_period_s = (RATE / frequency_hz + 1) / 2 / RATE
    bound = 50 * 2 * np.pi * 5 * half_period_s
    assert np.abs(found - envelope(sample / RATE)).max() < bound


def test_a_negative_sine_is_a_negative_amplitude():
    carrier = SineCarrier(4000.0)
    _, found = carrier.demodulate(carrier.modulate(np.full(48, -2.0), 0, RATE), RATE)
    np.testing.assert_allclose(found, -2.0, rtol=1e-12)


def test_other_frequencies_do_not_leak_in():
    # A harmonic is orthogonal to the carrier over every whole period.
    _, found = SineCarrier(4000.0).demodulate(
        SineCarrier(8000.0).modulate(np.ones(480), 0, RATE), RATE
    )
    np.testing.assert_allclose(found, 0.0, atol=1e-12)


@pytest.mark.parametrize("frequency_hz", [np.nextafter(12_000.0, 13_000.0), 24_000.0, 96_000.0])
def test_a_carrier_too_fast_for_the_device(frequency_hz):
    SineCarrier(12_000.0).check_rate(RATE)
    with pytest.raises(InputError, match="48000"):
        SineCarrier(frequency_hz).check_rate(RATE)


@pytest.mark.parametrize("bad", [0.0, -4000.0, np.nan, np.inf])
def test_impossible_carriers(bad):
    with pytest.raises(InputError, match="frequency_hz"):
        SineCarrier(bad)
    with pytest.raises(InputError, match="sample_rate_hz"):
        SineCarrier(100.0).check_rate(bad)


@pytest.mark.parametrize("frequency_hz", [50.0, 125.0, 997.0])
def test_a_direct_sine_is_a_carrier(frequency_hz):
    amplitude = np.full(4800, 100.0)
    direct = DirectWave(frequency_hz).modulate(amplitude, 77, RATE)
    # Straight lines between 4096 places: (pi/4096)^2 / 2 = 3e-7 of the amplitude.
    expected = SineCarrier(frequency_hz).modulate(amplitude, 77, RATE)
    np.testing.assert_allclose(direct, expected, rtol=0, atol=100 * 4e-7)


WAVES = {
    "sine": "sine",
    "square": "square",
    "triangle": [0.0, 1.0, 0.0, -1.0],
    "two harmonics": np.sin(2 * np.pi * np.arange(256) / 256)
    + 0.5 * np.cos(6 * np.pi * np.arange(256) / 256),
}


@pytest.mark.parametrize("name", WAVES)
def test_an_amplitude_pulls_as_much_whatever_the_wave(name):
    drive = DirectWave(100.0, WAVES[name])
    wave = drive.modulate(np.full(48_000, 100.0), 0, RATE)  # 100 whole periods
    # Attraction goes with the mean square. An edge of the square takes one of 480 samples.
    assert (wave**2).mean() == pytest.approx(100.0**2 / 2, rel=5e-3)
    assert abs(wave.mean()) <= 100 * 2 / 480 / 2
    assert np.abs(wave).max() <= 100 * drive.peak_per_sine * (1 + 1e-12)


@pytest.mark.parametrize(
    ("waveform", "sentence"),
    [
        ("saw", 'waveform: expected "sine", "square" or samples, got \'saw\''),
        ([0.0, 1.0, 1.0], "expected a mean of 0, got 0.667 of its peak; subtract the mean"),
        ([0.0, 0.0], "not all 0"),
        ([1.0], "two or more finite samples"),
        ([1.0, np.nan], "two or more finite samples"),
        ([[1.0, -1.0]], "two or more finite samples"),
        (["a", "b"], "expected samples of one period"),
    ],
)
def test_waves_that_are_none(waveform, sentence):
    with pytest.raises(InputError, match=sentence):
        DirectWave(100.0, waveform)
