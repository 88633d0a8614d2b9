"""Clocks of instruments: even times from uneven stamps, and a drive's frequency by those times.

Driver and instrument have a crystal each. They differ by up to some 100 ppm, a ceramic resonator by
0.5 %, so that a sine of 4 kHz is out of phase within a second of the other's clock.
"""

from __future__ import annotations

import numpy as np

from calibration.plan.parameters import Array

_APART = 0.005  # of a frequency: two clocks, one of them with a ceramic resonator
_PARTS = 8  # of a recording, at least, for the search of a frequency
_STEPS = 3  # of Gauss and Newton from its nearest fourth of a resolution; 2 are exact to 1e-6
_EVEN = 0.5  # of the mean step: larger differences are none of an instrument's own clock
_BLOCKS, _FEWEST = 50, 64  # parts of a recording, and samples of each
_LEVEL = 0.3  # of a step: a lost sample moves the stamps of all later ones by half of one or more


def even_times(t_s: Array) -> Array:
    """Times [s] of samples whose stamps come in bursts, late or rounded; other stamps as they are.

    Computers stamp samples when they arrive. Those of an even clock stay beside one line against
    their numbers, however late single ones are. Where samples are lost, or the rate changes, they
    do not, and the stamps are returned unchanged.

    Parameters
    ----------
    t_s : array, shape (samples,)
        Stamps [s].

    Examples
    --------
    >>> stamps = np.repeat(np.arange(100) * 0.016, 16)  # 16 samples each 16 ms
    >>> float(np.diff(even_times(stamps)).round(5).max())
    0.001
    """
    steps = np.diff(t_s)
    mean = float(steps.mean()) if len(steps) >= _FEWEST else 0.0
    if not mean > 0 or np.abs(steps - mean).max() <= _EVEN * mean:
        return t_s
    line = _line(t_s)
    parts = np.array_split(t_s - line, max(2, min(_BLOCKS, len(t_s) // _FEWEST)))
    levels = np.array([np.median(part) for part in parts])
    low, high = np.percentile(np.concatenate([p - np.median(p) for p in parts]), [5, 95])
    spread = high - low
    # A stamp may be late; one that is early beyond all others is none.
    is_even = np.ptp(levels) <= spread + _LEVEL * mean and (line - t_s).max() <= 3 * spread + mean
    return line if is_even else t_s


def _line(t_s: Array) -> Array:
    """Line through times against their numbers, by least squares; from means, for its digits."""
    number = np.arange(len(t_s)) - (len(t_s) - 1) / 2
    middle = t_s.mean()
    return np.asarray(middle + number * float(number @ (t_s - middle) / (number @ number)))


def sine_near(t_s: Array, values: Array, frequency_hz: float) -> tuple[float, float]:
    """Find a sine beside a constant: its frequency [Hz] by these times, and its amplitude.

    Parameters
    ----------
    t_s, values : array, shape (samples,)
        Times [s] and signal.
    frequency_hz : float
        By another clock; the sine is looked for within 0.5 % of it, as far as the samples are long
        enough to tell.
    """
    t = t_s - t_s.mean()
    found = frequency_hz
    lasts = float(t[-1] - t[0])
    # Blocks in which both clocks stay together within an eighth of a period.
    count = max(_PARTS, round(8 * _APART * frequency_hz * lasts))
    if frequency_hz * lasts > 2 * count and len(t) > 4 * count:
        beat = (values - values.mean()) * np.exp(-2j * np.pi * frequency_hz * t)
        parts = np.array([part.mean() for part in np.array_split(beat, count)])
        at = np.array([part.mean() for part in np.array_split(t, count)])
        off = np.arange(-_APART * frequency_hz, _APART * frequency_hz, 1 / (4 * lasts))
        found = (
            frequency_hz
            + off[np.abs(np.exp(-2j * np.pi * np.multiply.outer(off, at)) @ parts).argmax()]
        )
        peak = found
        for _ in range(_STEPS):
            basis, (a, b, _) = _sine(t, values, found)
            slope = 2 * np.pi * t * (b * basis[:, 0] - a * basis[:, 1])
            step = _least_squares(np.column_stack([basis, slope]), values)[3]
            # Noise alone has no slope to go by.
            found = float(np.clip(found + step, peak - 0.5 / lasts, peak + 0.5 / lasts))
    _, (a, b, _) = _sine(t, values, found)
    return found, float(np.hypot(a, b))


def _sine(t: Array, values: Array, frequency_hz: float) -> tuple[Array, Array]:
    """Cosine, sine and a constant, and what of each is in the values, by least squares."""
    angle = 2 * np.pi * frequency_hz * t
    basis = np.stack([np.cos(angle), np.sin(angle), np.ones_like(t)], axis=-1)
    return basis, _least_squares(basis, values)


def _least_squares(basis: Array, values: Array) -> Array:
    """Solve by the normal equations of a few columns, which are near orthogonal."""
    return np.asarray(np.linalg.lstsq(basis.T @ basis, basis.T @ values, rcond=None)[0])


def sine_amplitude(t_s: Array, values: Array, frequency_hz: float) -> float:
    """Amplitude of a sine near a frequency, see `sine_near`.

    Errors of the times can only lower it, so the larger one by the stamps and by an even clock is
    taken.
    """
    return max(sine_near(t, values, frequency_hz)[1] for t in (t_s, _line(t_s)))
