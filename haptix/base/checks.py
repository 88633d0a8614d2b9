"""Checks of arguments: each returns the value, or raises an `InputError` that names it."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import field
from dataclasses import fields as dataclass_fields
from functools import wraps
from math import inf, isfinite, isnan
from numbers import Real
from typing import Annotated, Any, ParamSpec, TypeVar, dataclass_transform

import numpy as np
import numpy.typing as npt
from pydantic import ConfigDict, Field, ValidationError, ValidatorFunctionWrapHandler, WrapValidator
from pydantic.dataclasses import dataclass

from haptix.base.errors import InputError

Array = npt.NDArray[np.float64]
Choice = TypeVar("Choice")
Made = TypeVar("Made")


def _as_given(value: Any, check: ValidatorFunctionWrapHandler) -> Any:
    """Read numbers of numpy and torch too; a whole one stays whole in files and their hashes."""
    if not isinstance(value, int | float):
        real = plain(value)
        value = value if real is None else real
    checked_value = check(value)
    return value if isinstance(value, int) else checked_value


Number = Annotated[float, Field(strict=True, allow_inf_nan=False), WrapValidator(_as_given)]
"""A field that is a finite number."""
Positive = Annotated[Number, Field(gt=0)]
"""A field that is above 0 and finite."""
NotNegative = Annotated[Number, Field(ge=0)]
"""A field that is 0 or more and finite."""
Length = Annotated[float, Field(strict=True, gt=0, allow_inf_nan=True), WrapValidator(_as_given)]
"""A field that is above 0 and may be infinite."""


@dataclass_transform(frozen_default=True, field_specifiers=(field, Field))
def checked(*, kw_only: bool = False) -> Callable[[type[Made]], type[Made]]:
    """Decorate a class: a frozen dataclass whose values pydantic checks by their annotations.

    The first value that is wrong raises an `InputError` that names it.

    Examples
    --------
    >>> @checked()
    ... class Panel:
    ...     width_mm: Positive = 60.0
    >>> Panel(width_mm=0)
    Traceback (most recent call last):
        ...
    haptix.base.errors.InputError: Panel.width_mm: input should be greater than 0, got 0
    """

    def decorate(plain_class: type[Made]) -> type[Made]:
        config = ConfigDict(strict=True, extra="forbid", arbitrary_types_allowed=True)
        made: Any = dataclass(frozen=True, kw_only=kw_only, config=config)(plain_class)
        check, names = made.__init__, [each.name for each in dataclass_fields(made) if each.init]

        @wraps(check)
        def init(self: Any, /, *values: Any, **fields: Any) -> None:
            try:  # by name, which an error quotes
                by_name = dict(zip(names, values, strict=False))
                check(self, *values[len(names) :], **by_name, **fields)
            except ValidationError as error:
                raise InputError(first_error(type(self).__name__, error)) from None

        made.__init__ = init
        decorated: type[Made] = made
        return decorated

    return decorate


def first_error(name: str, error: ValidationError) -> str:
    """Return one sentence about the first error of a table called `name`."""
    errors = error.errors()
    # A mistyped name gives two errors, "unknown" and "missing": the first helps more.
    first = next((wrong for wrong in errors if wrong["type"] == "extra_forbidden"), errors[0])
    # Tags of a union, such as "self-affine", are not keys in the file.
    keys = [part for part in first["loc"] if isinstance(part, int) or part.isidentifier()]
    field = ".".join((name, *map(str, keys)))
    # The error of a whole table names its reason; printing all its fields would hide that.
    is_within = isinstance(first.get("ctx", {}).get("error"), InputError)
    has_reason = first["type"] == "missing" or not first["loc"] or is_within
    got = "" if has_reason else f", got {first['input']!r:.200}"
    message = first["msg"].removeprefix("Value error, ")
    return f"{field}: {message[0].lower()}{message[1:]}{got}"


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
    """Check the class of a value; `hint` is the way to make one, or the order of arguments."""
    if not isinstance(value, kind):
        article = "an" if kind.__name__[0] in "AEIOU" else "a"
        raise InputError(
            f"{name}: expected {article} {kind.__name__}, got {shown(value)}"
            f"{f'; {hint}' if hint else ''}"
        )


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


Given = ParamSpec("Given")
Found = TypeVar("Found")


def eager(function: Callable[Given, Found]) -> Callable[Given, Found]:
    """Decorate a function that no graph of torch can hold: within one it raises.

    It decides by the values of its tensors, and computes a part of them in C. A trace would keep
    those decisions, and memory that C has not written.

    Parameters
    ----------
    function : callable
        Function of tensors.
    """
    sentence = (
        f"{function.__name__}: expected a plain call, since torch.jit.trace, torch.export, "
        "torch.compile with fullgraph and torch.vmap cannot follow it; pass whole tensors, and "
        "wrap calls from compiled code in torch.compiler.disable"
    )
    backwards = (
        f"{function.__name__}: expected a plain call, since its derivatives are those of reverse "
        "mode alone; use backward, torch.autograd.grad or torch.func.jacrev"
    )

    @wraps(function)
    def run(*given: Given.args, **named: Given.kwargs) -> Found:
        import torch  # loaded by those who call; checks of parameters come before it

        if torch.compiler.is_dynamo_compiling():  # an error where the whole must be one graph
            torch._dynamo.graph_break(msg=sentence)
            outside: Callable[Given, Found] = torch.compiler.disable(function)
            return outside(*given, **named)
        if torch._C._get_tracing_state() is not None or torch.compiler.is_compiling():
            raise InputError(sentence)
        forward_ad = torch.autograd.forward_ad
        if forward_ad._current_level >= 0 and any(  # there is no public one
            isinstance(value, torch.Tensor) and forward_ad.unpack_dual(value).tangent is not None
            for value in (*given, *named.values())
        ):
            raise InputError(backwards)
        try:
            return function(*given, **named)
        except RuntimeError as error:
            if "vmap" not in str(error):
                raise
            raise InputError(sentence) from None

    return run
