"""A layout's regions and materials as records of a program of a touch; docs/program.md has them."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from math import cos, radians, sin
from typing import get_args

import numpy as np

from haptix.base.errors import InputError
from haptix.feel.layout.layout import Layout
from haptix.feel.layout.region import Blend
from haptix.feel.layout.region_state import RegionState
from haptix.feel.materials import Evaluator, Grating, Noise, Spectral, TargetKind, Texture
from haptix.feel.materials.pyramid import Beyond, Pyramid
from haptix.feel.motion import Depends
from haptix.model.waves import Shape

NONE = 0xFFFFFFFF
"""In place of a number of a material: there is none."""

TARGETS: tuple[TargetKind, ...] = ("mu", "contrast", "share")
"""Numbers of the targets."""

_BLENDS, _BEYOND, _WAVES = get_args(Blend), get_args(Beyond), get_args(Shape)
_UNIFORM, _MAP, _GRATING = range(3)
_OUTLINES = ("rectangle", "ellipse")
_POLYGON = len(_OUTLINES)
_HEAD = "<IIddd"  # of a material: kind, target, value outside, cosine and sine of its direction
_OF_MAP = "6I4d"
_OF_GRATING = "4I8x5d"
MATERIAL_BYTES = 96
REGION_BYTES = 88
_REGION = "<4IiIII7d"


class Sections:
    """Bytes of a file with the places of its parts, each at a multiple of 8.

    Parameters
    ----------
    header_bytes : int
        Size of what comes before the first part.
    """

    def __init__(self, header_bytes: int) -> None:
        self._header_bytes = header_bytes
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
    """What is felt, as records: a material of the background, and regions from the bottom up.

    Parameters
    ----------
    felt : Evaluator
        A layout, as it is at rest, or a single material.
    sections : Sections
        Takes the numbers of maps and gratings.

    Raises
    ------
    InputError
        If a material depends on more than the place, or is of a kind that has no record.
    """

    def __init__(self, felt: Evaluator, sections: Sections) -> None:
        self._sections = sections
        self._records: list[bytes] = []
        self._known: dict[int, int] = {}
        self._kept: list[Evaluator] = []  # so that no other one gets the identity of one
        self.target = felt.target
        """Of all that is felt."""
        regions: Sequence[RegionState] = ()
        if isinstance(felt, Layout):
            below = felt.background
            self.background = (
                self._uniform(below, felt.target)
                if isinstance(below, float)
                else self._material("background", below)
            )
            settled = [region.settled() for region in reversed(felt.store.shown.regions)]
            regions = [region for region in settled if region.opacity.after[0] > 0.0]
        else:
            self.background = self._material("material", felt)
        """Number of the background's material."""
        self.regions = tuple(self._region(_name(felt, region), region) for region in regions)
        """Records of the regions, the lowest first."""

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
        if id(felt) in self._known:
            return self._known[id(felt)]
        if isinstance(felt, Texture):
            sharp = felt.beyond == "outside"
            record = self._map(felt, felt.pyramid, 0.0, felt.pixel_mm if sharp else 0.0)
        elif isinstance(felt, Noise | Spectral):
            record = self._map(felt, felt.pyramid, felt.orientation_deg, 0.0)
        elif isinstance(felt, Grating):
            record = self._grating(felt)
        else:
            raise InputError(f"{name}: {_why_not(felt)}")
        self._known[id(felt)] = len(self._records)
        self._kept.append(felt)
        return self._put(record)

    def _put(self, record: bytes) -> int:
        self._records.append(record.ljust(MATERIAL_BYTES, b"\0"))
        return len(self._records) - 1

    def _uniform(self, value: float, target: TargetKind) -> int:
        return self._put(struct.pack(_HEAD, _UNIFORM, TARGETS.index(target), value, 1.0, 0.0))

    def _head(self, kind: int, felt: Evaluator, orientation_deg: float) -> bytes:
        turn = radians(orientation_deg)
        target = TARGETS.index(felt.target)
        return struct.pack(_HEAD, kind, target, felt.outside, cos(turn), sin(turn))

    def _map(self, felt: Evaluator, map_of: Pyramid, turn_deg: float, sharp_mm: float) -> bytes:
        values = map_of.values
        rows, columns = values.shape
        at = self._sections.add(np.ascontiguousarray(values, dtype="<f4").tobytes())
        beyond_y, beyond_x = (_BEYOND.index(mode) for mode in map_of.modes)
        # Where the edge is a step, its places: the ramp begins half a pixel of the picture inside.
        of_map = struct.pack(
            f"<{_OF_MAP}", at, rows, columns, beyond_x, beyond_y, 0, map_of.pixel_mm, sharp_mm,
            columns * map_of.pixel_mm, rows * map_of.pixel_mm,
        )  # fmt: skip
        return self._head(_MAP, felt, turn_deg) + of_map

    def _grating(self, felt: Grating) -> bytes:
        rows = [table[: int(size)] for table, _, size in felt.tables]
        at = self._sections.add(np.concatenate(rows).astype("<f8").tobytes())
        return self._head(_GRATING, felt, felt.orientation_deg) + struct.pack(
            f"<{_OF_GRATING}", at, len(rows), _WAVES.index(felt.wave), 0,
            felt.period_mm, felt.phase, felt.low, felt.high, felt.duty,
        )  # fmt: skip


def _name(felt: Evaluator, region: RegionState) -> str:
    """Name of a region, or its number in the order in which they were added."""
    assert isinstance(felt, Layout)
    name = felt.regions[region.key].fields.name
    return f"region {region.key}" if name is None else f"region {name!r}"


def _why_not(felt: Evaluator) -> str:
    flags = felt.depends_on
    more = [str(flag.name).lower() for flag in flags & ~Depends.PLACE]
    hint = "haptix.LiveRenderer plays it"
    if more:
        on = " and ".join(more)
        return f"expected friction that depends on the place alone, got one of {on}, too; {hint}"
    return (
        "expected a photograph, heights, noise, a spectral material or a grating, got another "
        f"kind; {hint}"
    )
