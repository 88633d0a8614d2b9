"""What a virtual finger felt: friction against time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Felt:
    """What the finger felt; arrays of shape (samples,), evenly spaced in time."""

    t_s: Array
    """Time [s], on the clock of the path."""
    x_mm: Array
    y_mm: Array
    """True place of the finger [mm]."""
    speed_mm_per_s: Array
    """Sliding speed [mm/s]."""
    normal_force_n: Array
    """Normal force [N]."""
    mu: Array
    """Friction coefficient; NaN where the finger stands or is lifted, since nothing slides."""
    friction_force_n: Array
    """Friction force against the motion [N]; 0 where nothing slides: no force is known to push a
    standing finger, and friction is what it needs to be."""
    status: npt.NDArray[np.int64]
    """`haptix.Status`: `PULL_IN` where the contact snaps in (values at the branch's end),
    `BREAKDOWN` where that term is on and the field too high, else `OK`."""

    @property
    def is_sliding(self) -> npt.NDArray[np.bool_]:
        """Where there is friction to be felt."""
        return np.isfinite(self.mu)
