"""Live fingers as functions of time, so that any window of a stream can be rendered again."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from math import exp
from typing import Any

import numpy as np

from haptix.checks import Array
from haptix.motion import History, Motion
from haptix.motion.reactions import React, unmoved
from haptix.render.core import Fingers
from haptix.render.live_fingers import MOST_ROWS, LiveFingers, repeated
from haptix.render.settings import LiveSettings
from haptix.touch import TouchEvent, TouchState, TouchTracker


@lru_cache(maxsize=8)
def _weights(points: int, step_s: float, blend_s: float) -> Array:
    """Weights of a prediction's begin, middle and end at points between, and of what decays.

    A parabola through predictions 10 ms apart errs by 2 um where the acceleration of 10 m/s^2 that
    they assume decays within 0.3 s.
    """
    at = np.arange(1.0, points + 1) / points
    decay = np.exp(-at * points * step_s / blend_s)
    return np.array([(2 * at - 1) * (at - 1), 4 * at * (1 - at), at * (2 * at - 1), decay])


@dataclass(frozen=True, slots=True)
class _Track:
    """One finger from a time on, as the reports until then predict it; it never changes.

    What was played before then was of an older prediction: the difference in place and force decays
    as in `TouchTracker.path`, and the gain goes on from where it was.
    """

    tracker: TouchTracker
    now: Any
    """What the tracker knew, by identity."""
    is_down: bool
    start_s: float
    offset: tuple[float, float, float]
    gain: float

    def ahead(self, t_s: float) -> TouchState:
        """Return the prediction for a time, without the offset."""
        return self.tracker.at(t_s, self.now)

    def place(self, t_s: float) -> tuple[float, float, float]:
        """Return place and force at a time."""
        state = self.ahead(t_s)
        dx, dy, df = self.left(t_s)
        return state.x_mm + dx, state.y_mm + dy, state.normal_force_n + df

    def left(self, t_s: float) -> tuple[float, float, float]:
        """Return what is left of the offset at a time."""
        dx, dy, df = self.offset
        decay = exp(-max(t_s - self.start_s, 0.0) / self.tracker.settings.blend_s)
        return decay * dx, decay * dy, decay * df

    def _driven_until_s(self, settings: LiveSettings, at_rest: bool) -> float:
        """Return until when the finger gets drive."""
        if not (self.is_down and (self.now[-1] or at_rest)):
            return self.start_s
        reported_s: float = self.now[0]
        return max(reported_s + settings.touch.lost_after_s, self.start_s)

    def gain_at(self, t_s: float, settings: LiveSettings, at_rest: bool) -> float:
        """Return the share of its amplitude that the finger gets at a time."""
        last_s, fade_s = self._driven_until_s(settings, at_rest), settings.sliding.fade_s
        risen = self.gain + max(min(t_s, last_s) - self.start_s, 0.0) / fade_s
        return max(min(risen, 1.0) - max(t_s - last_s, 0.0) / fade_s, 0.0)

    def gains(
        self, t0_s: float, step_s: float, points: int, settings: LiveSettings, at_rest: bool
    ) -> Array | None:
        """Return that share at ``t0_s + step_s * (1 ... points)``; None where it is 0 at all."""
        last_s, fade_s = self._driven_until_s(settings, at_rest), settings.sliding.fade_s
        first_s, end_s = t0_s + step_s, t0_s + step_s * points
        full_s = self.start_s + (1.0 - self.gain) * fade_s
        if full_s <= first_s and end_s <= last_s:
            return np.ones(points)
        bends = sorted((first_s, min(full_s, last_s), last_s, last_s + fade_s, end_s))
        heights = [self.gain_at(bend_s, settings, at_rest) for bend_s in bends]
        if not any(heights):
            return None
        return np.interp(t0_s + step_s * np.arange(1.0, points + 1), bends, heights)


class RevisedFingers(LiveFingers):
    """Fingers at the points of any window. Only a revision lets a new report count.

    So what is appended goes on from what is queued, and a window can be rendered again.
    """

    def __init__(self, settings: LiveSettings) -> None:
        super().__init__(settings)
        self._settings = settings
        self._tracks: dict[TouchTracker, _Track] = {}
        self._at_rest = not settings.sliding.is_needed

    @property
    def is_live(self) -> bool:
        """Whether a finger is on the screen, or still fades out."""
        return bool(self._tracks or self.touches.active)

    def update(self, t0_s: float) -> None:
        """Let what has been reported count from a time on."""
        down = [tracker for _, tracker in self.touches.active]
        tracks = self._tracks
        for tracker in dict.fromkeys([*down, *tracks]):
            now, is_down, old = tracker.now, tracker.is_down, tracks.get(tracker)
            if old is None:
                tracks[tracker] = _Track(tracker, now, is_down, t0_s, (0.0, 0.0, 0.0), 0.0)
                continue
            if old.now is now and old.is_down == is_down:
                if not is_down and not self._gain(old, t0_s):
                    del tracks[tracker]
                    self._reactions.pop(tracker, None)
                continue
            new = tracker.at(t0_s, now)
            x, y, force = old.place(t0_s)
            offset = (x - new.x_mm, y - new.y_mm, force - new.normal_force_n)
            if old.now[0] + self._settings.touch.lost_after_s < t0_s:
                offset = (0.0, 0.0, 0.0)  # it was lost: nothing was played
            tracks[tracker] = _Track(tracker, now, is_down, t0_s, offset, self._gain(old, t0_s))

    def _gain(self, track: _Track, t_s: float) -> float:
        return track.gain_at(t_s, self._settings, self._at_rest)

    def take(
        self, event: TouchEvent, arrival_s: float | None = None, react: React = unmoved
    ) -> None:
        """Take a touch event; what a material makes of it holds from when that can be played."""
        if arrival_s is not None and self._ahead_s is not None:
            self._next_s = arrival_s + self._settings.reaction_s - self._ahead_s
        super().take(event, arrival_s, react)

    def motion(
        self, t0_s: float, step_s: float, points: int, since_s: float, at_rest: bool = False
    ) -> Fingers:
        """Fingers at ``t0_s + step_s * (1 ... points)``; see `LiveFingers.motion`."""
        self._ahead_s = t0_s - since_s
        self._at_rest = at_rest or not self._sliding.is_needed
        half_s = step_s * points / 2
        weights = _weights(points, step_s, self._settings.touch.blend_s)
        rows: list[Array] = []
        gains: list[Array] = []
        forces: list[float] = []
        velocities: list[tuple[float, float]] = []
        known: list[bool] = []
        histories: list[History] = []
        ids: list[int] = []
        fastest = 0.0
        for track in self._tracks.values():
            gain = track.gains(t0_s, step_s, points, self._settings, self._at_rest)
            if gain is None:
                continue
            gains.append(gain)
            middle = track.ahead(t0_s + half_s)
            x0, y0 = track.tracker.place(t0_s, track.now)
            x1, y1 = track.tracker.place(t0_s + 2 * half_s, track.now)
            dx, dy, df = track.left(t0_s)
            force = middle.normal_force_n
            ends = ((x0, middle.x_mm, x1, dx), (y0, middle.y_mm, y1, dy), (force,) * 3 + (df,))
            rows.append(np.dot(ends, weights))
            forces.append(force + df * float(weights[3, points // 2]))
            velocities.append((middle.vx_mm_s, middle.vy_mm_s))
            known.append(middle.force_source != "assumed")
            ids.append(track.tracker.touch_id)
            reactions = self._reactions.get(track.tracker)
            histories.append(() if reactions is None else reactions.history)
            fastest = max(fastest, middle.speed_mm_s)
        if not rows:
            return Fingers.none(points)
        x, y, normal_force = rows[0] if len(rows) == 1 else np.concatenate(rows, axis=1)
        motion = Motion(
            len(rows), points, x, y, normal_force, fastest * step_s, step_s, since_s,
            lambda: repeated(velocities, points), tuple(known), tuple(histories),
        )  # fmt: skip
        per_row = forces if len(forces) <= MOST_ROWS else None
        gain = gains[0] if len(gains) == 1 else np.concatenate(gains)
        return Fingers(motion, gain, per_row, tuple(ids))
