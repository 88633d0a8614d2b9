"""A layout: regions that are added, moved, changed and removed while it is felt."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from math import nan, sqrt
from typing import Any

import numpy as np

from haptix.checks import Array, number
from haptix.errors import InputError
from haptix.layout.controls import Controls
from haptix.layout.patch import Patch
from haptix.layout.region import LayoutFacts, RegionState, blended
from haptix.layout.regions import Region, Regions
from haptix.motion import FARTHEST_MM, Depends, Facts, Motion, Report
from haptix.texture import Evaluator, Feelable, TargetKind, as_mu, check_feelable
from haptix.texture.field import check_target


class Layout:
    """Materials in regions of the screen, which any thread may change while it is felt.

    A renderer asks for a block and reads the regions once, so that a block is of one state. What
    changes fades or glides, from the first sample that can still be changed. Without a renderer it
    changes at once.

    Parameters
    ----------
    background : float or Feelable
        What is felt below all regions, a number of the kind `target`.
    target : {"share", "mu", "contrast"}
        What the answers are. Materials of another kind are converted by what the screen can reach.

    Examples
    --------
    >>> from haptix.texture import Grating
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
        self._regions = Regions()
        self._controls = Controls(self._regions)
        self.patches: dict[int, Patch] = {}
        """Patches by their keys, also those that have gone while a finger was on them."""

    def add(
        self,
        material: Feelable,
        x_mm: float = 0.0,
        y_mm: float = 0.0,
        width_mm: float | None = None,
        height_mm: float | None = None,
        **fields: Any,
    ) -> Patch:
        """Put a material onto the layout; it fades in.

        Parameters
        ----------
        material : FrictionField or Material
            What is felt there; its origin lies at the region's corner.
        x_mm, y_mm : float
            Corner on the screen, upper left, before it is turned.
        width_mm, height_mm : float, optional
            Size; some materials have their own.
        **fields
            The others of a `haptix.layout.Region`: shape, rotation, scale, z, blend, opacity,
            mask and priority.

        Raises
        ------
        InputError
            If a value is outside its range, or the size is missing.
        """
        check_feelable("material", material)
        place = {"x_mm": x_mm, "y_mm": y_mm, "width_mm": width_mm, "height_mm": height_mm}
        return self.put(Region(material=material, **place, **fields))

    def put(self, region: Region) -> Patch:
        """Put a region onto the layout; see `add`."""
        with self.change():
            key = self._regions.add(region)
            patch = self.patches[key] = Patch(self._regions, self._controls, key, region.material)
        return patch

    def change(self) -> AbstractContextManager[None]:
        """Gather changes, so that a block has all of them or none; on an error, none."""
        return self._regions.change()

    def clear(self) -> None:
        """Remove all regions."""
        self._regions.clear()

    def attach(self, now: Callable[[], float], changed: Callable[[], None] = lambda: None) -> None:
        """Take the clock of a renderer: the first time [s] that can still be changed.

        `changed` is called after each change, in its thread.
        """
        regions = self._regions
        with regions.lock:
            regions.attach(now, changed)
            self._controls.forget()
            self.patches = {key: one for key, one in self.patches.items() if regions.has(key)}

    def heard(self, touch_id: int, report: Report) -> None:
        """Take a real report of a finger, on the clock of samples: controls follow it."""
        self._controls.heard(touch_id, report)

    @property
    def evaluator(self) -> Layout:
        """Itself."""
        return self

    @property
    def outside(self) -> float:
        """The background."""
        below = self._background
        return below if isinstance(below, float) else below.outside

    @property
    def extent_mm(self) -> tuple[float, float, float, float]:
        """Left, right, top and bottom of the box around all regions."""
        boxes = [region.box for region in self._regions.shown.regions if region.opacity.after[0]]
        if not boxes:
            return (0.0, 40.0, 0.0, 20.0)
        left, right, top, bottom = zip(*boxes, strict=True)
        return min(left), max(right), min(top), max(bottom)

    @property
    def depends_on(self) -> Depends:
        """What the answers depend on, as the regions are now."""
        below = self._background
        found = Depends.PLACE if isinstance(below, float) else below.depends_on
        now_s = self._regions.now()
        for region in self._regions.shown.regions:
            found |= region.depends_on(now_s)
        return found

    @property
    def drives_at_rest(self) -> bool:
        """Whether any region is felt at rest; the others fade there."""
        return self._regions.shown.drives_at_rest

    def wanted(self, motion: Motion) -> Array:
        """Friction wanted under the fingers, of the motion's shape."""
        x, y = motion.x_mm, motion.y_mm
        if not x.size:
            return np.empty(0)
        left, right = float(x[x.argmin()]), float(x[x.argmax()])
        top, bottom = float(y[y.argmin()]), float(y[y.argmax()])
        if not (max(-left, right, -top, bottom) <= FARTHEST_MM and left == left and top == top):
            far = ~((np.abs(x) <= FARTHEST_MM) & (np.abs(y) <= FARTHEST_MM))
            found = self.wanted(motion.at_places(np.where(far, 0.0, x), np.where(far, 0.0, y)))
            return np.where(far, self.outside, found)
        shown = self._regions.shown  # read once
        if shown.multiplies:
            motion = motion.with_footprint(2 * motion.footprint_mm)
        near = 2 * motion.footprint_mm + 1e-9
        start_s = motion.start_s
        first_s = float(start_s.min()) if isinstance(start_s, np.ndarray) else start_s
        layers: list[tuple[RegionState, Motion, float | Array]] = []
        hidden = False
        for region in shown.near(left - near, right + near, top - near, bottom + near):
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
                hidden = True  # and so is all below it
                break
        below = self._background
        rests = shown.drives_at_rest
        value: Array
        if hidden:
            value = np.zeros(x.shape)
        elif isinstance(below, float):
            value = self._converted(np.full(x.shape, below), self.target, motion, rests)
        else:
            value = self._asked(below, motion, rests)
        for region, on, cover in reversed(layers):
            if Depends.FACTS in region.evaluator.depends_on:
                on = on.with_history(region.history(on.history))
            if region.inner is not None:
                on = on.seen_from(region.inner)
            if region.blend == "multiply":
                felt = region.evaluator.wanted(on)
            else:
                felt = self._asked(region.evaluator, on, rests)
            if isinstance(cover, float) and cover == 1.0:
                value = blended(region.blend, value, felt)
            else:
                value = value + cover * (blended(region.blend, value, felt) - value)
        return np.asarray(value)

    def react(self, facts: Facts, before: Report | None, now: Report) -> Facts:
        """Return a finger's facts after a real report: of each region that it is on."""
        of: dict[int, Facts] = {}
        states: dict[int, int] = {}
        facts = facts if isinstance(facts, LayoutFacts) else LayoutFacts.newest({}, facts)
        held, left, shown = facts.of, facts, self._regions.shown
        near = shown.near(now.x_mm, now.x_mm, now.y_mm, now.y_mm)
        if held.keys() - {one.key for one in near}:
            near = shown.regions
        for region in near:
            if region.opacity.after[0] == 0.0:
                continue  # it goes
            known = held.get(region.key)
            if known is None and not region.is_near(now):
                continue
            here, on = region.seen(now)
            if not on and known is None:
                continue
            there = None if before is None or known is None else region.seen(before)[0]
            if known is not None and facts.states.get(region.key, 0) != region.state:
                known = known._replace(detent=nan)  # where it is now, without having crossed any
            found = region.evaluator.react(known or Facts(down_s=now.t_s), there, here)
            if on:
                of[region.key], states[region.key] = found, region.state
            else:
                left = LayoutFacts.newest({0: found}, left)
        is_same = left is facts and states == facts.states and of.keys() == held.keys()
        if is_same and all(one is held[key] for key, one in of.items()):
            return facts  # as mostly
        return LayoutFacts.newest(of, left, states)

    def under(self, report: Report) -> list[int]:
        """Keys of the regions under a report, the highest first."""
        return [
            region.key
            for region in self._regions.shown.near(*(report.x_mm,) * 2, *(report.y_mm,) * 2)
            if region.opacity.after[0] > 0.0 and region.is_near(report) and region.seen(report)[1]
        ]

    def priorities(self, motion: Motion) -> Array | None:
        """Priority of each finger at each point; None where all are alike."""
        shown = self._regions.shown
        if not shown.has_priorities:
            return None
        found = np.zeros(motion.x_mm.shape)
        first_s = float(np.min(motion.start_s))
        for region in reversed(shown.regions):
            on = motion.seen_from(region.axes(motion, first_s))
            inside = region.outline.cover(on.x_mm, on.y_mm, 0.0) >= 0.5
            found[inside] = region.priority
        return found

    def _asked(self, evaluator: Evaluator, motion: Motion, rests: bool) -> Array:
        """Answer of a material, in the target of the layout."""
        fades = rests and not evaluator.drives_at_rest
        return self._converted(evaluator.wanted(motion), evaluator.target, motion, fades)

    def _converted(self, value: Array, kind: TargetKind, motion: Motion, fades: bool) -> Array:
        """Numbers of a kind in the target of the layout; with `fades`, none where fingers rest."""
        if kind == self.target and not (fades and kind == "mu"):
            return value * _sliding(motion) if fades else value
        lowest, highest = motion.reach
        mu = as_mu(kind, value, lowest, highest)
        if fades:
            mu = lowest + (mu - lowest) * _sliding(motion)
        if self.target == "mu":
            return np.asarray(mu)
        if self.target == "contrast":
            return np.asarray(mu / lowest - 1)
        return np.asarray((mu - lowest) / np.maximum(highest - lowest, 1e-12))


def _sliding(motion: Motion) -> Array:
    """Share that is left of what a finger at rest does not feel: whole from 2 mm/s on."""
    return np.asarray(np.minimum(sqrt(2) * np.hypot(motion.ux, motion.uy), 1.0))
