"""The parts of all renderers: arm the device, count blocks, end at 0 V."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from math import nan
from typing import Any, Self

import numpy as np

from firmware_io import Device
from haptix.checks import Array
from haptix.errors import InputError, LimitError
from haptix.layout import Layout, LayoutEvent, LayoutEventKind, Listeners
from haptix.motion import Motion, Report
from haptix.render.core import Fingers, RenderCore, RenderedBlock
from haptix.render.drive import Drive, DriverCarrier
from haptix.render.master import EffectEnd, Master
from haptix.render.settings import RenderSettings
from haptix.status import Status
from haptix.surface import FrictionSurface
from haptix.texture import Feelable
from haptix.touch import TouchEvent

LONGEST_GAP_S = 60.0
"""Longest pause between touches that is rendered, in virtual time."""

_KEPT = 100_000  # block times


@dataclass
class RenderStats:
    """Counts and times since the renderer was entered."""

    samples: int = 0
    """Samples rendered."""
    below: int = 0
    """Samples, of all fingers, whose target was below the friction without voltage."""
    above: int = 0
    """Samples whose target was above what the highest voltage, pull-in or breakdown allow."""
    outside: int = 0
    """Samples whose force was outside the surface's range."""
    block_s: deque[float] = field(default_factory=lambda: deque(maxlen=_KEPT), repr=False)
    """Time to compute each of the last blocks [s]."""
    lead_s: float = 0.0
    """Time from computing a sample to playing it, as set, or from a touch to the first sample that
    knows of it where the driver can revise; 0 in virtual time."""
    samples_played: int = 0
    """Samples sent in real time, each once."""
    underruns: int = 0
    """Times that samples ran out."""
    late_blocks: int = 0
    """Blocks that arrived after samples had run out."""
    touch_age_s: float = 0.0
    """Time from the newest touch to the start of the last block [s]."""
    touch_ages_s: deque[float] = field(default_factory=lambda: deque(maxlen=_KEPT), repr=False)
    """That time of each of the last blocks with a finger on the screen [s]."""
    revisions: int = 0
    """Windows that were rendered again and revised before they were played."""
    refused: int = 0
    """Revisions that came too late."""
    late_samples: int = 0
    """Samples played from an older prediction, because their revision came later than asked for."""
    reaction_p50_s: float = float("nan")
    """Time from a touch to the first sample that knew of it [s]: median."""
    reaction_p99_s: float = float("nan")
    """99th percentile of it [s]."""
    reaction_max_s: float = float("nan")
    """Longest [s]."""
    longest_stall_s: float = 0.0
    """Longest time for which the thread that plays did not run when it should have [s]."""
    stall_s: float = 0.0
    """Longest time in which the device got no samples [s]; 0 if they never ran out."""
    holding_lead_s: float | None = None
    """Shortest lead that would have held [s]; None if this one has."""
    advice: str = ""
    """What to do if the lead did not hold; empty if it did."""

    def add(self, block: RenderedBlock, seconds: float) -> None:
        """Count a block."""
        self.samples += len(block.drive_v)
        self.block_s.append(seconds)
        if block.status.any():
            each = np.bincount(block.status.ravel(), minlength=len(Status)) * block.step
            self.below += int(each[Status.BELOW])
            self.above += int(each[Status.ABOVE] + each[Status.PULL_IN] + each[Status.BREAKDOWN])
            self.outside += int(each[Status.OUT_OF_RANGE])

    def add_touch_age(self, seconds: float) -> None:
        """Count the age of the newest touch at the start of a block."""
        self.touch_age_s = seconds
        self.touch_ages_s.append(seconds)

    def __str__(self) -> str:
        line = (
            f"{self.samples} samples ({self.below} below reach, {self.above} above, "
            f"{self.outside} outside the surface), {len(self.block_s)} blocks of "
            f"{self.p50_block_s * 1e3:.2f} ms (p99 {self.p99_block_s * 1e3:.2f}, longest "
            f"{self.max_block_s * 1e3:.2f}), lead {self.lead_s * 1e3:.3g} ms, {self.underruns} "
            f"underruns, {self.late_blocks} late blocks"
        )
        return f"{line}; {self.advice}" if self.advice else line

    @property
    def p50_block_s(self) -> float:
        """Median time to compute a block [s]; nan without blocks."""
        return _percentile(self.block_s, 50)

    @property
    def p99_block_s(self) -> float:
        """99th percentile of it [s]."""
        return _percentile(self.block_s, 99)

    @property
    def max_block_s(self) -> float:
        """Longest time [s]."""
        return _percentile(self.block_s, 100)

    @property
    def p50_touch_age_s(self) -> float:
        """Median age of the newest touch at the start of a block [s]; nan without touches."""
        return _percentile(self.touch_ages_s, 50)

    @property
    def p99_touch_age_s(self) -> float:
        """99th percentile of it [s]."""
        return _percentile(self.touch_ages_s, 99)

    @property
    def max_touch_age_s(self) -> float:
        """Largest age [s]."""
        return _percentile(self.touch_ages_s, 100)


def _percentile(times: deque[float], percent: float) -> float:
    kept = list(times)
    return float(np.percentile(kept, percent)) if kept else float("nan")


class RenderSession(RenderCore, ABC):
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
        self._listeners = Listeners()
        super().__init__(surface, texture, device, drive, settings)
        self.device = device
        self._reset()

    def _reset(self) -> None:
        """Start anew: from rest, at sample 0, with empty counts."""
        self.stats = RenderStats()
        self.blocks: list[RenderedBlock] = []
        self._amplitude_v = 0.0
        self._next_sample = 0
        self._master.reset()
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
        """Fade out; what depends on time, layouts too, stands until `resume`."""
        self._master.pause(self._samples_s)

    def resume(self) -> None:
        """Go on after a pause."""
        self._master.resume(self._samples_s)

    def on(self, kind: LayoutEventKind, callback: Callable[[LayoutEvent], None]) -> None:
        """Call a function at each "enter", "leave", "press", "release" or "detent" of a finger.

        It is called by `touch` and `lift`, in their thread, by the report itself and never by
        prediction. Fingers whose force is not measured press nothing.
        """
        self._listeners.on(kind, callback)

    def poll(self) -> list[EffectEnd]:
        """Tell which effects have ended since the last time, see `LiveRenderer.play`."""
        return self._master.ended(self._played_s, self.sample_rate_hz)

    def _attach(self, texture: Feelable) -> None:
        if isinstance(layout := texture.evaluator, Layout):
            layout.attach(lambda: self._since_s, self._changed)

    def _note(self, fingers: Fingers, first_sample: int) -> None:
        master = self._master
        if master.has_effects:
            first_s = master.scene_s(first_sample / self.sample_rate_hz)
            last_s = first_s + fingers.motion.points * self.step_s
            master.mark(first_s, last_s, bool(fingers.gain.max(initial=0.0) > 0.5))

    def _mixed(self, motion: Motion, first_sample: int) -> tuple[float | Array, Array | None]:
        master, first_s = self._master, first_sample / self.sample_rate_hz
        return master.at(first_s, motion.step_s, motion.points), master.added(motion)

    @property
    def _samples_s(self) -> float:
        """Time of the next sample since the first."""
        return self._next_sample / self.sample_rate_hz

    @property
    def _played_s(self) -> float:
        """Time of the scene up to which samples have been played."""
        return self._since_s

    def _heard(self, event: TouchEvent) -> None:
        """Tell callbacks what a touch did, and which effects have ended."""
        is_down = event.kind != "up"
        force = self._force_of(event) if is_down else None
        x, y = (float(event.x_mm), float(event.y_mm)) if is_down else (nan, nan)
        now = Report(self._since_s, x, y, force, is_down)
        if isinstance(layout := self._felt[1], Layout):
            layout.heard(event.touch_id, now)
        self._listeners.report(self.texture, event.touch_id, event.t_s, now)
        self.poll()

    def _force_of(self, event: TouchEvent) -> float | None:
        """Force that was measured; None where it is assumed."""
        return event.normal_force_n

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
        """Take a finger off the screen."""
        self.event(TouchEvent(t_s, touch_id, 0.0, 0.0, "up"))

    @abstractmethod
    def event(self, event: TouchEvent, arrival_s: float | None = None) -> None:
        """Take any touch event; see `touch`.

        `arrival_s` says when the event arrived, for prediction in virtual time. The default is the
        event's own time; recordings and real time take no notice of it.
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

    @property
    def _since_s(self) -> float:
        """Time of the next sample since the first, less pauses."""
        return self._master.scene_s(self._samples_s)

    def _render(self, fingers: Fingers) -> RenderedBlock:
        """Render the next block."""
        block = self.block(fingers, self._next_sample, self._amplitude_v)
        self._amplitude_v = float(block.amplitude_v[-1])
        self._next_sample += len(block.drive_v)
        return block

    def _count(self, block: RenderedBlock, seconds: float) -> None:
        self.stats.add(block, seconds)
        if self.settings.keep_blocks:
            self.blocks.append(block)


class VirtualTimeSession(RenderSession):
    """A session whose clock is the time stamps of touches, so that it can be repeated.

    The first touch is sample 0.
    """

    _start_s: float | None

    def __enter__(self) -> Self:
        self._prepare()
        self.device.arm()
        return self

    def __exit__(self, kind: Any, error: BaseException | None, traceback: Any) -> None:
        self.device.__exit__(kind, error, traceback)
        self._master.cut(self._played_s, self.sample_rate_hz)

    def _reset(self) -> None:
        super()._reset()
        self._start_s = None

    def _send(self, fingers: Fingers, began: float) -> None:
        """Render a block whose computation began at a `perf_counter`, and write it."""
        block = self._render(fingers)
        self.device.write(block.drive_v)
        self._count(block, time.perf_counter() - began)

    def _check_gap(self, t_s: float) -> None:
        """Refuse to render hours of nothing because a clock jumped."""
        gap_s = self._gap_s(t_s)
        if gap_s > LONGEST_GAP_S:
            raise InputError(
                f"touch: expected a time within {LONGEST_GAP_S:g} s of what is rendered, got one "
                f"{gap_s:g} s later; is the clock in seconds? Enter the renderer anew after a pause"
            )

    def _gap_s(self, t_s: float) -> float:
        """Time from what is rendered to another time."""
        if self._start_s is None:
            return 0.0
        return t_s - self._start_s - self._next_sample / self.sample_rate_hz
