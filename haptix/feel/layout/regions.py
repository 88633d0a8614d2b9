"""The regions of a layout: their changes, the search near a finger, and their controls."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import chain
from math import inf
from typing import Any, NamedTuple, Self
from weakref import ref

import numpy as np
from pydantic import ValidationError

from haptix.base.checks import Array, first_error, number
from haptix.base.errors import InputError
from haptix.feel.layout.region import RegionFields
from haptix.feel.layout.region_state import Control, Glide, Outline, RegionState
from haptix.feel.materials import (
    Evaluator,
    Feelable,
    FrictionField,
    RecordedProfile,
    Texture,
    check_feelable,
)
from haptix.feel.materials.controls import filling
from haptix.feel.materials.material import AnyMaterial
from haptix.feel.motion import Depends, LocalFrame, Motion, Report

LOOPED = 12  # up to this number of regions a loop over them is faster than numpy

FADE_S = 0.005
"""Time in which an added region fades in, and a removed one fades out."""

GLIDE_S = 0.02
"""Time in which a region moves. Reports of a drag come every 8 to 16 ms."""


@dataclass(frozen=True, slots=True)
class Shown:
    """Regions at one state of a layout; it never changes, a change replaces it."""

    regions: tuple[RegionState, ...] = ()
    """The highest first."""
    ways: Array | None = None
    """Of many regions: left, right, top and bottom of the way of each; shape (4, regions)."""
    evaluators: tuple[Evaluator, ...] = ()
    """Of all regions, each once."""
    multiplies: bool = False
    """Whether any region multiplies the friction below it."""
    has_priorities: bool = False
    """Whether any region has a priority."""
    controls: tuple[RegionState, ...] = ()
    """Those whose material has a value."""

    @classmethod
    def of(cls, regions: Sequence[RegionState]) -> Self:
        """Take regions, the highest first."""
        return cls(
            tuple(regions),
            np.array([region.way for region in regions]).T if len(regions) > LOOPED else None,
            tuple({id(region.evaluator): region.evaluator for region in regions}.values()),
            any(region.blend == "multiply" for region in regions),
            any(region.priority for region in regions),
            tuple(region for region in regions if region.control is not None),
        )

    def moved(self, at: int, region: RegionState) -> Shown:
        """Return the same with one region in another place."""
        regions, ways = self.regions, self.ways
        if ways is not None:
            ways = ways.copy()
            ways[:, at] = region.way
        return Shown(
            (*regions[:at], region, *regions[at + 1 :]),
            ways, self.evaluators, self.multiplies, self.has_priorities,
            tuple(region if other is self.regions[at] else other for other in self.controls),
        )  # fmt: skip

    def near(self, left: float, right: float, top: float, bottom: float) -> Sequence[RegionState]:
        """Return the regions whose way meets a box [mm], the top one first; all if they are few."""
        ways = self.ways
        if ways is None:
            return self.regions
        apart = (ways[0] > right) | (ways[1] < left) | (ways[2] > bottom) | (ways[3] < top)
        return [self.regions[at] for at in np.flatnonzero(~apart).tolist()]

    def near_any(self, x_mm: Array, y_mm: Array, near_mm: float) -> Sequence[RegionState]:
        """Return the regions near one of several paths, as `near`.

        Fingers far apart have a box around all of them that meets most regions.

        Parameters
        ----------
        x_mm, y_mm : ndarray, shape (fingers, points)
            Paths [mm].
        near_mm : float
            How far a region may be from a path's box.
        """
        if self.ways is None:
            return self.regions
        left, right, top, bottom = self.ways
        x, y = x_mm[..., None], y_mm[..., None]
        meets = (x.min(1) - near_mm <= right) & (x.max(1) + near_mm >= left)
        meets &= (y.min(1) - near_mm <= bottom) & (y.max(1) + near_mm >= top)
        return [self.regions[at] for at in np.flatnonzero(meets.any(0)).tolist()]

    @property
    def drives_at_rest(self) -> bool:
        """Whether any region drives fingers at rest."""
        return any(evaluator.drives_at_rest for evaluator in self.evaluators)


class Region(RegionFields):
    """A material in a region of a layout.

    Parameters
    ----------
    name : str, optional
        By which `LayoutMaterial.region` finds it.
    material : FrictionField or Material
        Material; its origin lies at the region's corner.
    mask : FrictionField or Material, optional
        Opacity at every place of the region, as a share.

    Raises
    ------
    InputError
        If a value is outside its range.
    """

    name: str | None = None
    material: AnyMaterial
    mask: AnyMaterial | None = None

    def __init__(self, /, **fields: Any) -> None:
        try:
            super().__init__(**fields)
        except ValidationError as error:
            raise InputError(first_error("region", error)) from None

    def replace(self, **changes: Any) -> Region:
        """Return the region with some fields changed."""
        return Region(**{name: getattr(self, name) for name in self.model_fields_set} | changes)

    @property
    def size_mm(self) -> tuple[float, float]:
        """Width and height before scaling: those of the region, or else of its material."""

        def size(name: str) -> float:
            size_mm: float | None = getattr(self, name) or _size_of(self.material, name)
            if size_mm is None:
                raise InputError(f"{name}: expected a size, since the material has none")
            return size_mm

        return size("width_mm"), size("height_mm")


class Regions:
    """Regions by their keys. Any thread may change them; `shown` is replaced and never changed."""

    def __init__(self) -> None:
        self.lock = threading.RLock()
        self.shown = Shown()
        self.materials: dict[int, Feelable] = {}
        """Materials of the regions that have not been removed, by the regions' keys."""
        self.now: Callable[[], float] = lambda: -inf
        """The first time [s] that can still be changed."""
        self._changed: Callable[[], None] = lambda: None
        self._draft: list[RegionState] | None = None
        self._last_at: dict[int, int] = {}  # by key: the region's last known index
        self._depth = 0
        self._fields: dict[int, Region] = {}
        self._held: dict[int, tuple[ref[FrictionField], Evaluator]] = {}  # by id of the field
        self._keys = 0

    def attach(self, now: Callable[[], float], changed: Callable[[], None]) -> None:
        """Take a clock, and a function to call after each change."""
        with self.lock:
            self.now, self._changed = now, changed
            # Fades and glides of another clock end now.
            self.shown = Shown.of(
                [region.settled() for region in self.shown.regions if region.opacity.after[0]]
            )

    @contextmanager
    def change(self) -> Iterator[None]:
        """Collect changes in a context; after an error none of them has effect."""
        with self.lock:
            self._depth += 1
            if self._depth == 1:
                now_s = self.now()
                self._draft = [region for region in self.shown.regions if not region.is_gone(now_s)]
                if len(self._draft) < len(self.shown.regions):  # their memory is free for new ones
                    self.shown = Shown.of(self._draft)
                before = dict(self._fields), dict(self.materials)
            try:
                yield
                if self._depth == 1 and self._draft is not None:
                    self.shown = Shown.of(self._draft)
            except BaseException:
                if self._depth == 1:
                    self._fields, self.materials = before
                raise
            finally:
                self._depth -= 1
                is_last = self._depth == 0
                if is_last:
                    self._draft = None
        if is_last:
            self._changed()

    def add(self, region: Region) -> int:
        """Add a region and return its key."""
        with self.change():
            self._keys += 1
            self._put(self._keys, region, self.now())
            return self._keys

    def has(self, key: int) -> bool:
        """Whether a region with this key is on the layout."""
        return key in self._fields

    def fields(self, key: int) -> Region:
        """Return the fields of a region; `InputError` if it was removed."""
        try:
            return self._fields[key]
        except KeyError:
            raise InputError(
                "region: expected a region of the layout; this one was removed"
            ) from None

    def clear(self) -> None:
        """Remove all regions."""
        with self.change():
            for key in list(self._fields):
                self.remove(key)

    def remove(self, key: int) -> None:
        """Fade a region out."""
        with self.change():
            now_s = self.now()
            self._fade(key, now_s, now_s)
            self._fields.pop(key, None)
            self.materials.pop(key, None)
            self._last_at.pop(key, None)

    def move(self, key: int, values: dict[str, Any], over_s: float) -> None:
        """Move a region along a line, to another corner, rotation or scale."""
        with self.lock:
            region = self._fields[key] = self.fields(key).replace(**values)
            draft = self._draft
            if (at := self._find(key)) is not None:
                state = (self.shown.regions if draft is None else draft)[at]
                place = state.place.to(region.corner(*region.size_mm), self.now(), over_s)
                moved = state.moved(place)
                if draft is None:
                    self.shown = self.shown.moved(at, moved)
                else:
                    draft[at] = moved
            if draft is not None:
                return
        self._changed()

    def _find(self, key: int) -> int | None:
        """Return the index of the state of a region that does not fade out; None without one."""
        regions = self.shown.regions if self._draft is None else self._draft
        # Look at the last known index first, so that a move costs the same among many regions.
        for at in chain((self._last_at.get(key, 0),), range(len(regions))):
            state = regions[at] if at < len(regions) else None
            if state is not None and state.key == key and state.opacity.after[0] > 0.0:
                self._last_at[key] = at
                return at
        return None

    def set(self, key: int, changes: dict[str, Any]) -> None:
        """Change fields of a region, in a cross-fade."""
        with self.change():
            if "material" in changes:
                check_feelable("material", changes["material"])
            region = self.fields(key).replace(**changes)
            inner = None if "material" in changes else self._last_of(key)[0]
            self._replace(key, region, inner)

    def show(self, key: int, inner: LocalFrame | None) -> None:
        """Show the material of a region in other axes, in a cross-fade."""
        with self.change():
            self._replace(key, self.fields(key), inner)

    def _replace(self, key: int, fields: Region, inner: LocalFrame | None) -> None:
        now_s, (_, state) = self.now(), self._last_of(key)
        # If the new state is opaque, the old one goes when the new one has faded in and covers it.
        # Otherwise both fade at the same time.
        is_opaque = fields.opacity in (None, 1.0) and fields.mask is None
        covered = is_opaque and fields.blend in (None, "over")
        self._fade(key, now_s, now_s + FADE_S if covered else now_s)
        self._put(key, fields, now_s, inner, state + 1)

    def _last_of(self, key: int) -> tuple[LocalFrame | None, int]:
        """Return the axes in which a region shows its material, and the number of that state."""
        if self._draft is None or (at := self._find(key)) is None:
            return None, 0  # opacity 0
        return self._draft[at].inner, self._draft[at].state

    def _put(
        self,
        key: int,
        fields: Region,
        now_s: float,
        inner: LocalFrame | None = None,
        state: int = 0,
    ) -> None:
        """Add a region, which fades in. Of regions with the same z, the last one is on top."""
        region = replace(self._region(key, fields, now_s), inner=inner, state=state)
        self._fields[key] = fields
        self.materials[key] = fields.material
        draft = self._draft or []
        draft.insert(sum((other.z, other.key) > (region.z, key) for other in draft), region)
        self._draft = draft

    def _fade(self, key: int, now_s: float, from_s: float) -> None:
        """Fade a region out from `now_s`; if `from_s` is later, let it end suddenly then.

        In that case another region covers it by then.
        """
        draft: list[RegionState] = []
        for region in self._draft or []:
            if region.key == key and region.opacity.after[0] > 0.0:
                if region.opacity.at(now_s)[0] == 0.0:
                    continue  # not shown yet: in a pause many changes must not accumulate
                over_s = 0.0 if from_s > now_s else FADE_S
                now = region.opacity.at(from_s)
                region = replace(region, opacity=Glide(now, (0.0,), from_s, from_s + over_s))
            draft.append(region)
        self._draft = draft

    def _region(self, key: int, fields: Region, now_s: float) -> RegionState:
        size = fields.size_mm
        felt = filling(fields.material, *size)
        evaluator = self._evaluator(felt)
        # Some make their maps at the first evaluation: make them now, not during a stroke.
        evaluator.wanted(Motion.of([0.0], 0.0))
        blend = fields.blend or "over"
        if blend == "multiply" and evaluator.target != "share":
            raise InputError(
                f"blend: a region that multiplies is a share, got a material of {evaluator.target}"
            )
        mask = None
        if fields.mask is not None:
            mask = self._evaluator(fields.mask)
            if mask.target != "share" or Depends.FACTS in mask.depends_on:
                raise InputError(
                    "mask: expected shares that no event of the finger changes, got a material of "
                    f"{mask.target}"
                )
        opacity = 1.0 if fields.opacity is None else fields.opacity
        fade = Glide((0.0,), (opacity,), now_s, now_s + FADE_S)
        return RegionState(
            key, evaluator, Outline(*size, fields.shape or "rectangle"),
            Glide.resting(*fields.corner(*size)), fade, fields.z or 0.0, blend,
            fields.priority or 0, mask, control=control_of(felt),
        )  # fmt: skip

    def _evaluator(self, material: Feelable) -> Evaluator:
        """Evaluator of a material; textures are copies that are held beyond their edges.

        A copy is kept as long as its texture, which an app may show again.
        """
        evaluator = material if isinstance(material, FrictionField) else material.evaluator
        if not isinstance(evaluator, FrictionField):
            return evaluator
        at = id(evaluator)
        if at in self._held:
            return self._held[at][1]
        held = _held(evaluator)
        if held is not evaluator:
            kept = self._held
            self._held[at] = ref(evaluator, lambda _: kept.pop(at, None)), held.evaluator
        return held.evaluator


def _held(field: FrictionField) -> FrictionField:
    """Return the field with its edge values beyond its edges, since a region's outline cuts it."""
    if isinstance(field, Texture | RecordedProfile) and field.beyond == "outside":
        return replace(field, beyond="hold")
    return field


def _size_of(material: Feelable, name: str) -> float | None:
    size_mm: float | None = getattr(material, name, None)
    if size_mm is None and not isinstance(material, FrictionField):
        size_mm = getattr(material.evaluator, name, None)
    return size_mm


def control_of(material: Any) -> Control | None:
    """Return the material if it has a value, else None."""
    return material if hasattr(type(material), "frame_at") else None


class _FingerOn(NamedTuple):
    touch_id: int
    x_mm: float
    y_mm: float


class Controls:
    """Values of the controls on a layout. Any thread may read and set them."""

    def __init__(self, regions: Regions) -> None:
        self._regions = regions
        self._values: dict[int, float] = {}
        self._fingers: dict[int, _FingerOn] = {}  # by the control's key: the last finger on it

    def report(self, touch_id: int, report: Report) -> None:
        """Take a real report of a finger, on the clock of samples."""
        regions = self._regions
        for region in regions.shown.controls:
            key, control = region.key, region.control
            if control is None or region.opacity.after[0] == 0.0:
                continue
            finger = self._fingers.get(key)
            was_on_it = finger is not None and finger.touch_id == touch_id
            if not (was_on_it or region.is_near(report)):
                continue
            local, on = region.on_outline(report)
            with regions.lock:
                if on:
                    self._fingers[key] = _FingerOn(touch_id, local.x_mm, local.y_mm)
                    inner = region.within(local)
                    self._values[key] = control.value(inner.x_mm, inner.y_mm)
                elif was_on_it:
                    del self._fingers[key]
                    if region.inner is not None:
                        regions.show(key, None)

    def forget(self) -> None:
        """Forget all fingers, when a renderer starts."""
        self._fingers.clear()

    def value(self, key: int) -> float:
        """Value of a control; 0 before a finger or the app has set it.

        Raises `InputError` if the region is no control.
        """
        self._control(key)
        return self._values.get(key, 0.0)

    def push(self, key: int, value: float) -> None:
        """Set the value of a control; a finger on it has that value from then on."""
        control = self._control(key)
        value = number("value", value, 0.0)
        if value > 1:
            raise InputError(f"value: expected 0 to 1, got {value:g}")
        with self._regions.lock:
            self._values[key] = value
            finger = self._fingers.get(key)
            if finger is not None:
                frame = control.frame_at(value, finger.x_mm, finger.y_mm)
                self._regions.show(key, frame)

    def _control(self, key: int) -> Control:
        control = control_of(self._regions.fields(key).material)
        if control is None:
            raise InputError(
                "value: expected a control, such as haptix.feel.Slider; this material has no value"
            )
        return control
