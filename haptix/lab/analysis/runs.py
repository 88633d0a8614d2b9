"""Runs: the answers of a session in one condition, by replaying them to its method."""

from __future__ import annotations

from collections.abc import Callable, Collection, Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf, isnan
from typing import Any, TypeVar

from haptix.base.files import digest, reading
from haptix.lab.experiment import Estimate, Method, MethodsByCondition
from haptix.lab.experiment.methods import DRAWN
from haptix.lab.experiment.session_plan import (
    SessionPlan,
    accepted,
    estimate_of,
    replayed,
    summary,
)
from haptix.lab.experiment.trial_log import LoggedSession

ALL = "all"
"""Participant of the rows that are over all of them."""
LEAST_PARTICIPANTS = 2
OF_GROUP = ("task", "condition", "experiment")
"""Columns by which runs belong together."""

_OF_APPARATUS = ("finger", "screen", "recipe", "drive")  # the drive is that of the first level
_INTERVAL = 0.95

Row = dict[str, Any]
Item = TypeVar("Item")
Key = TypeVar("Key", bound=Hashable)


def grouped(items: Iterable[Item], key: Callable[[Item], Key]) -> dict[Key, list[Item]]:
    """Items by their key, in the order in which they come."""
    groups: dict[Key, list[Item]] = {}
    for item in items:
        groups.setdefault(key(item), []).append(item)
    return groups


def condition_of(row: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the columns by which rows belong together."""
    return tuple(row[name] for name in OF_GROUP)


def words(*parts: str) -> str:
    """Join words that are not empty."""
    return " ".join(filter(None, parts))


@dataclass(frozen=True)
class RunOfMethod:
    """The answers of a session in one condition, and the estimate of its method."""

    session: LoggedSession
    condition: str
    """Name of the condition; empty if there is only one."""
    experiment: str
    """Hash of task, stimulus and method, without finger, screen and order."""
    method: Method
    estimate: Estimate
    rows: tuple[Mapping[str, str], ...]
    """Trials that count for the method."""
    summary: Mapping[str, Any]
    remarks: tuple[str, ...] = ()
    """Parts of the session's log that could not be checked."""

    @property
    def place(self) -> dict[str, Any]:
        """Columns that identify the run."""
        one = self.session
        place = {"participant": one.participant, "session": one.session, "task": one.task}
        place |= {"condition": self.condition, "experiment": self.experiment}
        return place | {"source": one.source}


def runs_of(session: LoggedSession) -> Iterator[RunOfMethod]:
    """Yield the runs of a session, by replaying its answers to its methods.

    Raises `FileFormatError` if a row does not belong to the experiment in the head of the log.
    """
    sequence, remarks = replayed(session)
    method = sequence.method
    with reading(session.path, "a log of trials"):
        task, plan = session.settings["task"], sequence.plan
        methods = method.methods if isinstance(method, MethodsByCondition) else {"": method}
        estimates = {
            name: estimate_of(part, session.rows, task, name) for name, part in methods.items()
        }
        unfinished = _unfinished(plan, methods.values(), estimates.values())
        first = (unfinished,) if unfinished and not session.finished else ()
        for name, part in methods.items():
            experiment = _hash(session, name, part.describe())
            mine = accepted(session.rows, name)
            rows = tuple(row for row in mine if row["kind"] == "trial")
            estimate = estimates[name]
            estimate = replace(estimate, warnings=(*first, *estimate.warnings))
            about = summary(session.rows, task, plan.exclude, name)
            yield RunOfMethod(session, name, experiment, part, estimate, rows, about, remarks)


def _unfinished(
    plan: SessionPlan, methods: Collection[Method], estimates: Iterable[Estimate]
) -> str:
    """Return a warning that a session is not finished, or ""; times in the plan are not checked."""
    stop, counted = plan.stop, sum(len(getattr(method, "answers", ())) for method in methods)
    is_done = all(method.is_done for method in methods)
    if is_done or counted >= (stop.most_trials or inf) or stop.most_minutes is not None:
        return ""
    if stop.spread is not None and all(part.width / 4 <= stop.spread for part in estimates):
        return ""
    return f"the session is not over: it has {counted} trials that count"


def _hash(session: LoggedSession, condition: str, method: Mapping[str, Any]) -> str:
    settings = session.settings
    hashes = settings.get("hashes", {})
    hashes = hashes.get(condition, hashes) if condition else hashes
    of_stimulus = {name: value for name, value in hashes.items() if name not in _OF_APPARATUS}
    shared = {name: value for name, value in method.items() if name not in DRAWN}
    experiment = {"task": settings["task"], "hashes": of_stimulus, "method": shared}
    if session.source == "simulated":  # simulated sessions are not pooled with those of people
        experiment["source"] = session.source
    return digest(experiment)[:8]


def holm(rows: Sequence[Row]) -> None:
    """Fill in `p_holm`, p for the number of rows (Holm, Scand. J. Stat. 6, 65 (1979))."""
    highest = 0.0
    for place, row in enumerate(sorted(rows, key=lambda row: row["p"])):
        highest = max(highest, min(1.0, row["p"] * (len(rows) - place)))
        row["p_holm"] = highest


def known(value: float | None) -> float | None:
    """Return a number that is one, or None."""
    return None if value is None or isnan(value) else value


def half_interval(spread: Any, free: int) -> Any:
    """Half of Student's interval of a value with a spread of so many degrees of freedom."""
    from scipy.stats import t as student

    return spread * student.ppf((1 + _INTERVAL) / 2, free)
