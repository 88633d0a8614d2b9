"""Gratings: periodic waves across the screen, band-limited by their harmonics."""

from __future__ import annotations

from functools import cached_property
from math import cos, radians, sin
from typing import Annotated, Literal, Self, get_args

import numpy as np
from pydantic import Field, PositiveFloat

from haptix.base.checks import Array
from haptix.base.native import NULL, Struct, doubles, library, room
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
        _ = self._compiled
        return self

    @cached_property
    def _waveform(self) -> Waveform:
        return Waveform(self.wave, self.duty)

    @cached_property
    def tables(self) -> list[Array]:
        """A period for 0, 1, 2, 4, ... harmonics: its values."""
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
            wave = np.fft.irfft(spectrum, size)
            tables.append((self.low + self.high) / 2 + (self.high - self.low) / 2 * wave)
            count = max(1, 2 * count)
        return tables

    @cached_property
    def _compiled(self) -> Struct:
        turn = radians(self.orientation_deg)
        return Struct(
            "hx_material",
            outside=self.outside,
            cosine=cos(turn),
            sine=sin(turn),
            low=self.low,
            high=self.high,
            numbers=len(self.tables),
            number=np.concatenate(self.tables),
            wave=get_args(Shape).index(self.wave),
            period_mm=self.period_mm,
            phase=self.phase,
            duty=self.duty,
        )

    def _sample(self, x_mm: Array, y_mm: Array, footprint_mm: float | Array) -> Array:
        one, each = footprint_mm, NULL
        if isinstance(footprint_mm, np.ndarray):
            one, each = 0.0, doubles(footprint_mm)
        value, at = room(x_mm.size)
        library.hx_grating_sample(
            self._compiled.at, doubles(x_mm), doubles(y_mm), one, each, x_mm.size, at
        )
        return value

    _anywhere = _sample  # it has the value outside for places that are none
