"""Transformed and weighted up-down methods."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from math import erfc, exp, inf, isnan, nan, sqrt
from random import Random
from statistics import NormalDist
from typing import Any

import numpy as np

from haptix.checks import number, positive, whole
from haptix.errors import InputError
from haptix.stimuli.adaptive.evidence import counted, log_shares, unless_by_chance, without
from haptix.stimuli.adaptive.method import Estimate, Method

_MOST_HELD = 0.25  # of the trials, at an end of the range
_WALKS = 100  # of a bootstrap: its spread is known to 7 %
_LAPSE = 0.02
_MOST_SCATTER = 2.0
"""Of the last reversals, in steps: 5 to 8 % of good runs pass it, and 37 % with slope 1.5 and
lapses of 0.08, half of those that are off by more than 2.5 dB (150 runs, default settings)."""


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
    most_trials : int
        It is done after this many, whatever the reversals.
    guess : float
        Share right of one who guesses; a walk to a lower share is taken to have none.
    """

    start: float
    steps: tuple[float, ...] = (4.0, 2.0, 1.0)
    reversals_per_step: int = 2
    stop_after: int = 8
    down_after: int = 3
    up_weight: float = 1.0
    lowest: float = -inf
    highest: float = inf
    most_trials: int = 300
    guess: float = 0.5

    kind = "up-down"

    def __post_init__(self) -> None:
        number("start", self.start)
        if not self.steps:
            raise InputError("steps: expected one size or more")
        for size in (*self.steps, self.up_weight):
            positive("steps and up_weight", size)
        for name in ("reversals_per_step", "stop_after", "down_after", "most_trials"):
            whole(name, getattr(self, name), 1)
        if not self.lowest <= self.start <= self.highest:
            raise InputError(
                f"start: expected {self.lowest:g} to {self.highest:g}, got {self.start:g}"
            )
        if not 0 <= number("guess", self.guess) < 1:
            raise InputError(f"guess: expected a share of 0 to below 1, got {self.guess:g}")
        self._level = float(self.start)
        self.answers: list[tuple[float, bool]] = []
        """Level of each trial, and whether the answer was right."""
        self._ends = [self.lowest, self.highest]
        self._in_a_row = self._direction = 0
        self.reversals: list[float] = []
        """Levels at which the direction changed."""

    @property
    def target(self) -> float:
        """Share of right answers at which it converges."""
        return float((self.up_weight / (1 + self.up_weight)) ** (1 / self.down_after))

    @property
    def _guess(self) -> float:
        return self.guess if self.guess < self.target else 0.0

    @property
    def level(self) -> float:
        return self._level

    @property
    def is_done(self) -> bool:
        enough = len(self.reversals) >= self._before_last_size + self.stop_after
        return enough or len(self.answers) >= self.most_trials

    @property
    def _before_last_size(self) -> int:
        """Number of reversals before the last size of step."""
        return self.reversals_per_step * (len(self.steps) - 1)

    @property
    def _step(self) -> float:
        return self.steps[min(len(self.reversals) // self.reversals_per_step, len(self.steps) - 1)]

    def update(self, is_right: float, level: float | None = None) -> None:
        at = self._level if level is None else float(level)
        if at < self._level:  # it was lowered to what can be presented
            self._ends[1] = at
        self.answers.append((at, bool(is_right)))
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
        """Mean of the reversals at the last size of step, an even number of them.

        Reversals hang together: their standard error is two to three times too small. The spread is
        that of a parametric bootstrap instead: the same walk is simulated with an observer of the
        function that was fitted to the answers (Foster & Bischof, Psychol. Bull. 109, 152 (1991)).
        There is no threshold where the answers are those of a guesser, or where the walk was held
        at an end of its range.
        """
        used = self._used
        if not used:
            return Estimate(nan, nan, {}, ("no threshold: no reversals at the last size of step",))
        found = Estimate(float(np.mean(used)), nan, {"share_right": self.target})
        held = sum(level in self._ends for level, _ in self.answers)
        if held > _MOST_HELD * len(self.answers):
            why = f"{held} of {len(self.answers)} trials were at the end of what can be presented"
            found = without(found, f"no threshold: {why}")
        found = unless_by_chance(found, self.answers, self._guess)
        if isnan(found.threshold):
            return found
        if not self.is_done or len(self.reversals) < self._before_last_size + self.stop_after:
            found = replace(found, warnings=("it is not over: fewer reversals than asked for",))
        found = replace(found, warnings=(*found.warnings, *self._unsettled(found.threshold)))
        return replace(found, spread=self._spread())

    def _unsettled(self, threshold: float) -> Iterator[str]:
        """Say what hints at a walk that lapses or a shallow function have kept from settling."""
        scatter = float(np.std(self._used))
        if scatter > _MOST_SCATTER * self.steps[-1]:
            yield (
                f"the reversals scatter by {scatter:.1f}, more than {_MOST_SCATTER:g} steps of "
                f"{self.steps[-1]:g}: the walk has not settled, as with a shallow function or "
                "lapses, and may be off by several steps; take larger steps or more reversals"
            )
        if threshold > self.start - self.steps[0]:
            yield (
                f"the walk ended within a step of its begin at {self.start:g}: lapses there may "
                "have kept it from coming down; begin higher"
            )

    @property
    def _used(self) -> list[float]:
        used = self.reversals[self._before_last_size :]
        return used[len(used) % 2 :]

    def _spread(self) -> float:
        """Spread of the mean reversal over walks of an observer as wide as the answers say."""
        size, (levels, right, wrong) = self.steps[-1], counted(self.answers)
        threshold = np.linspace(levels.min() - 5 * size, levels.max() + 5 * size, 101)
        widths = size * np.geomspace(0.5, 20.0, 25)
        t, width = (one.ravel() for one in np.meshgrid(threshold, widths, indexing="ij"))
        fixed = np.array(self._guess), np.array(_LAPSE)
        log_right, log_wrong = log_shares(levels, "normal", t, width, *fixed)
        # Steps are chosen by the width that is expected, some three of them, within a factor of e.
        prior = -0.5 * np.log(width / (3 * size)) ** 2
        likelihood = right @ log_right + wrong @ log_wrong + prior
        weight = np.exp(likelihood - likelihood.max())
        wide = exp(float(weight @ np.log(width) / weight.sum()))
        share = (self.target - self._guess) / (1 - self._guess - _LAPSE)
        middle = float(np.mean(self._used)) - wide * NormalDist().inv_cdf(share)
        draw = Random(len(self.answers))
        return float(np.nanstd([self._walk(middle, wide, draw) for _ in range(_WALKS)], ddof=1))

    def _walk(self, threshold: float, width: float, draw: Random) -> float:
        """Mean reversal of the walk of one observer."""
        one = replace(self)
        while not one.is_done:
            p = 0.5 * erfc((threshold - one.level) / (width * sqrt(2)))
            one.update(draw.random() < self._guess + (1 - self._guess - _LAPSE) * p)
        return float(np.mean(one._used)) if one._used else nan

    def describe(self) -> dict[str, Any]:
        return super().describe() | {"target": self.target}


def weighted_up_down(target: float, start: float, **others: Any) -> UpDown:
    """One up, one down, with steps that converge at any share of right answers (Kaernbach)."""
    if not 0 < target < 1:
        raise InputError(f"target: expected a share between 0 and 1, got {target!r}")
    return UpDown(start, down_after=1, up_weight=target / (1 - target), **others)
