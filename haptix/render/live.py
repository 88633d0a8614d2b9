"""Renderers of live touches: repeatable in virtual time, and in real time."""

from __future__ import annotations

import time
import warnings
from collections import deque
from collections.abc import Callable, Sequence
from math import inf
from typing import Any, Self

from firmware_io import Device
from firmware_io.marks import MOST_MARKS
from haptix.checks import Array, whole
from haptix.errors import InputError, OverloadWarning
from haptix.render.core import Fingers, RenderedBlock
from haptix.render.drive import Drive
from haptix.render.live_fingers import LiveFingers
from haptix.render.master import EffectEnd, PlayingEffect
from haptix.render.played import PlayedRecord
from haptix.render.producer import Producer
from haptix.render.revised import RevisedProducer, RevisedSource
from haptix.render.revised_fingers import RevisedFingers
from haptix.render.session import LONGEST_GAP_S, RenderSession, VirtualTimeSession
from haptix.render.settings import LiveSettings
from haptix.surface import FrictionSurface
from haptix.texture import Feelable
from haptix.touch import TouchCounts, TouchEvent


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
        return self._fingers.motion(
            t0_s, self.step_s, self.points, self._since_s, self.drives_at_rest
        )

    def play(
        self,
        effect: Feelable,
        priority: int = 0,
        done: Callable[[EffectEnd], None] | None = None,
    ) -> PlayingEffect:
        """Add an effect that ends to what all fingers feel, from the next sample on.

        Parameters
        ----------
        effect : Material
            Such as `haptix.materials.Transient`; a share of the reachable friction. Its time and
            all events from which it may begin are now.
        priority : int
            Of more than 8 at once, the oldest of the lowest priority is dropped.
        done : callable, optional
            Called with `EffectEnd` once the effect has been played, by the next `touch`, `lift` or
            `poll`, or on leaving.

        Raises
        ------
        InputError
            If the effect has no end, or is no share.
        """
        return self._master.play(effect, lambda: self._since_s, priority, done)

    def _take(self, events: Sequence[TouchEvent], arrival_s: float) -> None:
        """Take touch events, and tell what those did that were some."""
        counts, react = self.touch_counts, self._felt[1].react
        heard: list[TouchEvent] = []
        try:
            for event in events:
                before = counts.taken
                self._fingers.take(event, arrival_s, react)
                if counts.taken > before or getattr(event, "kind", None) == "up":
                    heard.append(event)
        finally:
            self._touched(arrival_s)  # once, and before callbacks, which may take long
            for event in heard:
                self._heard(event)

    def _touched(self, now_s: float) -> None:
        """Fingers have news since a time."""

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
        self._take([event], arrival_s)
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
    """Renders live touches in real time; they are given as they come, stamped by `now_s`.

    One thread renders and owns the device (`firmware_io.RevisedPlayback`). It plays
    `LiveSettings.horizon_s` ahead, and on each touch renders again what is played next. A driver
    that cannot revise is played `LiveSettings.lead_s` ahead, by two threads
    (`firmware_io.Playback`).

    Parameters are those of `RenderCore`, with `LiveSettings`.

    Warns
    -----
    OverloadWarning
        On leaving, if samples ran out, with what would help.
    """

    _producer: Producer | RevisedProducer | None = None
    record: PlayedRecord | None = None
    """What is played, where somebody takes it: set `PlayedRecord(renderer)`, or None, at any time.
    """
    taken: Callable[[TouchEvent], None] | None = None
    """Called with each touch that was taken, by `touch` and `lift`."""

    def _reset(self) -> None:
        super()._reset()
        self._marks: deque[int] = deque()
        self._ahead_s: float | None = None  # clock of touches minus that of samples
        if self._revises:
            self._fingers = RevisedFingers(self.settings)

    def __enter__(self) -> Self:
        self._prepare()
        producer = self._revised() if self._revises else self._fixed()
        producer.start()
        self._producer = producer
        return self

    @property
    def _revises(self) -> bool:
        return self.device.capabilities.guard_s > 0.0

    def _fixed(self) -> Producer:
        self.stats.lead_s = self.settings.lead_s
        samples = self.points * self.step
        return Producer(self.device, self._take_block, samples, self.settings.lead_s)

    def _revised(self) -> RevisedProducer:
        settings, fingers = self.settings, self._fingers
        assert isinstance(fingers, RevisedFingers)
        self.stats.lead_s = settings.reaction_s
        return RevisedProducer(
            self.device,
            RevisedSource(
                self,
                fingers,
                self._master.scene_s,
                self._count_window,
                lambda: self.record,
                self._place_marks,
            ),
            settings.reaction_s,
            settings.horizon_s,
        )

    @property
    def _samples_s(self) -> float:
        """Time of the next sample that can still be rendered, since the first."""
        if self._ahead_s is None:
            return super()._samples_s
        return max(0.0, self.now_s() + self.settings.reaction_s - self._ahead_s)

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

    def _take_stats(self, producer: Producer | RevisedProducer) -> None:
        played = producer.stats
        for name in vars(played).keys() & vars(self.stats).keys():
            setattr(self.stats, name, getattr(played, name))
        self.stats.advice = played.advice

    def mark(self, code: int = 0) -> None:
        """Let the driver tell when it plays the next sample that it has not been sent.

        Its digital line rises with that sample, up to `LiveSettings.horizon_s` from now, and
        `Device.marked` has the time by the driver's clock. More marks than a driver holds wait.

        Raises
        ------
        InputError
            If the driver takes no marks, or cannot revise.
        """
        if not (self._revises and self.device.capabilities.takes_marks):
            raise InputError(
                "mark: expected a driver that takes marks and can revise; update its firmware"
            )
        if whole("code", code) >= 2**16:
            raise InputError(f"code: expected at most 65535, got {code}")
        self._marks.append(code)

    def _place_marks(self, first: int) -> None:
        while self._marks and self.device.marks_waiting < MOST_MARKS:
            self.device.mark(first, self._marks.popleft())

    def reactions_s(self, most: int = 500) -> list[float]:
        """Return times from the last touches to the first samples that knew of them [s].

        Empty where nothing was touched yet, or the driver cannot revise.
        """
        producer = self._producer
        return producer.reactions_s(most) if isinstance(producer, RevisedProducer) else []

    def now_s(self) -> float:
        """Time of the clock by which touches are stamped."""
        return time.monotonic()

    @property
    def scene_s(self) -> float:
        """Time of the scene now: the one that materials which change in time are asked for."""
        if self._ahead_s is None:
            return self._master.scene_s(max(0.0, super()._samples_s - self.stats.lead_s))
        return self._master.scene_s(max(0.0, self.now_s() - self._ahead_s))

    def event(self, event: TouchEvent, arrival_s: float | None = None) -> None:
        """Take a touch event; see `touch`."""
        self.events([event])

    def events(self, events: Sequence[TouchEvent]) -> None:
        """Take the touch events of several fingers, which are rendered together; see `touch`."""
        producer = self._producer
        if producer is None:
            raise InputError("touch: expected a renderer that was entered; use it in a with block")
        producer.raise_once()
        now_s = self.now_s()
        self._take(events, now_s)
        revises = isinstance(producer, RevisedProducer)
        if revises and producer.shortages[0] != self.stats.underruns:
            self._take_stats(producer)

    def _heard(self, event: TouchEvent) -> None:
        if self.taken is not None:
            self.taken(event)
        super()._heard(event)

    def _touched(self, now_s: float) -> None:
        if isinstance(self._producer, RevisedProducer):
            self._producer.touch(now_s)

    def _changed(self) -> None:
        if self._producer is not None and self._fingers.touches.active:
            self._touched(self.now_s())

    def _count_window(self, block: RenderedBlock, seconds: float, at_s: float) -> None:
        self._count(block, seconds)
        self._take_age(at_s)
        self._ahead_s = at_s - block.first_sample / self.sample_rate_hz

    def _take_age(self, at_s: float) -> None:
        newest = self._fingers.newest_s
        if newest is not None:
            self.stats.add_touch_age(at_s - newest)

    def _take_block(self, t0_s: float) -> Array:
        """Render the samples that play from `t0_s` on."""
        began = time.perf_counter()
        fingers = self._motion(t0_s)
        block = self._render(fingers)
        if (record := self.record) is not None:
            record.add(block, fingers, t0_s)
        self._count(block, time.perf_counter() - began)
        self._take_age(t0_s)
        producer, counts = self._producer, (self.stats.underruns, self.stats.late_blocks)
        if isinstance(producer, Producer) and producer.shortages != counts:
            self._take_stats(producer)
        return block.drive_v
