"""Tables of some sessions: what each participant's answers say, and all of them together."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import isnan
from pathlib import Path
from typing import Any

from haptix.stimuli.adaptive import Magnitudes, Pairs
from haptix.stimuli.analysis.over_participants import differences, exponents_of_all, means
from haptix.stimuli.analysis.runs import RunOfMethod, runs_of
from haptix.stimuli.analysis.scales import magnitude_rows, scale_rows
from haptix.stimuli.analysis.session_files import read_sessions

Row = dict[str, Any]


@dataclass(frozen=True)
class Analysis:
    """What some sessions say.

    Parameters
    ----------
    tables : dict of str to list of dict
        "thresholds", "scales", "magnitudes" and "exponents" of each participant, as the tasks have
        them; "group" and "exponents-group" over participants; "differences" of conditions within
        participants.
    notes : tuple of str
        What was mixed or is missing.
    runs : tuple of RunOfMethod
        What the tables are made of, for pictures.
    """

    tables: dict[str, list[Row]]
    notes: tuple[str, ...]
    runs: tuple[RunOfMethod, ...]


def analyse(source: str | Path) -> Analysis:
    """Analyse a log, a folder of logs, or a study in the form of BIDS.

    Thresholds are those of the method that chose the levels, as the experiment stated them: none
    where the answers are as one who guesses gives them. Sessions that their plan excludes are in
    the tables and not in the means.

    Raises
    ------
    FileFormatError
        If a file is no log, or was changed.
    InputError
        If there is none.
    """
    runs = [run for session in read_sessions(source) for run in runs_of(session)]
    by_task: dict[str, list[RunOfMethod]] = {}
    for run in runs:
        kind = run.session.settings["task"]
        by_task.setdefault(kind if kind in ("pairs", "magnitude") else "thresholds", []).append(run)
    tables: dict[str, list[Row]] = {}
    if with_threshold := by_task.get("thresholds"):
        rows = _filled(map(_threshold_row, with_threshold))
        tables["thresholds"] = rows
        tables["group"] = means(rows, "threshold_db", "spread_db")
        tables["differences"] = differences(rows)
    if pairs := by_task.get("pairs"):
        tables["scales"] = scale_rows(pairs)
    if numbers := by_task.get("magnitude"):
        tables["magnitudes"] = magnitude_rows(numbers)
        tables["exponents"] = _filled(map(_exponent_row, numbers))
        tables["exponents-group"] = exponents_of_all(tables["exponents"])
    return Analysis({name: rows for name, rows in tables.items() if rows}, _notes(runs), (*runs,))


def _threshold_row(run: RunOfMethod) -> Row:
    found = run.found
    others = {name: value for name, value in found.others.items() if name != "guess"}
    return {
        **run.place,
        "trials": len(run.rows),
        "threshold_db": _known(found.threshold),
        "spread_db": _known(found.spread),
        **{name: _known(value) for name, value in others.items()},
        **run.summary,
        "warnings": "; ".join(found.warnings),
    }


def _exponent_row(run: RunOfMethod) -> Row:
    assert isinstance(run.method, Magnitudes)
    others = run.found.others
    values = {name: _known(others.get(name)) for name in ("exponent", "exponent_spread")}
    warnings = {"warnings": "; ".join(run.found.warnings)}
    return {**run.place, "trials": len(run.rows), **values, **run.summary, **warnings}


def _filled(rows: Iterable[Row]) -> list[Row]:
    """Give all rows the same columns, those that say why last."""
    listed = list(rows)
    names = dict.fromkeys(name for row in listed for name in row)
    last = [name for name in ("excluded", "warnings") if name in names]
    order = [*(name for name in names if name not in last), *last]
    return [{name: row.get(name) for name in order} for row in listed]


def _notes(runs: Sequence[RunOfMethod]) -> tuple[str, ...]:
    notes = []
    asked: dict[tuple[str, str], Counter[str]] = {}
    for run in runs:
        asked.setdefault((run.session.task, run.condition), Counter())[run.experiment] += 1
    for (task, condition), counts in asked.items():
        if len(counts) > 1:
            what = " ".join(filter(None, (task, condition))) or "the logs"
            parts = ", ".join(f"{count} of {name}" for name, count in counts.items())
            notes.append(
                f"{what}: the sessions are of different experiments, whose means stay apart: "
                f"{parts}"
            )
    without = [run for run in runs if isnan(run.found.threshold) and _has_threshold(run)]
    if without:
        notes.append(f"{len(without)} of {len(runs)} runs have no threshold; their rows say why")
    excluded = dict.fromkeys(run.session.name for run in runs if "excluded" in run.summary)
    if excluded:
        notes.append(f"excluded by the rules of their plan: {', '.join(excluded)}")
    return tuple(notes)


def _has_threshold(run: RunOfMethod) -> bool:
    return not isinstance(run.method, Pairs | Magnitudes)


def _known(value: float | None) -> float | None:
    return None if value is None or isnan(value) else value
