"""Adaptive procedures: transformed and weighted up-down, and QUEST+ on a grid.

Watson, J. Vision 17(3):10 (2017); Kontsevich & Tyler, Vision Res. 39, 2729 (1999).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import erfc, exp, inf, isnan, nan, prod, sqrt
from random import Random
from statistics import NormalDist
from typing import Any, Literal

import numpy as np

from haptix.checks import Array, choice, increasing, number, positive, row, whole
from haptix.errors import InputError
from haptix.stimuli.adaptive.methods import ConstantStimuli, Magnitudes, Method, Pairs
from haptix.stimuli.adaptive.psychometric import (
    Estimate,
    counted,
    function_named,
    log_shares,
    misfit,
    unless_by_chance,
    without,
)

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
        estimate = Estimate(float(np.mean(used)), nan, {"share_right": self.target})
        at_end = sum(level in self._ends for level, _ in self.answers)
        if at_end > _MOST_HELD * len(self.answers):
            why = f"{at_end} of {len(self.answers)} trials were at the end of what can be presented"
            estimate = without(estimate, f"no threshold: {why}")
        estimate = unless_by_chance(estimate, self.answers, self._guess)
        if isnan(estimate.threshold):
            return estimate
        warnings = estimate.warnings
        if not self.is_done or len(self.reversals) < self._before_last_size + self.stop_after:
            warnings = ("it is not over: fewer reversals than asked for",)
        warnings = (*warnings, *self._unsettled(estimate.threshold))
        return replace(estimate, spread=self._spread(), warnings=warnings)

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
        walk = replace(self)
        while not walk.is_done:
            p = 0.5 * erfc((threshold - walk.level) / (width * sqrt(2)))
            walk.update(draw.random() < self._guess + (1 - self._guess - _LAPSE) * p)
        return float(np.mean(walk._used)) if walk._used else nan

    def describe(self) -> dict[str, Any]:
        return super().describe() | {"target": self.target}


def weighted_up_down(target: float, start: float, **others: Any) -> UpDown:
    """One up, one down, with steps that converge at any share of right answers (Kaernbach)."""
    if not 0 < target < 1:
        raise InputError(f"target: expected a share between 0 and 1, got {target!r}")
    return UpDown(start, down_after=1, up_weight=target / (1 - target), **others)


_NAMES = ("threshold", "slope", "guess", "lapse")

_MOST_AT_END = 0.1  # of the posterior, on the first or last threshold of the grid
_LEAST_ANSWERS = 10  # seven right ones in a row are no chance
_ENTROPY_DIGITS = 10
_MOST_PROBABILITIES = 10_000_000  # levels times parameters: 160 MB


@dataclass(eq=False)
class Quest(Method):
    """Presents the level with the least expected entropy of the posterior.

    Parameters
    ----------
    levels : sequence of float
        Levels that can be presented, increasing.
    threshold, slope, guess, lapse : sequence of float or float
        Grid of each parameter; a single number is held fixed.
    function : str
        "weibull" (levels in dB), "normal" or "symmetric-normal".
    trials : int
        Number of trials.
    prior : mapping of str to sequence of float, optional
        Prior probabilities on the grids of some parameters; uniform by default.
    estimate_by : {"mean", "mode"}
        Which statistic of the posterior is reported.
    """

    levels: Sequence[float]
    threshold: Sequence[float] | float
    slope: Sequence[float] | float = 3.5
    guess: Sequence[float] | float = 0.5
    lapse: Sequence[float] | float = 0.02
    function: str = "weibull"
    trials: int = 40
    prior: Mapping[str, Sequence[float]] = field(default_factory=dict)
    estimate_by: Literal["mean", "mode"] = "mean"

    kind = "quest+"

    def __post_init__(self) -> None:
        self._levels = increasing("levels", self.levels)
        self.grids = {name: increasing(name, _some(getattr(self, name))) for name in _NAMES}
        whole("trials", self.trials, 1)
        choice("estimate_by", self.estimate_by, ("mean", "mode"))
        size = len(self._levels) * prod(map(len, self.grids.values()))
        if size > _MOST_PROBABILITIES:
            raise InputError(
                f"levels and parameters: expected at most {_MOST_PROBABILITIES} combinations, got "
                f"{size}; give coarser grids"
            )
        axes = np.meshgrid(*self.grids.values(), indexing="ij")
        self._shape = axes[0].shape
        flat = [axis.reshape(-1) for axis in axes]
        guesses, lapses = self.grids["guess"], self.grids["lapse"]
        if min(guesses[0], lapses[0]) < 0 or guesses[-1] + lapses[-1] >= 1:
            raise InputError("guess and lapse: expected shares of 0 or more, together below 1")
        with np.errstate(all="ignore"):  # what is not finite is refused
            right = function_named(self.function)(self._levels[:, None], *flat)
        if not np.isfinite(right).all():
            raise InputError("threshold and slope: expected values that give finite probabilities")
        # Shape (answers, levels, parameters): wrong, right.
        self._likelihood = np.stack([1 - right, right])
        self.posterior = self._prior_weights().reshape(-1)
        self.answers: list[tuple[float, bool]] = []
        """Level of each trial, and whether the answer was right."""
        self._next: int | None = None

    def _prior_weights(self) -> Array:
        weight = np.ones(self._shape)
        for name, given in self.prior.items():
            if name not in self.grids:
                raise InputError(f"prior.{name}: expected any of {', '.join(_NAMES)}")
            p = row(f"prior.{name}", given)
            if p.shape != self.grids[name].shape or not (p >= 0).all() or not p.sum() > 0:
                raise InputError(
                    f"prior.{name}: expected {len(self.grids[name])} weights of 0 or more"
                )
            at = _NAMES.index(name)
            weight = weight * p.reshape([-1 if i == at else 1 for i in range(len(_NAMES))])
        return np.asarray(weight / weight.sum())

    def expected_entropy(self) -> Array:
        """Expected entropy of the posterior after each level, shape (levels,)."""
        joint = self._likelihood * self.posterior
        answer = joint.sum(-1)
        share = joint / np.where(answer > 0, answer, 1.0)[..., None]
        logs = np.log(share, out=np.zeros_like(share), where=share > 0)
        return np.asarray(-(answer * (share * logs).sum(-1)).sum(0))

    @property
    def level(self) -> float:
        if self._next is None:
            # Rounded: of two that are alike every machine takes the same.
            self._next = int(np.argmin(self.expected_entropy().round(_ENTROPY_DIGITS)))
        return float(self._levels[self._next])

    @property
    def is_done(self) -> bool:
        return self.asked >= self.trials

    @property
    def asked(self) -> int:
        """Answers that it has taken."""
        return len(self.answers)

    def update(self, is_right: float, level: float | None = None) -> None:
        """Take an answer; a level between two of the grid counts as the nearest."""
        at = self.level if level is None else float(level)
        index = int(np.argmin(np.abs(self._levels - at)))
        posterior = self._likelihood[int(bool(is_right)), index] * self.posterior
        total = posterior.sum()
        if not total > 0:
            raise InputError(
                "an answer came that none of the parameters on the grid allows; "
                "allow for a guess and a lapse"
            )
        self.posterior = posterior / total
        self.answers.append((at, bool(is_right)))
        self._next = None

    def estimate(self) -> Estimate:
        """Mean or mode of the posterior.

        There is no threshold where the answers are those of a guesser, or the posterior lies at the
        end of the grid; before the tenth answer nothing is said of that. A misfit of the function
        is warned of.
        """
        estimate = self._of_posterior()
        if self.asked < min(_LEAST_ANSWERS, self.trials):
            return estimate
        low, high = (float(self._marginal("threshold")[at]) for at in (0, -1))
        grid = self.grids["threshold"]
        if len(grid) > 2 and max(low, high) > _MOST_AT_END:
            end, beyond = (grid[0], "below") if low > high else (grid[-1], "above")
            estimate = without(estimate, f"no threshold: it lies at {end:g} or {beyond}, where the "
                                   "grid ends")  # fmt: skip
        estimate = unless_by_chance(estimate, self.answers, self._guess())
        if isnan(estimate.threshold) or self.function == "symmetric-normal":
            return estimate
        assumed = [self.grids[name].tolist() for name in _NAMES[1:]]
        return replace(estimate, warnings=misfit(self.answers, self.function, *assumed))

    def _guess(self) -> float:
        """Share right of one who guesses; two equal answers have none of their own."""
        return 0.0 if self.function == "symmetric-normal" else float(self.grids["guess"][0])

    def _marginal(self, name: str) -> Array:
        table, at = self.posterior.reshape(self._shape), _NAMES.index(name)
        return np.asarray(table.sum(tuple(i for i in range(table.ndim) if i != at)))

    def _of_posterior(self) -> Estimate:
        table = self.posterior.reshape(self._shape)
        values: dict[str, float] = {}
        spread = 0.0
        best = np.unravel_index(int(table.argmax()), self._shape)
        for axis, (name, grid) in enumerate(self.grids.items()):
            marginal = self._marginal(name)
            mean = float(marginal @ grid)
            if name == "threshold":
                spread = sqrt(max(0.0, float(marginal @ (grid - mean) ** 2)))
            values[name] = mean if self.estimate_by == "mean" else float(grid[best[axis]])
        return Estimate(values.pop("threshold"), spread, values)

    def describe(self) -> dict[str, Any]:
        grids = {"levels": self._levels, **self.grids}
        prior = {name: [float(weight) for weight in row] for name, row in self.prior.items()}
        plain = {name: grid.tolist() for name, grid in grids.items()}
        return super().describe() | plain | {"prior": prior}


def _some(grid: Sequence[float] | float) -> Sequence[float]:
    return grid if isinstance(grid, Sequence | np.ndarray) else (grid,)


METHODS: dict[str, type[Method]] = {
    one.kind: one for one in (UpDown, Quest, ConstantStimuli, Magnitudes, Pairs)
}
"""Every method by the name that recipes use."""
