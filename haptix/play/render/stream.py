"""From touches to samples on a device: what all renderers share, and the one of recorded touches.

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
from abc import ABC, abstractmethod
from collections.abc import Callable
from math import nan
from typing import Any, Self

import numpy as np

from firmware_io import Device
from haptix.base.checks import Array, instance, number
from haptix.base.errors import InputError, LimitError
from haptix.feel.layout import Layout, LayoutEvent, LayoutEventKind, Listeners
from haptix.feel.materials import Feelable, check_feelable
from haptix.feel.motion import LIFTED_BELOW_N, Report, Trajectory
from haptix.model.surface import FrictionSurface
from haptix.play.render.drive import Drive, DriverCarrier
from haptix.play.render.fingers import RecordedFingers
from haptix.play.render.master import EffectEnd, Master
from haptix.play.render.samples import RenderCore, RenderedBlock, RenderStats
from haptix.play.render.settings import RenderSettings
from haptix.play.render.verified import VerifiedUse
from haptix.play.touch import ForceModel, TouchEvent
from haptix.play.touch.events import problem_of

_LOG = logging.getLogger("haptix.play.render")

LONGEST_GAP_S = 60.0
"""Longest pause between recorded touches that is rendered."""

_ASSUMED_N = ForceModel().assumed_n
_LONG_S = 0.25  # length of a block of `play`: long enough to hide the cost of calls of numpy


class RenderStream(RenderCore, ABC):
    """A context in which touches become samples on a device.

    Leaving the context ends at 0 V. So does a failing device: the next call raises its error once,
    and the renderer can be entered again.

    Parameters are those of `RenderCore`. The device's voltage ceiling is lowered to the surface's
    voltage limit. Raises `LimitError` on entering, if the surface's voltage limit is above the
    device's ceiling.
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
        """Quantities in use that leave the range in which the screen was verified."""
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

    def intensity(self, value: float) -> None:
        """Set the app's intensity, 0 to 1: a share of the friction above the lowest."""
        self._master.turn(self._samples_s, intensity=value)

    def person_intensity(self, value: float) -> None:
        """Set the intensity that the person allows, 0 to 1; the app's is multiplied with it."""
        self._master.turn(self._samples_s, person_intensity=value)

    def mute(self, on: bool = True) -> None:
        """Fade to the lowest friction in 5 ms, or in again if not `on`; time goes on."""
        self._master.turn(self._samples_s, is_muted=on)

    def pause(self, on: bool = True) -> None:
        """Fade out and stop the time of materials and layouts, or go on if not `on`."""
        if on:
            self._master.pause(self._samples_s)
        else:
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
            Events of a finger.
        arrival_s : float, optional
            Time of the clock [s] to wait for first, live; recordings take no notice of it.
        """

    def _prepare(self) -> None:
        """Check and set the device's limits, and reset."""
        limit, ceiling = self.surface.voltage_limit_v, self.device.limits.ceiling_v
        if limit > ceiling:
            raise LimitError(
                f"the surface asks for up to {limit:g} V, but the device allows {ceiling:g} V; "
                f"build one for it: {_building(self.surface, ceiling)}; or open the device anew if "
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
    >>> ribs = haptix.feel.Grating(period_mm=2.0)
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
            known_n = force_n if force_n >= LIFTED_BELOW_N else None
            event = TouchEvent(t_s, touch_id, x_mm, y_mm, "move", known_n)
            if (problem := problem_of(event)) is not None:
                raise InputError(f"{problem}, in sample {i + 1}")
        self._check_gap(path.t_s)
        touches = path.normal_force_n >= LIFTED_BELOW_N
        turns = np.flatnonzero(np.diff(touches, prepend=False, append=False))
        longest = max(self.points, round(_LONG_S / self.step_s))
        for first, end in turns.reshape(-1, 2).tolist():
            t, x, y, force = (column[first:end] for column in columns)
            self._follow(touch_id, t, x, y, force)
            if end < len(touches):
                t_s = float(path.t_s[end])
                self._fingers.lift(touch_id, t_s, t_s - (self._start_s or 0.0))
            self._render_known(longest)

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


def _building(surface: FrictionSurface, voltage_v: float) -> str:
    """Return the command that builds the same surface for voltages up to another one."""
    words = ["haptix build my.surface", f"--voltage-v {voltage_v:g}"]
    profiles = surface.info.get("profiles", {})
    words += [f"--{kind} {profiles[kind]}" for kind in ("finger", "screen") if kind in profiles]
    for option, axis in (
        ("normal-force-n", surface.normal_force_n),
        ("frequency-hz", surface.frequency_hz),
    ):
        if not axis.is_absent:
            ends = (axis.low, axis.high) if axis.varies else (axis.low,)
            words.append(f"--{option} {','.join(f'{end:g}' for end in ends)}")
    return " ".join(words)
