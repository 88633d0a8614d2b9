"""The method of constant stimuli, and the fit of a psychometric function."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from haptix.checks import row, whole
from haptix.errors import InputError
from haptix.stimuli.adaptive.method import Estimate
from haptix.stimuli.adaptive.psychometric import function_named

Array = npt.NDArray[np.float64]


class ConstantStimuli:
    """Every level equally often, in a random order.

    Parameters
    ----------
    levels : sequence of float
        Levels.
    repeats : int
        How often each.
    seed : int
        Of the order; every repetition has all levels once.
    function, guess, lapse
        Of the fitted function, see `fit`.
    """

    def __init__(
        self,
        levels: Sequence[float],
        repeats: int = 20,
        seed: int = 0,
        function: str = "weibull",
        guess: float = 0.5,
        lapse: float = 0.02,
    ) -> None:
        self.levels = row("levels", levels, 2).tolist()
        whole("repeats", repeats, 1)
        function_named(function)
        self.repeats, self.seed = repeats, seed
        self.function, self.guess, self.lapse = function, float(guess), float(lapse)
        draw = np.random.default_rng(seed)
        self._order = [
            self.levels[i] for _ in range(repeats) for i in draw.permutation(len(self.levels))
        ]
        self.answers: list[tuple[float, bool]] = []

    @property
    def level(self) -> float:
        """The level to be presented next; the last one when done."""
        return float(self._order[min(len(self.answers), len(self._order) - 1)])

    @property
    def is_done(self) -> bool:
        """Whether every level was presented `repeats` times."""
        return len(self.answers) >= len(self._order)

    def update(self, is_right: bool, level: float | None = None) -> None:
        """Take an answer."""
        self.answers.append((self.level if level is None else float(level), bool(is_right)))

    def estimate(self) -> Estimate:
        """Fit the function to the answers."""
        levels, answers = zip(*self.answers, strict=True) if self.answers else ((), ())
        return fit(levels, answers, self.function, self.guess, self.lapse)

    def describe(self) -> dict[str, Any]:
        """Everything that determines what it does."""
        return {
            "method": "constant-stimuli",
            "levels": self.levels,
            "repeats": self.repeats,
            "seed": self.seed,
            "function": self.function,
            "guess": self.guess,
            "lapse": self.lapse,
        }


def fit(
    levels: Sequence[float],
    answers: Sequence[bool],
    function: str = "weibull",
    guess: float = 0.5,
    lapse: float = 0.02,
) -> Estimate:
    """Most likely threshold and slope.

    Parameters
    ----------
    levels, answers : sequences of equal length
        Level of each trial, and whether the answer was right.
    function : str
        A name of `FUNCTIONS`.
    guess, lapse : float
        Held fixed.

    Returns
    -------
    Estimate
        Its spread is from the curvature of the likelihood.
    """
    from scipy.optimize import minimize

    x = np.asarray(levels, dtype=float)
    right = np.asarray(answers, dtype=bool)
    if len(x) != len(right) or len(set(x.tolist())) < 2:
        raise InputError("fit: expected answers at two levels or more")
    shape = function_named(function)

    def cost(threshold: float, log_slope: float) -> float:
        p = shape(x, threshold, np.exp(log_slope), guess, lapse)
        p = np.clip(p, 1e-12, 1 - 1e-12)
        return float(-np.log(np.where(right, p, 1 - p)).sum())

    width = float(np.ptp(x))
    log_slope = np.log(3.5) if function == "weibull" else np.log(width / 4)
    best = min(
        (
            minimize(lambda v: cost(v[0], v[1]), (start, log_slope), method="Nelder-Mead",
                     options={"xatol": 1e-6, "fatol": 1e-9, "maxiter": 2000})
            for start in np.quantile(x, (0.25, 0.5, 0.75))
        ),
        key=lambda found: float(found.fun),
    )  # fmt: skip
    threshold, log_slope = float(best.x[0]), float(best.x[1])
    step = 1e-3 * width
    bend = (
        cost(threshold + step, log_slope) - 2 * float(best.fun) + cost(threshold - step, log_slope)
    ) / step**2
    spread = float(1 / np.sqrt(bend)) if bend > 0 else float("nan")
    return Estimate(threshold, spread, {"slope": float(np.exp(log_slope))})
