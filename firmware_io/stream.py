"""The host's side of one stream: samples sent, the voltage on the output, the stop owed."""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from firmware_io.drive_window import DriveWindow
from firmware_io.errors import DeviceDisconnectedError, DeviceError, DeviceFaultError
from firmware_io.limits import DriveLimits
from firmware_io.marks import MOST_MARKS
from firmware_io.protocol import (
    INDEX_MODULUS,
    SEQUENCE_MODULUS,
    STREAM_OVERHEAD_BYTES,
    Arm,
    DeviceState,
    Mark,
    Revise,
    Setup,
    StatusReport,
    StreamMode,
    StreamSamples,
    samples_per_frame,
    volts_to_codes,
)
from firmware_io.protocol_client import ProtocolClient
from firmware_io.revisable import Revisable
from firmware_io.setting import MOST_REPORTS_PER_S

#: Reports in a frame: the fewest with less than 15 % overhead (PROTOCOL.md).
_REPORTS_PER_FRAME = 3
_REPORTS_PER_REVISION = 4
_REVISIONS_PER_S = 100  # that a link should carry: the usual touchscreen's reports
_LEAST_INTERVAL_S = 0.0025  # between two revisions, whatever the link
_OTHER_REPORTS_PER_S = 10  # questions to the driver
_USED_SHARE = 0.9  # of a link's bytes
_SLOWEST = 0.98  # of its rate, at which a driver plays; even without a crystal none is slower
_REVISE_OVERHEAD_BYTES = STREAM_OVERHEAD_BYTES + 2
#: Samples in one write to a link without reports: 64 KiB; longer writes delay a stop.
_SAMPLES_PER_WRITE = 32_000
_STANDS_S = 2.0  # without progress; a driver that waits for its lead plays within a watchdog time


@dataclass(frozen=True)
class Progress:
    """The driver's progress, by its last report.

    Parameters
    ----------
    reported_s : float
        Arrival of that report, by the host's clock.
    samples_sent, samples_played : int
        Since it was armed; samples sent after the report are included.
    room_samples : int
        Samples that it can accept now.
    is_playing : bool
        Whether it plays; it begins one lead after the first sample.
    clock_samples : float
        Its clock, in samples since its power-up.
    underruns : int
        Since its power-up.
    revisions, revisions_undone : int
        Revisions that it has obeyed, and those that it has refused or will, since it was armed.
    margin_samples : int
        Samples from its output to the first of the last revision, when it came.
    """

    reported_s: float
    samples_sent: int
    samples_played: int
    room_samples: int
    is_playing: bool
    clock_samples: float
    underruns: int
    revisions: int = 0
    revisions_undone: int = 0
    margin_samples: int = 0


class Stream:
    """Sends samples to one driver, and the STOP that is owed for them.

    It holds no reference to its `Device`: it must stop the driver after the device was collected.

    Parameters
    ----------
    client : ProtocolClient
        The client, after its handshake.
    limits : DriveLimits
        Limits of every sample.
    setup : Setup
        The set-up that is sent before the driver is armed.
    max_frame_samples : int
        Samples in the longest frame that it accepts.
    output_rate_hz : float
        Rate of its clock.

    Attributes
    ----------
    is_armed : bool
        Whether samples can be written.
    stop_is_owed : bool
        Whether the driver may be armed: from the first try to arm it until a STOP arrived.
    last_v : float
        The last voltage that may stand on the output. Of a frame that may have arrived or not,
        the larger of the voltages before and after it.
    samples_sent : int
        What was delivered since construction.
    """

    def __init__(
        self,
        client: ProtocolClient,
        limits: DriveLimits,
        setup: Setup,
        max_frame_samples: int,
        output_rate_hz: float,
    ) -> None:
        self.client = client
        self.link = client.link
        self.limits = limits
        self.is_armed = False
        self.stop_is_owed = False
        self.last_v = 0.0
        self.samples_sent = 0
        self._output_rate_hz = output_rate_hz
        self._max_frame_samples = max_frame_samples
        if self.link.report_bytes is not None:
            fitting = samples_per_frame(_REPORTS_PER_FRAME, self.link.report_bytes)
            self._max_frame_samples = min(max_frame_samples, fitting)
        self._most_samples = max_frame_samples
        self.setup = setup
        self._is_in_doubt = False
        self._sent = 0  # since armed
        self._marks_sent = 0
        self._queued: Revisable | None = None  # what the driver holds, if it may be revised
        self._before_v = 0.0  # the sample before those
        self._seen: StatusReport | None = None
        self._revised = self._obeyed = self._refused = self._undone = 0
        self._rested_s = client.clock()
        # Of one sample of an envelope the window counts every output sample, times the carrier.
        is_envelope = setup.mode is StreamMode.ENVELOPE
        self._each = round(output_rate_hz / setup.sample_rate_hz) if is_envelope else 1
        self._window = DriveWindow(limits, setup.sample_rate_hz * self._each)

    @property
    def frame_samples(self) -> int:
        """Samples in a whole frame: at most a quarter of the watchdog time."""
        setup = self.setup
        lasting = setup.watchdog_ms * setup.sample_rate_hz // 4000
        return max(1, min(self._max_frame_samples, lasting))

    @property
    def most_revised_samples(self) -> int:
        """Samples in the longest revision: in reports, of four of them."""
        setup, most = self.setup, self._most_samples
        if self.link.report_bytes is not None:
            most = min(most, samples_per_frame(_REPORTS_PER_REVISION, self.link.report_bytes) - 1)
        return max(1, min(most, setup.watchdog_ms * setup.sample_rate_hz // 4000))

    def revision_budget(self, window_s: float) -> tuple[int, float]:
        """Return samples in a revision, and the least time between two; see `Device`."""
        rate_hz, link = self.setup.sample_rate_hz, self.link
        most = min(self.most_revised_samples, int(window_s * rate_hz))
        if link.report_bytes is not None:
            # In whole reports, of those that frames leave over.
            reports = rate_hz / self.frame_samples * _REPORTS_PER_FRAME + _OTHER_REPORTS_PER_S
            left = MOST_REPORTS_PER_S - reports
            each = min(_REPORTS_PER_REVISION, max(1, int(left / _REVISIONS_PER_S)))
            most = min(most, samples_per_frame(each, link.report_bytes) - 1)
            return most, max(_LEAST_INTERVAL_S, each / max(left, 1.0))
        if link.bytes_per_s is not None:
            left = _USED_SHARE * link.bytes_per_s - 2.0 * rate_hz
            most = min(most, int(left / _REVISIONS_PER_S / 2) - _REVISE_OVERHEAD_BYTES // 2)
            most = max(most, 1)
            return most, max(
                _LEAST_INTERVAL_S, (2 * most + _REVISE_OVERHEAD_BYTES) / max(left, 1.0)
            )
        return most, _LEAST_INTERVAL_S

    def arm(self, revisable: bool = False) -> None:
        """Deliver a STOP still owed, set the driver up, then arm it; no effect if armed."""
        if self.is_armed:
            return
        self.stop(play_out=False)
        # Each time: a driver that was reset since then has lost its set-up.
        self.client.ask(self.setup)
        self._take_played(self._sent)  # as if all had been played: the window is not underrated
        self._sent = 0
        rate_hz = self.setup.sample_rate_hz * self._each
        rested_s = self.client.clock() - self._rested_s
        self._window.limits = self.limits
        self._window.rest(math.floor(min(rested_s, self.limits.window_s) * rate_hz))
        # Before the send: an ARM whose delivery fails may still have arrived.
        self.stop_is_owed = True
        self._is_in_doubt = True
        try:
            self.client.ask(Arm())
        except DeviceFaultError:
            self.stop_is_owed = False
            raise
        self._is_in_doubt = False
        self.is_armed = True
        self._marks_sent = self.client.marked_count  # those of before are forgotten
        self._queued = Revisable() if revisable else None
        self._before_v = 0.0
        self._seen = self.client.status
        self._revised = self._obeyed = self._refused = self._undone = 0

    def write(self, volts: npt.NDArray[np.float64]) -> None:
        """Check all samples, then send them as the driver has room for them."""
        self._check(volts, self.last_v)
        driven = self._driven(volts, self._sent, self.last_v)
        if self._queued is None:
            self._check_window(driven)
        else:
            waiting = self._driven(self._queued.values, self._queued.first, self._before_v)
            self._check_window(np.concatenate([waiting, driven]))
        self._send(volts, driven)
        self.poll()

    def revise(self, first: int, volts: npt.NDArray[np.float64]) -> None:
        """Check samples, then send them in the place of those queued from index `first` on."""
        queued, end = self._queued, first + volts.size
        if queued is None:
            raise DeviceError(
                "The device was armed for samples that stay; arm it with revisable=True."
            )
        if not (0 < volts.size <= self.most_revised_samples):
            raise DeviceError(
                f"A revision has 1 to {self.most_revised_samples} samples, but {volts.size} came; "
                "split it."
            )
        # The last one queued stays: what is appended goes on from it, whatever becomes of this.
        if not queued.first < first <= end < queued.end:
            raise DeviceError(
                f"Samples {queued.first + 1} to {queued.end - 2} can be revised, but {first} to "
                f"{end - 1} came; begin later, or end earlier."
            )
        changed = queued.with_values(first, volts)
        start = first - queued.first
        self._check(changed[start : start + volts.size + 1], queued[first - 1])
        self._check_window(self._driven(changed, queued.first, self._before_v))
        codes = volts_to_codes(volts, self.setup.full_scale_mv / 1e3, self.limits.ceiling_v)
        message = Revise(
            first % INDEX_MODULUS, codes, self.setup.mode, self._revised % SEQUENCE_MODULUS
        )
        before_v = self.last_v
        self._is_in_doubt = True
        self.last_v = max(before_v, float(volts[-1]), key=abs)
        self.client.send(message)
        self._is_in_doubt = False
        self.last_v = before_v
        self._revised += 1
        queued.replace(first, volts)

    def mark(self, index: int, code: int) -> None:
        """Ask the driver to tell when it plays a sample."""
        waiting = self._marks_sent - self.client.marked_count
        if waiting >= MOST_MARKS:
            raise DeviceError(
                f"{waiting} marks wait to be played, and a driver holds {MOST_MARKS}; mark fewer "
                "samples ahead."
            )
        self.client.send(Mark(index % INDEX_MODULUS, code))
        self._marks_sent += 1

    def _check(self, volts: npt.NDArray[np.float64], before_v: float) -> None:
        """Reject samples that break ceiling or slew behind the one before them."""
        setup = self.setup
        rate_hz = float(setup.sample_rate_hz)
        if setup.mode is StreamMode.WAVEFORM:
            self.limits.check(volts, before_v, rate_hz)
        else:
            self.limits.check_envelope(volts, before_v, rate_hz, setup.carrier_mhz / 1e3)

    def _check_window(self, driven: npt.NDArray[np.float64]) -> None:
        self._window.check(driven, self._each, self.setup.mode is StreamMode.ENVELOPE)

    def _settle(self) -> None:
        """Learn from the last report which revisions were obeyed, and what was played."""
        status, queued = self.client.status, self._queued
        if queued is None or status is None or status is self._seen:
            return
        self._seen = status
        obeyed = (status.revisions - self._obeyed) % SEQUENCE_MODULUS
        self._obeyed += obeyed
        queued.accept(obeyed)
        # Those sent behind a refused one are refused as well, whenever they come: counted already.
        if 0 < (status.refused - self._refused) % SEQUENCE_MODULUS < SEQUENCE_MODULUS // 2:
            undone = queued.undo()
            self._refused += undone
            self._undone += undone
            self._revised = self._obeyed
        self._take_played(self._sent - (self._sent - status.samples_played) % INDEX_MODULUS)

    def _take_played(self, index: int) -> None:
        """Take samples before an index into the window: nothing can replace them any more."""
        queued = self._queued
        if queued is None:
            return
        first = queued.first
        volts = queued.drop_before(index)
        if volts.size:
            self._window.take(self._driven(volts, first, self._before_v))
            self._before_v = float(volts[-1])

    def poll(self, is_fresh: bool = False, is_due: bool = False) -> None:
        """Read what the driver has sent; raise its fault.

        If it reports at an interval, read once in that interval, or if `is_due`: a read may take
        a millisecond. With `is_fresh`, ask for a report and wait for it.
        """
        interval_s = self.setup.status_ms / 1e3
        waits = interval_s and not (is_fresh or is_due)
        if waits and self.client.clock() - self.client.status_s < interval_s:
            return
        try:
            if is_fresh:
                self.client.synchronise()
            else:
                self.client.poll()
        finally:
            self._follow_fault()
        self._settle()
        silent_s = self.client.clock() - self.client.status_s
        if interval_s and self.is_armed and silent_s > self.setup.watchdog_ms / 1e3:
            raise DeviceDisconnectedError(
                f"{self.link.name} has sent nothing for {silent_s:.2g} s, though it should report "
                f"every {interval_s:g} s; check its cable and power, then open it again."
            )

    def progress(self) -> Progress:
        """Return the driver's progress, by its last report."""
        status = self._status()
        played = self._sent - (self._sent - status.samples_played) % INDEX_MODULUS
        ahead = self._sent - played
        if status.state is DeviceState.PLAYING:
            # What it has played since then, at the least, is room that it will report.
            since_s = _SLOWEST * (self.client.clock() - self.client.status_s)
            ahead -= min(max(0, int(since_s * self.setup.sample_rate_hz)), status.queued_samples)
        room = status.queued_samples + status.free_samples - ahead
        return Progress(
            self.client.status_s,
            self._sent,
            played,
            max(0, min(room, self._most_ahead - ahead)),
            status.state is DeviceState.PLAYING,
            status.clock_ticks * self.setup.sample_rate_hz / self._output_rate_hz,
            status.underruns,
            self._obeyed,
            self._undone,
            status.margin_samples,
        )

    @property
    def _most_ahead(self) -> int:
        """Most samples in the driver: it must play them before its watchdog time is over."""
        setup = self.setup
        if self._queued is not None:  # and a quarter of that time is for what holds up a frame
            return int(0.75 * setup.watchdog_ms / 1e3 * setup.sample_rate_hz)
        ahead_s = setup.watchdog_ms / 1e3 / 2 - min(setup.lead_us / 1e6, setup.watchdog_ms / 4e3)
        return max(self.frame_samples, int(ahead_s * setup.sample_rate_hz))

    def stop(self, play_out: bool) -> None:
        """Bring the output to 0 V and deliver STOP, if one is owed; it stays owed if that fails."""
        if not self.stop_is_owed or self.client.is_inherited:
            return
        self.is_armed = False
        unplayed = 0
        try:
            # If the voltage on the output is unknown, only the driver can ramp from it.
            if play_out and not self._is_in_doubt:
                unplayed = self._play_out()
        finally:
            # A driver ramps on STOP too, so STOP is sent even if the ramp here fails.
            self._send_stop()
        if unplayed:
            raise DeviceError(
                f"{self.link.name} is at 0 V, but did not play the last {unplayed} samples in the "
                "time that they take; its clock is slow, or it was kept waiting."
            )

    def close(self, play_out: bool = True) -> None:
        """Stop, then close the link even if that failed."""
        if self.client.is_inherited:
            return
        try:
            self.stop(play_out)
        finally:
            try:
                self.link.close()
            except OSError as error:
                raise self.client.lost(error) from error

    def abandon(self) -> None:
        """Close without raising, for a device that was collected: nobody can catch an error."""
        with suppress(Exception):
            self.close(play_out=False)

    def _play_out(self) -> int:
        """Ramp to 0 V behind the queue, wait for it, and return the number of unplayed samples."""
        rate_hz = self.setup.sample_rate_hz
        if self.last_v != 0.0:
            ramp = self.limits.ramp_to_zero(self.last_v, rate_hz)
            self._send(ramp, self._driven(ramp, self._sent, self.last_v))
        lead_s = self.setup.lead_us / 1e6
        end_s = self.client.clock() + self._status().queued_samples / rate_hz + lead_s + 1.0
        while self.stop_is_owed:
            status = self.client.synchronise()
            self._follow_fault()
            if status.queued_samples == 0 or self.client.clock() > end_s:
                return status.queued_samples
            self.client.clock.sleep(min(max(status.queued_samples, 1) / rate_hz, 0.01))
        return 0

    def _send_stop(self) -> None:
        was_in_doubt = self._is_in_doubt
        self._is_in_doubt = True
        self.client.send_stop()
        # A driver that refuses STOP has stopped as well. After a frame in doubt a refusal only
        # means that this frame had arrived, so that the number of STOP did not follow its own.
        self._is_at_rest()
        if was_in_doubt:
            self.client.fault = None
        self.client.raise_fault()

    def _send(self, volts: npt.NDArray[np.float64], driven: npt.NDArray[np.float64]) -> None:
        """Send samples, and count what leaves the driver for them."""
        full_scale_v = self.setup.full_scale_mv / 1e3
        codes = volts_to_codes(volts, full_scale_v, self.limits.ceiling_v)
        start = 0
        while start < codes.size:
            count = min(codes.size - start, self._room(codes.size - start))
            chunk = codes[start : start + count]
            frames = [
                StreamSamples(
                    (self._sent + at) % INDEX_MODULUS,
                    chunk[at : at + self.frame_samples],
                    self.setup.mode,
                )
                for at in range(0, count, self.frame_samples)
            ]
            before_v, reached_v = self.last_v, float(volts[start + count - 1])
            self._is_in_doubt = True
            self.last_v = max(before_v, reached_v, key=abs)
            self.client.send(*frames)
            # Only now: the driver counts the samples it received, and STOP must continue that.
            self._is_in_doubt = False
            self.last_v = reached_v
            self._sent += count
            self.samples_sent += count
            if self._queued is None:
                self._window.take(driven[start * self._each : (start + count) * self._each])
            else:
                self._queued.append(volts[start : start + count])
            start += count

    def _driven(
        self, volts: npt.NDArray[np.float64], first: int, before_v: float
    ) -> npt.NDArray[np.float64]:
        """Return what leaves the driver for samples from index `first` on, without a pause."""
        if self.setup.mode is StreamMode.WAVEFORM:
            return volts
        each = self._each
        levels = volts
        if each > 1:
            points = np.concatenate([[before_v], volts])
            at = np.arange(1, each * volts.size + 1) / each
            levels = np.interp(at, np.arange(points.size), points)
        turns = self.setup.carrier_mhz / 1e3 / self._output_rate_hz
        # The carrier begins at phase 0 with the line to the first sample.
        tick = np.arange(first * each, first * each + levels.size)
        carrier = np.sin(2 * np.pi * turns * tick)
        return np.asarray(levels * carrier)

    def _room(self, wanted: int) -> int:
        """Return how many of these samples the driver can accept: at least one frame, or all."""
        wanted = min(wanted, _SAMPLES_PER_WRITE)
        least = min(wanted, self.frame_samples)
        rate_hz = self.setup.sample_rate_hz
        stood_since_s = None
        while True:
            progress = self.progress()
            if progress.room_samples >= least:
                return min(wanted, progress.room_samples)
            if stood_since_s is not None:
                self.client.clock.sleep(min((least - progress.room_samples) / rate_hz, 0.005))
            self.client.synchronise()
            self._follow_fault()
            if self.progress().samples_played == progress.samples_played:
                now_s = self.client.clock()
                stood_since_s = now_s if stood_since_s is None else stood_since_s
                if now_s - stood_since_s > _STANDS_S:
                    raise DeviceError(
                        f"{self.link.name} has not played for two seconds; its clock has stopped. "
                        "Stop the device and open it again."
                    )
            else:
                stood_since_s = self.client.clock()

    def _status(self) -> StatusReport:
        status = self.client.status
        if status is None:
            raise DeviceDisconnectedError(f"{self.link.name} has not reported its status; arm it.")
        return status

    def _follow_fault(self) -> None:
        """Raise a fault of the driver; it has stopped, so no STOP is owed."""
        if self.client.fault is not None and (self.is_armed or self.stop_is_owed):
            self._is_at_rest()
            self.client.raise_fault()

    def _is_at_rest(self) -> None:
        self.is_armed = self.stop_is_owed = self._is_in_doubt = False
        self.last_v = 0.0
        self._rested_s = self.client.clock()
