"""The regions of a layout, and how they change."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from itertools import chain
from math import inf
from typing import Any

from pydantic import ValidationError

from haptix.documents import first_error
from haptix.errors import InputError
from haptix.layout.glide import Glide
from haptix.layout.outlines import Outline
from haptix.layout.region import Control, RegionState
from haptix.layout.shown import Shown
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

FADE_S = 0.005
"""Time in which what comes fades in, and what goes fades out."""

GLIDE_S = 0.02
"""Time in which a region moves: reports of a drag come each 8 to 16 ms."""

_KEPT = 64  # textures, held beyond their edges


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
            own: float | None = getattr(self, name) or _own_size(self.material, name)
            if own is None:
                raise InputError(f"{name}: expected a size, since the material has none")
            return own

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
            given = self._given[key] = self.given(key).replace(**values)
            draft = self._draft
            if (at := self._find(key)) is not None:
                one = (self.shown.regions if draft is None else draft)[at]
                moved = one.moved(one.place.to(given.corner(*given.size_mm), self.now(), over_s))
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
            one = regions[at] if at < len(regions) else None
            if one is not None and one.key == key and one.opacity.after[0] > 0.0:
                self._last_at[key] = at
                return at
        return None

    def set(self, key: int, changes: dict[str, Any]) -> None:
        """Change what a region was given, in a cross-fade."""
        with self.change():
            if "material" in changes:
                check_feelable("material", changes["material"])
            given = self.given(key).replace(**changes)
            inner = None if "material" in changes else self._last_of(key)[0]
            self._replace(key, given, inner)

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
    found: float | None = getattr(material, name, None)
    if found is None and not isinstance(material, FrictionField):
        found = getattr(material.evaluator, name, None)
    return found


def control_of(material: Any) -> Control | None:
    """Return a material that has a value; None for others."""
    return material if hasattr(type(material), "frame_at") else None
