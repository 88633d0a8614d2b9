"""Where fingers are while a block plays, and how much of the drive each is to feel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class FingerPoints:
    """Fingers at the control points of a block; arrays of shape (fingers * points,).

    Parameters
    ----------
    count : int
        Fingers.
    x_mm, y_mm : ndarray
        Places.
    normal_force_n : ndarray
        Forces [N].
    gain : ndarray
        0 to 1: how much of its amplitude each finger is given, to fade it in and out.
    footprint_mm : float
        Longest way of a finger from one control point to the next.
    row_force_n : list of float, optional
        One force for each finger, where it hardly changes during the block.
    """

    count: int
    x_mm: Array
    y_mm: Array
    normal_force_n: Array
    gain: Array
    footprint_mm: float
    row_force_n: list[float] | None = None


_NONE = np.empty(0)
NOBODY = FingerPoints(0, _NONE, _NONE, _NONE, _NONE, 0.0)
"""No finger touches."""


@dataclass(frozen=True)
class Sliding:
    """When a finger counts as sliding. Electrovibration is felt only then.

    Parameters
    ----------
    from_mm_per_s, to_mm_per_s : float
        Speeds at which it begins and ceases to slide. Their distance keeps a hesitating finger
        from switching the drive.
    fade_s : float
        Time in which the drive fades in and out.
    is_needed : bool
        Whether a finger that stands still gets no voltage.
    """

    from_mm_per_s: float = 2.0
    to_mm_per_s: float = 1.0
    fade_s: float = 0.005
    is_needed: bool = True

    def is_sliding(self, speed_mm_per_s: float, was_sliding: bool) -> bool:
        """Whether a finger of this speed is to feel the drive."""
        if not self.is_needed:
            return True
        return speed_mm_per_s > (self.to_mm_per_s if was_sliding else self.from_mm_per_s)
