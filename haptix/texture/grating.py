"""Gratings: waves across the screen, band-limited by their harmonics."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import cos, frexp, log2, pi, radians, sin
from typing import Literal, get_args

import numpy as np
import numpy.typing as npt

from haptix.errors import InputError, check_positive
from haptix.texture.field import (
    Array,
    FrictionField,
    Target,
    are_near,
    check_numbers,
    check_range,
    check_target,
    without_far_places,
)

Wave = Literal["sine", "square", "sawtooth"]

_MOST_HARMONICS = 1024
_POINTS_PER_WAVE = 16  # of a table, for its highest harmonic; linear interpolation loses 2 % of it


@dataclass(frozen=True)
class Grating(FrictionField):
    """A periodic wave of friction, without end.

    With a footprint f the wave is the sum of those of its harmonics that are longer than 2 f, from
    its Fourier series; fewer by up to half, blended so that nothing jumps when the speed changes.
    At a point it is the wave itself.

    Parameters
    ----------
    period_mm : float
        Length of the wave.
    wave : {"sine", "square", "sawtooth"}
        The square wave is high first; the sawtooth rises and falls at once.
    orientation_deg : float
        Direction in which the wave runs: 0 to the right, 90 down. Its ridges lie across.
    duty : float
        Part of the period for which the square wave is high.
    target : {"mu", "contrast", "share"}
        What `low` and `high` are, see `haptix.texture.as_mu`.
    low, high : float
        Lowest and highest value.
    phase : float
        Part of the period that lies before the origin. The sine is at its middle and rising there.

    Raises
    ------
    InputError
        If a value is outside its range.
    """

    period_mm: float
    wave: Wave = "sine"
    orientation_deg: float = 0.0
    duty: float = 0.5
    target: Target = "share"
    low: float = 0.0
    high: float = 1.0
    phase: float = 0.0
    _tables: tuple[tuple[Array, Array, Array], ...] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        check_numbers(
            period_mm=self.period_mm,
            orientation_deg=self.orientation_deg,
            duty=self.duty,
            low=self.low,
            high=self.high,
            phase=self.phase,
        )
        check_positive("period_mm", self.period_mm)
        if self.wave not in get_args(Wave):
            raise InputError(
                f"wave: expected one of {', '.join(get_args(Wave))}, got {self.wave!r}"
            )
        if not 0 < self.duty < 1:
            raise InputError(f"duty: expected a part between 0 and 1, got {self.duty:g}")
        check_target(self.target)
        check_range("low, high", self.target, self.low, self.high)
        object.__setattr__(self, "_tables", self._all_tables())

    @property
    def outside(self) -> float:
        """The lowest value."""
        return self.low

    def harmonics(self, count: int) -> tuple[float, npt.NDArray[np.complex128]]:
        """Mean, and complex amplitudes c of ``Re sum c_n exp(2 pi i n s)``, s in periods.

        For values from 0 to 1; n from 1 to `count`.
        """
        n = np.arange(1, count + 1)
        if self.wave == "sine":
            return 0.5, np.where(n == 1, -0.5j, 0)
        if self.wave == "sawtooth":
            return 0.5, np.asarray(1j / (pi * n), dtype=np.complex128)
        series = (1 - np.exp(-2j * pi * n * self.duty)) / (1j * pi * n)
        return self.duty, np.asarray(series, dtype=np.complex128)

    def _all_tables(self) -> tuple[tuple[Array, Array, Array], ...]:
        """One period for every doubling of the number of harmonics, from none: flat, next, size."""
        tables = []
        most = 1 if self.wave == "sine" else _MOST_HARMONICS
        mean, every = self.harmonics(most)
        count = 0
        while count <= most:
            size = _POINTS_PER_WAVE * max(count, 4)
            spectrum = np.zeros(size // 2 + 1, dtype=complex)
            spectrum[0] = mean * size
            # Lanczos' factors keep a cut-off series from ringing at the steps.
            taper = np.sinc(np.arange(1, count + 1) / (count + 1)) if most > 1 else 1.0
            spectrum[1 : count + 1] = taper * every[:count] * size / 2
            table = self.low + (self.high - self.low) * np.fft.irfft(spectrum, size)
            around = np.append(table, table[:2])  # rounding may reach the period's end
            tables.append((around[:-1], np.diff(around), np.array(float(size))))
            count = max(1, 2 * count)
        return tuple(tables)

    def _sample(self, x_mm: Array, y_mm: Array, footprint_mm: float | Array) -> Array:
        if not are_near(x_mm, y_mm):
            return without_far_places(self, x_mm, y_mm, footprint_mm)
        angle = radians(self.orientation_deg)
        place = x_mm * np.array(cos(angle) / self.period_mm)
        place += y_mm * np.array(sin(angle) / self.period_mm)
        place += np.array(self.phase)
        place -= np.floor(place)
        if isinstance(footprint_mm, np.ndarray):
            return self._varied(place, footprint_mm)
        return self._banded(place, footprint_mm)

    def _banded(self, place: Array, footprint_mm: float) -> Array:
        if footprint_mm == 0:
            return self.low + (self.high - self.low) * self._exact(place)
        # Harmonics that are long enough. Table l > 0 holds 2^(l-1), table 0 only the mean.
        room = self.period_mm / (2 * footprint_mm)
        last = len(self._tables) - 1
        if room >= 2.0**last:
            return self._read(last, place)
        if room <= 1:
            return self._read(0, place)
        level = frexp(room)[1] - 1
        value = self._read(level, place)
        finer = self._read(level + 1, place)
        finer -= value
        finer *= np.array(log2(room) - level)
        value += finer
        return value

    def _varied(self, place: Array, footprint_mm: Array) -> Array:
        last = len(self._tables) - 1
        with np.errstate(divide="ignore"):
            depth = np.log2(self.period_mm / (2 * footprint_mm))
        depth = np.minimum(np.maximum(depth, 0.0), float(last))
        level = np.minimum(depth.astype(np.intp), last - 1)
        value = np.empty(place.shape)
        for one in np.unique(level):
            mine = level == one
            value[mine] = self._read(int(one), place[mine])
            finer = self._read(int(one) + 1, place[mine])
            value[mine] += (depth[mine] - one) * (finer - value[mine])
        points = footprint_mm == 0
        value[points] = self._banded(place[points], 0.0)
        return value

    def _read(self, level: int, place: Array) -> Array:
        table, rise, size = self._tables[level]
        at = place * size
        index = at.astype(np.intp)
        at -= index
        at *= rise[index]
        at += table[index]
        return at

    def _exact(self, place: Array) -> Array:
        if self.wave == "sine":
            return 0.5 + 0.5 * np.sin(2 * pi * place)
        if self.wave == "sawtooth":
            return place
        return (place < self.duty).astype(np.float64)
