"""Transformed and weighted up-down methods."""

from __future__ import annotations

from math import nan, sqrt
from typing import Any

import numpy as np

from haptix.checks import number, positive, whole
from haptix.errors import InputError
from haptix.stimuli.adaptive.method import Estimate


class UpDown:
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

    def __init__(
        self,
        start: float,
        steps: tuple[float, ...] = (4.0, 2.0, 1.0),
        reversals_per_step: int = 2,
        stop_after: int = 8,
        down_after: int = 3,
        up_weight: float = 1.0,
        lowest: float = -np.inf,
        highest: float = np.inf,
    ) -> None:
        number("start", start)
        if not steps:
            raise InputError("steps: expected one size or more")
        for size in (*steps, up_weight):
            positive("steps and up_weight", size)
        for name, count in (
            ("reversals_per_step", reversals_per_step), ("stop_after", stop_after),
            ("down_after", down_after),
        ):  # fmt: skip
            whole(name, count, 1)
        if not lowest <= start <= highest:
            raise InputError(f"start: expected {lowest:g} to {highest:g}, got {start:g}")
        self.start, self.steps = float(start), tuple(float(size) for size in steps)
        self.reversals_per_step, self.stop_after = reversals_per_step, stop_after
        self.down_after, self.up_weight = down_after, float(up_weight)
        self.lowest, self.highest = float(lowest), float(highest)
        self._level = self.start
        self._in_a_row = 0
        self._direction = 0
        self.reversals: list[float] = []
        """Levels at which the direction changed."""

    @property
    def target(self) -> float:
        """Share of right answers at which it converges."""
        return float((self.up_weight / (1 + self.up_weight)) ** (1 / self.down_after))

    @property
    def level(self) -> float:
        """The level to be presented next."""
        return self._level

    @property
    def is_done(self) -> bool:
        """Whether all reversals are done."""
        before = self.reversals_per_step * (len(self.steps) - 1)
        return len(self.reversals) >= before + self.stop_after

    @property
    def _step(self) -> float:
        return self.steps[min(len(self.reversals) // self.reversals_per_step, len(self.steps) - 1)]

    def update(self, is_right: bool, level: float | None = None) -> None:
        """Take an answer."""
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
        before = self.reversals_per_step * (len(self.steps) - 1)
        used = self.reversals[before:]
        used = used[len(used) % 2 :]
        if not used:
            return Estimate(self._level, nan, {})
        spread = float(np.std(used, ddof=1) / sqrt(len(used))) if len(used) > 1 else nan
        return Estimate(float(np.mean(used)), spread, {"share_right": self.target})

    def describe(self) -> dict[str, Any]:
        """Everything that determines what it does."""
        return {
            "method": "up-down",
            "start": self.start,
            "steps": list(self.steps),
            "reversals_per_step": self.reversals_per_step,
            "stop_after": self.stop_after,
            "down_after": self.down_after,
            "up_weight": self.up_weight,
            "lowest": None if self.lowest == -np.inf else self.lowest,
            "highest": None if self.highest == np.inf else self.highest,
            "target": self.target,
        }


def weighted_up_down(target: float, start: float, **others: Any) -> UpDown:
    """One up, one down, with steps that converge at any share of right answers (Kaernbach)."""
    if not 0 < target < 1:
        raise InputError(f"target: expected a share between 0 and 1, got {target!r}")
    return UpDown(start, down_after=1, up_weight=target / (1 - target), **others)
