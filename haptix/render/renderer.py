"""The renderer: from touches on a texture to samples on a device."""

from __future__ import annotations

import time
from math import inf
from types import TracebackType
from typing import Self

import numpy as np

from firmware_io import Device
from haptix.errors import InputError, LimitError, check_positive
from haptix.motion import Trajectory
from haptix.render.block import CONTROL_HZ, SLEW_V_PER_S, BlockRenderer, Combination, RenderedBlock
from haptix.render.fingers import Array, FingerPoints, Sliding
from haptix.render.live import LiveFingers
from haptix.render.modulation import Carrier, Envelope
from haptix.render.producer import Producer
from haptix.render.replay import Replay
from haptix.render.stats import RenderStats
from haptix.surface import FrictionSurface
from haptix.texture import FrictionField
from haptix.touch import TouchCounts, TouchEvent, TouchSettings
from haptix.touch.events import problem_of

DEFAULT_CARRIER_HZ = 4000.0
"""Above what skin feels, and a whole twelfth of the usual 48 kHz."""

LONGEST_GAP_S = 60.0
"""Longest pause between touches that is rendered, in virtual time."""

_LONG_S = 0.25  # a block of `play`: far longer than what numpy costs per call


class Renderer:
    """Renders a texture under moving fingers.

    In *virtual time*, touches drive the clock and everything is repeatable: without `live` they
    are joined by straight lines, as befits a recording; with it, every block knows only the
    touches that had come when it would have been computed, and predicts. In *real time* a thread
    of its own renders, a second one owns the device, and touches are given as they come.

    Leaving the context ends at 0 V. A device that fails ends at 0 V as well: the next call raises
    its error, once, and the renderer can be entered again.

    Parameters
    ----------
    surface : FrictionSurface
        Must hold the drive's frequency and the thickness; kept as a slice at these.
    texture : FrictionField
        What to feel.
    device : Device
        Where the samples go; its ceiling is lowered to the surface's voltage limit, and must not
        be below it.
    carrier_hz : float, optional
        Frequency of the drive. Without it the surface's own, or where that spans several or leaves
        frequency out, the one nearest to `DEFAULT_CARRIER_HZ`.
    h0_m : float, optional
        Effective insulator thickness, where the surface spans several; the screen's own without.
    block_s : float
        Longest block.
    keep_blocks : bool
        Keep every `RenderedBlock` in `blocks`, for figures and tests.
    wave : Carrier, optional
        A `DirectDrive`, or any other wave, instead of a carrier of `carrier_hz`. A device that
        makes the carrier itself takes none.
    live : TouchSettings, optional
        Follow and predict touches like a live screen's; always so in real time.
    real_time : bool
        Whether to play as time goes by.
    lead_s : float
        Time from computing a sample to its being played, in live rendering: what may stall
        without being felt. Touches are predicted over it.
    compress : (float, float), optional
        Lowest and highest number of the texture, to be squeezed into what can be given. Without it
        friction out of reach becomes the nearest; it is counted in `stats` either way.
    combination : {"strongest", "first", "mean"}
        Which of several fingers' amplitudes the one electrode gets.
    sliding : Sliding
        When a finger counts as sliding: electrovibration is felt only then.
    slew_v_per_s : float
        Fastest change of the amplitude.
    strict : bool
        Raise for touches that cannot be used; otherwise they are dropped, and counted in
        `touch_counts`. Recordings are always strict.
    """

    def __init__(
        self,
        surface: FrictionSurface,
        texture: FrictionField,
        device: Device,
        carrier_hz: float | None = None,
        h0_m: float | None = None,
        block_s: float = 0.005,
        keep_blocks: bool = False,
        *,
        wave: Carrier | None = None,
        live: TouchSettings | None = None,
        real_time: bool = False,
        lead_s: float = 0.025,
        compress: tuple[float, float] | None = None,
        combination: Combination = "strongest",
        sliding: Sliding | None = None,
        slew_v_per_s: float = SLEW_V_PER_S,
        strict: bool = True,
    ) -> None:
        rate = device.capabilities.sample_rate_hz
        if wave is None:
            # A driver in envelope mode makes the carrier itself, and is sent amplitudes.
            kind = Envelope if device.mode == "envelope" else Carrier
            wave = kind(_carrier_hz(surface, carrier_hz), rate)
        elif device.mode == "envelope":
            raise InputError(
                "wave: expected none, since the device makes the carrier itself; open it with "
                "mode=waveform to send a wave"
            )
        elif carrier_hz is not None:
            raise InputError("expected carrier_hz or wave, got both; the wave has its frequency")
        elif wave.sample_rate_hz != rate:
            raise InputError(
                f"wave: expected the device's {rate:g} samples per second, got "
                f"{wave.sample_rate_hz:g}"
            )
        if surface.h0_m.varies and h0_m is None:
            h0_m = surface.info.get("screen_h0_m")
            if h0_m is None:
                raise InputError("h0_m: the surface spans several; say which the screen has")
        frequency = None if surface.frequency_hz.is_absent else wave.frequency_hz
        self.surface = surface.at(frequency, h0_m)
        self.device = device
        self.carrier = wave
        self.stats = RenderStats()
        self.blocks: list[RenderedBlock] = []
        self._keep_blocks = keep_blocks
        check_positive("block_s", block_s)
        check_positive("lead_s", lead_s)
        step = max(1, int(rate / CONTROL_HZ))
        self._step_s = step / rate
        self._points = max(1, round(block_s * rate / step))
        self._block = BlockRenderer(
            self.surface,
            texture,
            compress,
            wave,
            step,
            combination,
            slew_v_per_s,
        )
        self._sliding = Sliding() if sliding is None else sliding
        self._force = (live or TouchSettings()).force
        self._settings = TouchSettings() if live is None and real_time else live
        self._strict = strict
        self._lead_s = lead_s
        self._is_real_time = real_time
        self._replay = Replay(self._sliding)
        self._live = LiveFingers(self._settings or TouchSettings(), self._sliding, strict)
        self._start_s: float | None = None
        self._next_sample = 0
        self._producer: Producer | None = None

    def __enter__(self) -> Self:
        limit, ceiling = self.surface.voltage_limit_v, self.device.limits.ceiling_v
        if limit > ceiling:
            raise LimitError(
                f"the surface asks for up to {limit:g} V, but the device allows {ceiling:g} V; "
                f"build the surface for voltages up to {ceiling:g} V, or open the device anew if "
                "an earlier surface has lowered its ceiling"
            )
        if limit < ceiling:
            self.device.lower_ceiling(limit)
        if isinstance(self.carrier, Envelope):
            self.device.set_up(carrier_hz=self.carrier.frequency_hz)
        self.stats = RenderStats()
        self.blocks = []
        self._replay = Replay(self._sliding)
        self._live = LiveFingers(self._settings or TouchSettings(), self._sliding, self._strict)
        self._start_s, self._next_sample = None, 0
        self._block.begin()
        if self._is_real_time:
            self.stats.lead_s = self._lead_s
            samples = self._points * self._block.step
            producer = Producer(self.device, self._take_block, samples, self._lead_s)
            producer.start()
            self._producer = producer
        else:
            self.device.arm()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        if self._producer is not None:
            producer, self._producer = self._producer, None
            try:
                producer.stop(error)
            finally:
                self.stats.underruns = producer.stats.underruns
                self.stats.late_blocks = producer.stats.late_blocks
            return
        try:
            if error is None and self._settings is not None:
                self._simulate_until(self._live.newest_s)
        finally:
            self.device.__exit__(kind, error, traceback)

    @property
    def texture(self) -> FrictionField:
        """What to feel. Another one may be given at any time, and counts from the next block."""
        return self._block.field

    @texture.setter
    def texture(self, texture: FrictionField) -> None:
        self._block.field = texture

    def reachable(self, normal_force_n: Array, speed_mm_per_s: Array) -> tuple[Array, Array]:
        """Lowest and highest friction coefficient at forces and speeds, shape (points,)."""
        return self._block.reachable(normal_force_n, speed_mm_per_s)

    @property
    def touch_counts(self) -> TouchCounts:
        """What became of the touches of live rendering."""
        return self._live.touches.counts

    def now_s(self) -> float:
        """Time of the clock by which touches in real time are stamped."""
        return time.monotonic()

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
            Time of the touch [s]; in real time by `now_s`.
        x_mm, y_mm : float
            Place on the screen.
        normal_force_n : float, optional
            Normal force [N], above 0; estimated or assumed without.
        touch_id : int
            Which finger.
        contact_area_m2 : float, optional
            Area of contact [m^2], from which force may be estimated.

        Raises
        ------
        InputError
            If `strict`, or a recording, and a value cannot be used or time does not advance.
        LimitError, DeviceError
            If the device rejects the samples or fails; its output is then at 0 V.
        """
        self.event(TouchEvent(t_s, touch_id, x_mm, y_mm, "move", normal_force_n, contact_area_m2))

    def lift(self, t_s: float, touch_id: int = 0) -> None:
        """Take a finger off the screen."""
        self.event(TouchEvent(t_s, touch_id, 0.0, 0.0, "up"))

    def event(self, event: TouchEvent, arrival_s: float | None = None) -> None:
        """Take any touch event; see `touch`.

        In live rendering in virtual time it may say when it came; without, at its own time.
        """
        if self._producer is not None:
            self._producer.raise_once()
            self._live.take(event)
        elif self._settings is not None:
            # What plays within the lead of its arrival was computed before: it knows nothing of it.
            came_s = event.t_s if arrival_s is None else arrival_s
            if self._strict:
                self._check_gap(came_s)
            elif self._gap_s(came_s) > LONGEST_GAP_S:
                self._live.touches.counts.invalid += 1
                return
            self._simulate_until(came_s + self._lead_s)
            self._live.take(event)
            if self._start_s is None:
                self._start_s = self._live.newest_s
        else:
            self._replay_event(event)
            self._render_known(self._points)

    def play(self, path: Trajectory, touch_id: int = 0) -> None:
        """Render one finger's whole recorded path, in long blocks: the fastest way."""
        if self._settings is not None:
            raise InputError("play: expected a renderer of recordings; leave live, real_time out")
        long = max(self._points, round(_LONG_S / self._step_s))
        columns = (path.t_s, path.x_mm, path.y_mm, path.normal_force_n)
        rows = zip(*(column.tolist() for column in columns), strict=True)
        for row in rows:
            self._replay_event(TouchEvent(row[0], touch_id, row[1], row[2], "move", row[3]))
            self._render_known(long, least=long)
        self._render_known(long)

    def _replay_event(self, event: TouchEvent) -> None:
        problem = problem_of(event)
        if problem is not None:
            raise InputError(problem)
        self._check_gap(event.t_s)
        if event.kind == "up":
            self._replay.lift(event.touch_id, event.t_s)
            return
        found = self._force.estimate(event.normal_force_n, event.contact_area_m2)
        force = self._force.assumed if found is None else found
        self._replay.touch(event.touch_id, event.t_s, event.x_mm, event.y_mm, force.normal_force_n)
        if self._start_s is None:
            self._start_s = event.t_s

    def _check_gap(self, t_s: float) -> None:
        """Refuse to render hours of nothing because a clock jumped."""
        gap_s = self._gap_s(t_s)
        if gap_s > LONGEST_GAP_S:
            raise InputError(
                f"touch: expected a time within {LONGEST_GAP_S:g} s of what is rendered, got one "
                f"{gap_s:g} s later; is the clock in seconds? Enter the renderer anew after a pause"
            )

    def _gap_s(self, t_s: float) -> float:
        """Time that would have to be rendered to reach another one."""
        if self._start_s is None:
            return 0.0
        return t_s - self._start_s - self._next_sample / self.carrier.sample_rate_hz

    def _render_known(self, most: int, least: int = 1) -> None:
        """Render recorded fingers as far as their paths are known."""
        if self._start_s is None:
            return
        rate = self.carrier.sample_rate_hz
        # Clocks that count from 1970 resolve a few 1e-7 s: that must not cost a sample.
        end = int((self._replay.known_until_s - self._start_s) * rate + 0.02)
        while (left := (end - self._next_sample) // self._block.step) >= least:
            began = time.perf_counter()
            points = min(most, left)
            ends = self._next_sample + self._block.step * np.arange(1, points + 1)
            fingers = self._replay.points(self._start_s + ends / rate, self._step_s)
            self._send(fingers, points, began)

    def _simulate_until(self, t_s: float | None) -> None:
        """Render live fingers up to a time, without what comes after it."""
        if self._start_s is None or t_s is None or not t_s < inf:
            return
        rate = self.carrier.sample_rate_hz
        while (t0_s := self._start_s + self._next_sample / rate) <= t_s:
            began = time.perf_counter()
            fingers = self._live.points(t0_s, self._step_s, self._points)
            self._send(fingers, self._points, began)

    def _send(self, fingers: FingerPoints, points: int, began: float) -> None:
        """Render a block in virtual time and write it."""
        block = self._block.render(fingers, self._next_sample, points)
        self.device.write(block.drive_v)
        self._next_sample += len(block.drive_v)
        self._keep(block, time.perf_counter() - began)

    def _take_block(self, t0_s: float) -> Array:
        """Render a block in real time, of samples that play from `t0_s`."""
        began = time.perf_counter()
        fingers = self._live.points(t0_s, self._step_s, self._points)
        block = self._block.render(fingers, self._next_sample, self._points)
        self._next_sample += len(block.drive_v)
        self._keep(block, time.perf_counter() - began)
        newest = self._live.newest_s
        if newest is not None:
            self.stats.touch_age_s = t0_s - newest
        return block.drive_v

    def _keep(self, block: RenderedBlock, seconds: float) -> None:
        self.stats.add(block, self._block.step, seconds)
        if self._keep_blocks:
            self.blocks.append(block)


def _carrier_hz(surface: FrictionSurface, wanted_hz: float | None) -> float:
    if wanted_hz is not None:
        return wanted_hz
    frequency = surface.frequency_hz
    if frequency.is_absent:
        return DEFAULT_CARRIER_HZ
    return min(max(DEFAULT_CARRIER_HZ, frequency.low), frequency.high)
