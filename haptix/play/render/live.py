"""The renderer of live touches: its windows, their revision, and the record of those played."""

from __future__ import annotations

import logging
import threading
import time
import warnings
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from typing import Any, Literal, Self

import numpy as np

from firmware_io import CurrentReading, Device, Playback
from firmware_io.clock import ready_interpreter
from firmware_io.own_thread import OwnThread, finger_report
from firmware_io.progress import MOST_MARKS
from firmware_io.revisable import Revisable
from haptix.base.checks import Array, whole
from haptix.base.errors import InputError, OverloadWarning
from haptix.feel.layout import Layout
from haptix.feel.materials import Feelable
from haptix.model.surface import FrictionSurface
from haptix.play.render.adapting import Adaptation
from haptix.play.render.drive import Drive
from haptix.play.render.engine import EngineSource
from haptix.play.render.fingers import PredictedFingers
from haptix.play.render.master import EffectEnd, Master, PlayingEffect
from haptix.play.render.played import PlayedRecord
from haptix.play.render.program import compile_core
from haptix.play.render.samples import RenderCore, RenderedBlock
from haptix.play.render.settings import LiveSettings
from haptix.play.render.stream import LONGEST_GAP_S, RenderStream
from haptix.play.sensing import FingerObserver
from haptix.play.touch import TouchCounts, TouchEvent
from haptix.play.touch.events import problem_of

_LOG = logging.getLogger("haptix.play.render")


class RenderSource:
    """Renders windows that continue the samples queued before them; see `firmware_io.Source`.

    Parameters
    ----------
    core : RenderCore
        Renders.
    fingers : PredictedFingers
        Where they are.
    master : Master
        Intensity and effects, and the time of the scene.
    count : callable
        Takes each block, the time that it took, and when its first sample is played.
    record : callable
        Returns the record of what is played, where one is kept.
    appended : callable
        Called with the index of the first of samples that are new to the driver, before they are
        sent, on the thread that owns the device.
    """

    def __init__(
        self,
        core: RenderCore,
        fingers: PredictedFingers,
        master: Master,
        count: Callable[[RenderedBlock, float, float], None],
        record: Callable[[], PlayedRecord | None] = lambda: None,
        appended: Callable[[int], None] = lambda first: None,
    ) -> None:
        self._core = core
        self._fingers = fingers
        self._master = master
        self._count = count
        self._record = record
        self._appended = appended
        self.since_s = 0.0
        """Time of the first sample: later than 0 where another one has played before."""
        self.amplitudes = Revisable()  # of the queued samples, at the start of each step
        self.amplitudes.append(np.zeros(1))

    @property
    def grid(self) -> int:
        """Samples in a step."""
        return self._core.step

    @property
    def is_live(self) -> bool:
        """Whether reports of fingers could still change the queued samples."""
        return self._fingers.is_live

    def window(self, first: int, count: int, at_s: float, is_revision: bool) -> Array:
        """Render samples from index `first` on, of which the first is played at `at_s`."""
        began = time.perf_counter()
        core, amplitudes = self._core, self.amplitudes
        step, points = first // core.step, count // core.step
        queued = None
        if is_revision:
            self._fingers.update(at_s)
            start = step + 1 - amplitudes.first
            queued = amplitudes.values[start : start + points]
        if core.adapted is not None:
            core.adapted.window(at_s, core.step_s, is_revision)
        since_s = self.since_s + first / core.sample_rate_hz
        mix = self._master.mix(since_s, core.step_s, points)
        fingers = self._fingers.motion(at_s, core.step_s, points, mix.since_s, core.drives_at_rest)
        block = core.block(fingers, first, amplitudes[step], queued, mix)
        if mix.effects:
            mix.mark(fingers.motion, fingers.gain)
        if is_revision:
            amplitudes.replace(step + 1, block.amplitude_v)
        else:
            amplitudes.append(block.amplitude_v)
            self._appended(first)
        if (record := self._record()) is not None:
            record.add(block, fingers, at_s, is_revision)
        self._count(block, time.perf_counter() - began, at_s)
        return block.drive_v

    def settle(self, obeyed: int, undone: bool) -> None:
        """Record that the oldest `obeyed` revisions were played, and with `undone` no other was."""
        self.amplitudes.accept(obeyed)
        if undone:
            self.amplitudes.undo()
        if (record := self._record()) is not None:
            record.settle(obeyed, undone)

    def played(self, index: int) -> None:
        """Drop the amplitudes before the sample `index`."""
        self.amplitudes.drop_before(index // self._core.step)


class LiveRenderer(RenderStream):
    """Renders live touches, whose paths it predicts. Pass each touch as it comes, with `now_s`.

    One thread renders and owns the device (`firmware_io.Playback`). It plays
    `LiveSettings.horizon_s` ahead, and after each touch renders the queued samples again. For a
    device in steps ("mock:pace=stepped") there is no thread. There `run_until`, and events with the
    time of their arrival, play the samples that are due by the device's clock, the same each time.

    Parameters are those of `RenderCore`, with `LiveSettings`, and:

    Parameters
    ----------
    sense : bool or FingerObserver
        Learn the finger from the current that it draws: from the driver's own readings, or those
        that `sensed` is given where the driver has no sensor. An observer may know whose
        finger it is. If false, nothing is computed. Experimental: no driver has a sensor yet.

    Warns
    -----
    OverloadWarning
        On leaving, if samples ran out, with what would help.
    """

    settings: LiveSettings
    _settings_kind = LiveSettings

    _playback: Playback | None = None
    _own: OwnThread | None = None
    _engine: EngineSource | None = None
    _compiled_felt: tuple[object, object] = (None, None)
    plays_by: Literal["engine", "interpreter"] = "interpreter"
    """Who makes the samples: the engine in C in a thread of its own, or Python."""
    _record: PlayedRecord | None = None
    taken: Callable[[TouchEvent], None] | None = None
    """`touch` and `lift` call it with each touch that they took."""

    def __init__(
        self,
        surface: FrictionSurface,
        texture: Feelable,
        device: Device,
        drive: Drive | None = None,
        settings: LiveSettings | None = None,
        sense: bool | FingerObserver = False,
    ) -> None:
        self._changing = threading.Lock()
        super().__init__(surface, texture, device, drive, settings or LiveSettings())
        self._clock = device.clock
        if sense is not False:
            self.adapted = Adaptation.of(sense, self.surface, self.drive)

    def sensed(self, reading: CurrentReading) -> None:
        """Take a reading of the current, which arrives now; its time is by `now_s`.

        Raises
        ------
        InputError
            If the renderer does not sense.
        """
        if self.adapted is None:
            raise InputError("sensed: expected a renderer that senses; make it with sense=True")
        if self.adapted.read(reading, self.now_s()):
            self._changed()
        self.stats.finger = self.adapted.estimate

    def _read_current(self) -> None:
        """Take what the driver's sensor has read, in the thread that plays."""
        if self.adapted is not None:
            self.adapted.look(self.now_s())
            for reading in self.device.readings():
                self.sensed(reading)
            self._check_sensor(self.adapted)

    def _check_sensor(self, adapted: Adaptation) -> None:
        # What the driver says of its sensor comes before its silence is long enough.
        if adapted.check(self.now_s(), self.device.sensor_problem):
            self.stats.finger = adapted.estimate
            self._changed()

    @property
    def record(self) -> PlayedRecord | None:
        """Record of what is played; set it to `PlayedRecord(renderer)` or None at any time.

        Only the interpreter keeps one.
        """
        return self._record

    @record.setter
    def record(self, record: PlayedRecord | None) -> None:
        self._record = record
        if record is not None:
            self._leave_own_thread()

    _begin: Callable[[OwnThread | None], None]
    _source: RenderSource

    def _reset(self) -> None:
        self._ahead_s: float | None = None  # clock of touches minus that of samples
        super()._reset()  # from now on another thread that changes a layout may read the time
        self._marks: deque[int] = deque()
        self._fingers = PredictedFingers(self.settings)
        if self.adapted is not None:
            self.adapted.reset()

    def __enter__(self) -> Self:
        self._prepare()
        self._source = source = RenderSource(
            self, self._fingers, self._master, self._count_window, lambda: self.record,
            self._place_marks,
        )  # fmt: skip
        times_s = self.settings.reaction_s, self.settings.horizon_s
        measures = self.device.capabilities.sense_rate_hz and self.device.mode == "envelope"
        self._reads_driver = bool(measures and self.adapted is not None)
        on_read = self._read_current if self._reads_driver else None
        if self.adapted is not None:
            if not measures:
                _LOG.warning(
                    "sense: %s reports no current: expected a sensor, and a carrier of the driver "
                    "(mode=envelope); `sensed` takes readings of another converter",
                    self.device.name,
                )
            self.stats.finger = self.adapted.known(self.now_s())

        def begin(own: OwnThread | None) -> None:
            self._own, self.plays_by = own, "interpreter" if own is None else "engine"
            writer = None if own is None else lambda: own
            playback = Playback(
                self.device, source, *times_s, stats=self.stats, on_read=on_read, writer=writer
            )
            playback.start()
            self._playback = playback

        # Collect garbage before the driver is armed: that takes long, and an armed driver needs
        # data.
        with ExitStack() as stack:
            stack.enter_context(ready_interpreter())
            begin(self._own_thread())
            self._interpreter = stack.pop_all()
        self._begin = begin
        return self

    def _own_thread(self) -> OwnThread | None:
        """Return the thread without the interpreter, if the settings want one and it can play."""
        self._engine, mix, felt = None, self._master.compiled, self._felt_now
        if not self.settings.own_thread:
            return None
        why = OwnThread.why_not(self.device)
        if self.adapted is not None or self.settings.keep_blocks or self.record is not None:
            why = "sensing, keep_blocks and record need it"
        if not why:
            try:
                compiled = compile_core(self, self.settings, moving=True)
                source = EngineSource(
                    compiled,
                    self.settings.reaction_s,
                    lambda effect: compile_core(self, self.settings, felt=effect.evaluator),
                )
            except InputError as error:
                why = str(error)
        if why:
            _LOG.info("own_thread: plays by the interpreter: %s", why)
            return None
        stats = self.stats
        source.mix(mix)
        self._engine, self._compiled_felt = source, felt

        def count(windows_s: list[float]) -> None:
            stats.block_s.extend(windows_s)
            counts = source.counts
            stats.samples = counts.samples
            stats.below = stats.above = stats.outside = 0
            stats.reached(counts.statuses)
            self.verified.played(counts.most_v)

        return OwnThread(self.device, source.compiled(self.step), stats, count)

    @property
    def reports(self) -> int | None:
        """File descriptor to which another process may write reports of fingers.

        `firmware_io.own_thread.finger_report` makes them. None unless a thread of its own plays.
        """
        return None if self._own is None or self._own.reports < 0 else self._own.reports

    def _leave_own_thread(self) -> None:
        """Let the interpreter go on, since something has changed that the engine does not follow.

        The output pauses at 0 V meanwhile; the time of the scene goes on.
        """
        if self._own is None or self._playback is None:
            return
        with self._changing:
            if self._own is None:
                return
            _LOG.warning("own_thread: goes on by the interpreter, since something is changed")
            self._playback.stop()
            self._source.since_s = self._samples_s
            self._engine = None
            self._begin(None)

    def _engine_follows(self) -> bool:
        """Hand the engine what has changed; return whether it can play that."""
        with self._changing:
            engine, mix, felt = self._engine, self._master.compiled, self._felt_now
            if engine is None:
                return False
            try:
                effects = self._master.effects
                if all(now is then for now, then in zip(felt, self._compiled_felt, strict=True)):
                    engine.mix(mix, effects)
                    return True
                compiled = compile_core(self, self.settings, moving=True, kept=engine.maps)
                engine.adopt(compiled, mix, effects)
            except InputError as error:
                _LOG.warning("own_thread: %s", error)
                return False
            self._compiled_felt = felt
            return True

    @property
    def _felt_now(self) -> tuple[object, object]:
        """What is felt, which is replaced when it changes."""
        evaluator = self._felt[1]
        return self._felt, evaluator.store.shown if isinstance(evaluator, Layout) else None

    @property
    def _samples_s(self) -> float:
        if self._own is not None and self._playback is not None:
            self._ahead_s = self._own.began_s or None
        if self._ahead_s is None:
            return 0.0
        return max(0.0, self.now_s() + self.settings.reaction_s - self._ahead_s)

    def __exit__(self, kind: Any, error: BaseException | None, traceback: Any) -> None:
        playback, self._playback = self._playback, None
        if playback is None:
            return
        self._interpreter.close()
        try:
            playback.__exit__(kind, error, traceback)
        finally:
            _LOG.info("%s ends: %s", type(self).__name__, self.stats)
            self._master.cut(self.next_sample_s, self.sample_rate_hz)
        if self.stats.advice and error is None:
            warnings.warn(f"the renderer {self.stats.advice}", OverloadWarning, stacklevel=2)

    def mark(self, code: int = 0) -> None:
        """Mark the next sample that the driver has not received yet.

        The driver's digital line rises with that sample, up to `LiveSettings.horizon_s` from now,
        and `Device.marked` has the time by the driver's clock. Marks that the driver has no room
        for wait.

        Raises
        ------
        InputError
            If the driver takes no marks.
        DeviceError
            If a thousand wait for room in a driver that the engine plays.
        """
        if not self.device.capabilities.takes_marks:
            raise InputError("mark: expected a driver that takes marks; update its firmware")
        if whole("code", code) >= 2**16:
            raise InputError(f"code: expected at most 65535, got {code}")
        if (own := self._own) is None:
            self._marks.append(code)
        else:
            own.mark(code)

    def _place_marks(self, first: int) -> None:
        while self._marks and self.device.marks_waiting < MOST_MARKS:
            self.device.mark(first, self._marks.popleft())

    def now_s(self) -> float:
        """Time of the device's clock, for the times of touches."""
        return self._clock()

    def run_until(self, t_s: float) -> None:
        """Wait until a time of the clock; a device in steps plays until then."""
        self._running().run_until(t_s)

    @property
    def scene_s(self) -> float:
        """Time of the scene now, which materials that change in time depend on."""
        samples_s = 0.0 if self._ahead_s is None else max(0.0, self.now_s() - self._ahead_s)
        return self._master.scene_s(samples_s)

    def event(self, event: TouchEvent, arrival_s: float | None = None) -> None:
        """Take a touch event; see `touch`.

        The event is taken at `arrival_s` of the clock; without that, now, or on a device in steps
        at the time of the touch.
        """
        playback = self._running()
        at_s = event.t_s if arrival_s is None and not playback.has_thread else arrival_s
        if at_s is not None and at_s - self.now_s() <= LONGEST_GAP_S:
            playback.run_until(at_s)
        self.events([event])

    def events(self, events: Sequence[TouchEvent]) -> None:
        """Take the touch events of several fingers, which are rendered together; see `touch`."""
        self._running().raise_once()
        self._take(events, self.now_s())

    def poll(self) -> list[EffectEnd]:
        """Report the effects that have ended; see `RenderStream.poll`.

        Raises
        ------
        LimitError, DeviceError
            Once, the error that has ended the output.
        """
        if self._playback is not None:
            self._playback.raise_once()
        return super().poll()

    def _running(self) -> Playback:
        if self._playback is None:
            raise InputError("touch: expected a renderer that was entered; use it in a with block")
        return self._playback

    def play(
        self, effect: Feelable, priority: int = 0, done: Callable[[EffectEnd], None] | None = None
    ) -> PlayingEffect:
        """Add an effect of finite length to the texture, for all fingers, from the next sample on.

        Parameters
        ----------
        effect : Material
            Such as `haptix.feel.Transient`; a share of the reachable friction. Its time and all
            events from which it may begin are now.
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
        return self._master.play(effect, lambda: self.next_sample_s, priority, done)

    def _take(self, events: Sequence[TouchEvent], arrival_s: float) -> None:
        """Take touch events, and report those that were used."""
        if (own := self._own) is not None:
            for event in events:
                if (data := self._as_bytes(event, arrival_s)) is not None:
                    own.report(data)
        react = self._felt[1].react
        used: list[tuple[TouchEvent, float | None]] = []
        try:
            for event in events:
                report = self._fingers.take(event, arrival_s, react, is_kept=own is None)
                if report is not None:
                    used.append((event, report.normal_force_n))
                elif getattr(event, "kind", None) == "up":
                    used.append((event, None))
        finally:
            if self.adapted is not None:
                fingers = [tracker for _, tracker in self._fingers.touches.active]
                self.adapted.follow(arrival_s, fingers)
            if own is None:
                self._touched(arrival_s)  # once, and before callbacks, which may take long
            for event, force_n in used:
                self._on_touch(event, force_n)

    def _as_bytes(self, event: TouchEvent, arrival_s: float) -> bytes | None:
        if problem_of(event) is not None:
            return None
        is_down, force = event.kind != "up", None
        if is_down:
            force = self.settings.touch.force.estimate(event.normal_force_n, event.contact_area_m2)
        return finger_report(
            event.touch_id, event.t_s, event.x_mm, event.y_mm,
            None if force is None else force.normal_force_n, is_down, arrival_s,
        )  # fmt: skip

    @property
    def touch_counts(self) -> TouchCounts:
        """Counts of the touches that were used, and of those that were dropped."""
        return self._fingers.touches.counts

    def _on_touch(self, event: TouchEvent, normal_force_n: float | None) -> None:
        if self.taken is not None:
            self.taken(event)
        super()._on_touch(event, normal_force_n)

    def _touched(self, now_s: float) -> None:
        # After the playback has ended, touches are taken without effect.
        if self._playback is not None and self._playback.is_running:
            self._playback.touch(now_s)

    def _changed(self) -> None:
        if not self._engine_follows():
            self._leave_own_thread()
        if self._playback is not None and self._fingers.touches.active:
            self._touched(self.now_s())

    def _count_window(self, block: RenderedBlock, seconds: float, at_s: float) -> None:
        self._count(block, seconds)
        if self.adapted is not None:
            if not self._reads_driver:  # after a stall, the driver's readings are still to be taken
                self._check_sensor(self.adapted)
            self.stats.finger = self.adapted.estimate
        self._ahead_s = at_s - block.first_sample / self.sample_rate_hz - self._source.since_s
