"""The protocol: which strokes to make, as a file that a person can read and edit."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import chain, product
from typing import Annotated, Self

import numpy as np
from pydantic import Field, PositiveFloat, model_validator

from haptix.checks import positive
from haptix.documents import Document, Part

FORCES_N = (0.1, 0.3, 0.5, 0.7, 0.9)
VOLTAGES_V = (0.0, 50.0, 100.0, 150.0, 200.0)
FREQUENCY_HZ = 125.0
"""The paper's strokes: every force with every voltage, at one frequency."""

SWEEP_HZ = (30.0, 60.0, 300.0, 1000.0, 4000.0)
"""Frequencies that separate the screen's insulator from the skin's: each at every force."""

_HELD_OUT = ((0.4, 175.0, FREQUENCY_HZ), (0.2, 125.0, FREQUENCY_HZ), (0.8, 150.0, FREQUENCY_HZ))
_SHUFFLE_SEED = 20180  # any fixed one, so that a plan is the same twice


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
        Whether the finger slides back under the same drive, which cancels the sensor's cross-talk.
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
    def slides(self) -> int:
        """Number of times that the finger slides the length."""
        return 1 + self.there_and_back

    @property
    def sliding_s(self) -> float:
        """Time that the finger slides [s]."""
        return self.slides * self.length_mm / self.speed_mm_per_s


class Protocol(Document):
    """Strokes in the order in which they are made.

    Parameters
    ----------
    name : str
        Such as "paper", "full" or "short".
    idle_s : float
        Untouched time [s] at the start and the end of each recording: the sensor's zero.
    tolerance : float
        A stroke whose force or speed has a larger relative error is repeated.
    seconds_per_stroke : float
        Time for one stroke with its prompt [s], for the estimate of the total time.
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

    @classmethod
    def shuffled(
        cls,
        name: str,
        fitted: Iterable[Sequence[float]],
        held_out: Iterable[Sequence[float]],
        there_and_back: bool = True,
    ) -> Self:
        """Number strokes in random order, so that a finger that dries does not look like a force.

        `fitted` and `held_out` have normal force [N], amplitude [V] and frequency [Hz] of each.
        """
        rows = [(row, False) for row in fitted] + [(row, True) for row in held_out]
        order = np.random.default_rng(_SHUFFLE_SEED).permutation(len(rows)).tolist()
        strokes = [
            Stroke(
                number=number,
                normal_force_n=force,
                voltage_v=round(volts, 3),
                frequency_hz=hertz,
                there_and_back=there_and_back,
                held_out=is_held_out,
            )
            for number, index in enumerate(order, start=1)
            for (force, volts, hertz), is_held_out in [rows[index]]
        ]
        return cls(name=name, strokes=tuple(strokes))

    @property
    def duration_s(self) -> float:
        """Estimated time at the screen [s]."""
        return len(self.strokes) * self.seconds_per_stroke


def paper_protocol(max_voltage_v: float = 200.0) -> Protocol:
    """Return the paper's 25 strokes, one way each, and 3 more that are held out."""
    grid = product(FORCES_N, VOLTAGES_V, [FREQUENCY_HZ])
    rows = _scaled(grid, max_voltage_v), _scaled(_HELD_OUT, max_voltage_v)
    return Protocol.shuffled("paper", *rows, there_and_back=False)


def full_protocol(max_voltage_v: float = 200.0) -> Protocol:
    """Return the paper's strokes and a frequency sweep at the highest voltage, there and back."""
    grid = product(FORCES_N, VOLTAGES_V, [FREQUENCY_HZ])
    sweep = product(FORCES_N, VOLTAGES_V[-1:], SWEEP_HZ)
    held_out = (*_HELD_OUT, (0.6, 175.0, 60.0), (0.4, 175.0, 500.0))
    rows = _scaled(chain(grid, sweep), max_voltage_v), _scaled(held_out, max_voltage_v)
    return Protocol.shuffled("full", *rows)


def _scaled(rows: Iterable[Sequence[float]], max_voltage_v: float) -> list[Sequence[float]]:
    """Lower the paper's voltages in proportion for a screen that bears less."""
    share = min(positive("max_voltage_v", max_voltage_v) / VOLTAGES_V[-1], 1.0)
    return [(force, share * volts, hertz) for force, volts, hertz in rows]
