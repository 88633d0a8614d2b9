"""Where fingers are while a block plays, and how much of the drive each gets."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

_NONE = np.empty(0)


@dataclass(frozen=True)
class Motion:
    """Fingers at the control points of a block; arrays of shape (fingers * points,).

    Parameters
    ----------
    fingers, points : int
        How many fingers touch, and at how many control points.
    x_mm, y_mm : ndarray
        Places [mm].
    normal_force_n : ndarray
        Normal forces [N].
    gain : ndarray
        Share of its amplitude that each finger gets, 0 to 1: it fades in and out.
    footprint_mm : float
        Longest distance that a finger slides from one control point to the next [mm].
    finger_force_n : list of float, optional
        One force for each finger [N], where it hardly changes during the block.
    """

    fingers: int
    points: int
    x_mm: Array
    y_mm: Array
    normal_force_n: Array
    gain: Array
    footprint_mm: float
    finger_force_n: list[float] | None = None

    @classmethod
    def none(cls, points: int) -> Motion:
        """No finger touches."""
        return cls(0, points, _NONE, _NONE, _NONE, _NONE, 0.0)
