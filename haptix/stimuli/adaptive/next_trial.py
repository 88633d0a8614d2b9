"""Which trial comes next: practice, catch or counted, of which condition, with the target where."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from haptix.stimuli.adaptive.conditions import MethodsByCondition
from haptix.stimuli.adaptive.method import Method
from haptix.stimuli.adaptive.session_plan import SessionPlan
from haptix.stimuli.adaptive.tasks import Task

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


def next_trial(
    method: Method, task: Task, plan: SessionPlan, seed: int, trial: int, attempt: int
) -> NextTrial:
    """Return the trial that comes after some accepted ones; it depends on nothing else."""
    kind: Kind = "trial"
    if plan.practice is not None and trial < plan.practice.trials:
        kind = "practice"
    elif plan.catch is not None:
        is_catch = np.random.default_rng([seed, trial, _CATCH]).random() < plan.catch.share
        kind = "catch" if is_catch else "trial"
    level = float(method.level)
    if kind == "practice" and plan.practice is not None:
        level = plan.practice.level
    elif kind == "catch" and plan.catch is not None and plan.catch.level is not None:
        level = plan.catch.level
    draw = np.random.default_rng([seed, trial, attempt])
    has_target, right = task.arrange(draw, kind == "catch")
    condition = method.condition if isinstance(method, MethodsByCondition) else ""
    return NextTrial(kind, condition, level, method.other_level, has_target, right)
