"""The base of all materials, and the registry of their kinds."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from functools import cached_property
from hashlib import sha256
from pathlib import Path
from typing import Annotated, Any, ClassVar, Self

import tomlkit
from pydantic import (
    ConfigDict,
    PlainSerializer,
    PlainValidator,
    ValidationError,
    WithJsonSchema,
    model_validator,
)

from haptix.checks import Array, choice, shown
from haptix.documents import Part, first_error
from haptix.errors import FileFormatError, InputError
from haptix.files import json_text, read_json, read_toml, write_whole
from haptix.motion import Depends, Facts, Motion, Report
from haptix.texture import Evaluator, TargetKind
from haptix.texture.field import check_range
from haptix.units import with_numbers

KINDS: dict[str, type[Material]] = {}
"""Every kind of material by its name in documents; a subclass enters itself."""

React = Callable[[Facts, Report | None, Report], Facts]

ANY_KIND = "a material of any kind"
"""Stands in schemas for all kinds: pydantic knows no reference to what is registered later."""

_FOLDER: ContextVar[Path] = ContextVar("folder", default=Path())
_IS_SEALED: ContextVar[bool] = ContextVar("sealed", default=False)
_BY_CONTENT: ContextVar[bool] = ContextVar("by_content", default=False)


@contextmanager
def in_folder(folder: Path, is_sealed: bool = False) -> Iterator[None]:
    """Read and write documents whose paths are relative to a folder.

    A sealed folder is that of somebody else's documents: they name files by their hash only.
    """
    token, seal = _FOLDER.set(folder), _IS_SEALED.set(is_sealed)
    try:
        yield
    finally:
        _FOLDER.reset(token)
        _IS_SEALED.reset(seal)


@contextmanager
def by_content() -> Iterator[None]:
    """Write documents whose files are named by the hash of their content, wherever they lie."""
    token = _BY_CONTENT.set(True)
    try:
        yield
    finally:
        _BY_CONTENT.reset(token)


class ByFields(Part):
    """A part that is compared by its fields: not by what properties have kept of them."""

    def __eq__(self, other: object) -> bool:
        return isinstance(other, ByFields) and self._key == other._key

    def __hash__(self) -> int:
        return hash(self._key)

    @property
    def _key(self) -> tuple[Any, ...]:
        return (type(self), *self.values_of_fields().values())

    def values_of_fields(self) -> dict[str, Any]:
        """Values by the names of the fields."""
        return {name: getattr(self, name) for name in type(self).model_fields}


class Material(ByFields):
    """What a surface feels like: a document that answers for blocks of motion.

    A subclass is one kind. It gives `kind` its name, adds fields, and defines `wanted`, or
    `evaluator` where answers need something made once. It also says what it depends on. Answers are
    shares of the reachable friction unless a field ``target`` says otherwise, 0 outside unless
    there is a field ``outside``.

    Raises
    ------
    InputError
        If a field is unknown, missing or outside its range.
    """

    model_config = ConfigDict(ignored_types=(Depends,))

    depends_on: ClassVar[Depends] = Depends.PLACE
    drives_at_rest: ClassVar[bool] = False
    """True: the renderer does not fade the drive out at rest, the material does where it should."""

    kind: str

    def __init__(self, /, *values: Any, **fields: Any) -> None:
        if values:
            names = [name for name in type(self).model_fields if name != "kind"]
            raise InputError(
                f"{type(self).__name__}: expected its fields by name, such as {names[0]}=..., got "
                f"{shown(values[0])}"
            )
        try:
            super().__init__(**fields)
        except ValidationError as error:
            kind = type(self).model_fields["kind"].default
            raise InputError(first_error(str(kind), error)) from None

    @classmethod
    def __pydantic_init_subclass__(cls, **kwargs: Any) -> None:
        kind = cls.model_fields["kind"].default
        if not isinstance(kind, str):
            return  # a base of several kinds
        if cls.wanted is Material.wanted and cls.evaluator is Material.evaluator:
            raise TypeError(f"{cls.__name__}: expected a method wanted(motion), or evaluator")
        known = KINDS.setdefault(kind, cls)
        if known.__qualname__ != cls.__qualname__ or known.__module__ != cls.__module__:
            raise TypeError(f"{cls.__name__}: the kind {kind!r} is that of {known.__qualname__}")
        KINDS[kind] = cls

    @cached_property
    def evaluator(self) -> Evaluator:
        """What answers for this material; made once."""
        return Answering(
            self.wanted,
            getattr(self, "target", "share"),
            getattr(self, "outside", 0.0),
            self.depends_on,
            self.drives_at_rest,
            self.react,
        )

    def wanted(self, motion: Motion) -> Array:
        """Friction wanted under the fingers, of the motion's shape; no state, any thread."""
        return self.evaluator.wanted(motion)

    def react(self, facts: Facts, before: Report | None, now: Report) -> Facts:
        """Return the finger's facts after a real report; without `before` it has come down."""
        return facts

    @property
    def extent_mm(self) -> tuple[float, float, float, float]:
        """Left, right, top and bottom of what is worth drawing, in its own axes."""
        of = getattr(self, "of", None)
        return of.extent_mm if isinstance(of, Material) else (0.0, 40.0, 0.0, 20.0)

    @classmethod
    def upgrade(cls, fields: dict[str, Any], version: int) -> dict[str, Any]:
        """Turn the fields of an older document, of a `schema_version`, into today's."""
        return fields

    def replace(self, **fields: Any) -> Self:
        """Return a copy with some fields changed, validated like a new one."""
        return type(self)(**{**self.values_of_fields(), **fields})

    def save(self, path: str | Path) -> None:
        """Write a document that `load` reads back; paths of assets are relative to its folder."""
        path = Path(path)
        with in_folder(path.parent):
            fields = {"schema_version": 1, **self.model_dump(mode="json", exclude_none=True)}
        is_json = path.suffix == ".json"
        write_whole(path, json_text(fields) if is_json else tomlkit.dumps(fields))


@dataclass(frozen=True)
class Answering:
    """An evaluator of parts; see `haptix.texture.Evaluator`."""

    wanted: Callable[[Motion], Array]
    target: TargetKind = "share"
    outside: float = 0.0
    depends_on: Depends = Depends.PLACE
    drives_at_rest: bool = False
    react: React = lambda facts, before, now: facts


def load(path: str | Path) -> Material:
    """Read a material from TOML or JSON; its ``kind`` says which, see `KINDS`.

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
    fields = read_json(path) if path.suffix == ".json" else read_toml(path)
    version = fields.pop("schema_version", 1)
    if version != 1:
        raise FileFormatError(
            f"{path}: expected schema_version 1, got {version!r:.40}; update haptix to read it"
        )
    try:
        with in_folder(path.parent):
            return material_of(with_numbers("material", fields), version)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def material_of(table: Any, version: int = 1) -> Material:
    """Return a material, or what a table describes, or a file: a path that ends in .toml or .json.

    Anything else with an evaluator, such as a `haptix.Texture`, passes too; no document holds it.
    """
    if isinstance(table, str):
        if _IS_SEALED.get():
            raise InputError(f"material: expected a table here, got the path {table!r:.80}")
        return load(_FOLDER.get() / table)
    if not isinstance(table, Mapping):
        if not hasattr(table, "evaluator"):
            raise InputError(f'material: expected a table with a "kind", got {table!r:.80}')
        found: Material = table
        return found
    kind: Any = choice("material.kind", table.get("kind"), sorted(KINDS))
    return KINDS[kind](**KINDS[kind].upgrade(dict(table), version))


def table_of(material: Any) -> Any:
    """Table of a material within a document."""
    if not isinstance(material, Material):
        raise InputError(
            f"material: a {type(material).__name__} made in a program cannot be written; "
            "use its document, such as a photograph"
        )
    return material.model_dump(mode="json", exclude_none=True)


AnyMaterial = Annotated[
    Material,
    PlainValidator(material_of),
    PlainSerializer(table_of),
    WithJsonSchema({"title": ANY_KIND}),
]
"""A field that holds any material: itself, its table, or the path of its file."""


@dataclass(frozen=True, eq=False)
class Asset:
    """A file that a document names: by a path relative to its folder, or by its content.

    ``sha256:`` and the hash of its bytes stand for the file of that name, with any ending, in the
    folder or in ``assets`` beside the document.
    """

    name: str
    folder: Path

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Asset) and self._key == other._key

    def __hash__(self) -> int:
        return hash(self._key)

    @property
    def _key(self) -> str | Path:
        return self.name if self.name.startswith("sha256:") else (self.folder / self.name).resolve()

    @property
    def path(self) -> Path:
        """Where it is.

        Raises
        ------
        FileFormatError
            If there is no file of that hash, or its content is another.
        """
        if not self.name.startswith("sha256:"):
            return self.folder / self.name
        digest = self.name.removeprefix("sha256:")
        for folder in (self.folder, self.folder / "assets"):
            for found in sorted(folder.glob(f"{digest}*")):
                if sha256(found.read_bytes()).hexdigest() != digest:
                    raise FileFormatError(f"{found}: its content is not that of its name")
                return found
        raise FileFormatError(f"cannot find {self.name} in {self.folder} or assets beside it")


def _asset_of(value: Any) -> Asset:
    if isinstance(value, Asset):
        return value
    if isinstance(value, Path):
        value = str(value)
    if not isinstance(value, str) or not value:
        raise ValueError("expected the path of a file, or sha256: and its hash")
    if _IS_SEALED.get() and not value.startswith("sha256:"):
        raise ValueError("expected sha256: and the hash of a file that was sent")
    if value.startswith("sha256:") and not is_digest(value.removeprefix("sha256:")):
        raise ValueError("expected 64 hexadecimal digits after sha256:")
    return Asset(value, _FOLDER.get())


def is_digest(text: str) -> bool:
    """Whether a text is the hexadecimal digest of a SHA-256."""
    return len(text) == 64 and set(text) <= set("0123456789abcdef")


def _name_of(asset: Asset) -> str:
    """Name for the document that is being written."""
    if asset.name.startswith("sha256:"):
        return asset.name
    if _BY_CONTENT.get():
        return f"sha256:{sha256(asset.path.read_bytes()).hexdigest()}"
    return Path(os.path.relpath(asset.path, _FOLDER.get())).as_posix()


def read_asset(name: str) -> str:
    """Path of a file that a document names, for what knows files by their path alone."""
    try:
        return str(_asset_of(name).path)
    except ValueError as error:
        raise InputError(f"file: {error}") from None


def write_asset(path: str) -> str:
    """Return the name of a path for the document that is being written."""
    return _name_of(Asset(path, Path()))


AnyAsset = Annotated[
    Asset,
    PlainValidator(_asset_of),
    PlainSerializer(_name_of),
    WithJsonSchema({"type": "string", "minLength": 1}),
]
"""A field that names a file."""


class Scaled(Material):
    """Base of kinds whose levels 0 and 1 become friction.

    Parameters
    ----------
    target : {"share", "mu", "contrast"}
        What `low` and `high` are: shares of what the screen can reach, friction coefficients, or
        relative changes of friction; see `haptix.texture.as_mu`.
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
