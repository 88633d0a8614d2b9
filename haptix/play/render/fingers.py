"""Fingers as functions of time: recorded, whose paths are known, and live, which are predicted."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from math import hypot, inf, isnan, nan
from typing import Any, NamedTuple

import numpy as np

from haptix.base.checks import Array
from haptix.base.errors import InputError
from haptix.base.native import DOUBLES, NULL, ffi, library
from haptix.feel.motion import VELOCITY_OVER_S, History, Motion, Report
from haptix.feel.motion.block import React, Reactions, unmoved
from haptix.play.render.samples import Fingers
from haptix.play.render.settings import LiveSettings, Sliding
from haptix.play.touch import Touches, TouchEvent, TouchTracker
from haptix.play.touch.touches import Predicted

LOST_S = 0.1
"""A recorded finger counts as lifted if it has no touch for this time while others go on."""

_ROUNDING_S = 1e-6  # of a clock; a fade continues for this time
_address, _line = ffi.from_buffer, library.hx_line


@dataclass
class _KnownTrack:
    """One recorded finger, from the last rendered touch on."""

    touches: Array
    """Time [s], place x and y [mm] and normal force [N], shape (4, touches)."""
    gains: list[tuple[float, float]]
    """Times [s] and the share of its amplitude that the finger gets then."""
    is_sliding: bool = False
    is_down: bool = True
    force_known: bool = True
    react: React = unmoved
    reports: deque[tuple[float, Report, React]] = field(default_factory=deque)
    """Reports that do not count yet, with their time [s] and the reaction of the material."""
    reactions: Reactions = field(default_factory=Reactions)

    def fade(self, start_s: float, end_s: float, goal: float, fade_s: float) -> None:
        """Move the gain towards a goal during an interval."""
        last_s, gain = self.gains[-1]
        if last_s < start_s:
            self.gains.append((start_s, gain))
        needs = abs(goal - gain) * fade_s
        if needs >= end_s - start_s:
            goal = gain + (goal - gain) * (end_s - start_s) / needs
        elif needs > 0:
            self.gains.append((start_s + needs, goal))
        self.gains.append((end_s, goal))

    def speed_mm_per_s(self, t_s: float) -> float:
        """Return the speed between the touches around a time."""
        t, x, y, _ = self.touches
        i = min(max(int(t.searchsorted(t_s)), 1), len(t) - 1)
        return hypot(x[i] - x[i - 1], y[i] - y[i - 1]) / float(t[i] - t[i - 1]) if i else 0.0

    def history_until(self, t_s: float) -> History:
        """Let the reports until a time count, and the first one after it.

        That one may show that a fact came about before the time.
        """
        while self.reports:
            at_s, report, react = self.reports.popleft()
            self.reactions.report(report, react)
            if at_s >= t_s:
                break
        return self.reactions.history

    def forget_before(self, t_s: float) -> None:
        """Drop touches and gains before `t_s`, except those where the line through it starts."""
        first = int(self.touches[0].searchsorted(t_s - VELOCITY_OVER_S, side="right")) - 1
        self.touches = self.touches[:, max(min(first, self.touches.shape[1] - 2), 0) :]
        while len(self.gains) > 2 and self.gains[1][0] <= t_s:
            del self.gains[0]


class RecordedFingers:
    """Recorded touches of several fingers, each path known up to its last touch."""

    def __init__(self, sliding: Sliding) -> None:
        self._sliding = sliding
        self.tracks: dict[int, _KnownTrack] = {}
        self._latest_s = -np.inf

    def touch(
        self,
        touch_id: int,
        t_s: float | Array,
        x_mm: float | Array,
        y_mm: float | Array,
        normal_force_n: float | Array,
        force_known: bool = True,
        react: React = unmoved,
        start_s: float = 0.0,
        at_rest: bool = False,
    ) -> None:
        """Take a checked touch, or a row of them; `InputError` if their time does not advance.

        `react` is that of the material, `start_s` the time of the first sample; with `at_rest` a
        finger that rests gets drive too.
        """
        touches = np.array([t_s, x_mm, y_mm, normal_force_n], dtype=np.float64).reshape(4, -1)
        first_s, joined = float(touches[0, 0]), touches
        track = self.tracks.get(touch_id)
        if track is not None and not track.is_down:
            track = None
        latest_s = self._latest_s if track is None else float(track.touches[0, -1])
        if first_s < latest_s - LOST_S if track is None else first_s <= latest_s:
            raise InputError(f"touch: time must advance, but {first_s:g} s follows {latest_s:g} s")
        if track is None:
            self.tracks[touch_id] = track = _KnownTrack(touches, [(first_s, 0.0)])
        else:
            joined = np.hstack([track.touches[:, -1:], touches])
            track.touches = np.hstack([track.touches, touches])
        t, x, y, _ = joined
        speeds = np.hypot(np.diff(x), np.diff(y)) / np.diff(t)
        sliding = self._sliding
        for i, speed in enumerate(speeds.tolist()):
            least = sliding.to_mm_per_s if track.is_sliding else sliding.from_mm_per_s
            track.is_sliding = at_rest or not sliding.is_needed or speed > least
            if track.gains[-1][1] != track.is_sliding:
                track.fade(float(t[i]), float(t[i + 1]), float(track.is_sliding), sliding.fade_s)
        track.force_known, track.react = force_known, react
        # A material that does not react needs the first and last report only.
        relevant = touches[:, [0, -1]] if react is unmoved else touches
        for at_s, x_at, y_at, force in relevant.T.tolist():
            report = Report(at_s - start_s, x_at, y_at, force if force_known else None)
            track.reports.append((at_s, report, react))
        self._latest_s = max(self._latest_s, float(t[-1]))

    def lift(self, touch_id: int, t_s: float, since_s: float = nan) -> None:
        """Lift a finger; its drive fades out. `since_s` is the time on the clock of samples."""
        track = self.tracks.get(touch_id)
        if track is None or not track.is_down:
            return
        track.is_down = False
        if not isnan(since_s):
            now = Report(since_s, nan, nan, None, is_down=False)
            track.reports.append((t_s, now, track.react))
        fade_s, faded_until_s = self._sliding.fade_s, track.gains[-1][0]
        end_s = max(t_s, float(track.touches[0, -1]))
        if end_s > faded_until_s:
            track.fade(faded_until_s, end_s, float(track.is_sliding), fade_s)
        track.fade(end_s, end_s + fade_s, 0.0, fade_s)
        self._latest_s = max(self._latest_s, t_s)

    @property
    def known_until_s(self) -> float:
        """Time up to which all fingers' paths are known."""
        for touch_id, track in self.tracks.items():
            last_s = float(track.touches[0, -1])
            if track.is_down and last_s < self._latest_s - LOST_S:
                self.lift(touch_id, last_s)
        down = [float(track.touches[0, -1]) for track in self.tracks.values() if track.is_down]
        return min(down, default=self._latest_s)

    def motion(
        self, t0_s: float, step_s: float, points: int, since_s: float, at_rest: bool = False
    ) -> Fingers:
        """Fingers at ``t0_s + step_s * (1 ... points)``, on the clock of touches.

        `since_s` is `t0_s` on the clock of samples, see `Motion`. `at_rest` has no effect: `touch`
        has determined whether a finger is driven at rest.
        """
        self.tracks = {
            touch_id: track
            for touch_id, track in sorted(self.tracks.items())
            if track.is_down or track.gains[-1][0] >= t0_s + step_s
        }
        tracks = list(self.tracks.values())
        if not tracks:
            return Fingers.none(points)
        end_s = t0_s + step_s * points
        lines = np.empty((4, len(tracks), points))
        fastest, paths, known, histories = 0.0, [], [], []
        for finger, track in enumerate(tracks):
            track.forget_before(t0_s)
            fastest = max(fastest, track.speed_mm_per_s(end_s))
            paths.append(track.touches)
            known.append(track.force_known)
            known_s, *places_and_force = track.touches
            knots = [*((known_s, line) for line in places_and_force), self._gains(track)]
            for value, (knot_s, line) in zip(lines[:, finger], knots, strict=True):
                at_s, at = _address(DOUBLES, knot_s), _address(DOUBLES, line)
                _line(at_s, at, len(line), t0_s, step_s, points, _address(DOUBLES, value))
            histories.append(track.history_until(end_s))
        x, y, force, gains = lines.reshape(4, -1)
        motion = Motion(
            len(tracks), points, x, y, force, fastest * step_s, step_s, since_s,
            lambda: _velocities(t0_s + step_s * np.arange(1.0, points + 1), paths),
            tuple(known), tuple(histories),
        )  # fmt: skip
        return Fingers(motion, gains)

    def _gains(self, track: _KnownTrack) -> tuple[Array, Array]:
        """Times and gains. A fade continues for a microsecond, which covers a clock's rounding."""
        change = _ROUNDING_S / self._sliding.fade_s * (1 if track.is_sliding else -1)
        last_s, last = track.gains[-1]
        end = (last_s + _ROUNDING_S, min(max(last + change * track.is_down, 0.0), 1.0))
        times, gains = np.array([*track.gains, end]).T.copy()
        return times, gains


def _velocities(t_s: Array, paths: list[Array]) -> tuple[Array, Array]:
    """Mean velocities [mm/s] over the time before each point, as a live finger would have them."""
    vx, vy = (
        np.concatenate(
            [
                np.interp(t_s, path[0], path[axis])
                - np.interp(t_s - VELOCITY_OVER_S, path[0], path[axis])
                for path in paths
            ]
        )
        / VELOCITY_OVER_S
        for axis in (1, 2)
    )
    return vx, vy


class _PredictedTrack(NamedTuple):
    """One finger from a time on, predicted by the reports until then; it never changes.

    Samples before that time followed an older prediction. The difference in place and force decays
    over `TouchSettings.blend_s`, and the gain continues from its last value.
    """

    now: Predicted
    """Prediction of the tracker at that time; a newer one is another object."""
    row: Any
    """Its ``hx_track``."""


class PredictedFingers:
    """Live fingers, predicted by the reports until the last `update`.

    New reports count from the next `update` on. Therefore appended samples continue the queued
    ones, and any window can be rendered again. One thread may take touches while another calls
    `motion`.
    """

    def __init__(self, settings: LiveSettings) -> None:
        self.touches = Touches(settings.touch, settings.strict)
        self._settings = settings
        self.tracks: dict[TouchTracker, _PredictedTrack] = {}
        self._reactions: dict[TouchTracker, Reactions] = {}
        self._at_rest = not settings.sliding.is_needed
        self._ahead_s: float | None = None  # clock of touches minus that of samples
        self._updated_s = self._driven_until_s = -inf
        self._following = settings.touch.compiled(settings.sliding.fade_s)[1]
        self._rows = ffi.new("hx_track[]", 0)
        self._known: tuple[bool, ...] = ()
        self._ids: tuple[int, ...] = ()

    @property
    def is_live(self) -> bool:
        """Whether a finger is on the screen, is fading out, or has drive in queued samples."""
        is_here = bool(self.tracks or self.touches.active)
        return is_here or self._updated_s < self._driven_until_s

    def update(self, t0_s: float) -> None:
        """Let all reports until now count, from a time on."""
        self._updated_s = t0_s
        down = [tracker for _, tracker in self.touches.active]
        tracks = self.tracks
        before = dict(tracks)
        for tracker in dict.fromkeys([*down, *tracks]):
            now, is_down, old = tracker.now, tracker.is_down, tracks.get(tracker)
            if old is not None and old.now is now and old.row.is_down == is_down:
                if not is_down and not library.hx_finger_gain(
                    self._following, old.row, self._at_rest, t0_s
                ):
                    del tracks[tracker]
                    self._reactions.pop(tracker, None)
                continue
            row = ffi.new("hx_track *", now.track[0])
            row.is_down = is_down
            was = NULL if old is None else old.row
            library.hx_finger_update(self._following, row, was, self._at_rest, t0_s)
            tracks[tracker] = _PredictedTrack(now, row)
        if tracks != before:
            self._rows = ffi.new("hx_track[]", [track.row[0] for track in tracks.values()])
            self._known = tuple(track.now.force.source != "assumed" for track in tracks.values())
            self._ids = tuple(tracker.touch_id for tracker in tracks)

    def take(
        self,
        event: TouchEvent,
        arrival_s: float | None = None,
        react: React = unmoved,
        is_kept: bool = True,
    ) -> Report | None:
        """Take a touch event, see `Touches.push`; a move of an unknown finger brings it down.

        `react` is that of the material, see `Evaluator`. The facts that it returns hold from the
        first time that can still be played; they are not kept where another one renders. Returns
        the report for `react`, or None for an event that was dropped.
        """
        kind = getattr(event, "kind", None)
        if kind == "move" and event.touch_id not in self.touches:
            event = event._replace(kind="down")
        touches = self.touches
        before = dict(touches.active)
        if not touches.push(event, arrival_s):
            return None
        touch_id = event.touch_id
        tracker = dict(touches.active).get(touch_id) or before[touch_id]
        playable_s = 0.0
        if self._ahead_s is None:
            self._ahead_s = tracker.last_t_s
        elif arrival_s is not None:
            playable_s = arrival_s + self._settings.reaction_s - self._ahead_s
        t_s = tracker.last_t_s - self._ahead_s
        if kind == "up":
            now = Report(t_s, nan, nan, None, is_down=False)
        else:
            force = touches.settings.force.estimate(event.normal_force_n, event.contact_area_m2)
            force_n = None if force is None else force.normal_force_n
            now = Report(t_s, float(event.x_mm), float(event.y_mm), force_n)
        if is_kept:
            self._reactions.setdefault(tracker, Reactions()).report(now, react, playable_s)
        return now

    def motion(
        self, t0_s: float, step_s: float, points: int, since_s: float, at_rest: bool = False
    ) -> Fingers:
        """Fingers at ``t0_s + step_s * (1 ... points)``, on the clock of touches.

        `since_s` is `t0_s` on the clock of samples, see `Motion`. With `at_rest` fingers that rest
        get drive too.
        """
        self._ahead_s = t0_s - since_s
        self._at_rest = at_rest or not self._settings.sliding.is_needed
        rows, known, ids = self._rows, self._known, self._ids
        count = len(ids)
        numbers = np.empty((4 * count + 1) * points + 3 * count + 1)
        at = _address(DOUBLES, numbers)
        n = library.hx_fingers(
            self._following, rows, count, t0_s, step_s, points, self._at_rest, at
        )
        if not n:
            return Fingers.none(points)
        self._driven_until_s = max(self._driven_until_s, t0_s + step_s * points)
        size = n * points
        per_finger = 4 * size + points  # index of the numbers that are not for each point
        trackers = list(self.tracks)
        if n < count:
            which = numbers[per_finger + 2 * n : per_finger + 3 * n].astype(int).tolist()
            known, ids = tuple(known[k] for k in which), tuple(ids[k] for k in which)
            trackers = [trackers[k] for k in which]
        reactions = self._reactions
        histories = tuple(
            [reactions[tracker].history if tracker in reactions else () for tracker in trackers]
        )
        motion = Motion(
            n, points, numbers[:size], numbers[size : 2 * size], numbers[2 * size : 3 * size],
            numbers.item(per_finger + 3 * n) * step_s, step_s, since_s,
            lambda: tuple(
                np.repeat(numbers[per_finger : per_finger + 2 * n].reshape(2, n), points, axis=1)
            ),
            known, histories,
        )  # fmt: skip
        return Fingers(motion, numbers[3 * size : 4 * size], ids)
