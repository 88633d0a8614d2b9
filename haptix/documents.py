"""Documents: things in the world: validated, frozen, read from TOML, replaced field by field."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import tomlkit
from pydantic import (
    BaseModel,
    ConfigDict,
    PlainSerializer,
    PlainValidator,
    ValidationError,
)
from torch import Tensor

from haptix.errors import FileFormatError, InputError
from haptix.units import with_numbers


def _number(value: float | Tensor) -> float:
    return float(value.detach() if isinstance(value, Tensor) else value)


def _positive(value: Any) -> float | Tensor:
    if isinstance(value, str | bool):
        raise ValueError("expected a number")
    try:
        number = _number(value)
    except (TypeError, ValueError, RuntimeError):
        raise ValueError("expected a number") from None
    if not 0 < number < float("inf"):
        raise ValueError("expected a finite number above 0")
    return value if isinstance(value, Tensor) else number


Quantity = Annotated[float | Tensor, PlainValidator(_positive), PlainSerializer(_number)]
"""A positive number, or a tensor of one that is to be differentiated through."""


class Document(BaseModel):
    """Base of `Finger` and `Screen`: unknown keys and values out of range are errors."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    schema_version: Literal[1] = 1

    def __init__(self, **fields: Any) -> None:
        try:
            super().__init__(**fields)
        except ValidationError as error:
            raise InputError(_sentence(type(self).__name__, error)) from None

    def replace(self, **fields: Any) -> Self:
        """Return a copy with some fields changed, validated like a new one."""
        return type(self)(**{**dict(self), **fields})

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read a TOML file; numbers may be strings with units, such as "150 V".

        Raises
        ------
        FileFormatError
            If the file is missing, is not TOML, or is of a later schema.
        InputError
            If a field is unknown or outside its range.
        """
        path = Path(path)
        try:
            fields = tomllib.loads(path.read_text(encoding="utf-8"))
        except OSError as error:
            raise FileFormatError(f"cannot read {path}: {error.strerror}") from None
        except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
            raise FileFormatError(f"{path}: expected a TOML file, got: {error}") from None
        version = fields.get("schema_version", 1)
        if version != 1:
            raise FileFormatError(
                f"{path}: expected schema_version 1, got {version!r}; update haptix to read it"
            )
        try:
            return cls._from_table(with_numbers(cls.__name__, fields), path.parent)
        except InputError as error:
            raise InputError(f"{path}: {error}") from None

    @classmethod
    def _from_table(cls, fields: dict[str, Any], folder: Path) -> Self:
        """Make one from the table of a file in `folder`."""
        return cls(**fields)

    def save(self, path: str | Path) -> None:
        """Write the profile as TOML that `load` reads back to an equal one."""
        fields = self.model_dump(mode="json", exclude_none=True)
        path = Path(path)
        whole = path.with_name(path.name + ".part")
        try:
            whole.write_text(tomlkit.dumps(fields), encoding="utf-8")
            whole.replace(path)
        except OSError as error:
            raise FileFormatError(f"cannot write {path}: {error.strerror}") from None
        finally:
            whole.unlink(missing_ok=True)


def _sentence(name: str, error: ValidationError) -> str:
    first = error.errors()[0]
    # Tags of a union, such as "self-affine", are no keys that anybody typed.
    keys = [part for part in first["loc"] if isinstance(part, int) or part.isidentifier()]
    field = ".".join((name, *map(str, keys)))
    # What contradicts itself as a whole has said so; all of its fields would bury that.
    told = first["type"] == "missing" or not first["loc"]
    got = "" if told else f", got {first['input']!r}"
    message = first["msg"].removeprefix("Value error, ")
    return f"{field}: {message[0].lower()}{message[1:]}{got}"


def named_preset(kind: str, name: str, presets: dict[str, dict[str, Any]]) -> dict[str, Any]:
    """Look a preset up, or say which exist."""
    if name not in presets:
        raise InputError(f"unknown {kind} preset {name!r}: expected one of {', '.join(presets)}")
    return presets[name]
