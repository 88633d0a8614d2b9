"""Amplitude to drive signal, and back."""

from __future__ import annotations

from dataclasses import dataclass, field
from fractions import Fraction
from functools import cached_property
from math import sqrt
from typing import Literal

import numpy as np
import numpy.typing as npt

from haptix.errors import InputError, check_positive

Array = npt.NDArray[np.float64]

_LEAST_DC_FREE = 1e-6
"""Of a waveform's mean: what rounding of a thousand samples leaves."""
_PLACES = 4096  # of a waveform's table; a line between two is within 3e-7 of a sine


@dataclass(frozen=True)
class Carrier:
    """A sine of given frequency on the device's sample clock, continuous across blocks.

    Parameters
    ----------
    frequency_hz : float
        At most a quarter of the sample rate: below that a period has too few samples to carry its
        amplitude.
    sample_rate_hz : float
        Of the device.
    """

    frequency_hz: float
    sample_rate_hz: float

    def __post_init__(self) -> None:
        check_positive("frequency_hz", self.frequency_hz)
        check_positive("sample_rate_hz", self.sample_rate_hz)
        if self.frequency_hz > self.sample_rate_hz / 4:
            raise InputError(
                f"frequency_hz: expected at most a quarter of the device's {self.sample_rate_hz:g} "
                f"samples per second, got {self.frequency_hz:g} Hz; choose a lower carrier"
            )

    @property
    def peak_per_sine(self) -> float:
        """Peak of the wave over the amplitude of the sine that pulls as much."""
        return 1.0

    @property
    def pulls(self) -> Array | None:
        """Pull at even times of a period over its mean; None if too fast for the contact."""
        return None

    def modulate(self, amplitude_v: Array, first_sample: int) -> Array:
        """Drive signal [V] for amplitudes at consecutive samples, shape (samples,)."""
        return amplitude_v * self._wave(first_sample, len(amplitude_v))

    def demodulate(self, drive_v: Array) -> tuple[Array, Array]:
        """Sample index at the middle, and amplitude [V], of every whole carrier period.

        The amplitude is the least-squares one of the known carrier within each period; the signal
        starts at sample 0 of the clock.
        """
        period = self.sample_rate_hz / self.frequency_hz
        bounds = np.arange(0, len(drive_v) + 1e-9, period).round().astype(int)
        wave = self._wave(0, len(drive_v))
        starts = bounds[:-1]
        product = np.add.reduceat(drive_v[: bounds[-1]] * wave[: bounds[-1]], starts)
        energy = np.add.reduceat(wave[: bounds[-1]] ** 2, starts)
        return (bounds[:-1] + bounds[1:] - 1) / 2, product / energy

    @cached_property
    def _turns_per_sample(self) -> tuple[int, int]:
        """Numerator and denominator: in whole numbers the phase is exact at any sample."""
        return (Fraction(self.frequency_hz) / Fraction(self.sample_rate_hz)).as_integer_ratio()

    def _turns(self, first_sample: int, count: int) -> Array:
        """Phase in periods, small at the first sample: hours of samples keep their precision."""
        whole, part = self._turns_per_sample
        start = int(first_sample) * whole % part / part
        return np.asarray(start + self.frequency_hz / self.sample_rate_hz * np.arange(count))

    def _wave(self, first_sample: int, count: int) -> Array:
        return np.asarray(np.sin(2 * np.pi * self._turns(first_sample, count)))


@dataclass(frozen=True)
class Envelope(Carrier):
    """The amplitude of a carrier that the driver makes itself."""

    def __post_init__(self) -> None:
        check_positive("frequency_hz", self.frequency_hz)
        check_positive("sample_rate_hz", self.sample_rate_hz)

    def modulate(self, amplitude_v: Array, first_sample: int) -> Array:
        """Return the amplitudes themselves."""
        return amplitude_v

    def demodulate(self, drive_v: Array) -> tuple[Array, Array]:
        """Sample index and amplitude [V] of every sample."""
        return np.arange(len(drive_v), dtype=float), drive_v


@dataclass(frozen=True)
class DirectDrive(Carrier):
    """A wave at the frequency that is felt, of any shape.

    Contact area follows the mean of the squared voltage, so an amplitude is that of the sine which
    pulls as much: a square wave of amplitude A peaks at ``A / sqrt(2)``.

    Parameters
    ----------
    waveform : "sine", "square" or array_like, shape (samples,)
        One period, or its samples: not all 0, and with a mean of 0, since a constant voltage
        charges the skin and then pulls no more.
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
        """Peak of the wave over the amplitude of the sine that pulls as much."""
        return self._peak

    @property
    def pulls(self) -> Array | None:
        """Pull at even times of a period over its mean; None if it is constant."""
        # Coarser than the table: the mean of a period converges fast. Never at an edge at turn 0.
        turns = (np.arange(64) + 0.37) / 64
        places = len(self._table) - 1
        pulls = np.interp(turns * places, np.arange(places + 1), self._table) ** 2
        pulls /= pulls.mean()
        return None if np.ptp(pulls) < 0.1 else pulls

    def _wave(self, first_sample: int, count: int) -> Array:
        places = len(self._table) - 1
        at = (self._turns(first_sample, count) % 1.0) * places
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
