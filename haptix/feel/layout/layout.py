"""A layout: regions that are added, moved, changed and removed while it is felt.

A `LayoutRegion` is an app's handle of a region. `Controls` have the value of each control.
`Listeners` call the app, in its thread, when fingers do something.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from math import nan
from typing import Any, Literal, NamedTuple, get_args

import numpy as np

from haptix.base.checks import Array, choice, number
from haptix.base.errors import InputError
from haptix.feel.layout.region import Place
from haptix.feel.layout.region_state import (
    LayoutFacts,
    RegionState,
    blended,
    is_later,
    sliding_share,
)
from haptix.feel.layout.regions import GLIDE_S, Controls, Region, Regions
from haptix.feel.materials import Evaluator, Feelable, TargetKind, as_mu, check_feelable
from haptix.feel.materials.field import Mapped, check_target
from haptix.feel.motion import FARTHEST_MM, Depends, Facts, Motion, Report

LayoutEventKind = Literal["enter", "leave", "press", "release", "detent"]


class LayoutRegion:
    """A region on a layout; any thread may change it, at any time.

    `Layout.add` makes it.

    Parameters
    ----------
    regions, controls
        The layout's regions, and the values of its controls.
    key : int
        Number of the region.
    """

    def __init__(self, regions: Regions, controls: Controls, key: int) -> None:
        self._regions = regions
        self._controls = controls
        self.key = key

    def move(
        self,
        x_mm: float | None = None,
        y_mm: float | None = None,
        *,
        over_s: float = GLIDE_S,
        **place: float | None,
    ) -> None:
        """Move along a line from the present place; values that are left out stay the same.

        Parameters
        ----------
        x_mm, y_mm : float, optional
            New corner, before it is turned.
        over_s : float
            Time that it takes; at 0 it jumps.
        **place
            The rotation and `scale`, see `haptix.feel.layout.region.RegionFields`.

        Examples
        --------
        >>> from haptix.feel import Grating
        >>> layout = Layout()
        >>> ribs = layout.add(Grating(period_mm=2.0), x_mm=10, y_mm=5, width_mm=30, height_mm=20)
        >>> ribs.move(x_mm=20, y_mm=5)
        >>> ribs.x_mm
        20.0
        """
        choices = Place.model_fields.keys() | {"scale"}
        values = {choice("move", name, choices): value for name, value in place.items()}
        fields = {"x_mm": x_mm, "y_mm": y_mm, **values}
        changed = {name: value for name, value in fields.items() if value is not None}
        self._regions.move(self.key, changed, number("over_s", over_s, 0.0))

    def change(self, **changes: Any) -> None:
        """Change the material, or another field of `Layout.add`, in a cross-fade."""
        with self._regions.change():
            if changes:
                self._regions.set(self.key, changes)

    def set_value(self, value: float) -> None:
        """Set the value of a control: a slider, toggle or dial.

        If a finger is on the control, its detents are shifted so that the finger is at that value,
        and no detent counts as crossed. When that finger leaves, the shift ends.

        Parameters
        ----------
        value : float
            From 0 to 1.
        """
        with self._regions.change():
            self._controls.push(self.key, value)

    def remove(self) -> None:
        """Remove the region from the layout; it fades out. A second call has no effect.

        Examples
        --------
        >>> from haptix.feel import Grating
        >>> layout = Layout()
        >>> ribs = layout.add(Grating(period_mm=2.0), x_mm=10, y_mm=5, width_mm=30, height_mm=20)
        >>> ribs.remove()
        >>> ribs.is_there
        False
        """
        self._regions.remove(self.key)

    @property
    def value(self) -> float:
        """Value of a control, 0 to 1, as the last finger on it or the app has set it."""
        return self._controls.value(self.key)

    @property
    def material(self) -> Feelable:
        """Material of the region."""
        return self.fields.material

    @property
    def is_there(self) -> bool:
        """Whether the region is on the layout."""
        return self._regions.has(self.key)

    @property
    def fields(self) -> Region:
        """The region's fields; while it moves, those at the end of the move."""
        return self._regions.fields(self.key)

    @property
    def x_mm(self) -> float:
        """Corner before the rotation [mm]; during a move, that at its end."""
        return self.fields.x_mm or 0.0

    @property
    def y_mm(self) -> float:
        """See `x_mm`."""
        return self.fields.y_mm or 0.0

    @property
    def scale(self) -> float:
        """Millimetres on the screen for one of the material; during a move, that at its end."""
        return self.fields.scale or 1.0

    @property
    def width_mm(self) -> float:
        """Width on the screen, before it is turned."""
        return self.fields.size_mm[0] * self.scale

    @property
    def height_mm(self) -> float:
        """Height on the screen, before it is turned."""
        return self.fields.size_mm[1] * self.scale

    def __repr__(self) -> str:
        felt = f"{self.material!r:.60}" if self.is_there else "removed"
        return f"LayoutRegion({self.key}, {felt})"


class Layout(Mapped):
    """Materials in regions of the screen, which any thread may change while it is felt.

    A renderer reads the regions once for each block, so that a block shows one state. A change
    fades or glides, from the first sample that can still be changed. Without a renderer it has
    effect at once.

    Parameters
    ----------
    background : float or Feelable
        Material below all regions, or a number of the kind `target`.
    target : {"share", "mu", "contrast"}
        Quantity of the answers. Materials of another kind are converted by the reach of the screen.

    Examples
    --------
    >>> from haptix.feel import Grating
    >>> layout = Layout()
    >>> ribs = layout.add(Grating(period_mm=2.0), x_mm=10, y_mm=5, width_mm=30, height_mm=20)
    >>> ribs.move(x_mm=20, y_mm=5)
    >>> ribs.remove()
    """

    def __init__(self, background: float | Feelable = 0.0, target: TargetKind = "share") -> None:
        check_target(target)
        if target == "plain":
            raise InputError("target: plain numbers are not friction; give share, mu or contrast")
        self.target: TargetKind = target
        self._background: Evaluator | float
        if isinstance(background, int | float):
            self._background = number("background", background)
        else:
            check_feelable("background", background)
            self._background = background.evaluator
        self.store = Regions()
        """The state of the regions, which a renderer reads."""
        self._controls = Controls(self.store)
        self.regions: dict[int, LayoutRegion] = {}
        """Regions by their keys, with those that were removed while a finger was on them."""

    def add(
        self,
        material: Feelable,
        x_mm: float = 0.0,
        y_mm: float = 0.0,
        width_mm: float | None = None,
        height_mm: float | None = None,
        **fields: Any,
    ) -> LayoutRegion:
        """Put a material onto the layout; it fades in.

        Parameters
        ----------
        material : FrictionField or Material
            Material; its origin lies at the region's corner.
        x_mm, y_mm : float
            Corner on the screen, upper left, before it is turned.
        width_mm, height_mm : float, optional
            Size; some materials have their own.
        **fields
            The others of a `haptix.feel.Region`: shape, rotation, scale, z, blend, opacity,
            mask, priority and group.

        Raises
        ------
        InputError
            If a value is outside its range, or the size is missing.

        Examples
        --------
        >>> from haptix.feel import Grating
        >>> layout = Layout(background=0.1)
        >>> ribs = layout.add(Grating(period_mm=2.0), x_mm=10, y_mm=5, width_mm=30, height_mm=20)
        >>> ribs.x_mm, ribs.width_mm
        (10.0, 30.0)
        """
        check_feelable("material", material)
        place = {"x_mm": x_mm, "y_mm": y_mm, "width_mm": width_mm, "height_mm": height_mm}
        return self.put(Region(material=material, **place, **fields))

    def put(self, region: Region) -> LayoutRegion:
        """Put a region onto the layout; see `add`."""
        with self.change():
            key = self.store.add(region)
            placed = LayoutRegion(self.store, self._controls, key)
            self.regions[key] = placed
        return placed

    def change(self) -> AbstractContextManager[None]:
        """Collect changes in a context: a block shows all or none, and after an error none."""
        return self.store.change()

    def clear(self) -> None:
        """Remove all regions.

        Examples
        --------
        >>> from haptix.feel import Grating
        >>> layout = Layout()
        >>> ribs = layout.add(Grating(period_mm=2.0), x_mm=10, y_mm=5, width_mm=30, height_mm=20)
        >>> layout.clear()
        >>> ribs.is_there
        False
        """
        self.store.clear()

    def attach(self, now: Callable[[], float], changed: Callable[[], None] = lambda: None) -> None:
        """Take the clock of a renderer: the first time [s] that can still be changed.

        Parameters
        ----------
        now : callable
            Returns the first time [s] of the renderer's clock that can still be changed.
        changed : callable
            Called after each change, in the thread that makes it.
        """
        store = self.store
        with store.lock:
            store.attach(now, changed)
            self._controls.forget()
            self.regions = {key: region for key, region in self.regions.items() if store.has(key)}

    def report(self, touch_id: int, report: Report) -> None:
        """Let the controls follow a real report of a finger, on the clock of samples.

        Parameters
        ----------
        touch_id : int
        report : Report
            Its place and force, on the clock of samples.
        """
        self._controls.report(touch_id, report)

    @property
    def evaluator(self) -> Layout:
        """Itself."""
        return self

    @property
    def background(self) -> Evaluator | float:
        """Material below all regions."""
        return self._background

    @property
    def outside(self) -> float:
        """The number of the background where there is nothing to feel."""
        below = self._background
        return below if isinstance(below, float) else below.outside

    @property
    def extent_mm(self) -> tuple[float, float, float, float]:
        """Left, right, top and bottom of the box around all regions."""
        boxes = [region.box for region in self.store.shown.regions if region.opacity.after[0]]
        if not boxes:
            return (0.0, 40.0, 0.0, 20.0)
        left, right, top, bottom = zip(*boxes, strict=True)
        return min(left), max(right), min(top), max(bottom)

    @property
    def depends_on(self) -> Depends:
        """Quantities that the friction depends on, for the present regions."""
        below = self._background
        depends_on_all = Depends.PLACE if isinstance(below, float) else below.depends_on
        now_s = self.store.now()
        for region in self.store.shown.regions:
            depends_on_all |= region.depends_on(now_s)
        return depends_on_all

    @property
    def drives_at_rest(self) -> bool:
        """Whether any region drives fingers at rest; the others then fade out by themselves."""
        return self.store.shown.drives_at_rest

    def wanted(self, motion: Motion) -> Array:
        """Friction wanted under the fingers, of the motion's shape."""
        x, y = motion.x_mm, motion.y_mm
        if not x.size:
            return np.empty(0)
        left, right = float(x[x.argmin()]), float(x[x.argmax()])
        top, bottom = float(y[y.argmin()]), float(y[y.argmax()])
        if not (max(-left, right, -top, bottom) <= FARTHEST_MM and left == left and top == top):
            far = ~((np.abs(x) <= FARTHEST_MM) & (np.abs(y) <= FARTHEST_MM))
            brought_in = motion.at_places(np.where(far, 0.0, x), np.where(far, 0.0, y))
            return np.where(far, self.outside, self.wanted(brought_in))
        shown = self.store.shown  # read once
        if shown.multiplies:
            motion = motion.with_footprint(2 * motion.footprint_mm)
        # The ramp at an edge reaches two footprints along each axis of the region, which is turned.
        near = 3 * motion.footprint_mm + 1e-9
        start_s = motion.start_s
        first_s = float(start_s.min()) if isinstance(start_s, np.ndarray) else start_s
        layers: list[tuple[RegionState, Motion, float | Array]] = []
        hidden = False
        regions = (
            shown.near_any(x.reshape(-1, motion.points), y.reshape(-1, motion.points), near)
            if motion.fingers > 1
            else shown.near(left - near, right + near, top - near, bottom + near)
        )
        for region in regions:
            is_still = first_s >= region.place.end_s
            at_left, at_right, at_top, at_bottom = region.box if is_still else region.way
            if (
                right < at_left - near or left > at_right + near
                or bottom < at_top - near or top > at_bottom + near
            ):  # fmt: skip
                continue
            if not is_still:
                at_left, at_right, at_top, at_bottom = region.core
            inside = (
                left > at_left + near and right < at_right - near
                and top > at_top + near and bottom < at_bottom - near
            )  # fmt: skip
            on = motion.seen_from(region.axes(motion, first_s))
            cover = region.cover(on, motion, first_s, inside)
            if isinstance(cover, float) and cover == 0.0:
                continue
            layers.append((region, on, cover))
            if isinstance(cover, float) and cover == 1.0 and region.blend == "over":
                hidden = True  # this region hides all that is below it
                break
        below = self._background
        rests = shown.drives_at_rest
        value: Array
        if hidden:
            value = np.zeros(x.shape)
        elif isinstance(below, float):
            value = self._converted(np.full(x.shape, below), self.target, motion, rests)
        else:
            value = self._wanted_of(below, motion, rests)
        for region, on, cover in reversed(layers):
            if Depends.FACTS in region.evaluator.depends_on:
                on = on.with_history(region.history(on.history))
            if region.inner is not None:
                on = on.seen_from(region.inner)
            if region.blend == "multiply":
                felt = region.evaluator.wanted(on)
            else:
                felt = self._wanted_of(region.evaluator, on, rests)
            if isinstance(cover, float) and cover == 1.0:
                value = blended(region.blend, value, felt)
            else:
                value = value + cover * (blended(region.blend, value, felt) - value)
        return np.asarray(value)

    def react(self, facts: Facts, before: Report | None, now: Report) -> Facts:
        """Return a finger's facts after a real report, with those on each region under it.

        Parameters
        ----------
        facts : Facts
            Past events of the finger.
        before : Report or None
            The report before; None when it comes down.
        now : Report
            The new report.
        """
        of: dict[int, Facts] = {}
        states: dict[int, int] = {}
        facts = facts if isinstance(facts, LayoutFacts) else LayoutFacts.newest({}, facts)
        of_regions, left, shown = facts.of, facts, self.store.shown
        near = shown.near(now.x_mm, now.x_mm, now.y_mm, now.y_mm)
        if of_regions.keys() - {region.key for region in near}:
            near = shown.regions
        for region in near:
            if region.opacity.after[0] == 0.0:
                continue  # the region is being removed
            known = of_regions.get(region.key)
            if known is None and not region.is_near(now):
                continue
            here, on = region.seen(now)
            if not on and known is None:
                continue
            local_before = None if before is None or known is None else region.seen(before)[0]
            if known is not None and facts.states.get(region.key, 0) != region.state:
                known = known._replace(detent=nan)  # start at the present detent, without crossing
            facts_now = region.evaluator.react(known or Facts(down_s=now.t_s), local_before, here)
            if on:
                of[region.key], states[region.key] = facts_now, region.state
            else:
                left = LayoutFacts.newest({0: facts_now}, left)
        is_same = left is facts and states == facts.states and of.keys() == of_regions.keys()
        if is_same and all(unchanged is of_regions[key] for key, unchanged in of.items()):
            return facts  # the usual case
        return LayoutFacts.newest(of, left, states)

    def under(self, report: Report) -> list[int]:
        """Keys of the regions under a report, the top one first.

        Examples
        --------
        >>> from haptix.feel import Grating
        >>> layout = Layout()
        >>> ribs = layout.add(Grating(period_mm=2.0), x_mm=10, y_mm=5, width_mm=30, height_mm=20)
        >>> from haptix.feel import Report
        >>> layout.under(Report(0.0, x_mm=20.0, y_mm=10.0, normal_force_n=0.5)) == [ribs.key]
        True
        """
        return [
            region.key
            for region in self.store.shown.near(*(report.x_mm,) * 2, *(report.y_mm,) * 2)
            if region.opacity.after[0] > 0.0 and region.is_near(report) and region.seen(report)[1]
        ]

    def priorities(self, motion: Motion) -> Array | None:
        """Priority of each finger at each point; None if no region has a priority."""
        shown = self.store.shown
        if not shown.has_priorities:
            return None
        priority = np.zeros(motion.x_mm.shape)
        first_s = float(np.min(motion.start_s))
        for region in reversed(shown.regions):
            on = motion.seen_from(region.axes(motion, first_s))
            inside = region.outline.cover(on.x_mm, on.y_mm, 0.0) >= 0.5
            priority[inside] = region.priority
        return priority

    def _wanted_of(self, evaluator: Evaluator, motion: Motion, rests: bool) -> Array:
        """Wanted friction of a material, in the target of the layout."""
        fades = rests and not evaluator.drives_at_rest
        return self._converted(evaluator.wanted(motion), evaluator.target, motion, fades)

    def _converted(self, value: Array, kind: TargetKind, motion: Motion, fades: bool) -> Array:
        """Convert numbers of a kind to the layout's target; with `fades` they fade out at rest."""
        if kind == self.target and not (fades and kind == "mu"):
            return value * sliding_share(motion) if fades else value
        lowest, highest = motion.reach
        mu = as_mu(kind, value, lowest, highest)
        if fades:
            mu = lowest + (mu - lowest) * sliding_share(motion)
        if self.target == "mu":
            return np.asarray(mu)
        if self.target == "contrast":
            return np.asarray(mu / lowest - 1)
        return np.asarray((mu - lowest) / np.maximum(highest - lowest, 1e-12))


class LayoutEvent(NamedTuple):
    """An event of a finger, by a real report and never by prediction."""

    kind: LayoutEventKind
    region: LayoutRegion | None
    """The region; None on a material that fills the screen."""
    touch_id: int
    t_s: float
    """Time of the report, as the app has stamped it."""
    x_mm: float
    y_mm: float
    detent: float
    """Number of the detent; NaN for other kinds of event."""


class _Reported(NamedTuple):
    facts: Facts
    report: Report


class Listeners:
    """Callbacks of an app, called while it passes touches."""

    def __init__(self) -> None:
        self._callbacks: dict[str, list[Callable[[LayoutEvent], None]]] = {}
        self._fingers: dict[int, _Reported] = {}

    def on(self, kind: LayoutEventKind, callback: Callable[[LayoutEvent], None]) -> None:
        """Call a function at each event of a kind.

        Parameters
        ----------
        kind : str
            "enter", "leave", "press", "release" or "detent".
        callback : callable
            Takes the `LayoutEvent`.
        """
        choice("on", kind, get_args(LayoutEventKind))
        if not callable(callback):
            raise InputError(f"on: expected a function of the event, got {callback!r:.80}")
        self._callbacks.setdefault(kind, []).append(callback)

    def forget(self) -> None:
        """Forget all fingers, when a renderer starts."""
        self._fingers.clear()

    def report(self, texture: Feelable, touch_id: int, t_s: float, now: Report) -> None:
        """Take a real report of a finger; `now` is on the clock of samples, `t_s` its stamp.

        Parameters
        ----------
        texture : Feelable
            Material under the finger.
        touch_id : int
        t_s : float
            Time stamp of the report [s].
        now : Report
            The report, on the clock of samples.
        """
        if not self._callbacks:
            return
        before = self._fingers.pop(touch_id, None)
        if before is None and not now.is_down:
            return
        was = Facts(down_s=now.t_s) if before is None else before.facts
        facts = texture.evaluator.react(was, None if before is None else before.report, now)
        if now.is_down:
            self._fingers[touch_id] = _Reported(facts, now)
            if facts is was and before is not None:
                return  # the usual case: nothing has happened
        place = now if now.is_down or before is None else before.report
        for kind, region, detent in _changes(texture, was, facts, now.is_down):
            event = LayoutEvent(kind, region, touch_id, t_s, place.x_mm, place.y_mm, detent)
            for callback in self._callbacks.get(kind, ()):
                callback(event)


def _changes(
    texture: Feelable, was: Facts, now: Facts, is_down: bool
) -> list[tuple[LayoutEventKind, LayoutRegion | None, float]]:
    events: list[tuple[LayoutEventKind, LayoutRegion | None, float]] = []
    old: dict[int, Facts] = was.of if isinstance(was, LayoutFacts) else {}
    new: dict[int, Facts] = now.of if isinstance(now, LayoutFacts) else {}
    regions: dict[int, LayoutRegion] = {}
    if isinstance(layout := texture.evaluator, Layout):
        regions = layout.regions
    else:
        old, new = {0: was}, {0: now}
    for key, facts in old.items():
        if key not in new:
            if _is_pressed(facts):
                events.append(("release", regions.get(key), nan))
            events.append(("leave", regions.get(key), nan))
    for key, facts in new.items():
        region, before = regions.get(key), old.get(key)
        if before is None:
            events.append(("enter", region, nan))
            before = Facts()
        if is_later(facts.press_s, before.press_s):
            events.append(("press", region, nan))
        if is_later(facts.release_s, before.release_s):
            events.append(("release", region, nan))
        if is_later(facts.detent_s, before.detent_s):
            events.append(("detent", region, facts.detent))
    return events


def _is_pressed(facts: Facts) -> bool:
    # An event that has not happened is NaN, with which every comparison is false.
    return facts.press_s == facts.press_s and not facts.release_s >= facts.press_s
