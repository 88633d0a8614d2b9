"""The renderer of recordings, whose touches are joined by straight lines."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from math import hypot, isnan, nan

import numpy as np

from haptix.checks import Array, number
from haptix.errors import InputError
from haptix.motion import VELOCITY_OVER_S, Motion, Report, Trajectory
from haptix.motion.reactions import React, Reactions, unmoved
from haptix.render.core import Fingers
from haptix.render.session import VirtualTimeSession
from haptix.render.settings import Sliding
from haptix.touch import ForceModel, TouchEvent, events_of
from haptix.touch.events import problem_of

LOST_S = 0.1
"""A finger without touches for so long, while others go on, counts as lifted."""

_ROUNDING_S = 1e-6  # of a clock: a fade continues over it


@dataclass
class Track:
    """One finger, from the touch up to which it is rendered."""

    touches: list[tuple[float, float, float, float]]
    """Time [s], place x and y [mm] and normal force [N]."""
    gains: list[tuple[float, float]]
    """Time [s], and share of its amplitude that the finger gets then."""
    speed_mm_per_s: float = 0.0
    is_sliding: bool = False
    is_down: bool = True
    force_known: bool = True
    reactions: Reactions = field(default_factory=Reactions)
    react: React = unmoved

    def fade(self, start_s: float, end_s: float, goal: float, fade_s: float) -> None:
        """Move the gain towards a goal during an interval."""
        gain = self.gains[-1][1]
        needs = abs(goal - gain) * fade_s
        if needs >= end_s - start_s:
            goal = gain + (goal - gain) * (end_s - start_s) / needs
        elif needs > 0:
            self.gains.append((start_s + needs, goal))
        self.gains.append((end_s, goal))

    def forget_before(self, t_s: float) -> None:
        """Drop what lies before `t_s`, except the start of the line through it."""
        for knots, until_s in ((self.touches, t_s - VELOCITY_OVER_S), (self.gains, t_s)):
            while len(knots) > 2 and knots[1][0] <= until_s:
                del knots[0]


class RecordedFingers:
    """Recorded touches of several fingers, each path known up to its last touch."""

    def __init__(self, sliding: Sliding) -> None:
        self._sliding = sliding
        self._tracks: dict[int, Track] = {}
        self._latest_s = -np.inf

    def touch(
        self,
        touch_id: int,
        t_s: float,
        x_mm: float,
        y_mm: float,
        normal_force_n: float,
        force_known: bool = True,
        react: React = unmoved,
        since_s: float = 0.0,
        at_rest: bool = False,
    ) -> None:
        """Take a checked touch; `InputError` if its time does not advance.

        `react` is that of the material, `since_s` the touch's time on the clock of samples; with
        `at_rest` a finger that rests gets drive too.
        """
        track = self._tracks.get(touch_id)
        if track is None or not track.is_down:
            if t_s < self._latest_s - LOST_S:
                raise InputError(
                    f"touch: time must advance, but {t_s:g} s follows {self._latest_s:g} s"
                )
            track = Track([(t_s, x_mm, y_mm, normal_force_n)], [(t_s, 0.0)])
            self._tracks[touch_id] = track
        else:
            before_s, before_x_mm, before_y_mm, _ = track.touches[-1]
            if t_s <= before_s:
                raise InputError(f"touch: time must advance, but {t_s:g} s follows {before_s:g} s")
            distance_mm = hypot(x_mm - before_x_mm, y_mm - before_y_mm)
            track.speed_mm_per_s = distance_mm / (t_s - before_s)
            track.is_sliding = at_rest or self._sliding.is_sliding(
                track.speed_mm_per_s, track.is_sliding
            )
            track.fade(before_s, t_s, float(track.is_sliding), self._sliding.fade_s)
            track.touches.append((t_s, x_mm, y_mm, normal_force_n))
        track.force_known = force_known
        force_n = normal_force_n if force_known else None
        track.react = react
        track.reactions.report(Report(since_s, x_mm, y_mm, force_n), react)
        self._latest_s = max(self._latest_s, t_s)

    def lift(self, touch_id: int, t_s: float, since_s: float = nan) -> None:
        """Lift a finger; its drive fades out. `since_s` is the time on the clock of samples."""
        track = self._tracks.get(touch_id)
        if track is None or not track.is_down:
            return
        track.is_down = False
        if not isnan(since_s):
            track.reactions.report(Report(since_s, nan, nan, None, is_down=False), track.react)
        fade_s, faded_until_s = self._sliding.fade_s, track.gains[-1][0]
        end_s = max(t_s, track.touches[-1][0])
        if end_s > faded_until_s:
            track.fade(faded_until_s, end_s, float(track.is_sliding), fade_s)
        track.fade(end_s, end_s + fade_s, 0.0, fade_s)
        self._latest_s = max(self._latest_s, t_s)

    @property
    def known_until_s(self) -> float:
        """Time up to which all fingers' paths are known."""
        for touch_id, track in self._tracks.items():
            last_s = track.touches[-1][0]
            if track.is_down and last_s < self._latest_s - LOST_S:
                self.lift(touch_id, last_s)
        down = [track.touches[-1][0] for track in self._tracks.values() if track.is_down]
        return min(down, default=self._latest_s)

    def motion(self, t_s: Array, step_s: float, since_s: float) -> Fingers:
        """Fingers at times one step apart, shape (points,); the first ends a step from `since_s`.

        Touches have a clock of their own; `since_s` is on that of samples, see `Motion`.
        """
        start_s = float(t_s[0])
        self._tracks = {
            touch_id: track
            for touch_id, track in sorted(self._tracks.items())
            if track.is_down or track.gains[-1][0] >= start_s
        }
        tracks = list(self._tracks.values())
        if not tracks:
            return Fingers.none(len(t_s))
        columns, paths = [], []
        for track in tracks:
            known_s, *places_and_force = zip(*track.touches, strict=True)
            lines = [np.interp(t_s, known_s, column) for column in places_and_force]
            paths.append((known_s, *places_and_force[:2]))
            columns.append([*lines, self._gain(track, t_s)])
            track.forget_before(float(t_s[-1]))
        x, y, force, gain = map(np.concatenate, zip(*columns, strict=True))
        fastest = max(track.speed_mm_per_s for track in tracks)
        motion = Motion(
            len(tracks), len(t_s), x, y, force, fastest * step_s, step_s, since_s,
            lambda: _velocities(t_s, paths), tuple(track.force_known for track in tracks),
            tuple(track.reactions.history for track in tracks),
        )  # fmt: skip
        return Fingers(motion, gain)

    def _gain(self, track: Track, t_s: Array) -> Array:
        """Gain at times. A fade continues for a microsecond, which covers a clock's rounding."""
        change = _ROUNDING_S / self._sliding.fade_s * (1 if track.is_sliding else -1)
        last_s, last = track.gains[-1]
        end = (last_s + _ROUNDING_S, min(max(last + change * track.is_down, 0.0), 1.0))
        knots_s, gains = zip(*track.gains, end, strict=True)
        return np.asarray(np.interp(t_s, knots_s, gains, left=0.0))


def _velocities(t_s: Array, paths: list[tuple[tuple[float, ...], ...]]) -> tuple[Array, Array]:
    """Mean velocities over the time before each point: what comes after is not known yet."""
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


_FORCE = ForceModel()
_LONG_S = 0.25  # a block of `play`: far longer than what numpy costs per call


class Renderer(VirtualTimeSession):
    """Renders a texture under recorded touches, which are joined by straight lines.

    Touches drive the clock. A touch that cannot be used raises `InputError`. Parameters are those
    of `RenderCore`.
    """

    def _reset(self) -> None:
        super()._reset()
        self._fingers = RecordedFingers(self.settings.sliding)

    def event(self, event: TouchEvent, arrival_s: float | None = None) -> None:
        """Take a touch event and render up to it; see `touch`."""
        self._take(event)
        self._render_known(self.points)
        self._heard(event)

    def play(self, path: Trajectory, touch_id: int = 0) -> None:
        """Render one finger's whole recorded path, in long blocks: the fastest way."""
        long = max(self.points, round(_LONG_S / self.step_s))
        for event in events_of(path, touch_id)[:-1]:  # without the lift: another path may follow
            self._take(event)
            self._render_known(long, least=long)
        self._render_known(long)

    def _take(self, event: TouchEvent) -> None:
        problem = problem_of(event)
        if problem is not None:
            raise InputError(problem)
        if event.kind == "up":
            number("touch: t_s of a lift", event.t_s)
            self._check_gap(event.t_s)
            self._fingers.lift(event.touch_id, event.t_s, event.t_s - (self._start_s or 0.0))
            return
        self._check_gap(event.t_s)
        found = _FORCE.estimate(event.normal_force_n, event.contact_area_m2)
        force = _FORCE.assumed if found is None else found
        place = (event.x_mm, event.y_mm)
        self._fingers.touch(
            event.touch_id,
            event.t_s,
            *place,
            force.normal_force_n,
            found is not None,
            self._felt[1].react,
            0.0 if self._start_s is None else event.t_s - self._start_s,
            self.drives_at_rest,
        )
        if self._start_s is None:
            self._start_s = event.t_s

    def _render_known(self, most: int, least: int = 1) -> None:
        """Render as far as all fingers' paths are known, in blocks of `least` to `most` points."""
        if self._start_s is None:
            return
        rate, step = self.sample_rate_hz, self.step
        # Clocks that count from 1970 resolve a few 1e-7 s: that must not cost a sample.
        end = int((self._fingers.known_until_s - self._start_s) * rate + 0.02)
        while (left := (end - self._next_sample) // step) >= least:
            began = time.perf_counter()
            ends = self._next_sample + step * np.arange(1, min(most, left) + 1)
            times = self._start_s + ends / rate
            self._send(self._fingers.motion(times, self.step_s, self._since_s), began)
