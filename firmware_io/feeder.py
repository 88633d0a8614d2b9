"""The work of the writer thread: samples to the device, and 0 V when they run out."""

from __future__ import annotations

import math
import threading

import numpy as np
import numpy.typing as npt

from firmware_io.clock import Clock
from firmware_io.device import Device
from firmware_io.device_clock import DeviceClock
from firmware_io.progress import Progress
from firmware_io.ring import SampleRing

FADE_S = 0.005
"""Duration in seconds of the ramp down when samples run out, and of the fade back in."""

_LEAST_GUARD_S = 0.002  # within which a thread wakes, nine times in ten


class Feeder:
    """Keeps the device's queue at a lead, from a ring. A thread or a test calls its steps.

    Parameters
    ----------
    device : Device
        Armed by `begin`, written to by `step`, and stopped by `end`.
    lead_s, block_s : float
        See `firmware_io.Playback`.
    clock : Clock
        The host's clock.

    Attributes
    ----------
    ready : threading.Condition
        Its lock guards all state here but the device; notified at every change.
    underruns, late_blocks, samples_played : int
        See `firmware_io.PlaybackStats`.
    longest_gap_s : float
        Longest time for which a signal on its way had no samples; 0 if they never ran out.
    """

    def __init__(self, device: Device, lead_s: float, block_s: float, clock: Clock) -> None:
        rate_hz = device.capabilities.sample_rate_hz
        self.device = device
        self.rate_hz = rate_hz
        self.lead = round(lead_s * rate_hz)
        self.block = max(1, round(block_s * rate_hz))
        whole = device.least_write_samples
        if whole > 1:
            self.block = -(-self.block // whole) * whole
        self.guard = round(max(_LEAST_GUARD_S, lead_s / 8) * rate_hz)
        self.ready = threading.Condition()
        self.has_news = False  # blocks have a lead: one that comes now waits for the next step
        self.ring = SampleRing(self.lead + self.block)
        self.device_clock = DeviceClock(rate_hz)
        self.underruns = 0
        self.late_blocks = 0
        self.longest_gap_s = 0.0
        self.samples_put = 0
        self.samples_taken = 0
        self._clock = clock
        self._sent = 0  # to the device since it was armed, zeros included
        self._is_short = False  # from an underrun until samples come again
        self._short_since_s = 0.0
        self._largest_put = 0
        self._has_rested = True
        self._gain = 1.0
        self._progress: Progress | None = None
        self._began_s = math.inf  # when the first sample was sent
        self._had_rested = True  # by the report before
        self._known_underruns = 0
        self._is_draining = False

    def begin(self) -> None:
        """Arm the device, to play without a lead of its own."""
        status_s = min(self.lead / self.rate_hz / 5, self.device.watchdog_s / 10)
        self.device.set_up(lead_s=0.0, status_s=status_s)
        self.device.arm()
        self._known_underruns = self.device.progress().underruns

    def put(self, volts: npt.NDArray[np.float64]) -> None:
        """Append samples to the ring."""
        with self.ready:
            self.ring.put(volts)
            self.samples_put += volts.size
            self._largest_put = max(self._largest_put, volts.size)
            if self._is_short:
                self.late_blocks += 1
            # No carrier has two zeros in a row: a signal that ends with them has come to rest.
            tail = volts[-2:]
            if tail.size == 2:
                self._has_rested = not tail.any()
            elif tail.size == 1 and tail[0] != 0.0:
                self._has_rested = False
            self.ready.notify_all()

    @property
    def queued(self) -> int:
        """Samples between `put` and the output; call with the lock held."""
        return self.ring.queued + math.ceil(self._level(self._clock()))

    def step(self) -> float:
        """Do one round; return the time in seconds until the next, if nothing is put before.

        Raises
        ------
        DeviceError, LimitError
            From the device.
        """
        with self.ready:
            # By the report before: the next one does not tell for how long the device was dry.
            left = self._left(self._clock())
            if left < 0 and self.ring.queued and not (self._has_rested or self._is_short):
                self.longest_gap_s = max(self.longest_gap_s, -left / self.rate_hz)
        progress = self.device.progress()
        with self.ready:
            self._observe(progress)
            level = self._level(self._clock())
            room = min(progress.room_samples, int(self.lead - level))
            count = max(0, min(self.ring.queued, room))
            if level > self.lead / 2 and not self._is_draining:
                # Whole blocks, not single samples, unless the device runs low.
                count -= count % self.block
            volts = self.ring.take(count) if count else self._silence(level, room)
            if count:
                volts = self._faded_in(volts)
                if self._is_short:
                    gap_s = self._clock() - self._short_since_s
                    self.longest_gap_s = max(self.longest_gap_s, gap_s)
                self._is_short = False
                self.samples_taken += count
        if volts.size:
            self._began_s = min(self._began_s, self._clock())
            self.device.write(volts)
        with self.ready:
            self._sent += volts.size
            level = self._level(self._clock())
            self.ready.notify_all()
            wait = level - (self.lead / 2 if self.ring.queued else self.guard)
            if self.ring.queued >= self.block:
                wait = min(wait, level + self.block - self.lead)
            # If the device has no room though its clock predicts some, wait for its next report.
            return max(wait, self.block / 4 if self.ring.queued else 1.0) / self.rate_hz

    def end(self, drain: bool) -> None:
        """Stop the device at 0 V, with `drain` after all samples put have been played.

        Raises
        ------
        DeviceError, LimitError
            From the device.
        """
        if not drain:
            self.device.stop_at_once()
            return
        end_s = self._clock() + 2 * self.lead / self.rate_hz + 1.0
        self._is_draining = True
        while self.ring.queued and self._clock() < end_s:
            delay_s = self.step()
            if self.ring.queued:
                self._clock.sleep(delay_s)
        if self.device.last_v != 0.0:
            ramp = self.device.limits.ramp_to_zero(self.device.last_v, self.rate_hz, FADE_S)
            while self.device.progress().room_samples < ramp.size and self._clock() < end_s:
                self._clock.sleep(self.block / self.rate_hz)
            self.device.write(ramp)
            self._sent += ramp.size
        self._has_rested = True
        while (level := self._level(self._clock())) > 0 and self._clock() < end_s:
            self._clock.sleep(level / self.rate_hz)
            self._observe(self.device.progress())
        self.device.stop()

    def _observe(self, progress: Progress) -> None:
        self._progress = progress
        self.device_clock.observe(progress.reported_s, progress.clock_samples)
        # The driver's own underruns: the host was late. At rest they cannot be felt.
        if progress.underruns > self._known_underruns and not self._had_rested:
            self._count_underrun()
        self._known_underruns = progress.underruns
        self._had_rested = self._has_rested

    def _count_underrun(self) -> None:
        """Count an underrun, unless it is counted already or the signal has come to rest."""
        if not (self._is_short or self._has_rested):
            self._is_short = True
            now_s = self._clock()
            early = self.guard - self._left(now_s)  # samples that should have been sent by now
            self._short_since_s = now_s - max(0.0, early) / self.rate_hz
            self.underruns += 1

    @property
    def shortages(self) -> tuple[int, int]:
        """Underruns and late blocks."""
        return self.underruns, self.late_blocks

    @property
    def holding_lead_s(self) -> float | None:
        """Shortest lead, in whole milliseconds, that would have held; None if this one has.

        At the worst a stall begins before a block is put, and ends when the guard, an eighth of the
        lead, is all that is left.
        """
        if not (self.underruns and self.longest_gap_s):
            return None
        needed = (self.lead + self._largest_put) / self.rate_hz + self.longest_gap_s
        return math.ceil(needed * 8 / 7 * 1e3) / 1e3

    def _level(self, now_s: float) -> float:
        """Samples in the device that it has not played at `now_s`."""
        return max(0.0, self._left(now_s))

    def _left(self, now_s: float) -> float:
        """The same, and below 0 the samples that it lacks."""
        progress = self._progress
        if progress is None:
            return float(self._sent)
        # It plays from the first sample on, also before it has reported so.
        since_s = max(0.0, now_s - max(progress.reported_s, self._began_s))
        return self._sent - progress.samples_played - since_s * self.rate_hz

    def _silence(self, level: float, room: int) -> npt.NDArray[np.float64]:
        """Return the samples to send when the ring is empty: none yet, a ramp to 0 V, or zeros."""
        if self.ring.queued or level > self.guard or self._is_draining:
            return np.empty(0)
        self._count_underrun()
        if not self._has_rested:
            self._gain = 0.0
        count = max(0, min(self.guard + self.block - int(level), room))
        last_v = self.device.last_v
        if last_v == 0.0:
            return np.zeros(count)
        # Even beyond the lead: a ramp is short, and the driver's queue is long.
        return self.device.limits.ramp_to_zero(last_v, self.rate_hz, FADE_S)

    def _faded_in(self, volts: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Return the samples, faded in after an underrun."""
        if self._gain >= 1.0:
            return volts
        step = 1.0 / (FADE_S * self.rate_hz)
        gain = np.minimum(self._gain + step * np.arange(1, volts.size + 1), 1.0)
        self._gain = float(gain[-1])
        return np.asarray(volts * gain)
