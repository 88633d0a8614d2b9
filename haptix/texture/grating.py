"""Gratings: periodic waves across the screen, band-limited by their harmonics."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import log2

import numpy as np

from haptix.checks import Array, Positive, check_fields
from haptix.texture.field import FrictionField, TargetKind, check_range, check_target, turned
from haptix.texture.pyramid import blend_levels
from haptix.waves import Shape, Waveform

_MOST_HARMONICS = 1024
_POINTS_PER_WAVE = 16  # of a table, for its highest harmonic: linear interpolation loses 2 % of it


@dataclass(frozen=True)
class Grating(FrictionField):
    """A periodic wave of friction without end.

    With a footprint f the grating is the sum of its harmonics that are longer than 2 f. Between two
    such sums the values are blended, so that nothing jumps when the speed changes. At a point it is
    the wave itself.

    Parameters
    ----------
    period_mm : float
        Length of a period.
    wave : {"sine", "square", "sawtooth"}
        The square wave is high first. The sawtooth rises and falls at once.
    orientation_deg : float
        Direction in which the wave runs: 0 to the right, 90 down. Its ridges lie across.
    duty : float
        Part of the period for which the square wave is high.
    target : {"mu", "contrast", "share", "plain"}
        What `low` and `high` are, see `haptix.texture.as_mu`.
    low, high : float
        Lowest and highest value.
    phase : float
        Part of the period that lies before the origin. The sine is at its middle and rises there.

    Raises
    ------
    InputError
        If a value is outside its range.

    Examples
    --------
    >>> from haptix.motion import Motion
    >>> grating = Grating(period_mm=2.0, wave="square", low=0.2, high=0.8)
    >>> slow = Motion.of([0.5, 1.5], 0.0, 0.0, 10.0, 0.0)
    >>> grating.evaluator.wanted(slow).tolist()  # a ridge, a valley
    [0.8, 0.2]
    """

    period_mm: Positive
    wave: Shape = "sine"
    orientation_deg: float = 0.0
    duty: float = 0.5
    target: TargetKind = "share"
    low: float = 0.0
    high: float = 1.0
    phase: float = 0.0
    _waveform: Waveform = field(init=False, repr=False, compare=False)
    _tables: tuple[tuple[Array, Array, Array], ...] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        check_fields(self)
        check_target(self.target)
        check_range("low, high", self.target, self.low, self.high)
        object.__setattr__(self, "_waveform", Waveform(self.wave, self.duty))
        object.__setattr__(self, "_tables", self._all_tables())

    @property
    def outside(self) -> float:
        """The lowest value."""
        return self.low

    def _all_tables(self) -> tuple[tuple[Array, Array, Array], ...]:
        """Tabulate a period for 0, 1, 2, 4, ... harmonics: its values, the next ones, its size."""
        tables = []
        most = self._waveform.highest_harmonic or _MOST_HARMONICS
        series = self._waveform.harmonics(most)
        count = 0
        while count <= most:
            size = _POINTS_PER_WAVE * max(count, 4)
            spectrum = np.zeros(size // 2 + 1, dtype=complex)
            spectrum[0] = series[0] * size
            # Lanczos' factors keep a cut-off series from ringing at the steps.
            taper = np.sinc(np.arange(1, count + 1) / (count + 1)) if most > 1 else 1.0
            spectrum[1 : count + 1] = taper * series[1 : count + 1] * size / 2
            table = self._scaled(np.fft.irfft(spectrum, size))
            around = np.append(table, table[:2])  # rounding may reach the period's end
            tables.append((around[:-1], np.diff(around), np.array(float(size))))
            count = max(1, 2 * count)
        return tuple(tables)

    def _sample(self, x_mm: Array, y_mm: Array, footprint_mm: float | Array) -> Array:
        along, _ = turned(x_mm, y_mm, self.orientation_deg)
        place = along / np.array(self.period_mm)
        place += np.array(self.phase)
        place -= np.floor(place)
        last = len(self._tables) - 1
        # Table l > 0 holds 2^(l-1) harmonics, table 0 only the mean.
        depth: float | Array
        if isinstance(footprint_mm, np.ndarray):
            with np.errstate(divide="ignore"):
                depth = np.log2(self.period_mm / (2 * footprint_mm)).clip(0.0, last)
        elif footprint_mm == 0:
            return self._at_points(place)
        else:
            room = max(self.period_mm / (2 * footprint_mm), 1.0)
            depth = min(log2(room), float(last))
        value = blend_levels(depth, last, lambda level, mine: self._read(level, place[mine]))
        if isinstance(footprint_mm, np.ndarray):
            points = footprint_mm == 0
            value[points] = self._at_points(place[points])
        return value

    def _at_points(self, place: Array) -> Array:
        if self.wave == "square":
            return np.where(place < self.duty, self.high, self.low)  # in half the time
        return self._scaled(self._waveform.at(place))

    def _read(self, level: int, place: Array) -> Array:
        table, rise, size = self._tables[level]
        at = place * size
        index = at.astype(np.intp)
        at -= index
        at *= rise[index]
        at += table[index]
        return at

    def _scaled(self, wave: Array) -> Array:
        return (self.low + self.high) / 2 + (self.high - self.low) / 2 * wave
