"""Materials in time: envelopes, transients and effects. Their curves are low-passed to 1 kHz."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import inf
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
from pydantic import Field, PlainSerializer, PlainValidator, WithJsonSchema

from haptix.base.checks import Array
from haptix.base.errors import InputError
from haptix.feel.materials import Evaluator
from haptix.feel.materials.by_curve import product
from haptix.feel.materials.field import TargetKind
from haptix.feel.materials.material import AnyMaterial, Material
from haptix.feel.motion import Depends, Facts, Motion
from haptix.feel.signals.shapes import Points, Pulse
from haptix.feel.signals.signal import ANY_SIGNAL, Signal, signal_from

RATE_HZ = 12_000.0
"""Rate of the tables: that of the renderer's control points."""

FELT_HZ = 1000.0
"""Skin feels no vibration above this frequency."""

LONGEST_S = 60.0

_HALF = 12
# The taps of scipy's `firwin`, whose import would take a second at each start.
_TAPS = np.sinc(2 * FELT_HZ / RATE_HZ * np.arange(-_HALF, _HALF + 1)) * np.hamming(2 * _HALF + 1)
_TAPS /= _TAPS.sum()

Begins = Literal["start", "down", "press", "release", "detent"]
"""The event from which a curve's time counts: the first sample, or a fact of the finger."""

_FACTS = Depends.TIME | Depends.FACTS
EffectName = Literal["hint", "edge", "tick", "align", "success", "error"]
_EFFECTS = {
    "hint": Pulse(0.35, 0.03, length_s=0.03),
    "edge": Pulse(1.0, 0.08, length_s=0.08),
    "tick": Pulse(0.8, 0.012, length_s=0.012),
    "align": Points((0.0, 0.008, 0.0081, 0.048, 0.0481), (1.0, 1.0, -0.3, -0.3, 0.0)),
    "success": Points(
        (0.0, 0.012, 0.0121, 0.12, 0.1201, 0.132, 0.1321), (0.56, 0.56, 0, 0, 0.8, 0.8, 0)
    ),
    "error": Points(
        (0.0, 0.08, 0.0801, 0.16, 0.1601, 0.24, 0.2401, 0.32, 0.3201, 0.4, 0.4001),
        (1, 1, 0, 0, 1, 1, 0, 0, 1, 1, 0),
    ),
}
"""Shares of `WHOLE_CONTRAST` against time. The names are those of the WICG's proposal of haptics
for the web, which defines their meaning and no values, and two more; the values are ours."""

WHOLE_CONTRAST = 0.165
"""Change of friction of a whole effect over that without voltage: 1.5 JND of 0.11. A share of the
reachable range would be 0.1 JND on a dry finger and 7 JND on a wet one. The preset of a semi-wet
finger reaches this on its screen at 0.5 N and 150 V."""


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
    PlainSerializer(lambda signal: signal.describe()),
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

        A curve that starts from rest is a millisecond late, since the low-pass needs time to rise.
        """
        count = max(curve.samples(RATE_HZ) or 0, 1)
        values = curve.values(0, count, RATE_HZ)
        padding: Any = {"rest": "constant", "hold": "edge", "loop": "wrap"}[ends]
        width = _HALF if ends == "loop" else 2 * _HALF
        smooth = np.convolve(np.pad(values, width, mode=padding), _TAPS, mode="valid")
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
        """Values at times [s] since its beginning; the first value where it has not begun (NaN)."""
        if self.period_s is not None:
            age_s = age_s % self.period_s
        values = np.interp(age_s, self.t_s, self.value)
        return np.where(np.isnan(values), self.value[0], values)


def age(motion: Motion, begins: Begins) -> Array:
    """Time since an event at each point [s]; NaN where it has not happened."""
    if begins == "start":
        return motion.t_s
    facts: Facts = motion.facts
    return np.asarray(motion.t_s - getattr(facts, f"{begins}_s"))


class Envelope(Material):
    """Another material times a curve in time.

    Parameters
    ----------
    of : material
        Material that the curve multiplies.
    curve : signal
        Factors against time; before and after, those of its ends.
    loop : bool
        Whether it begins again at its end.
    begins : {"start", "down", "press", "release", "detent"}
        From when its time counts.

    Examples
    --------
    >>> from haptix.feel import Grating
    >>> curve = {"kind": "ramp", "start": 0.0, "end": 1.0, "length_s": 0.5}
    >>> Envelope(of=Grating(period_mm=2.0), curve=curve).curve.length_s
    0.5
    """

    kind: Literal["envelope"] = "envelope"
    of: AnyMaterial
    curve: AnyCurve
    loop: bool = False
    begins: Begins = "start"

    @cached_property
    def timeline(self) -> Timeline:
        """The curve's table."""
        return Timeline.of(self.curve, "loop" if self.loop else "hold")

    @cached_property
    def evaluator(self) -> Evaluator:
        """The product."""
        depends_on = Depends.TIME if self.begins == "start" else _FACTS
        return product(
            self, self.of.evaluator, lambda motion: self.timeline.at(age(motion, self.begins)),
            depends_on,
        )  # fmt: skip


class _FromEvent(Material):
    """Base of effects: a curve from an event on, 0 before and after."""

    begins: Begins = "down"
    depends_on = _FACTS

    @cached_property
    def timeline(self) -> Timeline:
        """The curve's table."""
        raise NotImplementedError

    @property
    def length_s(self) -> float:
        """Time from its beginning to its end [s]."""
        return self.timeline.length_s

    def wanted(self, motion: Motion) -> Array:
        """The curve's values under the fingers."""
        return self.timeline.at(age(motion, self.begins))


class Transient(_FromEvent):
    """A curve that begins at an event: a pulse, a sweep, a chain of points, an audio clip.

    It is late by a millisecond and holds nothing above 1 kHz. It is felt only while the finger
    slides.

    Parameters
    ----------
    curve : signal
        Shares of the reachable range against time.
    begins : {"start", "down", "press", "release", "detent"}
        The event with which it begins.

    Examples
    --------
    >>> click = Transient(curve={"kind": "pulse", "height": 1.0, "width_s": 0.01, "length_s": 0.02})
    >>> click.begins
    'down'
    """

    kind: Literal["transient"] = "transient"
    curve: AnyCurve

    @cached_property
    def timeline(self) -> Timeline:
        """The curve's table."""
        return Timeline.of(self.curve, "rest")


class WebEffect(_FromEvent):
    """One of the web's effects, with an intensity.

    ``hint``: something can be done here. ``edge``: the end of a range. ``tick``: a step of it.
    ``align``: two things are in line; friction rises, then falls below its start. ``success``:
    two ticks. ``error``: three edges. They ask for changes relative to the friction without
    voltage, so that each finger and screen that can give them gives the same.

    Parameters
    ----------
    name : {"hint", "edge", "tick", "align", "success", "error"}
        Which one.
    intensity : float
        How strong, 0 to 1.
    begins : {"start", "down", "press", "release", "detent"}
        The event with which it begins.

    Examples
    --------
    >>> WebEffect(name="tick").name
    'tick'
    """

    target: ClassVar[TargetKind] = "contrast"
    kind: Literal["effect"] = "effect"
    name: EffectName
    intensity: Annotated[float, Field(ge=0, le=1)] = 1.0

    @cached_property
    def timeline(self) -> Timeline:
        """The curve's table."""
        whole = Timeline.of(_EFFECTS[self.name], "rest")
        return Timeline(whole.t_s, np.asarray(WHOLE_CONTRAST * self.intensity * whole.value), None)
