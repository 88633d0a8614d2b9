"""The interface of adaptive methods: they choose a level and take an answer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from math import isinf
from typing import Any, ClassVar

import numpy as np


@dataclass(frozen=True)
class Estimate:
    """Result of a method: threshold, spread and other parameters."""

    threshold: float
    """Detection threshold, in the units of the levels; NaN if the answers give none."""
    spread: float
    """Standard deviation of the threshold; NaN if unknown."""
    others: dict[str, float]
    """Slope and other estimated parameters."""
    warnings: tuple[str, ...] = ()
    """Why there is no threshold, or why it may be wrong."""


@dataclass(eq=False)
class Method:
    """Chooses levels one at a time by the answers so far. A subclass has its settings as fields."""

    kind: ClassVar[str]
    """Name in recipes."""

    @property
    def level(self) -> float:
        """The level to be presented next."""
        raise NotImplementedError

    @property
    def is_done(self) -> bool:
        """Whether the method is finished."""
        raise NotImplementedError

    @property
    def other_level(self) -> float | None:
        """Level of what the next is compared with; None for the reference."""
        return None

    def update(self, is_right: float, level: float | None = None) -> None:
        """Take an answer; `level` is the presented level, if it differs from the method's.

        Right is True, or 1; where a number is the answer, it is that number.
        """
        raise NotImplementedError

    def estimate(self) -> Estimate:
        """Estimate from the answers so far."""
        raise NotImplementedError

    def describe(self) -> dict[str, Any]:
        """Everything that determines what it does, as plain values; no limit is None."""
        given = {one.name: getattr(self, one.name) for one in fields(self) if one.init}
        return {"method": self.kind} | {
            name: None if isinstance(value, float) and isinf(value) else value
            for name, value in given.items()
        }


class FixedOrder(Method):
    """A method whose presentations are in order before the first trial."""

    _order: list[tuple[float, ...]]
    """Level of each presentation, and of what it is compared with, if that is a level."""
    answers: Sequence[object]

    @property
    def _next(self) -> tuple[float, ...]:
        return self._order[min(len(self.answers), len(self._order) - 1)]

    @property
    def level(self) -> float:
        return self._next[0]

    @property
    def is_done(self) -> bool:
        return len(self.answers) >= len(self._order)


def shuffled(levels: Sequence[float], repeats: int, seed: int) -> list[tuple[float, ...]]:
    """Return all levels once in each repetition, in random order."""
    draw = np.random.default_rng(seed)
    return [(float(one),) for _ in range(repeats) for one in draw.permutation(list(levels))]
