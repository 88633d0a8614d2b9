"""Live fingers as functions of time, so that any window of a stream can be rendered again."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from haptix.checks import Array
from haptix.motion import History, Motion
from haptix.motion.reactions import React, unmoved
from haptix.render.core import Fingers
from haptix.render.live_fingers import MOST_ROWS, LiveFingers, repeated
from haptix.render.settings import LiveSettings
from haptix.touch import TouchEvent, TouchState, TouchTracker

_KNOT_S = 0.004  # between predictions; a line in between errs by 0.02 mm at 10 m/s^2


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
        decay = float(self.decay(np.float64(t_s)))
        dx, dy, df = self.offset
        return state.x_mm + decay * dx, state.y_mm + decay * dy, state.normal_force_n + decay * df

    def decay(self, t_s: Array | np.float64) -> Any:
        """Return what is left of the offset at times."""
        since = np.maximum(t_s - self.start_s, 0.0)
        return np.exp(-since / self.tracker.settings.blend_s)

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

    def gains(self, t_s: Array, settings: LiveSettings, at_rest: bool) -> Array | None:
        """Return that share at rising times, by straight lines; None where it is 0 at all."""
        last_s, fade_s = self._driven_until_s(settings, at_rest), settings.sliding.fade_s
        first_s, end_s = float(t_s[0]), float(t_s[-1])
        full_s = self.start_s + (1.0 - self.gain) * fade_s
        if full_s <= first_s and end_s <= last_s:
            return np.ones(t_s.size)
        bends = sorted((first_s, min(full_s, last_s), last_s, last_s + fade_s, end_s))
        heights = [self.gain_at(bend_s, settings, at_rest) for bend_s in bends]
        return np.interp(t_s, bends, heights) if any(heights) else None


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
        times = t0_s + step_s * np.arange(1.0, points + 1)
        end_s = t0_s + step_s * points
        knots = np.linspace(t0_s, end_s, 1 + max(1, int((end_s - t0_s) / _KNOT_S)))
        rows: list[tuple[Array, Array, Array, Array]] = []
        forces: list[float] = []
        velocities: list[tuple[float, float]] = []
        known: list[bool] = []
        histories: list[History] = []
        ids: list[int] = []
        fastest = 0.0
        for track in self._tracks.values():
            gain = track.gains(times, self._settings, self._at_rest)
            if gain is None:
                continue
            states = [track.ahead(t_s) for t_s in knots.tolist()]
            decay = track.decay(times)
            dx, dy, df = track.offset
            middle = states[len(states) // 2]
            x = np.interp(times, knots, [state.x_mm for state in states]) + dx * decay
            y = np.interp(times, knots, [state.y_mm for state in states]) + dy * decay
            rows.append((x, y, middle.normal_force_n + df * decay, gain))
            forces.append(middle.normal_force_n + df * float(decay[points // 2]))
            velocities.append((middle.vx_mm_s, middle.vy_mm_s))
            known.append(middle.force_source != "assumed")
            ids.append(track.tracker.touch_id)
            reactions = self._reactions.get(track.tracker)
            histories.append(() if reactions is None else reactions.history)
            fastest = max(fastest, middle.speed_mm_s)
        if not rows:
            return Fingers.none(points)
        x, y, force, gain = (np.concatenate(row) for row in zip(*rows, strict=True))
        motion = Motion(
            len(rows), points, x, y, force, fastest * step_s, step_s, since_s,
            lambda: repeated(velocities, points), tuple(known), tuple(histories),
        )  # fmt: skip
        per_row = forces if len(forces) <= MOST_ROWS else None
        return Fingers(motion, gain, per_row, tuple(ids))
