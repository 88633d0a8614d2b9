"""One block of the fingers' motion, and facts of what they did: all that a material depends on."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Flag, auto
from math import cos, inf, isnan, nan, sin
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from haptix.base.checks import Array
from haptix.base.errors import InputError
from haptix.base.fields import LIFTED_BELOW_N
from haptix.feel.motion.trajectory import Trajectory

SLOW_MM_PER_S = 2.0
"""At this speed and below, `Motion.ux` and `uy` are shorter than 1."""

Velocity = Callable[[], tuple[Array, Array]]
Reachable = Callable[[Array, Array], tuple[Array, Array]]
"""Lowest and highest friction coefficient at forces [N] and speeds [mm/s]."""


class Depends(Flag):
    """Quantities of a `Motion` that wanted friction depends on."""

    NOTHING = 0
    PLACE = auto()
    TIME = auto()
    DIRECTION = auto()
    SPEED = auto()
    FORCE = auto()
    FACTS = auto()


class Facts(NamedTuple):
    """Past events of one finger on a material: times [s] on the clock of `Motion.t_s`.

    A time is NaN until the event happens. Only real reports of a touch change facts, not
    predictions.
    """

    down_s: float = nan
    """Time at which the finger came down on the material."""
    press_s: float = nan
    """Time at which it last pressed."""
    release_s: float = nan
    """Time at which it last released."""
    detent: float = nan
    """Number of the last detent that it crossed."""
    detent_s: float = nan
    """Time at which it crossed that detent."""


class Report(NamedTuple):
    """One real report of a touch, in the axes of the material that it is on."""

    t_s: float
    """Time [s] on the clock of `Motion.t_s`."""
    x_mm: float
    y_mm: float
    normal_force_n: float | None
    """Normal force [N]; None if it was not measured."""
    is_down: bool = True
    """False once the finger is lifted, or has left the material."""


History = tuple[tuple[float, Facts], ...]
"""Facts of one finger in the order of time, each with the time [s] from which it holds."""


@dataclass(frozen=True, slots=True)
class LocalFrame:
    """Axes that lie, turn and move on the screen; numbers, or arrays of a motion's shape.

    Parameters
    ----------
    x_mm, y_mm : float or ndarray
        Their origin on the screen.
    angle_rad : float or ndarray
        How far they are turned, from x towards y.
    scale : float or ndarray
        Millimetres on the screen for one of theirs.
    vx_mm_s, vy_mm_s : float or ndarray
        Velocity of the origin.
    turn_rad_s : float or ndarray
        How fast they turn.
    growth_per_s : float or ndarray
        Rate of the scale's logarithm.

    Examples
    --------
    >>> frame = LocalFrame(x_mm=10.0, y_mm=20.0)
    >>> frame.angle_rad
    0.0
    """

    x_mm: float | Array = 0.0
    y_mm: float | Array = 0.0
    angle_rad: float | Array = 0.0
    scale: float | Array = 1.0
    vx_mm_s: float | Array = 0.0
    vy_mm_s: float | Array = 0.0
    turn_rad_s: float | Array = 0.0
    growth_per_s: float | Array = 0.0

    @property
    def is_still(self) -> bool:
        """Whether the axes neither move nor turn nor grow."""
        return all(
            isinstance(rate, float) and rate == 0.0
            for rate in (self.vx_mm_s, self.vy_mm_s, self.turn_rad_s, self.growth_per_s)
        )


class Motion:
    """Fingers during a block, at points one step apart; it never changes.

    Arrays have the shape (fingers * points,), finger after finger. Those of time and velocity are
    computed at first use, so that a material that depends on places alone does not pay for them.

    Parameters
    ----------
    fingers, points : int
        How many fingers touch, and at how many points.
    x_mm, y_mm : ndarray
        Places [mm]: x to the right, y down.
    normal_force_n : ndarray
        Normal forces [N].
    footprint_mm : float
        Distance that the fastest finger slides from one point to the next [mm]: of live fingers by
        the speed predicted for the middle of the block, of recorded ones by that at its end. Waves
        shorter than two footprints must be left out of an answer.
    step_s : float
        Time from one point to the next.
    start_s : float or ndarray
        Time one step before the first point, or the times of all points. It counts from the first
        sample of the output, by samples.
    velocity : callable, optional
        Returns velocities along x and y [mm/s]; without it the fingers rest. Of live fingers it is
        that of the prediction, of recorded ones the mean over the last 10 ms.
    force_known : tuple of bool, optional
        Of each finger: whether its force was measured, and not assumed. Without it, all were.
    history : tuple, optional
        Of each finger: its dated facts, see `History`.
    reachable : callable, optional
        What `reach` asks; a renderer states it before it asks a material.
    """

    __slots__ = (
        "_facts",
        "_history",
        "_speed",
        "_t_s",
        "_unit",
        "_v",
        "_velocity",
        "fingers",
        "footprint_mm",
        "force_known",
        "normal_force_n",
        "points",
        "reachable",
        "start_s",
        "step_s",
        "x_mm",
        "y_mm",
    )

    def __init__(
        self,
        fingers: int,
        points: int,
        x_mm: Array,
        y_mm: Array,
        normal_force_n: Array,
        footprint_mm: float,
        step_s: float,
        start_s: float | Array = 0.0,
        velocity: Velocity | None = None,
        force_known: tuple[bool, ...] | None = None,
        history: tuple[History, ...] = (),
        reachable: Reachable | None = None,
    ) -> None:
        self.fingers = fingers
        self.points = points
        self.x_mm = x_mm
        self.y_mm = y_mm
        self.normal_force_n = normal_force_n
        self.footprint_mm = footprint_mm
        self.step_s = step_s
        self.start_s = start_s
        self.force_known = force_known
        self._velocity = velocity
        self._history = history
        self.reachable = reachable
        self._t_s: Array | None = start_s if isinstance(start_s, np.ndarray) else None
        self._v: tuple[Array, Array] | None = None
        self._speed: Array | None = None
        self._unit: tuple[Array, Array] | None = None
        self._facts: Facts | None = None

    @classmethod
    def none(cls, points: int) -> Motion:
        """Return a block without fingers.

        Examples
        --------
        >>> Motion.none(4).fingers
        0
        """
        return cls(0, points, *(np.empty(0),) * 3, 0.0, 0.0)

    @classmethod
    def of(
        cls,
        x_mm: npt.ArrayLike,
        y_mm: npt.ArrayLike,
        t_s: npt.ArrayLike = 0.0,
        vx_mm_s: npt.ArrayLike = 0.0,
        vy_mm_s: npt.ArrayLike = 0.0,
        normal_force_n: npt.ArrayLike = 0.5,
        footprint_mm: float = 0.0,
        history: History = (),
        reachable: Reachable | None = None,
    ) -> Motion:
        """One finger, at places, times, velocities and forces that broadcast to one row.

        Parameters
        ----------
        x_mm, y_mm : array-like
        t_s : array-like
        vx_mm_s, vy_mm_s : array-like
        normal_force_n : array-like
        footprint_mm : float
            Diameter of the contact [mm]; 0 for a point.
        history : sequence
            Facts of the finger, each with the time [s] from which it holds.
        reachable : callable, optional
            Gives the reachable friction at forces and speeds.

        Raises
        ------
        InputError
            If these are not numbers, or are of shapes that do not broadcast.

        Examples
        --------
        >>> motion = Motion.of([1.0, 2.0], 20.0, vx_mm_s=30.0, vy_mm_s=40.0)
        >>> motion.speed_mm_s.tolist()
        [50.0, 50.0]
        """
        columns = (x_mm, y_mm, t_s, vx_mm_s, vy_mm_s, normal_force_n)
        try:
            rows = np.broadcast_arrays(*(np.asarray(a, dtype=np.float64) for a in columns))
        except (TypeError, ValueError):
            raise InputError("motion: expected numbers, or rows of them of one length") from None
        x, y, t, vx, vy, force = (np.atleast_1d(a).ravel() for a in rows)
        step_s = float(t[1] - t[0]) if len(t) > 1 else 0.0
        histories = (history,) if history else ()
        velocity = lambda: (vx, vy)  # noqa: E731
        return cls(
            1, len(x), x, y, force, footprint_mm, step_s, t, velocity, None, histories, reachable
        )  # fmt: skip

    @property
    def t_s(self) -> Array:
        """Times [s], counted in samples from the first of the output."""
        if self._t_s is None:
            ends = self.start_s + self.step_s * np.arange(1.0, self.points + 1)
            self._t_s = np.tile(ends, self.fingers)
        return self._t_s

    @property
    def _velocities(self) -> tuple[Array, Array]:
        if self._v is None:
            if self._velocity is None:
                self._v = (np.zeros(self.x_mm.shape),) * 2
            else:
                self._v = self._velocity()
        return self._v

    @property
    def vx_mm_s(self) -> Array:
        """Velocities along x [mm/s]."""
        return self._velocities[0]

    @property
    def vy_mm_s(self) -> Array:
        """Velocities along y [mm/s]."""
        return self._velocities[1]

    @property
    def speed_mm_s(self) -> Array:
        """Speeds [mm/s]."""
        if self._speed is None:
            self._speed = np.hypot(*self._velocities)
        return self._speed

    @property
    def _units(self) -> tuple[Array, Array]:
        if self._unit is None:
            vx, vy = self._velocities
            size = np.hypot(self.speed_mm_s, SLOW_MM_PER_S)
            self._unit = (vx / size, vy / size)
        return self._unit

    @property
    def ux(self) -> Array:
        """Directions along x, -1 to 1: ``v / hypot(v, 2 mm/s)``, so 0 at rest and smooth."""
        return self._units[0]

    @property
    def uy(self) -> Array:
        """Directions along y."""
        return self._units[1]

    @property
    def history(self) -> tuple[History, ...]:
        """Dated facts of each finger; empty if they are not known."""
        return self._history

    @property
    def facts(self) -> Facts:
        """Facts at each point; the fields are arrays instead of numbers."""
        if self._facts is None:
            rows = [
                _facts_at(history, times)
                for history, times in zip(
                    self._history or ((),) * self.fingers,
                    self.t_s.reshape(self.fingers, -1),
                    strict=True,
                )
            ]
            self._facts = Facts(*np.concatenate(rows, axis=1))
        return self._facts

    @property
    def reach(self) -> tuple[Array, Array]:
        """Lowest and highest friction coefficient that the screen gives at each point.

        Raises
        ------
        InputError
            If no renderer has set `reachable`.
        """
        if self.reachable is None:
            raise InputError("motion.reach: known only while a renderer asks; give friction as mu")
        return self.reachable(self.normal_force_n, self.speed_mm_s)

    def with_history(self, history: tuple[History, ...]) -> Motion:
        """Return the same motion with other facts, one history for each finger."""
        return self._at(self.x_mm, self.y_mm, self.footprint_mm, lambda: self._velocities, history)

    def at_places(self, x_mm: Array, y_mm: Array) -> Motion:
        """Return the same motion at other places.

        Parameters
        ----------
        x_mm, y_mm : array, shape (fingers * points,)

        Examples
        --------
        >>> moved = Motion.of([1.0, 2.0], 20.0).at_places(np.array([5.0, 6.0]), np.zeros(2))
        >>> moved.x_mm.tolist()
        [5.0, 6.0]
        """
        return self._at(x_mm, y_mm, self.footprint_mm, lambda: self._velocities, self._history)

    def begun_at(self, start_s: float, history: tuple[History, ...]) -> Motion:
        """Return the same motion on a clock that starts at a time, with facts on that clock.

        Parameters
        ----------
        start_s : float
            Time [s] on today's clock at which the other one is 0.
        history : tuple
            Facts of each finger, on the other clock.
        """
        motion = self.with_history(history)
        motion.start_s = self.start_s - start_s
        motion._t_s = None if self._t_s is None else self._t_s - start_s
        return motion

    def changed(
        self, t_s: Array | None, normal_force_n: Array | None, velocity: Velocity | None
    ) -> Motion:
        """Return the same motion at other times, forces or velocities; None keeps them.

        Parameters
        ----------
        t_s : array or None
        normal_force_n : array or None
        velocity : callable or None
            Gives the velocities [mm/s] along x and y.
        """
        motion = self._at(
            self.x_mm, self.y_mm, self.footprint_mm, velocity or (lambda: self._velocities),
            self._history,
        )  # fmt: skip
        if normal_force_n is not None:
            motion.normal_force_n = normal_force_n
        if t_s is not None:
            motion._t_s, motion.start_s = t_s, t_s
        return motion

    def with_footprint(self, footprint_mm: float) -> Motion:
        """Return the same motion with another footprint.

        Examples
        --------
        >>> Motion.of([1.0, 2.0], 20.0).with_footprint(0.5).footprint_mm
        0.5
        """
        return self._at(self.x_mm, self.y_mm, footprint_mm, lambda: self._velocities, self._history)

    def seen_from(self, frame: LocalFrame) -> Motion:
        """Return the motion in other axes; if these move, places and velocities are relative.

        The footprint is the longest relative way from one point to the next. A footprint of 0,
        which stands for all detail, stays 0.
        """
        x, y = self.x_mm - frame.x_mm, self.y_mm - frame.y_mm
        if frame.is_still:

            def still() -> tuple[Array, Array]:
                return _turned(*self._velocities, frame)

            footprint_mm = self.footprint_mm / float(frame.scale)
            return self._at(*_turned(x, y, frame), footprint_mm, still, self._history)
        vx = self.vx_mm_s - frame.vx_mm_s + frame.turn_rad_s * y - frame.growth_per_s * x
        vy = self.vy_mm_s - frame.vy_mm_s - frame.turn_rad_s * x - frame.growth_per_s * y
        relative = _turned(vx, vy, frame)
        fastest = float(np.hypot(*relative).max(initial=0.0)) if self.footprint_mm > 0 else 0.0
        return self._at(
            *_turned(x, y, frame), fastest * self.step_s, lambda: relative, self._history
        )

    def ahead(self, steps: Array, footprint_mm: float) -> Motion:
        """Return copies of each finger's points, moved along their paths by parts of a step.

        The copies follow each other, shape (len(steps) * fingers * points,).

        Parameters
        ----------
        steps : array, shape (copies,) or (copies, points)
            Parts of a step of the block to move by.
        footprint_mm : float
            Diameter of the contact of the copies [mm].
        """
        shape = (self.fingers, self.points)
        by = steps.reshape(len(steps), 1, -1)
        # A single point has no direction, and is not moved.
        moved = self.points > 1
        x, y = (
            (a + by * (np.gradient(a, axis=1) if moved else 0.0)).ravel()
            for a in (self.x_mm.reshape(shape), self.y_mm.reshape(shape))
        )
        count = len(steps)
        return Motion(
            count * self.fingers,
            self.points,
            x,
            y,
            np.tile(self.normal_force_n, count),
            footprint_mm,
            self.step_s,
            (self.t_s.reshape(shape) + self.step_s * by).ravel(),
            lambda: (np.tile(self.vx_mm_s, count), np.tile(self.vy_mm_s, count)),
            None if self.force_known is None else self.force_known * count,
            self._history * count,
            self.reachable,
        )

    def _at(
        self,
        x_mm: Array,
        y_mm: Array,
        footprint_mm: float,
        velocity: Velocity,
        history: tuple[History, ...],
    ) -> Motion:
        motion = Motion(
            self.fingers, self.points, x_mm, y_mm, self.normal_force_n, footprint_mm, self.step_s,
            self.start_s, velocity, self.force_known, history, self.reachable,
        )  # fmt: skip
        motion._t_s = self._t_s
        return motion


def _turned(x: Array, y: Array, frame: LocalFrame) -> tuple[Array, Array]:
    angle, scale = frame.angle_rad, frame.scale
    if isinstance(angle, np.ndarray):
        c, s = np.cos(angle) / scale, np.sin(angle) / scale
    elif angle != 0:
        c, s = np.asarray(cos(angle) / scale), np.asarray(sin(angle) / scale)
    elif isinstance(scale, float | int) and scale == 1:
        return x, y
    else:
        return x / scale, y / scale
    return x * c + y * s, y * c - x * s


def _facts_at(history: History, t_s: Array) -> Array:
    """Facts of one finger at times, shape (fields, points)."""
    rows = np.array([tuple(Facts()), *(tuple(facts) for _, facts in history)], dtype=np.float64)
    since = np.array([-inf, *(from_s for from_s, _ in history)])
    return np.asarray(rows[np.searchsorted(since, t_s, side="right") - 1].T)


React = Callable[[Facts, Report | None, Report], Facts]

_HISTORY_LENGTH = 64  # changes of facts of one finger; a block of a quarter second has fewer
_TIMES = ("down_s", "press_s", "release_s", "detent_s")


def unmoved(facts: Facts, before: Report | None, now: Report) -> Facts:
    """Return the facts unchanged, for a material that does not react.

    Parameters
    ----------
    facts : Facts
        Past events of the finger.
    before, now : Report
        Reports of it, which change nothing.
    """
    return facts


class Reactions:
    """The facts of one touch, from down to up: the last `kept` changes, or with None all changes.

    One thread may report while another reads `history`, because each report makes a new tuple.
    """

    def __init__(self, kept: int | None = _HISTORY_LENGTH) -> None:
        self._first_kept = 0 if kept is None else -kept
        self.history: History = ()
        self._last: Report | None = None

    def report(self, now: Report, react: React, from_s: float = nan) -> None:
        """Take a real report, on the clock of samples.

        The new facts hold from `from_s` on, the first time that can still be rendered. With NaN,
        for a recorded path, they hold from the time of the event.
        """
        history = self.history
        before = history[-1][1] if history else None
        facts = react(before or Facts(down_s=now.t_s), self._last, now)
        self._last = now
        if facts is before:
            return
        then = before or Facts()
        times = {name: (getattr(then, name), getattr(facts, name)) for name in _TIMES}
        new = {name: t_s for name, (earlier_s, t_s) in times.items() if _differ(t_s, earlier_s)}
        if before is not None and not new and not _differ(facts.detent, before.detent):
            return
        since_s = min((t_s for t_s in new.values() if not isnan(t_s)), default=now.t_s)
        if since_s < from_s:
            since_s = from_s
            facts = facts._replace(**{name: max(t_s, from_s) for name, t_s in new.items()})
        self.history = (*history[self._first_kept :], (since_s, facts))


def _differ(one: float, other: float) -> bool:
    return one != other and not (isnan(one) and isnan(other))


def facts_on(path: Trajectory, react: React, start_s: float) -> History:
    """Dated facts of a finger on a path; time 0 of the facts is `start_s` of the path."""
    reactions = Reactions(kept=None)
    columns = (path.t_s - start_s, path.x_mm, path.y_mm, path.normal_force_n)
    for t_s, x_mm, y_mm, force_n in zip(*(column.tolist() for column in columns), strict=True):
        is_down = force_n >= LIFTED_BELOW_N
        reactions.report(Report(t_s, x_mm, y_mm, force_n, is_down), react)
    return reactions.history
