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
from typing import Any, Literal, get_args

import numpy as np

from haptix.base.checks import Array
from haptix.base.native import NULL, Struct, doubles, ffi, library, room
from haptix.feel.materials.memory import take_room
from haptix.feel.motion import FARTHEST_MM

Beyond = Literal["outside", "hold", "repeat"]
"""Beyond the edges of a map: the outside value, the edge's value, or the map again."""

_BEYOND = get_args(Beyond)
_sample = library.hx_map_sample


def pyramid_numbers(rows: int, columns: int, beyond_x: Beyond, beyond_y: Beyond) -> int:
    """Return how many numbers the levels of a map take up, without making them.

    Parameters
    ----------
    rows, columns : int
        Size of the map.
    beyond_x, beyond_y : {"outside", "hold", "repeat"}
        See `Pyramid`.

    Examples
    --------
    >>> pyramid_numbers(64, 64, "repeat", "repeat")  # 66 x 66, twice, the coarser ones, and 80
    10433
    """
    return _size(rows, columns, beyond_x, beyond_y)[0]


def _size(rows: int, columns: int, *beyond: Beyond) -> tuple[int, int]:
    """Return the numbers and the levels of a map."""
    count = ffi.new("int64_t *")
    size = library.hx_pyramid_size(rows, columns, *map(_BEYOND.index, beyond), count)
    return size, count[0]


class Pyramid:
    """A map with its levels, which `haptix/base/native/haptix_pyramid.c` makes.

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
        self._channels = channels = 2 if np.iscomplexobj(values) else 1
        size, count = _size(rows, columns, beyond_x, beyond_y)
        take_room(self, 8 * channels * size)
        self.pixel_mm = pixel_mm
        """Side of a pixel."""
        self.outside = outside
        """Value beyond the edges."""
        self.modes: tuple[Beyond, Beyond] = (beyond_y, beyond_x)
        modes = _BEYOND.index(beyond_x), _BEYOND.index(beyond_y)
        self._numbers, at = room(channels * size)
        first, second = (
            library.hx_pyramid_row(at, columns, channels, *modes, row) - at for row in (0, 1)
        )
        map_of = np.lib.stride_tricks.as_strided(
            self._numbers[first:], (rows, columns * channels), (8 * (second - first), 8)
        )
        self._values: Any = np.asarray(map_of if channels == 1 else map_of.view(np.complex128))
        self._values[:] = values
        levels = ffi.new("hx_level[]", count)
        library.hx_pyramid_make(rows, columns, channels, pixel_mm, outside, *modes, levels, at)
        self._map = Struct(
            "hx_map",
            levels=levels,
            count=count,
            channels=channels,
            period_x_mm=columns * pixel_mm if beyond_x == "repeat" else 0.0,
            period_y_mm=rows * pixel_mm if beyond_y == "repeat" else 0.0,
            farthest_mm=FARTHEST_MM,
            outside=outside,
        )

    def __reduce__(self) -> Any:
        return Pyramid, (self.values, self.pixel_mm, self.outside, *reversed(self.modes))

    @property
    def values(self) -> Array:
        """The map itself, shape (rows, columns)."""
        return np.asarray(self._values)

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
