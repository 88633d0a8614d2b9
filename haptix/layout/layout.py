"""A layout: regions that are added, moved, changed and removed while it is felt."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from math import cos, inf, radians, sin
from typing import Any, get_args

import numpy as np

from haptix.checks import Array, choice, instance, number, positive, whole
from haptix.errors import InputError
from haptix.layout.glide import Glide
from haptix.layout.outlines import Outline, Shape
from haptix.layout.region import LayoutFacts, Region
from haptix.motion import FARTHEST_MM, Depends, Facts, Motion, Report
from haptix.texture import Evaluator, Feelable, FrictionField, TargetKind, as_mu, check_feelable
from haptix.texture.composition import Blend, blended, held
from haptix.texture.field import check_target

FADE_S = 0.005
"""Time in which what comes fades in, and what goes fades out."""

GLIDE_S = 0.02
"""Time in which a region moves: reports of a drag come each 8 to 16 ms."""

_KEPT = 64  # textures, held beyond their edges


class Patch:
    """A region on a layout; any thread may change it, at any time."""

    def __init__(self, layout: Layout, key: int, material: Feelable) -> None:
        self.layout = layout
        self.key = key
        self.material = material

    def move(
        self,
        x_mm: float | None = None,
        y_mm: float | None = None,
        rotation_deg: float | None = None,
        over_s: float = GLIDE_S,
    ) -> None:
        """Move along a line, from where it is; what is left out stays.

        Parameters
        ----------
        x_mm, y_mm : float, optional
            New corner, before it is turned.
        rotation_deg : float, optional
            New rotation about the middle, clockwise.
        over_s : float
            Time that it takes; at 0 it jumps.
        """
        values = [
            None if value is None else number(name, value)
            for name, value in (("x_mm", x_mm), ("y_mm", y_mm), ("rotation_deg", rotation_deg))
        ]
        self.layout._move(self.key, values, number("over_s", over_s, 0.0))

    def set(self, **changes: Any) -> None:
        """Change the material, or anything else that `Layout.add` takes, in a cross-fade."""
        self.layout._set(self, changes)

    def remove(self) -> None:
        """Take it off the layout; it fades out. Nothing happens if it is gone."""
        self.layout._remove(self.key)

    @property
    def is_there(self) -> bool:
        """Whether it is on the layout."""
        return self.key in self.layout._given

    @property
    def x_mm(self) -> float:
        """Corner, before it is turned; where a move goes."""
        return float(self.layout._of(self.key)["x_mm"])

    @property
    def y_mm(self) -> float:
        """See `x_mm`."""
        return float(self.layout._of(self.key)["y_mm"])

    @property
    def rotation_deg(self) -> float:
        """Rotation about the middle, clockwise; where a move goes."""
        return float(self.layout._of(self.key)["rotation_deg"])

    @property
    def width_mm(self) -> float:
        """Width on the screen, before it is turned."""
        given = self.layout._of(self.key)
        return float(given["width_mm"] * given["scale"])

    @property
    def height_mm(self) -> float:
        """Height on the screen, before it is turned."""
        given = self.layout._of(self.key)
        return float(given["height_mm"] * given["scale"])

    def __repr__(self) -> str:
        return f"Patch({self.key}, {self.material!r:.60})"


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
        self._lock = threading.RLock()
        self._regions: tuple[Region, ...] = ()  # the highest first; replaced, never changed
        self._draft: list[Region] | None = None
        self._depth = 0
        self._given: dict[int, dict[str, Any]] = {}
        self.patches: dict[int, Patch] = {}
        """Patches by their keys, also those that have gone while a finger was on them."""
        self._held: dict[int, tuple[Feelable, Evaluator]] = {}
        self._keys = 0
        self._now: Callable[[], float] = lambda: -inf
        self._changed: Callable[[], None] = lambda: None

    def add(
        self,
        material: Feelable,
        x_mm: float = 0.0,
        y_mm: float = 0.0,
        width_mm: float | None = None,
        height_mm: float | None = None,
        *,
        shape: Shape = "rectangle",
        rotation_deg: float = 0.0,
        scale: float = 1.0,
        z: float = 0.0,
        blend: Blend = "over",
        opacity: float = 1.0,
        mask: FrictionField | None = None,
        priority: int = 0,
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
        shape : {"rectangle", "ellipse"} or sequence of (x_mm, y_mm)
            See `Outline`.
        rotation_deg : float
            Rotation about the middle, clockwise.
        scale : float
            Millimetres on the screen for one of the material's, about the corner; the size grows
            with it.
        z : float
            Order: a higher region lies on top; of two at one height, the later one.
        blend : {"over", "add", "multiply", "max", "min"}
            How it changes the friction below it. One that multiplies is a share.
        opacity : float
            0 to 1.
        mask : FrictionField, optional
            Opacity at every place of the region, as a share.
        priority : int
            Of several fingers, those on the region of the highest priority get the electrode.

        Raises
        ------
        InputError
            If a value is outside its range, or the size is missing.
        """
        given: dict[str, Any] = {
            "material": material, "x_mm": x_mm, "y_mm": y_mm, "width_mm": width_mm,
            "height_mm": height_mm, "shape": shape, "rotation_deg": rotation_deg, "scale": scale,
            "z": z, "blend": blend, "opacity": opacity, "mask": mask, "priority": priority,
        }  # fmt: skip
        with self.change():
            self._keys += 1
            patch = self.patches[self._keys] = Patch(self, self._keys, material)
            self._put(patch, given, self._now())
        return patch

    @contextmanager
    def change(self) -> Iterator[None]:
        """Gather changes, so that a block has all of them or none; on an error, none."""
        with self._lock:
            self._depth += 1
            if self._depth == 1:
                now_s = self._now()
                self._draft = [one for one in self._regions if not one.is_gone(now_s)]
                before = dict(self._given)
            try:
                yield
                if self._depth == 1 and self._draft is not None:
                    self._regions = tuple(self._draft)
            except BaseException:
                if self._depth == 1:
                    self._given = before
                raise
            finally:
                self._depth -= 1
                is_whole = self._depth == 0
                if is_whole:
                    self._draft = None
        if is_whole:
            self._changed()

    def clear(self) -> None:
        """Remove all regions."""
        with self.change():
            for key in list(self._given):
                self._remove(key)

    def attach(self, now: Callable[[], float], changed: Callable[[], None] = lambda: None) -> None:
        """Take the clock of a renderer, the first time [s] that can still be changed.

        The renderer's `changed` is called after each change.
        """
        with self._lock:
            self._now, self._changed = now, changed
            # What came, went and moved by another clock has done so.
            self._regions = tuple(one.settled() for one in self._regions if one.opacity.after[0])
            self.patches = {key: self.patches[key] for key in self._given}

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
        boxes = [region.box for region in self._regions if region.opacity.after[0]]
        if not boxes:
            return (0.0, 40.0, 0.0, 20.0)
        left, right, top, bottom = zip(*boxes, strict=True)
        return min(left), max(right), min(top), max(bottom)

    @property
    def depends_on(self) -> Depends:
        """What the answers depend on, as the regions are now."""
        below = self._background
        found = Depends.PLACE if isinstance(below, float) else below.depends_on
        now_s = self._now()
        for region in self._regions:
            found |= region.depends_on(now_s)
        return found

    @property
    def drives_at_rest(self) -> bool:
        """Whether any region is felt at rest; the others fade there."""
        return any(region.evaluator.drives_at_rest for region in self._regions)

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
        regions = self._regions  # read once
        if any(region.blend == "multiply" for region in regions):
            motion = motion.with_footprint(2 * motion.footprint_mm)
        near = 2 * motion.footprint_mm + 1e-9
        start_s = motion.start_s
        first_s = float(start_s.min()) if isinstance(start_s, np.ndarray) else start_s
        layers: list[tuple[Region, Motion, float | Array]] = []
        hidden = False
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
                hidden = True  # and so is all below it
                break
        below = self._background
        rests = self.drives_at_rest
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
        held = facts.of if isinstance(facts, LayoutFacts) else {}
        left = facts
        for region in self._regions:
            if region.opacity.after[0] == 0.0:
                continue  # it goes
            known = held.get(region.key)
            if known is None and not region.is_near(now):
                continue
            here, on = region.seen(now)
            if not on and known is None:
                continue
            there = None if before is None or known is None else region.seen(before)[0]
            found = region.evaluator.react(known or Facts(down_s=now.t_s), there, here)
            if on:
                of[region.key] = found
            else:
                left = LayoutFacts.newest({0: found}, left)
        return LayoutFacts.newest(of, left)

    def under(self, report: Report) -> list[int]:
        """Keys of the regions under a report, the highest first."""
        return [
            region.key
            for region in self._regions
            if region.opacity.after[0] > 0.0 and region.is_near(report) and region.seen(report)[1]
        ]

    def priorities(self, motion: Motion) -> Array | None:
        """Priority of each finger at each point; None where all are alike."""
        regions = self._regions
        if not any(region.priority for region in regions):
            return None
        found = np.zeros(motion.x_mm.shape)
        first_s = float(np.min(motion.start_s))
        for region in reversed(regions):
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
            return value * np.hypot(motion.ux, motion.uy) if fades else value
        lowest, highest = motion.reach
        mu = as_mu(kind, value, lowest, highest)
        if fades:
            mu = lowest + (mu - lowest) * np.hypot(motion.ux, motion.uy)
        if self.target == "mu":
            return np.asarray(mu)
        if self.target == "contrast":
            return np.asarray(mu / lowest - 1)
        return np.asarray((mu - lowest) / np.maximum(highest - lowest, 1e-12))

    def _of(self, key: int) -> dict[str, Any]:
        try:
            return self._given[key]
        except KeyError:
            raise InputError("patch: expected one that is on its layout; it was removed") from None

    def _put(self, patch: Patch, given: dict[str, Any], now_s: float) -> None:
        """Add the region of a patch on top of those of its height, fading in."""
        region = self._region(patch.key, given, now_s)
        self._given[patch.key] = given
        draft = self._draft or []
        draft.insert(sum(one.z > region.z for one in draft), region)
        self._draft = draft

    def _region(self, key: int, given: dict[str, Any], now_s: float) -> Region:
        material = given["material"]
        check_feelable("material", material)
        for name in ("width_mm", "height_mm"):
            if given[name] is None:
                given[name] = _own_size(material, name)
                if given[name] is None:
                    raise InputError(f"{name}: expected a size, since the material has none")
            positive(name, given[name])
        for name in ("x_mm", "y_mm", "rotation_deg", "z"):
            number(name, given[name])
        positive("scale", given["scale"])
        choice("blend", given["blend"], get_args(Blend))
        whole("priority", given["priority"], -(10**6))
        opacity = number("opacity", given["opacity"], 0.0)
        if opacity > 1:
            raise InputError(f"opacity: expected 0 to 1, got {opacity:g}")
        evaluator = self._evaluator(material)
        if given["blend"] == "multiply" and evaluator.target != "share":
            raise InputError(
                f"blend: a region that multiplies is a share, got a material of {evaluator.target}"
            )
        mask = given["mask"]
        if mask is not None:
            instance("mask", mask, FrictionField)
            if mask.target != "share":
                raise InputError(f"mask: expected a field of shares, got {mask.target}")
            mask = held(mask)
        size = (float(given["width_mm"]), float(given["height_mm"]))
        fade = Glide((0.0,), (opacity,), now_s, now_s + FADE_S)
        return Region(
            key, evaluator, Outline(*size, given["shape"]), Glide.resting(*_corner(given)), fade,
            float(given["scale"]), float(given["z"]), given["blend"], given["priority"], mask,
        )  # fmt: skip

    def _evaluator(self, material: Feelable) -> Evaluator:
        """What answers for a material; textures are held beyond their edges, made once."""
        evaluator = material if isinstance(material, FrictionField) else material.evaluator
        if not isinstance(evaluator, FrictionField):
            return evaluator
        known = self._held.pop(id(evaluator), None)
        if known is None:
            known = (evaluator, held(evaluator).evaluator)
        self._held[id(evaluator)] = known
        if len(self._held) > _KEPT:
            del self._held[next(iter(self._held))]
        return known[1]

    def _move(self, key: int, values: list[float | None], over_s: float) -> None:
        with self._lock:
            given = dict(self._of(key))
            for name, value in zip(("x_mm", "y_mm", "rotation_deg"), values, strict=True):
                if value is not None:
                    given[name] = value
            self._given[key] = given
            now_s, corner = self._now(), _corner(given)
            regions = self._regions if self._draft is None else self._draft
            moved = [
                one.moved(one.place.to(corner, now_s, over_s))
                if one.key == key and one.opacity.after[0] > 0.0
                else one
                for one in regions
            ]
            if self._draft is None:
                self._regions = tuple(moved)
                self._changed()
            else:
                self._draft = moved

    def _set(self, patch: Patch, changes: dict[str, Any]) -> None:
        with self.change():
            given = dict(self._of(patch.key))
            for name in changes:
                choice("set", name, given)
            size = {"width_mm": None, "height_mm": None} if "material" in changes else {}
            given |= {name: one for name, one in size.items() if not _sized(given, name)}
            given |= changes
            now_s = self._now()
            # What is covered by an opaque one goes when that has come; others fade meanwhile.
            covered = given["blend"] == "over" and given["opacity"] == 1.0 and given["mask"] is None
            self._fade(patch.key, now_s, now_s + FADE_S if covered else now_s)
            self._put(patch, given, now_s)
            if "material" in changes:
                patch.material = changes["material"]

    def _remove(self, key: int) -> None:
        with self.change():
            now_s = self._now()
            self._fade(key, now_s, now_s)
            self._given.pop(key, None)

    def _fade(self, key: int, now_s: float, from_s: float) -> None:
        """Fade a region out, from a time on; what covers it until then hides its end."""
        draft = self._draft or []
        for i, region in enumerate(draft):
            if region.key == key and region.opacity.after[0] > 0.0:
                over_s = 0.0 if from_s > now_s else FADE_S
                now = region.opacity.at(from_s)
                fade = Glide(now, (0.0,), from_s, from_s + over_s)
                draft[i] = replace(region, opacity=fade)


def _own_size(material: Feelable, name: str) -> float | None:
    found: float | None = getattr(material, name, None)
    if found is None and not isinstance(material, FrictionField):
        found = getattr(material.evaluator, name, None)
    return found


def _sized(given: dict[str, Any], name: str) -> bool:
    """Whether a size was given, and not that of the material."""
    own = _own_size(given["material"], name)
    return bool(own is None or given[name] != own)


def _corner(given: dict[str, Any]) -> tuple[float, float, float]:
    """Corner on the screen and angle, turned about the middle."""
    angle = radians(float(given["rotation_deg"]))
    x, y = float(given["x_mm"]), float(given["y_mm"])
    if angle == 0.0:
        return x, y, 0.0
    half_x = given["width_mm"] * given["scale"] / 2
    half_y = given["height_mm"] * given["scale"] / 2
    c, s = cos(angle), sin(angle)
    return x + half_x - half_x * c + half_y * s, y + half_y - half_x * s - half_y * c, angle
