"""Transformed and weighted up-down methods."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, nan, sqrt
from typing import Any

import numpy as np

from haptix.checks import number, positive, whole
from haptix.errors import InputError
from haptix.stimuli.adaptive.method import Estimate, Method


@dataclass(eq=False)
class UpDown(Method):
    """Down after several right answers in a row, up after a wrong one, in shrinking steps.

    Levitt, J. Acoust. Soc. Am. 49, 467 (1971); weights after Kaernbach, Percept. Psychophys. 49,
    227 (1991). With steps of one size it converges where ``p^n = w / (1 + w)``: at 79.4 % right for
    the usual three down, one up.

    Parameters
    ----------
    start : float
        First level, in the unit of the steps, such as dB.
    steps : tuple of float
        Sizes of the steps down, in their order.
    reversals_per_step : int
        Reversals after which the next size is used.
    stop_after : int
        Reversals at the last size until it is done.
    down_after : int
        Right answers in a row that lead down (n).
    up_weight : float
        Size of a step up over that of one down (w).
    lowest, highest : float
        Range of the levels.
    """

    start: float
    steps: tuple[float, ...] = (4.0, 2.0, 1.0)
    reversals_per_step: int = 2
    stop_after: int = 8
    down_after: int = 3
    up_weight: float = 1.0
    lowest: float = -inf
    highest: float = inf

    kind = "up-down"

    def __post_init__(self) -> None:
        number("start", self.start)
        if not self.steps:
            raise InputError("steps: expected one size or more")
        for size in (*self.steps, self.up_weight):
            positive("steps and up_weight", size)
        for name in ("reversals_per_step", "stop_after", "down_after"):
            whole(name, getattr(self, name), 1)
        if not self.lowest <= self.start <= self.highest:
            raise InputError(
                f"start: expected {self.lowest:g} to {self.highest:g}, got {self.start:g}"
            )
        self._level = float(self.start)
        self._in_a_row = self._direction = 0
        self.reversals: list[float] = []
        """Levels at which the direction changed."""

    @property
    def target(self) -> float:
        """Share of right answers at which it converges."""
        return float((self.up_weight / (1 + self.up_weight)) ** (1 / self.down_after))

    @property
    def level(self) -> float:
        return self._level

    @property
    def is_done(self) -> bool:
        return len(self.reversals) >= self._before_last_size + self.stop_after

    @property
    def _before_last_size(self) -> int:
        """Number of reversals before the last size of step."""
        return self.reversals_per_step * (len(self.steps) - 1)

    @property
    def _step(self) -> float:
        return self.steps[min(len(self.reversals) // self.reversals_per_step, len(self.steps) - 1)]

    def update(self, is_right: bool, level: float | None = None) -> None:
        at = self._level if level is None else float(level)
        if is_right:
            self._in_a_row += 1
            if self._in_a_row < self.down_after:
                return
        self._in_a_row = 0
        direction = -1 if is_right else 1
        if self._direction not in (0, direction):
            self.reversals.append(at)
        self._direction = direction
        size = self._step if direction < 0 else self._step * self.up_weight
        self._level = min(max(at + direction * size, self.lowest), self.highest)

    def estimate(self) -> Estimate:
        """Mean of the reversals at the last size of step, an even number of them."""
        used = self.reversals[self._before_last_size :]
        used = used[len(used) % 2 :]
        if not used:
            return Estimate(self._level, nan, {})
        spread = float(np.std(used, ddof=1) / sqrt(len(used))) if len(used) > 1 else nan
        return Estimate(float(np.mean(used)), spread, {"share_right": self.target})

    def describe(self) -> dict[str, Any]:
        return super().describe() | {"target": self.target}


def weighted_up_down(target: float, start: float, **others: Any) -> UpDown:
    """One up, one down, with steps that converge at any share of right answers (Kaernbach)."""
    if not 0 < target < 1:
        raise InputError(f"target: expected a share between 0 and 1, got {target!r}")
    return UpDown(start, down_after=1, up_weight=target / (1 - target), **others)
