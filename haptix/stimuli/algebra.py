"""The algebra of signals: sums, products, one after the other, again and again, cut and faded."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from typing import Any

import numpy as np

from haptix.errors import InputError
from haptix.stimuli.signal import Array, Constant, Signal, as_signal, number, positive


def _read_parts(signal: Sum | Product | Concatenation) -> None:
    """Make constants of numbers, and refuse what is neither."""
    parts: Any = signal.parts
    if not isinstance(parts, tuple | list) or not parts:
        raise InputError(f"parts: expected one signal or more, got {parts!r}")
    object.__setattr__(signal, "parts", tuple(as_signal(part) for part in parts))


@dataclass(frozen=True)
class Sum(Signal):
    """Signals added; as long as the longest, those that have ended add 0."""

    kind = "sum"
    parts: tuple[Signal, ...]

    def __post_init__(self) -> None:
        _read_parts(self)

    @property
    def length(self) -> float:
        """Length [s] of the longest; a constant without end takes that of the others."""
        ends = [part.length for part in self.parts]
        bounded = [
            part.length
            for part in self.parts
            if not (isinstance(part, Constant) and part.length == inf)
        ]
        return max(bounded or ends)

    def inside(self, first: int, count: int, sample_rate_hz: float) -> Array:
        """Values."""
        total = np.zeros(count)
        for part in self.parts:
            if isinstance(part, Constant) and part.length == inf:
                total += part.value
            else:
                total += part.values(first, count, sample_rate_hz)
        return total


@dataclass(frozen=True)
class Product(Signal):
    """Signals multiplied; as long as the shortest."""

    kind = "product"
    parts: tuple[Signal, ...]

    def __post_init__(self) -> None:
        _read_parts(self)

    @property
    def length(self) -> float:
        """Length [s] of the shortest."""
        return min(part.length for part in self.parts)

    def inside(self, first: int, count: int, sample_rate_hz: float) -> Array:
        """Values."""
        total = np.ones(count)
        for part in self.parts:
            if isinstance(part, Constant):
                total *= part.value
            else:
                total *= part.values(first, count, sample_rate_hz)
        return total


@dataclass(frozen=True)
class Concatenation(Signal):
    """Signals one after the other."""

    kind = "concatenation"
    parts: tuple[Signal, ...]

    def __post_init__(self) -> None:
        _read_parts(self)
        endless = [i for i, part in enumerate(self.parts[:-1]) if part.length == inf]
        if endless:
            raise InputError(
                f"parts[{endless[0]}] has no end, so that nothing can follow it; give it a length"
            )

    @property
    def length(self) -> float:
        """Length [s] of all."""
        return sum(part.length for part in self.parts)

    def samples(self, sample_rate_hz: float) -> int | None:
        """Length in samples: each part is rounded to whole ones."""
        counts = [part.samples(sample_rate_hz) for part in self.parts]
        return None if counts[-1] is None else sum(count or 0 for count in counts)

    def inside(self, first: int, count: int, sample_rate_hz: float) -> Array:
        """Values."""
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
class Repetition(Signal):
    """A finite signal again and again; `times` may be infinite."""

    kind = "repetition"
    of: Signal
    times: float = inf

    def __post_init__(self) -> None:
        object.__setattr__(self, "of", as_signal(self.of))
        if self.of.length == inf:
            raise InputError("of: has no end, so that it cannot repeat; give it a length")
        number("times", self.times, 1, open_end=True)
        if self.times != inf and self.times != int(self.times):
            raise InputError(f"times: expected a whole number, got {self.times!r}")

    @property
    def length(self) -> float:
        """Length [s] of all repetitions."""
        return self.of.length * self.times

    def samples(self, sample_rate_hz: float) -> int | None:
        """Length in samples: whole ones of each repetition."""
        return None if self.times == inf else self._size(sample_rate_hz) * int(self.times)

    def _size(self, sample_rate_hz: float) -> int:
        return max(1, self.of.samples(sample_rate_hz) or 0)

    def inside(self, first: int, count: int, sample_rate_hz: float) -> Array:
        """Values."""
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
class Excerpt(Signal):
    """The first `length_s` of a signal; 0 where it has ended before."""

    kind = "excerpt"
    of: Signal
    length_s: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "of", as_signal(self.of))
        positive("length_s", self.length_s)

    @property
    def length(self) -> float:
        """Length [s]."""
        return self.length_s

    def inside(self, first: int, count: int, sample_rate_hz: float) -> Array:
        """Values."""
        return self.of.values(first, count, sample_rate_hz)


@dataclass(frozen=True)
class Window(Signal):
    """A finite signal faded in from `rest` and out to it."""

    kind = "window"
    of: Signal
    rise_s: float
    fall_s: float
    shape: str = "raised-cosine"
    rest: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "of", as_signal(self.of))
        number("rise_s", self.rise_s, 0.0)
        number("fall_s", self.fall_s, 0.0)
        number("rest", self.rest)
        if self.shape not in ("raised-cosine", "linear"):
            raise InputError(f'shape: expected "raised-cosine" or "linear", got {self.shape!r}')
        if self.of.length == inf:
            raise InputError("of: has no end, so that it cannot fade out; give it a length")
        if self.rise_s + self.fall_s > self.of.length * (1 + 1e-9):
            raise InputError(
                f"rise_s and fall_s: expected at most the signal's {self.of.length:g} s together, "
                f"got {self.rise_s:g} s and {self.fall_s:g} s"
            )

    @property
    def length(self) -> float:
        """Length [s], as without the window."""
        return self.of.length

    def samples(self, sample_rate_hz: float) -> int | None:
        """Length in samples, as without the window."""
        return self.of.samples(sample_rate_hz)

    def inside(self, first: int, count: int, sample_rate_hz: float) -> Array:
        """Values."""
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
