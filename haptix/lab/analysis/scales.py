"""Scales, tables of differences and maps of levels or items that people have compared."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import chain, combinations
from math import isnan
from typing import Any

import numpy as np

from haptix.base.checks import Array
from haptix.base.errors import from_extra
from haptix.lab.analysis.runs import (
    ALL,
    LEAST_PARTICIPANTS,
    Row,
    RunOfMethod,
    condition_of,
    grouped,
    half_interval,
    holm,
    known,
)
from haptix.lab.experiment import Magnitudes, Pairs
from haptix.lab.experiment.comparisons import (
    Comparison,
    Similarities,
    bradley_terry,
    bradley_terry_errors,
    bradley_terry_intervals,
)

_DRAWS = 200  # of participants with replacement: a spread is known to 5 %
_SHUFFLES = 20
_LEAST_FREE = 8  # degrees of freedom of a participant, for an effect of force or speed
_STILL = 1e-6  # logarithm of a force or speed that does not vary


def _label(method: Any, level: float, other: float | None = None) -> Row:
    """Columns that name an item, or a level; and another one."""
    assert isinstance(method, Comparison)
    names = ("item", "other") if method.items else ("level_db", "other_db")
    labels = [method.label(one) for one in (level, other) if one is not None]
    return dict(zip(names, labels, strict=False))


def _overall(run: RunOfMethod) -> Row:
    return {**run.place, "participant": ALL, "session": ""}


def scale_rows(runs: Sequence[RunOfMethod]) -> list[Row]:
    """Return Bradley-Terry values [logit] of each level, for each participant and for all.

    For all together, comparisons are pooled; the spread is a bootstrap over participants, so that
    it holds for the population. `fit_p` is small where no scale orders the levels. The intervals
    of 95 % are those of `bradley_terry_intervals`; over all, Student's of the spread.
    """
    rows = []
    for members in grouped(runs, lambda run: condition_of(run.place)).values():
        for run in members:
            assert isinstance(run.method, Pairs)
            won = run.method.wins()
            rows += _scale(run, won, bradley_terry(won))
        rows += scale_over_all(members)
    return rows


def _wins(runs: Sequence[RunOfMethod]) -> dict[str, Array]:
    """Return the wins of each participant that is not excluded."""
    wins: dict[str, Array] = {}
    for run in runs:
        if isinstance(run.method, Pairs) and "excluded" not in run.summary:
            who = run.session.participant
            wins[who] = wins.get(who, 0) + run.method.wins()
    return wins


def _drawn(several: Array) -> Array:
    """Return values of draws of the participants with replacement, shape (draws, levels)."""
    draw = np.random.default_rng(len(several))
    of_draws = draw.integers(len(several), size=(_DRAWS, len(several)))
    return np.array([bradley_terry(several[people].sum(0))[0] for people in of_draws])


def scale_over_all(runs: Sequence[RunOfMethod]) -> list[Row]:
    """Return the values that the participants of a condition have together, see `scale_rows`."""
    wins = _wins(runs)
    if len(wins) < LEAST_PARTICIPANTS:
        return []
    several = np.array([*wins.values()])
    value, _, fit_p = bradley_terry(several.sum(0))
    fitted = (value, np.std(_drawn(several), axis=0, ddof=1), fit_p)
    return _scale(runs[0], several.sum(0), fitted, len(wins))


def _scale(
    run: RunOfMethod, wins: Array, fitted: tuple[Array, Array, float], participants: int = 0
) -> list[Row]:
    assert isinstance(run.method, Pairs)
    value, spread, fit_p = fitted
    if participants:
        half = half_interval(spread, participants - 1)
        low, high = value - half, value + half
    else:
        low, high = bradley_terry_intervals(wins).T
    return [
        {
            **(_overall(run) if participants else run.place),
            **_label(run.method, level),
            "comparisons": int(wins[k].sum() + wins[:, k].sum()),
            "scale_logit": float(value[k]),
            "low_logit": known(float(low[k])),
            "high_logit": known(float(high[k])),
            "spread_logit": known(float(spread[k])),
            "fit_p": None if isnan(fit_p) else fit_p,
        }
        for k, level in enumerate(run.method.levels)
    ]


def scale_differences(runs: Sequence[RunOfMethod]) -> list[Row]:
    """Return the differences of all values of a condition, that of the item minus the other's.

    Over participants the errors are those of the bootstrap of `scale_rows`, with Student's
    distribution; of one participant those of the likelihood's curvature. `p_holm` is p corrected
    for the number of differences of the condition.
    """
    rows = []
    for members in grouped(runs, lambda run: condition_of(run.place)).values():
        if not (wins := _wins(members)):
            continue
        several = np.array([*wins.values()])
        value, _, _ = bradley_terry(several.sum(0))
        errors = bradley_terry_errors(several.sum(0)) if len(wins) < LEAST_PARTICIPANTS else None
        if errors is None:
            errors = np.cov(_drawn(several).T)
        rows += _differences(members[0], value, errors, len(wins), "difference_logit")
    return rows


def _differences(
    run: RunOfMethod, value: Array, errors: Array, participants: int, column: str
) -> list[Row]:
    from scipy.stats import norm
    from scipy.stats import t as student

    assert isinstance(run.method, Comparison)
    distribution = student(participants - 1) if participants > 1 else norm
    place = _overall(run) if participants > 1 else run.place
    rows: list[Row] = []
    for (i, level), (k, other) in combinations(enumerate(run.method.levels), 2):
        apart = float(value[i] - value[k])
        error = float(np.sqrt(max(errors[i, i] + errors[k, k] - 2 * errors[i, k], 1e-24)))
        half = error * distribution.ppf(0.975)
        rows.append(
            {
                **place, **_label(run.method, level, other), "participants": participants,
                column: apart, "low": apart - half, "high": apart + half,
                "p": float(2 * distribution.sf(abs(apart) / error)), "p_holm": None,
            }
        )  # fmt: skip
    holm(rows)
    return rows


def pair_rows(runs: Sequence[RunOfMethod]) -> list[Row]:
    """Return, for each participant and pair of levels, how often the second one was more."""
    rows = []
    for run in runs:
        assert isinstance(run.method, Pairs)
        won = run.method.wins()
        for (i, level), (k, other) in combinations(enumerate(run.method.levels), 2):
            counts = {"comparisons": int(won[i, k] + won[k, i]), "other_is_more": int(won[k, i])}
            rows.append({**run.place, **_label(run.method, level, other), **counts})
    return rows


def magnitude_rows(runs: Sequence[RunOfMethod]) -> list[Row]:
    """Return geometric means of the numbers for each level, of each participant and of all.

    People choose their own scales. For all together, each one's numbers are divided by their
    geometric mean and multiplied by that of everybody (modulus equalization; Lane, Catania &
    Stevens, J. Acoust. Soc. Am. 33, 160 (1961)). The spread is a factor: that of one participant's
    numbers, or for all together that of the participants' means. The intervals of 95 % are
    Student's of the logarithms (Bland & Altman, BMJ 312, 1079 (1996)). One participant's logarithms
    are taken to scatter alike at all levels, since many repeat a round number at one of them. Over
    all, it is the scatter of the participants' means at the level, about everybody's mean of all.
    A participant's modulus is that of all conditions of a task, so that their levels compare too.
    """
    rows, of_tasks = [], dict[tuple[str, ...], dict[str, list[dict[float, float]]]]()
    for members in grouped(runs, lambda run: condition_of(run.place)).values():
        means: dict[str, list[dict[float, float]]] = {}
        for run in members:
            assert isinstance(run.method, Magnitudes)
            levels, numbers = np.array(run.method.answers).reshape(-1, 2).T
            logs = {at: np.log(numbers[levels == at]) for at in np.unique(levels).tolist()}
            free = len(numbers) - len(logs)
            scatter = np.sqrt(sum(log.var() * len(log) for log in logs.values()) / max(free, 1))
            rows += [
                _magnitude(run.place | _label(run.method, at), logs[at], scatter, free)
                for at in logs
            ]
            if logs and "excluded" not in run.summary:
                of_session = {at: float(log.mean()) for at, log in logs.items()}
                means.setdefault(run.session.participant, []).append(of_session)
        of_tasks[condition_of(members[0].place)] = means
    first = {condition_of(run.place): run for run in reversed(runs)}
    for places in grouped(of_tasks, lambda place: (place[0], frozenset(of_tasks[place]))).values():
        people = [*of_tasks[places[0]]]  # who made all of these conditions
        if len(people) < LEAST_PARTICIPANTS:
            continue
        items = [
            (place, at)
            for place in places
            for at in sorted(set.intersection(*map(set, chain(*of_tasks[place].values()))))
        ]
        table = np.array(
            [[np.mean([one[at] for one in of_tasks[place][who]]) for place, at in items]
             for who in people]
        )  # fmt: skip
        table += table.mean() - table.mean(1, keepdims=True)
        spread = table.std(0, ddof=1)
        rows += [
            _magnitude(
                _overall(first[place]) | _label(first[place].method, at),
                table[:, k], spread[k], len(people) - 1,
            )
            for k, (place, at) in enumerate(items)
        ]  # fmt: skip
    return rows


def magnitude_differences(runs: Sequence[RunOfMethod]) -> list[Row]:
    """Return the differences of the logarithms of all levels of a condition, over participants.

    Paired t-tests, with `p_holm` corrected for the number of differences: a person's own scale
    cancels. Participants who have numbers for all levels count.
    """
    rows = []
    for members in grouped(runs, lambda run: condition_of(run.place)).values():
        means: dict[str, list[Array]] = {}
        for run in members:
            assert isinstance(run.method, Magnitudes)
            levels, numbers = np.array(run.method.answers).reshape(-1, 2).T
            if "excluded" not in run.summary and set(run.method.levels) <= {*levels.tolist()}:
                of_levels = [np.log(numbers[levels == at]).mean() for at in run.method.levels]
                means.setdefault(run.session.participant, []).append(np.array(of_levels))
        table = np.array([np.mean(sessions, axis=0) for sessions in means.values()])
        if len(table) < LEAST_PARTICIPANTS:
            continue
        errors = np.cov(table.T) / len(table)
        rows += _differences(members[0], table.mean(0), errors, len(table), "difference_ln")
    return rows


def _magnitude(place: Row, logs: Array, scatter: float, free: int) -> Row:
    """Return a row; `scatter`, of one of the logarithms, has so many degrees of freedom."""
    spread = float(np.exp(logs.std(ddof=1))) if len(logs) > 1 else None
    half = half_interval(scatter / np.sqrt(len(logs)), free)
    values = {"mean": 0.0, "low": -half, "high": half}
    values = {name: known(float(np.exp(logs.mean() + off))) for name, off in values.items()}
    return {**place, "answers": len(logs), **values, "spread": spread}


def similarity_rows(runs: Sequence[RunOfMethod]) -> list[Row]:
    """Return the share of comparisons in which each two items were called alike.

    Of triads chance is a third. The intervals of 95 % are Wilson's (J. Am. Stat. Assoc. 22, 209
    (1927)); over all with the number of comparisons that would scatter as the participants' shares
    do, and Student's factor (Korn & Graubard, Surv. Methodol. 24, 193 (1998)). Where each
    participant compared two items once, the answers are independent draws, whose scatter follows
    from the share.
    """
    rows: list[Row] = []
    for members in grouped(runs, lambda run: condition_of(run.place)).values():
        of_people: dict[str, Array] = {}
        for run in members:
            assert isinstance(run.method, Similarities)
            counts = np.array(run.method.alike())
            rows += _similarities(run.place, run.method, counts[None])
            if "excluded" not in run.summary:
                who = run.session.participant
                of_people[who] = of_people.get(who, 0) + counts
        if len(of_people) >= LEAST_PARTICIPANTS:
            several = np.array([*of_people.values()])
            rows += _similarities(_overall(members[0]), members[0].method, several)
    return rows


def _similarities(place: Row, method: Any, counts: Array) -> Iterator[Row]:
    from scipy.stats import norm
    from scipy.stats import t as student

    for (i, level), (k, other) in combinations(enumerate(method.levels), 2):
        alike, together = counts[:, :, i, k].T
        alike, together = alike[together > 0], together[together > 0]
        row = {**place, **_label(method, level, other), "comparisons": int(together.sum())}
        row |= {"alike": int(alike.sum()), "share": None, "low": None, "high": None}
        people = len(together)
        if people and (people > 1 or len(counts) == 1):
            share, size = float((alike / together).mean()), float(together.sum())
            z = float(norm.ppf(0.975))
            if together.max() > 1 and people > 1:
                variance = float((alike / together).var(ddof=1)) / people
                if variance > 0:
                    size = share * (1 - share) / variance
                z = float(student.ppf(0.975, people - 1))
            middle = (share + z**2 / (2 * size)) / (1 + z**2 / size)
            half = z / (1 + z**2 / size) * (share * (1 - share) / size + (z / size / 2) ** 2) ** 0.5
            low, high = max(0.0, middle - half), min(1.0, middle + half)
            row |= {"share": share, "low": low, "high": high}
        yield row


def maps(runs: Sequence[RunOfMethod]) -> tuple[list[Row], list[Row]]:
    """Return the places of items on a map, and how well maps of some dimensions fit.

    Non-metric scaling (Kruskal, Psychometrika 29, 1 (1964)) of the shares in which two items were
    not called alike, of all participants together, by scikit-learn. The map has two dimensions, its
    principal axes. `stress` is Kruskal's stress-1, and `stress_by_chance` the mean of that of
    shuffled shares: a map whose stress is no lower shows nothing. There is none before each two
    items were compared.
    """
    places: list[Row] = []
    stresses: list[Row] = []
    for members in grouped(runs, lambda run: condition_of(run.place)).values():
        methods = [
            run.method
            for run in members
            if isinstance(run.method, Similarities) and "excluded" not in run.summary
        ]
        if not methods:
            continue
        alike, together = np.sum([method.alike() for method in methods], axis=0)
        upper = np.triu_indices(len(together), 1)
        if not together[upper].all():
            continue
        # Above 0, which the library takes for unknown.
        apart = (together - alike + 0.5) / (together + 1)
        np.fill_diagonal(apart, 0.0)
        draw, place = np.random.default_rng(len(apart)), _overall(members[0])
        for dimensions in range(1, min(4, len(apart) - 1)):
            at, stress = _map(apart, dimensions)
            by_chance = []
            for _ in range(_SHUFFLES):
                shuffled = np.zeros_like(apart)
                shuffled[upper] = draw.permutation(apart[upper])
                by_chance.append(_map(shuffled + shuffled.T, dimensions)[1])
            fit = {"dimensions": dimensions, "stress": stress}
            stresses.append({**place, **fit, "stress_by_chance": float(np.mean(by_chance))})
            if dimensions == 2:
                places += [
                    {**place, **_label(members[0].method, level), "x": float(x), "y": float(y)}
                    for level, (x, y) in zip(methods[0].levels, at, strict=True)
                ]
    return places, stresses


def _map(apart: Array, dimensions: int) -> tuple[Array, float]:
    with from_extra("stimuli"):
        from sklearn.manifold import MDS

    scaling = MDS(
        dimensions, metric_mds=False, metric="precomputed", normalized_stress=True,
        init="classical_mds", n_init=1, n_jobs=1,
    )  # fmt: skip
    at = scaling.fit_transform(apart)
    at = at - at.mean(0)
    _, _, axes = np.linalg.svd(at)
    at = at @ axes.T
    return at * np.where(at[np.abs(at).argmax(0), range(dimensions)] < 0, -1, 1), scaling.stress_


def trial_rows(runs: Sequence[RunOfMethod]) -> list[Row]:
    """Return each trial of comparisons with its force and speed, for models with covariates.

    `out_of_range` is the reason why a trial counts whose touch was out of its ranges.
    """
    rows = []
    for run in runs:
        assert isinstance(run.method, Comparison)
        for row in run.rows:
            others = [] if row["other_level"] == "n/a" else row["other_level"].split()
            names = [run.method.label(float(level)) for level in (row["level"], *others)]
            felt = {name: None if row[name] == "n/a" else float(row[name]) for name in _COVARIATES}
            rows.append(
                {
                    **run.place, "trial": int(row["trial"]), "first": names[0],
                    "second": names[1] if len(names) > 1 else None,
                    "third": names[2] if len(names) > 2 else None,
                    "answer": row["answer"], **felt,
                    "out_of_range": "" if row["why"] == "n/a" else row["why"],
                }
            )  # fmt: skip
    return rows


_COVARIATES = ("normal_force_n", "speed_mm_per_s", "reaction_s")


def covariate_rows(runs: Sequence[RunOfMethod]) -> list[Row]:
    """Return the effect of a trial's force and speed on numbers, at equal items.

    `exponent` is the slope of a number's logarithm on that of force or speed within the trials of
    an item, by least squares of both together, for each participant; over all their mean with
    Student's interval. Where it differs from 0, the items' values depend on how they were touched.
    """
    rows: list[Row] = []
    for members in grouped(runs, lambda run: condition_of(run.place)).values():
        slopes: dict[str, list[float]] = {}
        for run in members:
            x, free = _within_items(run)
            moving = [k for k in range(2) if x[:, k].std() > _STILL]
            free -= len(moving)
            if not moving or free < _LEAST_FREE:
                continue
            y, names, x = x[:, 2], [_COVARIATES[k] for k in moving], x[:, moving]
            fitted, rest, rank, _ = np.linalg.lstsq(x, y, rcond=None)
            if rank < len(names):
                continue
            errors = np.sqrt(np.diag(np.linalg.inv(x.T @ x)) * rest[0] / free)
            for name, slope, error in zip(names, fitted.tolist(), errors, strict=True):
                rows.append(_effect(run.place, name, slope, float(error), free))
                if "excluded" not in run.summary:
                    slopes.setdefault(name, []).append(slope)
        for name, several in slopes.items():
            if (people := len(several)) >= LEAST_PARTICIPANTS:
                error = float(np.std(several, ddof=1) / people**0.5)
                mean = float(np.mean(several))
                rows.append(_effect(_overall(members[0]), name, mean, error, people - 1))
    return rows


def _within_items(run: RunOfMethod) -> tuple[Array, int]:
    """Return logarithms of force, speed and number less their means of each item, and freedom.

    Trials without a reading count for none; force or speed that few trials have is 0 in all.
    """
    table = np.log(
        [[_number(row[name]) for name in (*_COVARIATES[:2], "answer")] for row in run.rows]
    ).reshape(-1, 3)
    levels = np.array([float(row["level"]) for row in run.rows])
    if len(table):
        table[:, np.isnan(table).mean(0) > 0.5] = 0.0
    kept = np.isfinite(table).all(1)
    table, levels = table[kept], levels[kept]
    for level in (items := np.unique(levels)):
        table[levels == level] -= table[levels == level].mean(0)
    return table, len(table) - len(items)


def _number(cell: str) -> float:
    return float("nan") if cell == "n/a" or not float(cell) > 0 else float(cell)


def _effect(place: Row, name: str, slope: float, error: float, free: int) -> Row:
    from scipy.stats import t as student

    half = float(half_interval(error, free))
    p = float(2 * student.sf(abs(slope) / max(error, 1e-12), free))
    interval = {"low": slope - half, "high": slope + half, "p": p}
    return {**place, "covariate": name, "exponent": slope, **interval}
