"""Checks of arguments: each returns the value, or raises an `InputError` that names it."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import fields
from functools import partial
from math import inf, isfinite, isnan
from numbers import Real
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from haptix.base.errors import InputError

Array = npt.NDArray[np.float64]
Choice = TypeVar("Choice")

Positive = float
"""A field that must be above 0, see `check_fields`."""
NotNegative = float
"""A field that must be 0 or more."""
Length = float
"""A field that must be above 0 and may be infinite."""


def number(
    name: str, value: Any, least: float = -inf, *, above: float = -inf, open_end: bool = False
) -> float:
    """Check that a number is at least `least` and above `above`; `open_end` allows infinity.

    An array or a tensor of one value is a number, a bool is not.
    """
    real = plain(value)
    good = real is not None and real >= least and (real > above or above == -inf)
    if real is None or not good or isnan(real) or not (open_end or isfinite(real)):
        bound = f" above {above:g}" if above > -inf else f" of at least {least:g}"
        raise InputError(
            f"{name}: expected a {'' if open_end else 'finite '}number"
            f"{bound if max(above, least) > -inf else ''}, "
            f"got {f'{value!r:.80}' if real is None else f'{real:g}'}"
        )
    return real


def plain(value: Any) -> float | None:
    """Return a real number as a float, and None for anything else."""
    if type(value) is float:
        return value
    with suppress(AttributeError, ValueError, RuntimeError):  # not an array or tensor of one
        value = value.item()
    with suppress(OverflowError):  # an integer beyond all floats
        return float(value) if isinstance(value, Real) and not isinstance(value, bool) else None
    return None


def positive(name: str, value: Any, *, open_end: bool = False) -> float:
    """Check a number above 0; see `number`."""
    return number(name, value, above=0.0, open_end=open_end)


def boolean(name: str, value: Any) -> bool:
    """Check that a value is True or False, and not a word such as "yes"."""
    if not isinstance(value, bool | np.bool_):
        raise InputError(f"{name}: expected True or False, got {value!r:.80}")
    return bool(value)


def shown(value: Any) -> str:
    """Return the start of a value's repr, in one line."""
    return " ".join(f"{value!r:.400}".split())[:80]


def instance(name: str, value: Any, kind: type[Any], hint: str = "") -> None:
    """Check that a value is of a class; `hint` says how to make one, or the order of arguments."""
    if not isinstance(value, kind):
        article = "an" if kind.__name__[0] in "AEIOU" else "a"
        raise InputError(
            f"{name}: expected {article} {kind.__name__}, got {shown(value)}"
            f"{f'; {hint}' if hint else ''}"
        )


_BY_ANNOTATION: dict[str, Callable[[str, Any], Any]] = {
    "bool": boolean,
    "float": number,
    "Positive": positive,
    "NotNegative": partial(number, least=0.0),
    "Length": partial(positive, open_end=True),
}


def check_fields(owner: Any) -> None:
    """Check numbers and bools of a dataclass by their annotations; a float is any finite number.

    Its module must have ``from __future__ import annotations``. Optional numbers may be None.
    """
    for field in fields(owner):
        if not field.init:
            continue
        kind, value = str(field.type), getattr(owner, field.name)
        if value is None and kind.endswith(" | None"):
            continue
        check = _BY_ANNOTATION.get(kind.removesuffix(" | None"))
        if check is not None:
            check(field.name, value)


def whole(name: str, value: Any, least: int = 0) -> int:
    """Check an integer of at least `least`."""
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < least:
        raise InputError(f"{name}: expected a whole number from {least}, got {value!r:.80}")
    return int(value)


def choice(name: str, value: Choice, known: Iterable[Choice]) -> Choice:
    """Check that a value is one of those `known`."""
    options = list(known)
    if value not in options:
        raise InputError(
            f"{name}: expected one of {', '.join(map(str, options))}, got {value!r:.80}"
        )
    return value


def row(name: str, values: Any, least_count: int = 1) -> Array:
    """Return finite numbers as an array of shape (count,), with `least_count` of them or more."""
    try:
        array = np.asarray(values, dtype=np.float64)
    except (OverflowError, TypeError, ValueError):
        raise InputError(f"{name}: expected numbers, got {values!r:.80}") from None
    if array.ndim != 1 or len(array) < least_count:
        raise InputError(
            f"{name}: expected a row of at least {least_count} numbers, got shape {array.shape}"
        )
    bad = ~np.isfinite(array)
    if bad.any():
        at = int(bad.argmax())
        raise InputError(f"{name}: expected finite numbers, but number {at + 1} is {array[at]:g}")
    return array


def increasing(name: str, values: Any, least_count: int = 1) -> Array:
    """Return a `row` in which every number exceeds the one before."""
    array = row(name, values, least_count)
    late = np.diff(array) <= 0
    if late.any():
        at = int(late.argmax())
        raise InputError(
            f"{name}: expected increasing numbers, but number {at + 2} is {array[at + 1]:g} after "
            f"{array[at]:g}"
        )
    return array
