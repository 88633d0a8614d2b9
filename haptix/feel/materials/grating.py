"""Gratings: periodic waves across the screen, band-limited by their harmonics."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from math import cos, log2, radians, sin
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import Field, PositiveFloat

from haptix.base.checks import Array
from haptix.feel.materials.field import FrictionField
from haptix.feel.materials.material import Scaled
from haptix.model.waves import Shape, Waveform

_MOST_HARMONICS = 1024
_POINTS_PER_WAVE = 16  # for a table's highest harmonic, of which interpolation then loses 2 %


class Grating(FrictionField, Scaled):
    """A periodic wave of friction without end.

    With a footprint f the grating is the sum of its harmonics that are longer than 2 f. Between two
    such sums the values are blended, so that nothing jumps when the speed changes. At a point it is
    the wave itself.

    Parameters
    ----------
    period_mm : float
        Distance from one rib to the next.
    wave : {"sine", "square", "sawtooth"}
        Shape of the ribs. The square wave is high first. The sawtooth rises and falls at once.
    orientation_deg : float
        Direction in which it runs: 0 to the right, 90 down. Its ridges lie across.
    duty : float
        Part of the period for which the square wave is high.
    phase : float
        Part of the period that lies before the origin. The sine is at its middle and rises there.

    Raises
    ------
    InputError
        If a value is outside its range.

    Examples
    --------
    >>> from haptix.feel import Motion
    >>> grating = Grating(period_mm=2.0, wave="square", low=0.2, high=0.8)
    >>> slow = Motion.of([0.5, 1.5], 0.0, 0.0, 10.0, 0.0)
    >>> grating.evaluator.wanted(slow).tolist()  # a ridge, a valley
    [0.8, 0.2]
    """

    kind: Literal["grating"] = "grating"
    period_mm: PositiveFloat
    wave: Shape = "sine"
    orientation_deg: float = 0.0
    duty: Annotated[float, Field(gt=0, lt=1)] = 0.5
    phase: float = 0.0

    @property
    def evaluator(self) -> Self:
        """Itself, with its tables computed."""
        _ = self._ready
        return self

    @cached_property
    def _ready(self) -> tuple[tuple[tuple[Array, Array, Array], ...], Array, Array, Array, Array]:
        turn = radians(self.orientation_deg)
        c, s = np.array(cos(turn)), np.array(sin(turn))
        return self.tables, c, s, np.array(self.period_mm), np.array(self.phase)

    @cached_property
    def _waveform(self) -> Waveform:
        return Waveform(self.wave, self.duty)

    @cached_property
    def tables(self) -> tuple[tuple[Array, Array, Array], ...]:
        """A period for 0, 1, 2, 4, ... harmonics: values, steps to the next, size."""
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
            table = self._between(np.fft.irfft(spectrum, size))
            around = np.append(table, table[:2])  # rounding may reach the period's end
            tables.append((around[:-1], np.diff(around), np.array(float(size))))
            count = max(1, 2 * count)
        return tuple(tables)

    def _sample(self, x_mm: Array, y_mm: Array, footprint_mm: float | Array) -> Array:
        tables, c, s, period, phase = self._ready
        along = x_mm * c + y_mm * s if self.orientation_deg else x_mm
        place = along / period
        place += phase
        place -= np.floor(place)
        last = len(tables) - 1
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
        value = _blend_levels(depth, last, lambda level, mine: self._read(level, place[mine]))
        if isinstance(footprint_mm, np.ndarray):
            points = footprint_mm == 0
            value[points] = self._at_points(place[points])
        return value

    def _at_points(self, place: Array) -> Array:
        if self.wave == "square":
            # Twice as fast as the waveform.
            return np.where(place < self.duty, self.high, self.low)
        return self._between(self._waveform.at(place))

    def _read(self, level: int, place: Array) -> Array:
        table, rise, size = self.tables[level]
        at = place * size
        index = at.astype(np.intp)
        at -= index
        at *= rise[index]
        at += table[index]
        return at

    def _between(self, wave: Array) -> Array:
        return (self.low + self.high) / 2 + (self.high - self.low) / 2 * wave


def _blend_levels(depth: float | Array, last: int, read: Callable[[int, Any], Array]) -> Array:
    """Blend levels linearly by depth, 0 to `last`: one number, or an array of shape (places,).

    ``read(level, mine)`` returns new values of a level at the places that `mine` selects.
    """
    if isinstance(depth, float):
        value = read(int(depth), ...)
        if (part := depth - int(depth)) > 0:
            coarse = read(int(depth) + 1, ...)
            coarse -= value
            coarse *= part
            value += coarse
        return value
    level = np.minimum(depth.astype(np.intp), max(last - 1, 0))
    value = np.empty(0)
    for lower in np.unique(level).tolist():
        mine = level == lower
        values = read(lower, mine)
        if last > 0:
            values += (depth[mine] - lower) * (read(lower + 1, mine) - values)
        if not value.size:
            value = np.empty(depth.shape, dtype=values.dtype)
        value[mine] = values
    return value
