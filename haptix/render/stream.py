"""From touches to samples on a device: recorded as they are, or live, predicted and revised.

States of a renderer::

              with: limits are set, the device is armed, counts begin at 0
    outside ----------------------------------------------------------------> entered
       ^                                                                      |     |
       |  leaving: the output is at 0 V, effects that play are cut            |     |
       +----------------------------------------------------------------------+     |
       |                                                                            |
       |  leaving                       an error of the device, or of a limit: 0 V  |
       +--------------------- failed <----------------------------------------------+

While entered, the stream runs whether or not a finger touches. `mute` and `pause` fade to the
lowest friction, and a pause also stops the time of the scene. A live renderer that failed raises
the error once, at the next call; a recorded one raises it immediately. Both can be entered again.
"""

from __future__ import annotations

import logging
import time
import warnings
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from math import nan
from typing import Any, Self

import numpy as np

from firmware_io import CurrentReading, Device, Playback
from firmware_io.clock import ready_interpreter
from firmware_io.progress import MOST_MARKS
from haptix.checks import Array, instance, number, whole
from haptix.errors import InputError, LimitError, OverloadWarning
from haptix.layout import Layout, LayoutEvent, LayoutEventKind, Listeners
from haptix.motion import Report, Trajectory
from haptix.render.adapting import Adaptation
from haptix.render.drive import Drive, DriverCarrier
from haptix.render.fingers import PredictedFingers, RecordedFingers
from haptix.render.master import EffectEnd, Master, PlayingEffect
from haptix.render.played import PlayedRecord, RenderSource
from haptix.render.samples import RenderCore, RenderedBlock, RenderStats
from haptix.render.settings import LiveSettings, RenderSettings
from haptix.render.verified import VerifiedUse
from haptix.sensing import FingerObserver
from haptix.surface import FrictionSurface
from haptix.texture import Feelable, check_feelable
from haptix.touch import ForceModel, TouchCounts, TouchEvent
from haptix.touch.events import problem_of

_LOG = logging.getLogger("haptix.render")

LONGEST_GAP_S = 60.0
"""Longest pause between recorded touches that is rendered."""

_ASSUMED_N = ForceModel().assumed_n
_LONG_S = 0.25  # length of a block of `play`: long enough to hide the cost of calls of numpy


class RenderStream(RenderCore, ABC):
    """A context in which touches become samples on a device.

    Leaving the context ends at 0 V. So does a failing device: the next call raises its error once,
    and the renderer can be entered again.

    Parameters are those of `RenderCore`. The device's voltage ceiling is lowered to the surface's
    voltage limit.

    Raises
    ------
    LimitError
        On entering, if the surface's voltage limit is above the device's ceiling.
    """

    def __init__(
        self,
        surface: FrictionSurface,
        texture: Feelable,
        device: Device,
        drive: Drive | None = None,
        settings: RenderSettings | None = None,
    ) -> None:
        self._master = Master(self._changed)
        self._listeners: Listeners | None = None
        super().__init__(surface, texture, device, drive, settings)
        self.device = device
        self.verified = VerifiedUse(self.surface.info, self.drive.frequency_hz)
        """What leaves the range in which the screen was verified; `told` hears of it."""
        self._reset()

    def _reset(self) -> None:
        """Start again from rest, at sample 0, with empty counts."""
        self.stats = RenderStats()
        self.blocks: list[RenderedBlock] = []
        self._master.reset()
        self.verified.reset()
        if self._listeners is not None:
            self._listeners.forget()
        self._attach(self.texture)

    @property
    def intensity(self) -> float:
        """Intensity that the app asks for, 0 to 1: a share of the friction above the lowest."""
        return self._master.intensity

    @intensity.setter
    def intensity(self, share: float) -> None:
        self._master.turn(self._samples_s, intensity=share)

    @property
    def user_intensity(self) -> float:
        """Intensity that the user allows, 0 to 1; the app's is multiplied with it."""
        return self._master.user_intensity

    @user_intensity.setter
    def user_intensity(self, share: float) -> None:
        self._master.turn(self._samples_s, user_intensity=share)

    def mute(self) -> None:
        """Fade to the lowest friction in 5 ms; time goes on."""
        self._master.turn(self._samples_s, is_muted=True)

    def unmute(self) -> None:
        """Fade in again."""
        self._master.turn(self._samples_s, is_muted=False)

    def pause(self) -> None:
        """Fade out, and stop the time of materials and layouts until `resume`."""
        self._master.pause(self._samples_s)

    def resume(self) -> None:
        """Go on after a pause."""
        self._master.resume(self._samples_s)

    def on(self, kind: LayoutEventKind, callback: Callable[[LayoutEvent], None]) -> None:
        """Call a function at each "enter", "leave", "press", "release" or "detent" of a finger.

        `touch` and `lift` call it, in their thread. Reports cause events, never predictions. A
        finger whose force is not measured does not press.

        Parameters
        ----------
        kind : str
            The kind of event.
        callback : callable
            Takes the `LayoutEvent`.
        """
        if self._listeners is None:
            self._listeners = Listeners()
        self._listeners.on(kind, callback)

    def poll(self) -> list[EffectEnd]:
        """Return the effects that have ended since the last call, see `LiveRenderer.play`."""
        return self._master.ended(self.next_sample_s, self.sample_rate_hz)

    def _feel(self, texture: Feelable) -> None:
        check_feelable("texture", texture)
        self._attach(texture)
        super()._feel(texture)
        self._changed()

    def _changed(self) -> None:
        """React to a change of texture, intensity or effects; the next block has it."""

    def _attach(self, texture: Feelable) -> None:
        """Give a layout the clock of the stream."""
        if isinstance(layout := texture.evaluator, Layout):
            layout.attach(lambda: self.next_sample_s, self._changed)

    @property
    @abstractmethod
    def _samples_s(self) -> float:
        """Time of the next sample that can still be rendered, since the first."""

    def _on_touch(self, event: TouchEvent, normal_force_n: float | None) -> None:
        """Pass a touch to the layout and the callbacks, and end effects.

        `normal_force_n` is the measured force, or None if it is assumed.
        """
        is_down = event.kind != "up"
        x, y = (float(event.x_mm), float(event.y_mm)) if is_down else (nan, nan)
        _LOG.debug("touch %d %s at %.6f s, %g, %g mm", event.touch_id, event.kind, event.t_s, x, y)
        self.verified.touched(event, normal_force_n)
        texture, evaluator, _ = self._felt
        listeners, layout = self._listeners, evaluator if isinstance(evaluator, Layout) else None
        if listeners is not None or layout is not None:
            now = Report(self.next_sample_s, x, y, normal_force_n if is_down else None, is_down)
            if layout is not None:
                layout.report(event.touch_id, now)
            if listeners is not None:
                listeners.report(texture, event.touch_id, event.t_s, now)
        self.poll()

    def touch(
        self,
        t_s: float,
        x_mm: float,
        y_mm: float,
        normal_force_n: float | None = None,
        touch_id: int = 0,
        contact_area_m2: float | None = None,
    ) -> None:
        """Take a touch; in virtual time, render up to it.

        Parameters
        ----------
        t_s : float
            Time of the touch [s]; in real time by `LiveRenderer.now_s`.
        x_mm, y_mm : float
            Place on the screen.
        normal_force_n : float, optional
            Normal force [N], above 0. Without it, the force is estimated or assumed.
        touch_id : int
            Which finger.
        contact_area_m2 : float, optional
            Contact area [m^2], from which the force may be estimated.

        Raises
        ------
        InputError
            If a value cannot be used or time does not advance, unless `LiveSettings.strict` is
            off.
        LimitError, DeviceError
            If the device rejects the samples or fails; its output is then at 0 V.
        """
        self.event(TouchEvent(t_s, touch_id, x_mm, y_mm, "move", normal_force_n, contact_area_m2))

    def lift(self, t_s: float, touch_id: int = 0) -> None:
        """Take a finger off the screen.

        Parameters
        ----------
        t_s : float
        touch_id : int
        """
        self.event(TouchEvent(t_s, touch_id, 0.0, 0.0, "up"))

    @abstractmethod
    def event(self, event: TouchEvent, arrival_s: float | None = None) -> None:
        """Take any touch event; see `touch`.

        Parameters
        ----------
        event : TouchEvent
            What a finger did.
        arrival_s : float, optional
            Time of the clock [s] to wait for first, live; recordings take no notice of it.
        """

    def _prepare(self) -> None:
        """Check and set the device's limits, and reset."""
        limit, ceiling = self.surface.voltage_limit_v, self.device.limits.ceiling_v
        if limit > ceiling:
            raise LimitError(
                f"the surface asks for up to {limit:g} V, but the device allows {ceiling:g} V; "
                f"build the surface for voltages up to {ceiling:g} V, or open the device anew if "
                "an earlier surface has lowered its ceiling"
            )
        if limit < ceiling:
            self.device.lower_ceiling(limit)
        if isinstance(self.drive, DriverCarrier):
            self.device.set_up(carrier_hz=self.drive.frequency_hz)
        self._reset()
        _LOG.info("%s begins, up to %g V on %s", type(self).__name__, limit, self.device.name)

    @property
    def next_sample_s(self) -> float:
        """Time of the next sample since the first, without the pauses."""
        return self._master.scene_s(self._samples_s)

    def _count(self, block: RenderedBlock, seconds: float) -> None:
        self.stats.add(block, seconds)
        self.verified.played(float(block.amplitude_v.max(initial=0.0)))
        if self.settings.keep_blocks:
            self.blocks.append(block)


class Renderer(RenderStream):
    """Renders a texture under recorded touches, which are joined by straight lines.

    The touches are the clock: the first is sample 0, and each touch renders the samples up to it.
    Nothing is revised, so that a recording gives the same samples each time. A touch that cannot be
    used raises `InputError`. Parameters are those of `RenderCore`.

    Examples
    --------
    >>> import haptix
    >>> model = haptix.ContactModel(haptix.Finger(), haptix.Screen(), fidelity="closed-form")
    >>> surface = haptix.FrictionSurface.build(model, {"frequency_hz": 240.0}, 0.01)
    >>> ribs = haptix.texture.Grating(period_mm=2.0)
    >>> with haptix.open_device("mock:") as device, Renderer(surface, ribs, device) as renderer:
    ...     renderer.touch(0.0, x_mm=10.0, y_mm=20.0, normal_force_n=0.5)
    ...     renderer.touch(0.1, x_mm=15.0, y_mm=20.0, normal_force_n=0.5)
    >>> renderer.stats.samples > 0
    True
    """

    def _reset(self) -> None:
        super()._reset()
        self._fingers = RecordedFingers(self.settings.sliding)
        self._start_s: float | None = None
        self._next_sample = 0
        self._amplitude_v = 0.0

    def __enter__(self) -> Self:
        self._prepare()
        self.device.arm()
        return self

    def __exit__(self, kind: Any, error: BaseException | None, traceback: Any) -> None:
        _LOG.info("%s ends: %s", type(self).__name__, self.stats)
        self.device.__exit__(kind, error, traceback)
        self._master.cut(self.next_sample_s, self.sample_rate_hz)

    @property
    def _samples_s(self) -> float:
        return self._next_sample / self.sample_rate_hz

    def event(self, event: TouchEvent, arrival_s: float | None = None) -> None:
        """Take a touch event and render up to it; see `touch`."""
        self._take(event)
        self._render_known(self.points)
        self._on_touch(event, event.normal_force_n)

    def play(self, path: Trajectory, touch_id: int = 0) -> None:
        """Render one finger's whole recorded path, in long blocks: the fastest way.

        All of it is checked before any of it is rendered.

        Parameters
        ----------
        path : Trajectory
            Times, places and forces of the finger.
        touch_id : int
        """
        instance("path", path, Trajectory, "haptix.Trajectory.from_csv reads a file")
        columns = (path.t_s, path.x_mm, path.y_mm, path.normal_force_n)
        # Every check is a range of one column, so that it suffices to check the columns' extremes.
        ends = {int(end) for column in columns for end in (column.argmin(), column.argmax())}
        for i in sorted(ends):
            t_s, x_mm, y_mm, force_n = (float(column[i]) for column in columns)
            event = TouchEvent(t_s, touch_id, x_mm, y_mm, "move", force_n)
            if (problem := problem_of(event)) is not None:
                raise InputError(f"{problem}, in sample {i + 1}")
        self._follow(touch_id, *columns)
        self._render_known(max(self.points, round(_LONG_S / self.step_s)))

    def _take(self, event: TouchEvent) -> None:
        if (problem := problem_of(event)) is not None:
            raise InputError(problem)
        if event.kind == "up":
            number("touch: t_s of a lift", event.t_s)
            self._check_gap(event.t_s)
            self._fingers.lift(event.touch_id, event.t_s, event.t_s - (self._start_s or 0.0))
            return
        force_n = _ASSUMED_N if event.normal_force_n is None else event.normal_force_n
        place, is_known = (event.x_mm, event.y_mm), event.normal_force_n is not None
        self._follow(event.touch_id, event.t_s, *place, force_n, is_known)

    def _follow(
        self,
        touch_id: int,
        t_s: float | Array,
        x_mm: float | Array,
        y_mm: float | Array,
        normal_force_n: float | Array,
        force_known: bool = True,
    ) -> None:
        """Move a finger along touches that have been checked."""
        self._check_gap(t_s)
        start_s = float(np.min(t_s)) if self._start_s is None else self._start_s
        felt = self._felt[1]
        self._fingers.touch(
            touch_id, t_s, x_mm, y_mm, normal_force_n, force_known, felt.react, start_s,
            felt.drives_at_rest,
        )  # fmt: skip
        self._start_s = start_s

    def _render_known(self, most: int) -> None:
        """Render as far as all fingers' paths are known, in blocks of up to `most` points."""
        if self._start_s is None:
            return
        rate, step = self.sample_rate_hz, self.step
        # A clock that counts from 1970 resolves a few 1e-7 s, which must not cost a sample.
        end = int((self._fingers.known_until_s - self._start_s) * rate + 0.02)
        while (left := (end - self._next_sample) // step) > 0:
            began, first = time.perf_counter(), self._next_sample
            points, samples_s = min(most, left), first / rate
            mix = self._master.mix(samples_s, self.step_s, points)
            at_s = self._start_s + samples_s
            fingers = self._fingers.motion(at_s, self.step_s, points, mix.since_s)
            block = self.block(fingers, first, self._amplitude_v, mix=mix)
            if mix.effects:
                mix.mark(fingers.motion, fingers.gain)
            self._amplitude_v = float(block.amplitude_v[-1])
            self._next_sample += len(block.drive_v)
            self.device.write(block.drive_v)
            self._count(block, time.perf_counter() - began)

    def _check_gap(self, t_s: float | Array) -> None:
        """Refuse a touch that would render a long pause, as after a jump of the clock."""
        times = np.atleast_1d(t_s)
        before_s = times[0] if self._start_s is None else self._start_s + self._samples_s
        gap_s = float(np.diff(times, prepend=before_s).max())
        if gap_s > LONGEST_GAP_S:
            raise InputError(
                f"touch: expected a time within {LONGEST_GAP_S:g} s of what is rendered, got one "
                f"{gap_s:g} s later; is the clock in seconds? Enter the renderer anew after a pause"
            )


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
        that `sensed` is given where the driver has no sensor. An observer may have been told whose
        finger it is. Off, nothing is computed.

    Warns
    -----
    OverloadWarning
        On leaving, if samples ran out, with what would help.
    """

    settings: LiveSettings
    _settings_kind = LiveSettings

    _playback: Playback | None = None
    record: PlayedRecord | None = None
    """Record of what is played; set it to `PlayedRecord(renderer)` or None at any time."""
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

    def _reset(self) -> None:
        self._ahead_s: float | None = None  # clock of touches minus that of samples
        super()._reset()  # from now on another thread that changes a layout may read the time
        self._marks: deque[int] = deque()
        self._fingers = PredictedFingers(self.settings)
        if self.adapted is not None:
            self.adapted.reset()

    def __enter__(self) -> Self:
        self._prepare()
        source = RenderSource(
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
        playback = Playback(self.device, source, *times_s, stats=self.stats, on_read=on_read)
        # Collect garbage before the driver is armed: that takes long, and an armed driver needs
        # data.
        with ExitStack() as stack:
            stack.enter_context(ready_interpreter())
            playback.start()
            self._interpreter = stack.pop_all()
        self._playback = playback
        return self

    @property
    def _samples_s(self) -> float:
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
        """
        if not self.device.capabilities.takes_marks:
            raise InputError("mark: expected a driver that takes marks; update its firmware")
        if whole("code", code) >= 2**16:
            raise InputError(f"code: expected at most 65535, got {code}")
        self._marks.append(code)

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
        return self._master.play(effect, lambda: self.next_sample_s, priority, done)

    def _take(self, events: Sequence[TouchEvent], arrival_s: float) -> None:
        """Take touch events, and report those that were used."""
        react = self._felt[1].react
        used: list[tuple[TouchEvent, float | None]] = []
        try:
            for event in events:
                report = self._fingers.take(event, arrival_s, react)
                if report is not None:
                    used.append((event, report.normal_force_n))
                elif getattr(event, "kind", None) == "up":
                    used.append((event, None))
        finally:
            if self.adapted is not None:
                fingers = [tracker for _, tracker in self._fingers.touches.active]
                self.adapted.follow(arrival_s, fingers)
            self._touched(arrival_s)  # once, and before callbacks, which may take long
            for event, force_n in used:
                self._on_touch(event, force_n)

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
        if self._playback is not None and self._fingers.touches.active:
            self._touched(self.now_s())

    def _count_window(self, block: RenderedBlock, seconds: float, at_s: float) -> None:
        self._count(block, seconds)
        if self.adapted is not None:
            if not self._reads_driver:  # after a stall, the driver's readings are still to be taken
                self._check_sensor(self.adapted)
            self.stats.finger = self.adapted.estimate
        self._ahead_s = at_s - block.first_sample / self.sample_rate_hz
