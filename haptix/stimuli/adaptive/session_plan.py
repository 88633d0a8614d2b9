"""What surrounds the trials of a session: practice, catch trials, breaks, stopping, exclusion."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, PositiveFloat, PositiveInt

from haptix.documents import Part
from haptix.errors import InputError
from haptix.stimuli.adaptive.tasks import Task

Share = Annotated[float, Field(ge=0, le=1)]


class Practice(Part):
    """Trials at the beginning that do not count, at a level that is surely felt."""

    trials: PositiveInt
    level: float
    feedback: bool = True


class Catch(Part):
    """Trials that the method does not hear of: they tell whether somebody attends.

    Where one of several intervals has the target, it is at a `level` that is surely felt. Where the
    answer is whether there is a target, or a difference, there is none.
    """

    share: Annotated[float, Field(gt=0, lt=1)]
    level: float | None = None


class StopRules(Part):
    """A session ends at the first that is reached; the method may end it before."""

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
        Whether each answer is told to be right or wrong.
    """

    practice: Practice | None = None
    catch: Catch | None = None
    stop: StopRules = StopRules()
    exclude: Exclude = Exclude()
    break_every: PositiveInt | None = None
    feedback: bool = False


def check_plan(plan: SessionPlan, task: Task, name: str) -> None:
    """Raise `InputError` where a task cannot have what a plan asks for."""
    if plan.catch is None:
        if task.detects:
            raise InputError(
                f"catch: the task {name!r} needs trials without a target, to tell who always says "
                "the same; give their share, such as catch = { share = 0.5 }"
            )
        return
    if not task.choices:
        raise InputError(f"catch: {name} has no right answers, and so no catch trials")
    if task.detects != (plan.catch.level is None):
        need = "no level: there is no target" if task.detects else "a level that is surely felt"
        raise InputError(f"catch.level: catch trials of {name} have {need}")
