"""The method of constant stimuli, and the fit of a psychometric function."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import isnan, nan

import numpy as np
import numpy.typing as npt

from haptix.checks import row, whole
from haptix.errors import InputError
from haptix.stimuli.adaptive.evidence import counted, misfit, unless_by_chance, without
from haptix.stimuli.adaptive.method import Estimate, FixedOrder, shuffled
from haptix.stimuli.adaptive.psychometric import function_named

Array = npt.NDArray[np.float64]


@dataclass(eq=False)
class ConstantStimuli(FixedOrder):
    """Every level equally often, in a random order.

    Parameters
    ----------
    levels : sequence of float
        Levels.
    repeats : int
        Presentations of each level.
    seed : int
        Seed of the order; every repetition has all levels once.
    function, guess, lapse
        Form and fixed parameters of the fitted function, see `fit`.
    """

    levels: Sequence[float]
    repeats: int = 20
    seed: int = 0
    function: str = "weibull"
    guess: float = 0.5
    lapse: float = 0.02

    kind = "constant-stimuli"

    def __post_init__(self) -> None:
        self.levels = row("levels", self.levels, 2).tolist()
        whole("repeats", self.repeats, 1)
        function_named(self.function)
        self._order = shuffled(self.levels, self.repeats, self.seed)
        self.answers: list[tuple[float, bool]] = []

    def update(self, is_right: float, level: float | None = None) -> None:
        self.answers.append((self.level if level is None else float(level), bool(is_right)))

    def estimate(self) -> Estimate:
        levels, answers = zip(*self.answers, strict=True) if self.answers else ((), ())
        return fit(levels, answers, self.function, self.guess, self.lapse)


def fit(
    levels: Sequence[float],
    answers: Sequence[bool],
    function: str = "weibull",
    guess: float = 0.5,
    lapse: float = 0.02,
) -> Estimate:
    """Most likely threshold and slope; the spread is from the curvature of the likelihood in both.

    `answers` say for the level of each trial whether it was right; guess and lapse are held fixed.
    There is no threshold where the answers are those of a guesser, or beyond the levels. A lapse
    rate that fits far better is warned of.
    """
    from scipy.optimize import minimize

    x = np.asarray(levels, dtype=float)
    right = np.asarray(answers, dtype=bool)
    if len(x) != len(right) or len(set(x.tolist())) < 2:
        raise InputError("fit: expected answers at two levels or more")
    shape = function_named(function)
    pairs = [*zip(x.tolist(), right.tolist(), strict=True)]
    is_guessed = function != "symmetric-normal"
    if is_guessed:
        nothing = unless_by_chance(Estimate(nan, nan, {}), pairs, guess)
        if nothing.warnings:
            return nothing
    at_level, hits, misses = counted(pairs)

    def cost(at: Array) -> float:
        """Minus the log-likelihood of threshold and ln slope."""
        p = shape(at_level, at[0], np.exp(at[1]), guess, lapse).clip(1e-12, 1 - 1e-12)
        return -float(hits @ np.log(p) + misses @ np.log1p(-p))

    width = float(np.ptp(x))
    log_slope = np.log(3.5 if function == "weibull" else width / 4)
    options = {"xatol": 1e-6, "fatol": 1e-9, "maxiter": 2000}
    tries = [
        minimize(cost, (start, log_slope), method="Nelder-Mead", options=options)
        for start in np.quantile(x, (0.25, 0.5, 0.75))
    ]
    best = min(tries, key=lambda one: float(one.fun))
    bend = _curvature(cost, best.x, np.array([1e-3 * width, 1e-2]))
    well = bool(np.all(np.linalg.eigvalsh(bend) > 0))
    spread = float(np.sqrt(np.linalg.inv(bend)[0, 0])) if well else nan
    found = Estimate(float(best.x[0]), spread, {"slope": float(np.exp(best.x[1]))})
    if not x.min() <= found.threshold <= x.max():
        why = f"none lies within the levels, {x.min():g} to {x.max():g}"
        found = without(found, f"no threshold: {why}")
    if isnan(found.threshold) or not is_guessed:
        return found
    return replace(found, warnings=misfit(pairs, function, None, (guess,), (lapse,)))


def _curvature(cost: Callable[[Array], float], at: Array, step: Array) -> Array:
    """Second derivatives by central differences, shape (2, 2)."""
    e = np.diag(step)
    return np.array(
        [
            [
                cost(at + e[i] + e[j]) - cost(at + e[i] - e[j])
                - cost(at - e[i] + e[j]) + cost(at - e[i] - e[j])
                for j in range(2)
            ]
            for i in range(2)
        ]
    ) / (4 * np.outer(step, step))  # fmt: skip
