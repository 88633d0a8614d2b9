"""The power of a plan before its first session, by simulation.

An experiment is run by simulated observers: precision of its thresholds, and the participants that
it needs. Of a set of stimuli, each is rendered, and its sensation level follows from the attraction
of the skin. The louder of its steady part and its edges is compared with people whose thresholds
scatter around the published ones. Scatter, slope and lapse rate are assumptions of the caller,
repeated in each row, because the sources that were read do not state them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from math import ceil, inf, isnan
from time import perf_counter
from typing import Any

import numpy as np
import numpy.typing as npt

from haptix.base.checks import Array, number, positive, whole
from haptix.base.errors import InputError
from haptix.base.files import csv_text
from haptix.base.report import record
from haptix.base.task import Context, Result, Task
from haptix.lab.experiment.methods import Method
from haptix.lab.experiment.psychometric import counted, function_named, group_of_likelihoods
from haptix.lab.experiment.recipe import ExperimentRecipe
from haptix.lab.experiment.session_plan import TASKS
from haptix.lab.stimuli.rendering import Rendering, Tally
from haptix.lab.stimuli.set_plan import SetPlan
from haptix.model.perception.sensation import Loudest, SensationInTime

_ALPHA = 0.05
_KNOWN_WITHIN = 0.02  # half of a power's 95 % interval
_LEAST_ROUNDS, _MOST_ROUNDS = 8, 100
_QUICK, _FITTED = 1000, 50  # people of a round, with a run in each condition
_TESTED = 1000  # participants of the studies of a round that the model tests
_BEYOND_DB = 10.0  # the levels, that a threshold is looked for
_PEOPLE = 4000  # drawn for a share
_STUDIES = 2000  # drawn for a power, in each round
Whole = npt.NDArray[np.int64]
_CHANCE = 0.5  # of two alternatives
_UNKNOWN, _SURELY = 0.1, 0.9


@dataclass(frozen=True)
class Observer:
    """A simulated observer: parameters of the psychometric function."""

    threshold: float
    slope: float = 3.5
    lapse: float = 0.02
    guess: float = 0.5
    function: str = "weibull"

    def share(self, level: float) -> float:
        """Probability of a right answer."""
        shape = function_named(self.function)
        at = np.asarray(level)
        return float(shape(at, self.threshold, self.slope, self.guess, self.lapse))


def one_run(
    make: Callable[[], Method], observer: Observer, seed: int, ceiling: float | None = None
) -> tuple[Method, int]:
    """Run a method to its end with an observer; return it and the number of trials."""
    method, draw, trials = make(), np.random.default_rng(seed), 0
    while not method.is_done:
        level = method.level if ceiling is None else min(method.level, ceiling)
        method.update(bool(draw.random() < observer.share(level)), level)
        trials += 1
    return method, trials


def accuracy(
    make: Callable[[], Method],
    observer: Observer,
    runs: int,
    seed: int = 0,
    ceiling: float | None = None,
) -> dict[str, Any]:
    """Return a method's bias, scatter and coverage for an observer, over some runs.

    Bias, scatter and median width of the interval are of the runs that gave a threshold; `coverage`
    is the share of those whose 95 % interval holds the truth.
    """
    whole("runs", runs, 2)
    off, widths, trials, held, warned = [], [], [], 0, 0
    for k in range(runs):
        method, count = one_run(make, observer, seed + k, ceiling)
        estimate = method.estimate(reaction_s=())
        trials.append(count)
        warned += bool(estimate.warnings)
        if not isnan(estimate.threshold):
            off.append(estimate.threshold - observer.threshold)
            widths.append(estimate.width)
            held += estimate.low <= observer.threshold <= estimate.high
    known = len(off) > 1
    return {
        "threshold": observer.threshold,
        "slope": observer.slope,
        "lapse": observer.lapse,
        "trials": float(np.mean(trials)),
        "bias": float(np.mean(off)) if known else None,
        "scatter": float(np.std(off, ddof=1)) if known else None,
        "width": float(np.median(widths)) if known else None,
        "coverage": held / len(off) if known else None,
        "no_threshold": 1 - len(off) / runs,
        "warned": warned / runs,
    }


def paired_power(
    make: Callable[[], Method],
    observer: Observer,
    difference: float,
    between: float,
    participants: Sequence[int],
    runs: int,
    seed: int = 0,
    alpha: float = _ALPHA,
    ceiling: float | None = None,
) -> list[dict[str, Any]]:
    """Return the power of a comparison of two conditions within participants, for sample sizes.

    The test is that of `analyse`: the hierarchical model of both conditions, in which a threshold
    beyond the levels has its part. Whole studies are simulated, of people who are new in each
    round. Power is that of a t-test of quick estimates, plus how much more often the model of
    their quick likelihoods finds the difference, plus how much more often that of fitted ones
    does, which takes longest and differs least (levels of Giles, Oper. Res. 56, 607 (2008)).
    Rounds go on until all powers have 95 % intervals of 0.02 to either side, at most 100 of them.

    Parameters
    ----------
    make : callable
        Makes a method.
    observer : Observer
        The mean participant in the first condition.
    difference : float
        By how much the second condition's threshold is higher.
    between : float
        Standard deviation of thresholds between participants, in either condition independently
        by a third of it.
    participants : sequence of int
        Sample sizes.
    runs : int
        Simulated runs that are fitted, at least.
    seed : int
        Seed.
    alpha : float
        Two-sided level of the test.
    ceiling : float, optional
        Highest level that can be presented.
    """
    from scipy.stats import t as student

    number("difference", difference)
    number("between", between, 0.0)
    positive("alpha", alpha)
    for count in participants:
        whole("participants", count, 2)
    whole("runs", runs, 10)
    plan = _Comparison(make, observer, difference, between, alpha, ceiling)
    found: list[list[float]] = []
    beyond: list[float] = []
    half = np.full(len(participants), inf)
    least = max(_LEAST_ROUNDS, ceil(runs / (2 * _FITTED)))
    while len(found) < least or (half.max() > _KNOWN_WITHIN and len(found) < _MOST_ROUNDS):
        powers, without = plan.once([seed, len(found)], participants)
        found.append(powers)
        beyond.append(without)
        if len(found) > 1:
            error = np.std(found, axis=0, ddof=1) / np.sqrt(len(found))
            half = student.ppf(0.975, len(found) - 1) * error
    powers = np.mean(found, axis=0).tolist()
    return [
        {
            "participants": count,
            "difference": difference,
            "between": between,
            "slope": observer.slope,
            "lapse": observer.lapse,
            "power": min(max(power, 0.0), 1.0),
            "power_low": min(max(power - within, 0.0), 1.0),
            "power_high": min(max(power + within, 0.0), 1.0),
            "runs": 2 * len(found) * _FITTED,
            "beyond_levels": float(np.mean(beyond)),
        }
        for count, power, within in zip(participants, powers, half.tolist(), strict=True)
    ]


@dataclass(frozen=True)
class _Comparison:
    """Studies of two conditions within participants."""

    make: Callable[[], Method]
    observer: Observer
    difference: float
    between: float
    alpha: float
    ceiling: float | None

    def round_s(self, participants: Sequence[int]) -> float:
        """Seconds of a round on this machine, by the times of a few runs and tests."""
        began, few = perf_counter(), range(4)
        methods = [one_run(self.make, self.observer, seed, self.ceiling)[0] for seed in few]
        quick = [_quick_likelihood(method, self.observer) for method in methods]
        ran = perf_counter()
        for method in methods:
            method.estimate(reaction_s=())
        total = 2 * (_QUICK * (ran - began) + _FITTED * (perf_counter() - ran)) / len(few)
        for count in participants:
            began = perf_counter()
            self._by_model(quick * count, np.arange(count)[None])
            total += 3 * max(_TESTED // count, 2) * (perf_counter() - began)
        return total

    def once(self, seed: Sequence[int], participants: Sequence[int]) -> tuple[list[float], float]:
        """Power of each sample size by new people, and the share of runs without a threshold."""
        draw = np.random.default_rng(seed)
        people, fitted = _QUICK, max(_FITTED, max(participants))
        true = self.observer.threshold + self.between * draw.standard_normal((people, 1))
        true = true + self.difference * np.arange(2)
        true = true + self.between / 3 * draw.standard_normal((people, 2))
        methods = [
            one_run(self.make, replace(self.observer, threshold=threshold), own, self.ceiling)[0]
            for threshold, own in zip(
                true.ravel().tolist(), draw.integers(2**62, size=2 * people).tolist(), strict=True
            )
        ]
        quick = [_quick_likelihood(method, self.observer) for method in methods]
        means = np.reshape([_mean_of(*one) for one in quick], (-1, 2))
        estimates = [method.estimate(reaction_s=()) for method in methods[: 2 * fitted]]
        likelihoods = [one.likelihood for one in estimates if one.likelihood is not None]
        if len(likelihoods) < len(estimates):
            raise InputError(
                "simulate: a run has too few answers for a threshold; plan more trials"
            )
        powers = []
        for count in participants:
            power = self._by_t(means[_studies(draw, _STUDIES, people, count)]).mean()
            few = max(_TESTED // count, 2)
            studies = _studies(draw, few, people, count)
            power += (self._by_model(quick, studies) - self._by_t(means[studies])).mean()
            studies = _studies(draw, few, fitted, count)
            more = self._by_model(likelihoods, studies) - self._by_model(quick, studies)
            powers.append(float(power + more.mean()))
        return powers, float(np.mean([isnan(one.threshold) for one in estimates]))

    def _by_t(self, thresholds: Array) -> Array:
        """Whether a t-test finds a difference, shape (studies,)."""
        from scipy.stats import t as student

        count = thresholds.shape[1]
        apart = np.diff(thresholds)[..., 0]
        t = apart.mean(1) / np.maximum(apart.std(1, ddof=1) / np.sqrt(count), 1e-12)
        return np.asarray(np.abs(t) > student.ppf(1 - self.alpha / 2, count - 1), dtype=float)

    def _by_model(self, likelihoods: Sequence[tuple[Array, Array]], studies: Whole) -> Array:
        """Whether the model of the analysis finds a difference, shape (studies,)."""
        count = studies.shape[1]
        who, condition = [str(k // 2) for k in range(2 * count)], [0, 1] * count
        found = np.zeros(len(studies))
        for study, members in enumerate(studies):
            felt = [likelihoods[2 * member + k] for member in members.tolist() for k in (0, 1)]
            tested = group_of_likelihoods(felt, who, condition)
            found[study] = tested.p(np.array([-1.0, 1.0])) < self.alpha
        return found


def _studies(draw: np.random.Generator, studies: int, people: int, count: int) -> Whole:
    """Participants of studies, each at most once in one; shape (studies, participants)."""
    return np.array(
        [draw.choice(people, count, replace=False, shuffle=False) for _ in range(studies)]
    )


_WIDTHS = np.exp(np.linspace(-1.8, 1.8, 7))
_LAPSES = np.array([0.002, 0.03, 0.06, 0.12, 0.2])
# About those of `fit`; each lapse rate stands for those around it.
_PRIOR = np.exp(-0.5 * (np.log(_WIDTHS) / 0.85) ** 2)[:, None] * np.array(
    [0.5, 0.3, 0.2, 0.07, 0.06]
)


def _quick_likelihood(method: Method, observer: Observer) -> tuple[Array, Array]:
    """Logarithm of the likelihood of thresholds, as that of `fit`, by a coarse grid."""
    levels, right, wrong = counted(method.answers)  # type: ignore[attr-defined]  # of thresholds
    grid = np.linspace(levels[0] - _BEYOND_DB, levels[-1] + _BEYOND_DB, 61)
    at, slope = grid[:, None, None, None], 3.5 / _WIDTHS[:, None, None]
    shape = function_named(observer.function)
    p = shape(levels, at, slope, observer.guess, _LAPSES[:, None]).clip(1e-9, 1 - 1e-9)
    logs = np.log(p) @ right + np.log1p(-p) @ wrong
    weight = (np.exp(logs - logs.max()) * _PRIOR).sum((1, 2))
    return grid, np.log(np.maximum(weight / weight.max(), 1e-300))


def _mean_of(levels: Array, logs: Array) -> float:
    weight = np.exp(logs - logs.max())
    return float(weight @ levels / weight.sum())


_ALWAYS_GUESSED = 0.05  # share of answers that find a target where the task has no chance level


class SimulateObserver(Task):
    """Runs of one simulated observer: precision of its thresholds, or power of a comparison.

    The `experiment` is one of `ExperimentRecipe` without its conditions, and the `comparison` the
    `difference`, `between` and sample sizes `participants` of `paired_power`.
    """

    experiment: dict[str, Any]
    observer: Observer
    runs: int
    comparison: dict[str, Any] | None = None

    def rows(self) -> list[dict[str, Any]]:
        """Return the row of `accuracy`, or those of `paired_power`."""
        recipe = ExperimentRecipe(**self.experiment)
        how = recipe.make_method, self.observer
        if self.comparison is None:
            return [accuracy(*how, self.runs, recipe.seed)]
        return paired_power(*how, **self.comparison, runs=self.runs, seed=recipe.seed)

    def expected_s(self) -> float:
        """Seconds that a comparison takes on this machine, at the least."""
        recipe, of = ExperimentRecipe(**self.experiment), self.comparison or {}
        plan = _Comparison(
            recipe.make_method, self.observer, of["difference"], of["between"], _ALPHA, None
        )
        return plan.round_s(of["participants"]) * max(_LEAST_ROUNDS, self.runs / (2 * _FITTED))

    def run(self, context: Context) -> Result:
        """Simulate."""
        rows = record(self.rows())
        table = csv_text(rows[0], (row.values() for row in rows))
        return Result(rows, files={"simulation.csv": table})


def simulations(
    recipe: ExperimentRecipe,
    threshold_db: Sequence[float],
    slope: Sequence[float],
    lapse: Sequence[float],
    runs: int,
    comparison: Mapping[str, Any] | None = None,
) -> Iterator[SimulateObserver]:
    """Yield the task of each observer: every combination of the values.

    Raises `InputError` if the task measures no threshold.

    Parameters
    ----------
    recipe : ExperimentRecipe
        The experiment; its conditions are left out.
    threshold_db, slope, lapse : sequence of float
        Of the observers.
    runs : int
        Runs of each observer, or simulated participants.
    comparison : mapping, optional
        Where the power is asked for, see `SimulateObserver`.
    """
    if recipe.task in ("pairs", "triads", "sorting", "magnitude"):
        raise InputError(f"simulate: the task {recipe.task!r} measures no threshold")
    recipe.model_copy(update={"conditions": ()}).make_method()  # a wrong one is refused here
    plain = recipe.model_dump(
        mode="json", include={"name", "stimulus", "pedestal", "method", "task", "seed"},
        exclude_none=True,
    )  # fmt: skip
    guess = TASKS[recipe.task].guess or _ALWAYS_GUESSED
    for observer in product(threshold_db, slope, lapse, [guess]):
        yield SimulateObserver(
            experiment=plain,
            observer=Observer(*observer),
            runs=whole("runs", runs, 10),
            comparison=comparison,
        )


@dataclass(frozen=True)
class People:
    """Observers whose thresholds scatter around the published ones."""

    between_db: float = 3.0
    """Standard deviation of thresholds between people [dB]."""
    slope: Sequence[float] = (1.5, 3.5)
    lapse: Sequence[float] = (0.02, 0.08)
    """Slopes and lapse rates, all of them equally often."""
    seed: int = 0
    """Seed of the random draws."""

    def shares(self, level_db: float) -> Array:
        """Share of presentations that each of some people detects, shape (people,)."""
        number("between_db", self.between_db, 0.0)
        draw = np.random.default_rng(self.seed)
        threshold = self.between_db * draw.standard_normal(_PEOPLE)
        slope, lapse = draw.choice(self.slope, _PEOPLE), draw.choice(self.lapse, _PEOPLE)
        weibull = function_named("weibull")
        return np.asarray(weibull(np.full(_PEOPLE, level_db), threshold, slope, 0.0, lapse))

    def power(self, level_db: float, participants: int, repeats: int, alpha: float = 0.05) -> float:
        """Probability that a study shows that people do not guess between two alternatives.

        Each of the participants answers `repeats` times; a one-sided t-test compares their shares
        of right answers with one half.
        """
        from scipy.stats import t as student

        whole("participants", participants, 2)
        draw = np.random.default_rng([self.seed, participants])
        people = draw.choice(self.shares(level_db), (_STUDIES, participants))
        right = draw.binomial(repeats, _CHANCE + (1 - _CHANCE) * people) / repeats
        error = right.std(1, ddof=1) / np.sqrt(participants)
        t = (right.mean(1) - _CHANCE) / np.maximum(error, 1e-12)
        return float(np.mean(t > student.ppf(1 - alpha, participants - 1)))


def levels(
    plan: SetPlan, on_progress: Callable[[float], None] = lambda share: None
) -> Iterator[tuple[str, Loudest, bool]]:
    """Yield each file of a set: name, levels, and whether all its friction is reachable."""
    total, done = len(plan.stimuli) * len(plan.screens), 0
    for screen in plan.screens:
        apparatus = plan.apparatus(screen)
        for stimulus in plan.stimuli:
            response, _ = apparatus.responses(stimulus)
            skin, rate = apparatus.skin(stimulus), plan.sample_rate_hz
            rendering = Rendering(stimulus, response, rate, skin)
            tally = Tally(SensationInTime(plan.perception, rate, skin))
            for block in rendering.stream():
                tally.take(block, response)
            done += 1
            on_progress(done / total)
            name = stimulus.name + plan.suffix(screen)
            yield name, tally.sensation.finish(), tally.is_reached


def predictions(
    plan: SetPlan,
    people: People,
    participants: Sequence[int] = (),
    on_progress: Callable[[float], None] = lambda share: None,
) -> Iterator[dict[str, Any]]:
    """Yield a row for each stimulus of a set: its level, who detects it, and the power of a study.

    `detected` is the mean share of detections over people, `low` and `high` hold 95 % of people.
    They are None where no threshold is published of anything in the stimulus, or of more than a
    tenth of its energy, unless nearly everybody detects the rest.
    """
    for name, loudest, is_reached in levels(plan, on_progress):
        known = [level for level in (loudest.sensation_db, loudest.edges_db) if level is not None]
        level_db = max(known, default=-inf)
        row: dict[str, Any] = {
            "stimulus": name,
            "steady_db": loudest.sensation_db,
            "edges_db": loudest.edges_db,
            "unknown_share": loudest.outside_share,
            "is_reached": is_reached,
            "detected": None,
            "low": None,
            "high": None,
        }
        shares = people.shares(level_db) if known else np.zeros(1)
        is_known = known and (loudest.outside_share <= _UNKNOWN or shares.mean() > _SURELY)
        if is_known:
            low, high = np.percentile(shares, (2.5, 97.5)).tolist()
            row |= {"detected": float(shares.mean()), "low": low, "high": high}
        for count in participants:
            power = people.power(level_db, count, plan.trials.repeats) if is_known else None
            row[f"power_{count}"] = power
        yield row
