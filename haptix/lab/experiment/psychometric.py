"""Psychometric functions, their fit to answers, a test for guessing, and the means of a group."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import inf, isfinite, nan
from typing import Any

import numpy as np
import numpy.typing as npt

from haptix.base.checks import Array, choice


@dataclass(frozen=True)
class Estimate:
    """Estimate from answers: a threshold with its interval, and other parameters."""

    threshold: float = nan
    """Detection threshold, in the units of the levels; NaN if the answers give none."""
    low: float = nan
    """The threshold lies from here to `high` with 95 %; an end that is not known is infinite."""
    high: float = nan
    others: dict[str, float] = field(default_factory=dict)
    """Slope and other estimated parameters."""
    warnings: tuple[str, ...] = ()
    """Why there is no threshold, or what the observer did that the interval allows for."""
    likelihood: tuple[Array, Array] | None = field(default=None, repr=False, compare=False)
    """Levels, and the logarithm of the likelihood of a threshold at each; None for few answers."""

    @property
    def width(self) -> float:
        """Width of the interval; NaN without a threshold."""
        return self.high - self.low

    def record(self) -> dict[str, Any]:
        """Return plain values for JSON; an unknown one is None."""
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

_BEYOND_CHANCE = 3.3
"""Logarithm of the likelihood ratio from which answers are no guesses: p = 0.01 of chi-squared."""

_LEAST_ANSWERS = 10  # seven right ones in a row are no chance
_SURELY = 0.95  # probability from which a warning is given
_INTERVAL = (0.025, 0.5, 0.975)
_EPOCHS = 4  # of a run, for drift and overdispersion
_REACH = 4.0  # beyond the levels, in typical widths, that a threshold is looked for
_FINE = 800  # shares at which the likelihood of a cell is tabulated: much finer than its bends
_MOST_LAPSE, _LAPSES_AS = 0.25, 22.0
_ANY_LAPSE = 0.2  # of observers: attention that is elsewhere, or answers that are early guesses
_LEAST_TIMES = 30  # answers whose times show two kinds
_EM_STEPS = 60
_FASTEST_S, _LEAST_SPREAD = 1e-3, 0.05
_TWENTY_TO_ONE = 3.0  # logarithm
_ALIKE = 1.92  # of logarithms of likelihoods: half of chi-squared at 95 %
_SLOPES_WITHIN = 0.85
_DRIFTS = np.array([-4.0, -2.0, -1.0, 0.0, 1.0, 2.0, 4.0])
_NO_DRIFT = 0.7
_OVERDISPERSION = np.array([0.003, 0.1, 0.2, 0.32, 0.46])
_MANY_LAPSES = 0.06
_LIKELY, _MAY_BE = 0.75, 0.5
_TYPICAL_SLOPE = 3.5


def without(estimate: Estimate, why: str, is_above: bool | None = None) -> Estimate:
    """Return an estimate without a threshold, with the reason and the end that is known."""
    low, high = nan, nan
    if is_above is not None and estimate.likelihood is not None:
        levels, logs = estimate.likelihood
        alike = levels[logs > logs.max() - _ALIKE]
        low, high = (float(alike[0]), inf) if is_above else (-inf, float(alike[-1]))
    warnings = (f"no threshold: {why}", *estimate.warnings)
    return replace(estimate, threshold=nan, low=low, high=high, warnings=warnings)


def counted(answers: Answers) -> tuple[Array, Array, Array]:
    """Levels, and counts of right and wrong answers at each."""
    levels, at = np.unique([level for level, _ in answers], return_inverse=True)
    right = np.bincount(at, [is_right for _, is_right in answers], len(levels))
    total = np.bincount(at, minlength=len(levels)).astype(float)
    return levels, right.astype(float), total - right


def fit(
    answers: Answers,
    function: str = "weibull",
    guess: float = 0.5,
    empty: tuple[int, int] = (0, 0),
    reaction_s: Sequence[float] = (),
) -> Estimate:
    """Return the threshold with its 95 % interval; any method may have chosen the levels.

    The posterior over threshold, slope, lapse rate, overdispersion and drift, on a grid. Answers
    at one level in one quarter of the run are beta-binomial about the function: an observer who
    changes widens the interval (Schuett, Harmeling, Macke & Wichmann, Vision Res. 122, 105
    (2016)). The threshold may drift evenly over the run; it is that of the middle. The median is
    stated. There is none where no function that rises is better than guessing by a likelihood
    ratio (p = 0.01), or where it lies beyond the levels: then `low` or `high` is the other end.

    Answers that are fast guesses by their reaction times (`fast_guesses`) are right by chance.

    Priors: even for the threshold; log-normal for the slope about 3.5, of a normal function about
    an eighth of the range of the levels, within a factor of 2.3; Beta(1, 22) for the lapse rate,
    and for one observer in five any rate up to a quarter; Beta(1, 10) for the overdispersion, the
    square root of the correlation of two answers; three tenths for a drift, of at most 10 dB or
    four widths of the function.

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
    reaction_s : sequence of float
        Reaction time of each answer [s], if they are known.
    """
    function_named(function)
    if len(answers) < _LEAST_ANSWERS:
        return without(Estimate(), f"{len(answers)} answers; it takes {_LEAST_ANSWERS} or more")
    guessed = np.zeros(len(answers))
    if len(reaction_s) == len(answers):
        guessed = fast_guesses(answers, reaction_s, guess)
    posterior, over_chance = _posterior(answers, function, guess, empty, guessed)
    if guessed.any():
        posterior.others["fast_guesses"] = share = float(guessed.mean())
        warning = f"{share:.0%} of the answers are fast guesses by their times, and count as such"
        posterior = replace(posterior, warnings=(*posterior.warnings, warning))
    levels = [level for level, _ in answers]
    low, high = min(levels), max(levels)
    if function == "symmetric-normal" or over_chance > _BEYOND_CHANCE:
        if low <= posterior.threshold <= high:
            return posterior
        is_above = posterior.threshold > high
        end = "above" if is_above else "below"
        why = f"it lies {end} the levels that were presented, {low:g} to {high:g}"
        return without(posterior, why, is_above)
    right = sum(is_right for _, is_right in answers)
    why = (
        f"{right} of {len(answers)} answers were right, and no function that rises is better than "
        f"guessing (ln likelihood ratio {over_chance:.1f}, expected {_BEYOND_CHANCE:g})"
    )
    return without(posterior, why, True)


def fast_guesses(answers: Answers, reaction_s: Sequence[float], guess: float = 0.5) -> Array:
    """Return the probability that each answer is a fast guess, shape (answers,).

    Reaction times are a mixture of two log-normal distributions (Ollman, Psychon. Sci. 6, 155
    (1966)): the faster answers are right by chance, or, like the others, as often as all are at
    their level. The probabilities are 0 unless the first is 20 times as likely.

    Parameters
    ----------
    answers : sequence of (float, bool)
        Levels, and whether the answers were right.
    reaction_s : sequence of float
        Time from the end of each presentation to the answer [s].
    guess : float
        Share right of one who guesses.
    """
    none, time_s = np.zeros(len(answers)), np.array(reaction_s, dtype=float)
    if len(answers) < _LEAST_TIMES or not (time_s > 0).mean() > _SURELY or not 0 < guess < 1:
        return none
    time = np.log(np.maximum(time_s, _FASTEST_S))
    levels, is_right = np.array(answers, dtype=float).T
    _, at = np.unique(levels, return_inverse=True)
    by_chance = np.where(is_right > 0, guess, 1 - guess)
    first = time <= np.quantile(time, 0.2)  # many may have the same time
    if first.all():
        return none
    best, fast = -inf, none
    for guesses in (False, True):
        share, is_fast = 0.2, first.astype(float)
        for _ in range(_EM_STEPS):
            slow = 1 - is_fast
            # Share right of those who do not guess at each level, with an answer of chance added.
            kept = slow if guesses else np.ones(len(time))
            right = (np.bincount(at, kept * is_right) + guess) / (np.bincount(at, kept) + 1)
            felt = np.where(is_right > 0, right[at], 1 - right[at])
            densities = []
            for part, weight, of_answer in (
                (is_fast, share, by_chance if guesses else felt),
                (slow, 1 - share, felt),
            ):
                middle = part @ time / part.sum()
                sd = max(float(np.sqrt(part @ (time - middle) ** 2 / part.sum())), _LEAST_SPREAD)
                off = (time - middle) / sd
                densities.append(weight / sd * np.exp(-0.5 * off**2) * of_answer)
            total = densities[0] + densities[1] + 1e-300
            is_fast = densities[0] / total
            share = float(np.clip(is_fast.mean(), 0.01, 0.5))
        likelihood = float(np.log(total).sum())
        if not guesses:
            best = likelihood
        elif likelihood > best + _TWENTY_TO_ONE and is_fast @ time < share * time.sum():
            fast = is_fast
    return fast


def _posterior(
    answers: Answers, function: str, guess: float, empty: tuple[int, int], guessed: Array
) -> tuple[Estimate, float]:
    """Median, interval, means of the other parameters; and the likelihood ratio to guessing."""
    from scipy.stats import beta

    shape, in_db = function_named(function), function == "weibull"
    levels, is_right = np.array(answers, dtype=float).T
    quarter = np.arange(len(levels)) * _EPOCHS // len(levels)
    shared = np.rint(4 * guessed) / 4
    informs = shared < 1
    if not informs.any():
        shared, informs = np.zeros(len(levels)), np.ones(len(levels), dtype=bool)
    is_right = is_right[informs]
    cells, at = np.unique(
        np.stack([levels, quarter, shared])[:, informs], axis=1, return_inverse=True
    )
    level, when, by_chance = cells[0], (cells[1] + 0.5) / _EPOCHS - 0.5, cells[2]
    total = np.bincount(at.ravel()).astype(float)
    right = np.bincount(at.ravel(), is_right).astype(float)
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
        felt = shape(level, middle, slope, guesses[:, None, None], off)
        return np.asarray(by_chance * guesses[:, None, None] + (1 - by_chance) * felt)

    def prior(log_slope: Array, lapse: Array) -> Array:
        of_slope = np.exp(-0.5 * (log_slope / _SLOPES_WITHIN) ** 2)
        usual = (1 - _ANY_LAPSE) * _LAPSES_AS * (1 - lapse) ** (_LAPSES_AS - 1)
        return np.asarray(of_slope[:, None] * (usual + _ANY_LAPSE / _MOST_LAPSE))

    # First without drift and overdispersion, to see where the mass is.
    p = shares(*axes, np.zeros(1)).clip(1e-9, 1 - 1e-9)
    likelihood = np.log(p) @ right + np.log1p(-p) @ (total - right)
    over_chance = _over_chance(likelihood[..., 0].max((0, 1, 2)), right, total, guesses, empty)
    weight = _weights(likelihood).sum((3, 4)) * prior(*axes[1:])
    ends = axes[0][[0, -1]]
    # Where answers may be lapses or a flat function, what either allows is in the interval.
    of_slope = -0.5 * (axes[1] / _SLOPES_WITHIN) ** 2
    profile = (likelihood[..., 0].max((2, 3)) + of_slope).max(1)
    allowed = axes[0][profile > profile.max() - _ALIKE]
    axes = (
        _around(weight.sum((1, 2)), axes[0], 61),
        _around(weight.sum((0, 2)), axes[1], 9),
        _around(weight.sum((0, 1)), axes[2], 6),
    )
    drifts = _DRIFTS * typical
    p = shares(*axes, drifts)
    steps = np.rint(np.moveaxis(p, -1, 0) * _FINE).astype(np.intp)
    likelihood = np.zeros((*p.shape[:-1], len(_OVERDISPERSION)))
    for table, steps_at in zip(_beta_binomial(right, total), steps, strict=True):
        likelihood += table.take(steps_at, 0)
    likelihood = np.moveaxis(likelihood, -1, 0)
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
    low, middle, high = np.interp(_INTERVAL, np.cumsum(mass) - mass / 2, axes[0]).tolist()
    log_mass = np.log(np.maximum(mass / mass.max(), 1e-300))
    inside = axes[0][log_mass > -_ALIKE]
    if log_mass[-1] > -_ALIKE and axes[0][-1] == ends[1]:
        low, high = float(inside[0]), inf
    if log_mass[0] > -_ALIKE and axes[0][0] == ends[0]:
        low, high = -inf, (float(inside[-1]) if isfinite(high) else inf)
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
    if lapsing > _MAY_BE:
        low, high = min(low, float(allowed[0])), max(high, float(allowed[-1]))
    warnings = tuple(_said(others, lapsing, marginal(0)))
    found = Estimate(float(middle), float(low), float(high), others, warnings, (axes[0], log_mass))
    return found, over_chance


def _beta_binomial(right: Array, total: Array) -> Iterator[Array]:
    """Logarithm of the likelihood of each cell, shape (shares of ``_FINE``, overdispersion).

    ``B(r + a, n - r + b) / B(a, b)`` for counts r of n is the product of the first r of a, a + 1,
    ..., and of the first n - r of b, b + 1, ..., over that of the first n of a + b, a + b + 1, ....
    """
    share = np.clip(np.arange(_FINE + 1) / _FINE, 0.25 / _FINE, 1 - 0.25 / _FINE)[:, None]
    spread = 1 / _OVERDISPERSION**2 - 1

    def log_products(first: Array) -> Array:
        """Of the first 0, 1, 2, ... factors from `first`."""
        factors = first + np.arange(total.max()).reshape(-1, *[1] * first.ndim)
        return np.concatenate([np.zeros((1, *first.shape)), np.log(factors).cumsum(0)])

    # The shares are even about a half: what b = (1 - share) spread gives is what a gives, turned.
    of_right, of_all = log_products(share * spread), log_products(spread)
    for r, n in zip(right.astype(int), total.astype(int), strict=True):
        yield of_right[r] + of_right[n - r, ::-1] - of_all[n]


def _over_chance(
    best: Array, right: Array, total: npt.NDArray[Any], guesses: Array, empty: tuple[int, int]
) -> float:
    """Logarithm of the likelihood of the best function over that of an observer who guesses.

    `best` has the function's for each of the shares `guesses`. Where trials without a target tell
    the share of a guesser, both are at their best share.
    """
    from scipy.special import xlog1py, xlogy

    found, shown = float(right.sum()), float(total.sum())
    share = (found + empty[0]) / (shown + empty[1]) if empty[1] else float(guesses[0])
    by_chance = xlogy(found + empty[0], share) + xlog1py(
        shown + empty[1] - found - empty[0], -share
    )
    of_empty = xlogy(empty[0], guesses) + xlog1py(empty[1] - empty[0], -guesses)
    return float((best + of_empty).max() - by_chance)


def _said(others: Mapping[str, float], lapsing: float, scatter: Array) -> Iterator[str]:
    """Name what the answers show of the observer, which the interval allows for."""
    if others["drift_probability"] > _SURELY:
        yield (
            f"the threshold drifts by {others['drift']:+.1f} from the first trial to the last; it "
            "is stated for the middle"
        )
    if lapsing > _LIKELY:
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


_SIZES = np.concatenate([[0.0], np.geomspace(0.05, 5.0, 16)])


@dataclass(frozen=True)
class Group:
    """Posterior of the means of conditions: a mixture of normal distributions."""

    weight: Array
    """Of each pair of standard deviations between participants that was tried; shape (sizes,)."""
    mean: Array
    """Means of the conditions; shape (sizes, conditions)."""
    covariance: Array
    """Of the means; shape (sizes, conditions, conditions)."""
    between: float
    """Standard deviation between participants in a condition."""

    def _along(self, factors: Array) -> tuple[Array, Array]:
        variance = np.einsum("i,kij,j->k", factors, self.covariance, factors)
        return self.mean @ factors, np.sqrt(variance)

    def p(self, factors: Array) -> float:
        """Twice the probability of the sign of a sum of conditions that is less likely."""
        from scipy.special import ndtr

        middle, error = self._along(factors)
        below = float(self.weight @ ndtr(-middle / error))
        return 2 * min(below, 1 - below)

    def contrast(self, factors: Array) -> tuple[float, float, float, float]:
        """Return mean and 95 % interval of a sum of conditions, and `p`."""
        from scipy.optimize import brentq
        from scipy.special import ndtr

        middle, error = self._along(factors)
        most = 12 * float(error.max())
        ends = middle.min() - most, middle.max() + most

        def beyond(at: float, share: float) -> float:
            return float(self.weight @ ndtr((at - middle) / error)) - share

        low, high = (brentq(beyond, *ends, (share,)) for share in _INTERVAL[::2])
        return float(self.weight @ middle), low, high, self.p(factors)


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
    table = _Table.of(person, condition)
    off, free = value - table.means(value), max(1, len(value) - table.conditions)
    return table.solved(value, spread, float(np.sqrt((off**2).sum() / free)) or 1e-9)[0]


def group_of_likelihoods(
    likelihoods: Sequence[tuple[Array, Array]], person: Sequence[str], condition: Sequence[int]
) -> Group:
    """Return the means of `group` for people of whom likelihoods are known, not only values.

    One whose threshold lies above all levels has a likelihood that stays high there. Each is
    replaced by the normal distribution that leaves the same mean and variance, given all others
    (expectation propagation; Minka, Proc. 17th Conf. Uncertainty in Artificial Intelligence, 362
    (2001)).

    Parameters
    ----------
    likelihoods : sequence of (ndarray, ndarray)
        Values, and the logarithm of the likelihood at each; beyond the ends it stays as it is.
    person, condition : sequence
        As in `group`.
    """
    table, count = _Table.of(person, condition), len(likelihoods)
    ends = [end for values, _ in likelihoods for end in (values[0], values[-1])]
    reach = max(ends) - min(ends)
    grid = np.linspace(min(ends) - reach, max(ends) + reach, _GRID)
    logs = np.array([np.interp(grid, *one) for one in likelihoods])

    def moments(middle: Array, variance: Array) -> tuple[Array, Array]:
        weight = logs - 0.5 * (grid - middle[:, None]) ** 2 / variance[:, None]
        weight = np.exp(weight - weight.max(1, keepdims=True))
        weight /= weight.sum(1, keepdims=True)
        mean = weight @ grid
        return mean, np.maximum(weight @ grid**2 - mean**2, (grid[1] - grid[0]) ** 2 / 12)

    wide = np.full(count, reach**2)
    value, variance = moments(np.full(count, np.mean(ends)), wide)
    closed = np.array([max(one[0], one[-1]) < -_ALIKE for _, one in likelihoods])
    centre = value - table.means(value, closed)
    scatter = float(np.sqrt((centre[closed] ** 2).sum() / max(1, closed.sum() - table.conditions)))
    scale = max(scatter, float(np.sqrt(np.median(variance[closed])))) if closed.any() else reach / 8
    precision, shift = 1 / variance, value / variance
    for _ in range(_ROUNDS):
        found, middle, cavity = table.solved(shift / precision, precision**-0.5, scale)
        middle = np.where(cavity < wide, middle, np.mean(ends))
        cavity = np.minimum(cavity, wide)
        mean, left = moments(middle, cavity)
        new = np.maximum(1 / left - 1 / cavity, 1e-4 / wide)
        moved = np.where(new > 1e-4 / wide, mean / left - middle / cavity, new * mean)
        is_settled = np.abs(moved / new - shift / precision).max() < _SETTLED * scale
        shift, precision = moved, new
        if is_settled:
            break
    return found


_GRID = 1000
_ROUNDS, _SETTLED = 12, 0.01


@dataclass(frozen=True)
class _Table:
    """Places of values in a table of participants and conditions."""

    who: npt.NDArray[np.int64]
    condition: npt.NDArray[np.int64]

    @classmethod
    def of(cls, person: Sequence[str], condition: Sequence[int]) -> _Table:
        return cls(np.unique(person, return_inverse=True)[1], np.array(condition))

    @property
    def conditions(self) -> int:
        return int(self.condition.max()) + 1

    def means(self, value: Array, weight: Array | None = None) -> Array:
        """Mean of each value's condition, by weights."""
        weight = np.ones(len(value)) if weight is None else np.asarray(weight, dtype=float)
        total = np.bincount(self.condition, weight * value, self.conditions)
        count = np.bincount(self.condition, weight, self.conditions)
        overall = (weight @ value) / max(float(weight.sum()), 1e-300)
        means = np.where(count > 0, total / np.maximum(count, 1e-300), overall)
        return np.asarray(means[self.condition])

    def solved(self, value: Array, spread: Array, scale: float) -> tuple[Group, Array, Array]:
        """Return the posterior, and mean and variance of each true value by all others alone.

        `scale` is that of the priors of both standard deviations between participants.
        """
        place = self.who, self.condition
        known = np.zeros((int(self.who.max()) + 1, self.conditions))
        y, variance = known.copy(), known + 1.0
        known[place], y[place], variance[place] = 1.0, value, spread**2
        prior = np.gradient(_SIZES) / (1 + _SIZES**2)
        # Each pair of sizes: shape (sizes, participants, conditions).
        shared, own = (
            sizes.ravel() for sizes in np.meshgrid(*2 * (scale * _SIZES,), indexing="ij")
        )
        of_sizes = np.log(np.outer(prior, prior)).ravel()
        # Covariance of a participant's values: own^2 + spread^2 on the diagonal, plus shared^2.
        precise = known / (variance + own[:, None, None] ** 2)
        each = precise.sum(2)
        factor = shared[:, None] ** 2 / (1 + shared[:, None] ** 2 * each)
        inverse = precise.sum(1)[:, :, None] * np.eye(self.conditions)
        inverse = inverse - precise.mT @ (factor[..., None] * precise)
        covariance = np.linalg.inv(inverse)

        def whitened(values: Array) -> Array:
            """Inverse covariance of the values, times values."""
            weighed = precise * values
            return np.asarray(weighed - (factor * weighed.sum(2))[:, :, None] * precise)

        mean = (covariance @ whitened(y).sum(1)[..., None])[..., 0]
        off = whitened(y - mean[:, None, :])
        rest = (y * off).sum((1, 2))
        with np.errstate(divide="ignore"):
            sizes_of = np.where(known > 0, np.log(precise), 0.0).sum((1, 2))
        sizes_of = sizes_of - np.log1p(shared[:, None] ** 2 * each).sum(1)
        likelihood = 0.5 * (sizes_of - np.linalg.slogdet(inverse)[1] - rest)
        weight = _weights(likelihood + of_sizes)
        weight /= weight.sum()
        between = float(weight @ np.hypot(shared, own))
        # Each value by all others (Sundararajan & Keerthi, Neural Comput. 13, 1103 (2001)).
        of_means = precise[..., None] * np.eye(self.conditions)
        of_means = of_means - (factor[..., None] * precise)[..., None] * precise[:, :, None, :]
        taken = (of_means @ covariance[:, None] * of_means).sum(-1)
        alone = (precise - factor[..., None] * precise**2 - taken)[:, *place]
        alone = np.maximum(alone, 1e-12 / scale**2)
        middle = value - off[:, *place] / alone
        others = weight @ middle
        left = weight @ (np.maximum(1 / alone - spread**2, 0.0) + middle**2) - others**2
        return Group(weight, mean, covariance, between), others, np.maximum(left, 1e-12)
