"""The regions of a layout, how they change, and how those near a finger are found."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import chain
from math import inf
from typing import Any, Self

import numpy as np
from pydantic import ValidationError

from haptix.checks import Array
from haptix.documents import first_error
from haptix.errors import InputError
from haptix.layout.region_state import Control, Glide, Outline, RegionState
from haptix.motion import Depends, LocalFrame
from haptix.region import RegionFields
from haptix.texture import (
    Evaluator,
    Feelable,
    FrictionField,
    RecordedProfile,
    Texture,
    check_feelable,
)
from haptix.texture.material import AnyMaterial

LOOPED = 12  # regions up to which asking each is faster than asking numpy for all

FADE_S = 0.005
"""Time in which what comes fades in, and what goes fades out."""

GLIDE_S = 0.02
"""Time in which a region moves: reports of a drag come each 8 to 16 ms."""

_KEPT = 64  # textures, held beyond their edges


@dataclass(frozen=True, slots=True)
class Shown:
    """Regions at one state of a layout; it never changes, a change replaces it.

    Parameters
    ----------
    regions : tuple of RegionState
        The highest first.
    ways : ndarray, shape (4, regions), optional
        Of many regions: left, right, top and bottom of the way of each.
    evaluators : tuple of Evaluator
        Of all regions, each once.
    multiplies : bool
        Whether any region multiplies what is below it.
    has_priorities : bool
        Whether any region has a priority.
    controls : tuple of RegionState
        Those whose material has a value.
    """

    regions: tuple[RegionState, ...] = ()
    ways: Array | None = None
    evaluators: tuple[Evaluator, ...] = ()
    multiplies: bool = False
    has_priorities: bool = False
    controls: tuple[RegionState, ...] = ()

    @classmethod
    def of(cls, regions: Sequence[RegionState]) -> Self:
        """Take regions, the highest first."""
        return cls(
            tuple(regions),
            np.array([one.way for one in regions]).T if len(regions) > LOOPED else None,
            tuple({id(one.evaluator): one.evaluator for one in regions}.values()),
            any(one.blend == "multiply" for one in regions),
            any(one.priority for one in regions),
            tuple(one for one in regions if one.control is not None),
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
            tuple(region if one is self.regions[at] else one for one in self.controls),
        )  # fmt: skip

    def near(self, left: float, right: float, top: float, bottom: float) -> Sequence[RegionState]:
        """Return at least those whose way meets a box [mm], the highest first; of few, all."""
        ways = self.ways
        if ways is None:
            return self.regions
        apart = (ways[0] > right) | (ways[1] < left) | (ways[2] > bottom) | (ways[3] < top)
        return [self.regions[at] for at in np.flatnonzero(~apart).tolist()]

    @property
    def drives_at_rest(self) -> bool:
        """Whether any region is felt at rest."""
        return any(one.drives_at_rest for one in self.evaluators)


class Region(RegionFields):
    """A material in a region of a layout.

    Parameters
    ----------
    name : str, optional
        By which `LayoutMaterial.patch` finds it.
    material : FrictionField or Material
        What is felt there; its origin lies at the region's corner.
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
        """Width and height before it is scaled: its own, or those of its material."""

        def size(name: str) -> float:
            size_mm: float | None = getattr(self, name) or _own_size(self.material, name)
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
        """By their keys; of those that have not been removed."""
        self.now: Callable[[], float] = lambda: -inf
        """The first time [s] that can still be changed."""
        self._changed: Callable[[], None] = lambda: None
        self._draft: list[RegionState] | None = None
        self._last_at: dict[int, int] = {}  # by key: where it was found last
        self._depth = 0
        self._given: dict[int, Region] = {}
        self._held: dict[int, tuple[Feelable, Evaluator]] = {}
        self._keys = 0

    def attach(self, now: Callable[[], float], changed: Callable[[], None]) -> None:
        """Take a clock, and whom to tell of changes."""
        with self.lock:
            self.now, self._changed = now, changed
            # What came, went and moved by another clock has done so.
            self.shown = Shown.of(
                [one.settled() for one in self.shown.regions if one.opacity.after[0]]
            )

    @contextmanager
    def change(self) -> Iterator[None]:
        """Gather changes; on an error, none of them counts."""
        with self.lock:
            self._depth += 1
            if self._depth == 1:
                now_s = self.now()
                self._draft = [one for one in self.shown.regions if not one.is_gone(now_s)]
                before = dict(self._given), dict(self.materials)
            try:
                yield
                if self._depth == 1 and self._draft is not None:
                    self.shown = Shown.of(self._draft)
            except BaseException:
                if self._depth == 1:
                    self._given, self.materials = before
                raise
            finally:
                self._depth -= 1
                is_last = self._depth == 0
                if is_last:
                    self._draft = None
        if is_last:
            self._changed()

    def add(self, given: Region) -> int:
        """Add a region and return its key."""
        with self.change():
            self._keys += 1
            self._put(self._keys, given, self.now())
            return self._keys

    def has(self, key: int) -> bool:
        """Whether there is such a region."""
        return key in self._given

    def given(self, key: int) -> Region:
        """Return what a region was given; `InputError` if it is gone."""
        try:
            return self._given[key]
        except KeyError:
            raise InputError("patch: expected one that is on its layout; it was removed") from None

    def clear(self) -> None:
        """Remove all regions."""
        with self.change():
            for key in list(self._given):
                self.remove(key)

    def remove(self, key: int) -> None:
        """Fade a region out."""
        with self.change():
            now_s = self.now()
            self._fade(key, now_s, now_s)
            self._given.pop(key, None)
            self.materials.pop(key, None)
            self._last_at.pop(key, None)

    def move(self, key: int, values: dict[str, Any], over_s: float) -> None:
        """Move a region along a line, to another corner, rotation or scale."""
        with self.lock:
            region = self._given[key] = self.given(key).replace(**values)
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
        """Return the place of a region in the order, of the one that stays; None if none does."""
        regions = self.shown.regions if self._draft is None else self._draft
        # Mostly where it was: so a move costs the same among many.
        for at in chain((self._last_at.get(key, 0),), range(len(regions))):
            state = regions[at] if at < len(regions) else None
            if state is not None and state.key == key and state.opacity.after[0] > 0.0:
                self._last_at[key] = at
                return at
        return None

    def set(self, key: int, changes: dict[str, Any]) -> None:
        """Change what a region was given, in a cross-fade."""
        with self.change():
            if "material" in changes:
                check_feelable("material", changes["material"])
            region = self.given(key).replace(**changes)
            inner = None if "material" in changes else self._last_of(key)[0]
            self._replace(key, region, inner)

    def show(self, key: int, inner: LocalFrame | None) -> None:
        """Show the material of a region in other axes, in a cross-fade."""
        with self.change():
            self._replace(key, self.given(key), inner)

    def _replace(self, key: int, given: Region, inner: LocalFrame | None) -> None:
        now_s, (_, state) = self.now(), self._last_of(key)
        # What is covered by an opaque one goes when that has come; others fade meanwhile.
        is_opaque = given.opacity in (None, 1.0) and given.mask is None
        covered = is_opaque and given.blend in (None, "over")
        self._fade(key, now_s, now_s + FADE_S if covered else now_s)
        self._put(key, given, now_s, inner, state + 1)

    def _last_of(self, key: int) -> tuple[LocalFrame | None, int]:
        """Return the axes in which a region shows its material, and the number of that state."""
        if self._draft is None or (at := self._find(key)) is None:
            return None, 0  # opacity 0
        return self._draft[at].inner, self._draft[at].state

    def _put(
        self,
        key: int,
        given: Region,
        now_s: float,
        inner: LocalFrame | None = None,
        state: int = 0,
    ) -> None:
        """Add a region, fading in: of one height, those that were added later lie on top."""
        region = replace(self._region(key, given, now_s), inner=inner, state=state)
        self._given[key] = given
        self.materials[key] = given.material
        draft = self._draft or []
        draft.insert(sum((one.z, one.key) > (region.z, key) for one in draft), region)
        self._draft = draft

    def _fade(self, key: int, now_s: float, from_s: float) -> None:
        """Fade a region out, from a time on; what covers it until then hides its end."""
        kept: list[RegionState] = []
        for region in self._draft or []:
            if region.key == key and region.opacity.after[0] > 0.0:
                if region.opacity.at(now_s)[0] == 0.0:
                    continue  # it has not begun to show: in a pause, changes do not pile up
                over_s = 0.0 if from_s > now_s else FADE_S
                now = region.opacity.at(from_s)
                region = replace(region, opacity=Glide(now, (0.0,), from_s, from_s + over_s))
            kept.append(region)
        self._draft = kept

    def _region(self, key: int, given: Region, now_s: float) -> RegionState:
        evaluator = self._evaluator(given.material)
        blend = given.blend or "over"
        if blend == "multiply" and evaluator.target != "share":
            raise InputError(
                f"blend: a region that multiplies is a share, got a material of {evaluator.target}"
            )
        mask = None
        if given.mask is not None:
            mask = self._evaluator(given.mask)
            if mask.target != "share" or Depends.FACTS in mask.depends_on:
                raise InputError(
                    "mask: expected shares that no event of the finger changes, got a material of "
                    f"{mask.target}"
                )
        size = given.size_mm
        opacity = 1.0 if given.opacity is None else given.opacity
        fade = Glide((0.0,), (opacity,), now_s, now_s + FADE_S)
        return RegionState(
            key, evaluator, Outline(*size, given.shape or "rectangle"),
            Glide.resting(*given.corner(*size)), fade, given.z or 0.0, blend, given.priority or 0,
            mask, control=control_of(given.material),
        )  # fmt: skip

    def _evaluator(self, material: Feelable) -> Evaluator:
        """What answers for a material; textures are held beyond their edges, made once."""
        evaluator = material if isinstance(material, FrictionField) else material.evaluator
        if not isinstance(evaluator, FrictionField):
            return evaluator
        known = self._held.pop(id(evaluator), None)
        if known is None:
            known = (evaluator, _held(evaluator).evaluator)
        self._held[id(evaluator)] = known
        if len(self._held) > _KEPT:
            del self._held[next(iter(self._held))]
        return known[1]


def _held(field: FrictionField) -> FrictionField:
    """Return the field, held beyond its edges: a region ends at its outline."""
    if isinstance(field, Texture | RecordedProfile) and field.beyond == "outside":
        return replace(field, beyond="hold")
    return field


def _own_size(material: Feelable, name: str) -> float | None:
    size_mm: float | None = getattr(material, name, None)
    if size_mm is None and not isinstance(material, FrictionField):
        size_mm = getattr(material.evaluator, name, None)
    return size_mm


def control_of(material: Any) -> Control | None:
    """Return a material that has a value; None for others."""
    return material if hasattr(type(material), "frame_at") else None
