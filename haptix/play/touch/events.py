"""Touch events: of a touchscreen or a path, their clock, and their normal force."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from itertools import count
from math import exp, expm1, inf, log, sqrt
from typing import Annotated, Any, Literal, NamedTuple, Self

import numpy as np
import numpy.typing as npt
from pydantic import Field

from haptix.base import checks
from haptix.base.checks import NotNegative, Number, Positive, checked, instance, number, positive
from haptix.base.errors import InputError
from haptix.base.fields import HARDEST_N, LARGEST_AREA_M2, LARGEST_MM, LEAST_AREA_M2, LIFTED_BELOW_N
from haptix.feel.motion import Trajectory

TouchKind = Literal["down", "move", "up"]
KINDS: tuple[TouchKind, ...] = ("down", "move", "up")

LARGEST_S = 1e10
"""Some 300 years, so that clocks that count from 1970 pass; a larger number is in ms or ns."""


class TouchEvent(NamedTuple):
    """One report of one touch; nothing is checked before a tracker takes it.

    Parameters
    ----------
    t_s : float
        Time stamp [s] on the renderer's clock.
    touch_id : int
        Number of the finger's touch, the same from "down" to "up"; then another may have it. Panels
        and TUIO get the smallest that is free, since the service takes 0 to 255.
    x_mm, y_mm : float
        Place on the screen. That of an "up" is not used: it often repeats an old place.
    kind : {"down", "move", "up"}
        Kind of report.
    normal_force_n : float, optional
        Normal force [N], above 0, where the screen measures it.
    contact_area_m2 : float, optional
        Area of contact [m^2], above 0, where the screen measures it.

    Examples
    --------
    >>> TouchEvent(0.0, 1, 10.0, 20.0, "down").x_mm
    10.0
    """

    t_s: float
    touch_id: int
    x_mm: float
    y_mm: float
    kind: TouchKind = "move"
    normal_force_n: float | None = None
    contact_area_m2: float | None = None


def problem_of(event: Any, checks_force: bool = True) -> str | None:
    """Return the problem of an event (field, expected and actual value), or None.

    Without `checks_force` any force and area are accepted.
    """
    values: Any = event
    if not isinstance(event, TouchEvent):
        return f"touch: expected a TouchEvent, got {event!r:.80}"
    t_s, touch_id, x_mm, y_mm, kind, force, area = values
    if type(touch_id) is not int:
        return f"touch: touch_id: expected an integer, got {touch_id!r}"
    if kind not in KINDS:
        return f'touch {touch_id}: kind: expected "down", "move" or "up", got {kind!r}'
    if kind == "up":
        return None
    for name, value, largest, unit in (
        ("t_s", t_s, LARGEST_S, "seconds"),
        ("x_mm", x_mm, LARGEST_MM, "millimetres"),
        ("y_mm", y_mm, LARGEST_MM, "millimetres"),
    ):
        if not _within(value, -largest, largest):
            return (
                f"touch {touch_id}: {name}: expected a finite number of {unit}, "
                f"{largest:g} at most, got {value!r}"
            )
    measured = (
        ("normal_force_n", force, LIFTED_BELOW_N, HARDEST_N, "N"),
        ("contact_area_m2", area, LEAST_AREA_M2, LARGEST_AREA_M2, "m^2"),
    )
    for name, value, least, largest, unit in measured if checks_force else ():
        if value is not None and not _within(value, least, largest):
            return (
                f"touch {touch_id}: {name}: expected a finger's, {least:g} to {largest:g} "
                f"{unit}, or None where the screen measures none, got {value!r:.80}"
            )
    return None


def _within(value: Any, low: float, high: float) -> bool:
    try:
        return bool(low <= value <= high)
    except (TypeError, ValueError):
        return False


@dataclass(slots=True)
class TouchCounts:
    """Counts of events by outcome, over all touches."""

    taken: int = 0
    """Events that went into a filter, including the next two kinds."""
    reordered: int = 0
    """Events that arrived after a later one and were sorted in."""
    coalesced: int = 0
    """Events that replaced the report before, of the same or nearly the same time."""
    late: int = 0
    """Dropped: too old to be sorted in, or of a touch that has ended."""
    clock_jumps: int = 0
    """Times that a touch was restarted because its clock ran backwards."""
    from_the_future: int = 0
    """Dropped: the stamp is later than the arrival, and so from another clock."""
    stale: int = 0
    """Dropped: so old on arrival that the touch was lost; from another clock, or after a stall."""
    invalid: int = 0
    """Dropped: not finite, too large, or not an event."""
    bad_force: int = 0
    """Unusable forces and areas; the place of the event was used."""
    without_down: int = 0
    """Touches that began with a "move"."""
    without_up: int = 0
    """Touches that ended because their id came down again, or to make room."""
    unknown_up: int = 0
    """Dropped: "up" of an unknown touch."""
    jumps: int = 0
    """Dropped: farther than a finger moves; it counts only if the next report is near it."""
    crowded: int = 0
    """Dropped: more touches at once than allowed."""


def free_id(taken: Iterable[int]) -> int:
    """Return the smallest number of a touch, from 1, that is not taken."""
    used = {*taken}
    return next(number for number in count(1) if number not in used)


def events_of(path: Trajectory, touch_id: int = 0) -> list[TouchEvent]:
    """Return a path as events: down, moves, and up at the last place, and where it is lifted.

    Parameters
    ----------
    path : Trajectory
        Times, places and forces.
    touch_id : int

    Examples
    --------
    >>> from haptix.feel import Trajectory
    >>> first, *_ = events_of(Trajectory.of([0.0, 0.1], [5.0, 10.0], 20.0, 0.5))
    >>> first.t_s, first.x_mm, first.normal_force_n
    (0.0, 5.0, 0.5)
    """
    instance("path", path, Trajectory, "haptix.Trajectory.from_csv reads a file")
    columns = (path.t_s, path.x_mm, path.y_mm, path.normal_force_n)
    events: list[TouchEvent] = []
    is_down = False
    for t, x, y, force in zip(*(column.tolist() for column in columns), strict=True):
        if force >= LIFTED_BELOW_N:
            events.append(TouchEvent(t, touch_id, x, y, "move" if is_down else "down", force))
        elif is_down:
            events.append(events[-1]._replace(t_s=t, kind="up"))
        is_down = force >= LIFTED_BELOW_N
    return [*events, events[-1]._replace(kind="up")] if is_down else events


def paced(
    events: Iterable[TouchEvent],
    speed: float = 1.0,
    clock: Callable[[], float] = time.monotonic,
    sleep: Callable[[float], None] = time.sleep,
) -> Iterator[TouchEvent]:
    """Yield events at their times, with time stamps of the clock.

    Parameters
    ----------
    events : iterable of TouchEvent
        A recording. An event of an earlier time than the one before comes at once.
    speed : float
        2 plays twice as fast.
    clock, sleep : callable
        Functions that return the time [s], and that wait [s].
    """
    checks.positive("speed", speed)
    offset_s: float | None = None
    for event in events:
        if not isinstance(event, TouchEvent):
            raise InputError(f"events: expected TouchEvents, got {event!r:.80}")
        if offset_s is None:
            offset_s = clock() - event.t_s / speed
        due_s = event.t_s / speed + offset_s
        # In this form an event whose time is NaN comes at once.
        if (wait_s := due_s - clock()) > 0:
            sleep(wait_s)
        yield event._replace(t_s=due_s)


MARGIN_S = 0.02
"""A stamp may be ahead of its arrival by this time, because clocks and drivers round."""

_UNITS = {"seconds": 1.0, "milliseconds": 1e3, "microseconds": 1e6, "nanoseconds": 1e9}
_SAME_CLOCK_S = 60.0
"""A stamp that is this close to another clock was taken from that clock."""

Misplaced = Literal["from_the_future", "stale"]
"""Kinds of impossible stamps, as `TouchCounts` names them."""


def misplaced(
    t_s: float, arrival_s: float, oldest_s: float, uncertainty_s: float
) -> Misplaced | None:
    """Return how a stamp contradicts the time at which it arrived, or None.

    Parameters
    ----------
    t_s, arrival_s : float
        Stamp and arrival [s] on one clock.
    oldest_s : float
        Age from which a touch is lost.
    uncertainty_s : float
        Known uncertainty of the clock.
    """
    margin_s = MARGIN_S + uncertainty_s
    if t_s > arrival_s + margin_s:
        return "from_the_future"
    return "stale" if t_s < arrival_s - oldest_s - margin_s else None


def about_clock(t_s: float, arrival_s: float, oldest_s: float, uncertainty_s: float) -> str:
    """Return a sentence about a misplaced stamp: the clock, the unit, and what to do."""
    off_s = t_s - arrival_s
    margin_s = MARGIN_S + uncertainty_s
    problem = (
        f"t_s: expected seconds of the renderer's clock (now_s(), in real time time.monotonic()), "
        f"from {(oldest_s + margin_s) * 1e3:.3g} ms ago to {margin_s * 1e3:.3g} ms ahead, got "
        f"{t_s:g}, which is {abs(off_s):.3g} s {'ahead' if off_s > 0 else 'old'}"
    )
    for clock, now_s in (("time.monotonic()", arrival_s), ("time.time()", time.time())):
        for unit, per_s in _UNITS.items():
            is_close = abs(t_s / per_s - now_s) < _SAME_CLOCK_S
            if abs(off_s) > _SAME_CLOCK_S < now_s and is_close:
                return (
                    f"{problem}; that is {clock} in {unit}: map it with haptix.play.touch.AppClock"
                )
    return (
        f"{problem}; map the clock of the stamps with haptix.play.AppClock, or, if the program "
        "stalled, drop such touches with strict=False"
    )


@checked()
class AppClock:
    """Map from the clock of an app's touches to the renderer's: ``offset_s + unit_s * stamp``.

    ::

        clock = AppClock.measure(pygame.time.get_ticks, unit_s=1e-3)
        touch = TouchSettings(clock_uncertainty_s=clock.uncertainty_s)
        renderer.touch(clock.t_s(event.timestamp), x_mm, y_mm)

    Parameters
    ----------
    unit_s : float
        One unit of the app's clock [s]: 1e-3 for milliseconds.
    offset_s : float
        Time of the renderer's clock at the app's 0 [s].
    uncertainty_s : float
        Largest error of the map when it was made [s]; a clock that drifts or is set adds to it.
    """

    unit_s: Positive
    offset_s: Number
    uncertainty_s: NotNegative = 0.0

    @classmethod
    def measure(
        cls,
        read: Callable[[], float],
        unit_s: float = 1.0,
        now: Callable[[], float] = time.monotonic,
        duration_s: float = 0.05,
    ) -> Self:
        """Measure the offset by many readings of the app's clock between two of the renderer's.

        Each reading bounds the offset from both sides. If the bounds of two readings contradict
        each other, the app's clock has coarse ticks and shows a past time. Then the earliest
        reading of a tick counts, and the contradiction adds to the uncertainty.

        Parameters
        ----------
        read : callable
            Returns the app's time, as it stamps touches.
        unit_s : float
            Its unit [s].
        now : callable
            The renderer's clock, `LiveRenderer.now_s`.
        duration_s : float
            How long to read; longer than a tick of the app's clock.

        Raises
        ------
        InputError
            If the app's clock does not run, or in another unit.
        """
        positive("unit_s", unit_s)
        lowest, highest, narrowest = -float("inf"), float("inf"), float("inf")
        begun_s = after_s = now()
        first = at = number("read()", read()) * unit_s
        while after_s - begun_s < duration_s:
            before_s = now()
            at = number("read()", read()) * unit_s
            after_s = now()
            lowest, highest = max(lowest, before_s - at), min(highest, after_s - at)
            narrowest = min(narrowest, after_s - before_s)
        elapsed_s = at - first
        if not 0.5 < elapsed_s / (after_s - begun_s) < 2:
            raise InputError(
                f"unit_s: expected the unit of the app's clock, but by {unit_s:g} s it ran "
                f"{elapsed_s:.3g} s in {after_s - begun_s:.3g} s; milliseconds are 1e-3"
            )
        return cls(unit_s, highest - narrowest / 2, narrowest / 2 + max(0.0, lowest - highest))

    def t_s(self, stamp: Any) -> float:
        """Time of the renderer's clock [s] at a stamp of the app's."""
        return self.offset_s + self.unit_s * number("stamp", stamp)


ForceSource = Literal["axis", "area", "assumed"]


class ForceEstimate(NamedTuple):
    """A normal force [N], its standard deviation [N], and where it comes from.

    Parameters
    ----------
    normal_force_n : float
    sigma_n : float
        Its standard deviation [N].
    source : str
        Where it comes from.
    """

    normal_force_n: float
    sigma_n: float
    source: ForceSource


@checked()
class AreaProxy:
    """Force from contact area by a power law: ``F = 1 N * (area / area_at_1n)^(1 / exponent)``.

    This inverts the law of the apparent area in `haptix.Finger`. A touchscreen's "area"
    differs from screen to screen, so calibrate with the screen and the finger at hand (`fit`).

    Parameters
    ----------
    area_at_1n_m2 : float
        Reported area under 1 N [m^2].
    exponent : float
        How area grows with force; some 0.15 to 0.7 for fingertips.
    log_sigma : float
        Standard deviation of ln F about the law: 0.3 is a factor of 1.35 either way.
    force_range_n : (float, float)
        Range of plausible forces; an area that gives a force outside it is not used.
    """

    area_at_1n_m2: Positive
    exponent: Positive
    log_sigma: Number
    force_range_n: Annotated[tuple[Number, Number], Field(strict=False)] = (0.02, 10.0)

    def __post_init__(self) -> None:
        low, high = self.force_range_n
        if not 0 < low < high < inf:
            raise InputError(
                f"force_range_n: expected (low, high) with 0 < low < high, got {low:g}, {high:g}"
            )
        if not 0 <= self.log_sigma <= 3:
            raise InputError(
                f"log_sigma: expected 0 to 3 (a factor of 20), got {self.log_sigma:g}; with a "
                "wider spread state a force instead (ForceModel.assumed_n)"
            )

    @classmethod
    def fit(cls, contact_area_m2: npt.ArrayLike, normal_force_n: npt.ArrayLike) -> Self:
        """Fit the law to pairs of reported area [m^2] and measured force [N], each of shape (n,).

        Least squares of ln F against ln area, so that the predicted force has the least spread.
        `log_sigma` is that of the residuals; `force_range_n` is half the smallest to twice the
        largest force given.

        Parameters
        ----------
        contact_area_m2 : array-like, shape (n,)
            Reported areas [m^2].
        normal_force_n : array-like, shape (n,)
            Measured forces [N].

        Raises
        ------
        InputError
            If there are fewer than 3 pairs, a value is not above 0, or force does not grow with
            area.

        Examples
        --------
        >>> law = AreaProxy.fit([5e-5, 1e-4, 2e-4], [0.25, 0.5, 1.0])
        >>> round(law.force(1e-4).normal_force_n, 6)
        0.5
        """
        area = checks.row("contact_area_m2", contact_area_m2)
        force = checks.row("normal_force_n", normal_force_n)
        if len(area) != len(force) or len(area) < 3:
            raise InputError(
                "area proxy: expected areas and forces of one length, 3 pairs or more, got "
                f"{len(area)} and {len(force)}"
            )
        for name, values in (("contact_area_m2", area), ("normal_force_n", force)):
            for i, value in enumerate(values.tolist(), 1):
                positive(f"area proxy: {name} of pair {i}", value)
        ln_area, ln_force = np.log(area), np.log(force)
        varies = float(np.ptp(ln_area)) > 0
        slope, offset = np.polyfit(ln_area, ln_force, 1).tolist() if varies else (0.0, 0.0)
        if slope <= 0:
            raise InputError(
                "area proxy: expected areas that grow with force; press with several forces, from "
                "light to firm"
            )
        residual = ln_force - slope * ln_area - offset
        return cls(
            area_at_1n_m2=exp(-offset / slope),
            exponent=1 / slope,
            log_sigma=sqrt(float(residual @ residual) / (len(area) - 2)),
            force_range_n=(float(force.min()) / 2, 2 * float(force.max())),
        )

    def force(self, contact_area_m2: float) -> ForceEstimate | None:
        """Median force and standard deviation (log-normal) for an area above 0.

        None where the force is outside `force_range_n`.

        Examples
        --------
        >>> law = AreaProxy.fit([5e-5, 1e-4, 2e-4], [0.25, 0.5, 1.0])
        >>> law.force(2e-4).normal_force_n > law.force(1e-4).normal_force_n
        True
        """
        ln_force = log(contact_area_m2 / self.area_at_1n_m2) / self.exponent
        low, high = self.force_range_n
        if not log(low) <= ln_force <= log(high):
            return None
        force = exp(ln_force)
        variance = self.log_sigma**2
        return ForceEstimate(force, force * exp(variance / 2) * sqrt(expm1(variance)), "area")


@checked()
class ForceModel:
    """Where a touch gets its force: from the force axis, else the area, else the assumption.

    Parameters
    ----------
    assumed_n, assumed_sigma_n : float
        Used where nothing is measured: a usual exploring force, and its spread among people.
    axis_sigma : float
        Standard deviation of a measured force, as a share of it.
    area_proxy : AreaProxy, optional
        Calibrated law; without it areas are not used.
    """

    assumed_n: Annotated[Number, Field(ge=LIFTED_BELOW_N, le=HARDEST_N)] = 0.5
    assumed_sigma_n: NotNegative = 0.25
    axis_sigma: NotNegative = 0.05
    area_proxy: AreaProxy | None = None
    assumed: ForceEstimate = field(init=False, repr=False)

    def __post_init__(self) -> None:
        assumed = ForceEstimate(self.assumed_n, self.assumed_sigma_n, "assumed")
        object.__setattr__(self, "assumed", assumed)

    def estimate(
        self, normal_force_n: float | None, contact_area_m2: float | None
    ) -> ForceEstimate | None:
        """Force of a report, or None if the report has neither a usable force nor a usable area.

        Parameters
        ----------
        normal_force_n : float or None
            Force [N] in the report.
        contact_area_m2 : float or None
            Contact area [m^2] in the report.
        """
        if normal_force_n is not None and _usable(normal_force_n, LIFTED_BELOW_N, HARDEST_N):
            force = float(normal_force_n)
            return ForceEstimate(force, self.axis_sigma * force, "axis")
        if (
            self.area_proxy is not None
            and contact_area_m2 is not None
            and _usable(contact_area_m2, LEAST_AREA_M2, LARGEST_AREA_M2)
        ):
            return self.area_proxy.force(float(contact_area_m2))
        return None


def _usable(value: float, least: float, largest: float) -> bool:
    try:
        return bool(least <= value <= largest)
    except (TypeError, ValueError):
        return False
