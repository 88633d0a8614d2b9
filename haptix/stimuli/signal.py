"""Signals: frozen descriptions that are evaluated block by block, and their algebra.

A signal says a quantity against time. Its value at a sample depends on the sample's number and the
sample rate alone, so that it can be streamed in blocks, by several threads, in any order.
"""

from __future__ import annotations

import hashlib
import json
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, fields
from math import inf, isfinite
from numbers import Real
from typing import Any, ClassVar, Literal

import numpy as np
import numpy.typing as npt

from haptix.errors import InputError

Array = npt.NDArray[np.float64]

KINDS: dict[str, type[Signal]] = {}
"""Every kind of signal by the name that recipes use."""


class Signal(ABC):
    """Base of all signals; ``+``, ``-`` and ``*`` take signals and numbers.

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

    @property
    @abstractmethod
    def length(self) -> float:
        """Length [s]; `math.inf` where the signal goes on for ever."""

    @abstractmethod
    def inside(self, first: int, count: int, sample_rate_hz: float) -> Array:
        """Values at samples that lie within the length."""

    def samples(self, sample_rate_hz: float) -> int | None:
        """Length in samples; None where it is infinite."""
        return None if self.length == inf else round(self.length * sample_rate_hz)

    def values(self, first: int, count: int, sample_rate_hz: float) -> Array:
        """Values at `count` samples from number `first` on; 0 past the end.

        Parameters
        ----------
        first : int
            Number of the first sample, 0 or more.
        count : int
            How many.
        sample_rate_hz : float
            Samples per second.
        """
        total = self.samples(sample_rate_hz)
        if total is None or first + count <= total:
            return self.inside(first, count, sample_rate_hz)
        within = max(0, total - first)
        values = np.zeros(count)
        if within:
            values[:within] = self.inside(first, within, sample_rate_hz)
        return values

    def describe(self) -> dict[str, Any]:
        """Everything that determines the values, as plain values; `signal_from` reads it."""
        table: dict[str, Any] = {"kind": self.kind}
        for field in fields(self):  # type: ignore[arg-type]  # every signal is a dataclass
            table[field.name] = _plain(getattr(self, field.name))
        return table

    def digest(self) -> str:
        """Hash of the description."""
        text = json.dumps(self.describe(), sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()

    @property
    def seeds(self) -> tuple[int, ...]:
        """Seeds of all noise within."""
        found: list[int] = []
        for field in fields(self):  # type: ignore[arg-type]
            value = getattr(self, field.name)
            parts = value if isinstance(value, tuple) else (value,)
            if field.name == "seed":
                found.append(int(value))
            for part in parts:
                if isinstance(part, Signal):
                    found.extend(part.seeds)
        return tuple(found)

    def __add__(self, other: Signal | float) -> Signal:
        from haptix.stimuli.algebra import Sum

        return Sum((self, as_signal(other)))

    def __radd__(self, other: float) -> Signal:
        from haptix.stimuli.algebra import Sum

        return Sum((as_signal(other), self))

    def __sub__(self, other: Signal | float) -> Signal:
        from haptix.stimuli.algebra import Sum

        if not isinstance(other, Signal):
            return Sum((self, as_signal(-other)))
        return Sum((self, -other))

    def __rsub__(self, other: float) -> Signal:
        return other + (-self)

    def __neg__(self) -> Signal:
        from haptix.stimuli.algebra import Product

        return Product((Constant(-1.0), self))

    def __mul__(self, other: Signal | float) -> Signal:
        from haptix.stimuli.algebra import Product

        return Product((self, as_signal(other)))

    def __rmul__(self, other: float) -> Signal:
        from haptix.stimuli.algebra import Product

        return Product((as_signal(other), self))

    def then(self, *others: Signal) -> Signal:
        """One after the other; all but the last must be finite."""
        from haptix.stimuli.algebra import Concatenation

        return Concatenation((self, *others))

    def repeat(self, times: float = inf) -> Signal:
        """Again and again; for ever without a number."""
        from haptix.stimuli.algebra import Repetition

        return Repetition(self, times)

    def lasting(self, length_s: float) -> Signal:
        """Cut to a length, or filled up with 0."""
        from haptix.stimuli.algebra import Excerpt

        return Excerpt(self, length_s)

    def window(
        self,
        rise_s: float,
        fall_s: float | None = None,
        shape: Literal["raised-cosine", "linear"] = "raised-cosine",
        rest: float = 0.0,
    ) -> Signal:
        """Faded in and out, from and to `rest`; the signal must be finite."""
        from haptix.stimuli.algebra import Window

        return Window(self, rise_s, rise_s if fall_s is None else fall_s, shape, rest)


def as_signal(value: Signal | float) -> Signal:
    """Return a signal; a number is a constant without end."""
    if isinstance(value, Signal):
        return value
    if isinstance(value, bool) or not isinstance(value, Real):
        raise InputError(f"expected a signal or a number, got {value!r}")
    return Constant(float(value))


def signal_from(table: Any, place: str = "signal") -> Signal:
    """Read a signal from a table as `Signal.describe` writes it; a number is a constant.

    Raises
    ------
    InputError
        If a kind or a field is unknown, missing or wrong; the message says where.
    """
    if isinstance(table, Signal):
        return table
    if isinstance(table, int | float) and not isinstance(table, bool):
        return Constant(float(table))
    if not isinstance(table, Mapping) or "kind" not in table:
        raise InputError(f'{place}: expected a table with a "kind", or a number, got {table!r}')
    if table["kind"] not in KINDS:
        raise InputError(
            f"{place}.kind: unknown {table['kind']!r}; expected one of {', '.join(sorted(KINDS))}"
        )
    kind = KINDS[table["kind"]]
    known = {field.name: field for field in fields(kind)}  # type: ignore[arg-type]
    given: dict[str, Any] = {}
    for name, value in table.items():
        if name == "kind":
            continue
        if name not in known:
            raise InputError(
                f"{place}.{name}: {table['kind']} has no such field; expected some of "
                f"{', '.join(known)}"
            )
        given[name] = _read(value, f"{place}.{name}")
    try:
        return kind(**given)
    except InputError as error:
        raise InputError(f"{place}: {error}") from None
    except TypeError as error:
        # "__init__() missing 1 required positional argument: 'frequency_hz'"
        raise InputError(f"{place} ({table['kind']}): {str(error).split('__init__() ')[-1]}") from (
            None
        )


def _read(value: Any, place: str) -> Any:
    if isinstance(value, Mapping) and "kind" in value:
        from haptix.stimuli.speed import SPEEDS, speed_from

        return speed_from(value, place) if value["kind"] in SPEEDS else signal_from(value, place)
    if isinstance(value, list | tuple):
        return tuple(_read(item, f"{place}[{i}]") for i, item in enumerate(value))
    return inf if value == "forever" else value


def _plain(value: Any) -> Any:
    if hasattr(value, "describe"):
        return value.describe()
    if isinstance(value, tuple):
        return [_plain(item) for item in value]
    if isinstance(value, np.generic):
        value = value.item()
    return "forever" if value == inf else value


def number(name: str, value: Any, least: float = -inf, open_end: bool = False) -> None:
    """Refuse what is no number of at least `least`; infinite only with `open_end`."""
    good = isinstance(value, Real) and not isinstance(value, bool)
    if not good or not (isfinite(value) or (open_end and value == inf)) or value < least:
        bound = "" if least == -inf else f" of at least {least:g}"
        raise InputError(f"{name}: expected a {'' if open_end else 'finite '}number{bound}, "
                         f"got {value!r}")  # fmt: skip


def read_row(owner: object, *names: str) -> None:
    """Make tuples of the lists and arrays of numbers in some fields of a frozen dataclass."""
    for name in names:
        value = getattr(owner, name)
        if isinstance(value, list | np.ndarray):
            object.__setattr__(owner, name, tuple(np.asarray(value).tolist()))


def positive(name: str, value: Any, open_end: bool = False) -> None:
    """Refuse what is no number above 0."""
    number(name, value, 0.0, open_end)
    if value == 0:
        raise InputError(f"{name}: expected a number above 0, got 0")


@dataclass(frozen=True)
class Constant(Signal):
    """One value."""

    kind = "constant"
    value: float
    length_s: float = inf

    def __post_init__(self) -> None:
        number("value", self.value)
        positive("length_s", self.length_s, open_end=True)

    @property
    def length(self) -> float:
        """Length [s]."""
        return self.length_s

    def inside(self, first: int, count: int, sample_rate_hz: float) -> Array:
        """Values."""
        return np.full(count, float(self.value))
