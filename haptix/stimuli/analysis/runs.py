"""The answers of a session in each of its conditions, and what its method states of them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, fields, replace
from math import inf
from typing import Any

from haptix.errors import FileFormatError
from haptix.files import reading
from haptix.stimuli.adaptive import METHODS, Estimate, Method
from haptix.stimuli.adaptive.session_plan import SessionPlan
from haptix.stimuli.adaptive.session_summary import found_by_chance, summary
from haptix.stimuli.analysis.session_files import LoggedSession
from haptix.surface.request import digest

_OWN = ("seed", "order")  # of a participant, in the description of a method
_OF_APPARATUS = ("finger", "screen", "recipe", "drive")  # the drive is that of the first level


@dataclass(frozen=True)
class RunOfMethod:
    """The answers of a session in one condition, and what its method states of them."""

    session: LoggedSession
    condition: str
    """Empty where there is one alone."""
    experiment: str
    """Hash of what was asked: task, stimulus and method, but not finger, screen and order."""
    method: Method
    found: Estimate
    rows: tuple[Mapping[str, str], ...]
    """Trials that the method has heard of."""
    summary: Mapping[str, Any]

    @property
    def place(self) -> dict[str, Any]:
        """Columns that say whose it is."""
        one = self.session
        place = {"participant": one.participant, "session": one.session, "task": one.task}
        return {**place, "condition": self.condition, "experiment": self.experiment}


def runs_of(session: LoggedSession) -> Iterator[RunOfMethod]:
    """Yield the runs of a session: its methods hear its answers again.

    Raises
    ------
    FileFormatError
        If a row is none of the experiment of its head.
    """
    with reading(session.path, "a log of trials"):
        described = session.settings["method"]
        tables = described["methods"] if described["method"] == "conditions" else {"": described}
        methods = {name: method_of(table) for name, table in tables.items()}
        own: dict[str, list[Mapping[str, str]]] = {name: [] for name in methods}
        for row in session.rows:
            if row["accepted"] != "true" or row["kind"] not in ("trial", "n/a"):
                continue
            condition = row["condition"].replace("n/a", "")
            if condition not in methods:
                raise FileFormatError(
                    f"{session.path}: trial {row['trial']} is of the condition {condition!r}, "
                    f"which its head does not have: expected one of {', '.join(methods)}"
                )
            is_number = row["is_right"] == "n/a"
            value = float(row["answer"]) if is_number else row["is_right"] == "true"
            methods[condition].update(value, float(row["level"]))
            own[condition].append(row)
        task, plan = session.settings["task"], SessionPlan(**session.settings.get("plan", {}))
        found = {
            name: found_by_chance(method.estimate(), session.rows, task, name)
            for name, method in methods.items()
        }
        if unfinished := _unfinished(plan, methods.values(), found.values()):
            found = {
                name: replace(one, warnings=(unfinished, *one.warnings))
                for name, one in found.items()
            }
        said = summary(session.rows, task, plan.exclude)
        for name, method in methods.items():
            asked = _hash(session.settings, name, tables[name])
            yield RunOfMethod(session, name, asked, method, found[name], (*own[name],), said)


def method_of(table: Mapping[str, Any]) -> Method:
    """Make a method anew from what `Method.describe` says of it."""
    kind = METHODS[table["method"]]
    names = [one.name for one in fields(kind) if one.init]
    # No limit is None there, and the default here.
    return kind(**{name: table[name] for name in names if table.get(name) is not None})


def _unfinished(plan: SessionPlan, methods: Iterable[Method], found: Iterable[Estimate]) -> str:
    """Say that a session is not over; a rule of time cannot be told from a log."""
    counted, stop = 0, plan.stop
    is_done = True
    for method in methods:
        counted += len(getattr(method, "answers", ()))
        is_done &= method.is_done
    if is_done or counted >= (stop.most_trials or inf) or stop.most_minutes is not None:
        return ""
    if stop.spread is not None and all(one.spread <= stop.spread for one in found):
        return ""
    return f"the session is not over: it has {counted} trials that count"


def _hash(settings: Mapping[str, Any], condition: str, method: Mapping[str, Any]) -> str:
    hashes = settings.get("hashes", {})
    hashes = hashes.get(condition, hashes) if condition else hashes
    of_stimulus = {name: one for name, one in hashes.items() if name not in _OF_APPARATUS}
    plain = {name: one for name, one in method.items() if name not in _OWN}
    return digest({"task": settings["task"], "hashes": of_stimulus, "method": plain})[:8]
