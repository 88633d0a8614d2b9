"""The plan of a session: task, order of conditions, practice, catch trials; and its trials in turn.

The sequence of trials is presented live, or replayed from its log.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from math import sqrt
from pathlib import Path
from statistics import NormalDist
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, PositiveFloat, PositiveInt

from haptix.base.checks import choice
from haptix.base.documents import Part
from haptix.base.errors import FileFormatError, InputError
from haptix.base.files import reading
from haptix.lab.experiment.methods import Method, MethodsByCondition
from haptix.lab.experiment.procedures import METHODS
from haptix.lab.experiment.psychometric import Estimate
from haptix.lab.experiment.trial_log import LoggedSession, cell, program


@dataclass(frozen=True)
class TrialTask:
    """The presentation and the question of a trial.

    Parameters
    ----------
    choices : tuple of str
        Keys of the answers; none where a number is the answer.
    intervals : int
        Presentations of a trial.
    guess : float
        Share right of one who guesses.
    detects : bool
        Trials without a target are among those with one, and the answers say which is which.
    in_one_stroke : bool
        Presentations follow each other without a pause.
    asks : str
        The question.
    is_ordered : bool
        The method decides the order of a trial's presentations.
    takes_whole_numbers : bool
        The number of an answer is a whole one.
    """

    choices: tuple[str, ...]
    intervals: int
    guess: float
    detects: bool = False
    in_one_stroke: bool = False
    asks: str = "Which one?"
    is_ordered: bool = False
    takes_whole_numbers: bool = False

    def arrange(self, draw: np.random.Generator, is_empty: bool) -> tuple[tuple[bool, ...], str]:
        """Draw which intervals have the target, and which answer is right.

        Parameters
        ----------
        draw : numpy.random.Generator
            Source of the numbers.
        is_empty : bool
            Whether no interval has the target, in tasks that detect one.
        """
        if self.is_ordered and not is_empty:
            return (True,) * self.intervals, self.choices[0] if self.guess else ""
        place = int(draw.integers(max(2, self.intervals)))
        has_target = tuple(k == place or self.intervals == 1 for k in range(self.intervals))
        if not self.detects:
            return has_target, self.choices[place] if self.choices else ""
        if is_empty:
            return (False,) * self.intervals, self.choices[1]
        return has_target, self.choices[0]


TASKS = {
    "2ifc": TrialTask(("1", "2"), 2, 0.5),
    "2afc": TrialTask(("l", "r"), 2, 0.5, in_one_stroke=True),
    "3afc": TrialTask(("1", "2", "3"), 3, 1 / 3),
    "yes-no": TrialTask(("y", "n"), 1, 0.0, detects=True, asks="Was it there?"),
    "same-different": TrialTask(("d", "s"), 2, 0.0, detects=True, asks="Were they different?"),
    "pairs": TrialTask(("1", "2"), 2, 0.5, asks="Which one is more?", is_ordered=True),
    "triads": TrialTask(
        ("1", "2", "3"), 3, 0.0, asks="Which one is least like the other two?", is_ordered=True
    ),
    "magnitude": TrialTask((), 1, 0.0, asks="How strong was it? Give a number above 0."),
    "sorting": TrialTask(
        (), 1, 0.0, takes_whole_numbers=True,
        asks="Which group is it in? Give a whole number from 1; a new number makes a new group.",
    ),
}  # fmt: skip
"""By name: the target in one of two or three intervals, or on one side of a stroke; there or not;
two that differ or not; which of two is more; which of three is least alike; a number for one; the
group of one. The answers of the last three are neither right nor wrong."""


def task_named(name: str) -> TrialTask:
    """Look a task up by its name."""
    return TASKS[choice("task", name, TASKS)]


Share = Annotated[float, Field(ge=0, le=1)]


class Practice(Part):
    """Practice trials, which do not count, at a level that is surely felt."""

    trials: PositiveInt
    level: float
    feedback: bool = True


class Catch(Part):
    """Catch trials: the method does not get them, and they show whether a person attends.

    Where one of several intervals has the target, it is at a `level` that is surely felt. Where the
    answer is whether there is a target, or a difference, there is none.
    """

    share: Annotated[float, Field(gt=0, lt=1)]
    level: float | None = None


class StopRules(Part):
    """A session ends at the first that is reached; the method may end it before.

    The spread is a quarter of the threshold's 95 % interval.
    """

    most_trials: PositiveInt | None = None
    most_minutes: PositiveFloat | None = None
    spread: PositiveFloat | None = None
    least_trials: PositiveInt = 20
    """Before them the spread is not looked at."""


class Exclude(Part):
    """Rules by which a session is marked as excluded; its data stay."""

    catch_right: Share | None = None
    """Least share of catch trials right."""
    off_touch: Share | None = None
    """Most attempts whose touch was off."""


class SessionPlan(Part):
    """All of them.

    Parameters
    ----------
    break_every : int, optional
        Trials after which the participant rests.
    feedback : bool
        Whether the participant learns after each answer if it was right.
    """

    practice: Practice | None = None
    catch: Catch | None = None
    stop: StopRules = StopRules()
    exclude: Exclude = Exclude()
    break_every: PositiveInt | None = None
    feedback: bool = False


def check_plan(plan: SessionPlan, task: TrialTask, name: str) -> None:
    """Raise `InputError` if the task does not allow the plan."""
    if plan.catch is None:
        if task.detects:
            raise InputError(
                f"catch: the task {name!r} needs trials without a target, to find who always "
                "answers the same; give their share, such as catch = { share = 0.5 }"
            )
        return
    if not (task.guess or task.detects):
        raise InputError(f"catch: {name} has no right answers, and so no catch trials")
    if task.detects != (plan.catch.level is None):
        need = "no level: there is no target" if task.detects else "a level that is surely felt"
        raise InputError(f"catch.level: catch trials of {name} have {need}")


_NORMAL = NormalDist()


def accepted(rows: Sequence[Mapping[str, str]], condition: str = "") -> list[Mapping[str, str]]:
    """Return the rows of accepted trials, of a condition or all."""
    of_condition = (row for row in rows if not condition or row["condition"] == condition)
    return [row for row in of_condition if row["accepted"] == "true"]


def summary(
    rows: Sequence[Mapping[str, str]],
    task: str,
    exclude: Exclude | None = None,
    condition: str = "",
) -> dict[str, Any]:
    """Return the catch trials' results and exclusions of a log's rows, as plain values.

    Trials that count though their touch was out of range; catch trials right; of tasks that detect
    also the shares of hits and false alarms, d' and the criterion: all of a condition, or if none
    is named of the session. The rules by which it is excluded are those of the session.
    """
    values = dict[str, Any]()
    counted = accepted(rows, condition)
    if out := sum(row.get("why", "n/a") != "n/a" for row in counted):
        values["out_of_range"] = out
    if caught := [row for row in counted if row["kind"] == "catch"]:
        right = sum(row["is_right"] == "true" for row in caught)
        values["catch_trials"], values["catch_right"] = len(caught), right / len(caught)
        if task_named(task).detects:
            shown = [row for row in counted if row["kind"] == "trial"]
            hits = sum(row["is_right"] == "true" for row in shown)
            values |= detection(hits, len(shown), len(caught) - right, len(caught), task)
    if why := _why_excluded(rows, exclude or Exclude()):
        values["excluded"] = why
    return values


def _why_excluded(rows: Sequence[Mapping[str, str]], rules: Exclude) -> str:
    """Return by which rules a session is excluded; empty if it is not."""
    why, counted = [], accepted(rows)
    caught = [row["is_right"] == "true" for row in counted if row["kind"] == "catch"]
    if caught and rules.catch_right is not None and sum(caught) / len(caught) < rules.catch_right:
        why.append(f"{sum(caught)} of {len(caught)} catch trials were right")
    if rows and rules.off_touch is not None:
        off = 1 - sum(row.get("why", "n/a") == "n/a" for row in counted) / len(rows)
        if off > rules.off_touch:
            why.append(f"the touch was off in {off:.0%} of the attempts")
    return "; ".join(why)


def estimate_of(
    method: Method, rows: Sequence[Mapping[str, str]], task: str, condition: str = ""
) -> Estimate:
    """Return a method's estimate, with reaction times, and with trials without a target.

    Reaction times of simulated observers say nothing. Of imported answers they may not be known.
    """
    mine = accepted(rows, condition)
    trials = [row for row in mine if row["kind"] in ("trial", "n/a")]
    times = [row["reaction_s"] for row in trials if row["source"] != "simulated"]
    reaction_s = None if "n/a" in times else [float(time) for time in times]
    if not task_named(task).detects:
        return method.estimate(reaction_s=reaction_s)
    empty = [row for row in mine if row["kind"] == "catch"]
    # An empty trial that is wrong is one in which a target was found.
    found = sum(row["is_right"] != "true" for row in empty)
    return method.estimate((found, len(empty)), reaction_s)


def detection(
    hits: int, shown: int, false_alarms: int, empty: int, task: str = "yes-no"
) -> dict[str, float]:
    """Return the shares of hits and false alarms, d' and the criterion.

    Half an answer is added to each count (Hautus, Behav. Res. Methods 27, 46 (1995)). For
    "same-different" d' is that of an observer who compares the two (Macmillan & Creelman, Detection
    Theory, 2nd ed. (2005), ch. 9).
    """
    hit = (hits + 0.5) / (shown + 1)
    false = (false_alarms + 0.5) / (empty + 1)
    shares = {"hits": hit, "false_alarms": false}
    if task != "same-different":
        z_hit, z_false = _NORMAL.inv_cdf(hit), _NORMAL.inv_cdf(false)
        return shares | {"d_prime": z_hit - z_false, "criterion": -(z_hit + z_false) / 2}
    limit = -sqrt(2) * _NORMAL.inv_cdf(false / 2)

    def hits_at(d: float) -> float:
        above, below = ((limit - d) / sqrt(2), (-limit - d) / sqrt(2))
        return 1 - _NORMAL.cdf(above) + _NORMAL.cdf(below)

    low, high = 0.0, 20.0
    for _ in range(60):  # hits rise with d'
        middle = (low + high) / 2
        low, high = (middle, high) if hits_at(middle) < hit else (low, middle)
    return shares | {"d_prime": low, "criterion": limit}


Kind = Literal["practice", "catch", "trial"]

_CATCH = 0x636174  # keeps these draws apart from those of the order


@dataclass(frozen=True)
class NextTrial:
    """A trial that is to be presented."""

    kind: Kind
    condition: str
    """Empty where there is one alone."""
    level: float
    other_levels: tuple[float, ...]
    """Levels that it is compared with; none for the reference."""
    has_target: tuple[bool, ...]
    """Of each interval."""
    right: str


@dataclass(eq=False)
class TrialSequence:
    """The sequence of trials: it depends on method, task, plan, seed and the rows so far alone."""

    method: Method
    task: TrialTask
    plan: SessionPlan
    seed: int
    trials: int = 0
    """Accepted trials, those of practice and catch trials included."""
    counted: int = 0
    """Of those, the ones that the method has counted."""
    attempt: int = 0
    """Earlier attempts at the next trial."""

    def next(self) -> NextTrial:
        """Return the trial that comes next."""
        plan = self.plan
        kind: Kind = "trial"
        if plan.practice is not None and self.trials < plan.practice.trials:
            kind = "practice"
        elif plan.catch is not None:
            draw = np.random.default_rng([self.seed, self.trials, _CATCH])
            kind = "catch" if draw.random() < plan.catch.share else "trial"
        level = float(self.method.level)
        if kind == "practice" and plan.practice is not None:
            level = plan.practice.level
        elif kind == "catch" and plan.catch is not None and plan.catch.level is not None:
            level = plan.catch.level
        draw = np.random.default_rng([self.seed, self.trials, self.attempt])
        has_target, right = self.task.arrange(draw, kind == "catch")
        condition, several = "", self.method
        if isinstance(several, MethodsByCondition):
            is_practice = kind == "practice"
            condition = several.practised(self.trials) if is_practice else several.condition
        return NextTrial(kind, condition, level, self.method.other_levels, has_target, right)

    def hear(self, row: Mapping[str, str]) -> None:
        """Take the row of an attempt."""
        if row["accepted"] != "true":
            if row["kind"] == "trial" and not self.method.is_done:
                self.method.postpone()
            self.attempt += 1
            return
        if row["kind"] == "trial":
            is_number = row["is_right"] == "n/a"
            value = float(row["answer"]) if is_number else row["is_right"] == "true"
            level = float(row["level"])
            if isinstance(self.method, MethodsByCondition):
                self.method.update(value, level, row["condition"])
            else:
                self.method.update(value, level)
            self.counted += 1
        self.trials, self.attempt = self.trials + 1, 0

    def difference(self, row: Mapping[str, str]) -> str:
        """Return the difference of a row from the next trial; empty if there is none."""
        if self.method.is_done:
            return "comes after the last trial of the method"
        planned = self.next()
        known = {
            "trial": self.trials,
            "attempt": self.attempt,
            "kind": planned.kind,
            "condition": planned.condition,
            "level_asked": planned.level,
            "right": planned.right,
        }
        lowered = row["lowered_to_ceiling"] == "true"
        if not lowered:
            known["level"] = planned.level
            known["other_level"] = _others(planned.other_levels, row["other_level"])
        if planned.right:
            known["is_right"] = row["answer"] == row["right"]
        for name, value in known.items():
            if row[name] != cell(value):
                return f"{name} is {row[name]}, and that of the plan {cell(value)}"
        if lowered and not float(row["level"]) < planned.level:
            return f"level is {row['level']}, and not below the {planned.level} of the plan"
        return ""


def _others(planned: Sequence[float], found: str) -> str:
    """Return the cell of the levels that a trial compares with; lower ones in it are kept."""
    cells = found.split()
    if len(cells) != len(planned) or found == "n/a":
        return cell(" ".join(map(cell, planned)))
    lower = [float(one) < level for one, level in zip(cells, planned, strict=True)]
    return " ".join(c if low else cell(p) for c, low, p in zip(cells, lower, planned, strict=True))


def replay(sequence: TrialSequence, rows: Sequence[Mapping[str, str]], path: Path) -> Iterator[str]:
    """Replay the rows of a log; yield the differences from the sequence's own trials.

    Raises
    ------
    FileFormatError
        If a row of this program is not that of the plan, or a number is not the next. Rows of
        another program may have been chosen otherwise, and are replayed all the same.
    """
    for number, row in enumerate(rows, 1):
        if different := sequence.difference(row):
            what = f"{path}: row {number} (trial {row['trial']}): {different}"
            place = {"trial": cell(sequence.trials), "attempt": cell(sequence.attempt)}
            if row["version"] == program() or any(row[name] != place[name] for name in place):
                raise FileFormatError(f"{what}; restore the log as it was written")
            yield what
        sequence.hear(row)


def method_of(table: Mapping[str, Any]) -> Method:
    """Make a method from the table of `Method.describe`."""
    if table["method"] == MethodsByCondition.kind:
        methods = {name: method_of(table["methods"][name]) for name in table["order"]}
        stream = table.get("stream", 0)
        return MethodsByCondition(methods, table["interleaved"], table["seed"], stream)
    kind = METHODS[table["method"]]
    names = [field.name for field in fields(kind) if field.init]
    # No limit is None there, and the default here.
    return kind(**{name: table[name] for name in names if table.get(name) is not None})


def replayed(session: LoggedSession) -> tuple[TrialSequence, tuple[str, ...]]:
    """Return the sequence of a session that was read, and notes on its log.

    Raises `FileFormatError` as `replay` does.
    """
    with reading(session.path, "a log of trials"):
        settings = session.settings
        sequence = TrialSequence(
            method_of(settings["method"]),
            task_named(settings["task"]),
            SessionPlan(**settings.get("plan", {})),
            settings["seed"],
        )
        differences = [*replay(sequence, session.rows, session.path)]
    return sequence, (*session.remarks, *differences[:1])
