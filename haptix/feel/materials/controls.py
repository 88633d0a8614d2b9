"""Controls: buttons, pressed by force; sliders, toggles and dials with detents."""

from __future__ import annotations

from functools import cached_property
from math import atan2, cos, isnan, pi, radians, sin
from typing import Annotated, Literal, Self, TypeVar

import numpy as np
from pydantic import Field, PositiveFloat, model_validator

from haptix.base.checks import Array, increasing
from haptix.base.errors import InputError
from haptix.feel.materials.by_curve import Row
from haptix.feel.materials.field import turned
from haptix.feel.materials.material import Scaled
from haptix.feel.motion import Depends, Facts, LocalFrame, Motion, Report

Sized = TypeVar("Sized")

LEAST_PITCH_MM = 3.0
"""Closer detents run together: places of live touches err by 0.8 mm (95 %)."""

_HYSTERESIS = 0.05  # share of the pitch past the ridge's top from which a detent counts as crossed


def ridge(distance_mm: Array, width_mm: float, footprint_mm: float) -> Array:
    """Level of a ridge, a raised cosine about 0.

    Where the drive cannot follow it, the ridge is wider and lower, with the same area.
    """
    width = max(width_mm, 4 * footprint_mm)
    part = np.clip(np.abs(distance_mm) / width, 0.0, 0.5)
    return np.asarray(width_mm / width * (0.5 + 0.5 * np.cos(2 * pi * part)))


class _Control(Scaled):
    """Base of the controls with detents.

    Parameters
    ----------
    ridge_mm : float
        Width of a ridge. It lies between two detents: friction brakes there, and lets go when the
        finger has passed. It never pulls the finger anywhere, as a spring would.
    """

    ridge_mm: PositiveFloat = 1.5

    def _detent(self, x_mm: float, y_mm: float) -> float:
        """Place along the detents, in detents: whole at each, half on the ridge between two."""
        raise NotImplementedError

    def _step(self, before: float, now: float) -> float:
        """Signed number of detents from one place to another."""
        return now - before

    def react(self, facts: Facts, before: Report | None, now: Report) -> Facts:
        """Count a detent as crossed when the finger has passed the ridge before it."""
        if not now.is_down:
            return facts
        place = self._detent(now.x_mm, now.y_mm)
        if isnan(facts.detent):
            return facts._replace(detent=float(round(place)))
        away = self._step(facts.detent, place)
        if abs(away) < 0.5 + _HYSTERESIS or isnan(place):
            return facts
        steps = float(round(away))
        at_s = now.t_s
        if before is not None:
            # The time at which the finger passed the top of the last ridge.
            start = self._step(facts.detent, self._detent(before.x_mm, before.y_mm))
            top = steps - 0.5 if steps > 0 else steps + 0.5
            part = (top - start) / (away - start) if away != start else 1.0
            at_s = before.t_s + min(max(part, 0.0), 1.0) * (now.t_s - before.t_s)
        return facts._replace(detent=self._numbered(facts.detent + steps), detent_s=at_s)

    def _numbered(self, detent: float) -> float:
        return detent


class Slider(_Control):
    """A slider along x from the origin: ridges between its detents, walls at its ends.

    Parameters
    ----------
    travel_mm : float
        From the first detent to the last.
    detents : int or list of float
        How many, evenly spaced; or their places [mm], increasing.
    orientation_deg : float
        Direction of the travel: 0 to the right, 90 down.
    snap : bool
        Whether `value` is that of the nearest detent. The screen does not move the finger there.
    start_mm : float
        Place of the first detent; places of `detents` count from it. A region needs room before
        it for the wall.

    Examples
    --------
    >>> Slider(travel_mm=60.0, detents=5).detents
    5
    """

    kind: Literal["slider"] = "slider"
    travel_mm: PositiveFloat = 60.0
    detents: Annotated[int, Field(ge=2, le=1000)] | Row = 9
    orientation_deg: float = 0.0
    snap: bool = True
    start_mm: float = 0.0

    @model_validator(mode="after")
    def _has_room(self) -> Self:
        if not isinstance(self.detents, int):
            increasing("detents", self.detents, 2)
        closest = float(np.diff(self.places_mm).min())
        least = max(LEAST_PITCH_MM, 2 * self.ridge_mm)
        if closest < least * (1 - 1e-9):
            raise ValueError(f"expected detents {least:g} mm apart or more, got {closest:.3g} mm")
        return self

    @cached_property
    def places_mm(self) -> Array:
        """Places of the detents along the travel, shape (detents,)."""
        if isinstance(self.detents, int):
            return self.start_mm + np.linspace(0.0, self.travel_mm, self.detents)
        return self.start_mm + np.array(self.detents)

    def value(self, x_mm: float, y_mm: float = 0.0) -> float:
        """Value at a place, 0 at the first detent and 1 at the last; of the nearest with `snap`.

        Parameters
        ----------
        x_mm, y_mm : float
            The place, in the slider's axes [mm].

        Examples
        --------
        >>> Slider(travel_mm=60.0, detents=5).value(60.0)
        1.0
        """
        along = self._along(x_mm, y_mm)
        places = self.places_mm
        if self.snap:
            along = float(places[np.abs(places - along).argmin()])
        return float(np.clip((along - places[0]) / (places[-1] - places[0]), 0.0, 1.0))

    def frame_at(self, value: float, x_mm: float, y_mm: float) -> LocalFrame:
        """Axes in which a finger at a place has a value.

        Parameters
        ----------
        value : float
            0 at the first detent, 1 at the last.
        x_mm, y_mm : float
            The finger's place [mm].
        """
        places, angle = self.places_mm, radians(self.orientation_deg)
        goal = float(places[0] + value * (places[-1] - places[0]))
        away = self._along(x_mm, y_mm) - goal
        return LocalFrame(away * cos(angle), away * sin(angle))

    @property
    def extent_mm(self) -> tuple[float, float, float, float]:
        """Where it is."""
        places = self.places_mm
        return (float(places[0]) - 5.0, float(places[-1]) + 5.0, 0.0, 15.0)

    def wanted(self, motion: Motion) -> Array:
        """Friction under the fingers."""
        along, _ = turned(motion.x_mm, motion.y_mm, self.orientation_deg)
        places = self.places_mm
        tops = (places[:-1] + places[1:]) / 2
        nearest = tops[np.searchsorted((tops[:-1] + tops[1:]) / 2, along)]
        beyond = np.maximum(places[0] - along, along - places[-1])
        walls = np.clip(beyond / self.ridge_mm, 0.0, 1.0)
        ridges = ridge(along - nearest, self.ridge_mm, motion.footprint_mm)
        return self.scaled(np.maximum(ridges, walls))

    def _along(self, x_mm: float, y_mm: float) -> float:
        angle = radians(self.orientation_deg)
        return x_mm * cos(angle) + y_mm * sin(angle)

    def _detent(self, x_mm: float, y_mm: float) -> float:
        places = self.places_mm
        return float(np.interp(self._along(x_mm, y_mm), places, np.arange(len(places))))


class Toggle(_Control):
    """A switch with two sides along x, its corner at the origin.

    Friction rises over `throw_mm` towards the middle, and falls at once behind it: the switch goes
    over. On the way back it is the same from the other side.

    Parameters
    ----------
    width_mm : float
        Width; the middle is at half of it. What is left at its default is that of the region.
    throw_mm : float
        Way over which friction rises.

    Examples
    --------
    >>> Toggle(width_mm=20.0).value(0.0)
    0.0
    """

    kind: Literal["toggle"] = "toggle"
    width_mm: PositiveFloat = 20.0
    throw_mm: PositiveFloat = 5.0
    ridge_mm: PositiveFloat = 0.3
    depends_on = Depends.PLACE | Depends.DIRECTION

    @model_validator(mode="after")
    def _has_room(self) -> Self:
        if 2 * self.throw_mm > self.width_mm:
            raise ValueError("expected throw_mm of at most half of width_mm")
        return self

    def value(self, x_mm: float, y_mm: float = 0.0) -> float:
        """Value at a place: 0 on the left side, 1 on the right one.

        Parameters
        ----------
        x_mm, y_mm : float
            The place, in the toggle's axes [mm].
        """
        return float(x_mm > self.width_mm / 2)

    def frame_at(self, value: float, x_mm: float, y_mm: float) -> LocalFrame:
        """Axes in which a finger at a place has a value: unchanged, or mirrored at the middle.

        Parameters
        ----------
        value : float
            0 for the left side, 1 for the right one.
        x_mm, y_mm : float
            The finger's place [mm].
        """
        is_there = self.value(x_mm) == round(value)
        return LocalFrame(0.0 if is_there else 2 * x_mm - self.width_mm)

    @property
    def extent_mm(self) -> tuple[float, float, float, float]:
        """Where it is."""
        return (0.0, self.width_mm, 0.0, self.width_mm / 2)

    def wanted(self, motion: Motion) -> Array:
        """Friction under the fingers."""
        right = self._rise(motion.x_mm - self.width_mm / 2, motion.footprint_mm)
        left = self._rise(self.width_mm / 2 - motion.x_mm, motion.footprint_mm)
        level = right * np.maximum(motion.ux, 0.0) + left * np.maximum(-motion.ux, 0.0)
        return self.scaled(level)

    def _rise(self, past_mm: Array, footprint_mm: float) -> Array:
        """Rise to the middle for a finger that comes from below 0, and the fall behind it."""
        rise = np.clip(1 + past_mm / self.throw_mm, 0.0, 1.0)
        fall = np.clip(1 - past_mm / max(self.ridge_mm, 4 * footprint_mm), 0.0, 1.0)
        return np.asarray(rise * fall)

    def _detent(self, x_mm: float, y_mm: float) -> float:
        return min(max(0.5 + (x_mm - self.width_mm / 2) / self.throw_mm, 0.0), 1.0)


class Dial(_Control):
    """A knob: ridges across the way round, as wide at every radius.

    Parameters
    ----------
    detents : int
        In a turn; the first is at 0 deg, to the right, the next ones from x towards y.
    inner_mm, outer_mm : float
        Radii between which there are ridges.
    centre_mm : (float, float)
        Its middle; in a region, from the region's corner.

    Examples
    --------
    >>> Dial(detents=12, inner_mm=8.0, outer_mm=25.0).detents
    12
    """

    kind: Literal["dial"] = "dial"
    detents: Annotated[int, Field(ge=2, le=1000)] = 12
    inner_mm: PositiveFloat = 10.0
    outer_mm: PositiveFloat = 25.0
    centre_mm: tuple[float, float] = (0.0, 0.0)

    @model_validator(mode="after")
    def _has_room(self) -> Self:
        pitch = 2 * pi * self.inner_mm / self.detents
        least = max(LEAST_PITCH_MM, 2 * self.ridge_mm)
        if pitch < least or self.inner_mm >= self.outer_mm:
            raise ValueError(
                f"expected inner_mm below outer_mm, and detents {least:g} mm apart there or more, "
                f"got {pitch:.3g} mm"
            )
        return self

    def value(self, x_mm: float, y_mm: float = 0.0) -> float:
        """Part of a turn at a place, of the nearest detent: 0 to the right, rising from x to y.

        Parameters
        ----------
        x_mm, y_mm : float
            The place, in the dial's axes [mm].
        """
        return float(round(self._detent(x_mm, y_mm)) % self.detents) / self.detents

    def frame_at(self, value: float, x_mm: float, y_mm: float) -> LocalFrame:
        """Axes in which a finger at a place has a value: turned about the centre.

        Parameters
        ----------
        value : float
            Part of a turn.
        x_mm, y_mm : float
            The finger's place [mm].
        """
        x, y = self.centre_mm
        angle = atan2(y_mm - y, x_mm - x) - 2 * pi * value
        c, s = cos(angle), sin(angle)
        return LocalFrame(x - x * c + y * s, y - x * s - y * c, angle)

    @property
    def extent_mm(self) -> tuple[float, float, float, float]:
        """Where it is."""
        (x, y), outer = self.centre_mm, self.outer_mm
        return (x - outer, x + outer, y - outer, y + outer)

    def wanted(self, motion: Motion) -> Array:
        """Friction under the fingers."""
        x, y = motion.x_mm - self.centre_mm[0], motion.y_mm - self.centre_mm[1]
        radius = np.hypot(x, y)
        turn = np.arctan2(y, x) * (self.detents / (2 * pi)) - 0.5
        way = (turn - np.round(turn)) * radius * (2 * pi / self.detents)
        ramp = max(self.ridge_mm, 4 * motion.footprint_mm)
        depth = np.minimum(radius - self.inner_mm, self.outer_mm - radius)
        within = np.clip(0.5 + depth / ramp, 0.0, 1.0)
        return self.scaled(within * ridge(way, self.ridge_mm, motion.footprint_mm))

    def _detent(self, x_mm: float, y_mm: float) -> float:
        x, y = self.centre_mm
        return atan2(y_mm - y, x_mm - x) * self.detents / (2 * pi)

    def _step(self, before: float, now: float) -> float:
        half = self.detents / 2
        return (now - before + half) % self.detents - half

    def _numbered(self, detent: float) -> float:
        return detent % self.detents


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
        Size on the screen. What is left at its default is that of the region.
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
        """Press where the force rises through `press_n` on the face, release below `release_n`.

        Where the report before has no force, the first that has enough of it presses.
        """
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
        known = before.normal_force_n is not None
        at = _crossing(before, now, self.press_n) if known else now.t_s
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


def filling(material: Sized, width_mm: float, height_mm: float) -> Sized:
    """Return a button or toggle in the size of its region, other materials as they are.

    Only a size that is left at its default is replaced, and only by one that the control admits.

    Parameters
    ----------
    material : Feelable
    width_mm, height_mm : float
        The region's size, before it is scaled.

    Examples
    --------
    >>> filling(Button(height_mm=10.0), 60.0, 20.0).width_mm
    60.0
    """
    if not isinstance(material, Button | Toggle):
        return material
    known = type(material).model_fields
    size = {"width_mm": width_mm, "height_mm": height_mm}
    of_region = {
        name: size_mm
        for name, size_mm in size.items()
        if name in known and getattr(material, name) == known[name].default != size_mm
    }
    if not of_region:
        return material
    try:
        return type(material)(**material.model_dump() | of_region)
    except InputError:
        return material


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
