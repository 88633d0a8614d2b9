"""Documents: fingers, screens, scenes and recipes, as validated and frozen tables of a file."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal, Self

import tomlkit
from pydantic import BaseModel, ConfigDict, ValidationError

from haptix.base.checks import first_error
from haptix.base.display import html_table
from haptix.base.errors import FileFormatError, InputError
from haptix.base.files import (
    check_schema_version,
    checked_values,
    file_at,
    json_text,
    read_json,
    read_toml,
    write_whole,
)
from haptix.base.units import with_numbers


class Part(BaseModel):
    """A table within a document: unknown keys and values out of range are errors."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    def __eq__(self, other: object) -> bool:
        # By fields alone: cached properties may hold arrays, whose == is no bool.
        return type(self) is type(other) and all(
            getattr(self, name) == getattr(other, name) for name in type(self).model_fields
        )

    if not TYPE_CHECKING:  # with this method, a type checker would accept misspelt attributes

        def __getattr__(self, name: str) -> Any:
            try:
                return super().__getattr__(name)
            except AttributeError as error:
                error.name, error.obj = name, self  # Python then suggests similar names
                raise

    def _repr_html_(self) -> str:
        fields = type(self).model_fields
        return html_table(type(self).__name__, {name: getattr(self, name) for name in fields})


class Document(Part):
    """A table with a file of its own: TOML, or JSON if its name ends in ``.json``."""

    presets: ClassVar[Mapping[str, Mapping[str, Any]]] = {}
    """Fields by the names of presets."""

    schema_version: Literal[1] = 1

    def __init__(self, /, **fields: Any) -> None:
        try:
            super().__init__(**fields)
        except ValidationError as error:
            raise InputError(first_error(type(self).__name__, error)) from None

    def replace(self, **fields: Any) -> Self:
        """Return a copy with some fields changed, validated like a new one.

        Examples
        --------
        >>> import haptix
        >>> haptix.Finger.preset("wet").replace(poisson_ratio=0.45).poisson_ratio
        0.45
        """
        return type(self)(**{**dict(self), **fields})

    @classmethod
    def preset(cls, name: str) -> Self:
        """Return a preset by its name.

        Raises
        ------
        InputError
            If there is no preset of that name.

        Examples
        --------
        >>> from haptix.model import Finger
        >>> Finger.preset("wet").name
        'wet'
        """
        if name not in cls.presets:
            raise InputError(
                f"unknown {cls.__name__.lower()} preset {name!r}: expected one of "
                f"{', '.join(cls.presets)}"
            )
        return cls(name=name, **cls.presets[name])

    @classmethod
    def named(cls, name: str, folder: Path = Path()) -> Self:
        """Load the file `name` in `folder` if it ends in ``.toml``, else return a preset.

        Parameters
        ----------
        name : str
            A preset's name, or that of a file.
        folder : Path
            Where the file lies.

        Examples
        --------
        >>> import haptix
        >>> haptix.Finger.named("dry").name
        'dry'
        """
        return cls.load(folder / name) if name.endswith(".toml") else cls.preset(name)

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read a file; numbers may be strings with units, such as "150 V".

        Raises
        ------
        FileFormatError
            If the file is missing, is not TOML or JSON, or is of a later schema.
        InputError
            If a field is unknown, missing or outside its range.
        """
        path = file_at("path", path)
        fields = read_json(path) if path.suffix == ".json" else read_toml(path)
        if not fields:  # an interrupted write, and not a document of all defaults
            raise FileFormatError(f"{path}: expected the fields of a {cls.__name__}, got none")
        check_schema_version(path, fields.get("schema_version", 1))
        kinds = {key: field.annotation for key, field in cls.model_fields.items()}
        texts = {key for key, kind in kinds.items() if kind in (str, str | None)}
        try:
            return cls._from_table(with_numbers(cls.__name__, fields, texts), path.parent)
        except InputError as error:
            raise InputError(f"{path}: {error}") from None

    @classmethod
    def _from_table(cls, fields: dict[str, Any], folder: Path) -> Self:
        """Make a document from the table of a file in `folder`, to which its paths are relative."""
        if "folder" not in cls.model_fields:
            return cls(**fields)
        if "folder" in fields:
            raise InputError(
                f"{cls.__name__}.folder: a file has none; its paths are relative to the file"
            )
        return cls(**fields, folder=folder)

    def save(self, path: str | Path) -> None:
        """Write a file that `load` reads back to an equal document.

        Raises
        ------
        InputError
            If a text holds a character that no file takes, such as a NUL.

        Examples
        --------
        >>> import haptix
        >>> from tempfile import TemporaryDirectory
        >>> with TemporaryDirectory() as folder:
        ...     haptix.Finger.preset("wet").save(f"{folder}/mine.toml")
        ...     print(haptix.Finger.load(f"{folder}/mine.toml").name)
        wet
        """
        fields = self.model_dump(mode="json", exclude_none=True)
        try:
            checked_values(fields)
        except ValueError as error:
            raise InputError(
                f"{Path(path).name}: expected a text that a file takes, got {error}"
            ) from None
        is_json = Path(path).suffix == ".json"
        write_whole(path, json_text(fields) if is_json else tomlkit.dumps(fields))
