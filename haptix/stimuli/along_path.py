"""Friction along the finger's path: a texture that the finger's speed turns into a signal."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from inspect import signature
from math import inf, pi
from typing import Any

import numpy as np

from haptix.checks import Length, Positive, choice, increasing, number, positive, row
from haptix.errors import InputError
from haptix.files import read_csv
from haptix.signals.described import KINDS, Described, read, set_corners
from haptix.signals.signal import Array, Signal
from haptix.texture import FrictionField, Grating, RecordedProfile, TargetKind
from haptix.waves import Shape


def _grating_texture(
    period_mm: float,
    wave: Shape = "sine",
    orientation_deg: float = 0.0,
    duty: float = 0.5,
    target: TargetKind = "share",
    low: float = 0.0,
    high: float = 1.0,
    phase: float = 0.0,
) -> Grating:
    """Return a grating whose numbers may be plain, in a stimulus's quantity; no material's are."""
    rest = {"wave": wave, "orientation_deg": orientation_deg, "duty": duty, "phase": phase}
    if target != "plain":
        return Grating(period_mm=period_mm, target=target, low=low, high=high, **rest)
    plain_range = {"low": number("low", low), "high": number("high", high)}
    return Grating(period_mm=period_mm, **rest).model_copy(update={"target": target, **plain_range})


_TEXTURES: dict[str, tuple[type[FrictionField], Callable[..., FrictionField]]] = {
    "grating-texture": (Grating, _grating_texture),
    "profile-texture": (RecordedProfile, RecordedProfile),
}
"""Textures that recipes hold: their classes, and what makes one of its fields."""

KINDS.update({kind: make for kind, (_, make) in _TEXTURES.items()})


class SpeedProfile(Described):
    """Base of the speed profiles."""

    @abstractmethod
    def position_mm(self, t_s: Array) -> Array:
        """Place along the finger's line [mm] at times [s]."""


@dataclass(frozen=True)
class SteadySpeed(SpeedProfile):
    """A constant speed."""

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


def _path_of_file(file: str, start_s: float = 0.0) -> Path:
    """Read a finger's own path: a CSV file with columns t_s and x_mm, from a time on."""
    rows = [
        (one.number("t_s") - start_s, one.number("x_mm")) for one in read_csv(file, ("t_s", "x_mm"))
    ]
    kept = [(t_s, x_mm) for t_s, x_mm in rows if t_s >= 0]
    if len(kept) < 2:
        raise InputError(f"{file}: expected two places or more from {start_s:g} s on")
    t_s, x_mm = zip(*kept, strict=True)
    return Path(t_s, x_mm)


KINDS["recorded-path"] = _path_of_file


def speed_from(table: Any, place: str = "speed") -> SpeedProfile:
    """Read a profile from a table as `SpeedProfile.describe` writes it; a number is a speed.

    Raises
    ------
    InputError
        If the table is not a speed profile.
    """
    if isinstance(table, SpeedProfile):
        return table
    if isinstance(table, int | float) and not isinstance(table, bool):
        return SteadySpeed(positive(place, table))
    found: object = read(table, place)
    if not isinstance(found, SpeedProfile):
        raise InputError(f"{place}: expected how the finger moves, got a {table['kind']}")
    return found


@dataclass(frozen=True)
class AlongPath(Signal):
    """Values of a texture where the finger is: on the line y = 0, with all detail.

    The numbers of the texture are in the stimulus's quantity, whatever its target says. A number as
    `speed` is a steady one [mm/s].
    """

    kind = "along-path"
    field: FrictionField
    speed: SpeedProfile | float | None = None
    length_s: Length = inf

    def __post_init__(self) -> None:
        super().__post_init__()
        if not isinstance(self.field, FrictionField):
            raise InputError(f"field: expected a texture, got {self.field!r:.80}")
        if self.speed is None:
            raise InputError(
                "speed: a texture lies in space and needs the finger's speed to become a signal; "
                "give mm/s or a speed profile"
            )
        object.__setattr__(self, "speed", speed_from(self.speed))

    def _inside(self, first: int, count: int, sample_rate_hz: float) -> Array:
        assert isinstance(self.speed, SpeedProfile)  # made so in __post_init__
        x = self.speed.position_mm(np.arange(first, first + count) / sample_rate_hz)
        return self.field.friction(x, np.zeros(count))

    def describe(self) -> dict[str, Any]:
        """Everything that determines the values, as plain values.

        Raises
        ------
        InputError
            If a recipe cannot describe the texture.
        """
        kind = next((kind for kind, (of, _) in _TEXTURES.items() if of is type(self.field)), None)
        if kind is None:
            raise InputError(
                f"field: a {type(self.field).__name__} cannot be written to a sidecar; expected a "
                "Grating or a RecordedProfile"
            )
        names = signature(_TEXTURES[kind][1]).parameters
        texture = {name: getattr(self.field, name) for name in names}
        listed = {name: list(v) if isinstance(v, tuple) else v for name, v in texture.items()}
        return {**super().describe(), "field": {"kind": kind, **listed}}


def grating(
    amplitude: float,
    period_mm: float,
    speed: SpeedProfile | float | None = None,
    shape: str = "sine",
    phase_rad: float = 0.0,
    offset: float = 0.0,
    length_s: float = inf,
) -> AlongPath:
    """Return a grating ``offset + amplitude * sin`` or square as a finger of this speed meets it.

    Amplitude and offset are in the stimulus's quantity, the phase is that at the finger's start. A
    number as `speed` is a steady one [mm/s].
    """
    for name, value in (("amplitude", amplitude), ("phase_rad", phase_rad), ("offset", offset)):
        number(name, value)
    waves = _grating_texture(
        period_mm=period_mm,
        wave="square" if choice("shape", shape, ("sine", "square")) == "square" else "sine",
        target="plain",
        low=offset - amplitude,
        high=offset + amplitude,
        phase=phase_rad / (2 * pi),
    )
    return AlongPath(waves, speed, length_s)


def relief(
    x_mm: tuple[float, ...],
    values_at: tuple[float, ...],
    speed: SpeedProfile | float | None = None,
    length_s: float = inf,
) -> AlongPath:
    """Return straight lines between corners on the screen, as a finger of this speed meets them."""
    places, values = increasing("x_mm", x_mm, 2), row("values_at", values_at, 2)
    # The grid's step matters to footprints only, and a stimulus has none.
    step_mm = float(np.ptp(places)) / 1000
    profile = RecordedProfile(
        tuple(places.tolist()), tuple(values.tolist()), "plain", beyond="hold", step_mm=step_mm
    )
    return AlongPath(profile, speed, length_s)


KINDS["grating"] = grating
KINDS["relief"] = relief
