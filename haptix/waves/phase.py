"""The phase of a wave on a sample clock: exact at any sample, in whatever block it is asked."""

from __future__ import annotations

from fractions import Fraction
from functools import lru_cache

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

_STEP = 512  # samples between two points of the grid on which `sine` adds angles


def turns(first: int, count: int, frequency_hz: float, sample_rate_hz: float) -> Array:
    """Phase in periods at samples `first` to ``first + count - 1``, below 1 at the first.

    Whole periods are taken off in whole numbers: hours of samples keep their precision.
    """
    whole, part = _turns_per_sample(frequency_hz, sample_rate_hz)
    start = int(first) * whole % part / part
    return np.asarray(start + frequency_hz / sample_rate_hz * np.arange(count))


def sine(
    first: int, count: int, frequency_hz: float, sample_rate_hz: float, phase_rad: float = 0.0
) -> Array:
    """``sin(2 pi f n / rate + phase)`` at samples `first` to ``first + count - 1``.

    By angle addition on a fixed grid of samples: three times as fast as a sine per sample. A value
    depends on its sample's number alone.
    """
    whole, part = _turns_per_sample(frequency_hz, sample_rate_hz)
    table_sine, table_cosine = _table(frequency_hz, sample_rate_hz)
    first = int(first)
    begin, end = first // _STEP, -(-(first + count) // _STEP)
    start = np.array([row * _STEP * whole % part / part for row in range(begin, end)])
    angle = 2 * np.pi * start + phase_rad
    rows = np.sin(angle)[:, None] * table_cosine
    rows += np.cos(angle)[:, None] * table_sine
    offset = first - begin * _STEP
    return np.asarray(rows.reshape(-1)[offset : offset + count])


@lru_cache(maxsize=64)
def _turns_per_sample(frequency_hz: float, sample_rate_hz: float) -> tuple[int, int]:
    return (Fraction(frequency_hz) / Fraction(sample_rate_hz)).as_integer_ratio()


@lru_cache(maxsize=64)
def _table(frequency_hz: float, sample_rate_hz: float) -> tuple[Array, Array]:
    angle = 2 * np.pi * (turns(0, _STEP, frequency_hz, sample_rate_hz) % 1.0)
    return np.sin(angle), np.cos(angle)
