"""Methods that compare levels, or items of a set: numbers, pairs, triads, free sorting.

The items of a set have their numbers, from 0, as levels, and their names in `items`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import combinations
from math import log, nan
from typing import ClassVar

import numpy as np

from haptix.base.checks import Array, choice, positive, row, whole
from haptix.base.errors import InputError
from haptix.lab.experiment.methods import FixedOrder
from haptix.lab.experiment.orders import shuffled, williams_square
from haptix.lab.experiment.psychometric import Estimate


@dataclass(eq=False)
class Comparison(FixedOrder):
    """A method without a threshold, whose answers compare levels or items.

    Parameters
    ----------
    levels : sequence of float
        Levels; of items, their numbers from 0.
    repeats : int
        Repetitions of all presentations.
    seed : int
        Seed of the order.
    items : sequence of str
        Names of the items, if the levels are their numbers.
    """

    levels: Sequence[float]
    repeats: int = 4
    seed: int = 0
    items: Sequence[str] = ()

    least_levels: ClassVar[int] = 2

    def __post_init__(self) -> None:
        self.levels = row("levels", self.levels, self.least_levels).tolist()
        if len(set(self.levels)) < len(self.levels):
            raise InputError("levels: expected levels that differ")
        if self.items and self.levels != [*range(len(self.items))]:
            raise InputError("levels: expected the numbers of the items, from 0; leave them out")
        whole("repeats", self.repeats, 1)
        self._order = self._ordered(np.random.default_rng(self.seed))
        self.answers = []

    def _ordered(self, draw: np.random.Generator) -> list[tuple[float, ...]]:
        """Return the levels of each presentation."""
        raise NotImplementedError

    @property
    def other_levels(self) -> tuple[float, ...]:
        return self._next[1:]

    def label(self, level: float) -> float | str:
        """Return the name of an item, or the level."""
        return self.items[int(level)] if self.items else level

    def name(self, level: float) -> str:
        """Return the name of an item, or the level in digits."""
        return self.items[int(level)] if self.items else f"{level:g}"


@dataclass(eq=False)
class Magnitudes(Comparison):
    """Magnitude estimation: a number for each presentation, without a standard.

    Stevens, Psychol. Rev. 64, 153 (1957): the geometric mean of the numbers rises as a power of the
    intensity; levels are in dB, 20 log10 of it. Every repetition has all levels once.

    Parameters
    ----------
    levels, repeats, seed, items
        As for `Comparison`.
    first_row : int, optional
        Row that orders the first repetition, of Williams squares one after another; later ones take
        the rows after it. Over the rows of a square each level follows each other one equally
        often. By default the orders are random.
    square_seed : int, optional
        Seed by which each square's levels and the order of its rows are drawn; those who share
        squares have the same. By default each square is that of `williams_square`.
    """

    first_row: int | None = None
    square_seed: int | None = None

    kind = "magnitudes"

    answers: list[tuple[float, float]] = field(init=False)
    """Level of each trial, and the number that was given."""

    def _ordered(self, draw: np.random.Generator) -> list[tuple[float, ...]]:
        if self.first_row is None:
            return shuffled(self.levels, self.repeats, self.seed)
        order = list[tuple[float, ...]]()
        for number in range(self.first_row, self.first_row + self.repeats):
            square = np.array(williams_square(len(self.levels)))
            which, at = divmod(number, len(square))
            if self.square_seed is not None:
                draw = np.random.default_rng([self.square_seed, which])
                square = draw.permutation(draw.permutation(len(self.levels))[square])
            order += [(self.levels[k],) for k in square[at]]
        return order

    def update(self, is_right: float, level: float | None = None) -> None:
        """Take the number that was given."""
        number = positive("answer", float(is_right))
        self.answers.append((self.level if level is None else float(level), number))

    def estimate(
        self, empty: tuple[int, int] = (0, 0), reaction_s: Sequence[float] | None = None
    ) -> Estimate:
        """Return geometric means, and of levels the exponent of the power function."""
        levels, numbers = np.array(self.answers).reshape(-1, 2).T
        if len(set(levels.tolist())) < 2:
            return Estimate()
        means = {
            f"mean_at_{self.name(level)}": float(np.exp(np.log(numbers[levels == level]).mean()))
            for level in sorted(set(levels.tolist()))
        }
        if self.items:
            return Estimate(others=means)
        from scipy.stats import linregress

        line_fit = linregress(levels / 20 * log(10), np.log(numbers))
        line = {"exponent": float(line_fit.slope), "exponent_spread": float(line_fit.stderr)}
        return Estimate(others=line | means)


@dataclass(eq=False)
class Pairs(Comparison):
    """Pairwise comparison: which of two is more, for all pairs.

    Every repetition has all pairs once, in random order. The order within a pair is drawn, and
    reversed from one repetition to the next.

    Parameters
    ----------
    levels, repeats, seed, items
        As for `Comparison`.
    """

    kind = "pairs"

    answers: list[tuple[float, float, bool]] = field(init=False)
    """The two levels of each trial, and whether the first was more."""

    def _ordered(self, draw: np.random.Generator) -> list[tuple[float, ...]]:
        pairs = list(combinations(self.levels, 2))
        reverse = draw.random(len(pairs)) < 0.5
        return [
            pairs[i][:: -1 if reverse[i] ^ (k % 2) else 1]
            for k in range(self.repeats)
            for i in draw.permutation(len(pairs))
        ]

    def update(self, is_right: float, level: float | None = None) -> None:
        """Take whether `level` was more than the other one."""
        first, second = self._next
        self.answers.append((first, second, bool(is_right)))

    def wins(self) -> Array:
        """Return how often each level was more than each other one, shape (levels, levels)."""
        at = {level: k for k, level in enumerate(self.levels)}
        won = np.zeros((len(at), len(at)))
        for first, second, is_more in self.answers:
            more, less = (first, second) if is_more else (second, first)
            won[at[more], at[less]] += 1
        return won

    def estimate(
        self, empty: tuple[int, int] = (0, 0), reaction_s: Sequence[float] | None = None
    ) -> Estimate:
        """Return a scale value for each level, in logits with a mean of 0; no threshold."""
        scale = dict(zip(self.levels, bradley_terry(self.wins())[0].tolist(), strict=True))
        return Estimate(others={f"scale_at_{self.name(x)}": value for x, value in scale.items()})


class Similarities(Comparison):
    """A comparison of which items are alike."""

    def alike(self) -> tuple[Array, Array]:
        """Return how often each two were called alike, and compared, shape (levels, levels)."""
        raise NotImplementedError

    def estimate(
        self, empty: tuple[int, int] = (0, 0), reaction_s: Sequence[float] | None = None
    ) -> Estimate:
        """Return nothing: `alike` has the answers."""
        return Estimate()


@dataclass(eq=False)
class Triads(Similarities):
    """Method of triads: which of three is least like the other two.

    Each answer calls the other two alike (Torgerson, Theory and Methods of Scaling (1958), ch. 11).
    Every repetition has each triad once, or `triads` of them, drawn so that all pairs come about
    equally often. Each of a triad has each of the three places once in three repetitions.

    Parameters
    ----------
    levels, repeats, seed, items
        As for `Comparison`.
    triads : int, optional
        Triads of a repetition. By default all: 10 of 5 items, 56 of 8, 120 of 10.
    """

    triads: int | None = None
    repeats: int = 1

    kind = "triads"
    least_levels = 3

    answers: list[tuple[float, float, float, int]] = field(init=False)
    """The three levels of each trial, and the place, from 0, of the one that was least alike."""

    def _ordered(self, draw: np.random.Generator) -> list[tuple[float, ...]]:
        every = np.array([*combinations(range(len(self.levels)), 3)])
        count = len(every) if self.triads is None else whole("triads", self.triads, 1)
        if count > len(every):
            raise InputError(f"triads: expected at most {len(every)}, got {count}")
        seen, order = np.zeros((len(self.levels),) * 2), []
        turns = draw.permuted(np.tile(np.arange(3), (len(every), 1)), axis=1)
        for repetition in range(self.repeats):
            chosen: list[int] = []
            left = draw.permutation(len(every))
            for _ in range(count):
                i, j, k = every[left].T
                at = int(np.argmin(seen[i, j] ** 2 + seen[i, k] ** 2 + seen[j, k] ** 2))
                chosen.append(int(left[at]))
                left = np.delete(left, at)
                for one, other in combinations(every[chosen[-1]], 2):
                    seen[one, other] += 1
            order += [
                tuple(self.levels[one] for one in np.roll(every[at][turns[at]], repetition))
                for at in draw.permutation(chosen)
            ]
        return order

    def update(self, is_right: float, level: float | None = None) -> None:
        """Take the place, from 1, of the one that is least like the other two."""
        place = choice("answer", int(is_right), (1, 2, 3))
        first, second, third = self._next
        self.answers.append((first, second, third, place - 1))

    def alike(self) -> tuple[Array, Array]:
        alike, together = np.zeros((2, len(self.levels), len(self.levels)))
        place = {level: k for k, level in enumerate(self.levels)}
        for *three, odd in self.answers:
            at = [place[level] for level in three]
            for one, other in combinations(at, 2):
                together[[one, other], [other, one]] += 1
            one, other = (item for k, item in enumerate(at) if k != odd)
            alike[[one, other], [other, one]] += 1
        return alike, together


@dataclass(eq=False)
class Sorting(Similarities):
    """Free sorting: the number of a group for each presentation; items of a group are alike.

    All items come once in each repetition, in random order, and may move to another group. The
    groups of the last repetition count (Coxon, Sorting Data (1999)).

    Parameters
    ----------
    levels, repeats, seed, items
        As for `Comparison`.
    """

    repeats: int = 2

    kind = "sorting"
    least_levels = 3

    answers: list[tuple[float, int]] = field(init=False)
    """Level of each trial, and the number of its group."""

    def _ordered(self, draw: np.random.Generator) -> list[tuple[float, ...]]:
        return shuffled(self.levels, self.repeats, self.seed)

    def update(self, is_right: float, level: float | None = None) -> None:
        """Take the number of the group."""
        self.answers.append((self.level, whole("answer", int(is_right), 1)))

    def groups(self) -> dict[float, int]:
        """Return the last group of each level that has one."""
        return dict(self.answers)

    def alike(self) -> tuple[Array, Array]:
        groups = self.groups()
        number = np.array([groups.get(level, 0) for level in self.levels])
        together = ((number[:, None] > 0) & (number > 0)).astype(float)
        np.fill_diagonal(together, 0.0)
        return together * (number[:, None] == number), together


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
    value, errors, _ = _most_likely(wins, np.zeros(count))
    share = expit(value[:, None] - value[None, :])
    spread = np.where(total.any(1), np.sqrt(np.diag(errors).clip(0)), nan)
    off = ~np.eye(count, dtype=bool)
    observed = np.divide(wins, total, out=np.full_like(share, 0.5), where=total > 0)
    deviance = 2 * float((xlogy(wins, observed) - xlogy(wins, share))[off].sum())
    free = int((np.triu(total, 1) > 0).sum()) - (count - 1)
    return value, spread, float(chi2.sf(deviance, free)) if free > 0 else nan


def bradley_terry_errors(wins: Array) -> Array:
    """Return the covariance of the values of `bradley_terry`, shape (levels, levels)."""
    return _most_likely(wins, np.zeros(len(wins)))[1]


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
    value, errors, highest = _most_likely(wins, np.zeros(len(wins)))
    variances = np.diag(errors)
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
    """Return values by Firth's likelihood from a start, their covariance, and its logarithm.

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
    return value, errors, float((wins * log_expit(apart)).sum() + penalty)


_FAR = 25.0  # logits; no comparisons set an end there
_MOST_STEPS = 200  # some ten are taken
