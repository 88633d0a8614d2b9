"""How the finger moves: place against time."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from haptix.checks import Positive, positive
from haptix.errors import InputError
from haptix.stimuli.described import Described, read, set_corners

Array = npt.NDArray[np.float64]


class SpeedProfile(Described):
    """Base of the speed profiles."""

    @abstractmethod
    def position_mm(self, t_s: Array) -> Array:
        """Place along the finger's line [mm] at times [s]."""


@dataclass(frozen=True)
class SteadySpeed(SpeedProfile):
    """One speed."""

    kind = "steady-speed"
    speed_mm_per_s: Positive

    def position_mm(self, t_s: Array) -> Array:
        """Place [mm]."""
        return t_s * self.speed_mm_per_s


@dataclass(frozen=True)
class Strokes(SpeedProfile):
    """To and fro over `stroke_mm`, each stroke in `stroke_s`, with the speed of a half sine."""

    kind = "strokes"
    stroke_mm: Positive
    stroke_s: Positive

    def position_mm(self, t_s: Array) -> Array:
        """Place [mm]."""
        return np.asarray(self.stroke_mm * (0.5 - 0.5 * np.cos(np.pi * t_s / self.stroke_s)))


@dataclass(frozen=True)
class Path(SpeedProfile):
    """Straight lines between recorded places; the finger stays at the last."""

    kind = "path"
    t_s: tuple[float, ...]
    x_mm: tuple[float, ...]

    def __post_init__(self) -> None:
        set_corners(self, "t_s", "x_mm")

    def position_mm(self, t_s: Array) -> Array:
        """Place [mm]."""
        return np.asarray(np.interp(t_s, self.t_s, self.x_mm))


def speed_from(table: Any, place: str = "speed") -> SpeedProfile:
    """Read a profile from a table as `SpeedProfile.describe` writes it; a number is a speed.

    Raises
    ------
    InputError
        If it is none.
    """
    if isinstance(table, SpeedProfile):
        return table
    if isinstance(table, int | float) and not isinstance(table, bool):
        return SteadySpeed(positive(place, table))
    found = read(table, place)
    if not isinstance(found, SpeedProfile):
        raise InputError(f"{place}: expected how the finger moves, got a {found.kind}")
    return found
