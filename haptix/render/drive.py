"""Drives: from an amplitude to a drive signal and back."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from fractions import Fraction
from functools import lru_cache
from math import sqrt
from typing import Literal

import numpy as np
import numpy.typing as npt

from haptix.errors import InputError, check_positive

Array = npt.NDArray[np.float64]

_LEAST_DC_FREE = 1e-6
"""Largest mean of a waveform over its peak: what rounding of a thousand samples leaves."""
_PLACES = 4096  # of a waveform's table; lines between them are within 3e-7 of a sine


@dataclass(frozen=True)
class Drive(ABC):
    """A periodic voltage on the device's sample clock, continuous across blocks.

    Parameters
    ----------
    frequency_hz : float
        At most a quarter of the device's sample rate: a shorter period has too few samples to
        carry its amplitude.
    """

    frequency_hz: float

    def __post_init__(self) -> None:
        check_positive("frequency_hz", self.frequency_hz)

    def check_rate(self, sample_rate_hz: float) -> None:
        """Raise `InputError` unless a device of this sample rate can play the drive."""
        check_positive("sample_rate_hz", sample_rate_hz)
        if self.frequency_hz > sample_rate_hz / 4:
            raise InputError(
                f"frequency_hz: expected at most a quarter of the device's {sample_rate_hz:g} "
                f"samples per second, got {self.frequency_hz:g} Hz; choose a lower carrier"
            )

    @property
    def peak_per_sine(self) -> float:
        """Peak of the drive over the amplitude of the sine with the same mean attraction."""
        return 1.0

    @property
    def pulls(self) -> Array | None:
        """Attraction at even times of a period over its mean; None if the contact follows the mean.

        The contact is too slow for a carrier, and a constant attraction has no ripple.
        """
        return None

    def modulate(self, amplitude_v: Array, first_sample: int, sample_rate_hz: float) -> Array:
        """Drive signal [V] for amplitudes at consecutive samples, shape (samples,)."""
        return amplitude_v * self._wave(first_sample, len(amplitude_v), sample_rate_hz)

    def demodulate(self, drive_v: Array, sample_rate_hz: float) -> tuple[Array, Array]:
        """Sample index at the middle, and amplitude [V], of every whole period.

        The amplitude is a least-squares fit of the known wave within each period. The signal
        starts at sample 0 of the clock.
        """
        period = sample_rate_hz / self.frequency_hz
        bounds = np.arange(0, len(drive_v) + 1e-9, period).round().astype(int)
        wave = self._wave(0, len(drive_v), sample_rate_hz)
        starts = bounds[:-1]
        product = np.add.reduceat(drive_v[: bounds[-1]] * wave[: bounds[-1]], starts)
        energy = np.add.reduceat(wave[: bounds[-1]] ** 2, starts)
        return (bounds[:-1] + bounds[1:] - 1) / 2, product / energy

    @abstractmethod
    def _wave(self, first_sample: int, count: int, sample_rate_hz: float) -> Array:
        """Return the wave of amplitude 1 V, shape (count,)."""

    def _turns(self, first_sample: int, count: int, sample_rate_hz: float) -> Array:
        """Phase in periods, small at the first sample: hours of samples keep their precision."""
        whole, part = _turns_per_sample(self.frequency_hz, sample_rate_hz)
        start = int(first_sample) * whole % part / part
        return np.asarray(start + self.frequency_hz / sample_rate_hz * np.arange(count))


@lru_cache(maxsize=64)
def _turns_per_sample(frequency_hz: float, sample_rate_hz: float) -> tuple[int, int]:
    """Numerator and denominator: in whole numbers the phase is exact at any sample."""
    return (Fraction(frequency_hz) / Fraction(sample_rate_hz)).as_integer_ratio()


@dataclass(frozen=True)
class SineCarrier(Drive):
    """A sine that is too fast to be felt; its amplitude is the envelope."""

    def _wave(self, first_sample: int, count: int, sample_rate_hz: float) -> Array:
        turns = self._turns(first_sample, count, sample_rate_hz)
        return np.asarray(np.sin(2 * np.pi * turns))


@dataclass(frozen=True)
class DriverCarrier(SineCarrier):
    """A carrier that the driver makes itself: it is sent the envelope."""

    def check_rate(self, sample_rate_hz: float) -> None:
        """Accept any rate: the samples hold only the envelope."""
        check_positive("sample_rate_hz", sample_rate_hz)

    def modulate(self, amplitude_v: Array, first_sample: int, sample_rate_hz: float) -> Array:
        """Return the amplitudes themselves."""
        return amplitude_v

    def demodulate(self, drive_v: Array, sample_rate_hz: float) -> tuple[Array, Array]:
        """Sample index and amplitude [V] of every sample."""
        return np.arange(len(drive_v), dtype=float), drive_v


@dataclass(frozen=True)
class DirectWave(Drive):
    """A wave of any shape at the frequency that is felt.

    Contact area follows the mean of the squared voltage, so an amplitude is that of the sine with
    the same mean attraction: a square wave of amplitude A peaks at ``A / sqrt(2)``.

    Parameters
    ----------
    waveform : "sine", "square" or array_like, shape (samples,)
        One period, or its samples. They may not all be 0. Their mean must be 0, since a constant
        voltage charges the skin and then attracts no more.
    """

    waveform: Literal["sine", "square"] | npt.ArrayLike = "sine"
    _table: Array = field(init=False, repr=False, compare=False)
    _peak: float = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        table = np.append(one := _one_period(self.waveform), one[0])
        # Of the period's straight lines: thirds of the products of neighbours.
        squares = table[:-1] ** 2 + table[:-1] * table[1:] + table[1:] ** 2
        scale = sqrt(0.5 / (float(squares.mean()) / 3))
        object.__setattr__(self, "_table", table * scale)
        object.__setattr__(self, "_peak", float(np.abs(table).max()) * scale)

    @property
    def peak_per_sine(self) -> float:
        """Peak of the drive over the amplitude of the sine with the same mean attraction."""
        return self._peak

    @property
    def pulls(self) -> Array | None:
        """Attraction at even times of a period over its mean; None if it is constant."""
        # Coarser than the table: the mean of a period converges fast. Never at an edge at turn 0.
        turns = (np.arange(64) + 0.37) / 64
        places = len(self._table) - 1
        pulls = np.interp(turns * places, np.arange(places + 1), self._table) ** 2
        pulls /= pulls.mean()
        return None if np.ptp(pulls) < 0.1 else pulls

    def _wave(self, first_sample: int, count: int, sample_rate_hz: float) -> Array:
        places = len(self._table) - 1
        at = (self._turns(first_sample, count, sample_rate_hz) % 1.0) * places
        cell = at.astype(np.intp)
        start = self._table[cell]
        return np.asarray(start + (at - cell) * (self._table[cell + 1] - start))


def _one_period(waveform: Literal["sine", "square"] | npt.ArrayLike) -> Array:
    turns = np.arange(_PLACES) / _PLACES
    if isinstance(waveform, str):
        if waveform == "sine":
            return np.asarray(np.sin(2 * np.pi * turns))
        if waveform == "square":
            # Its two edges lie within one place of the table, and cross 0 at turns 0 and 1/2.
            return np.asarray(np.sign(np.sin(2 * np.pi * turns).round(12)))
        raise InputError(f'waveform: expected "sine", "square" or samples, got {waveform!r}')
    try:
        samples = np.asarray(waveform, dtype=float)
    except (TypeError, ValueError):
        raise InputError(f"waveform: expected samples of one period, got {waveform!r}") from None
    if samples.ndim != 1 or len(samples) < 2 or not np.isfinite(samples).all():
        raise InputError(
            "waveform: expected two or more finite samples of one period, got an array of shape "
            f"{samples.shape}"
        )
    peak = float(np.abs(samples).max())
    if peak == 0:
        raise InputError("waveform: expected samples that are not all 0")
    if abs(float(samples.mean())) > _LEAST_DC_FREE * peak:
        raise InputError(
            f"waveform: expected a mean of 0, got {samples.mean() / peak:.3g} of its peak; "
            "subtract the mean"
        )
    return samples / peak
