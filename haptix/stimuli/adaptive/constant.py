"""The method of constant stimuli, and the fit of a psychometric function."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from haptix.checks import row, whole
from haptix.errors import InputError
from haptix.stimuli.adaptive.method import Estimate, Method
from haptix.stimuli.adaptive.psychometric import function_named

Array = npt.NDArray[np.float64]


@dataclass(eq=False)
class ConstantStimuli(Method):
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
        draw = np.random.default_rng(self.seed)
        self._order = np.concatenate(
            [draw.permutation(self.levels) for _ in range(self.repeats)]
        ).tolist()
        self.answers: list[tuple[float, bool]] = []

    @property
    def level(self) -> float:
        return float(self._order[min(len(self.answers), len(self._order) - 1)])

    @property
    def is_done(self) -> bool:
        return len(self.answers) >= len(self._order)

    def update(self, is_right: bool, level: float | None = None) -> None:
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
    """Most likely threshold and slope; the spread is from the curvature of the likelihood.

    `answers` say for the level of each trial whether it was right; guess and lapse are held fixed.
    """
    from scipy.optimize import minimize

    x = np.asarray(levels, dtype=float)
    right = np.asarray(answers, dtype=bool)
    if len(x) != len(right) or len(set(x.tolist())) < 2:
        raise InputError("fit: expected answers at two levels or more")
    shape = function_named(function)

    def cost(at: Array) -> float:
        """Minus the log-likelihood of threshold and ln slope."""
        p = shape(x, at[0], np.exp(at[1]), guess, lapse).clip(1e-12, 1 - 1e-12)
        return float(-np.log(np.where(right, p, 1 - p)).sum())

    width = float(np.ptp(x))
    log_slope = np.log(3.5 if function == "weibull" else width / 4)
    options = {"xatol": 1e-6, "fatol": 1e-9, "maxiter": 2000}
    found = [
        minimize(cost, (start, log_slope), method="Nelder-Mead", options=options)
        for start in np.quantile(x, (0.25, 0.5, 0.75))
    ]
    best = min(found, key=lambda one: float(one.fun))
    step = np.array([1e-3 * width, 0.0])
    bend = (cost(best.x + step) - 2 * float(best.fun) + cost(best.x - step)) / step[0] ** 2
    spread = float(1 / np.sqrt(bend)) if bend > 0 else float("nan")
    return Estimate(float(best.x[0]), spread, {"slope": float(np.exp(best.x[1]))})
