"""Friction in time: envelopes of materials, and transients that begin at an event."""

from __future__ import annotations

from functools import cached_property
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from haptix.checks import Array
from haptix.materials.by_curve import product
from haptix.materials.timeline import AnyCurve, Begins, Timeline, age
from haptix.motion import Depends, Motion
from haptix.signals.in_time import Points, Pulse
from haptix.texture import Evaluator
from haptix.texture.material import AnyMaterial, Material

_FACTS = Depends.TIME | Depends.FACTS


class Envelope(Material):
    """Another material times a curve in time.

    Parameters
    ----------
    of : material
        What the curve multiplies.
    curve : signal
        Factors against time; before and after, those of its ends.
    loop : bool
        Whether it begins again at its end.
    begins : {"start", "down", "press", "release", "detent"}
        From when its time counts.
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
            self.of.evaluator,
            lambda motion: self.timeline.at(age(motion, self.begins)),
            depends_on,
        )


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
    """

    kind: Literal["transient"] = "transient"
    curve: AnyCurve

    @cached_property
    def timeline(self) -> Timeline:
        """The curve's table."""
        return Timeline.of(self.curve, "rest")


EffectName = Literal["hint", "edge", "tick", "align"]

_EFFECTS = {
    "hint": Pulse(0.35, 0.03, length_s=0.03),
    "edge": Pulse(1.0, 0.08, length_s=0.08),
    "tick": Pulse(0.8, 0.012, length_s=0.012),
    "align": Points((0.0, 0.008, 0.0081, 0.048, 0.0481), (1.0, 1.0, -0.3, -0.3, 0.0)),
}
"""Shares against time. The names are those of the WICG's proposal of haptics for the web, which
says what they mean and gives no values; these are ours."""


class WebEffect(_FromEvent):
    """One of the web's effects, with an intensity.

    ``hint``: something can be done here. ``edge``: the end of a range. ``tick``: a step of it.
    ``align``: two things are in line; friction rises, then falls below what it was.

    Parameters
    ----------
    name : {"hint", "edge", "tick", "align"}
        Which one.
    intensity : float
        How strong, 0 to 1.
    begins : {"start", "down", "press", "release", "detent"}
        The event with which it begins.
    """

    kind: Literal["effect"] = "effect"
    name: EffectName
    intensity: Annotated[float, Field(ge=0, le=1)] = 1.0

    @cached_property
    def timeline(self) -> Timeline:
        """The curve's table."""
        whole = Timeline.of(_EFFECTS[self.name], "rest")
        return Timeline(whole.t_s, np.asarray(self.intensity * whole.value), None)
