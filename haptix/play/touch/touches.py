"""All touches on a screen: from the reports of each to the present place of the finger."""

from __future__ import annotations

import logging
from dataclasses import field
from math import hypot, nan
from typing import Any, NamedTuple

from haptix.base import checks
from haptix.base.checks import NotNegative, Positive, checked
from haptix.base.errors import InputError
from haptix.play.touch.events import (
    LARGEST_S,
    ForceEstimate,
    ForceModel,
    ForceSource,
    TouchCounts,
    TouchEvent,
    TouchKind,
    about_clock,
    misplaced,
    problem_of,
)
from haptix.play.touch.filters import FILTERS, InteractingSinger, PlaceFilter

_LOG = logging.getLogger("haptix.play.touch")
# Number of ended touches whose ids are remembered: late events must not start them again.
_REMEMBERED = 32
_FIRST_INTERVAL_S = 1 / 60
_OUTCOMES = {
    "HX_TAKEN": "taken",
    "HX_COALESCED": "coalesced",
    "HX_REORDERED": "reordered",
    "HX_JUMPED": "jumps",
    "HX_LATE": "late",
    "HX_CLOCK_JUMPED": "clock_jumps",
}


@checked()
class TouchSettings:
    """Settings of a tracker; times in seconds.

    Parameters
    ----------
    filter : PlaceFilter
        `InteractingSinger`, `SingerKalman`, `ConstantVelocityKalman` or `OneEuroFilter`.
    latency_s : float
        How far ahead places are predicted, beyond the age of the last report. It is the time from
        the finger being at a place to the report's time stamp, plus the time from a sample being
        rendered to the finger feeling it. Measure it end to end.
    lost_after_s : float
        A touch without a report for this long is lost. It is held where it was expected then, and
        does not slide. The next report starts it again, as if the finger had just come down.
    blend_s : float
        Time constant with which a path follows the correction of a new report.
    slide_above_mm_s, rest_below_mm_s : float
        A finger starts to slide above the first and comes to rest below the second.
    turn_above_mm_s, turn_s : float
        A finger whose velocity averages to less, since it turns, still slides for `turn_s` at most
        while its averaged speed is above the first.
    slide_smoothing_s : float
        Time constant over which velocity, as a vector, and speed are averaged for that decision.
    reorder_s : float
        An event that is late by at most this is put in its place. Later ones are dropped.
    clock_uncertainty_s : float
        Known uncertainty of the stamps' clock, see `AppClock`.
    least_interval_s : float
        Reports that follow each other faster than this replace each other.
    force : ForceModel
        Where the normal force comes from.
    """

    filter: PlaceFilter = field(default_factory=InteractingSinger)
    latency_s: NotNegative = 0.0
    lost_after_s: Positive = 0.08
    blend_s: Positive = 0.003
    slide_above_mm_s: NotNegative = 8.0
    rest_below_mm_s: NotNegative = 4.0
    turn_above_mm_s: Positive = 8.0
    turn_s: NotNegative = 0.1
    slide_smoothing_s: Positive = 0.05
    reorder_s: NotNegative = 0.02
    clock_uncertainty_s: NotNegative = 0.0
    least_interval_s: Positive = 0.001
    force: ForceModel = field(default_factory=ForceModel)

    def __post_init__(self) -> None:
        if type(self.filter) not in FILTERS:
            names = ", ".join(kind.__name__ for kind in FILTERS)
            raise InputError(f"filter: expected {names}, got {type(self.filter).__name__}")
        if self.latency_s > 0.5:
            raise InputError(
                f"latency_s: expected 0.5 s at most, got {self.latency_s:g}; is it in ms? No "
                "finger can be predicted over more"
            )
        if self.rest_below_mm_s > self.slide_above_mm_s:
            raise InputError(
                "expected rest_below_mm_s <= slide_above_mm_s, got "
                f"{self.rest_below_mm_s:g} and {self.slide_above_mm_s:g}"
            )

    def compiled(self, fade_s: float = 1.0) -> tuple[Any, Any]:
        """Return the same for the library in C, to follow touches and to predict fingers.

        Parameters
        ----------
        fade_s : float
            Time in which the drive of a finger fades in and out [s].
        """
        from haptix.base.native import ffi  # late, as in `TouchTracker`

        number, parameters = self.filter.compiled
        touching = ffi.new("hx_touching *", (
            parameters, self.slide_above_mm_s, self.rest_below_mm_s, self.turn_above_mm_s,
            self.turn_s, self.slide_smoothing_s, self.reorder_s, self.least_interval_s,
            self.lost_after_s, number,
        ))  # fmt: skip
        following = (self.latency_s, self.lost_after_s, self.blend_s, fade_s)
        return touching, ffi.new("hx_following *", following)


class TouchState(NamedTuple):
    """A touch at one time; names hold the units.

    Parameters
    ----------
    t_s : float
    x_mm, y_mm : float
    vx_mm_s, vy_mm_s, speed_mm_s : float
        Velocity and speed [mm/s].
    age_s : float
        Time since the last report [s]; below 0 if its time stamp is later.
    normal_force_n, force_sigma_n : float
        Normal force and its standard deviation [N].
    force_source : str
        Where the force comes from.
    is_sliding, is_lost, is_down : bool
        Whether it slides; its reports have stopped; it touches.
    """

    t_s: float
    x_mm: float
    y_mm: float
    vx_mm_s: float
    vy_mm_s: float
    speed_mm_s: float
    age_s: float
    normal_force_n: float
    force_sigma_n: float
    force_source: ForceSource
    is_sliding: bool
    is_lost: bool
    is_down: bool


class Predicted(NamedTuple):
    """A touch as its reports predict it, for the library in C; each report makes a new one."""

    track: Any
    """Its ``hx_track``, from the last report on."""
    force: ForceEstimate


class TouchTracker:
    """Follows one touch from down to up.

    One thread may push reports while another reads: the second reads `now`, which the first
    replaces.

    Parameters
    ----------
    settings : TouchSettings
        Filter, latency and limits.
    t_s, x_mm, y_mm : float
        The first report, finite.
    normal_force_n, contact_area_m2 : float, optional
        Its force and area, if measured.
    counts : TouchCounts, optional
        Counts to add to; by default its own.
    touch_id : int
        Which touch it is.
    interval_s : float
        Interval of the panel's reports, until it is estimated.
    """

    def __init__(
        self,
        settings: TouchSettings,
        t_s: float,
        x_mm: float,
        y_mm: float,
        normal_force_n: float | None = None,
        contact_area_m2: float | None = None,
        counts: TouchCounts | None = None,
        touch_id: int = 0,
        interval_s: float = _FIRST_INTERVAL_S,
    ) -> None:
        self.settings = settings
        self.touch_id = touch_id
        self.counts = TouchCounts() if counts is None else counts
        self.is_down = True
        self._settings, self._following = settings.compiled()
        self._force = settings.force.assumed
        from haptix.base.native import ffi, library  # late: the service has words for its lack

        self._ffi, self._library = ffi, library
        self._outcomes = [(getattr(library, flag), name) for flag, name in _OUTCOMES.items()]
        self._memory = ffi.new("double[]", library.hx_tracker_bytes() // 8 + 1)
        self._at = ffi.cast("hx_tracker *", self._memory)
        library.hx_tracker_start(self._settings, self._at, interval_s, t_s, x_mm, y_mm)
        if normal_force_n is not None or contact_area_m2 is not None:
            self._take_force(normal_force_n, contact_area_m2)
        self._publish()
        self.counts.taken += 1

    @property
    def interval_s(self) -> float:
        """Interval of the panel's reports, as estimated until now."""
        interval_s: float = self._library.hx_tracker_interval_s(self._at)
        return interval_s

    @property
    def last_t_s(self) -> float:
        """Time of the latest report."""
        t_s: float = self.now.track.reported_s
        return t_s

    def push(
        self,
        t_s: float,
        x_mm: float,
        y_mm: float,
        normal_force_n: float | None = None,
        contact_area_m2: float | None = None,
    ) -> bool:
        """Take a further report; all numbers finite. False if it was dropped.

        It was if it came too late, or if it jumps: then it counts once the next one is near it.

        Parameters
        ----------
        t_s : float
        x_mm, y_mm : float
        normal_force_n : float, optional
            Normal force [N], if measured.
        contact_area_m2 : float, optional
            Contact area [m^2], if measured.
        """
        outcome = self._library.hx_tracker_push(self._settings, self._at, t_s, x_mm, y_mm)
        for flag, name in self._outcomes:
            if outcome & flag:
                setattr(self.counts, name, getattr(self.counts, name) + 1)
        if not outcome & self._library.HX_TAKEN:
            return False
        if (normal_force_n is not None or contact_area_m2 is not None) and (
            outcome & self._library.HX_LATEST  # a later report has a newer force
        ):
            self._take_force(normal_force_n, contact_area_m2)
        self._publish()
        return True

    def lift(self) -> None:
        """End the touch: it no longer slides, and its place is predicted until it is lost."""
        self.is_down = False

    def at(self, t_s: float) -> TouchState:
        """Place, velocity and force of the finger at a time, predicted over the latency.

        A finger of which nothing is reported for two intervals of reports has not moved: it rests
        at the place that was reported last.

        Parameters
        ----------
        t_s : float

        Examples
        --------
        >>> track = TouchTracker(TouchSettings(), 0.0, 10.0, 20.0, normal_force_n=0.5)
        >>> track.push(0.01, 10.5, 20.0, normal_force_n=0.5)
        True
        >>> track.at(0.015).is_down
        True
        """
        track, force = self.now
        place = self._ffi.new("double[4]")
        self._library.hx_finger_place(self._following, track, t_s, place)
        x, y, vx, vy = place
        age, down = t_s - track.reported_s, self.is_down
        return TouchState(
            t_s, x, y, vx, vy, hypot(vx, vy), age, force.normal_force_n, force.sigma_n,
            force.source, bool(track.is_sliding) and age <= track.moves_s and down,
            age > self.settings.lost_after_s, down,
        )  # fmt: skip

    def _take_force(self, normal_force_n: float | None, contact_area_m2: float | None) -> None:
        estimate = self.settings.force.estimate(normal_force_n, contact_area_m2)
        if estimate is not None:
            self._force = estimate
        elif normal_force_n is not None or self.settings.force.area_proxy is not None:
            self.counts.bad_force += 1

    def _publish(self) -> None:
        track = self._ffi.new("hx_track *")
        self._library.hx_tracker_follow(self._settings, self._at, track)
        track.normal_force_n = self._force.normal_force_n
        self.now = Predicted(track, self._force)
        """The present prediction; every report replaces it by a new object."""


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

    Examples
    --------
    >>> touches = Touches()
    >>> touches.touch(0.0, x_mm=10.0, y_mm=20.0), len(touches.active)
    (True, 1)
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
        self._interval_s = _FIRST_INTERVAL_S
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
        # A "down" that arrives after its first "move" is treated as an earlier report.
        taken = tracker.push(event.t_s, event.x_mm, event.y_mm, force, area)
        if taken or event.t_s > tracker.last_t_s:  # which jumped
            return taken
        return self._late(event, tracker.last_t_s)

    def touch(
        self,
        t_s: float,
        x_mm: float,
        y_mm: float,
        normal_force_n: float | None = None,
        touch_id: int = 0,
        contact_area_m2: float | None = None,
    ) -> bool:
        """Take a report of a finger that is down; the first of an id brings it down.

        Parameters
        ----------
        t_s : float
        x_mm, y_mm : float
        normal_force_n : float, optional
            Normal force [N], if measured.
        touch_id : int
        contact_area_m2 : float, optional
            Contact area [m^2], if measured.

        Examples
        --------
        >>> touches = Touches()
        >>> touches.touch(0.0, x_mm=10.0, y_mm=20.0, normal_force_n=0.5)
        True
        >>> len(touches.active)
        1
        """
        is_there = type(touch_id) is int and touch_id in self._trackers
        kind: TouchKind = "move" if is_there else "down"
        return self.push(
            TouchEvent(t_s, touch_id, x_mm, y_mm, kind, normal_force_n, contact_area_m2)
        )

    def lift(self, touch_id: int = 0, t_s: float = nan) -> bool:
        """End a touch, at a time if one is given.

        Parameters
        ----------
        touch_id : int
        t_s : float
            Time [s]; NaN for that of its last report.

        Examples
        --------
        >>> touches = Touches()
        >>> touches.touch(0.0, x_mm=10.0, y_mm=20.0) and touches.lift(t_s=0.1)
        True
        """
        return self.push(TouchEvent(t_s, touch_id, 0.0, 0.0, "up"))

    def __getitem__(self, touch_id: int) -> TouchTracker:
        """Tracker of a finger that is down; KeyError if there is none."""
        return self._trackers[touch_id]

    def __contains__(self, touch_id: object) -> bool:
        return touch_id in self._trackers

    def __len__(self) -> int:
        return len(self._trackers)

    def _misplaced(self, event: TouchEvent, arrival_s: float) -> str | None:
        """Count an event with an impossible stamp, and return the problem.

        An object that is not an event returns None here; `problem_of` reports it later.
        """
        clock = (arrival_s, self.settings.lost_after_s, self.settings.clock_uncertainty_s)
        try:
            error = None if event.kind == "up" else misplaced(event.t_s, *clock)
        except (AttributeError, TypeError, ValueError):
            return None
        if error is None:
            return None
        setattr(self.counts, error, getattr(self.counts, error) + 1)
        if not self.strict:
            return error  # the long message is for strict mode only: such events may be many
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
            self.settings, t_s, x_mm, y_mm, force, area, self.counts, touch_id, self._interval_s
        )
        self._active = tuple(self._trackers.items())
        return True

    def _end(self, touch_id: int, tracker: TouchTracker, t_s: float = nan) -> None:
        tracker.lift()
        self._interval_s = tracker.interval_s
        del self._trackers[touch_id]
        self._active = tuple(self._trackers.items())
        last_t_s = tracker.last_t_s
        try:
            # An "up" may have any time, even NaN: the touch lasted at least until its last report.
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
        _LOG.info("dropped: %s", problem)
        return False

    def _make_room(self, t_s: float) -> bool:
        touch_id, tracker = min(self._active, key=lambda item: item[1].last_t_s)
        if t_s - tracker.last_t_s <= self.settings.lost_after_s:
            return False
        self.counts.without_up += 1
        self._end(touch_id, tracker)
        return True
