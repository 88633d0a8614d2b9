"""Signals: documents that are evaluated block by block, and their algebra.

A signal is a quantity against time. Its value at a sample depends only on the sample's number and
the sample rate. So it can be streamed in blocks, by several threads, in any order.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator, Mapping
from contextlib import suppress
from functools import cached_property
from math import inf
from numbers import Real
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Self, dataclass_transform

import numpy as np
import numpy.typing as npt
from pydantic import (
    BeforeValidator,
    Field,
    PlainSerializer,
    PlainValidator,
    WithJsonSchema,
    model_validator,
)

from haptix.base import checks
from haptix.base.checks import increasing
from haptix.base.errors import InputError
from haptix.base.kinds import Kind, Kinds
from haptix.base.units import FOREVER

Array = npt.NDArray[np.float64]

_MODULES = {
    "along_path": ("along-path", "material"),
    "signals.shapes": (
        "chirp", "morph", "points", "pulse", "ramp", "recorded", "sine", "square", "step",
        "time-noise",
    ),
    "signals.signal": (
        "concatenation", "constant", "excerpt", "product", "repetition", "sum", "window",
    ),
}  # fmt: skip
KINDS = Kinds(
    "haptix.feel.signals",
    {kind: f"haptix.feel.{module}" for module, kinds in _MODULES.items() for kind in kinds},
    {name: f"haptix.feel.along_path:{name}" for name in ("grating", "relief")},
)
"""Every kind of signal by its name in recipes and sidecars; a subclass enters itself."""


_AS_HELD = PlainSerializer(lambda value: FOREVER if value == inf else value)

Number = Annotated[checks.Number, _AS_HELD]
Positive = Annotated[checks.Positive, _AS_HELD]
NotNegative = Annotated[checks.NotNegative, _AS_HELD]
Length = Annotated[
    checks.Length,
    BeforeValidator(lambda value: inf if isinstance(value, str) and value == FOREVER else value),
    _AS_HELD,
    WithJsonSchema({"anyOf": [{"type": "number", "exclusiveMinimum": 0}, {"const": FOREVER}]}),
]
"""A number above 0 that may be infinite: "forever" in files."""


def _row(values: Any) -> Any:
    with suppress(ValueError):  # not of one shape
        array = np.asarray(values)
        return array.tolist() if array.dtype.kind in "iuf" else values
    return values


Row = Annotated[tuple[Number, ...], BeforeValidator(_row)]


if TYPE_CHECKING:  # that of pydantic lets its checkers take fields by name only
    from pydantic._internal._model_construction import ModelMetaclass

    @dataclass_transform(frozen_default=True, field_specifiers=(Field,))
    class _ByPlace(ModelMetaclass):
        pass

else:
    _ByPlace = type(Kind)


class Described(Kind, metaclass=_ByPlace):
    """Base of what recipes and sidecars hold; its fields may be given by their places.

    `kind` stands last in a class: type checkers count the fields before it.
    """

    def __init__(self, /, *values: Any, **fields: Any) -> None:
        names = [name for name in type(self).model_fields if name != "kind"]
        super().__init__(*values[len(names) :], **dict(zip(names, values, strict=False)), **fields)

    def _check_corners(self, places: str, values: str) -> None:
        """Check two rows: two corners or more at increasing places, with a value for each."""
        corners = increasing(places, getattr(self, places), 2)
        if len(corners) != len(getattr(self, values)):
            raise InputError(f"{places}: expected as many as {values}, got {len(corners)}")


class Signal(Described):
    """Base of all signals; ``+``, ``-`` and ``*`` take signals and numbers.

    A subclass is one kind. It gives `kind` its name, adds fields and a `length_s`, and defines
    `_inside`. A package brings a kind with an entry point of the group ``haptix.feel.signals``.
    """

    kinds: ClassVar[Kinds] = KINDS

    if TYPE_CHECKING:  # a field of some, and a property of others

        @property
        def length_s(self) -> float:
            """Length; `math.inf` for a signal without end."""

    def samples(self, sample_rate_hz: float) -> int | None:
        """Length in samples; None for a signal without end."""
        return None if self.length_s == inf else round(self.length_s * sample_rate_hz)

    def values(self, first: int, count: int, sample_rate_hz: float) -> Array:
        """Values at `count` samples from number `first` on, shape (count,); 0 past the end.

        Parameters
        ----------
        first : int
            Number of the first sample; 0 is at the signal's start.
        count : int
        sample_rate_hz : float

        Examples
        --------
        >>> Constant(0.3, length_s=1.0).values(0, 2, 48000.0).tolist()
        [0.3, 0.3]
        """
        total = self.samples(sample_rate_hz)
        within = count if total is None else min(count, max(0, total - first))
        if within == count:
            return self._inside(first, count, sample_rate_hz)
        values = np.zeros(count)
        if within:
            values[:within] = self._inside(first, within, sample_rate_hz)
        return values

    @abstractmethod
    def _inside(self, first: int, count: int, sample_rate_hz: float) -> Array:
        """Values at samples that lie within the length."""

    def walk(self) -> Iterator[Kind]:
        """Yield this signal and the documents within it."""
        yield self
        for name in type(self).model_fields:
            value = getattr(self, name)
            for part in value if isinstance(value, tuple) else (value,):
                if isinstance(part, Signal):
                    yield from part.walk()
                elif isinstance(part, Kind):
                    yield part

    @property
    def seeds(self) -> tuple[int, ...]:
        """Seeds of all noise within."""
        seeds = (getattr(part, "seed", None) for part in self.walk() if isinstance(part, Signal))
        return tuple(seed for seed in seeds if seed is not None)

    def __add__(self, other: Signal | float) -> Signal:
        return Sum((self, signal_from(other)))

    def __radd__(self, other: float) -> Signal:
        return Sum((signal_from(other), self))

    def __sub__(self, other: Signal | float) -> Signal:
        return Sum((self, -other if isinstance(other, Signal) else signal_from(-other)))

    def __rsub__(self, other: float) -> Signal:
        return other + (-self)

    def __neg__(self) -> Signal:
        return Product((Constant(-1.0), self))

    def __mul__(self, other: Signal | float) -> Signal:
        return Product((self, signal_from(other)))

    def __rmul__(self, other: float) -> Signal:
        return Product((signal_from(other), self))

    def then(self, *others: Signal) -> Signal:
        """Play other signals after this one; all but the last must be finite.

        Examples
        --------
        >>> Constant(1.0, length_s=0.5).then(Constant(0.0, length_s=0.5)).length_s
        1.0
        """
        return Concatenation((self, *others))

    def repeat(self, times: float = inf) -> Signal:
        """Repeat the signal; without end if no number is given.

        Examples
        --------
        >>> Constant(1.0, length_s=0.5).repeat(3).length_s
        1.5
        """
        return Repetition(self, times)

    def lasting(self, length_s: float) -> Signal:
        """Cut to a length, or fill up with 0.

        Examples
        --------
        >>> Constant(1.0).lasting(2.0).length_s
        2.0
        """
        return Excerpt(self, length_s)

    def window(
        self,
        rise_s: float,
        fall_s: float | None = None,
        shape: Literal["raised-cosine", "linear"] = "raised-cosine",
        rest: float = 0.0,
    ) -> Signal:
        """Fade in from `rest` and out to it; the signal must be finite.

        Parameters
        ----------
        rise_s : float
            Time of the fade in [s].
        fall_s : float, optional
            Time of the fade out [s]; the same if not given.
        shape : str
            "raised-cosine" or "linear".
        rest : float
            Value before and after.

        Examples
        --------
        >>> Constant(1.0, length_s=1.0).window(0.1).length_s
        1.0
        """
        return Window(self, rise_s, rise_s if fall_s is None else fall_s, shape, rest)


def signal_from(table: Any, place: str = "") -> Signal:
    """Read a signal from a table as `Signal.describe` writes it; a number is a constant.

    Parameters
    ----------
    table : mapping, float or Signal
    place : str
        Where it stands in its document, for messages.

    Raises
    ------
    InputError
        If a kind or a field is unknown, missing or wrong; the message begins with `place`.

    Examples
    --------
    >>> signal_from({"kind": "constant", "value": 0.3}).value
    0.3
    """
    if isinstance(table, Signal):
        return table
    try:
        if isinstance(table, Mapping):
            signal: Signal = KINDS.read("signal", table)
            return signal
        if isinstance(table, bool) or not isinstance(table, Real):
            raise InputError(
                f'expected a table with a "kind", a signal or a number, got {table!r:.80}'
            )
        return Constant(float(table))
    except InputError as error:
        raise InputError(f"{place}: {error}" if place else str(error)) from None


ANY_SIGNAL = "a signal of any kind"
"""Stands in schemas for all kinds: pydantic knows no reference to kinds registered later."""

AnySignal = Annotated[
    Signal,
    PlainValidator(signal_from),
    PlainSerializer(lambda signal: signal.describe()),
    WithJsonSchema({"title": ANY_SIGNAL}),
]
"""A field that holds any signal: itself, its table, or a number, which is a constant."""


class Constant(Signal):
    """A constant value.

    Parameters
    ----------
    value : float
        The value.
    length_s : float
        Length [s]; endless if not given.

    Examples
    --------
    >>> Constant(0.3, length_s=1.0).values(0, 3, 48000.0).tolist()
    [0.3, 0.3, 0.3]
    """

    value: Number
    length_s: Length = inf
    kind: Literal["constant"] = "constant"

    def _inside(self, first: int, count: int, sample_rate_hz: float) -> Array:
        return np.full(count, float(self.value))


class _OfParts(Signal):
    """A signal of several, or of numbers, which are constants."""

    parts: Annotated[tuple[AnySignal, ...], Field(min_length=1)]


class Sum(_OfParts):
    """Signals added; as long as the longest. A signal that has ended adds 0.

    A constant without end takes the length of the others.

    Examples
    --------
    >>> (Constant(0.25, length_s=1.0) + 0.5).values(0, 2, 48000.0).tolist()
    [0.75, 0.75]
    """

    kind: Literal["sum"] = "sum"

    @cached_property
    def length_s(self) -> float:
        """Length of the longest."""
        lengths = [
            part.length_s
            for part in self.parts
            if part.length_s < inf or not isinstance(part, Constant)
        ]
        return max(lengths, default=inf)

    def _inside(self, first: int, count: int, sample_rate_hz: float) -> Array:
        total = np.zeros(count)
        for part in self.parts:
            total += part.values(first, count, sample_rate_hz)
        return total


class Product(_OfParts):
    """Signals multiplied; as long as the shortest.

    Examples
    --------
    >>> (Constant(0.5, length_s=1.0) * Constant(0.5)).values(0, 2, 48000.0).tolist()
    [0.25, 0.25]
    """

    kind: Literal["product"] = "product"

    @cached_property
    def length_s(self) -> float:
        """Length of the shortest."""
        return min(part.length_s for part in self.parts)

    def _inside(self, first: int, count: int, sample_rate_hz: float) -> Array:
        total = np.ones(count)
        for part in self.parts:
            total *= part.values(first, count, sample_rate_hz)
        return total


class Concatenation(_OfParts):
    """Signals one after the other.

    Examples
    --------
    >>> Constant(1.0, length_s=0.5).then(Constant(0.0, length_s=0.25)).length_s
    0.75
    """

    kind: Literal["concatenation"] = "concatenation"

    @model_validator(mode="after")
    def _can_follow(self) -> Self:
        for i, part in enumerate(self.parts[:-1]):
            if part.length_s == inf:
                raise InputError(
                    f"parts[{i}] has no end, so that nothing can follow it; give it a length"
                )
        return self

    @cached_property
    def length_s(self) -> float:
        """Length of all together."""
        return sum(part.length_s for part in self.parts)

    def samples(self, sample_rate_hz: float) -> int | None:
        """Length in samples: each part is rounded to whole ones."""
        counts = [part.samples(sample_rate_hz) for part in self.parts]
        return None if counts[-1] is None else sum(count or 0 for count in counts)

    def _inside(self, first: int, count: int, sample_rate_hz: float) -> Array:
        values = np.zeros(count)
        start = 0
        for part in self.parts:
            size = part.samples(sample_rate_hz)
            low = max(first, start)
            high = first + count if size is None else min(first + count, start + size)
            if low < high:
                values[low - first : high - first] = part.values(
                    low - start, high - low, sample_rate_hz
                )
            start += size or 0
        return values


class _OfOne(Signal):
    """A signal of another one, or of a number, which is a constant."""

    of: AnySignal

    def _needs_end(self, to: str) -> None:
        if self.of.length_s == inf:
            raise InputError(f"of: has no end, so that it cannot {to}; give it a length")


class Repetition(_OfOne):
    """A finite signal repeated; `times` may be infinite.

    Parameters
    ----------
    of : Signal
    times : float
        How often; endless if not given.

    Examples
    --------
    >>> Constant(0.3, length_s=0.5).repeat(4).length_s
    2.0
    """

    times: Length = inf
    kind: Literal["repetition"] = "repetition"

    @model_validator(mode="after")
    def _can_repeat(self) -> Self:
        self._needs_end("repeat")
        if self.times != inf and self.times != int(self.times):
            raise InputError(f"times: expected a whole number, got {self.times!r}")
        return self

    @property
    def length_s(self) -> float:
        """Length of all repetitions."""
        return self.of.length_s * self.times

    def samples(self, sample_rate_hz: float) -> int | None:
        """Length in samples, a whole number for each repetition."""
        return None if self.times == inf else self._size(sample_rate_hz) * int(self.times)

    def _size(self, sample_rate_hz: float) -> int:
        return max(1, self.of.samples(sample_rate_hz) or 0)

    def _inside(self, first: int, count: int, sample_rate_hz: float) -> Array:
        size = self._size(sample_rate_hz)
        if size <= count:
            once = self.of.values(0, size, sample_rate_hz)
            return np.asarray(np.resize(np.roll(once, -(first % size)), count))
        values = np.empty(count)
        done = 0
        while done < count:
            start = (first + done) % size
            run = min(count - done, size - start)
            values[done : done + run] = self.of.values(start, run, sample_rate_hz)
            done += run
        return values


class Excerpt(_OfOne):
    """The first `length_s` of a signal; 0 where it has ended before.

    Parameters
    ----------
    of : Signal
    length_s : float

    Examples
    --------
    >>> Constant(0.3).lasting(0.5).length_s
    0.5
    """

    length_s: Positive
    kind: Literal["excerpt"] = "excerpt"

    def _inside(self, first: int, count: int, sample_rate_hz: float) -> Array:
        return self.of.values(first, count, sample_rate_hz)


class Window(_OfOne):
    """A finite signal faded in from `rest` and out to it.

    Parameters
    ----------
    of : Signal
    rise_s, fall_s : float
        Times of the fades in and out [s].
    shape : str
        "raised-cosine" or "linear".
    rest : float
        Value before and after.

    Examples
    --------
    >>> faded = Constant(1.0, length_s=1.0).window(0.25, shape="linear")
    >>> faded.values(0, 5, 4.0).tolist()[:2]
    [0.0, 1.0]
    """

    rise_s: NotNegative
    fall_s: NotNegative
    shape: Literal["raised-cosine", "linear"] = "raised-cosine"
    rest: Number = 0.0
    kind: Literal["window"] = "window"

    @model_validator(mode="after")
    def _fits(self) -> Self:
        self._needs_end("fade out")
        if self.rise_s + self.fall_s > self.length_s * (1 + 1e-9):
            raise InputError(
                f"rise_s and fall_s: expected at most the signal's {self.length_s:g} s together, "
                f"got {self.rise_s:g} s and {self.fall_s:g} s"
            )
        return self

    @property
    def length_s(self) -> float:
        """Length, as without the window."""
        return self.of.length_s

    def samples(self, sample_rate_hz: float) -> int | None:
        """Length in samples, as without the window."""
        return self.of.samples(sample_rate_hz)

    def _inside(self, first: int, count: int, sample_rate_hz: float) -> Array:
        values = self.of.values(first, count, sample_rate_hz)
        last = (self.of.samples(sample_rate_hz) or 1) - 1
        rise, fall = self.rise_s * sample_rate_hz, self.fall_s * sample_rate_hz
        if first >= rise and first + count <= last - fall:
            return values
        n = np.arange(first, first + count, dtype=float)
        share = np.ones(count)
        if rise > 0:
            share = np.minimum(share, n / rise)
        if fall > 0:
            share = np.minimum(share, (last - n) / fall)
        if self.shape == "raised-cosine":
            share = 0.5 - 0.5 * np.cos(np.pi * share)
        return np.asarray(self.rest + share * (values - self.rest))
