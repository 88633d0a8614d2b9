"""Curves in time, low-passed to what skin feels and tabulated once."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import PlainSerializer, PlainValidator, WithJsonSchema

from haptix.checks import Array
from haptix.errors import InputError
from haptix.motion import Facts, Motion
from haptix.signals.signal import ANY_SIGNAL, Signal, signal_from

RATE_HZ = 12_000.0
"""Rate of the tables: that of the renderer's control points."""

FELT_HZ = 1000.0
"""Skin feels no vibration above."""

LONGEST_S = 60.0

_HALF = 12
_TAPS = np.sinc(2 * FELT_HZ / RATE_HZ * np.arange(-_HALF, _HALF + 1)) * np.hamming(2 * _HALF + 1)
_TAPS /= _TAPS.sum()  # scipy's `firwin`, without the second that its import takes at each start

Begins = Literal["start", "down", "press", "release", "detent"]
"""The event from which a curve's time counts: the first sample, or a fact of the finger."""


def _signal(table: Any) -> Signal:
    signal = signal_from(table)
    if not signal.length_s <= LONGEST_S:
        length = "no end" if signal.length_s == inf else f"{signal.length_s:g} s"
        raise InputError(
            f"curve: expected a signal of at most {LONGEST_S:g} s, got {length}; give its "
            "length_s, and loop where it goes on"
        )
    return signal


AnyCurve = Annotated[
    Signal,
    PlainValidator(_signal),
    PlainSerializer(lambda one: one.describe()),
    WithJsonSchema({"title": ANY_SIGNAL}),
]
"""A signal as stimuli have them: sine, pulse, chirp, points, recorded, sums, products, ..."""


@dataclass(frozen=True)
class Timeline:
    """A tabulated curve.

    Attributes
    ----------
    t_s, value : ndarray
        The table; values beyond it are those of its ends.
    period_s : float or None
        Time after which it begins again.
    """

    t_s: Array
    value: Array
    period_s: float | None

    @classmethod
    def of(cls, curve: Signal, ends: Literal["rest", "hold", "loop"]) -> Self:
        """Tabulate a curve that ends in 0 ("rest"), stays at its ends, or begins again.

        A curve that starts from rest is late by a millisecond: it has no earlier time to rise in.
        """
        count = max(curve.samples(RATE_HZ) or 0, 1)
        values = curve.values(0, count, RATE_HZ)
        how: Any = {"rest": "constant", "hold": "edge", "loop": "wrap"}[ends]
        width = _HALF if ends == "loop" else 2 * _HALF
        smooth = np.convolve(np.pad(values, width, mode=how), _TAPS, mode="valid")
        first = -_HALF if ends == "hold" else 0
        if ends == "loop":
            smooth = np.append(smooth, smooth[0])
        if ends == "rest":
            smooth[0] = smooth[-1] = 0.0
        t_s = (first + np.arange(len(smooth))) / RATE_HZ
        return cls(t_s, smooth, count / RATE_HZ if ends == "loop" else None)

    @property
    def length_s(self) -> float:
        """Time until it has ended."""
        return float(self.t_s[-1])

    def at(self, age_s: Array) -> Array:
        """Values at times since its beginning; what has not begun (NaN) is at its first value."""
        if self.period_s is not None:
            age_s = age_s % self.period_s
        found = np.interp(age_s, self.t_s, self.value)
        return np.where(np.isnan(found), self.value[0], found)


def age(motion: Motion, begins: Begins) -> Array:
    """Time since an event at each point [s]; NaN where it has not happened."""
    if begins == "start":
        return motion.t_s
    facts: Facts = motion.facts
    return np.asarray(motion.t_s - getattr(facts, f"{begins}_s"))
