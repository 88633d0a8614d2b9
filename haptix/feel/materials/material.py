"""The base of all materials, and how their documents are read."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Self

import tomlkit
from pydantic import ConfigDict, PlainSerializer, PlainValidator, WithJsonSchema, model_validator

from haptix.base.checks import Array, shown
from haptix.base.errors import InputError
from haptix.base.files import check_schema_version, json_text, read_json, read_toml, write_whole
from haptix.base.kinds import Kind, Kinds, document_path, in_folder
from haptix.base.units import with_numbers
from haptix.feel.materials.field import Evaluator, Mapped, TargetKind, check_range
from haptix.feel.materials.patterns import SUFFIXES, fields_of
from haptix.feel.motion import Depends, Facts, Motion, Report
from haptix.feel.motion.block import React, unmoved

_MODULES = {
    "feel.layout.layout_material": ("layout",),
    "feel.materials.by_curve": ("by-force", "by-speed"),
    "feel.materials.controls": ("button", "dial", "slider", "toggle"),
    "feel.materials.grating": ("grating",),
    "feel.materials.moving": ("moving",),
    "feel.materials.penn": ("penn",),
    "feel.materials.recorded": ("recording",),
    "feel.materials.relief": ("relief",),
    "feel.materials.spectral": ("noise", "spectral"),
    "feel.materials.texture": ("heights", "photograph"),
    "feel.materials.timeline": ("effect", "envelope", "transient"),
}
KINDS = Kinds(
    "haptix.feel.materials",
    {kind: f"haptix.{module}" for module, kinds in _MODULES.items() for kind in kinds},
)
"""Every kind of material by its name in documents; a subclass registers itself."""


ANY_KIND = "a material of any kind"
"""Placeholder for all kinds in schemas: pydantic has no reference to kinds registered later."""


class Material(Mapped, Kind):
    """The feel of a surface: a document that answers for blocks of motion.

    A subclass is one kind. It gives `kind` its name, adds fields, and defines `wanted`, or
    `evaluator` where answers need something made once. It lists what it depends on. Answers are
    shares of the reachable friction unless a field ``target`` says otherwise, 0 outside unless
    there is a field ``outside``. A package brings a kind with an entry point of the group
    ``haptix.feel.materials``.

    Raises
    ------
    InputError
        If a field is unknown, missing or outside its range.
    """

    model_config = ConfigDict(ignored_types=(Depends,))

    kinds: ClassVar[Kinds] = KINDS
    if TYPE_CHECKING:
        kind: Any  # of a class, its own name alone
    depends_on: ClassVar[Depends] = Depends.PLACE
    drives_at_rest: ClassVar[bool] = False
    """If true, the renderer does not fade the drive out at rest; the material has to do it."""

    @classmethod
    def __pydantic_init_subclass__(cls, **kwargs: Any) -> None:
        is_mute = cls.wanted is Material.wanted and cls.evaluator is Material.evaluator
        if is_mute and isinstance(cls.model_fields["kind"].default, str):
            raise TypeError(f"{cls.__name__}: expected a method wanted(motion), or evaluator")
        super().__pydantic_init_subclass__(**kwargs)

    @cached_property
    def evaluator(self) -> Evaluator:
        """The object that gives this material's friction; it is made once."""
        return Answering(
            self.wanted,
            getattr(self, "target", "share"),
            getattr(self, "outside", 0.0),
            self.depends_on,
            self.drives_at_rest,
            self.react,
            self,
        )

    def wanted(self, motion: Motion) -> Array:
        """Friction wanted under the fingers, of the motion's shape; any thread may call it."""
        return self.evaluator.wanted(motion)

    def react(self, facts: Facts, before: Report | None, now: Report) -> Facts:
        """Return the finger's facts after a report; if `before` is None, it has just come down.

        Parameters
        ----------
        facts : Facts
            Past events of the finger.
        before : Report or None
            The report before; None when it comes down.
        now : Report
            The new report.
        """
        return facts

    @property
    def extent_mm(self) -> tuple[float, float, float, float]:
        """Left, right, top and bottom of the part that is worth drawing, in its axes."""
        of = getattr(self, "of", None)
        return of.extent_mm if isinstance(of, Material) else super().extent_mm

    def save(self, path: str | Path) -> None:
        """Write a document that `load` reads back; paths of assets are relative to its folder."""
        path = Path(path)
        with in_folder(path.parent):
            fields = {"schema_version": 1, **self.describe()}
        is_json = path.suffix == ".json"
        write_whole(path, json_text(fields) if is_json else tomlkit.dumps(fields))


@dataclass(frozen=True)
class Answering:
    """A `haptix.feel.Evaluator` whose properties and methods are passed to it."""

    wanted: Callable[[Motion], Array]
    target: TargetKind = "share"
    outside: float = 0.0
    depends_on: Depends = Depends.PLACE
    drives_at_rest: bool = False
    react: React = unmoved
    material: Material | None = None
    """The document that it answers for."""


def load(path: str | Path) -> Material:
    """Read a material from TOML or JSON; its ``kind`` says which, see `KINDS`.

    Patterns of other programs (``.ahap``, ``.haptic``, ``.hjif``) are read as what of them is
    friction, see `haptix.feel.materials.patterns`.

    Numbers may be strings with units, such as "2 mm".

    Raises
    ------
    FileFormatError
        If the file is missing, is not TOML or JSON, or is of a later schema.
    InputError
        If the kind or a field is unknown, missing or outside its range.
    """
    if not isinstance(path, str | os.PathLike):
        raise InputError(f"load: expected the path of a document, got {shown(path)}")
    path = Path(path)
    try:
        if path.suffix in SUFFIXES:
            fields = fields_of(path)
        else:
            fields = read_json(path) if path.suffix == ".json" else read_toml(path)
        check_schema_version(path, fields.pop("schema_version", 1))
        with in_folder(path.parent):
            return material_of(fields)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def material_of(table: Any) -> Material:
    """Return a material: itself, or read from a table or from a file (.toml or .json).

    Other objects with an evaluator, such as a `haptix.Texture`, are accepted too, but cannot be
    written to a document.

    Parameters
    ----------
    table : Material, mapping, str or Path
        A material, its table, or the path of a file. Numbers may be strings with units.

    Examples
    --------
    >>> material_of({"kind": "grating", "period_mm": "0.2 cm"}).period_mm
    2.0
    """
    if isinstance(table, str):
        return load(document_path(table))
    if not isinstance(table, Mapping):
        # Look at the class first: reading the instance's property may compute much.
        if not (hasattr(type(table), "evaluator") or hasattr(table, "evaluator")):
            raise InputError(f'material: expected a table with a "kind", got {table!r:.80}')
        existing: Material = table
        return existing
    material: Material = KINDS.read("material", with_numbers("material", table))
    return material


def table_of(material: Any) -> Any:
    """Table of a material within a document."""
    if not isinstance(material, Material):
        raise InputError(
            f"material: a {type(material).__name__} made in a program cannot be written; "
            "use its document, such as a photograph"
        )
    return material.describe()


AnyMaterial = Annotated[
    Material,
    PlainValidator(material_of),
    PlainSerializer(table_of),
    WithJsonSchema({"title": ANY_KIND}),
]
"""A field that holds any material: itself, its table, or the path of its file."""


class Scaled(Material):
    """Base of kinds whose levels 0 and 1 become friction.

    Parameters
    ----------
    target : {"share", "mu", "contrast"}
        Quantity of `low` and `high`: shares of the reach of the screen, friction coefficients, or
        relative changes of friction; see `haptix.feel.as_mu`.
    low, high : float
        Friction at the lowest and at the highest level.
    """

    target: Annotated[TargetKind, WithJsonSchema({"enum": ["share", "mu", "contrast"]})] = "share"
    low: float = 0.0
    high: float = 1.0

    @model_validator(mode="after")
    def _is_a_range(self) -> Self:
        if self.target == "plain":
            raise ValueError("expected a target of share, mu or contrast")
        if self.target != "share" and not {"low", "high"} <= self.model_fields_set:
            raise ValueError(f"expected low and high for a target of {self.target}")
        check_range("low, high", self.target, self.low, self.high)
        return self

    @property
    def outside(self) -> float:
        """Friction of level 0."""
        return self.low

    def scaled(self, level: Array) -> Array:
        """Friction of levels."""
        return self.low + (self.high - self.low) * level
