"""One region at one state of a layout: its place, its outline, its opacity and its material."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from math import cos, hypot, inf, sin, sqrt
from typing import Any, Protocol

import numpy as np

from haptix.base.checks import Array
from haptix.feel.layout.region import Blend, Shape
from haptix.feel.materials import Evaluator
from haptix.feel.motion import Depends, Facts, History, LocalFrame, Motion, Report

Row = tuple[float, ...]

Box = tuple[float, float, float, float]
"""Left, right, top and bottom [mm]."""

_RULES = {"add": np.add, "multiply": np.multiply, "max": np.maximum, "min": np.minimum}


@dataclass(frozen=True, slots=True)
class Glide:
    """A row of numbers: `before` until `start_s`, `after` from `end_s` on, a line in between."""

    before: Row
    after: Row
    start_s: float = -inf
    end_s: float = -inf

    @classmethod
    def resting(cls, *values: float) -> Glide:
        """Return constant numbers."""
        return cls(values, values)

    def to(self, values: Row, from_s: float, over_s: float) -> Glide:
        """Glide to other numbers, from the numbers at `from_s`."""
        return Glide(self.at(from_s), values, from_s, from_s + over_s)

    def at(self, t_s: float) -> Row:
        """Numbers at a time."""
        if t_s >= self.end_s:
            return self.after
        if t_s <= self.start_s:
            return self.before
        part = (t_s - self.start_s) / (self.end_s - self.start_s)
        return tuple(a + part * (b - a) for a, b in zip(self.before, self.after, strict=True))

    def parts(self, t_s: Array) -> Array:
        """Share of the glide that is done at times, 0 to 1."""
        if not self.end_s > self.start_s:
            return (t_s >= self.end_s).astype(np.float64)
        return np.asarray(np.clip((t_s - self.start_s) / (self.end_s - self.start_s), 0.0, 1.0))


@dataclass(frozen=True)
class Outline:
    """A shape in a rectangle whose corner is the origin.

    Parameters
    ----------
    width_mm, height_mm : float
        Size of the rectangle.
    shape : {"rectangle", "ellipse"} or sequence of (x_mm, y_mm)
        The shape; a polygon need not be convex, and its edges may not cross.

    Examples
    --------
    >>> disc = Outline(20.0, 20.0, "ellipse")
    >>> disc.contains(10.0, 10.0), disc.contains(1.0, 1.0)  # its middle, a corner
    (True, False)
    """

    width_mm: float
    height_mm: float
    shape: Shape = "rectangle"

    def cover(self, x_mm: Array, y_mm: Array, ramp_mm: float) -> Array:
        """Share of each place that is inside, 0 to 1: a ramp across the edge, or a step at 0.

        Parameters
        ----------
        x_mm, y_mm : array
        ramp_mm : float
            Width of the ramp across the edge [mm]; 0 for a step.

        Examples
        --------
        >>> x_mm, y_mm = np.array([5.0, 12.0]), np.array([5.0, 5.0])
        >>> edge = Outline(10.0, 10.0).cover(x_mm, y_mm, ramp_mm=0.0)
        >>> edge.tolist()
        [1.0, 0.0]
        """
        ramp = max(ramp_mm, 1e-9)
        width, height = self.width_mm, self.height_mm
        if self.shape == "rectangle":
            # The difference of two steps is right for regions narrower than the ramps too.
            inside = _step(x_mm, ramp) - _step(x_mm - width, ramp)
            inside *= _step(y_mm, ramp) - _step(y_mm - height, ramp)
            return inside
        if self.shape == "ellipse":
            a, b = width / 2, height / 2
            depth = (1 - np.hypot(x_mm / a - 1, y_mm / b - 1)) * min(a, b)
            # Beyond the ends of a narrow one this is less than the way to its rectangle.
            across, down = a - np.abs(x_mm - a), b - np.abs(y_mm - b)
            return _step(np.minimum(depth, np.minimum(across, down)), ramp)
        return _step(_depth_in(self.shape, x_mm, y_mm), ramp)

    def contains(self, x_mm: float, y_mm: float) -> bool:
        """Whether a place is inside.

        Parameters
        ----------
        x_mm, y_mm : float

        Examples
        --------
        >>> Outline(10.0, 10.0, "ellipse").contains(5.0, 5.0)
        True
        >>> Outline(10.0, 10.0, "ellipse").contains(0.5, 0.5)
        False
        """
        if self.shape == "rectangle":
            return 0.0 <= x_mm <= self.width_mm and 0.0 <= y_mm <= self.height_mm
        if self.shape == "ellipse":
            return hypot(2 * x_mm / self.width_mm - 1, 2 * y_mm / self.height_mm - 1) <= 1.0
        return bool(self.cover(np.array([x_mm]), np.array([y_mm]), 0.0)[0] >= 0.5)


def _step(depth_mm: Array, ramp_mm: float) -> Array:
    """Return a step from 0 to 1, as a ramp around a depth of 0."""
    return np.asarray(np.clip(0.5 + depth_mm / ramp_mm, 0.0, 1.0))


def _depth_in(corners: Any, x_mm: Array, y_mm: Array) -> Array:
    """Distance to a polygon's nearest edge, negative outside."""
    nearest = np.full(x_mm.shape, np.inf)
    inside = np.zeros(x_mm.shape, dtype=bool)
    x0, y0 = corners[-1]
    for x1, y1 in corners:
        dx, dy = x1 - x0, y1 - y0
        along = ((x_mm - x0) * dx + (y_mm - y0) * dy) / max(dx * dx + dy * dy, 1e-300)
        along = np.clip(along, 0.0, 1.0)
        np.minimum(nearest, np.hypot(x_mm - x0 - along * dx, y_mm - y0 - along * dy), out=nearest)
        if dy:  # a ray to the right crosses this edge
            inside ^= ((y0 > y_mm) != (y1 > y_mm)) & (x_mm < x0 + (y_mm - y0) * dx / dy)
        x0, y0 = x1, y1
    return np.where(inside, nearest, -nearest)


class Control(Protocol):
    """A material with a value: a slider, a toggle, a dial."""

    def value(self, x_mm: float, y_mm: float) -> float:
        """Value at a place, 0 to 1."""

    def frame_at(self, value: float, x_mm: float, y_mm: float) -> LocalFrame:
        """Axes of the control in which a finger at a place has a value."""


def is_later(now_s: float, before_s: float) -> bool:
    """Whether an event happened after another one; a time is NaN until its event happens."""
    return now_s == now_s and not now_s <= before_s


class LayoutFacts(Facts):
    """Facts of a finger on a layout: the newest of all regions, and those of each."""

    of: dict[int, Facts]
    """Facts on each region under the finger, by the region's key."""
    states: dict[int, int]
    """Number of the material's state that these facts belong to, by the region's key."""

    @classmethod
    def newest(
        cls, of: dict[int, Facts], before: Facts, states: dict[int, int] | None = None
    ) -> LayoutFacts:
        """Take the newest time of each kind, over the regions and the facts before."""
        candidates = [before, *of.values()]

        def latest(name: str) -> Facts:
            newest_facts = candidates[0]
            for facts in candidates[1:]:
                this_s, newest_s = getattr(facts, name), getattr(newest_facts, name)
                if is_later(this_s, newest_s):
                    newest_facts = facts
            return newest_facts

        crossed = latest("detent_s")
        times = [getattr(latest(name), name) for name in ("down_s", "press_s", "release_s")]
        made = cls._make((*times, crossed.detent, crossed.detent_s))
        made.of, made.states = of, states or {}
        return made

    def _replace(self, /, **changed: float) -> LayoutFacts:
        """Replace times, also in those regions whose facts have the same time."""
        made = LayoutFacts(*Facts._replace(Facts(*self), **changed))
        made.of = {}
        for key, facts in self.of.items():
            same = [name for name in changed if getattr(facts, name) == getattr(self, name)]
            made.of[key] = facts._replace(**{name: changed[name] for name in same})
        made.states = self.states
        return made


@dataclass(frozen=True, slots=True)
class RegionState:
    """A region at one state; it never changes, a layout replaces it."""

    key: int
    """Of its region."""
    evaluator: Evaluator
    """Answers in millimetres from the region's corner."""
    outline: Outline
    """Its shape."""
    place: Glide
    """Corner x, y on the screen [mm], angle [rad], and millimetres on the screen for one of the
    material's."""
    opacity: Glide
    """Opacity, 0 to 1."""
    z: float = 0.0
    blend: Blend = "over"
    priority: int = 0
    mask: Evaluator | None = None
    """See `Layout.add`."""
    inner: LocalFrame | None = None
    """Axes of the material within the region, where these differ."""
    state: int = 0
    """Number of the state of its material: facts of another one do not hold."""
    control: Control | None = None
    """Its material, where that has a value."""
    way: Box = field(init=False)
    """Box around both ends of the glide."""
    box: Box = field(init=False)
    """Box around the region at the end of the glide."""
    core: Box = field(init=False)
    """Intersection of the boxes at both ends, which the region covers during the whole glide."""
    frame: LocalFrame = field(init=False)
    """Axes at the end of the glide."""
    is_level: bool = field(init=False)
    """Whether it is an upright rectangle without a mask, which covers its whole box."""

    def __post_init__(self) -> None:
        left, right, top, bottom = self._box(*self.place.before)
        box = at_left, at_right, at_top, at_bottom = self._box(*self.place.after)
        way = min(left, at_left), max(right, at_right), min(top, at_top), max(bottom, at_bottom)
        core = max(left, at_left), min(right, at_right), max(top, at_top), min(bottom, at_bottom)
        level = self.outline.shape == "rectangle" and self.mask is None
        level = level and self.place.before[2] == self.place.after[2] == 0.0
        object.__setattr__(self, "way", way)
        object.__setattr__(self, "box", box)
        object.__setattr__(self, "core", core)
        object.__setattr__(self, "frame", LocalFrame(*self.place.after))
        object.__setattr__(self, "is_level", level)

    def depends_on(self, now_s: float) -> Depends:
        """Quantities that the region's friction depends on, from a time on."""
        changes = max(self.place.end_s, self.opacity.end_s) > now_s
        flags = Depends.PLACE | self.evaluator.depends_on
        if self.mask is not None:
            flags |= self.mask.depends_on
        return flags | Depends.TIME if changes else flags

    def moved(self, place: Glide) -> RegionState:
        """Return the region, gliding to another place."""
        return replace(self, place=place)

    def settled(self) -> RegionState:
        """Return the region at the end of its fade and its glide."""
        place, opacity = Glide.resting(*self.place.after), Glide.resting(*self.opacity.after)
        return replace(self, place=place, opacity=opacity)

    def is_gone(self, t_s: float) -> bool:
        """Whether the region has been removed and has faded out."""
        return self.opacity.after[0] == 0.0 and t_s >= self.opacity.end_s

    def axes(self, motion: Motion, first_s: float) -> LocalFrame:
        """Axes of the region during a block that begins at `first_s`."""
        place = self.place
        if first_s >= place.end_s:
            return self.frame
        (x0, y0, a0, s0), (x1, y1, a1, s1) = place.before, place.after
        span_s, t_s = place.end_s - place.start_s, motion.t_s
        parts: Array
        moving: float | Array
        if place.start_s <= first_s and t_s[-1] <= place.end_s:  # the glide lasts the whole block
            parts, moving = (t_s - place.start_s) / span_s, 1 / span_s
        else:
            parts = place.parts(t_s)
            moving = ((parts > 0) & (parts < 1)) / (span_s or 1.0)
        turns, grows = a1 != a0, s1 != s0
        scale = s0 + parts * (s1 - s0) if grows else s0
        return LocalFrame(
            x0 + parts * (x1 - x0), y0 + parts * (y1 - y0), a0 + parts * (a1 - a0) if turns else a0,
            scale, moving * (x1 - x0), moving * (y1 - y0), moving * (a1 - a0) if turns else 0.0,
            moving * (s1 - s0) / scale if grows else 0.0,
        )  # fmt: skip

    def cover(self, on: Motion, motion: Motion, first_s: float, inside: bool) -> float | Array:
        """Opacity at the places of `on`, the motion in the region's axes; a number if constant."""
        opacity: float | Array
        if first_s >= self.opacity.end_s:
            opacity = self.opacity.after[0]
        else:
            low, high = self.opacity.before[0], self.opacity.after[0]
            opacity = low + self.opacity.parts(motion.t_s) * (high - low)
        if inside and self.is_level:
            return opacity
        covered = self.outline.cover(on.x_mm, on.y_mm, 4 * on.footprint_mm)
        if self.mask is not None:
            shares = self.mask.wanted(on.with_footprint(2 * on.footprint_mm))
            covered *= np.clip(shares, 0.0, 1.0)
        return opacity * covered

    def history(self, of_layout: tuple[History, ...]) -> tuple[History, ...]:
        """Facts of each finger on this region."""
        return tuple(
            tuple(
                (from_s, facts.of.get(self.key, Facts()))
                for from_s, facts in of_finger
                if isinstance(facts, LayoutFacts)
            )
            for of_finger in of_layout
        )

    def is_near(self, report: Report) -> bool:
        """Whether a report may be on the region."""
        left, right, top, bottom = self.way
        return left <= report.x_mm <= right and top <= report.y_mm <= bottom

    def seen(self, report: Report) -> tuple[Report, bool]:
        """Return a report in the axes of the region's material, and whether it is on the region."""
        local, on = self.on_outline(report)
        return self.within(local), on

    def on_outline(self, report: Report) -> tuple[Report, bool]:
        """Return a report in the region's axes, and whether it is on the region."""
        t_s, x_mm, y_mm, force_n, on = report
        x, y = _turned(x_mm, y_mm, *self.place.at(t_s))
        on = on and self.opacity.at(t_s)[0] > 0 and self.outline.contains(x, y)
        return Report(t_s, x, y, force_n, on), on

    def within(self, there: Report) -> Report:
        """Convert a report from the region's axes to those of its material."""
        inner = self.inner
        if inner is None:
            return there
        # These axes neither move nor grow: their fields are numbers.
        axes: Any = (inner.x_mm, inner.y_mm, inner.angle_rad, inner.scale)
        x, y = _turned(there.x_mm, there.y_mm, *axes)
        return there._replace(x_mm=x, y_mm=y)

    def _box(self, x_mm: float, y_mm: float, angle: float, scale: float) -> Box:
        """Return the box around the region at a place."""
        shape = self.outline.shape
        width, height = self.outline.width_mm, self.outline.height_mm
        if angle == 0.0 and isinstance(shape, str):
            return x_mm, x_mm + width * scale, y_mm, y_mm + height * scale
        c, s = cos(angle) * scale, sin(angle) * scale
        local = (
            [(0.0, 0.0), (width, 0.0), (0.0, height), (width, height)]
            if isinstance(shape, str)
            else shape
        )
        across = [x_mm + x * c - y * s for x, y in local]
        down = [y_mm + x * s + y * c for x, y in local]
        return min(across), max(across), min(down), max(down)


def blended(blend: Blend, below: float | Array, felt: Array) -> Array:
    """Blend the friction of a layer with the friction below it."""
    rule = _RULES.get(blend)
    return felt if rule is None else np.asarray(rule(below, felt))


def _turned(
    x_mm: float, y_mm: float, x0_mm: float, y0_mm: float, angle: float, scale: float
) -> tuple[float, float]:
    """Return a place in other axes."""
    x, y, c, s = x_mm - x0_mm, y_mm - y0_mm, cos(angle) / scale, sin(angle) / scale
    return x * c + y * s, y * c - x * s


def sliding_share(motion: Motion) -> Array:
    """Share of the friction by speed: 0 at rest, 1 from 2 mm/s on."""
    return np.asarray(np.minimum(sqrt(2) * np.hypot(motion.ux, motion.uy), 1.0))
