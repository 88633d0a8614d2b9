"""QUEST+ on a grid, of which the psi method is the case of threshold and slope.

Watson, J. Vision 17(3):10 (2017); Kontsevich & Tyler, Vision Res. 39, 2729 (1999).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import isnan, prod, sqrt
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from haptix.checks import choice, increasing, row, whole
from haptix.errors import InputError
from haptix.stimuli.adaptive.evidence import misfit, unless_by_chance, without
from haptix.stimuli.adaptive.method import Estimate, Method
from haptix.stimuli.adaptive.psychometric import function_named

Array = npt.NDArray[np.float64]

_NAMES = ("threshold", "slope", "guess", "lapse")
_MOST_AT_END = 0.1  # of the posterior, on the first or last threshold of the grid
_LEAST_ANSWERS = 10  # seven right ones in a row are no chance
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
            self._next = int(np.argmin(self.expected_entropy()))
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
        found = self._of_posterior()
        if self.asked < min(_LEAST_ANSWERS, self.trials):
            return found
        low, high = (float(self._marginal("threshold")[at]) for at in (0, -1))
        grid = self.grids["threshold"]
        if len(grid) > 2 and max(low, high) > _MOST_AT_END:
            end, beyond = (grid[0], "below") if low > high else (grid[-1], "above")
            found = without(found, f"no threshold: it lies at {end:g} or {beyond}, where the "
                                   "grid ends")  # fmt: skip
        found = unless_by_chance(found, self.answers, self._guess())
        if isnan(found.threshold) or self.function == "symmetric-normal":
            return found
        held = [self.grids[name].tolist() for name in _NAMES[1:]]
        return replace(found, warnings=misfit(self.answers, self.function, *held))

    def _guess(self) -> float:
        """Share right of one who guesses; two equal answers have none of their own."""
        return 0.0 if self.function == "symmetric-normal" else float(self.grids["guess"][0])

    def _marginal(self, name: str) -> Array:
        table, at = self.posterior.reshape(self._shape), _NAMES.index(name)
        return np.asarray(table.sum(tuple(i for i in range(table.ndim) if i != at)))

    def _of_posterior(self) -> Estimate:
        table = self.posterior.reshape(self._shape)
        found: dict[str, float] = {}
        spread = 0.0
        best = np.unravel_index(int(table.argmax()), self._shape)
        for axis, (name, grid) in enumerate(self.grids.items()):
            marginal = self._marginal(name)
            mean = float(marginal @ grid)
            if name == "threshold":
                spread = sqrt(max(0.0, float(marginal @ (grid - mean) ** 2)))
            found[name] = mean if self.estimate_by == "mean" else float(grid[best[axis]])
        return Estimate(found.pop("threshold"), spread, found)

    def describe(self) -> dict[str, Any]:
        grids = {"levels": self._levels, **self.grids}
        prior = {name: [float(weight) for weight in row] for name, row in self.prior.items()}
        plain = {name: grid.tolist() for name, grid in grids.items()}
        return super().describe() | plain | {"prior": prior}


def _some(grid: Sequence[float] | float) -> Sequence[float]:
    return grid if isinstance(grid, Sequence | np.ndarray) else (grid,)
