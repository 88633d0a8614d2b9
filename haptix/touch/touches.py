"""All touches on a screen: one tracker for each finger that is down."""

from __future__ import annotations

from math import nan

from haptix import checks
from haptix.errors import InputError
from haptix.touch.clock import about_clock, misplaced
from haptix.touch.events import LARGEST_S, TouchCounts, TouchEvent, TouchKind, problem_of
from haptix.touch.settings import TouchSettings
from haptix.touch.tracker import TouchTracker

# Ended touches that are remembered, so that their late events do not start them again.
_REMEMBERED = 32


class Touches:
    """Passes events to trackers by their id.

    A bad report must never leave a finger under voltage, so unusable events are dropped and counted
    (`counts`), and the touch continues. With `strict` they raise instead, and change nothing.

    Parameters
    ----------
    settings : TouchSettings, optional
        Settings of every tracker.
    strict : bool
        Raise `InputError` for events that cannot be used.
    max_touches : int
        Largest number at once. A further touch replaces the one that is lost for longest; if none
        is lost, it is dropped.
    """

    def __init__(
        self, settings: TouchSettings | None = None, strict: bool = False, max_touches: int = 16
    ) -> None:
        checks.whole("max_touches", max_touches, 1)
        if settings is not None:
            checks.instance("settings", settings, TouchSettings)
        self.settings = TouchSettings() if settings is None else settings
        self.strict = checks.boolean("strict", strict)
        self.max_touches = max_touches
        self.counts = TouchCounts()
        self._trackers: dict[int, TouchTracker] = {}
        self._ended: dict[int, float] = {}
        self._active: tuple[tuple[int, TouchTracker], ...] = ()

    @property
    def active(self) -> tuple[tuple[int, TouchTracker], ...]:
        """Id and tracker of each finger that is down, in the order in which they came down."""
        return self._active

    def push(self, event: TouchEvent, arrival_s: float | None = None) -> bool:
        """Take an event; False if it was dropped.

        Parameters
        ----------
        event : TouchEvent
            The report.
        arrival_s : float, optional
            When it arrived, on the clock of its stamp. With it, a stamp that is from the future or
            older than `TouchSettings.lost_after_s` is dropped; an "up" never is.

        Raises
        ------
        InputError
            Only if `strict`: a value is not finite or huge, a force or an area not above 0, the
            event is too late or its stamp of another clock, or the touch is not there or one too
            many.
        """
        if arrival_s is not None and (problem := self._misplaced(event, arrival_s)) is not None:
            return self._drop(problem)
        problem = problem_of(event, self.strict)
        if problem is not None:
            self.counts.invalid += 1
            return self._drop(problem)
        t_s, touch_id, x_mm, y_mm, kind, force, area = event
        tracker = self._trackers.get(touch_id)
        if kind == "up":
            if tracker is None:
                self.counts.unknown_up += 1
                return self._drop(f"touch {touch_id}: went up, but was not down")
            self._end(touch_id, tracker, t_s)
            return True
        event = TouchEvent(float(t_s), touch_id, float(x_mm), float(y_mm), kind, force, area)
        if tracker is None:
            return self._begin(event)
        if kind == "down" and t_s > tracker.last_t_s:
            self.counts.without_up += 1
            self._end(touch_id, tracker)
            return self._begin(event)
        # A "down" that comes after its first "move" is just an earlier report.
        taken = tracker.push(event.t_s, event.x_mm, event.y_mm, force, area)
        return taken or self._late(event, tracker.last_t_s)

    def touch(
        self,
        t_s: float,
        x_mm: float,
        y_mm: float,
        normal_force_n: float | None = None,
        touch_id: int = 0,
        contact_area_m2: float | None = None,
    ) -> bool:
        """Take a report of a finger that is down; the first of an id brings it down."""
        is_there = type(touch_id) is int and touch_id in self._trackers
        kind: TouchKind = "move" if is_there else "down"
        return self.push(
            TouchEvent(t_s, touch_id, x_mm, y_mm, kind, normal_force_n, contact_area_m2)
        )

    def lift(self, touch_id: int = 0, t_s: float = nan) -> bool:
        """End a touch, at a time if one is given."""
        return self.push(TouchEvent(t_s, touch_id, 0.0, 0.0, "up"))

    def __getitem__(self, touch_id: int) -> TouchTracker:
        """Tracker of a finger that is down; KeyError if there is none."""
        return self._trackers[touch_id]

    def __contains__(self, touch_id: object) -> bool:
        return touch_id in self._trackers

    def __len__(self) -> int:
        return len(self._trackers)

    def _misplaced(self, event: TouchEvent, arrival_s: float) -> str | None:
        """Count an event whose stamp cannot be, and say so; what is no event is found later."""
        clock = (arrival_s, self.settings.lost_after_s, self.settings.clock_uncertainty_s)
        try:
            found = None if event.kind == "up" else misplaced(event.t_s, *clock)
        except (AttributeError, TypeError, ValueError):
            return None
        if found is None:
            return None
        setattr(self.counts, found, getattr(self.counts, found) + 1)
        if not self.strict:
            return found  # nobody reads the sentence, and a late app sends many such
        return f"touch {event.touch_id}: {about_clock(event.t_s, *clock)}"

    def _begin(self, event: TouchEvent) -> bool:
        t_s, touch_id, x_mm, y_mm, kind, force, area = event
        ended = self._ended.get(touch_id)
        if kind == "move" and ended is not None and t_s <= ended:
            self.counts.late += 1
            return self._late(event, ended)
        if len(self._trackers) >= self.max_touches and not self._make_room(t_s):
            self.counts.crowded += 1
            return self._drop(
                f"touch {touch_id}: expected at most {self.max_touches} touches at once; lift "
                "others first, or raise max_touches"
            )
        if kind == "move":
            self.counts.without_down += 1
        self._trackers[touch_id] = TouchTracker(
            self.settings, t_s, x_mm, y_mm, force, area, self.counts, touch_id
        )
        self._active = tuple(self._trackers.items())
        return True

    def _end(self, touch_id: int, tracker: TouchTracker, t_s: float = nan) -> None:
        tracker.lift()
        del self._trackers[touch_id]
        self._active = tuple(self._trackers.items())
        last_t_s = tracker.last_t_s
        try:
            # An "up" may carry any time, nan too: the touch was certainly there until its last.
            self._ended[touch_id] = t_s if last_t_s < t_s <= LARGEST_S else last_t_s
        except TypeError:
            self._ended[touch_id] = last_t_s
        if len(self._ended) > _REMEMBERED:
            del self._ended[next(iter(self._ended))]

    def _late(self, event: TouchEvent, last_t_s: float) -> bool:
        return self._drop(
            f"touch {event.touch_id}: time must advance, but {event.t_s:g} s follows {last_t_s:g} "
            f"s, which is more than {self.settings.reorder_s:g} s later (reorder_s)"
        )

    def _drop(self, problem: str) -> bool:
        if self.strict:
            raise InputError(problem)
        return False

    def _make_room(self, t_s: float) -> bool:
        touch_id, tracker = min(self._active, key=lambda item: item[1].last_t_s)
        if t_s - tracker.last_t_s <= self.settings.lost_after_s:
            return False
        self.counts.without_up += 1
        self._end(touch_id, tracker)
        return True
