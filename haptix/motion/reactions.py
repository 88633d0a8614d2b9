"""What a finger has done on a material: its dated facts, kept from real reports."""

from __future__ import annotations

from collections.abc import Callable
from math import isnan, nan

from haptix.motion.block import Facts, History, Report
from haptix.motion.trajectory import LIFTED_BELOW_N, Trajectory

React = Callable[[Facts, Report | None, Report], Facts]

_KEPT = 64  # changes of facts of one finger; a block of a quarter of a second has fewer
_TIMES = ("down_s", "press_s", "release_s", "detent_s")


def unmoved(facts: Facts, before: Report | None, now: Report) -> Facts:
    """Return the facts as they are: a material that does not react."""
    return facts


class Reactions:
    """Facts of one touch, from down to up; the last changes that are kept, or all.

    One thread may report while another reads `history`, which is replaced and never changed.
    """

    def __init__(self, kept: int | None = _KEPT) -> None:
        self._kept = 0 if kept is None else -kept
        self.history: History = ()
        self._last: Report | None = None

    def report(self, now: Report, react: React, from_s: float = nan) -> None:
        """Take a real report, on the clock of samples.

        What the material makes of it holds from `from_s` on, the first time that can still be
        rendered. Where that is NaN, a recorded path, it holds from when it happened.
        """
        history = self.history
        before = history[-1][1] if history else None
        found = react(before or Facts(down_s=now.t_s), self._last, now)
        self._last = now
        if found is before:
            return
        then = before or Facts()
        new = {n: getattr(found, n) for n in _TIMES if _differ(getattr(found, n), getattr(then, n))}
        if before is not None and not new and not _differ(found.detent, before.detent):
            return
        since_s = min((t_s for t_s in new.values() if not isnan(t_s)), default=now.t_s)
        if since_s < from_s:
            since_s = from_s
            found = found._replace(**{name: max(t_s, from_s) for name, t_s in new.items()})
        self.history = (*history[self._kept :], (since_s, found))


def _differ(one: float, other: float) -> bool:
    return one != other and not (isnan(one) and isnan(other))


def facts_on(path: Trajectory, react: React, start_s: float) -> History:
    """Dated facts of a finger on a path, on a clock that starts at `start_s` of the path's."""
    reactions = Reactions(kept=None)
    columns = (path.t_s - start_s, path.x_mm, path.y_mm, path.normal_force_n)
    for t_s, x_mm, y_mm, force_n in zip(*(column.tolist() for column in columns), strict=True):
        is_down = force_n >= LIFTED_BELOW_N
        reactions.report(Report(t_s, x_mm, y_mm, force_n, is_down), react)
    return reactions.history
