"""Psychometric functions, their fit to answers, a test for guessing, and the means of a group."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from math import isfinite, nan
from typing import Any

import numpy as np

from haptix.base.checks import Array, choice


@dataclass(frozen=True)
class Estimate:
    """Estimate from answers: a threshold with its interval, and other parameters."""

    threshold: float = nan
    """Detection threshold, in the units of the levels; NaN if the answers give none."""
    low: float = nan
    """The threshold lies from here to `high` with 95 %."""
    high: float = nan
    others: dict[str, float] = field(default_factory=dict)
    """Slope and other estimated parameters."""
    warnings: tuple[str, ...] = ()
    """Why there is no threshold, or what the observer did that the interval allows for."""

    @property
    def width(self) -> float:
        """Width of the interval; NaN without a threshold."""
        return self.high - self.low

    def record(self) -> dict[str, Any]:
        """Return plain values for JSON; what is unknown is None."""
        numbers = {"threshold_db": self.threshold, "low_db": self.low, "high_db": self.high}
        numbers |= self.others
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

_LEAST_ANSWERS = 10  # seven right ones in a row are no chance
_SURELY = 0.95  # probability of what is warned of
_INTERVAL = (0.025, 0.5, 0.975)
_EPOCHS = 4  # of a run, for drift and overdispersion
_REACH = 4.0  # beyond the levels, in typical widths, that a threshold is looked for
_FINE = 800  # shares at which the likelihood of a cell is tabulated: much finer than its bends
_MOST_LAPSE, _LAPSES_AS = 0.25, 22.0
_SLOPES_WITHIN = 0.85
_DRIFTS = np.array([-4.0, -2.0, -1.0, 0.0, 1.0, 2.0, 4.0])
_NO_DRIFT = 0.7
_OVERDISPERSION = np.array([0.003, 0.1, 0.2, 0.32, 0.46])
_MANY_LAPSES = 0.06
_TYPICAL_SLOPE = 3.5


def chance_p(answers: Answers, guess: float) -> float:
    """Probability that an observer who guesses is right at least as often."""
    from scipy.stats import binomtest

    right = sum(is_right for _, is_right in answers)
    if not answers or not 0 < guess < 1:
        return 0.0 if right else 1.0
    return float(binomtest(right, len(answers), guess, alternative="greater").pvalue)


def without(estimate: Estimate, why: str) -> Estimate:
    """Return an estimate without a threshold, with the reason."""
    return Estimate(others=estimate.others, warnings=(f"no threshold: {why}", *estimate.warnings))


def counted(answers: Answers) -> tuple[Array, Array, Array]:
    """Levels, and counts of right and wrong answers at each."""
    levels, at = np.unique([level for level, _ in answers], return_inverse=True)
    right = np.bincount(at, [is_right for _, is_right in answers], len(levels))
    total = np.bincount(at, minlength=len(levels)).astype(float)
    return levels, right.astype(float), total - right


def fit(
    answers: Answers, function: str = "weibull", guess: float = 0.5, empty: tuple[int, int] = (0, 0)
) -> Estimate:
    """Return the threshold with its 95 % interval; any method may have chosen the levels.

    The posterior over threshold, slope, lapse rate, overdispersion and drift, on a grid. Answers
    at one level in one quarter of the run are beta-binomial about the function: an observer who
    changes widens the interval (Schuett, Harmeling, Macke & Wichmann, Vision Res. 122, 105
    (2016)). The threshold may drift evenly over the run; it is that of the middle. The median is
    stated. There is none where the answers are those of a guesser, or where it lies beyond the
    levels.

    Priors: even for the threshold; log-normal for the slope about 3.5, of a normal function about
    an eighth of the range of the levels, within a factor of 2.3; Beta(1, 22) for the lapse rate;
    Beta(1, 10) for the overdispersion, the square root of the correlation of two answers; three
    tenths for a drift, of at most 10 dB or four widths of the function.

    Parameters
    ----------
    answers : sequence of (float, bool)
        Levels, in the order of the trials, and whether the answers were right.
    function : str
        Form of the function.
    guess : float
        Share right of one who guesses.
    empty : (int, int)
        Trials without a target in which one was found, and all of them: where there are some, they
        tell `guess`.
    """
    function_named(function)
    if len(answers) < _LEAST_ANSWERS:
        return without(Estimate(), f"{len(answers)} answers; it takes {_LEAST_ANSWERS} or more")
    posterior = _posterior(answers, function, guess, empty)
    levels = [level for level, _ in answers]
    if not min(levels) <= posterior.threshold <= max(levels):
        end = "above" if posterior.threshold > max(levels) else "below"
        why = f"it lies {end} the levels that were presented, {min(levels):g} to {max(levels):g}"
        return without(posterior, why)
    if function == "symmetric-normal" or empty[1]:
        return posterior
    p = chance_p(answers, guess)
    if p <= CHANCE_P:
        return posterior
    right = sum(is_right for _, is_right in answers)
    why = f"{right} of {len(answers)} answers were right, as guessing gives them (p = {p:.2g})"
    return without(posterior, why)


def _posterior(answers: Answers, function: str, guess: float, empty: tuple[int, int]) -> Estimate:
    """Median, interval and means of the other parameters."""
    from scipy.special import betaln
    from scipy.stats import beta

    shape, in_db = function_named(function), function == "weibull"
    levels, is_right = np.array(answers, dtype=float).T
    quarter = np.arange(len(levels)) * _EPOCHS // len(levels)
    cells, at = np.unique([levels, quarter], axis=1, return_inverse=True)
    level, when = cells[0], (cells[1] + 0.5) / _EPOCHS - 0.5
    total = np.bincount(at.ravel()).astype(float)
    right = np.bincount(at.ravel(), is_right)
    # A typical width of the function: the scale of ln(-ln(wrong)), or a standard deviation.
    typical = 20 / np.log(10) / _TYPICAL_SLOPE if in_db else float(np.ptp(levels)) / 8 or 1.0
    guesses = np.array([guess])
    if empty[1]:
        right_answers, trials = empty
        guesses = beta.ppf(
            np.arange(0.1, 1.0, 0.2), right_answers + 0.5, trials - right_answers + 0.5
        )
    reach = _REACH * typical
    axes = (
        np.linspace(levels.min() - reach, levels.max() + reach, 101),
        np.linspace(-2.2, 2.2, 13) * _SLOPES_WITHIN,
        np.linspace(0.002, _MOST_LAPSE, 13),
    )

    def shares(threshold: Array, log_slope: Array, lapse: Array, drift: Array) -> Array:
        """Share right, shape (threshold, slope, lapse, guess, drift, cell)."""
        width = np.exp(log_slope)[:, None, None, None, None]
        slope = _TYPICAL_SLOPE / width if in_db else typical * width
        middle = threshold[:, None, None, None, None, None] + drift[:, None] * when
        off = np.minimum(lapse, (1 - guesses.max()) / 2)[:, None, None, None]
        return shape(level, middle, slope, guesses[:, None, None], off)

    def prior(log_slope: Array, lapse: Array) -> Array:
        of_slope = np.exp(-0.5 * (log_slope / _SLOPES_WITHIN) ** 2)
        return np.asarray(of_slope[:, None] * (1 - lapse) ** (_LAPSES_AS - 1))

    # First without drift and overdispersion, to see where the mass is.
    p = shares(*axes, np.zeros(1)).clip(1e-9, 1 - 1e-9)
    weight = _weights(np.log(p) @ right + np.log1p(-p) @ (total - right))
    weight = weight.sum((3, 4)) * prior(*axes[1:])
    axes = (
        _around(weight.sum((1, 2)), axes[0], 61),
        _around(weight.sum((0, 2)), axes[1], 9),
        _around(weight.sum((0, 1)), axes[2], 6),
    )
    drifts = _DRIFTS * typical
    p = shares(*axes, drifts)
    steps = np.rint(p * _FINE).astype(np.int16)
    share = np.clip(np.arange(_FINE + 1) / _FINE, 0.25 / _FINE, 1 - 0.25 / _FINE)[:, None]
    likelihood = np.zeros((len(_OVERDISPERSION), *p.shape[:-1]))
    for k, scatter in enumerate(_OVERDISPERSION):
        spread = 1 / scatter**2 - 1
        a, b = share * spread, (1 - share) * spread
        table = betaln(right + a, total - right + b) - betaln(a, b)
        for cell in range(len(level)):
            likelihood[k] += table[:, cell][steps[..., cell]]
    of_drift = (_DRIFTS != 0) / (1 + _DRIFTS**2)
    of_drift = (1 - _NO_DRIFT) * of_drift / of_drift.sum() + _NO_DRIFT * (_DRIFTS == 0)
    edges = np.array([0.0, *(_OVERDISPERSION[1:] + _OVERDISPERSION[:-1]) / 2, 0.53])
    of_scatter = -np.diff((1 - edges) ** 10)
    weight = _weights(likelihood) * of_drift * prior(*axes[1:])[..., None, None]
    weight *= of_scatter.reshape(-1, 1, 1, 1, 1, 1)
    weight /= weight.sum()

    def marginal(axis: int) -> Array:
        return np.asarray(weight.sum(tuple({*range(6)} - {axis})))

    mass = marginal(1)
    low, middle, high = np.interp(_INTERVAL, np.cumsum(mass) - mass / 2, axes[0])
    width, drifting = float(np.exp(marginal(2) @ axes[1])), marginal(5)
    others = {
        "slope": _TYPICAL_SLOPE / width if in_db else typical * width,
        "lapse": float(marginal(3) @ axes[2]),
        "overdispersion": float(marginal(0) @ _OVERDISPERSION),
        "drift": float(drifting @ drifts),
        "drift_probability": float(drifting[_DRIFTS != 0].sum()),
    }
    if empty[1]:
        others["guess"] = float(marginal(4) @ guesses)
    lapsing = float(marginal(3)[axes[2] > _MANY_LAPSES].sum())
    return Estimate(
        float(middle), float(low), float(high), others, (*_said(others, lapsing, marginal(0)),)
    )


def _said(others: Mapping[str, float], lapsing: float, scatter: Array) -> Iterator[str]:
    """Name what the answers show of the observer, which the interval allows for."""
    if others["drift_probability"] > _SURELY:
        yield (
            f"the threshold drifts by {others['drift']:+.1f} from the first trial to the last; it "
            "is stated for the middle"
        )
    if lapsing > _SURELY:
        yield f"{others['lapse']:.0%} of the answers are lapses, wrong at any level; let them rest"
    if scatter[_OVERDISPERSION >= 0.2].sum() > _SURELY:
        yield (
            "the shares right scatter more than chance and this function allow, as of an observer "
            "who changes or levels out of order"
        )


def _weights(likelihood: Array) -> Array:
    """Return weights from their logarithms; the largest is 1."""
    return np.asarray(np.exp(likelihood - likelihood.max()))


def _around(weight: Array, at: Array, count: int) -> Array:
    """Return values around a weight's centre, within the range that was tried."""
    share = weight / weight.sum()
    mean = float(share @ at)
    spread = float(np.sqrt(share @ (at - mean) ** 2)) + (at[1] - at[0]) / 3
    ends = max(at[0], mean - 5 * spread), min(at[-1], mean + 5 * spread)
    return np.linspace(*ends, count)


_SIZES = np.concatenate([[0.0], np.geomspace(0.03, 8.0, 18)])


@dataclass(frozen=True)
class Group:
    """Posterior of the means of conditions: a mixture of normal distributions.

    Parameters
    ----------
    weight : ndarray, shape (sizes,)
        Of each pair of standard deviations between participants that was tried.
    mean : ndarray, shape (sizes, conditions)
        Means of the conditions.
    covariance : ndarray, shape (sizes, conditions, conditions)
        Of the means.
    between : float
        Standard deviation between participants in a condition.
    """

    weight: Array
    mean: Array
    covariance: Array
    between: float

    def contrast(self, factors: Array) -> tuple[float, float, float, float]:
        """Return mean and 95 % interval of a sum of conditions, and p of its sign.

        p is twice the probability of the sign that is less likely.
        """
        from scipy.optimize import brentq
        from scipy.special import ndtr

        middle = self.mean @ factors
        error = np.sqrt(np.einsum("i,kij,j->k", factors, self.covariance, factors))
        mean, most = float(self.weight @ middle), 12 * float(error.max())

        def below(at: float) -> float:
            return float(self.weight @ ndtr((at - middle) / error))

        ends = middle.min() - most, middle.max() + most
        low, high = (brentq(lambda at: below(at) - share, *ends) for share in _INTERVAL[::2])  # noqa: B023
        return mean, low, high, 2 * min(below(0.0), 1 - below(0.0))


def group(value: Array, spread: Array, person: Sequence[str], condition: Sequence[int]) -> Group:
    """Return means of conditions for the population of the participants.

    A value is the mean of its condition, plus what a participant has in all conditions, plus what
    they have in this one, plus its own error of a known `spread`; all normal. The standard
    deviations of the first two are tried on a grid, with half-Cauchy priors as wide as the values
    scatter (Gelman, Bayesian Anal. 1, 515 (2006)), and the means follow from each pair.

    Parameters
    ----------
    value, spread : ndarray, shape (values,)
        Of a participant in a condition; one value of each pair at most.
    person : sequence of str
        Whose each value is.
    condition : sequence of int
        Of which condition, from 0.
    """
    _, who = np.unique(person, return_inverse=True)
    table = np.zeros((who.max() + 1, max(condition) + 1))
    known, y, variance = table.copy(), table.copy(), table + 1.0
    known[who, condition], y[who, condition], variance[who, condition] = 1.0, value, spread**2
    count = known.sum(0)
    off = (y - (y * known).sum(0) / count) * known
    scale = float(np.sqrt((off**2).sum() / max(1.0, known.sum() - len(count)))) or 1e-9
    sizes = scale * _SIZES
    prior = np.gradient(_SIZES) / (1 + _SIZES**2)
    weights, means, covariances, totals = [], [], [], []
    for shared, of_shared in zip(sizes, prior, strict=True):
        for own, of_own in zip(sizes, prior, strict=True):
            # Covariance of a participant's values: own^2 + spread^2 on the diagonal, plus shared^2.
            precise = known / (variance + own**2)
            each = precise.sum(1)
            factor = shared**2 / (1 + shared**2 * each)
            of_person = (precise * y).sum(1)
            inverse = np.diag(precise.sum(0)) - precise.T @ (factor[:, None] * precise)
            covariance = np.linalg.inv(inverse)
            right = (precise * y).sum(0) - precise.T @ (factor * of_person)
            mean = covariance @ right
            rest = (precise * y**2).sum() - factor @ of_person**2 - right @ mean
            sizes_of = np.log(precise[known > 0]).sum() - np.log1p(shared**2 * each).sum()
            likelihood = 0.5 * (sizes_of - np.linalg.slogdet(inverse)[1] - rest)
            weights.append(likelihood + np.log(of_shared * of_own))
            means.append(mean)
            covariances.append(covariance)
            totals.append(np.hypot(shared, own))
    weight = np.exp(np.array(weights) - max(weights))
    weight /= weight.sum()
    return Group(weight, np.array(means), np.array(covariances), float(weight @ np.array(totals)))
