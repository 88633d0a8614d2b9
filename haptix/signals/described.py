"""Values that a recipe names by their kind, written to plain tables and read back."""

from __future__ import annotations

import inspect
from abc import ABC
from collections.abc import Callable, Iterator, Mapping
from dataclasses import fields
from math import inf
from typing import Any, ClassVar, TypeVar

import numpy as np

from haptix.checks import check_fields, choice, increasing, row
from haptix.errors import InputError

KINDS: dict[str, Callable[..., Any]] = {}
"""Constructor of each kind of value, by the name that recipes use."""

Made = TypeVar("Made")


class Described(ABC):
    """Base of frozen dataclasses whose fields are all that determines them.

    Attributes
    ----------
    kind : str
        Name in recipes and sidecars.
    """

    kind: ClassVar[str]

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        if "kind" in cls.__dict__:
            KINDS[cls.kind] = cls

    def __post_init__(self) -> None:
        check_fields(self)

    def describe(self) -> dict[str, Any]:
        """Return a plain table that `read` turns into an equal value."""
        # Every subclass is a dataclass.
        names = [field.name for field in fields(self)]  # type: ignore[arg-type]
        return {"kind": self.kind} | {name: plain(getattr(self, name)) for name in names}

    def walk(self) -> Iterator[Described]:
        """Yield this value and all described values within."""
        yield self
        for field in fields(self):  # type: ignore[arg-type]
            value = getattr(self, field.name)
            for part in value if isinstance(value, tuple) else (value,):
                if isinstance(part, Described):
                    yield from part.walk()


def read(table: Any, place: str, kinds: Mapping[str, Callable[..., Made]] = KINDS) -> Made:
    """Make what a table describes: its ``kind`` is one of `kinds`, the rest are the fields.

    Raises
    ------
    InputError
        If a kind or a field is unknown, missing or wrong; the message says where.
    """
    if not isinstance(table, Mapping) or "kind" not in table:
        number = ", or a number" if kinds is KINDS else ""
        raise InputError(f'{place}: expected a table with a "kind"{number}, got {table!r:.80}')
    kind = choice(f"{place}.kind", table["kind"], sorted(kinds))
    known = inspect.signature(kinds[kind]).parameters
    given = {name: value for name, value in table.items() if name != "kind"}
    unknown = [name for name in given if name not in known]
    if unknown:
        raise InputError(
            f"{place}.{unknown[0]}: {kind} has no such field; expected any of {', '.join(known)}"
        )
    given = {name: _read_field(value, f"{place}.{name}") for name, value in given.items()}
    try:
        return kinds[kind](**given)
    except InputError as error:
        raise InputError(f"{place}: {error}") from None
    except TypeError as error:
        # "Sine.__init__() missing 1 required positional argument: 'frequency_hz'"
        raise InputError(f"{place} ({kind}): {str(error).split('() ')[-1]}") from None


def _read_field(value: Any, place: str) -> Any:
    if isinstance(value, Mapping) and str(value.get("kind")) in KINDS:
        return read(value, place)
    if isinstance(value, list | tuple):
        return tuple(_read_field(item, f"{place}[{i}]") for i, item in enumerate(value))
    return inf if value == "forever" else value


def plain(value: Any) -> Any:
    """Return a field as what JSON and TOML hold."""
    if isinstance(value, Described):
        return value.describe()
    if isinstance(value, tuple):
        return [plain(item) for item in value]
    if isinstance(value, np.generic):
        value = value.item()
    return "forever" if value == inf else value


def set_corners(owner: object, places: str, values: str) -> None:
    """Check two fields of a frozen dataclass, and make tuples of lists and arrays.

    Raises
    ------
    InputError
        If there are fewer than two corners, their places do not increase, or a number is missing.
    """
    given = getattr(owner, places), getattr(owner, values)
    if len(increasing(places, given[0], 2)) != len(row(values, given[1], 2)):
        raise InputError(f"{places}: expected as many as {values}, got {len(given[0])}")
    for name, value in zip((places, values), given, strict=True):
        object.__setattr__(owner, name, tuple(np.asarray(value).tolist()))
