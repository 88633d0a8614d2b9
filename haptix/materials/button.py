"""A button: an edge to slide over, and a press and release that are felt by force."""

from __future__ import annotations

from math import isnan
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, PositiveFloat, model_validator

from haptix.checks import Array
from haptix.motion import Depends, Facts, Motion, Report
from haptix.texture.material import Scaled

EDGE_MM = 0.3
"""Width of a step of friction: no more than a finger at 100 mm/s needs for the slew limit."""

_RISES_FROM = 0.3  # share of press_n from which friction rises
_DROP_S, _LOW_S, _RISE_S = 1e-3, 0.03, 0.1


class Button(Scaled):
    """A button whose corner is the origin.

    The rim is rough, so that a sliding finger finds it. While the finger presses, friction rises
    with the force; when it is pressed, and when it is released, friction drops at once, and rises
    again. When pressing, only a drop of friction is felt: the skin under the finger, held by
    friction and strained by pressing, slips back (Monnoyer, Diaz, Wiertlewski and others, IEEE
    Transactions on Haptics 2023, with ultrasonic lubrication). Here the drop is that from the added
    friction of the screen. That it is felt as a click was not tested on electrovibration.

    Fingers whose force is assumed press no button.

    Parameters
    ----------
    width_mm, height_mm : float
        Size on the screen.
    press_n, release_n : float
        Normal forces at which it is pressed and let go.
    rim_mm : float
        Width of the rim, by which a sliding finger finds the button.

    Examples
    --------
    >>> Button(width_mm=20.0, height_mm=12.0, press_n=0.8).press_n
    0.8
    """

    kind: Literal["button"] = "button"
    width_mm: PositiveFloat = 16.0
    height_mm: PositiveFloat = 12.0
    press_n: PositiveFloat = 0.8
    release_n: PositiveFloat = 0.5
    rim_mm: Annotated[float, Field(ge=0)] = 2.0
    depends_on = Depends.PLACE | Depends.TIME | Depends.SPEED | Depends.FORCE | Depends.FACTS
    drives_at_rest = True

    @model_validator(mode="after")
    def _can_be_pressed(self) -> Self:
        if self.release_n >= self.press_n:
            raise ValueError("expected release_n below press_n")
        if 2 * self.rim_mm >= min(self.width_mm, self.height_mm):
            raise ValueError("expected a rim of less than half of the size")
        return self

    @property
    def extent_mm(self) -> tuple[float, float, float, float]:
        """Its size, and a little around."""
        return (-2.0, self.width_mm + 2.0, -2.0, self.height_mm + 2.0)

    def wanted(self, motion: Motion) -> Array:
        """Friction under the fingers: of the rim for one that slides, of the face by its force."""
        depth = self._depth_mm(motion.x_mm, motion.y_mm)
        ramp = max(EDGE_MM, 4 * motion.footprint_mm)
        inside, face = (np.clip(0.5 + (depth - at) / ramp, 0.0, 1.0) for at in (0.0, self.rim_mm))
        slides = np.hypot(motion.ux, motion.uy)
        level = np.maximum((inside - face) * slides, face * self._pressing(motion))
        return self.scaled(level)

    def react(self, facts: Facts, before: Report | None, now: Report) -> Facts:
        """Press where the force rises through `press_n` on the face, release below `release_n`."""
        is_pressed = not isnan(facts.press_s) and not facts.release_s >= facts.press_s
        force = now.normal_force_n
        if force is None or not now.is_down or not self._on_face(now):
            return facts._replace(release_s=now.t_s) if is_pressed else facts
        if is_pressed:
            at = _crossing(before, now, self.release_n)
            return facts if at is None or force > self.release_n else facts._replace(release_s=at)
        if force < self.press_n:
            return facts
        if before is None:
            return facts._replace(press_s=now.t_s)
        at = _crossing(before, now, self.press_n)
        return facts._replace(press_s=at) if at is not None and self._on_face(before) else facts

    def _depth_mm(self, x_mm: Array, y_mm: Array) -> Array:
        """Distance of places from the outline, above 0 inside."""
        across = np.minimum(x_mm, self.width_mm - x_mm)
        return np.minimum(across, np.minimum(y_mm, self.height_mm - y_mm))

    def _on_face(self, report: Report) -> bool:
        depth = self._depth_mm(np.array(report.x_mm), np.array(report.y_mm))
        return bool(depth >= self.rim_mm)

    def _pressing(self, motion: Motion) -> Array:
        """Level of the face: by force until it is pressed, then by the time since that."""
        start = _RISES_FROM * self.press_n
        known = np.repeat(motion.force_known or (True,) * motion.fingers, motion.points)
        by_force = np.clip((motion.normal_force_n - start) / (self.press_n - start), 0.0, 1.0)
        by_force *= known
        facts, t = motion.facts, motion.t_s
        since_press, since_release = t - facts.press_s, t - facts.release_s
        # An event that has not happened is NaN, with which every comparison is false.
        pressed = (since_press >= 0) & ~(facts.release_s >= facts.press_s)
        lasting = np.maximum(_dropped(since_press), _risen(since_press))
        after = np.maximum(_dropped(since_release), by_force * _risen(since_release))
        return np.where(pressed, lasting, np.where(since_release >= 0, after, by_force))


def _dropped(since_s: Array) -> Array:
    return np.asarray(np.clip(1 - since_s / _DROP_S, 0.0, 1.0))


def _risen(since_s: Array) -> Array:
    """Return a rise that begins when the skin has slipped back."""
    return np.asarray(np.clip((since_s - _LOW_S) / _RISE_S, 0.0, 1.0))


def _crossing(before: Report | None, now: Report, force_n: float) -> float | None:
    """Time at which the force went through a value between two reports."""
    if before is None or before.normal_force_n is None or now.normal_force_n is None:
        return None
    first, last = before.normal_force_n - force_n, now.normal_force_n - force_n
    if first * last > 0 or first == last or first == 0:
        return None
    return before.t_s + (now.t_s - before.t_s) * first / (first - last)
