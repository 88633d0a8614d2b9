"""The protocol: which strokes to make, as a file that a person can read and edit."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
import tomlkit
from pydantic import BaseModel, ConfigDict, Field, PositiveFloat, ValidationError, model_validator

from haptix.errors import FileFormatError, InputError
from haptix.units import with_numbers

FORCES_N = (0.1, 0.3, 0.5, 0.7, 0.9)
VOLTAGES_V = (0.0, 50.0, 100.0, 150.0, 200.0)
FREQUENCY_HZ = 125.0
"""The paper's strokes: every force with every voltage, at one frequency."""

SWEEP_HZ = (30.0, 60.0, 300.0, 1000.0, 4000.0)
"""Frequencies that tell the screen's insulator from the skin's: each at every force."""

_SPREAD_SEED = 20180  # order of the strokes: any fixed one, so that a plan is the same twice


class Stroke(BaseModel):
    """One stroke of the finger.

    Parameters
    ----------
    number : int
        From 1; names the file.
    normal_force_n, voltage_v, frequency_hz : float
        Force [N] to hold, amplitude [V] and frequency [Hz] of the sine that is played.
    speed_mm_per_s, length_mm : float
        How to slide.
    there_and_back : bool
        Whether the finger slides back under the same drive: what the sensor's axes tell each other
        cancels.
    held_out : bool
        Kept out of the fit, for verification.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    number: Annotated[int, Field(ge=1)]
    normal_force_n: PositiveFloat
    voltage_v: Annotated[float, Field(ge=0)]
    frequency_hz: PositiveFloat
    speed_mm_per_s: PositiveFloat = 50.0
    length_mm: PositiveFloat = 40.0
    there_and_back: bool = True
    held_out: bool = False

    @property
    def label(self) -> str:
        """One line for the person at the screen."""
        return (
            f"stroke {self.number}: {self.normal_force_n:g} N, {self.length_mm:g} mm"
            f"{' and back' * self.there_and_back} at {self.speed_mm_per_s:g} mm/s, "
            f"{self.voltage_v:g} V at {self.frequency_hz:g} Hz"
        )

    @property
    def sliding_s(self) -> float:
        """Time that the finger slides [s]."""
        return (1 + self.there_and_back) * self.length_mm / self.speed_mm_per_s


class Protocol(BaseModel):
    """Strokes in the order in which they are made.

    Parameters
    ----------
    name : str
        Such as "paper", "full" or "short".
    idle_s : float
        Untouched time [s] at the start and the end of each recording: the sensor's zero.
    tolerance : float
        A stroke whose force or speed is off by more than this share is repeated.
    seconds_per_stroke : float
        What one takes with its prompt, for the estimate of the time [s].
    strokes : tuple of Stroke
        Numbers are unique.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    schema_version: Literal[1] = 1
    name: str = "custom"
    idle_s: PositiveFloat = 0.3
    tolerance: Annotated[float, Field(gt=0, lt=1)] = 0.15
    seconds_per_stroke: PositiveFloat = 9.0
    strokes: tuple[Stroke, ...]

    @model_validator(mode="after")
    def _has_strokes(self) -> Self:
        numbers = [stroke.number for stroke in self.strokes]
        if not numbers:
            raise ValueError("expected at least one stroke")
        if len(set(numbers)) < len(numbers):
            raise ValueError("expected every stroke to have a number of its own")
        return self

    @property
    def duration_s(self) -> float:
        """Estimated time at the screen [s]."""
        return len(self.strokes) * self.seconds_per_stroke

    def save(self, path: str | Path) -> None:
        """Write TOML, or JSON where the name ends so.

        Raises
        ------
        FileFormatError
            If the file cannot be written.
        """
        path = Path(path)
        fields = self.model_dump(mode="json")
        text = (
            json.dumps(fields, indent=2) + "\n" if path.suffix == ".json" else tomlkit.dumps(fields)
        )
        try:
            path.write_text(text, encoding="utf-8")
        except OSError as error:
            raise FileFormatError(f"cannot write {path}: {error.strerror}") from None

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read what `save` wrote; numbers may be strings with units, such as "150 V".

        Raises
        ------
        FileFormatError
            If the file is missing or is no TOML or JSON.
        InputError
            If a field is unknown or outside its range.
        """
        path = Path(path)
        try:
            text = path.read_text(encoding="utf-8")
            fields = json.loads(text) if path.suffix == ".json" else tomllib.loads(text)
        except OSError as error:
            raise FileFormatError(f"cannot read {path}: {error.strerror}") from None
        except ValueError as error:
            raise FileFormatError(f"{path}: expected TOML or JSON, got: {error}") from None
        if not isinstance(fields, dict):
            raise FileFormatError(f"{path}: expected a table, got {type(fields).__name__}")
        strokes = fields.get("strokes")
        if isinstance(strokes, list):
            fields["strokes"] = [
                with_numbers(f"strokes.{index}", one) if isinstance(one, dict) else one
                for index, one in enumerate(strokes)
            ]
        try:
            return cls.model_validate(fields)
        except ValidationError as error:
            raise InputError(f"{path}: {first_complaint(error)}") from None


def first_complaint(error: ValidationError) -> str:
    """One sentence about what a table has wrong."""
    first = error.errors()[0]
    place = ".".join(map(str, first["loc"]))
    message = first["msg"].removeprefix("Value error, ")
    got = "" if first["type"] == "missing" or not place else f", got {first['input']!r}"
    return f"{place + ': ' if place else ''}{message[0].lower()}{message[1:]}{got}"


def paper_protocol(max_voltage_v: float = 200.0) -> Protocol:
    """Return the paper's 25 strokes, one way each, and 3 more that are held out."""
    grid = [(force, volts, FREQUENCY_HZ) for force in FORCES_N for volts in VOLTAGES_V]
    held_out = [(0.4, 175.0, FREQUENCY_HZ), (0.2, 125.0, FREQUENCY_HZ), (0.8, 150.0, FREQUENCY_HZ)]
    return _protocol("paper", grid, held_out, max_voltage_v, there_and_back=False)


def full_protocol(max_voltage_v: float = 200.0) -> Protocol:
    """Return the paper's strokes and a frequency sweep at the highest voltage, there and back."""
    grid = [(force, volts, FREQUENCY_HZ) for force in FORCES_N for volts in VOLTAGES_V]
    grid += [(force, VOLTAGES_V[-1], hertz) for force in FORCES_N for hertz in SWEEP_HZ]
    held_out = [
        (0.4, 175.0, FREQUENCY_HZ),
        (0.2, 125.0, FREQUENCY_HZ),
        (0.8, 150.0, FREQUENCY_HZ),
        (0.6, 175.0, 60.0),
        (0.4, 175.0, 500.0),
    ]
    return _protocol("full", grid, held_out, max_voltage_v)


def _protocol(
    name: str,
    grid: list[tuple[float, float, float]],
    held_out: list[tuple[float, float, float]],
    max_voltage_v: float,
    there_and_back: bool = True,
) -> Protocol:
    if not max_voltage_v > 0:
        raise InputError(f"max_voltage_v: expected a voltage above 0 V, got {max_voltage_v:g} V")
    # A screen that bears less has the same protocol, drawn together.
    share = min(max_voltage_v / VOLTAGES_V[-1], 1.0)
    rows = [(*row, False) for row in grid] + [(*row, True) for row in held_out]
    return Protocol(
        name=name,
        strokes=numbered(
            [
                {
                    "normal_force_n": force,
                    "voltage_v": round(share * volts, 3),
                    "frequency_hz": hertz,
                    "there_and_back": there_and_back,
                    "held_out": is_held_out,
                }
                for force, volts, hertz, is_held_out in rows
            ]
        ),
    )


def numbered(strokes: list[dict[str, Any]]) -> tuple[Stroke, ...]:
    """Shuffle strokes, so that a finger that dries does not look like a force, and number them."""
    order = np.random.default_rng(_SPREAD_SEED).permutation(len(strokes))
    return tuple(
        Stroke(number=place + 1, **strokes[index]) for place, index in enumerate(order.tolist())
    )


def strokes_within(minutes: float, seconds_per_stroke: float, held_out: int) -> int:
    """How many strokes fit into a time: enough to fit, and those held out."""
    count = int(60 * minutes / seconds_per_stroke + 1e-9)
    least = 6 + held_out
    if count < least:
        raise InputError(
            f"minutes: expected time for {least} strokes of {seconds_per_stroke:g} s or more "
            f"({least * seconds_per_stroke / 60:.2g} minutes), got {minutes:g} minutes"
        )
    return count
