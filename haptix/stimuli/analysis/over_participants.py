"""Means over participants, and differences of conditions within them."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from math import sqrt
from typing import Any

import numpy as np

from haptix.checks import Array

Row = dict[str, Any]
_INTERVAL = 0.975
_GROUP = ("task", "condition", "experiment")


def means(rows: Sequence[Row], column: str, spread: str) -> list[Row]:
    """Return mean, spread between participants and 95 % interval of each condition.

    A participant's sessions are averaged first. Who has no value, or is excluded, is counted and
    not averaged. Intervals are Student's.

    Parameters
    ----------
    rows : sequence of dict
        A row for each participant, session and condition.
    column, spread : str
        What is averaged, and its own spread within a session.
    """
    found = []
    for group, members in _groups(rows).items():
        own = _by_participant(members, column)
        everybody = {row["participant"] for row in members}
        within = [row[spread] for row in members if row[spread] is not None and _counts(row)]
        found.append(
            {
                **dict(zip(_GROUP, group, strict=True)),
                "participants": len(own),
                "without": len(everybody) - len(own),
                **_mean(np.array([*own.values()]), column.removesuffix("_db")),
                "spread_within": float(np.sqrt(np.mean(np.square(within)))) if within else None,
            }
        )
    return found


def exponents_of_all(rows: Sequence[Row]) -> list[Row]:
    """Return the mean exponent of each condition."""
    return means(rows, "exponent", "exponent_spread")


def differences(rows: Sequence[Row]) -> list[Row]:
    """Return differences of two conditions within participants, with a paired t-test.

    `p_holm` is p corrected for the number of pairs of the task (Holm, Scand. J. Stat. 6, 65
    (1979)).
    """
    from scipy.stats import t as student

    by_task: dict[str, dict[tuple[Any, ...], dict[str, float]]] = {}
    for group, members in _groups(rows).items():
        by_task.setdefault(group[0], {})[group] = _by_participant(members, "threshold_db")
    found: list[Row] = []
    for task, conditions in by_task.items():
        of_task: list[Row] = []
        for (first, own), (second, others) in combinations(conditions.items(), 2):
            both = sorted(own.keys() & others.keys())
            apart = np.array([others[name] - own[name] for name in both])
            if first[1] == second[1] or len(both) < 2:
                continue
            error = float(apart.std(ddof=1)) / sqrt(len(both))
            p = float(2 * student.sf(abs(apart.mean()) / error, len(both) - 1)) if error else None
            of_task.append(
                {
                    "task": task,
                    "condition": second[1],
                    "minus": first[1],
                    "participants": len(both),
                    **_mean(apart, "difference"),
                    "p": p,
                    "p_holm": None,
                }
            )
        known = sorted((row for row in of_task if row["p"] is not None), key=lambda row: row["p"])
        highest = 0.0
        for place, row in enumerate(known):
            highest = max(highest, min(1.0, row["p"] * (len(known) - place)))
            row["p_holm"] = highest
        found += of_task
    return found


def _mean(values: Array, name: str) -> Row:
    from scipy.stats import t as student

    count = len(values)
    mean = float(values.mean()) if count else None
    row: Row = {f"{name}_db" if name != "exponent" else name: mean}
    if count < 2 or mean is None:
        return row | dict.fromkeys(("between", "error", "low", "high"))
    between = float(values.std(ddof=1))
    error = between / sqrt(count)
    half = float(student.ppf(_INTERVAL, count - 1)) * error
    return row | {"between": between, "error": error, "low": mean - half, "high": mean + half}


def _counts(row: Row) -> bool:
    return not row.get("excluded")


def _groups(rows: Sequence[Row]) -> dict[tuple[Any, ...], list[Row]]:
    groups: dict[tuple[Any, ...], list[Row]] = {}
    for row in rows:
        groups.setdefault(tuple(row[name] for name in _GROUP), []).append(row)
    return groups


def _by_participant(rows: Sequence[Row], column: str) -> dict[str, float]:
    own: dict[str, list[float]] = {}
    for row in rows:
        if row[column] is not None and _counts(row):
            own.setdefault(row["participant"], []).append(row[column])
    return {name: float(np.mean(values)) for name, values in own.items()}
