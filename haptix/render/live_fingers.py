"""Live fingers: predicted from the touches that have arrived so far."""

from __future__ import annotations

import numpy as np

from haptix.render.core import Motion
from haptix.render.settings import LiveSettings
from haptix.render.target import Array
from haptix.touch import Touches, TouchEvent, TouchTracker

_MOST_ROWS = 3


class LiveFingers:
    """Fingers at the control points of the next block.

    One thread may take touches while another asks for the motion.

    Parameters
    ----------
    settings : LiveSettings
        How touches are followed, how the drive fades, and whether a touch that cannot be used
        raises.
    """

    def __init__(self, settings: LiveSettings) -> None:
        self.touches = Touches(settings.touch, settings.strict)
        self._sliding = settings.sliding
        self._gains: dict[TouchTracker, float] = {}
        self._steps: Array = np.empty(0)

    def motion(self, t0_s: float, step_s: float, points: int) -> Motion:
        """Fingers at ``t0_s + step_s * (1 ... points)``."""
        down = [tracker for _, tracker in self.touches.active]
        gains = self._gains
        if not down and not gains:
            return Motion.none(points)
        for tracker in down:
            gains.setdefault(tracker, 0.0)
        most = step_s * points / self._sliding.fade_s
        starts: list[tuple[float, ...]] = []
        slopes: list[tuple[float, ...]] = []
        forces: list[float] = []
        fastest = 0.0
        for tracker, gain in list(gains.items()):
            part = tracker.path(t0_s, step_s, points)
            gets_drive = part.is_down and not part.is_lost
            gets_drive = gets_drive and (part.is_sliding or not self._sliding.is_needed)
            end = min(gain + most, 1.0) if gets_drive else max(gain - most, 0.0)
            if end == 0.0 and not part.is_down:
                del gains[tracker]
            else:
                gains[tracker] = end
            if gain == end == 0.0:
                continue
            starts.append((part.x_mm, part.y_mm, part.normal_force_n, gain))
            gain_slope = (end - gain) / (step_s * points)
            slopes.append((part.x_slope_mm_s, part.y_slope_mm_s, part.force_slope_n_s, gain_slope))
            forces.append(part.normal_force_n + part.force_slope_n_s * step_s * points / 2)
            fastest = max(fastest, part.speed_mm_s)
        if not starts:
            return Motion.none(points)
        if len(self._steps) != points:
            self._steps = np.arange(1.0, points + 1) * step_s
        start = np.array(starts, dtype=np.float64)
        slope = np.array(slopes, dtype=np.float64)
        lines: Array = start.T[:, :, None] + slope.T[:, :, None] * self._steps
        x, y, force, gain_at = lines.reshape(4, -1)
        # Rows of the surface pay for few fingers; for many, one batch of points is faster.
        rows = forces if len(forces) <= _MOST_ROWS else None
        return Motion(len(starts), points, x, y, force, gain_at, fastest * step_s, rows)

    def take(self, event: TouchEvent) -> None:
        """Take a touch event; a move of an unknown finger brings it down."""
        if event.kind == "move" and event.touch_id not in self.touches:
            event = event._replace(kind="down")
        self.touches.push(event)

    @property
    def newest_s(self) -> float | None:
        """Time stamp of the newest touch of a finger on the screen; None without one."""
        return max((tracker.last_t_s for _, tracker in self.touches.active), default=None)
