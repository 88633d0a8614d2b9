"""What a plan is worth before its first session, by simulation.

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
from math import ceil, hypot, inf, isnan
from statistics import NormalDist
from typing import Any

import numpy as np

from haptix.base.checks import Array, number, positive, whole
from haptix.base.errors import InputError
from haptix.base.files import csv_text
from haptix.base.report import record
from haptix.base.task import Context, Result, Task
from haptix.lab.experiment.methods import Method
from haptix.lab.experiment.psychometric import function_named, group_of_likelihoods
from haptix.lab.experiment.recipe import ExperimentRecipe
from haptix.lab.experiment.session_plan import TASKS
from haptix.lab.stimuli.rendering import Rendering, Tally
from haptix.lab.stimuli.set_plan import SetPlan
from haptix.model.perception.sensation import Loudest, SensationInTime

_STUDIES_DRAWN, _STUDIES_TESTED = 10_000, 300  # by which a power is known within 0.02
_NEAR = 3  # simulated observers, on either side, one of whose runs a participant gets
_PEOPLE = 4000  # drawn for a share
_STUDIES = 2000  # drawn for a power
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
    alpha: float = 0.05,
    ceiling: float | None = None,
) -> Iterator[dict[str, Any]]:
    """Yield the power of a comparison of two conditions within participants, for each sample size.

    The test is that of `analyse`: the hierarchical model of both conditions, in which a threshold
    beyond the levels has its part. `runs` observers are simulated, whose thresholds lie at even
    quantiles of the population. In each of many studies, participants are drawn from the
    population anew, each with the run of an observer whose threshold is next to his.

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
    runs, seed : int
        Simulated observers, and seed.
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
    own = between / 3
    at = NormalDist(observer.threshold, max(hypot(between, own), 1e-9))
    quantiles = [(k + 0.5) / ceil(runs / 2) for k in range(ceil(runs / 2))]
    low = [at.inv_cdf(share) for share in quantiles]
    truths = np.sort(np.array([*low, *(threshold + difference for threshold in low)]))[:runs]
    found = []
    for k, truth in enumerate(truths):
        method, _ = one_run(make, replace(observer, threshold=float(truth)), seed + k, ceiling)
        found.append(method.estimate(reaction_s=()))
    likelihoods = [one.likelihood for one in found if one.likelihood is not None]
    if len(likelihoods) < len(found):
        raise InputError("simulate: a run has too few answers for a threshold; plan more trials")
    likelihood_means = np.array([_mean_of(*one) for one in likelihoods])
    for count in participants:
        draw = np.random.default_rng([seed, runs, count])
        size = (_STUDIES_DRAWN, count, 2)
        true = observer.threshold + between * draw.standard_normal((_STUDIES_DRAWN, count, 1))
        true = true + difference * np.arange(2) + own * draw.standard_normal(size)
        near = np.searchsorted(truths, true) + draw.integers(-_NEAR, _NEAR, size)
        run = np.clip(near, 0, len(truths) - 1)
        moved = true - truths[run]
        # A t-test of all studies; in some, how much more often the analysis' test finds it.
        apart = np.diff(likelihood_means[run] + moved)[..., 0]
        t = apart.mean(1) / np.maximum(apart.std(1, ddof=1) / np.sqrt(count), 1e-12)
        by_t = np.abs(t) > student.ppf(1 - alpha / 2, count - 1)
        who, condition = [str(k // 2) for k in range(2 * count)], [0, 1] * count
        more = 0.0
        for study in range(_STUDIES_TESTED):
            members = zip(run[study].ravel(), moved[study].ravel(), strict=True)
            felt = [(likelihoods[k][0] + shift, likelihoods[k][1]) for k, shift in members]
            tested = group_of_likelihoods(felt, who, condition)
            more += float(tested.p(np.array([-1.0, 1.0])) < alpha) - float(by_t[study])
        shown = float(by_t.mean()) + more / _STUDIES_TESTED
        yield {
            "participants": count,
            "difference": difference,
            "between": between,
            "slope": observer.slope,
            "lapse": observer.lapse,
            "power": min(max(shown, 0.0), 1.0),
            "beyond_levels": float(np.mean([isnan(one.threshold) for one in found])),
        }


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
        return [*paired_power(*how, **self.comparison, runs=self.runs, seed=recipe.seed)]

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
    if recipe.task in ("pairs", "magnitude"):
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
