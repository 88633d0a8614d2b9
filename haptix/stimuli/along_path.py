"""Friction along the finger's path: a texture that the finger's speed turns into a signal."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from math import inf, pi
from typing import Any

import numpy as np

from haptix.checks import Length, choice, increasing, number, row
from haptix.errors import InputError
from haptix.stimuli.described import KINDS
from haptix.stimuli.signal import Array, Signal
from haptix.stimuli.speed import SpeedProfile, speed_from
from haptix.texture import FrictionField, Grating, RecordedProfile

_FIELDS: dict[str, Callable[..., Grating | RecordedProfile]] = {
    "grating-texture": Grating,
    "profile-texture": RecordedProfile,
}
"""Textures that a recipe can describe, by kind."""


@dataclass(frozen=True)
class AlongPath(Signal):
    """Values of a texture where the finger is: on the line y = 0, with all detail.

    Parameters
    ----------
    field : FrictionField
        The texture. Its numbers are in the stimulus's quantity, whatever its target says.
    speed : SpeedProfile or float
        How the finger moves; a number is a steady speed [mm/s].
    length_s : float
        Length.
    """

    kind = "along-path"
    field: FrictionField
    speed: SpeedProfile | float | None = None
    length_s: Length = inf

    def __post_init__(self) -> None:
        super().__post_init__()
        if isinstance(self.field, Mapping):
            object.__setattr__(self, "field", _field_from(self.field))
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
        named = [kind for kind, of in _FIELDS.items() if type(self.field) is of]
        if not named:
            raise InputError(
                f"field: a {type(self.field).__name__} cannot be written to a sidecar; expected a "
                "Grating or a RecordedProfile"
            )
        # Both are dataclasses.
        names = [one.name for one in fields(self.field) if one.init]  # type: ignore[arg-type]
        texture = {name: getattr(self.field, name) for name in names}
        listed = {name: list(v) if isinstance(v, tuple) else v for name, v in texture.items()}
        return {**super().describe(), "field": {"kind": named[0], **listed}}


def _field_from(table: Mapping[str, Any]) -> FrictionField:
    given = {name: tuple(v) if isinstance(v, list) else v for name, v in table.items()}
    make = _FIELDS[choice("field.kind", str(given.pop("kind", None)), _FIELDS)]
    try:
        return make(**given)
    except TypeError as error:
        raise InputError(f"field: {str(error).split('() ')[-1]}") from None


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

    Parameters
    ----------
    amplitude, offset : float
        In the stimulus's quantity.
    period_mm : float
        Length of a period.
    speed : SpeedProfile or float
        How the finger moves; a number is a steady speed [mm/s].
    shape : {"sine", "square"}
        Shape of a period.
    phase_rad : float
        At the finger's start.
    length_s : float
        Length.
    """
    for name, value in (("amplitude", amplitude), ("phase_rad", phase_rad), ("offset", offset)):
        number(name, value)
    choice("shape", shape, ("sine", "square"))
    waves = Grating(
        period_mm,
        "square" if shape == "square" else "sine",
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
