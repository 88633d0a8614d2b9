"""Psychometric functions, their fit to answers, and what the answers can say at all."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import isfinite, isnan, nan
from typing import Any

import numpy as np

from haptix.checks import Array, choice
from haptix.errors import InputError


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

    def record(self) -> dict[str, Any]:
        """Return plain values for JSON; what is unknown is None."""
        numbers = {"threshold_db": self.threshold, "spread_db": self.spread, **self.others}
        known = {name: value if isfinite(value) else None for name, value in numbers.items()}
        return {**known, "warnings": list(self.warnings)}


Psychometric = Callable[..., Array]
"""Share right for (level, threshold, slope, guess, lapse), which broadcast."""


def weibull(level: Array, threshold: Array, slope: Array, guess: Array, lapse: Array) -> Array:
    """Weibull function of a level in dB: ``1 - d - (1 - g - d) exp(-10^(b (x - t) / 20))``.

    At the threshold ``1 - 1/e`` of the way from guess to ``1 - lapse`` is reached (Watson, J.
    Vision 17(3):10 (2017), Eq. 6).
    """
    # Beyond that all are right.
    steps = np.minimum(slope * (level - threshold) / 20, 300.0)
    return np.asarray(1 - lapse - (1 - guess - lapse) * np.exp(-(10**steps)))


def normal(level: Array, threshold: Array, slope: Array, guess: Array, lapse: Array) -> Array:
    """Cumulative normal of a linear level; `slope` is its standard deviation."""
    from scipy.special import ndtr

    return np.asarray(guess + (1 - guess - lapse) * ndtr((level - threshold) / slope))


def symmetric_normal(
    level: Array, threshold: Array, slope: Array, guess: Array, lapse: Array
) -> Array:
    """Cumulative normal between `lapse` and ``1 - lapse``, for two equal answers. No `guess`."""
    return normal(level, threshold, slope, lapse, lapse)


FUNCTIONS: dict[str, Psychometric] = {
    "weibull": weibull,
    "normal": normal,
    "symmetric-normal": symmetric_normal,
}
"""Psychometric functions by the names that recipes use."""


def function_named(name: str) -> Psychometric:
    """Look a function up by its name."""
    return FUNCTIONS[choice("function", name, FUNCTIONS)]


Answers = Sequence[tuple[float, bool]]
"""Level of each trial, and whether the answer was right."""

CHANCE_P = 0.01
"""An observer who guesses is right as often as this, or more rarely, in a run with a threshold."""

MISFIT_P = 0.05
"""Share of good runs in which the deviance is warned of; less, as the function was fitted."""

MOST_SHIFT = 0.75
"""Of a threshold, in its own spreads, by assumptions: 5 % of runs of 200 trials at 8 levels pass it
where the assumption holds, and 87 % where slope and lapse rate are 1.5 and 0.08. Of runs that it
was not chosen by, three intervals and 30 trials at each of 7 levels: 0 to 8 % of slopes 2 to 8 with
lapse rates of at most 0.02, and 83 % of those of 1.5 and 0.08 (200 runs of each). With 20 trials at
each of 6 levels off its centre, 3 % of slope 4 and 14 % of slope 2."""

_LAPSES = (0.0, 0.01, 0.02, 0.04, 0.06, 0.08, 0.1, 0.12)

_THRESHOLDS = 121
_RUNS = 199  # simulated ones
_LEAST_AT_LEVEL = 5


def chance_p(answers: Answers, guess: float) -> float:
    """Probability that one who only guesses is right as often, or more often."""
    from scipy.stats import binomtest

    right = sum(is_right for _, is_right in answers)
    if not answers or not 0 < guess < 1:
        return 0.0 if right else 1.0
    return float(binomtest(right, len(answers), guess, alternative="greater").pvalue)


def without(found: Estimate, why: str) -> Estimate:
    """Return an estimate that gives no threshold, and says why."""
    return Estimate(nan, nan, found.others, (why, *found.warnings))


def unless_by_chance(estimate: Estimate, answers: Answers, guess: float) -> Estimate:
    """Return an estimate, without a threshold where the answers are as those of a guesser."""
    p = chance_p(answers, guess)
    if p <= CHANCE_P:
        return estimate
    right = sum(is_right for _, is_right in answers)
    return without(
        estimate,
        f"no threshold: {right} of {len(answers)} answers were right, as guessing gives them "
        f"(p = {p:.2g})",
    )


def log_shares(
    levels: Array, function: str, threshold: Array, slope: Array, guess: Array, lapse: Array
) -> tuple[Array, Array]:
    """Logarithms of the shares right and wrong, shape (levels, parameters).

    Parameters of the function have the shape (parameters,), or broadcast to it.
    """
    right = function_named(function)(levels[:, None], threshold, slope, guess, lapse)
    right = right.clip(1e-9, 1 - 1e-9)
    return np.log(right), np.log1p(-right)


def counted(answers: Answers) -> tuple[Array, Array, Array]:
    """Levels, and how many answers at each were right and wrong."""
    levels, at = np.unique([level for level, _ in answers], return_inverse=True)
    right = np.bincount(at, [is_right for _, is_right in answers], len(levels))
    total = np.bincount(at, minlength=len(levels)).astype(float)
    return levels, right.astype(float), total - right


def misfit(
    answers: Answers,
    function: str,
    slopes: Sequence[float] | None,
    guess: Sequence[float],
    lapses: Sequence[float],
) -> tuple[str, ...]:
    """Warn where the threshold hangs on an assumed slope or lapse rate, or no function fits.

    The mean threshold over all slopes and lapse rates is compared with that over the assumed ones:
    a lapse rate that is held fixed biases a threshold (Wichmann & Hill, Percept. Psychophys. 63,
    1293 (2001)), and so does a slope. Where few levels were presented the answers cannot tell, and
    the warning says so. Where levels were presented several times, the deviance of the best
    function is compared with that of simulated answers (ibid., p. 1303).

    Parameters
    ----------
    answers : sequence of (float, bool)
        Levels, and whether the answers were right.
    function : str
        Form of the function.
    slopes, guess, lapses : sequence of float
        Values that were assumed; slopes are None if any was.
    """
    levels, right, wrong = counted(answers)
    if len(levels) < 2:
        return ()
    span = float(np.ptp(levels))
    any_slope = np.geomspace(1.0, 8.0, 9)
    if function != "weibull":
        any_slope = np.geomspace(0.03, 2.0, 9) * span
    assumed = np.asarray(any_slope if slopes is None else slopes)
    # What lies between the assumed values is assumed as well.
    slope = np.union1d(any_slope, np.linspace(assumed.min(), assumed.max(), 5))
    lapse = np.union1d(_LAPSES, np.linspace(min(lapses), max(lapses), 3))
    threshold = np.linspace(levels[0] - span, levels[-1] + span, _THRESHOLDS)
    axes = np.meshgrid(threshold, slope, np.asarray(guess), lapse, indexing="ij")
    t, b, g, d = (one.ravel() for one in axes)
    log_right, log_wrong = log_shares(levels, function, t, b, g, d)
    likelihood = right @ log_right + wrong @ log_wrong
    is_held = (b >= assumed.min()) & (b <= assumed.max()) & (d >= min(lapses)) & (d <= max(lapses))
    middle, spread = _moments(t[is_held], likelihood[is_held])
    free, free_spread = _moments(t, likelihood)
    warnings = []
    if abs(free - middle) > MOST_SHIFT * spread:
        warnings.append(
            "the threshold hangs on the slope or the lapse rate that were assumed: over all of "
            f"them it is {free:.1f} +- {free_spread:.1f}, over the assumed ones {middle:.1f} +- "
            f"{spread:.1f}; allow for several, and present levels that are surely felt"
        )
    best = int(likelihood.argmax())
    if len(answers) >= _LEAST_AT_LEVEL * len(levels):
        total = right + wrong
        share = np.exp(log_right[:, best])
        draw = np.random.default_rng(len(answers))
        drawn = draw.binomial(total.astype(int), share, (_RUNS, len(levels)))
        simulated = drawn.astype(float)
        worse = _deviance(simulated, total, share) >= _deviance(right, total, share)
        p = float((1 + worse.sum()) / (1 + _RUNS))
        if p < MISFIT_P:
            warnings.append(
                f"no function of this form fits (p = {p:.2g}): the shares right scatter more than "
                "chance allows, as of an observer who changes or levels out of order"
            )
    return tuple(warnings)


def _deviance(right: Array, total: Array, share: Array) -> Array:
    """Deviance of counts from shares, shape (rows,)."""
    from scipy.special import xlogy

    wrong = total - right
    parts = xlogy(right, right / (total * share)) + xlogy(wrong, wrong / (total * (1 - share)))
    return np.asarray(2 * parts.sum(-1))


def _moments(at: Array, likelihood: Array) -> tuple[float, float]:
    """Mean and spread of values by their log-likelihoods."""
    weight = np.exp(likelihood - likelihood.max())
    mean = float(weight @ at / weight.sum())
    return mean, float(np.sqrt(weight @ (at - mean) ** 2 / weight.sum()))


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
    estimate = Estimate(float(best.x[0]), spread, {"slope": float(np.exp(best.x[1]))})
    if not x.min() <= estimate.threshold <= x.max():
        why = f"none lies within the levels, {x.min():g} to {x.max():g}"
        estimate = without(estimate, f"no threshold: {why}")
    if isnan(estimate.threshold) or not is_guessed:
        return estimate
    return replace(estimate, warnings=misfit(pairs, function, None, (guess,), (lapse,)))


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
