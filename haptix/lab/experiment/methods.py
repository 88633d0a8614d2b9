"""Methods of an experiment: they choose levels and take answers; those of a fixed order."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from itertools import combinations
from math import isinf, log, nan
from typing import Any, ClassVar

import numpy as np

from haptix.base.checks import Array, positive, row, whole
from haptix.base.errors import InputError
from haptix.lab.experiment.psychometric import Answers, Estimate, fit, function_named


@dataclass(eq=False)
class Method:
    """Chooses levels one at a time by the answers so far. A subclass has its settings as fields."""

    kind: ClassVar[str]
    """Name in recipes."""

    @property
    def level(self) -> float:
        """The level to be presented next."""
        raise NotImplementedError

    @property
    def is_done(self) -> bool:
        """Whether the method is finished."""
        raise NotImplementedError

    @property
    def other_level(self) -> float | None:
        """Level that the next presentation is compared with; None for the reference."""
        return None

    def update(self, is_right: float, level: float | None = None) -> None:
        """Take an answer.

        Parameters
        ----------
        is_right : float
            True, or 1, where it is; the number, where that is the answer.
        level : float, optional
            The presented level, if it differs from the method's.
        """
        raise NotImplementedError

    def postpone(self) -> None:
        """Note that the presentation did not count; by default it is presented again."""

    def estimate(
        self, empty: tuple[int, int] = (0, 0), reaction_s: Sequence[float] = ()
    ) -> Estimate:
        """Estimate from the answers so far.

        Parameters
        ----------
        empty : (int, int)
            Trials without a target in which one was found, and all of them; of tasks that detect.
        reaction_s : sequence of float
            Reaction time of each answer [s], where they are known: see `fast_guesses`.
        """
        raise NotImplementedError

    def describe(self) -> dict[str, Any]:
        """Everything that determines what it does, as plain values; no limit is None."""
        settings = {field.name: getattr(self, field.name) for field in fields(self) if field.init}
        return {"method": self.kind} | {
            name: None if isinstance(value, float) and isinf(value) else value
            for name, value in settings.items()
        }


class ThresholdMethod(Method):
    """A method that measures a threshold; all methods estimate it from the same posterior."""

    answers: Answers
    """Level of each trial, and whether the answer was right."""
    function: str = "weibull"

    @property
    def guess_share(self) -> float:
        """Share right of an observer who guesses."""
        raise NotImplementedError

    def estimate(
        self, empty: tuple[int, int] = (0, 0), reaction_s: Sequence[float] = ()
    ) -> Estimate:
        return fit(self.answers, self.function, self.guess_share, empty, reaction_s)


class FixedOrder(Method):
    """A method whose order of presentations is fixed before the first trial."""

    _order: list[tuple[float, ...]]
    """Level of each presentation, and of what it is compared with, if that is a level."""
    answers: Sequence[object]

    @property
    def _next(self) -> tuple[float, ...]:
        return self._order[min(len(self.answers), len(self._order) - 1)]

    @property
    def level(self) -> float:
        return self._next[0]

    @property
    def is_done(self) -> bool:
        return len(self.answers) >= len(self._order)

    def postpone(self) -> None:
        """Present it again at the end."""
        self._order.append(self._order.pop(len(self.answers)))


def shuffled(levels: Sequence[float], repeats: int, seed: int) -> list[tuple[float, ...]]:
    """Return all levels once in each repetition, in random order."""
    draw = np.random.default_rng(seed)
    return [(float(level),) for _ in range(repeats) for level in draw.permutation(list(levels))]


@dataclass(eq=False)
class MethodsByCondition(Method):
    """A method for each condition.

    Parameters
    ----------
    methods : mapping of str to Method
        By the names of the conditions, in the order of their blocks.
    interleaved : bool
        Each trial's condition is drawn from those that are not done; otherwise one follows another.
    seed : int
        Seed of what is drawn.
    """

    methods: Mapping[str, Method]
    interleaved: bool = True
    seed: int = 0

    kind = "conditions"

    def __post_init__(self) -> None:
        if not self.methods:
            raise InputError("conditions: expected one or more")
        self._taken = 0
        self._drawn: str | None = None

    @property
    def condition(self) -> str:
        """Name of the condition of the next trial."""
        if self._drawn is None:
            left = [name for name, method in self.methods.items() if not method.is_done]
            left = left or list(self.methods)[-1:]
            draw = np.random.default_rng([self.seed, self._taken])
            self._drawn = left[int(draw.integers(len(left)))] if self.interleaved else left[0]
        return self._drawn

    @property
    def level(self) -> float:
        return self.methods[self.condition].level

    @property
    def other_level(self) -> float | None:
        return self.methods[self.condition].other_level

    @property
    def is_done(self) -> bool:
        return all(method.is_done for method in self.methods.values())

    def update(
        self, is_right: float, level: float | None = None, condition: str | None = None
    ) -> None:
        """Take an answer to a condition.

        Parameters
        ----------
        is_right, level : float
            As for `Method.update`.
        condition : str, optional
            By default that of the next trial.
        """
        self.methods[self.condition if condition is None else condition].update(is_right, level)
        self._taken, self._drawn = self._taken + 1, None

    def postpone(self) -> None:
        self.methods[self.condition].postpone()

    def estimate(
        self, empty: tuple[int, int] = (0, 0), reaction_s: Sequence[float] = ()
    ) -> Estimate:
        """Return the estimate of the only condition; several have theirs in `methods`."""
        if len(self.methods) == 1:
            return next(iter(self.methods.values())).estimate(empty, reaction_s)
        return Estimate()

    def describe(self) -> dict[str, Any]:
        described = {name: method.describe() for name, method in self.methods.items()}
        return super().describe() | {"methods": described, "order": list(self.methods)}


@dataclass(eq=False)
class ConstantStimuli(FixedOrder, ThresholdMethod):
    """Every level equally often, in a random order.

    Parameters
    ----------
    levels : sequence of float
        Levels.
    repeats : int
        Presentations of each level.
    seed : int
        Seed of the order; every repetition has all levels once.
    function, guess
        Form of the fitted function and share right of one who guesses, see `fit`.
    """

    levels: Sequence[float]
    repeats: int = 20
    seed: int = 0
    function: str = "weibull"
    guess: float = 0.5

    kind = "constant-stimuli"

    def __post_init__(self) -> None:
        self.levels = row("levels", self.levels, 2).tolist()
        whole("repeats", self.repeats, 1)
        function_named(self.function)
        self._order = shuffled(self.levels, self.repeats, self.seed)
        self.answers: list[tuple[float, bool]] = []

    def update(self, is_right: float, level: float | None = None) -> None:
        self.answers.append((self.level if level is None else float(level), bool(is_right)))

    @property
    def guess_share(self) -> float:
        return self.guess


@dataclass(eq=False)
class Magnitudes(FixedOrder):
    """Magnitude estimation: a number for each presentation, without a standard.

    Stevens, Psychol. Rev. 64, 153 (1957): the geometric mean of the numbers rises as a power of the
    intensity; levels are in dB, 20 log10 of it.

    Parameters
    ----------
    levels : sequence of float
        Levels [dB].
    repeats : int
        Presentations of each; every repetition has all levels once.
    seed : int
        Seed of the order.
    """

    levels: Sequence[float]
    repeats: int = 4
    seed: int = 0

    kind = "magnitudes"

    def __post_init__(self) -> None:
        self.levels = row("levels", self.levels, 2).tolist()
        whole("repeats", self.repeats, 1)
        self._order = shuffled(self.levels, self.repeats, self.seed)
        self.answers: list[tuple[float, float]] = []
        """Level of each trial, and the number that was given."""

    def update(self, is_right: float, level: float | None = None) -> None:
        """Take the number that was given."""
        number = positive("answer", float(is_right))
        self.answers.append((self.level if level is None else float(level), number))

    def estimate(
        self, empty: tuple[int, int] = (0, 0), reaction_s: Sequence[float] = ()
    ) -> Estimate:
        """Return the exponent of the power function and its standard error; no threshold."""
        levels, numbers = np.array(self.answers).reshape(-1, 2).T
        if len(set(levels.tolist())) < 2:
            return Estimate()
        from scipy.stats import linregress

        line_fit = linregress(levels / 20 * log(10), np.log(numbers))
        means = {
            f"mean_at_{level:g}": float(np.exp(np.log(numbers[levels == level]).mean()))
            for level in sorted(set(levels.tolist()))
        }
        line = {"exponent": float(line_fit.slope), "exponent_spread": float(line_fit.stderr)}
        return Estimate(others=line | means)


@dataclass(eq=False)
class Pairs(FixedOrder):
    """Pairwise comparison: which of two levels is more, for all pairs.

    Parameters
    ----------
    levels : sequence of float
        Levels, two or more that differ.
    repeats : int
        Comparisons of each pair; every repetition has all pairs once.
    seed : int
        Seed of the order.
    """

    levels: Sequence[float]
    repeats: int = 4
    seed: int = 0

    kind = "pairs"

    def __post_init__(self) -> None:
        self.levels = row("levels", self.levels, 2).tolist()
        if len(set(self.levels)) < len(self.levels):
            raise InputError("levels: expected levels that differ")
        whole("repeats", self.repeats, 1)
        draw = np.random.default_rng(self.seed)
        pairs = list(combinations(self.levels, 2))
        self._order = [
            pairs[i][:: (1 if draw.random() < 0.5 else -1)]
            for _ in range(self.repeats)
            for i in draw.permutation(len(pairs))
        ]
        self.answers: list[tuple[float, float, bool]] = []
        """The two levels of each trial, and whether the first was more."""

    @property
    def other_level(self) -> float:
        return self._next[1]

    def update(self, is_right: float, level: float | None = None) -> None:
        """Take whether `level` was more than `other_level`."""
        self.answers.append((self.level, self.other_level, bool(is_right)))

    def wins(self) -> Array:
        """Return how often each level was more than each other one, shape (levels, levels)."""
        at = {level: k for k, level in enumerate(self.levels)}
        won = np.zeros((len(at), len(at)))
        for first, second, is_more in self.answers:
            more, less = (first, second) if is_more else (second, first)
            won[at[more], at[less]] += 1
        return won

    def estimate(
        self, empty: tuple[int, int] = (0, 0), reaction_s: Sequence[float] = ()
    ) -> Estimate:
        """Return a scale value for each level, in logits with a mean of 0; no threshold."""
        scale = dict(zip(self.levels, bradley_terry(self.wins())[0].tolist(), strict=True))
        return Estimate(others={f"scale_at_{x:g}": value for x, value in scale.items()})


def bradley_terry(wins: Array) -> tuple[Array, Array, float]:
    """Return scale values in logits with a mean of 0, their standard errors, and how they fit.

    Bradley & Terry, Biometrika 39, 324 (1952), without the bias of few comparisons: each pair gets
    half of its leverage as wins on both sides (Firth, Biometrika 80, 27 (1993)), by which all
    values are finite too. Errors are those of the likelihood's curvature; NaN of a level that was
    never compared. The fit is the probability of a deviance as large from that of pairs that have
    no scale in common (a chi-square approximation); NaN for two levels.

    Parameters
    ----------
    wins : ndarray, shape (levels, levels)
        How often the level of a row was more than that of a column.
    """
    from scipy.special import expit, xlogy
    from scipy.stats import chi2

    count, total = len(wins), wins + wins.T
    value, variances, _ = _most_likely(wins, np.zeros(count))
    share = expit(value[:, None] - value[None, :])
    spread = np.where(total.any(1), np.sqrt(variances.clip(0)), nan)
    off = ~np.eye(count, dtype=bool)
    observed = np.divide(wins, total, out=np.full_like(share, 0.5), where=total > 0)
    deviance = 2 * float((xlogy(wins, observed) - xlogy(wins, share))[off].sum())
    free = int((np.triu(total, 1) > 0).sum()) - (count - 1)
    return value, spread, float(chi2.sf(deviance, free)) if free > 0 else nan


def bradley_terry_intervals(wins: Array) -> Array:
    """Return the 95 % interval of each value of `bradley_terry`, shape (levels, 2).

    Where Firth's likelihood, at its highest with that value held, is within half of a chi-square of
    its maximum: unlike a normal interval it holds the truth as often where some levels are
    never less (Heinze & Schemper, Stat. Med. 21, 2409 (2002)). NaN where comparisons set no end.
    """
    from scipy.optimize import brentq
    from scipy.stats import chi2

    there = (wins + wins.T).any(1)
    wins, ends, most = wins[there][:, there], np.full((len(wins), 2), nan), chi2.ppf(0.95, 1)
    if not there.any():
        return ends
    value, variances, highest = _most_likely(wins, np.zeros(len(wins)))
    for k, own in enumerate(np.flatnonzero(there)):
        along = np.eye(len(wins))[k] - 1 / len(wins)

        def over(off: float, k: int = k, along: Array = along) -> float:
            """Twice the loss of likelihood, over the most of the interval."""
            held = value + off / along[k] * along
            return float(2 * (highest - _most_likely(wins, held, k)[2]) - most)

        for side in (0, 1):
            end = (2 * side - 1) * float(np.sqrt(variances[k]))
            while over(end) < 0 and abs(end) < _FAR:
                end *= 1.5
            if abs(end) < _FAR:
                ends[own, side] = value[k] + brentq(over, 0.0, end, xtol=1e-4)
    return ends


def _most_likely(wins: Array, value: Array, held: int | None = None) -> tuple[Array, Array, float]:
    """Return values by Firth's likelihood from a start, their variances, and its logarithm.

    One of them may be held. Their mean is; they are known but for a constant.
    """
    from scipy.special import expit, log_expit

    total = wins + wins.T
    free = np.eye(len(wins)) - 1 / len(wins)
    if held is not None:
        free -= np.outer(free[held], free[held]) / free[held, held]
    for _ in range(_MOST_STEPS):
        apart = value[:, None] - value[None, :]
        share = expit(apart)
        bend = total * share * (1 - share)
        curvature = np.diag(bend.sum(1)) - bend
        errors = np.linalg.pinv(curvature)
        variances = np.diag(errors)
        leverage = bend * (variances[:, None] + variances[None, :] - 2 * errors)
        score = (wins + leverage / 2 - (total + leverage) * share).sum(1)
        # With the curvature of the wins alone it would swing about a pair that was compared once.
        of_all = (total + leverage) * share * (1 - share)
        of_all = np.diag(of_all.sum(1)) - of_all
        step = np.linalg.pinv(of_all if held is None else free @ of_all @ free) @ score
        if np.abs(step).max() < 1e-10:
            break
        value = value + step * min(1.0, 1 / max(float(np.abs(step).max()), 1e-300))
    sizes = np.linalg.eigvalsh(curvature)[1:]
    penalty = np.log(np.maximum(sizes, 1e-12)).sum() / 2
    return value, variances, float((wins * log_expit(apart)).sum() + penalty)


_FAR = 25.0  # logits; no comparisons set an end there
_MOST_STEPS = 200  # some ten are taken
