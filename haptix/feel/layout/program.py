"""A layout's regions and materials as records of a program of a touch; docs/program.md has them."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from math import cos, pi, radians, sin
from typing import Any, get_args

import numpy as np

from haptix.base.errors import InputError
from haptix.feel.layout.layout import Layout
from haptix.feel.layout.region import Blend
from haptix.feel.layout.region_state import RegionState
from haptix.feel.materials import (
    Button,
    ByForce,
    BySpeed,
    Dial,
    Envelope,
    Evaluator,
    Grating,
    Moving,
    Noise,
    Relief,
    Slider,
    Spectral,
    TargetKind,
    Texture,
    Toggle,
    Transient,
    WebEffect,
)
from haptix.feel.materials.material import Answering
from haptix.feel.materials.pyramid import Beyond, Pyramid
from haptix.feel.materials.timeline import RATE_HZ, Begins, Timeline
from haptix.feel.motion import LocalFrame
from haptix.model.waves import Shape

NONE = 0xFFFFFFFF
"""In place of a number of a material: there is none."""

TARGETS: tuple[TargetKind, ...] = ("mu", "contrast", "share")
"""Numbers of the targets."""

_BLENDS, _BEYOND, _WAVES = get_args(Blend), get_args(Beyond), get_args(Shape)
_BEGINS = get_args(Begins)
(
    _UNIFORM, _MAP, _GRATING, _SLIDER, _TOGGLE, _DIAL, _RELIEF, _BY_SPEED, _BY_FORCE, _CURVE,
    _MOVING, _BUTTON,
) = range(12)  # fmt: skip
_OUTLINES = ("rectangle", "ellipse")
_POLYGON = len(_OUTLINES)
# Of a material: kind, target, value outside, cosine and sine of its direction; place of its
# numbers and how many, or rows and columns, and what its kind has there; its own numbers.
_MATERIAL = "<IIddd6I"
_OWN_REALS = 9
_REGION = "<4IiIII7d"


class Sections:
    """Bytes of a file with the places of its parts, each at a multiple of 8.

    Parameters
    ----------
    header_bytes : int
        Size of what comes before the first part.
    """

    def __init__(self, header_bytes: int) -> None:
        self._parts: list[bytes] = []
        self.size = header_bytes
        """Size of the file."""

    def add(self, part: bytes) -> int:
        """Append a part and return its place."""
        at = self.size
        padded = part + bytes(-len(part) % 8)
        self._parts.append(padded)
        self.size += len(padded)
        return at

    @property
    def parts(self) -> bytes:
        """All parts, without the header."""
        return b"".join(self._parts)


class FeltRecords:
    """A layout as records: a material of the background, and regions from the bottom up.

    Parameters
    ----------
    felt : Evaluator
        A layout, as it is at rest, or a single material.
    sections : Sections
        Takes the numbers of maps and gratings.
    moving : bool
        Keep the regions that fade out and those that are shown in other axes, whose numbers
        `moving` has; without it, all are written as they will be at rest.
    kept : sequence of (Evaluator, int)
        Materials whose maps are taken over from a program before, and their numbers in it.

    Raises
    ------
    InputError
        If a material is of a kind that has no record.
    """

    def __init__(
        self,
        felt: Evaluator,
        sections: Sections,
        moving: bool = False,
        kept: Sequence[tuple[Evaluator, int]] = (),
    ) -> None:
        self._sections = sections
        self._records: list[bytes] = []
        self._known: dict[int, int] = {}
        self._written: list[Evaluator] = []  # so that no other one gets the identity of one
        self._kept = {id(felt): number for felt, number in kept}
        self.maps: list[tuple[Evaluator, int]] = []
        """Materials with maps, and their numbers."""
        self.target = felt.target
        """Of all that is felt."""
        self.is_layout = isinstance(felt, Layout)
        """Whether regions, and no single material, take what fingers do."""
        shown: Sequence[RegionState] = ()
        if isinstance(felt, Layout):
            below = felt.background
            self.background = (
                self._uniform(below, felt.target)
                if isinstance(below, float)
                else self._material("background", below)
            )
            shown = [
                region
                for region in reversed(felt.store.shown.regions)
                if moving or region.opacity.after[0] > 0.0
            ]
        else:
            self.background = self._material("material", felt)
        """Number of the background's material."""
        self.regions = tuple(self._region(_name(felt, region), region) for region in shown)
        """Records of the regions, the lowest first."""
        self.glides = tuple(_glide(region) for region in shown) if moving else ()
        """The numbers of an ``hx_glide`` of each region."""

    @property
    def materials(self) -> Sequence[bytes]:
        """Records of the materials."""
        return self._records

    def _region(self, name: str, region: RegionState) -> bytes:
        material = self._material(name, region.evaluator)
        mask = NONE if region.mask is None else self._material(f"mask of {name}", region.mask)
        outline, corners_at, corners = region.outline, 0, 0
        if isinstance(outline.shape, str):
            shape = _OUTLINES.index(outline.shape)
        else:
            shape, corners = _POLYGON, len(outline.shape)
            corners_at = self._sections.add(np.array(outline.shape, dtype="<f8").tobytes())
        return struct.pack(
            _REGION, material, mask, shape, _BLENDS.index(region.blend), region.priority, corners,
            corners_at, 0, *region.place.after, outline.width_mm, outline.height_mm,
            region.opacity.after[0],
        )  # fmt: skip

    def _material(self, name: str, felt: Evaluator) -> int:
        """Number of a material's record; each is written once."""
        if id(felt) not in self._known:
            self._known[id(felt)] = self._record(name, felt)
            self._written.append(felt)
        return self._known[id(felt)]

    def _record(self, name: str, felt: Evaluator) -> int:
        if isinstance(felt, Texture):
            sharp = felt.beyond == "outside"
            return self._map(felt, felt.pyramid, 0.0, felt.pixel_mm if sharp else 0.0)
        if isinstance(felt, Noise | Spectral):
            return self._map(felt, felt.pyramid, felt.orientation_deg, 0.0)
        if isinstance(felt, Grating):
            return self._grating(felt)
        material = felt.material if isinstance(felt, Answering) else None
        writers: dict[type, Any] = {
            Slider: self._slider, Toggle: self._toggle, Dial: self._dial, Relief: self._relief,
            BySpeed: self._by_curve, ByForce: self._by_curve, Envelope: self._envelope,
            Moving: self._moving, Button: self._button, Transient: self._from_event,
            WebEffect: self._from_event,
        }  # fmt: skip
        # By the very class: one that is derived from it may ask for something else.
        if (write := writers.get(type(material))) is None:
            raise InputError(f"{name}: {_why_not(felt)}")
        return int(write(name, felt, material))

    def _put(
        self,
        kind: int,
        felt: Evaluator,
        *own: float,
        words: Sequence[int] = (),
        turn_deg: float = 0.0,
        numbers: Any = None,
    ) -> int:
        """Write a record: `words` behind the place of its numbers, then those of its own."""
        at, turn, is_map = 0, radians(turn_deg), kind in (_MAP, _RELIEF)
        if is_map:
            self.maps.append((felt, len(self._records)))
        kept = self._kept.get(id(felt))
        if numbers is not None and kept is None:
            at = self._sections.add(
                np.asarray(numbers).astype("<f4" if is_map else "<f8").tobytes()
            )
        self._records.append(
            struct.pack(
                _MATERIAL, kind, TARGETS.index(felt.target), felt.outside, cos(turn), sin(turn),
                at, *words, *(0,) * (4 - len(words)), kept or 0,
            )
            + struct.pack(f"<{_OWN_REALS}d", *own, *(0.0,) * (_OWN_REALS - len(own)))
        )  # fmt: skip
        return len(self._records) - 1

    def _map(self, felt: Evaluator, map_of: Pyramid, turn_deg: float, sharp_mm: float) -> int:
        rows, columns = map_of.values.shape
        beyond_y, beyond_x = (_BEYOND.index(mode) for mode in map_of.modes)
        # Where the edge is a step, its places: the ramp begins half a pixel of the picture inside.
        return self._put(
            _MAP, felt, map_of.pixel_mm, sharp_mm, columns * map_of.pixel_mm,
            rows * map_of.pixel_mm, words=(rows, columns, beyond_x, beyond_y), turn_deg=turn_deg,
            numbers=map_of.values,
        )  # fmt: skip

    def _grating(self, felt: Grating) -> int:
        return self._put(
            _GRATING, felt, felt.period_mm, felt.phase, felt.low, felt.high, felt.duty,
            words=(len(felt.tables), _WAVES.index(felt.wave)), turn_deg=felt.orientation_deg,
            numbers=np.concatenate(felt.tables),
        )  # fmt: skip

    def _slider(self, name: str, felt: Evaluator, of: Slider) -> int:
        return self._put(
            _SLIDER, felt, of.low, of.high, of.ridge_mm, words=(len(of.places_mm),),
            turn_deg=of.orientation_deg, numbers=of.places_mm,
        )  # fmt: skip

    def _toggle(self, name: str, felt: Evaluator, of: Toggle) -> int:
        sizes = (of.ridge_mm, of.width_mm, of.throw_mm)
        return self._put(_TOGGLE, felt, of.low, of.high, *sizes)

    def _dial(self, name: str, felt: Evaluator, of: Dial) -> int:
        sizes = (of.ridge_mm, of.inner_mm, of.outer_mm, *of.centre_mm)
        return self._put(_DIAL, felt, of.low, of.high, *sizes, words=(of.detents,))

    def _relief(self, name: str, felt: Evaluator, of: Relief) -> int:
        slopes = of.slopes
        values, pixel_mm = slopes.pyramid.values, slopes.pyramid.pixel_mm
        return self._put(
            _RELIEF, felt, of.low, of.high, of.edge_mm, slopes.width_mm, slopes.height_mm, of.bias,
            pixel_mm, words=values.shape, numbers=[values.real, values.imag],
        )  # fmt: skip

    def _by_curve(self, name: str, felt: Evaluator, of: BySpeed | ByForce) -> int:
        corners, values = of.points
        kind = _BY_SPEED if isinstance(of, BySpeed) else _BY_FORCE
        changed = NONE if of.of is None else self._material(name, of.of.evaluator)
        return self._put(kind, felt, words=(len(corners), changed), numbers=[corners, values])

    def _envelope(self, name: str, felt: Evaluator, of: Envelope) -> int:
        return self._curve(felt, of.timeline, of.begins, self._material(name, of.of.evaluator))

    def _from_event(self, name: str, felt: Evaluator, of: Transient | WebEffect) -> int:
        return self._curve(felt, of.timeline, of.begins, NONE)

    def _curve(self, felt: Evaluator, line: Timeline, begins: Begins, changed: int) -> int:
        return self._put(
            _CURVE, felt, round(line.t_s[0] * RATE_HZ), RATE_HZ, line.period_s or 0.0,
            words=(len(line.value), changed, _BEGINS.index(begins)), numbers=line.value,
        )  # fmt: skip

    def _button(self, name: str, felt: Evaluator, of: Button) -> int:
        sizes = (of.rim_mm, of.width_mm, of.height_mm, of.press_n, of.release_n)
        return self._put(_BUTTON, felt, of.low, of.high, *sizes)

    def _moving(self, name: str, felt: Evaluator, of: Moving) -> int:
        changed, path = self._material(name, of.of.evaluator), of.path
        knots, loops, numbers = 0, False, None
        if path is not None:
            knots, loops, numbers = len(path.t_s), path.loop, np.vstack(path.columns)
        return self._put(
            _MOVING, felt, *of.velocity_mm_s, of.turn_deg_s * pi / 180, *of.about_mm,
            words=(knots, changed, int(loops)), numbers=numbers,
        )  # fmt: skip

    def _uniform(self, value: float, target: TargetKind) -> int:
        return self._put(_UNIFORM, Answering(lambda motion: motion.x_mm, target, value))


def _glide(region: RegionState) -> tuple[Any, ...]:
    place, opacity, inner = region.place, region.opacity, region.inner or LocalFrame()
    return (
        place.before, place.start_s, place.end_s, *opacity.before, opacity.start_s, opacity.end_s,
        (inner.x_mm, inner.y_mm, inner.angle_rad, inner.scale), region.way, region.core,
        region.is_level, region.key, region.state,
    )  # fmt: skip


def _name(felt: Evaluator, region: RegionState) -> str:
    """Name of a region, or its number in the order in which they were added."""
    assert isinstance(felt, Layout)
    placed = felt.regions.get(region.key)
    name = placed.fields.name if placed is not None and placed.is_there else None
    return f"region {region.key}" if name is None else f"region {name!r}"


def _why_not(felt: Evaluator) -> str:
    kind = type(felt).__name__
    return (
        f"expected a kind of material that is haptix's own and no layout, got {kind}; "
        "haptix.LiveRenderer plays it"
    )
