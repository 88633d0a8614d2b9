"""A layout as a document: materials of every kind in regions of the screen."""

from __future__ import annotations

import math
from functools import cached_property
from typing import Annotated, Any, Literal, Self

from pydantic import PlainSerializer, PlainValidator, WithJsonSchema, model_validator

from haptix.base.checks import plain
from haptix.base.errors import InputError
from haptix.feel.layout import Layout, LayoutRegion, Region
from haptix.feel.materials import TargetKind
from haptix.feel.materials.material import ANY_KIND, Material, material_of, table_of


def _number_or_material(value: Any) -> float | Material:
    number = plain(value)
    return material_of(value) if number is None else number


NumberOrMaterial = Annotated[
    float | Material,
    PlainValidator(_number_or_material),
    PlainSerializer(lambda value: value if isinstance(value, float) else table_of(value)),
    WithJsonSchema({"anyOf": [{"type": "number"}, {"title": ANY_KIND}]}),
]


class LayoutMaterial(Material):
    """Materials of every kind in regions; see `haptix.Layout`, which its evaluator is.

    Parameters
    ----------
    regions : list of tables
        Each a `haptix.feel.Region`; with a ``name`` it is found by `region`.
    background : float or material
        Friction below all regions.
    target : {"share", "mu", "contrast"}
        Quantity of the answers.
    """

    kind: Literal["layout"] = "layout"
    regions: tuple[Region, ...] = ()
    background: NumberOrMaterial = 0.0
    target: Annotated[TargetKind, WithJsonSchema({"enum": ["share", "mu", "contrast"]})] = "share"

    @model_validator(mode="after")
    def _has_names_of_its_own(self) -> Self:
        names = [region.name for region in self.regions if region.name is not None]
        if len(set(names)) < len(names):
            raise ValueError("expected regions of different names")
        if self.target == "plain":
            raise ValueError("expected a target of share, mu or contrast")
        return self

    @cached_property
    def evaluator(self) -> Layout:
        """A `haptix.Layout`, which an app may change while it is felt."""
        layout = Layout(self.background, self.target)
        for region in self.regions:
            layout.put(region)
        return layout

    def region(self, name: str) -> LayoutRegion:
        """Return a region of the layout, by its name, to move or change it."""
        names = [region.name for region in self.regions]
        if name not in names:
            raise InputError(f"region: expected the name of a region, got {name!r:.80}")
        return self.evaluator.regions[1 + names.index(name)]

    @property
    def extent_mm(self) -> tuple[float, float, float, float]:
        """Box around its regions."""
        return self.evaluator.extent_mm


_PLACE_MM = (0.0, 45.0, 0.0, 30.0)
"""Place that is shown of what has no edges: left, right, top, bottom."""


def shown_place_mm(felt: Material) -> tuple[float, float, float, float]:
    """Return where a material is shown: its extent, and a layout's around its regions."""
    place = felt.extent_mm
    left, right, top, bottom = place
    if not (math.isfinite(right - left + bottom - top) and right > left and bottom > top):
        return _PLACE_MM
    if isinstance(felt, LayoutMaterial) and not isinstance(felt.background, float | int):
        boxes = zip(place, _PLACE_MM, (min, max, min, max), strict=True)
        left, right, top, bottom = (chosen(one, other) for one, other, chosen in boxes)
    return left, right, top, bottom
