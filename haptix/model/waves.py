"""Periodic waves: their phase on a sample clock, and their shape over one period."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from math import pi
from typing import Literal, Self, get_args

import numpy as np
import numpy.typing as npt

from haptix.base.checks import Array
from haptix.base.errors import InputError

_LONGEST_TABLE = 4096  # samples
_STEP = 512  # samples between two points of the grid on which `sine` adds angles


def turns(first: int, count: int, frequency_hz: float, sample_rate_hz: float) -> Array:
    """Phase in periods at samples `first` to ``first + count - 1``, below 1 at the first.

    Whole periods are taken off in whole numbers: hours of samples keep their precision.

    Examples
    --------
    >>> turns(0, 4, frequency_hz=1000, sample_rate_hz=4000).tolist()
    [0.0, 0.25, 0.5, 0.75]
    """
    whole, part = _turns_per_sample(frequency_hz, sample_rate_hz)
    start = int(first) * whole % part / part
    ramp = _ramp if count <= _STEP else _ramp.__wrapped__  # long ones would fill the memory
    return np.asarray(start + ramp(count, frequency_hz, sample_rate_hz))


def sine(
    first: int, count: int, frequency_hz: float, sample_rate_hz: float, phase_rad: float = 0.0
) -> Array:
    """``sin(2 pi f n / rate + phase)`` at samples `first` to ``first + count - 1``.

    By angle addition on a fixed grid of samples: three times as fast as a sine per sample. A value
    depends on its sample's number alone.

    Examples
    --------
    >>> (sine(0, 4, frequency_hz=1000, sample_rate_hz=4000) + 0.0).round(6).tolist()
    [0.0, 1.0, 0.0, -1.0]
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


@lru_cache(maxsize=8)
def _ramp(count: int, frequency_hz: float, sample_rate_hz: float) -> Array:
    """Phase since the first sample, cached: a renderer asks for blocks of the same lengths."""
    return np.asarray(frequency_hz / sample_rate_hz * np.arange(count))


@lru_cache(maxsize=64)
def _turns_per_sample(frequency_hz: float, sample_rate_hz: float) -> tuple[int, int]:
    return (Fraction(frequency_hz) / Fraction(sample_rate_hz)).as_integer_ratio()


@lru_cache(maxsize=64)
def _table(frequency_hz: float, sample_rate_hz: float) -> tuple[Array, Array]:
    angle = 2 * np.pi * (turns(0, _STEP, frequency_hz, sample_rate_hz) % 1.0)
    return np.sin(angle), np.cos(angle)


@lru_cache(maxsize=8)
def sine_table(frequency_hz: float, sample_rate_hz: float) -> Array | None:
    """Return a sine from phase 0 until it repeats, read only; None if that is too long."""
    whole, period = _turns_per_sample(frequency_hz, sample_rate_hz)
    if period > _LONGEST_TABLE:
        return None
    values = np.sin(2 * np.pi * (np.arange(period) * whole % period / period))
    values.flags.writeable = False
    return values


Shape = Literal["sine", "square", "sawtooth"]

_LEAST_SAMPLES = 2


@dataclass(frozen=True, eq=False)
class Waveform:
    """One period of a wave whose largest magnitude is 1.

    Raises `InputError` if the shape is unknown, or the duty is not between 0 and 1.

    Examples
    --------
    >>> Waveform("square").mean_square, round(Waveform("sine").mean_square, 12)
    (1.0, 0.5)
    """

    shape: Shape | Literal["samples"] = "sine"
    """The sine rises from 0. The square wave is 1 first, then -1. The sawtooth rises from -1 to 1
    and falls at once. Samples are joined by straight lines."""
    duty: float = 0.5
    """Share of the period for which the square wave is 1."""
    period: Array | None = None
    """Even samples of one period, for the shape "samples"; `of_samples` scales them."""
    shift_turns: float = 0.0
    """Part of the period that lies before turn 0."""

    def __post_init__(self) -> None:
        known = (*get_args(Shape), *([] if self.period is None else ["samples"]))
        if self.shape not in known:
            raise InputError(f"wave: expected one of {', '.join(known)}, got {self.shape!r}")
        if not 0 < self.duty < 1:
            raise InputError(f"duty: expected a part between 0 and 1, got {self.duty:g}")

    @classmethod
    def of_samples(cls, samples: npt.ArrayLike) -> Self:
        """Take one period, sampled evenly; scaled so that its largest magnitude is 1.

        Raises `InputError` if there are fewer than two samples, one is not finite, or all are 0.

        Examples
        --------
        >>> Waveform.of_samples([1.0, -1.0]).mean
        0.0
        """
        try:
            period = np.asarray(samples, dtype=float)
        except (TypeError, ValueError):
            raise InputError(f"waveform: expected samples of one period, got {samples!r}") from None
        if period.ndim != 1 or len(period) < _LEAST_SAMPLES or not np.isfinite(period).all():
            raise InputError(
                "waveform: expected two or more finite samples of one period, got an array of "
                f"shape {period.shape}"
            )
        peak = float(np.abs(period).max())
        if peak == 0:
            raise InputError("waveform: expected samples that are not all 0")
        return cls("samples", period=period / peak)

    def at(self, turns: Array) -> Array:
        """Values at phases in periods, of any shape.

        Examples
        --------
        >>> Waveform("square").at(np.array([0.25, 0.75])).tolist()
        [1.0, -1.0]
        """
        place = turns + self.shift_turns
        if self.shape == "sine":
            return np.asarray(np.sin(2 * pi * place))
        place = place - np.floor(place)
        if self.shape == "sawtooth":
            return np.asarray(2 * place - 1)
        if self.shape == "square":
            return np.where(place < self.duty, 1.0, -1.0)
        assert self.period is not None  # by __post_init__
        around = np.append(self.period, self.period[0])
        place *= len(self.period)
        cell = np.minimum(place.astype(np.intp), len(self.period) - 1)
        start = around[cell]
        return np.asarray(start + (place - cell) * (around[cell + 1] - start))

    def harmonics(self, count: int) -> npt.NDArray[np.complex128]:
        """Amplitudes c of the series ``Re sum_n c_n exp(2 pi i n s)``, s in periods.

        Shape (count + 1,); c_0 is the mean. Of samples it is the series that passes through them.

        Examples
        --------
        >>> int(abs(Waveform("square").harmonics(3)).argmax())  # the lowest
        1
        """
        n = np.arange(count + 1)
        c = np.zeros(count + 1, dtype=np.complex128)
        if self.shape == "sine":
            c[n == 1] = -1j
        elif self.shape == "sawtooth":
            c[1:] = 2j / (pi * n[1:])
        elif self.shape == "square":
            c[0] = 2 * self.duty - 1
            c[1:] = 2 * (1 - np.exp(-2j * pi * n[1:] * self.duty)) / (1j * pi * n[1:])
        else:
            assert self.period is not None  # by __post_init__
            size = len(self.period)
            spectrum = np.fft.rfft(self.period) / size
            spectrum[1:] *= 2
            if size % 2 == 0:
                spectrum[-1] /= 2  # the highest harmonic has no partner of negative frequency
            known = min(len(c), len(spectrum))
            c[:known] = spectrum[:known]
        return np.asarray(c * np.exp(2j * pi * n * self.shift_turns))

    @property
    def highest_harmonic(self) -> int | None:
        """Number of the highest harmonic; None for a wave with steps, whose series has no end."""
        if self.period is not None:
            return len(self.period) // 2
        return 1 if self.shape == "sine" else None

    @property
    def mean(self) -> float:
        """Mean over the period."""
        return float(self.harmonics(0)[0].real)

    @property
    def mean_square(self) -> float:
        """Mean of the square over the period."""
        if self.period is None:
            return {"sine": 1 / 2, "square": 1.0, "sawtooth": 1 / 3}[self.shape]
        # The square of a straight line: thirds of the products of neighbours.
        here, after = self.period, np.roll(self.period, -1)
        return float((here**2 + here * after + after**2).mean()) / 3
