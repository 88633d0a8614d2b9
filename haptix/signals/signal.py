"""Signals: frozen descriptions that are evaluated block by block, and their algebra.

A signal is a quantity against time. Its value at a sample depends only on the sample's number and
the sample rate. So it can be streamed in blocks, by several threads, in any order.
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from math import inf
from numbers import Real
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from haptix.checks import Length, NotNegative, Positive, choice, number
from haptix.errors import InputError
from haptix.signals.described import Described, read

Array = npt.NDArray[np.float64]


class Signal(Described):
    """Base of all signals; ``+``, ``-`` and ``*`` take signals and numbers.

    Attributes
    ----------
    length_s : float
        Length; `math.inf` for a signal without end.
    """

    length_s: float

    def samples(self, sample_rate_hz: float) -> int | None:
        """Length in samples; None for a signal without end."""
        return None if self.length_s == inf else round(self.length_s * sample_rate_hz)

    def values(self, first: int, count: int, sample_rate_hz: float) -> Array:
        """Values at `count` samples from number `first` on, shape (count,); 0 past the end."""
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

    @property
    def seeds(self) -> tuple[int, ...]:
        """Seeds of all noise within."""
        return tuple(int(part.seed) for part in self.walk() if hasattr(part, "seed"))

    def __add__(self, other: Signal | float) -> Signal:
        return Sum((self, as_signal(other)))

    def __radd__(self, other: float) -> Signal:
        return Sum((as_signal(other), self))

    def __sub__(self, other: Signal | float) -> Signal:
        return Sum((self, -other if isinstance(other, Signal) else as_signal(-other)))

    def __rsub__(self, other: float) -> Signal:
        return other + (-self)

    def __neg__(self) -> Signal:
        return Product((Constant(-1.0), self))

    def __mul__(self, other: Signal | float) -> Signal:
        return Product((self, as_signal(other)))

    def __rmul__(self, other: float) -> Signal:
        return Product((as_signal(other), self))

    def then(self, *others: Signal) -> Signal:
        """Play other signals after this one; all but the last must be finite."""
        return Concatenation((self, *others))

    def repeat(self, times: float = inf) -> Signal:
        """Repeat the signal; without end if no number is given."""
        return Repetition(self, times)

    def lasting(self, length_s: float) -> Signal:
        """Cut to a length, or fill up with 0."""
        return Excerpt(self, length_s)

    def window(
        self,
        rise_s: float,
        fall_s: float | None = None,
        shape: Literal["raised-cosine", "linear"] = "raised-cosine",
        rest: float = 0.0,
    ) -> Signal:
        """Fade in from `rest` and out to it; the signal must be finite."""
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
    if isinstance(table, Signal | int | float) and not isinstance(table, bool):
        return as_signal(table)
    found: object = read(table, place)
    if not isinstance(found, Signal):
        raise InputError(f"{place}: expected a signal, got a {table['kind']}")
    return found


@dataclass(frozen=True)
class Constant(Signal):
    """A constant value."""

    kind = "constant"
    value: float
    length_s: Length = inf

    def _inside(self, first: int, count: int, sample_rate_hz: float) -> Array:
        return np.full(count, float(self.value))


@dataclass(frozen=True)
class _OfParts(Signal):
    """A signal of several, or of numbers, which are constants."""

    parts: tuple[Signal, ...]

    def __post_init__(self) -> None:
        parts: Any = self.parts
        if not isinstance(parts, tuple | list) or not parts:
            raise InputError(f"parts: expected one signal or more, got {parts!r}")
        object.__setattr__(self, "parts", tuple(as_signal(part) for part in parts))
        object.__setattr__(self, "length_s", self._length())

    def _length(self) -> float:
        return sum(part.length_s for part in self.parts)


class Sum(_OfParts):
    """Signals added; as long as the longest. A signal that has ended adds 0.

    A constant without end takes the length of the others.
    """

    kind = "sum"

    def _length(self) -> float:
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
    """Signals multiplied; as long as the shortest."""

    kind = "product"

    def _length(self) -> float:
        return min(part.length_s for part in self.parts)

    def _inside(self, first: int, count: int, sample_rate_hz: float) -> Array:
        total = np.ones(count)
        for part in self.parts:
            total *= part.values(first, count, sample_rate_hz)
        return total


class Concatenation(_OfParts):
    """Signals one after the other."""

    kind = "concatenation"

    def __post_init__(self) -> None:
        super().__post_init__()
        for i, part in enumerate(self.parts[:-1]):
            if part.length_s == inf:
                raise InputError(
                    f"parts[{i}] has no end, so that nothing can follow it; give it a length"
                )

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


@dataclass(frozen=True)
class _OfOne(Signal):
    """A signal of another one, or of a number, which is a constant."""

    of: Signal

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "of", as_signal(self.of))

    def _needs_end(self, to: str) -> None:
        if self.of.length_s == inf:
            raise InputError(f"of: has no end, so that it cannot {to}; give it a length")


@dataclass(frozen=True)
class Repetition(_OfOne):
    """A finite signal repeated; `times` may be infinite."""

    kind = "repetition"
    times: Length = inf

    def __post_init__(self) -> None:
        super().__post_init__()
        self._needs_end("repeat")
        number("times", self.times, 1, open_end=True)
        if self.times != inf and self.times != int(self.times):
            raise InputError(f"times: expected a whole number, got {self.times!r}")
        object.__setattr__(self, "length_s", self.of.length_s * self.times)

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


@dataclass(frozen=True)
class Excerpt(_OfOne):
    """The first `length_s` of a signal; 0 where it has ended before."""

    kind = "excerpt"
    length_s: Positive

    def _inside(self, first: int, count: int, sample_rate_hz: float) -> Array:
        return self.of.values(first, count, sample_rate_hz)


@dataclass(frozen=True)
class Window(_OfOne):
    """A finite signal faded in from `rest` and out to it."""

    kind = "window"
    rise_s: NotNegative
    fall_s: NotNegative
    shape: str = "raised-cosine"
    rest: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        choice("shape", self.shape, ("raised-cosine", "linear"))
        self._needs_end("fade out")
        length = self.of.length_s
        if self.rise_s + self.fall_s > length * (1 + 1e-9):
            raise InputError(
                f"rise_s and fall_s: expected at most the signal's {length:g} s together, "
                f"got {self.rise_s:g} s and {self.fall_s:g} s"
            )
        object.__setattr__(self, "length_s", length)

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
