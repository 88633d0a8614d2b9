"""What is presented in a trial, and how the finger touched it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from haptix.errors import LimitError
from haptix.surface.request import digest

Array = npt.NDArray[np.float64]

_STEP_V = 0.01  # far below what is felt, far above the rounding of a sum


@dataclass(frozen=True)
class Touch:
    """Mean force and speed of the finger in a trial."""

    normal_force_n: float
    speed_mm_per_s: float


@dataclass(frozen=True)
class Presentation:
    """Drive signals of a trial, for a level.

    Parameters
    ----------
    target : callable
        Drive [V], shape (samples,), for a level.
    reference : ndarray
        Drive [V] of the other alternative.
    peak_v : callable
        Highest voltage of the target at a level; must rise with it.
    identity : mapping of str to str
        What the drive rests on, such as ``{"stimulus": ..., "finger": ...}``, each as a hash. A log
        is continued only by a presentation of the same identity.
    profile : str
        Finger and screen, for the log.
    """

    target: Callable[[float], Array]
    reference: Array
    peak_v: Callable[[float], float]
    identity: Mapping[str, str] = field(default_factory=dict)
    profile: str = ""

    def allowed(self, level: float, ceiling_v: float) -> float:
        """Return the level, lowered to the highest whose voltage is within a ceiling [V]."""
        if self.peak_v(level) <= ceiling_v:
            return level
        low, high, span = level, level, 1.0
        while self.peak_v(low) > ceiling_v:
            low, span = low - span, 2 * span
            if span > 1e6:
                raise LimitError("no level keeps the target within the ceiling")
        while (middle := 0.5 * (low + high)) not in (low, high):
            low, high = (middle, high) if self.peak_v(middle) <= ceiling_v else (low, middle)
        return low

    def hashes(self, level: float) -> dict[str, str]:
        """Return `identity`, and where it names no finger the drive itself, at a level."""
        if "finger" in self.identity:
            return dict(self.identity)
        # Adding 0.0 makes a negative zero a zero.
        drives = (np.round(one / _STEP_V) + 0.0 for one in (self.target(level), self.reference))
        return {**self.identity, "drive": digest({"drive": [one.tolist() for one in drives]})}
