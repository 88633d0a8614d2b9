"""The clock of touches: which stamps cannot be, and how an app's clock becomes the renderer's."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, Self

from haptix.checks import NotNegative, Positive, check_fields, number, positive
from haptix.errors import InputError

MARGIN_S = 0.02
"""A stamp may be so far ahead of its arrival, as clocks and drivers round."""

_UNITS = {"seconds": 1.0, "milliseconds": 1e3, "microseconds": 1e6, "nanoseconds": 1e9}
_LIKE = 60.0
"""A stamp within so many seconds of another clock was taken from that one."""

Misplaced = Literal["from_the_future", "stale"]
"""Kinds of stamps that cannot be, as `TouchCounts` names them."""


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
    said = (
        f"t_s: expected seconds of the renderer's clock (now_s(), in real time time.monotonic()), "
        f"from {(oldest_s + margin_s) * 1e3:.3g} ms ago to {margin_s * 1e3:.3g} ms ahead, got "
        f"{t_s:g}, which is {abs(off_s):.3g} s {'ahead' if off_s > 0 else 'old'}"
    )
    for clock, now_s in (("time.monotonic()", arrival_s), ("time.time()", time.time())):
        for unit, per_s in _UNITS.items():
            if abs(off_s) > _LIKE < now_s and abs(t_s / per_s - now_s) < _LIKE:
                return f"{said}; that is {clock} in {unit}: map it with haptix.touch.AppClock"
    return (
        f"{said}; map the clock of the stamps with haptix.touch.AppClock, or, if the program "
        "stalled, drop such touches with strict=False"
    )


@dataclass(frozen=True)
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
    offset_s: float
    uncertainty_s: NotNegative = 0.0

    def __post_init__(self) -> None:
        check_fields(self)

    @classmethod
    def measure(
        cls,
        read: Callable[[], float],
        unit_s: float = 1.0,
        now: Callable[[], float] = time.monotonic,
        duration_s: float = 0.05,
    ) -> Self:
        """Read the app's clock between two looks at the renderer's, again and again.

        Each reading bounds the offset from both sides. Where the bounds of two readings contradict
        each other, the app's clock ticks coarsely: it shows a past time, so the earliest of a tick
        counts, and the contradiction adds to the uncertainty.

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
        ran = at - first
        if not 0.5 < ran / (after_s - begun_s) < 2:
            raise InputError(
                f"unit_s: expected the unit of the app's clock, but by {unit_s:g} s it ran "
                f"{ran:.3g} s in {after_s - begun_s:.3g} s; milliseconds are 1e-3"
            )
        return cls(unit_s, highest - narrowest / 2, narrowest / 2 + max(0.0, lowest - highest))

    def t_s(self, stamp: Any) -> float:
        """Time of the renderer's clock [s] at a stamp of the app's."""
        return self.offset_s + self.unit_s * number("stamp", stamp)
