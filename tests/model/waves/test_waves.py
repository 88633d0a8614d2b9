"""Waves against their definitions."""

import numpy as np
import pytest

from haptix.model.waves import Waveform, sine, turns

RATE = 48_000.0
PERIOD = np.random.default_rng(3).uniform(-1, 1, 12)
WAVES = {
    "sine": Waveform(),
    "cosine": Waveform(shift_turns=0.25),
    "square": Waveform("square", duty=0.3),
    "sawtooth": Waveform("sawtooth", shift_turns=0.1),
}


@pytest.mark.parametrize("name", WAVES)
def test_harmonics_and_means_are_those_of_the_wave(name):
    wave = WAVES[name]
    count, samples = 6, 1 << 16
    # The midpoint rule over a period; at the steps it errs by a part of 1/samples.
    s = (np.arange(samples) + 0.5) / samples
    value = wave.at(s)
    found = wave.harmonics(count)
    assert wave.mean == pytest.approx(value.mean(), abs=1e-4)
    assert wave.mean_square == pytest.approx((value**2).mean(), abs=1e-4)
    assert np.abs(value).max() == pytest.approx(1.0, abs=1e-4)
    for n in range(1, count + 1):
        expected = 2 * np.mean(value * np.exp(-2j * np.pi * n * s))
        assert found[n] == pytest.approx(expected, abs=1e-4)


def test_samples_are_joined_by_straight_lines():
    wave = Waveform.of_samples(5 * PERIOD)
    places = np.linspace(-1, 2, 3001)
    expected = np.interp(places * 12, np.arange(13), np.append(PERIOD, PERIOD[0]), period=12)
    np.testing.assert_allclose(wave.at(places), expected / np.abs(PERIOD).max(), atol=1e-12)
    fine = (np.arange(120_000) + 0.5) / 120_000
    # The midpoint rule on 1e4 places a line.
    assert wave.mean_square == pytest.approx((wave.at(fine) ** 2).mean(), rel=1e-7)


@pytest.mark.parametrize("frequency_hz", [4000.0, 4001.7, 0.3])
def test_a_sine_depends_on_the_samples_number_alone(frequency_hz):
    # 1e10 samples are 58 hours. In whole numbers there is no rounding of the phase.
    whole, part = (frequency_hz / RATE).as_integer_ratio()
    for first in (0, 511, 170_000_000, 10_000_000_007):
        exact = np.array([(n * whole) % part / part for n in range(first, first + 1200)])
        found = sine(first, 1200, frequency_hz, RATE, 0.4)
        # `frequency_hz / RATE` above is rounded: 2**-53 of 1e10 / 12 turns, times 2 pi.
        bound = 2e-12 + 2 * np.pi * first * frequency_hz / RATE * 2.0**-53
        np.testing.assert_allclose(found, np.sin(2 * np.pi * exact + 0.4), atol=bound)
        np.testing.assert_array_equal(found[700:], sine(first + 700, 500, frequency_hz, RATE, 0.4))


def test_a_sine_of_twelve_samples_repeats_even_after_hours():
    first = 170_000_000  # an hour at 48 kHz
    exact = np.sin(2 * np.pi * ((first + np.arange(5000)) % 12) / 12)
    np.testing.assert_allclose(sine(first, 5000, 4000.0, RATE), exact, atol=1e-12)
    phase = turns(first, 5000, 4000.0, RATE)
    np.testing.assert_allclose(np.sin(2 * np.pi * phase), exact, atol=1e-12 * 5000)
