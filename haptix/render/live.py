"""Renderers of live touches: repeatable in virtual time, and in real time."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable
from math import inf, nan
from typing import Any, Self

import numpy as np

from firmware_io import Device
from haptix.checks import Array
from haptix.errors import InputError, OverloadWarning
from haptix.motion import History, Motion, Report
from haptix.motion.reactions import React, Reactions, unmoved
from haptix.render.core import Fingers
from haptix.render.drive import Drive
from haptix.render.master import Effect, Played
from haptix.render.producer import Producer
from haptix.render.session import LONGEST_GAP_S, RenderSession, VirtualTimeSession
from haptix.render.settings import LiveSettings
from haptix.surface import FrictionSurface
from haptix.texture import Feelable
from haptix.touch import TouchCounts, Touches, TouchEvent, TouchTracker

_MOST_ROWS = 3


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
        rows = forces if len(forces) <= _MOST_ROWS else None
        motion = Motion(
            len(starts), points, x, y, force, fastest * step_s, step_s, since_s,
            lambda: _repeated(velocities, points), tuple(known), tuple(histories),
        )  # fmt: skip
        return Fingers(motion, gain_at, rows)

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


def _repeated(velocities: list[tuple[float, float]], points: int) -> tuple[Array, Array]:
    vx, vy = np.repeat(np.array(velocities).T, points, axis=1)
    return vx, vy


class _LiveSession(RenderSession):
    """A session in which each block knows only the touches that have arrived, and predicts."""

    settings: LiveSettings
    _settings_kind = LiveSettings

    def __init__(
        self,
        surface: FrictionSurface,
        texture: Feelable,
        device: Device,
        drive: Drive | None = None,
        settings: LiveSettings | None = None,
    ) -> None:
        super().__init__(surface, texture, device, drive, settings or LiveSettings())

    def _reset(self) -> None:
        super()._reset()
        self._fingers = LiveFingers(self.settings)

    def _motion(self, t0_s: float) -> Fingers:
        """Fingers during the next block, which plays from `t0_s` on."""
        return self._fingers.motion(t0_s, self.step_s, self.points, self._since_s, self._at_rest)

    def play(
        self,
        effect: Feelable,
        priority: int = 0,
        done: Callable[[Played], None] | None = None,
    ) -> Effect:
        """Add an effect that ends to what all fingers feel, from the next sample on.

        Parameters
        ----------
        effect : Material
            Such as `haptix.materials.Transient`; a share of the reachable friction. Its time and
            all events from which it may begin are now.
        priority : int
            Of more than 8 at once, the oldest of the lowest priority is dropped.
        done : callable, optional
            Called with `Played` once the effect has been played, by the next `touch`, `lift` or
            `poll`, or on leaving.

        Raises
        ------
        InputError
            If the effect has no end, or is no share.
        """
        return self._master.play(effect, lambda: self._since_s, priority, done)

    def _take(self, event: TouchEvent, arrival_s: float) -> None:
        """Take a touch event, and tell what it did if it was one."""
        counts = self.touch_counts
        before = counts.taken
        self._fingers.take(event, arrival_s, self._felt[1].react)
        if counts.taken > before or getattr(event, "kind", None) == "up":
            self._heard(event)

    def _force_of(self, event: TouchEvent) -> float | None:
        found = self.settings.touch.force.estimate(event.normal_force_n, event.contact_area_m2)
        return None if found is None else found.normal_force_n

    @property
    def touch_counts(self) -> TouchCounts:
        """What became of the touches."""
        return self._fingers.touches.counts


class PredictingRenderer(_LiveSession, VirtualTimeSession):
    """Renders live touches in virtual time: a repeatable test of a real-time path.

    A block knows only the touches that had arrived when it would have been computed. Parameters
    are those of `LiveRenderer`.
    """

    def event(self, event: TouchEvent, arrival_s: float | None = None) -> None:
        """Take a touch event and render up to a lead after its arrival; see `touch`."""
        arrival_s = event.t_s if arrival_s is None else arrival_s
        if self.settings.strict:
            self._check_gap(arrival_s)
        elif self._gap_s(arrival_s) > LONGEST_GAP_S:
            self.touch_counts.invalid += 1
            return
        # What plays within the lead was computed before the event arrived.
        self._render_until(arrival_s + self.settings.lead_s)
        self._take(event, arrival_s)
        if self._start_s is None:
            self._start_s = self._fingers.newest_s

    def __exit__(self, kind: Any, error: BaseException | None, traceback: Any) -> None:
        try:
            if error is None:
                self._render_until(self._fingers.newest_s)
        finally:
            super().__exit__(kind, error, traceback)

    def _render_until(self, t_s: float | None) -> None:
        if self._start_s is None or t_s is None or not t_s < inf:
            return
        while (t0_s := self._start_s + self._next_sample / self.sample_rate_hz) <= t_s:
            began = time.perf_counter()
            self._send(
                self._motion(t0_s),
                began,
            )


class LiveRenderer(_LiveSession):
    """Renders live touches in real time.

    One thread renders, another owns the device (`firmware_io.Playback`), and touches are given as
    they come, stamped by `now_s`.

    Parameters are those of `RenderCore`, with `LiveSettings`.

    Warns
    -----
    OverloadWarning
        On leaving, if samples ran out: with late blocks, the longest stall, and a lead that would
        have held.
    """

    _producer: Producer | None = None

    def __enter__(self) -> Self:
        self._prepare()
        self.stats.lead_s = self.settings.lead_s
        samples = self.points * self.step
        producer = Producer(self.device, self._take_block, samples, self.settings.lead_s)
        producer.start()
        self._producer = producer
        return self

    def __exit__(self, kind: Any, error: BaseException | None, traceback: Any) -> None:
        producer, self._producer = self._producer, None
        if producer is None:
            return
        try:
            producer.stop(error)
        finally:
            self._take_stats(producer)
            self._master.cut(self._played_s, self.sample_rate_hz)
        if self.stats.advice and error is None:
            warnings.warn(f"the renderer {self.stats.advice}", OverloadWarning, stacklevel=2)

    def _take_stats(self, producer: Producer) -> None:
        played = producer.stats
        for name in ("underruns", "late_blocks", "stall_s", "holding_lead_s", "advice"):
            setattr(self.stats, name, getattr(played, name))

    def now_s(self) -> float:
        """Time of the clock by which touches are stamped."""
        return time.monotonic()

    def event(self, event: TouchEvent, arrival_s: float | None = None) -> None:
        """Take a touch event; see `touch`."""
        if self._producer is None:
            raise InputError("touch: expected a renderer that was entered; use it in a with block")
        self._producer.raise_once()
        self._take(event, self.now_s())

    def _take_block(self, t0_s: float) -> Array:
        """Render the samples that play from `t0_s` on."""
        began = time.perf_counter()
        block = self._render(self._motion(t0_s))
        self._count(block, time.perf_counter() - began)
        newest = self._fingers.newest_s
        if newest is not None:
            self.stats.add_touch_age(t0_s - newest)
        producer, counts = self._producer, (self.stats.underruns, self.stats.late_blocks)
        if producer is not None and producer.shortages != counts:
            self._take_stats(producer)
        return block.drive_v
