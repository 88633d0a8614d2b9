"""Numbers that go from one value to another along a line in time."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf

import numpy as np

from haptix.checks import Array

Row = tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Glide:
    """A row of numbers: `before` until `start_s`, `after` from `end_s` on, a line in between."""

    before: Row
    after: Row
    start_s: float = -inf
    end_s: float = -inf

    @classmethod
    def resting(cls, *values: float) -> Glide:
        """Numbers that stay."""
        return cls(values, values)

    def to(self, values: Row, from_s: float, over_s: float) -> Glide:
        """Glide to other numbers, from what these are then."""
        return Glide(self.at(from_s), values, from_s, from_s + over_s)

    def at(self, t_s: float) -> Row:
        """Numbers at a time."""
        if t_s >= self.end_s:
            return self.after
        if t_s <= self.start_s:
            return self.before
        part = (t_s - self.start_s) / (self.end_s - self.start_s)
        return tuple(a + part * (b - a) for a, b in zip(self.before, self.after, strict=True))

    def parts(self, t_s: Array) -> Array:
        """Share of the way gone at times."""
        if not self.end_s > self.start_s:
            return (t_s >= self.end_s).astype(np.float64)
        return np.asarray(np.clip((t_s - self.start_s) / (self.end_s - self.start_s), 0.0, 1.0))
