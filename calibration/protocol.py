"""The protocol: which strokes to make, as a file that a person can read and edit."""

from __future__ import annotations

from typing import Annotated, Any, Self

import numpy as np
from pydantic import Field, PositiveFloat, model_validator

from haptix.documents import Document, Part
from haptix.errors import InputError

FORCES_N = (0.1, 0.3, 0.5, 0.7, 0.9)
VOLTAGES_V = (0.0, 50.0, 100.0, 150.0, 200.0)
FREQUENCY_HZ = 125.0
"""The paper's strokes: every force with every voltage, at one frequency."""

SWEEP_HZ = (30.0, 60.0, 300.0, 1000.0, 4000.0)
"""Frequencies that tell the screen's insulator from the skin's: each at every force."""

_SPREAD_SEED = 20180  # order of the strokes: any fixed one, so that a plan is the same twice


class Stroke(Part):
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


class Protocol(Document):
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
