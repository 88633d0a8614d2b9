"""A texture as a map of friction over the screen."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from pathlib import Path
from typing import Literal, get_args

import numpy as np
import numpy.typing as npt

from haptix.errors import InputError, check_positive
from haptix.texture.photograph import read_grey

Polarity = Literal["bright-high", "dark-high"]
Array = npt.NDArray[np.float64]

# Percentiles of grey that become level 0 and 1, so that single pixels do not decide.
_CLIPPED = (1.0, 99.0)


@dataclass(frozen=True)
class Texture:
    """Friction over a rectangle with its corner at (0, 0), x to the right and y downwards.

    Parameters
    ----------
    level : ndarray, shape (rows, columns)
        0 to 1: from the lowest to the highest friction.
    width_mm : float
        Width on the screen; the height follows from the pixels, which are square.
    mu_range : (float, float), optional
        Absolute friction coefficients of levels 0 and 1. Without it a level is a share of the
        friction range that is reachable at the finger's force.
    """

    level: Array
    width_mm: float
    mu_range: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        check_positive("width_mm", self.width_mm)
        level = self.level
        if level.ndim != 2 or 0 in level.shape or not ((level >= 0) & (level <= 1)).all():
            raise InputError(
                f"level: expected a map of values from 0 to 1, got shape {level.shape}"
            )
        if self.mu_range is not None:
            low, high = self.mu_range
            if not 0 <= low < high < inf:
                raise InputError(
                    f"mu_range: expected finite 0 <= low < high, got {low:g}, {high:g}"
                )

    @classmethod
    def from_image(
        cls,
        image: str | Path | npt.ArrayLike,
        width_mm: float,
        polarity: Polarity = "bright-high",
        mu_range: tuple[float, float] | None = None,
    ) -> Texture:
        """Take a photograph: grey between its 1st and 99th percentile becomes level 0 to 1.

        Parameters
        ----------
        image : path or array_like
            A file, or grey (rows, columns) or colour (rows, columns, 3 or 4) pixels.
        width_mm : float
            Width on the screen.
        polarity : {"bright-high", "dark-high"}
            Which end of the grey scale has the higher friction.
        mu_range : (float, float), optional
            Absolute friction coefficients instead of shares of the reachable range.

        Raises
        ------
        InputError
            If the file is missing or no image, or a value is outside its range.
        """
        if polarity not in get_args(Polarity):
            raise InputError(f'polarity: expected "bright-high" or "dark-high", got {polarity!r}')
        grey = read_grey(image)
        dark, bright = np.percentile(grey, _CLIPPED)
        if bright <= dark:
            raise InputError("image: expected some contrast, got pixels of one grey")
        level = np.clip((grey - dark) / (bright - dark), 0.0, 1.0)
        return cls(1 - level if polarity == "dark-high" else level, width_mm, mu_range)

    @property
    def pixel_mm(self) -> float:
        """Side of a pixel."""
        return self.width_mm / int(self.level.shape[1])

    @property
    def height_mm(self) -> float:
        """Height on the screen."""
        return self.pixel_mm * int(self.level.shape[0])

    def friction(self, x_mm: npt.ArrayLike, y_mm: npt.ArrayLike) -> Array:
        """Wanted friction at places of any common shape, bilinear between pixel centres.

        Returns
        -------
        ndarray
            Shares of the reachable range, or friction coefficients where the texture has a
            `mu_range`. Beyond the edges it is level 0, the lowest friction.
        """
        x, y = np.broadcast_arrays(np.asarray(x_mm, dtype=float), np.asarray(y_mm, dtype=float))
        rows, columns = self.level.shape
        inside = (x >= 0) & (x <= self.width_mm) & (y >= 0) & (y <= self.height_mm)
        column, row = x / self.pixel_mm - 0.5, y / self.pixel_mm - 0.5
        column = np.where(inside, column, 0).clip(0, columns - 1)
        row = np.where(inside, row, 0).clip(0, rows - 1)
        left, above = column.astype(np.intp), row.astype(np.intp)
        right, below = np.minimum(left + 1, columns - 1), np.minimum(above + 1, rows - 1)
        across, down = column - left, row - above
        upper = self.level[above, left] * (1 - across) + self.level[above, right] * across
        lower = self.level[below, left] * (1 - across) + self.level[below, right] * across
        level = np.where(inside, upper * (1 - down) + lower * down, 0.0)
        if self.mu_range is None:
            return level
        low, high = self.mu_range
        return low + level * (high - low)
