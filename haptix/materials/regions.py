"""A layout as a document: materials of every kind in regions of the screen."""

from __future__ import annotations

from functools import cached_property
from typing import Annotated, Literal, Self

from pydantic import Field, PositiveFloat, WithJsonSchema, model_validator

from haptix.documents import Part
from haptix.errors import InputError
from haptix.layout import Layout, Patch
from haptix.materials.material import AnyMaterial, Material
from haptix.materials.still import NumberOrMaterial, field_of
from haptix.texture import TargetKind
from haptix.texture.composition import Blend

Corner = tuple[float, float]


class RegionTable(Part):
    """A material in a region; see `haptix.Layout.add`."""

    name: str | None = None
    material: AnyMaterial
    x_mm: float = 0.0
    y_mm: float = 0.0
    width_mm: PositiveFloat | None = None
    height_mm: PositiveFloat | None = None
    shape: Literal["rectangle", "ellipse"] | Annotated[tuple[Corner, ...], Field(min_length=3)] = (
        "rectangle"
    )
    rotation_deg: float = 0.0
    scale: PositiveFloat = 1.0
    z: float = 0.0
    blend: Blend = "over"
    opacity: Annotated[float, Field(ge=0, le=1)] = 1.0
    mask: AnyMaterial | None = None
    priority: int = 0


class LayoutMaterial(Material):
    """Materials of every kind in regions; see `haptix.Layout`, which its evaluator is.

    Parameters
    ----------
    regions : list of tables
        Each a ``material`` with its place, and what else `haptix.Layout.add` takes; with a ``name``
        it is found by `patch`.
    background : float or material
        Friction below all regions.
    target : {"share", "mu", "contrast"}
        What the answers are.
    """

    kind: Literal["layout"] = "layout"
    regions: tuple[RegionTable, ...] = ()
    background: NumberOrMaterial = 0.0
    target: Annotated[TargetKind, WithJsonSchema({"enum": ["share", "mu", "contrast"]})] = "share"

    @model_validator(mode="after")
    def _has_names_of_its_own(self) -> Self:
        names = [one.name for one in self.regions if one.name is not None]
        if len(set(names)) < len(names):
            raise ValueError("expected regions of different names")
        if self.target == "plain":
            raise ValueError("expected a target of share, mu or contrast")
        return self

    @cached_property
    def evaluator(self) -> Layout:
        """A `haptix.Layout`, which an app may change while it is felt."""
        made = Layout(self.background, self.target)
        for one in self.regions:
            mask = None if one.mask is None else field_of(one.mask)
            made.add(**{key: value for key, value in one if key not in ("name", "mask")}, mask=mask)
        return made

    def patch(self, name: str) -> Patch:
        """Return the patch of a region by its name."""
        names = [one.name for one in self.regions]
        if name not in names:
            raise InputError(f"patch: expected the name of a region, got {name!r:.80}")
        return self.evaluator.patches[1 + names.index(name)]

    @property
    def extent_mm(self) -> tuple[float, float, float, float]:
        """Box around its regions."""
        return self.evaluator.extent_mm
