"""Recorded fingers: touches joined by straight lines."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import hypot

import numpy as np

from haptix.errors import InputError
from haptix.render.motion import Array, Motion
from haptix.render.settings import Sliding

LOST_S = 0.1
"""A finger without touches for so long, while others go on, counts as lifted."""

_ROUNDING_S = 1e-6  # of a clock: a fade continues over it


@dataclass
class Track:
    """One finger, from the touch up to which it is rendered."""

    t_s: list[float]
    x_mm: list[float]
    y_mm: list[float]
    normal_force_n: list[float]
    gain_t_s: list[float]
    gain: list[float] = field(default_factory=lambda: [0.0])
    speed_mm_per_s: float = 0.0
    is_sliding: bool = False
    is_down: bool = True

    def fade(self, start_s: float, end_s: float, goal: float, fade_s: float) -> None:
        """Move the gain towards a goal during an interval."""
        gain = self.gain[-1]
        needs = abs(goal - gain) * fade_s
        if needs < end_s - start_s:
            if needs > 0:
                self.gain_t_s.append(start_s + needs)
                self.gain.append(goal)
        else:
            goal = gain + (goal - gain) * (end_s - start_s) / needs
        self.gain_t_s.append(end_s)
        self.gain.append(goal)

    def forget_before(self, t_s: float) -> None:
        """Drop what lies before `t_s`, except the start of the line through it."""
        while len(self.t_s) > 2 and self.t_s[1] <= t_s:
            for column in (self.t_s, self.x_mm, self.y_mm, self.normal_force_n):
                del column[0]
        while len(self.gain_t_s) > 2 and self.gain_t_s[1] <= t_s:
            del self.gain_t_s[0], self.gain[0]


class RecordedFingers:
    """Recorded touches of several fingers, each path known up to its last touch.

    Parameters
    ----------
    sliding : Sliding
        When a finger gets the drive.
    """

    def __init__(self, sliding: Sliding) -> None:
        self._sliding = sliding
        self._tracks: dict[int, Track] = {}
        self._latest_s = -np.inf

    def touch(
        self, touch_id: int, t_s: float, x_mm: float, y_mm: float, normal_force_n: float
    ) -> None:
        """Take a checked touch.

        Raises
        ------
        InputError
            If its time does not advance.
        """
        track = self._tracks.get(touch_id)
        if track is None or not track.is_down:
            if t_s < self._latest_s - LOST_S:
                raise InputError(
                    f"touch: time must advance, but {t_s:g} s follows {self._latest_s:g} s"
                )
            self._tracks[touch_id] = Track([t_s], [x_mm], [y_mm], [normal_force_n], [t_s])
        else:
            before_s = track.t_s[-1]
            if t_s <= before_s:
                raise InputError(f"touch: time must advance, but {t_s:g} s follows {before_s:g} s")
            distance_mm = hypot(x_mm - track.x_mm[-1], y_mm - track.y_mm[-1])
            track.speed_mm_per_s = distance_mm / (t_s - before_s)
            track.is_sliding = self._sliding.is_sliding(track.speed_mm_per_s, track.is_sliding)
            track.fade(before_s, t_s, float(track.is_sliding), self._sliding.fade_s)
            for column, value in zip(
                (track.t_s, track.x_mm, track.y_mm, track.normal_force_n),
                (t_s, x_mm, y_mm, normal_force_n),
                strict=True,
            ):
                column.append(value)
        self._latest_s = max(self._latest_s, t_s)

    def lift(self, touch_id: int, t_s: float) -> None:
        """Lift a finger; its drive fades out."""
        track = self._tracks.get(touch_id)
        if track is None or not track.is_down:
            return
        track.is_down = False
        end_s = max(t_s, track.t_s[-1])
        if end_s > track.gain_t_s[-1]:
            track.fade(track.gain_t_s[-1], end_s, float(track.is_sliding), self._sliding.fade_s)
        track.fade(end_s, end_s + self._sliding.fade_s, 0.0, self._sliding.fade_s)
        self._latest_s = max(self._latest_s, t_s)

    @property
    def known_until_s(self) -> float:
        """Time up to which all fingers' paths are known."""
        for touch_id, track in self._tracks.items():
            if track.is_down and track.t_s[-1] < self._latest_s - LOST_S:
                self.lift(touch_id, track.t_s[-1])
        down = [track.t_s[-1] for track in self._tracks.values() if track.is_down]
        return min(down, default=self._latest_s)

    def motion(self, t_s: Array, step_s: float) -> Motion:
        """Fingers at times one step apart, shape (points,)."""
        start_s = float(t_s[0])
        for touch_id in [i for i, one in self._tracks.items() if not one.is_down]:
            if self._tracks[touch_id].gain_t_s[-1] < start_s:
                del self._tracks[touch_id]
        if not self._tracks:
            return Motion.none(len(t_s))
        tracks = [self._tracks[i] for i in sorted(self._tracks)]
        columns = [
            [np.interp(t_s, track.t_s, getattr(track, name)) for track in tracks]
            for name in ("x_mm", "y_mm", "normal_force_n")
        ]
        gain = [self._gain(one, t_s) for one in tracks]
        for track in tracks:
            track.forget_before(float(t_s[-1]))
        x, y, force = (np.concatenate(column) for column in columns)
        fastest = max(track.speed_mm_per_s for track in tracks)
        return Motion(len(tracks), len(t_s), x, y, force, np.concatenate(gain), fastest * step_s)

    def _gain(self, track: Track, t_s: Array) -> Array:
        """Gain at times. A fade continues for a microsecond, which covers a clock's rounding."""
        change = _ROUNDING_S / self._sliding.fade_s * (1 if track.is_sliding else -1)
        last = min(max(track.gain[-1] + change * track.is_down, 0.0), 1.0)
        knots = [*track.gain_t_s, track.gain_t_s[-1] + _ROUNDING_S]
        return np.interp(t_s, knots, [*track.gain, last], left=0.0)
