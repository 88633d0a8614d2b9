"""Scales of sessions without right answers: pairwise comparison, and magnitude estimation."""

from __future__ import annotations

from collections.abc import Sequence
from math import isnan
from typing import Any

import numpy as np

from haptix.checks import Array
from haptix.stimuli.adaptive import Magnitudes, Pairs
from haptix.stimuli.adaptive.scaling import bradley_terry
from haptix.stimuli.analysis.runs import RunOfMethod

Row = dict[str, Any]
ALL = "all"
"""Participant of the rows that are over all of them."""

_DRAWS = 200  # of participants with replacement: a spread is known to 5 %


def scale_rows(runs: Sequence[RunOfMethod]) -> list[Row]:
    """Return Bradley-Terry values [logit] of each level, for each participant and for all.

    Over all, comparisons are counted together; the spread is a bootstrap over participants, so that
    it holds for others than these. `fit_p` is small where no scale orders the levels.
    """
    rows = []
    for members in _groups(runs):
        wins = []
        for run in members:
            assert isinstance(run.method, Pairs)
            won = run.method.wins()
            rows += _scale(run, run.method.levels, won, bradley_terry(won))
            if "excluded" not in run.summary:
                wins.append(won)
        if len(wins) > 1:
            value, _, fit_p = bradley_terry(np.sum(wins, 0))
            draw, several = np.random.default_rng(len(wins)), np.array(wins)
            drawn = [
                bradley_terry(several[draw.integers(len(wins), size=len(wins))].sum(0))[0]
                for _ in range(_DRAWS)
            ]
            found = (value, np.std(drawn, axis=0, ddof=1), fit_p)
            first = members[0]
            assert isinstance(first.method, Pairs)
            rows += _scale(first, first.method.levels, several.sum(0), found, of_all=True)
    return rows


def _scale(
    run: RunOfMethod,
    levels: Sequence[float],
    wins: Array,
    found: tuple[Array, Array, float],
    of_all: bool = False,
) -> list[Row]:
    value, spread, fit_p = found
    return [
        {
            **run.place,
            **({"participant": ALL, "session": ""} if of_all else {}),
            "level_db": level,
            "comparisons": int(wins[k].sum() + wins[:, k].sum()),
            "scale_logit": float(value[k]),
            "spread_logit": float(spread[k]),
            "fit_p": None if isnan(fit_p) else fit_p,
        }
        for k, level in enumerate(levels)
    ]


def magnitude_rows(runs: Sequence[RunOfMethod]) -> list[Row]:
    """Return geometric means of the numbers for each level, of each participant and of all.

    People choose scales of their own: over all, each one's numbers are divided by their geometric
    mean and multiplied by that of everybody (modulus equalization; Lane, Catania & Stevens, J.
    Acoust. Soc. Am. 33, 160 (1961)). The spread is a factor: of one's numbers, or over all of their
    participants' means.
    """
    rows = []
    for members in _groups(runs):
        logs: list[dict[float, float]] = []
        for run in members:
            assert isinstance(run.method, Magnitudes)
            levels, numbers = np.array(run.method.answers).reshape(-1, 2).T
            own = {}
            for level in np.unique(levels).tolist():
                given = np.log(numbers[levels == level])
                own[level] = float(given.mean())
                rows.append(_magnitude(run.place, level, given))
            if own and "excluded" not in run.summary:
                logs.append(own)
        if len(logs) > 1:
            shared = sorted(set.intersection(*map(set, logs)))
            table = np.array([[one[level] for level in shared] for one in logs])
            table += table.mean() - table.mean(1, keepdims=True)
            place = {**members[0].place, "participant": ALL, "session": ""}
            rows += [_magnitude(place, at, table[:, k]) for k, at in enumerate(shared)]
    return rows


def _magnitude(place: Row, level: float, logs: Array) -> Row:
    spread = float(np.exp(logs.std(ddof=1))) if len(logs) > 1 else None
    mean = float(np.exp(logs.mean()))
    return {**place, "level_db": level, "answers": len(logs), "mean": mean, "spread": spread}


def _groups(runs: Sequence[RunOfMethod]) -> list[list[RunOfMethod]]:
    groups: dict[tuple[str, ...], list[RunOfMethod]] = {}
    for run in runs:
        key = (run.session.task, run.condition, run.experiment)
        groups.setdefault(key, []).append(run)
    return [*groups.values()]
