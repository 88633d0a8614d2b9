"""How the finger moves: place against time."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any, ClassVar

import numpy as np

from haptix.errors import InputError
from haptix.stimuli.signal import Array, number, positive, read_row
from haptix.stimuli.waves import demand_corners

SPEEDS: dict[str, type[SpeedProfile]] = {}
"""Every kind of speed profile by the name that recipes use."""


class SpeedProfile(ABC):
    """Base of the speed profiles."""

    kind: ClassVar[str]

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        SPEEDS[cls.kind] = cls

    @abstractmethod
    def position_mm(self, t_s: Array) -> Array:
        """Place along the grating [mm] at times [s]."""

    def describe(self) -> dict[str, Any]:
        """Everything that determines the profile, as plain values."""
        table: dict[str, Any] = {"kind": self.kind}
        for field in fields(self):  # type: ignore[arg-type]  # every profile is a dataclass
            value = getattr(self, field.name)
            table[field.name] = list(value) if isinstance(value, tuple) else value
        return table


@dataclass(frozen=True)
class SteadySpeed(SpeedProfile):
    """One speed."""

    kind = "steady-speed"
    speed_mm_per_s: float

    def __post_init__(self) -> None:
        positive("speed_mm_per_s", self.speed_mm_per_s)

    def position_mm(self, t_s: Array) -> Array:
        """Place [mm]."""
        return t_s * self.speed_mm_per_s


@dataclass(frozen=True)
class Strokes(SpeedProfile):
    """To and fro over `stroke_mm`, each way in `stroke_s`, with the speed of a half sine."""

    kind = "strokes"
    stroke_mm: float
    stroke_s: float

    def __post_init__(self) -> None:
        positive("stroke_mm", self.stroke_mm)
        positive("stroke_s", self.stroke_s)

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
        read_row(self, "t_s", "x_mm")
        demand_corners("t_s", self.t_s, self.x_mm)

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
        number(place, table)
        return SteadySpeed(float(table))
    if not isinstance(table, Mapping) or table.get("kind") not in SPEEDS:
        raise InputError(
            f"{place}: expected a speed in mm/s, or a table whose kind is one of "
            f"{', '.join(SPEEDS)}, got {table!r}"
        )
    given = {
        name: tuple(value) if isinstance(value, list) else value
        for name, value in table.items()
        if name != "kind"
    }
    try:
        return SPEEDS[table["kind"]](**given)
    except InputError as error:
        raise InputError(f"{place}: {error}") from None
    except TypeError as error:
        raise InputError(f"{place}: {str(error).split('__init__() ')[-1]}") from None
