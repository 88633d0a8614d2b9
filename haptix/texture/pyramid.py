"""A sampled map at falling resolutions, read at the resolution of the finger's footprint.

Level 0 is the map itself, bilinear between its pixels. Level 1 is the map smoothed by the binomial
kernel of 9 taps, whose response ``cos^8(pi k p)`` at wavenumber k leaves 6 % at a quarter of the
pixels' rate 1/p and nothing at half of it. Each further level takes every second pixel of the one
before and smooths again. So a level holds only waves of 4 of its pixels or longer, twice as long as
it could hold. Bilinear interpolation then adds little of waves that the map does not have.

A footprint f carries waves longer than 2 f. Level 0 serves footprints up to p/2, level 1 those from
p to 2 p, and each further level twice the footprint of the one before. In between, two levels are
blended linearly in the footprint's logarithm, so nothing jumps when the speed changes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import floor, log2
from typing import Any, Literal

import numpy as np

from haptix.checks import Array

Beyond = Literal["outside", "hold", "repeat"]
"""Beyond the edges of a map: the outside value, the edge's value, or the map again."""

_KERNEL = np.array([1, 8, 28, 56, 70, 56, 28, 8, 1]) / 256
_REACH = len(_KERNEL) // 2
_Origin = tuple[int, int]
"""Row and column of the map at an array's first pixel, in pixels of its level."""


@dataclass(frozen=True)
class _Level:
    """One level, with the numbers of a bilinear look-up.

    Numbers that numpy multiplies with are arrays of no dimension: they take a third of the time of
    a Python float.
    """

    corners: tuple[Array, Array, Array, Array]
    """The flat map, and the map without its first pixel, first row, and both."""
    per_mm: Array
    column: Array
    row: Array
    """Pixels per millimetre, and pixel of the place (0, 0)."""
    stride: Array
    low_x: float
    high_x: float
    low_y: float
    high_y: float
    """Places [mm] between which there are four pixels around."""

    @classmethod
    def of(cls, values: Array, pixel_mm: float, column: float, row: float) -> _Level:
        rows, columns = values.shape
        flat = np.ascontiguousarray(values).reshape(-1)
        # A hair inside, so that rounding cannot reach a pixel that is not there.
        hair = 1e-9 * max(rows, columns)
        return cls(
            (flat, flat[1:], flat[columns:], flat[columns + 1 :]),
            np.array(1 / pixel_mm),
            np.array(column),
            np.array(row),
            np.array(float(columns)),
            (hair - column) * pixel_mm,
            (columns - 1 - hair - column) * pixel_mm,
            (hair - row) * pixel_mm,
            (rows - 1 - hair - row) * pixel_mm,
        )

    def at(self, x_mm: Array, y_mm: Array) -> Array:
        """Bilinear values; those of the rim for places beyond."""
        if not (
            x_mm[x_mm.argmin()] >= self.low_x
            and x_mm[x_mm.argmax()] <= self.high_x
            and y_mm[y_mm.argmin()] >= self.low_y
            and y_mm[y_mm.argmax()] <= self.high_y
        ):
            x_mm = x_mm.clip(self.low_x, self.high_x)
            y_mm = y_mm.clip(self.low_y, self.high_y)
        across = x_mm * self.per_mm
        across += self.column
        down = y_mm * self.per_mm
        down += self.row
        left, above = np.floor(across), np.floor(down)
        across -= left
        down -= above
        above *= self.stride
        above += left
        index = above.astype(np.intp)
        here, right, below, diagonal = self.corners
        upper = here[index]
        slope = right[index]
        slope -= upper
        slope *= across
        upper += slope
        lower = below[index]
        slope = diagonal[index]
        slope -= lower
        slope *= across
        lower += slope
        lower -= upper
        lower *= down
        upper += lower
        return upper


class Pyramid:
    """A map with its levels.

    Parameters
    ----------
    values : ndarray, shape (rows, columns)
        Values at the pixels' centres; the first pixel's corner is at (0, 0). Complex ones hold two
        maps at the price of one look-up.
    pixel_mm : float
        Side of a pixel.
    outside : float
        Value beyond the edges where `beyond` is "outside". The edge is then a ramp as wide as a
        pixel, since a step would alias at any footprint.
    beyond_x, beyond_y : {"outside", "hold", "repeat"}
        Values beyond left and right, and above and below. A map that repeats needs a power of two
        of pixels in that direction.
    """

    def __init__(
        self,
        values: Array,
        pixel_mm: float,
        outside: float,
        beyond_x: Beyond = "outside",
        beyond_y: Beyond = "outside",
    ) -> None:
        rows, columns = values.shape
        self.pixel_mm = pixel_mm
        self.outside = outside
        self._modes: tuple[Beyond, Beyond] = (beyond_y, beyond_x)
        self._period_x = columns * pixel_mm if beyond_x == "repeat" else None
        self._period_y = rows * pixel_mm if beyond_y == "repeat" else None
        self._levels = [self._level(values, (0, 0), 1)]
        # Levels go on until a pixel spans the shorter period, or the map twice: a finger that moves
        # farther from one sample to the next misses it anyway.
        repeated = [
            n for n, mode in zip(values.shape, self._modes, strict=True) if mode == "repeat"
        ]
        widest = min(repeated) if repeated else 2 * max(rows, columns)
        smooth, origin, step = values * 1.0, (0, 0), 1
        while len(self._levels) == 1 or step < widest:
            if len(self._levels) > 1:
                smooth, origin = self._halved(smooth, origin)
                step *= 2
            smooth, origin = self._smoothed(smooth, origin)
            self._levels.append(self._level(smooth, origin, step))
        self._last = len(self._levels) - 1

    def _padded(self, values: Array, origin: _Origin, by: int) -> tuple[Array, _Origin]:
        """The map with more pixels on every side but those where it repeats."""
        first = list(origin)
        for axis, mode in enumerate(self._modes):
            if mode == "repeat":
                continue
            width = [(0, 0), (0, 0)]
            width[axis] = (by, by)
            if mode == "hold":
                values = np.pad(values, width, mode="edge")
            else:
                values = np.pad(values, width, constant_values=self.outside)
            first[axis] -= by
        return values, (first[0], first[1])

    def _smoothed(self, values: Array, origin: _Origin) -> tuple[Array, _Origin]:
        from scipy.ndimage import correlate1d  # a tenth of a second of every start

        values, origin = self._padded(values, origin, _REACH)
        for axis, mode in enumerate(self._modes):
            # What lies beyond the padding is as it was, and stays so.
            ends = {"outside": "constant", "hold": "nearest", "repeat": "wrap"}[mode]
            values = correlate1d(values, _KERNEL, axis=axis, mode=ends, cval=self.outside)
        return values, origin

    def _halved(self, values: Array, origin: _Origin) -> tuple[Array, _Origin]:
        """Every second pixel: those at even places, so that levels stay aligned."""
        values, origin = self._padded(values, origin, 1)
        row, column = origin[0] % 2, origin[1] % 2
        return values[row::2, column::2], ((origin[0] + row) // 2, (origin[1] + column) // 2)

    def _level(self, values: Array, origin: _Origin, step: int) -> _Level:
        # Two pixels: between them, where places beyond are held, there is no trace of the map.
        values, origin = self._padded(values, origin, 2)
        around = [int(mode == "repeat") for mode in self._modes]
        values = np.pad(values, [(one, one) for one in around], mode="wrap")
        # The centre of the map's first pixel is half a pixel from its corner.
        row, column = (
            -0.5 / step - start + more for start, more in zip(origin, around, strict=True)
        )
        return _Level.of(values, self.pixel_mm * step, column, row)

    def sample(self, x_mm: Array, y_mm: Array, footprint_mm: float | Array) -> Array:
        """Values at finite places, shape (places,); see `FrictionField.friction`."""
        if self._period_x is not None:
            x_mm = _into(x_mm, self._period_x)
        if self._period_y is not None:
            y_mm = _into(y_mm, self._period_y)
        wide = footprint_mm / self.pixel_mm
        depth: float | Array
        if isinstance(wide, np.ndarray):
            with np.errstate(divide="ignore"):
                depth = np.log2(wide)
            depth = np.maximum(np.minimum(depth + 1, 1.0), depth).clip(0.0, self._last)
        elif wide <= 0.5:
            depth = 0.0
        else:
            depth = log2(wide)
            depth = min(max(min(depth + 1, 1.0), depth), float(self._last))
        return blend_levels(
            depth, self._last, lambda level, mine: self._levels[level].at(x_mm[mine], y_mm[mine])
        )


def blend_levels(depth: float | Array, last: int, read: Callable[[int, Any], Array]) -> Array:
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
    for one in np.unique(level).tolist():
        mine = level == one
        found = read(one, mine)
        if last > 0:
            found += (depth[mine] - one) * (read(one + 1, mine) - found)
        if not value.size:
            value = np.empty(depth.shape, dtype=found.dtype)
        value[mine] = found
    return value


def _into(place_mm: Array, period_mm: float) -> Array:
    """Places moved by whole periods to between 0 and one."""
    first = floor(place_mm[place_mm.argmin()] / period_mm)
    if place_mm[place_mm.argmax()] < (first + 1) * period_mm:  # a block seldom crosses a seam
        return place_mm - np.array(first * period_mm) if first else place_mm
    return place_mm - period_mm * np.floor(place_mm / period_mm)
