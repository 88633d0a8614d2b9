"""The sequence of a session's trials, presented live or replayed from its log."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Literal

import numpy as np

from haptix.errors import FileFormatError
from haptix.files import reading
from haptix.stimuli.adaptive.methods import Method, MethodsByCondition
from haptix.stimuli.adaptive.procedures import METHODS
from haptix.stimuli.adaptive.session_plan import SessionPlan, TrialTask, task_named
from haptix.stimuli.adaptive.trial_log import LoggedSession, cell, program

Kind = Literal["practice", "catch", "trial"]

_CATCH = 0x636174  # keeps these draws apart from those of the order


@dataclass(frozen=True)
class NextTrial:
    """A trial that is to be presented."""

    kind: Kind
    condition: str
    """Empty where there is one alone."""
    level: float
    other_level: float | None
    """Level of what it is compared with; None for the reference."""
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
    """Of those, the ones that the method has heard of."""
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
        condition = self.method.condition if isinstance(self.method, MethodsByCondition) else ""
        return NextTrial(kind, condition, level, self.method.other_level, has_target, right)

    def hear(self, row: Mapping[str, str]) -> None:
        """Take the row of an attempt."""
        if row["accepted"] != "true":
            if row["kind"] in ("trial", "n/a") and not self.method.is_done:
                self.method.postpone()
            self.attempt += 1
            return
        if row["kind"] in ("trial", "n/a"):
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
            if planned.other_level is not None and float(row["other_level"]) >= planned.other_level:
                known["other_level"] = planned.other_level
        if self.task.choices:
            known["is_right"] = row["answer"] == row["right"]
        for name, value in known.items():
            # Logs of before have neither kinds nor conditions.
            if row[name] != cell(value) and not (name in _LATER and row[name] == "n/a"):
                return f"{name} is {row[name]}, and that of the plan {cell(value)}"
        if lowered and not float(row["level"]) < planned.level:
            return f"level is {row['level']}, and not below the {planned.level} of the plan"
        return ""


_LATER = ("kind", "condition")


def replay(sequence: TrialSequence, rows: Sequence[Mapping[str, str]], path: Path) -> Iterator[str]:
    """Replay the rows of a log; yield the differences from what the sequence would present.

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
        return MethodsByCondition(methods, table["interleaved"], table["seed"])
    kind = METHODS[table["method"]]
    names = [field.name for field in fields(kind) if field.init]
    # No limit is None there, and the default here.
    return kind(**{name: table[name] for name in names if table.get(name) is not None})


def replayed(session: LoggedSession) -> tuple[TrialSequence, tuple[str, ...]]:
    """Return the sequence of a session that was read, and notes on its log.

    Raises
    ------
    FileFormatError
        As `replay` does.
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
