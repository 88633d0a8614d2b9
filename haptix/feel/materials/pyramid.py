"""A sampled map at falling resolutions, read at the resolution of the finger's footprint.

Level 0 is the map itself, bilinear between its pixels of side p. Level 1 is the map smoothed by the
binomial kernel of 9 taps. Its response ``cos^8(pi k p)`` at wavenumber k is 6 % at a quarter of the
pixels' rate 1/p and zero at half of it. Each further level takes every second pixel of the level
before and smooths again. So a level has only waves of 4 of its pixels or longer, twice as long as
it could hold, and bilinear interpolation adds few waves that the map does not have.

A footprint f carries waves longer than 2 f. Level 0 serves footprints up to p/2, level 1 those from
p to 2 p, and each further level twice the footprint of the one before. In between, two levels are
blended linearly in the footprint's logarithm, so that nothing jumps when the speed changes.
"""

from __future__ import annotations

from math import log2
from typing import Literal

import numpy as np

from haptix.base.checks import Array
from haptix.base.native import NULL, Struct, doubles, library, room
from haptix.feel.materials.memory import take_room
from haptix.feel.motion import FARTHEST_MM

Beyond = Literal["outside", "hold", "repeat"]
"""Beyond the edges of a map: the outside value, the edge's value, or the map again."""

_KERNEL = np.array([1, 8, 28, 56, 70, 56, 28, 8, 1]) / 256
_REACH = len(_KERNEL) // 2
_MARGIN, _WRAPPED = 2, 1  # pixels around a level: beyond its edges, or where it repeats
_FLOAT = np.float64
_sample = library.hx_map_sample
_Origin = tuple[int, int]
"""Row and column of the map at an array's first pixel, in pixels of its level."""


def pyramid_pixels(rows: int, columns: int, beyond_x: Beyond, beyond_y: Beyond) -> int:
    """Return the pixels of all levels of a map, without making them.

    Parameters
    ----------
    rows, columns : int
        Size of the map.
    beyond_x, beyond_y : {"outside", "hold", "repeat"}
        See `Pyramid`.

    Examples
    --------
    >>> pyramid_pixels(64, 64, "repeat", "repeat")  # 66 x 66, twice, and the coarser ones
    10353
    """
    repeated = [n for n, beyond in ((rows, beyond_y), (columns, beyond_x)) if beyond == "repeat"]
    widest = min(repeated) if repeated else 2 * max(rows, columns)
    counts = 1
    while counts == 1 or 2 ** (counts - 2) < widest:
        counts += 1
    heights, widths = _sides(rows, beyond_y, counts), _sides(columns, beyond_x, counts)
    return sum(height * width for height, width in zip(heights, widths, strict=True))


def _sides(size: int, beyond: Beyond, levels: int) -> list[int]:
    """Pixels along one side of each level, with those around the map."""
    if beyond == "repeat":
        return [size + 2, *(size // 2**level + 2 for level in range(levels - 1))]
    sides, origin = [size + 4], 0
    for level in range(1, levels):
        if level > 1:
            size, origin = size + 2, origin - 1
            size, origin = (size + 1 - origin % 2) // 2, (origin + origin % 2) // 2
        size, origin = size + 2 * _REACH, origin - _REACH
        sides.append(size + 4)
    return sides


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
        values = np.asarray(values, np.complex128 if np.iscomplexobj(values) else _FLOAT)
        rows, columns = values.shape
        take_room(self, values.itemsize * pyramid_pixels(rows, columns, beyond_x, beyond_y))
        self.pixel_mm = pixel_mm
        """Side of a pixel."""
        self.outside = outside
        """Value beyond the edges."""
        self.modes: tuple[Beyond, Beyond] = (beyond_y, beyond_x)
        levels = [self._level(values, (0, 0), 1)]
        # The last level has pixels as wide as the shorter period, or twice as wide as the map. A
        # finger that moves farther from one sample to the next does not meet the map's details.
        repeated = [n for n, mode in zip(values.shape, self.modes, strict=True) if mode == "repeat"]
        widest = min(repeated) if repeated else 2 * max(rows, columns)
        smooth, origin, step = values, (0, 0), 1
        while len(levels) == 1 or step < widest:
            if len(levels) > 1:
                smooth, origin = self._halved(smooth, origin)
                step *= 2
            smooth, origin = self._smoothed(smooth, origin)
            levels.append(self._level(smooth, origin, step))
        self._channels = 2 if np.iscomplexobj(values) else 1
        self._map = Struct(
            "hx_map",
            levels=levels,
            count=len(levels),
            channels=self._channels,
            period_x_mm=columns * pixel_mm if beyond_x == "repeat" else 0.0,
            period_y_mm=rows * pixel_mm if beyond_y == "repeat" else 0.0,
            farthest_mm=FARTHEST_MM,
            outside=outside,
        )
        self._finest: Array = levels[0].fields["values"]
        self._columns = int(levels[0].fields["columns"])

    @property
    def values(self) -> Array:
        """The map itself, shape (rows, columns)."""
        top, left = (_WRAPPED if mode == "repeat" else _MARGIN for mode in self.modes)
        finest = self._finest.reshape(-1, self._columns, self._channels)[top:-top, left:-left]
        values = finest if self._channels == 1 else finest.copy().view(np.complex128)
        return np.asarray(values[..., 0])

    def _padded(self, values: Array, origin: _Origin, by: int) -> tuple[Array, _Origin]:
        """The map with `by` more pixels on every side, except where the map repeats."""
        for mode in dict.fromkeys(self.modes):  # most maps have one, and are copied once
            if mode == "repeat":
                continue
            more = [by * (its_mode == mode) for its_mode in self.modes]
            width = [(pixels, pixels) for pixels in more]
            if mode == "hold":
                values = np.pad(values, width, mode="edge")
            else:
                values = np.pad(values, width, constant_values=self.outside)
            origin = (origin[0] - more[0], origin[1] - more[1])
        return values, origin

    def _smoothed(self, values: Array, origin: _Origin) -> tuple[Array, _Origin]:
        from scipy.ndimage import correlate1d  # here, since it takes a tenth of a second to import

        values, origin = self._padded(values, origin, _REACH)
        for axis, mode in enumerate(self.modes):
            # Beyond the padding the values are constant, and smoothing does not change them.
            ends = {"outside": "constant", "hold": "nearest", "repeat": "wrap"}[mode]
            target = None if axis == 0 else values  # which is then ours
            values = correlate1d(values, _KERNEL, axis, target, ends, self.outside)
        return values, origin

    def _halved(self, values: Array, origin: _Origin) -> tuple[Array, _Origin]:
        """Every second pixel: those at even places, so that levels stay aligned."""
        values, origin = self._padded(values, origin, 1)
        row, column = origin[0] % 2, origin[1] % 2
        return values[row::2, column::2], ((origin[0] + row) // 2, (origin[1] + column) // 2)

    def _level(self, values: Array, origin: _Origin, step: int) -> Struct:
        # Places beyond the level are moved to between its two outermost pixels, which the map does
        # not reach.
        values, origin = self._padded(values, origin, _MARGIN)
        around = [_WRAPPED * (mode == "repeat") for mode in self.modes]
        if any(around):
            values = np.pad(values, [(pixels, pixels) for pixels in around], mode="wrap")
        # The centre of the map's first pixel is half a pixel from its corner.
        row, column = (
            -0.5 / step - start + more for start, more in zip(origin, around, strict=True)
        )
        pixel_mm, (rows, columns) = self.pixel_mm * step, values.shape
        # The limits lie slightly inside, so that rounding cannot reach a pixel that does not exist.
        slack = 1e-9 * max(rows, columns)
        return Struct(
            "hx_level",
            values=np.ascontiguousarray(values).view(_FLOAT),
            columns=columns,
            per_mm=1 / pixel_mm,
            column=column,
            row=row,
            low_x=(slack - column) * pixel_mm,
            high_x=(columns - 1 - slack - column) * pixel_mm,
            low_y=(slack - row) * pixel_mm,
            high_y=(rows - 1 - slack - row) * pixel_mm,
        )

    def sample(self, x_mm: Array, y_mm: Array, footprint_mm: float | Array) -> Array:
        """Values at places, shape (places,), with one footprint [mm] for all or one for each.

        Places that are NaN or farther than `FARTHEST_MM` have the value `outside`.
        """
        wide = footprint_mm / self.pixel_mm
        depth, depths = 0.0, NULL
        if isinstance(wide, np.ndarray):
            with np.errstate(divide="ignore"):
                log_width = np.log2(wide)
            depths = doubles(np.maximum(np.minimum(log_width + 1, 1.0), log_width))
        elif wide > 0.5:
            depth = log2(wide)
            if depth < 1.0:
                depth = depth + 1.0 if depth < 0.0 else 1.0
        count = x_mm.size
        if y_mm.size != count:
            raise ValueError(f"expected as many y_mm as x_mm, {count}, got {y_mm.size}")
        values, at = room(count * self._channels)
        _sample(self._map.at, doubles(x_mm), doubles(y_mm), depth, depths, count, at)
        return values if self._channels == 1 else values.view(np.complex128)
