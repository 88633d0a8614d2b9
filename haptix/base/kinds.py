"""Documents of many kinds: each kind is one class, in haptix or in another package.

A `Kind` is a frozen table; its field ``kind`` names its class, which `Kinds` finds. Each file that
a document names is an `Asset`.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from functools import cached_property
from hashlib import sha256
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from inspect import signature
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Self, TypeVar
from weakref import WeakValueDictionary

from pydantic import PlainSerializer, PlainValidator, ValidationError, WithJsonSchema
from pydantic_core import PydanticSerializationError

from haptix.base.checks import choice, first_error, shown
from haptix.base.documents import Part
from haptix.base.errors import FileFormatError, InputError

Made = TypeVar("Made")

_FOLDER: ContextVar[Path | None] = ContextVar("folder", default=None)
_IS_SEALED: ContextVar[bool] = ContextVar("sealed", default=False)
_BY_CONTENT: ContextVar[bool] = ContextVar("by_content", default=False)


@contextmanager
def in_folder(folder: Path, is_sealed: bool = False) -> Iterator[None]:
    """Read and write documents whose paths are relative to a folder.

    A sealed folder holds documents of other people, which may name files by their hash only.
    """
    token, seal = _FOLDER.set(folder), _IS_SEALED.set(is_sealed)
    try:
        yield
    finally:
        _FOLDER.reset(token)
        _IS_SEALED.reset(seal)


@contextmanager
def by_content() -> Iterator[None]:
    """Write documents that name their files by the hash of the content, and not by the path."""
    token = _BY_CONTENT.set(True)
    try:
        yield
    finally:
        _BY_CONTENT.reset(token)


def document_path(name: str) -> Path:
    """Path of a document that another one names.

    Raises `InputError` in a sealed folder.
    """
    if _IS_SEALED.get():
        raise InputError(f"expected a table here, got the path {name!r:.80}")
    return (_FOLDER.get() or Path()) / name


class Kinds(Mapping[str, type[Any]]):
    """Classes of the kinds of one family, by the names that documents use.

    A class is imported at its first use. Another package adds a kind by an entry point that has
    the kind's name.

    Parameters
    ----------
    group : str
        Group of the entry points.
    built_in : mapping
        Modules of the kinds in haptix.
    short : mapping
        Short forms by their names: functions, as "module:function", that make one of a kind.
    """

    def __init__(
        self, group: str, built_in: Mapping[str, str], short: Mapping[str, str] | None = None
    ) -> None:
        self._group = group
        self._built_in = built_in
        self._short = short or {}
        self._entered: dict[str, type[Any]] = {}

    @cached_property
    def _installed(self) -> dict[str, EntryPoint]:
        return {point.name: point for point in entry_points(group=self._group)}

    def enter(self, name: str, model: type[Any]) -> None:
        """Register a new class; raise `TypeError` if the kind belongs to another one."""
        known = self._entered.setdefault(name, model)
        if (known.__module__, known.__qualname__) != (model.__module__, model.__qualname__):
            raise TypeError(f"{model.__name__}: the kind {name!r} is that of {known.__qualname__}")
        self._entered[name] = model

    def __getitem__(self, name: str) -> type[Any]:
        if name not in self._entered:
            if name in self._built_in:
                import_module(self._built_in[name])
            else:
                self._load(self._installed[name])
        return self._entered[name]

    def read(self, name: str, table: Mapping[str, Any]) -> Any:
        """Make the object that a table describes; messages call the table `name`.

        Raises `InputError` if the kind or a field is unknown, missing or wrong.
        """
        fields = dict(table)
        kind = choice(f"{name}.kind", fields.get("kind"), [*self, *self._short])
        if kind not in self._short:
            return self[kind](**fields)
        del fields["kind"]
        module, _, function = self._short[kind].partition(":")
        return call(kind, getattr(import_module(module), function), fields)

    def _load(self, installed: EntryPoint) -> None:
        whose = installed.dist.name if installed.dist else installed.value
        try:
            installed.load()
        except Exception as error:  # a stranger's module may raise anything
            raise InputError(
                f"kind {installed.name}: cannot be imported from {whose} ({error}); update or "
                "uninstall that package"
            ) from error
        if installed.name not in self._entered:
            raise InputError(
                f"kind {installed.name}: {installed.value} of {whose} defines no such kind; name "
                "its entry point as the class names its kind"
            )

    def __iter__(self) -> Iterator[str]:
        return iter(sorted({*self._built_in, *self._installed, *self._entered}))

    def __len__(self) -> int:
        return len({*self._built_in, *self._installed, *self._entered})


class Kind(Part):
    """A table of a kind.

    Raises `InputError` if a field is unknown, missing or outside its range.
    """

    kinds: ClassVar[Kinds]
    """All kinds of its family."""

    if TYPE_CHECKING:  # no field, or type checkers count it before those of a class

        @property
        def kind(self) -> str:
            """Name of the kind."""

    else:
        kind: str

    def __init__(self, /, *values: Any, **fields: Any) -> None:
        model = type(self)
        kind = str(model.model_fields["kind"].default)
        if values:
            names = [name for name in model.model_fields if name != "kind"]
            raise InputError(
                f"{model.__name__}: expected its fields by name, such as {names[0]}=..., got "
                f"{shown(values[0])}"
            )
        try:
            super().__init__(**fields)
        except ValidationError as error:
            unknown = next((name for name in fields if name not in model.model_fields), None)
            if unknown is not None:
                raise InputError(
                    f"{kind}.{unknown}: {_no_such(kind, model.model_fields)}"
                ) from None
            raise InputError(first_error(kind, error)) from None

    @classmethod
    def __pydantic_init_subclass__(cls, **kwargs: Any) -> None:
        kind = cls.model_fields["kind"].default
        if isinstance(kind, str):  # else a base of several kinds
            cls.kinds.enter(kind, cls)

    def describe(self) -> dict[str, Any]:
        """Return a table of plain values, which is read back to an equal document.

        Raises
        ------
        InputError
            If it holds an object of the program that no document can describe.

        Examples
        --------
        >>> from haptix.feel import Grating
        >>> Grating(period_mm=2.0).describe()["period_mm"]
        2.0
        """
        try:
            return self.model_dump(mode="json", exclude_none=True)
        except PydanticSerializationError as error:
            raise error.__cause__ or error from None

    def replace(self, **fields: Any) -> Self:
        """Return a copy with some fields changed, validated like a new one.

        Examples
        --------
        >>> from haptix.feel import Grating
        >>> Grating(period_mm=2.0).replace(period_mm=3.0).period_mm
        3.0
        """
        known = {name: getattr(self, name) for name in type(self).model_fields}
        return type(self)(**{**known, **fields})


def _no_such(kind: str, known: Iterable[str]) -> str:
    names = ", ".join(name for name in known if name != "kind")
    return f"{kind} has no such field; expected any of {names}"


def call(name: str, make: Callable[..., Made], fields: Mapping[str, Any]) -> Made:
    """Call a function or a class with the fields of a table that messages call `name`.

    Raises `InputError` if a field is unknown, missing or wrong.
    """
    known = signature(make).parameters
    for field in fields:
        if field not in known:
            raise InputError(f"{name}.{field}: {_no_such(name, known)}")
    try:
        return make(**fields)
    except InputError as error:
        raise InputError(f"{name}: {error}") from None
    except TypeError as error:  # "grating() missing 1 required positional argument: 'period_mm'"
        raise InputError(f"{name}: {str(error).split('() ')[-1]}") from None


_SHARED: WeakValueDictionary[str, Any] = WeakValueDictionary()


def shared(key: Any, make: Callable[[], Made]) -> Made:
    """Return what `make` makes; it is shared as long as anything refers to it.

    Equal keys, of plain values, give the same object.
    """
    text = json.dumps(key, sort_keys=True)
    value: Made | None = _SHARED.get(text)
    if value is None:
        value = _SHARED[text] = make()
    return value


@dataclass(frozen=True, eq=False)
class Asset:
    """A file that a document names: by a path relative to its folder, or by its content's hash.

    ``sha256:`` and the hash name the file whose name begins with that hash, with any ending, in
    the folder or in ``assets`` beside the document.
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
        """Path of the file.

        Raises `FileFormatError` if there is no file of that hash, or its content has another hash.
        """
        if not self.name.startswith("sha256:"):
            return self.folder / self.name
        digest = self.name.removeprefix("sha256:")
        for folder in (self.folder, self.folder / "assets"):
            for candidate in sorted(folder.glob(f"{digest}*")):
                if sha256(candidate.read_bytes()).hexdigest() != digest:
                    raise FileFormatError(f"{candidate}: its content is not that of its name")
                return candidate
        raise FileFormatError(f"cannot find {self.name} in {self.folder} or assets beside it")

    def shared(self, parameters: Any, make: Callable[[Path], Made]) -> Made:
        """Return what `make` makes of the file, shared by its content and `parameters`."""
        path = self.path
        content = sha256(path.read_bytes()).hexdigest() if path.is_file() else str(path)
        return shared([content, parameters], lambda: make(path))


def asset_of(value: Any) -> Asset:
    """Return the file that a document names.

    Raises `InputError` if it is not a name, or is a path in a sealed folder.
    """
    if isinstance(value, Asset):
        return value
    if isinstance(value, Path):
        value = str(value)
    if not isinstance(value, str) or not value:
        raise InputError(f"expected the path of a file, or sha256: and its hash, got {value!r:.80}")
    if _IS_SEALED.get() and not value.startswith("sha256:"):
        raise InputError(
            f"expected sha256: and the hash of a file that was sent, got {value!r:.80}"
        )
    if value.startswith("sha256:") and not is_digest(value.removeprefix("sha256:")):
        raise InputError(f"expected 64 hexadecimal digits after sha256:, got {value!r:.80}")
    return Asset(value, _FOLDER.get() or Path())


def is_digest(text: str) -> bool:
    """Whether a text is the hexadecimal digest of a SHA-256."""
    return len(text) == 64 and set(text) <= set("0123456789abcdef")


def _name_of(asset: Asset) -> str:
    """Return the name of a file for the document that is being written."""
    if asset.name.startswith("sha256:"):
        return asset.name
    if _BY_CONTENT.get():
        return f"sha256:{sha256(asset.path.read_bytes()).hexdigest()}"
    folder = _FOLDER.get()
    path = asset.path if folder is None else Path(os.path.relpath(asset.path, folder))
    return path.as_posix()


AnyAsset = Annotated[
    Asset,
    PlainValidator(asset_of),
    PlainSerializer(_name_of),
    WithJsonSchema({"type": "string", "minLength": 1}),
]
"""A field that names a file."""
