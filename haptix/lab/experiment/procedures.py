"""Adaptive procedures: transformed and weighted up-down, and QUEST+ on a grid.

Watson, J. Vision 17(3):10 (2017); Kontsevich & Tyler, Vision Res. 39, 2729 (1999).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import inf, isfinite, prod
from typing import Any

import numpy as np

from haptix.base.checks import Array, increasing, number, positive, row, whole
from haptix.base.errors import InputError
from haptix.lab.experiment.comparisons import Magnitudes, Pairs, Sorting, Triads
from haptix.lab.experiment.methods import ConstantStimuli, Method, ThresholdMethod
from haptix.lab.experiment.psychometric import Estimate, function_named


def _untimed(found: Estimate, reaction_s: Sequence[float] | None, holds: str) -> Estimate:
    """Warn of fast guesses, which lead levels up and show in reaction times alone."""
    if reaction_s is not None or not isfinite(found.threshold):
        return found
    why = (
        "the reaction times are not known: if 30 % of the answers are fast guesses, which lead the "
        f"levels up, the interval holds the threshold in {holds} runs; log the times, or present "
        "constant stimuli"
    )
    return replace(found, warnings=(*found.warnings, why))


@dataclass(eq=False)
class UpDown(ThresholdMethod):
    """Down after several right answers in a row, up after a wrong one, in shrinking steps.

    Levitt, J. Acoust. Soc. Am. 49, 467 (1971); weights after Kaernbach, Percept. Psychophys. 49,
    227 (1991). With steps of one size it converges where ``p^n = w / (1 + w)``: at 79.4 % right for
    the usual three down, one up. Without reaction times its estimate warns that it cannot allow for
    fast guesses.

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
        self._in_a_row = self._direction = 0
        self.reversals: list[float] = []
        """Levels at which the direction changed."""

    @property
    def target(self) -> float:
        """Share of right answers at which it converges."""
        return float((self.up_weight / (1 + self.up_weight)) ** (1 / self.down_after))

    @property
    def guess_share(self) -> float:
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

    def estimate(
        self, empty: tuple[int, int] = (0, 0), reaction_s: Sequence[float] | None = None
    ) -> Estimate:
        return _untimed(super().estimate(empty, reaction_s), reaction_s, "6 of 10")

    def describe(self) -> dict[str, Any]:
        return super().describe() | {"target": self.target}


def weighted_up_down(target: float, start: float, **others: Any) -> UpDown:
    """One up, one down, with steps that converge at any share of right answers (Kaernbach).

    Parameters
    ----------
    target : float
        The share, between 0 and 1.
    start, others
        As for `UpDown`.
    """
    if not 0 < target < 1:
        raise InputError(f"target: expected a share between 0 and 1, got {target!r}")
    return UpDown(start, down_after=1, up_weight=target / (1 - target), **others)


_NAMES = ("threshold", "slope", "guess", "lapse")

_ENTROPY_DIGITS = 10
_MOST_PROBABILITIES = 10_000_000  # levels times parameters: 160 MB


@dataclass(eq=False)
class Quest(ThresholdMethod):
    """Presents the level with the least expected entropy of the posterior on its grids.

    The grids choose levels. With one slope or lapse rate, an estimate without reaction times warns
    that it cannot allow for fast guesses. The threshold is that of the posterior of every method,
    see `fit`.

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
    """

    levels: Sequence[float]
    threshold: Sequence[float] | float
    slope: Sequence[float] | float = 3.5
    guess: Sequence[float] | float = 0.5
    lapse: Sequence[float] | float = 0.02
    function: str = "weibull"
    trials: int = 40
    prior: Mapping[str, Sequence[float]] = field(default_factory=dict)

    kind = "quest+"

    def __post_init__(self) -> None:
        self._levels = increasing("levels", self.levels)
        self.grids = {name: increasing(name, _some(getattr(self, name))) for name in _NAMES}
        whole("trials", self.trials, 1)
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
        with np.errstate(all="ignore"):  # values that are not finite are refused
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

    @property
    def guess_share(self) -> float:
        return float(self.grids["guess"][0])

    def estimate(
        self, empty: tuple[int, int] = (0, 0), reaction_s: Sequence[float] | None = None
    ) -> Estimate:
        found = super().estimate(empty, reaction_s)
        # With a grid of slopes and lapses it presents levels that tell lapses.
        known = min(len(self.grids["slope"]), len(self.grids["lapse"])) > 1
        return found if known else _untimed(found, reaction_s, "3 of 4")

    def describe(self) -> dict[str, Any]:
        grids = {"levels": self._levels, **self.grids}
        prior = {name: [float(weight) for weight in row] for name, row in self.prior.items()}
        plain = {name: grid.tolist() for name, grid in grids.items()}
        return super().describe() | plain | {"prior": prior}


def _some(grid: Sequence[float] | float) -> Sequence[float]:
    return grid if isinstance(grid, Sequence | np.ndarray) else (grid,)


METHODS: dict[str, type[Method]] = {
    method.kind: method
    for method in (UpDown, Quest, ConstantStimuli, Magnitudes, Pairs, Triads, Sorting)
}
"""Every method by the name that recipes use."""
