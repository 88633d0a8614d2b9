"""Signals in space, turned into time by the finger's speed."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf

import numpy as np

from haptix.errors import InputError
from haptix.stimuli.signal import Array, Signal, number, positive, read_row
from haptix.stimuli.speed import SpeedProfile, speed_from
from haptix.stimuli.waves import demand_corners


@dataclass(frozen=True)
class Grating(Signal):
    """A grating of a period on the screen, as a finger of this speed meets it.

    Parameters
    ----------
    amplitude, offset : float
        ``offset + amplitude * sin`` or square.
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

    kind = "grating"
    amplitude: float
    period_mm: float
    speed: SpeedProfile | float | None = None
    shape: str = "sine"
    phase_rad: float = 0.0
    offset: float = 0.0
    length_s: float = inf

    def __post_init__(self) -> None:
        for name in ("amplitude", "phase_rad", "offset"):
            number(name, getattr(self, name))
        positive("period_mm", self.period_mm)
        positive("length_s", self.length_s, open_end=True)
        if self.shape not in ("sine", "square"):
            raise InputError(f'shape: expected "sine" or "square", got {self.shape!r}')
        object.__setattr__(self, "speed", demand_speed("a grating", self.speed))

    @property
    def length(self) -> float:
        """Length [s]."""
        return self.length_s

    def inside(self, first: int, count: int, sample_rate_hz: float) -> Array:
        """Values."""
        turns = position_mm(self, first, count, sample_rate_hz) / self.period_mm
        wave = np.sin(2 * np.pi * (turns % 1.0) + self.phase_rad)
        if self.shape == "square":
            wave = np.where(wave >= 0, 1.0, -1.0)
        return np.asarray(self.offset + self.amplitude * wave)


@dataclass(frozen=True)
class Relief(Signal):
    """Straight lines between corners on the screen, as a finger of this speed meets them."""

    kind = "relief"
    x_mm: tuple[float, ...]
    values_at: tuple[float, ...]
    speed: SpeedProfile | float | None = None
    length_s: float = inf

    def __post_init__(self) -> None:
        read_row(self, "x_mm", "values_at")
        demand_corners("x_mm", self.x_mm, self.values_at)
        positive("length_s", self.length_s, open_end=True)
        object.__setattr__(self, "speed", demand_speed("a relief", self.speed))

    @property
    def length(self) -> float:
        """Length [s]."""
        return self.length_s

    def inside(self, first: int, count: int, sample_rate_hz: float) -> Array:
        """Values."""
        x = position_mm(self, first, count, sample_rate_hz)
        return np.asarray(np.interp(x, self.x_mm, self.values_at))


def demand_speed(what: str, speed: SpeedProfile | float | None) -> SpeedProfile:
    """Return the profile, or say that space needs one to become time."""
    if speed is None:
        raise InputError(
            f"speed: {what} lies in space and needs the finger's speed to become a signal; give "
            "mm/s or a speed profile"
        )
    return speed_from(speed)


def position_mm(signal: Grating | Relief, first: int, count: int, sample_rate_hz: float) -> Array:
    """Places of the finger at the samples [mm]."""
    assert isinstance(signal.speed, SpeedProfile)  # made so in __post_init__
    return signal.speed.position_mm(np.arange(first, first + count) / sample_rate_hz)
