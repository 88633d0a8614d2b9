"""Tasks: how alternatives are presented, and what is asked."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from haptix.checks import choice


@dataclass(frozen=True)
class Task:
    """A task.

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
    """

    choices: tuple[str, ...]
    intervals: int
    guess: float
    detects: bool = False
    in_one_stroke: bool = False

    def arrange(self, draw: np.random.Generator, is_empty: bool) -> tuple[tuple[bool, ...], str]:
        """Draw which intervals have the target, and which answer is right.

        An empty trial has none: of the tasks that detect.
        """
        place = int(draw.integers(max(2, self.intervals)))
        has_target = tuple(k == place or self.intervals == 1 for k in range(self.intervals))
        if not self.detects:
            return has_target, self.choices[place] if self.choices else ""
        if is_empty:
            return (False,) * self.intervals, self.choices[1]
        return has_target, self.choices[0]


TASKS = {
    "2ifc": Task(("1", "2"), 2, 0.5),
    "2afc": Task(("l", "r"), 2, 0.5, in_one_stroke=True),
    "3afc": Task(("1", "2", "3"), 3, 1 / 3),
    "yes-no": Task(("y", "n"), 1, 0.0, detects=True),
    "same-different": Task(("d", "s"), 2, 0.0, detects=True),
    "pairs": Task(("1", "2"), 2, 0.5),
    "magnitude": Task((), 1, 0.0),
}
"""By name: the target in one of two or three intervals, or on one side of a stroke; there or not;
two that differ or not; which of two is more; a number for one."""


def task_named(name: str) -> Task:
    """Look a task up by its name."""
    return TASKS[choice("task", name, TASKS)]
