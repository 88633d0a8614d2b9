"""Fingers that are on the screen now, at the points of the next block."""

from __future__ import annotations

from math import nan

import numpy as np

from haptix.checks import Array
from haptix.motion import History, Motion, Report
from haptix.motion.reactions import React, Reactions, unmoved
from haptix.render.core import Fingers
from haptix.render.settings import LiveSettings
from haptix.touch import Touches, TouchEvent, TouchTracker

MOST_ROWS = 3
"""Fingers up to which each has a row of the surface of its own."""


class LiveFingers:
    """Fingers at the control points of the next block.

    One thread may take touches while another asks for the motion.
    """

    def __init__(self, settings: LiveSettings) -> None:
        self.touches = Touches(settings.touch, settings.strict)
        self._sliding = settings.sliding
        self._gains: dict[TouchTracker, float] = {}
        self._reactions: dict[TouchTracker, Reactions] = {}
        self._next_s = 0.0  # the next block's start on the clock of samples,
        self._ahead_s: float | None = None  # and that of touches minus that of samples
        self._steps: Array = np.empty(0)

    def motion(
        self, t0_s: float, step_s: float, points: int, since_s: float, at_rest: bool = False
    ) -> Fingers:
        """Fingers at ``t0_s + step_s * (1 ... points)``; `at_rest`, those that rest get drive too.

        Touches have a clock of their own; `since_s` is `t0_s` on that of samples, see `Motion`.
        """
        self._next_s, self._ahead_s = since_s + step_s * points, t0_s - since_s
        at_rest = at_rest or not self._sliding.is_needed
        down = [tracker for _, tracker in self.touches.active]
        gains = self._gains
        if not down and not gains:
            return Fingers.none(points)
        for tracker in down:
            gains.setdefault(tracker, 0.0)
        most = step_s * points / self._sliding.fade_s
        starts: list[tuple[float, ...]] = []
        slopes: list[tuple[float, ...]] = []
        forces: list[float] = []
        velocities: list[tuple[float, float]] = []
        known: list[bool] = []
        histories: list[History] = []
        ids: list[int] = []
        fastest = 0.0
        for tracker, gain in list(gains.items()):
            part = tracker.path(t0_s, step_s, points)
            gets_drive = part.is_down and not part.is_lost
            gets_drive = gets_drive and (part.is_sliding or at_rest)
            end = min(gain + most, 1.0) if gets_drive else max(gain - most, 0.0)
            if end == 0.0 and not part.is_down:
                del gains[tracker]
                self._reactions.pop(tracker, None)
            else:
                gains[tracker] = end
            if gain == end == 0.0:
                continue
            starts.append((part.x_mm, part.y_mm, part.normal_force_n, gain))
            gain_slope = (end - gain) / (step_s * points)
            slopes.append((part.x_slope_mm_s, part.y_slope_mm_s, part.force_slope_n_s, gain_slope))
            forces.append(part.normal_force_n + part.force_slope_n_s * step_s * points / 2)
            velocities.append((part.vx_mm_s, part.vy_mm_s))
            known.append(part.force_known)
            ids.append(tracker.touch_id)
            reactions = self._reactions.get(tracker)
            histories.append(() if reactions is None else reactions.history)
            fastest = max(fastest, part.speed_mm_s)
        if not starts:
            return Fingers.none(points)
        if len(self._steps) != points:
            self._steps = np.arange(1.0, points + 1) * step_s
        start = np.array(starts, dtype=np.float64)
        slope = np.array(slopes, dtype=np.float64)
        lines: Array = start.T[:, :, None] + slope.T[:, :, None] * self._steps
        x, y, force, gain_at = lines.reshape(4, -1)
        # Rows of the surface pay for few fingers; for many, one batch of points is faster.
        rows = forces if len(forces) <= MOST_ROWS else None
        motion = Motion(
            len(starts), points, x, y, force, fastest * step_s, step_s, since_s,
            lambda: repeated(velocities, points), tuple(known), tuple(histories),
        )  # fmt: skip
        return Fingers(motion, gain_at, rows, tuple(ids))

    def take(
        self, event: TouchEvent, arrival_s: float | None = None, react: React = unmoved
    ) -> None:
        """Take a touch event, see `Touches.push`; a move of an unknown finger brings it down.

        `react` is that of the material, see `Evaluator`.
        """
        kind = getattr(event, "kind", None)
        if kind == "move" and event.touch_id not in self.touches:
            event = event._replace(kind="down")
        touches = self.touches
        before = dict(touches.active)
        if not touches.push(event, arrival_s):
            return
        touch_id = event.touch_id
        tracker = dict(touches.active).get(touch_id) or before.get(touch_id)
        if tracker is None:
            return
        if self._ahead_s is None:
            self._ahead_s = tracker.last_t_s
        t_s = tracker.last_t_s - self._ahead_s
        if kind == "up":
            now = Report(t_s, nan, nan, None, is_down=False)
        else:
            force = touches.settings.force.estimate(event.normal_force_n, event.contact_area_m2)
            force_n = None if force is None else force.normal_force_n
            now = Report(t_s, float(event.x_mm), float(event.y_mm), force_n)
        self._reactions.setdefault(tracker, Reactions()).report(now, react, self._next_s)

    @property
    def newest_s(self) -> float | None:
        """Time stamp of the newest touch of a finger on the screen; None without one."""
        return max((tracker.last_t_s for _, tracker in self.touches.active), default=None)


def repeated(velocities: list[tuple[float, float]], points: int) -> tuple[Array, Array]:
    """Return one velocity for each finger at all points."""
    vx, vy = np.repeat(np.array(velocities).T, points, axis=1)
    return vx, vy
