"""Real-time playback: one thread makes samples, another owns the device and plays them."""

from __future__ import annotations

from dataclasses import dataclass
from numbers import Real

import numpy as np
import numpy.typing as npt

from firmware_io.background import BackgroundPlayback
from firmware_io.clock import Clock
from firmware_io.device import Device
from firmware_io.errors import DeviceError
from firmware_io.feeder import Feeder

LONGEST_LEAD_S = 1.0


@dataclass(frozen=True)
class PlaybackStats:
    """Counters since `Playback.start`.

    Parameters
    ----------
    lead_s : float
        Time from `put` to the output that is asked for, in seconds.
    underruns : int
        Number of times that samples ran out before the signal had come to rest.
    late_blocks : int
        Blocks put after samples had run out.
    samples_played : int
        Samples put that have gone to the device.
    device_rate_hz, drift_ppm : float or None
        Samples that the device plays per second of the host's clock, and the excess over its
        stated rate; None in the first second.
    stall_s : float
        Longest time in which the signal got no samples, in seconds; 0 if they never ran out.
    holding_lead_s : float or None
        Shortest lead that would have held, in seconds; None if this one has.
    """

    lead_s: float
    underruns: int
    late_blocks: int
    samples_played: int
    device_rate_hz: float | None
    drift_ppm: float | None
    stall_s: float = 0.0
    holding_lead_s: float | None = None

    @property
    def advice(self) -> str:
        """What to do if the lead did not hold; empty if it did."""
        if self.holding_lead_s is None:
            return ""
        held = f"a lead of {self.holding_lead_s * 1e3:.0f} ms would have held"
        if self.holding_lead_s > LONGEST_LEAD_S:
            held = f"no lead up to {LONGEST_LEAD_S:g} s would have held"
        return (
            f"cannot hold its lead of {self.lead_s * 1e3:.3g} ms: {self.underruns} underruns, "
            f"{self.late_blocks} late blocks, longest stall {self.stall_s * 1e3:.0f} ms; {held}. "
            "Choose a longer lead, or give the computer less to do"
        )

    def __str__(self) -> str:
        drift = "" if self.drift_ppm is None else f", drift {self.drift_ppm:.0f} ppm"
        line = (
            f"{self.samples_played} samples, lead {self.lead_s * 1e3:.3g} ms, {self.underruns} "
            f"underruns, {self.late_blocks} late blocks{drift}"
        )
        return f"{line}; {self.advice}" if self.advice else line


class Playback(BackgroundPlayback[Feeder]):
    """Plays samples in real time, through a thread that owns the device.

    The thread keeps the device's queue at the lead, by the device's own clock, so that the delay
    does not grow. When samples run out it ramps to 0 V, keeps the device fed with 0 V, and fades
    in when they return. However it ends (`stop`, an exception, Ctrl-C, SIGTERM, the interpreter's
    exit, or garbage collection), the output ends at 0 V and the thread ends. It can start again.

    Parameters
    ----------
    device : Device
        Open; only the playback may use it between `start` and `stop`.
    lead_s : float
        Time from `put` to the output, in seconds: the longest stall that is not felt.
    block_s : float
        Shortest write to the device, in seconds, unless its queue runs low; at most a third of
        the lead. With HID reports it is rounded up to whole frames.
    clock : Clock, optional
        For tests: there is no thread, and each call does the work that is due.

    Raises
    ------
    DeviceError
        If a time is out of range.
    """

    def __init__(
        self,
        device: Device,
        lead_s: float = 0.025,
        block_s: float = 0.001,
        *,
        clock: Clock | None = None,
    ) -> None:
        is_number = isinstance(lead_s, Real)
        if not (is_number and 0.003 <= lead_s <= LONGEST_LEAD_S):
            raise DeviceError(
                f"lead_s must lie in 0.003..{LONGEST_LEAD_S:g}, but is {lead_s!r}; "
                "0.025 is a usual lead."
            )
        if not (0.0 < block_s <= lead_s / 3):
            raise DeviceError(
                f"block_s must be above 0 and at most a third of lead_s, {lead_s / 3:g}, but is "
                f"{block_s!r}; shorten the block or lengthen the lead."
            )
        super().__init__(device, clock)
        self.lead_s = lead_s
        self._block_s = block_s

    def _feeder(self) -> Feeder:
        return Feeder(self.device, self.lead_s, self._block_s, self._now)

    def put(self, volts: npt.NDArray[np.float64]) -> None:
        """Append samples; the device plays them one lead later.

        Parameters
        ----------
        volts : ndarray of float64, shape (n,)
            Voltages at the device's sample rate, or amplitudes if it makes the carrier.

        Raises
        ------
        DeviceError
            If there is no room, or it does not run; once, the error that ended it.
        LimitError
            Once, if earlier samples broke a limit; the output is then at 0 V.
        """
        writer = self._running()
        values = np.asarray(volts)
        if values.ndim != 1 or values.dtype.kind not in "fiu":
            raise DeviceError(
                "Voltages must be a 1-D array of real numbers, but came as "
                f"{values.ndim}-D {values.dtype}; give one voltage per sample."
            )
        writer.feeder.put(values.astype(np.float64, copy=False))
        if self._clock is not None:
            self._step(writer)

    def wait_for_room(self, samples: int, timeout_s: float = 1.0) -> bool:
        """Wait until this many samples can be put without a longer delay.

        Returns
        -------
        bool
            Whether there is room; False after the timeout.

        Raises
        ------
        DeviceError, LimitError
            As from `put`.
        """
        writer = self._running()
        feeder = writer.feeder
        if samples > feeder.lead:
            raise DeviceError(
                f"The lead holds {feeder.lead} samples, but room for {samples} was asked for; "
                "put shorter blocks, or choose a longer lead."
            )
        end_s = self._now() + timeout_s
        if self._clock is not None:
            self._step(writer)
        while True:
            with feeder.ready:
                if not writer.is_over:
                    missing = samples - self._room(feeder)
                    left_s = end_s - self._now()
                    if missing <= 0:
                        return True
                    if left_s <= 0:
                        return False
                    wait_s = min(max(missing / feeder.rate_hz, 1e-4), left_s)
                    if self._clock is None:
                        feeder.ready.wait(wait_s)
            writer.raise_once()
            self._running()
            if self._clock is not None:
                self._clock.sleep(min(self._step(writer), wait_s))

    @property
    def room_samples(self) -> int:
        """Samples that can be put before the delay exceeds the lead; 0 if stopped."""
        if self._writer is None or self._writer.is_over:
            return 0
        with self._writer.feeder.ready:
            return self._room(self._writer.feeder)

    @property
    def samples_put(self) -> int:
        """Samples put since `start`."""
        return 0 if self._writer is None else self._writer.feeder.samples_put

    @property
    def queued_samples(self) -> int:
        """Samples between `put` and the output."""
        if self._writer is None or self._writer.is_over:
            return 0
        with self._writer.feeder.ready:
            return self._writer.feeder.queued

    @property
    def shortages(self) -> tuple[int, int]:
        """Underruns and late blocks, as in `stats`, for callers that ask often."""
        return (0, 0) if self._writer is None else self._writer.feeder.shortages

    @property
    def stats(self) -> PlaybackStats:
        """Counters since `start`."""
        if self._writer is None:
            return PlaybackStats(self.lead_s, 0, 0, 0, None, None)
        feeder = self._writer.feeder
        with feeder.ready:
            return PlaybackStats(
                self.lead_s,
                feeder.underruns,
                feeder.late_blocks,
                feeder.samples_taken,
                feeder.device_clock.rate_hz,
                feeder.device_clock.drift_ppm,
                feeder.longest_gap_s and self.lead_s + feeder.longest_gap_s,
                feeder.holding_lead_s,
            )

    def _room(self, feeder: Feeder) -> int:
        return max(0, min(feeder.lead - feeder.queued, feeder.ring.room))
