"""The host's side of one stream: the samples sent, the output's voltage, and the STOP owed.

States of a stream, by `is_armed` and `stop_is_owed`::

               SETUP, ARM                 any error, or stop
    at rest ---------------> armed ------------------------------> stop owed
       ^                   |   ^  | write, revise, mark                |
       |                   |   +--+                                    |
       +-------------------+                                           |
       |  the driver's own fault: it is at 0 V                         |
       +---------------------------------------------------------------+
                   STOP is answered; stop, arm and close send it again

A STOP is owed from just before ARM is sent. Until it is delivered the driver may play; its watchdog
ends that if no STOP arrives. A frame whose delivery failed may have arrived or not. Until a STOP,
the voltage and the next frame's number may then be those before or those after that frame.
"""

from __future__ import annotations

import logging
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from firmware_io.capabilities import MOST_REPORTS_PER_S
from firmware_io.device_errors import DeviceDisconnectedError, DeviceError, DeviceFaultError
from firmware_io.drive_check import DriveCheck
from firmware_io.limits import DriveLimits
from firmware_io.progress import MOST_MARKS, Progress
from firmware_io.protocol import (
    INDEX_MODULUS,
    STREAM_OVERHEAD_BYTES,
    Arm,
    DeviceState,
    FaultReport,
    Mark,
    Revise,
    Setup,
    StatusReport,
    StreamSamples,
    samples_per_frame,
)
from firmware_io.protocol_client import ProtocolClient
from firmware_io.revisable import Provisional

_LOG = logging.getLogger("firmware_io.stream")

#: Samples in one write to a link without reports: 64 KiB; longer writes delay a stop.
_SAMPLES_PER_WRITE = 32_000
_SLOWEST = 0.98  # share of its rate at which a driver plays at least, even without a crystal
_STANDS_S = 2.0  # time without progress; a lead is over within a watchdog time

#: Reports in a frame: the fewest with less than 15 % overhead (PROTOCOL.md).
_REPORTS_PER_FRAME = 3
_REPORTS_PER_REVISION = 4
_REVISIONS_PER_S = 100  # rate that a link should carry: reports of the usual touchscreen
_LEAST_INTERVAL_S = 0.0025  # between two revisions, on any link
_OTHER_REPORTS_PER_S = 10  # questions to the driver
_USED_SHARE = 0.9  # share of a link's bytes that is used
_REVISE_OVERHEAD_BYTES = STREAM_OVERHEAD_BYTES + 2


@dataclass(frozen=True)
class Pace:
    """Sizes of frames and of revisions."""

    setup: Setup
    """The driver's set-up."""
    max_frame_samples: int
    """Samples in the longest frame that the driver accepts."""
    report_bytes: int | None = None
    bytes_per_s: float | None = None
    """Report size and bytes per second of the link, see `Link`."""

    @property
    def least_write_samples(self) -> int:
        """Best size of a write: if the link has reports, multiples of it fill whole frames."""
        return 1 if self.report_bytes is None else self.frame_samples

    @cached_property
    def frame_samples(self) -> int:
        """Samples in a whole frame: at most a quarter of the watchdog time."""
        most = self.max_frame_samples
        if self.report_bytes is not None:
            most = min(most, samples_per_frame(_REPORTS_PER_FRAME, self.report_bytes))
        return max(1, min(most, self._lasting))

    @property
    def most_revised_samples(self) -> int:
        """Samples in the longest revision; on a link with reports, of four reports."""
        most = self.max_frame_samples
        if self.report_bytes is not None:
            most = min(most, samples_per_frame(_REPORTS_PER_REVISION, self.report_bytes) - 1)
        return max(1, min(most, self._lasting))

    @property
    def _lasting(self) -> int:
        return self.setup.watchdog_ms * self.setup.sample_rate_hz // 4000

    def most_ahead(self, is_revisable: bool) -> int:
        """Return the most samples in the driver.

        Samples that are revised may last longer than the watchdog time, which a revision or the
        next piece ends long before: then a stall that the watchdog bears is no underrun. Those
        written once last, with the lead, for three quarters of it: a quarter is left for delays of
        a frame.
        """
        setup = self.setup
        if is_revisable:
            return int(1.2 * setup.watchdog_ms / 1e3 * setup.sample_rate_hz)
        ahead_s = 0.75 * setup.watchdog_ms / 1e3 - min(setup.lead_us / 1e6, setup.watchdog_ms / 4e3)
        return max(self.frame_samples, int(ahead_s * setup.sample_rate_hz))

    def revision_budget(self, window_s: float) -> tuple[int, float]:
        """Return samples in a revision, and the least time from one to the next, in seconds.

        Parameters
        ----------
        window_s : float
            Longest revision. It is shorter if driver or link cannot carry so much a hundred times
            a second.
        """
        rate_hz = self.setup.sample_rate_hz
        most = min(self.most_revised_samples, int(window_s * rate_hz))
        if self.report_bytes is not None:
            # In whole reports, of those that frames do not need.
            reports = rate_hz / self.frame_samples * _REPORTS_PER_FRAME + _OTHER_REPORTS_PER_S
            left = MOST_REPORTS_PER_S - reports
            each = min(_REPORTS_PER_REVISION, max(1, int(left / _REVISIONS_PER_S)))
            most = min(most, samples_per_frame(each, self.report_bytes) - 1)
            return most, max(_LEAST_INTERVAL_S, each / max(left, 1.0))
        if self.bytes_per_s is not None:
            left = _USED_SHARE * self.bytes_per_s - 2.0 * rate_hz
            most = min(most, int(left / _REVISIONS_PER_S / 2) - _REVISE_OVERHEAD_BYTES // 2)
            most = max(most, 1)
            return most, max(
                _LEAST_INTERVAL_S, (2 * most + _REVISE_OVERHEAD_BYTES) / max(left, 1.0)
            )
        return most, _LEAST_INTERVAL_S


class Stream:
    """Sends samples to one driver, and the STOP that it then owes.

    It has no reference to its `Device`, since it stops the driver after the device was collected.

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
    output_rate_hz : int
        Rate of its clock.

    Attributes
    ----------
    is_armed : bool
        Whether samples can be written.
    stop_is_owed : bool
        Whether the driver may be armed: from the first try to arm it until a STOP arrived.
    last_v : float
        The last possible voltage of the output. If a frame may have arrived or not, the larger of
        the voltages before and after it.
    samples_sent : int
        Samples delivered since construction.
    """

    def __init__(
        self,
        client: ProtocolClient,
        limits: DriveLimits,
        setup: Setup,
        max_frame_samples: int,
        output_rate_hz: int,
    ) -> None:
        self.client = client
        self.link = client.link
        self.is_armed = False
        self.stop_is_owed = False
        self.last_v = 0.0
        self.samples_sent = 0
        self.output_rate_hz = output_rate_hz
        link = client.link
        self.pace = Pace(setup, max_frame_samples, link.report_bytes, link.bytes_per_s)
        self.checks = DriveCheck(limits, setup, output_rate_hz)
        self.provisional: Provisional | None = None
        self._is_in_doubt = False
        self._sent = 0  # since armed
        self._marks_sent = 0
        self._rested_s = client.clock()

    @property
    def setup(self) -> Setup:
        """The set-up, which is sent before the driver is armed."""
        return self.pace.setup

    def bind(self, limits: DriveLimits, setup: Setup) -> None:
        """Set other limits and another set-up, from the next arming on."""
        self.pace = replace(self.pace, setup=setup)
        self.checks.bind(limits, setup)

    @property
    def limits(self) -> DriveLimits:
        """Limits of every sample."""
        return self.checks.limits

    def arm(self, revisable: bool = False) -> None:
        """Deliver a STOP still owed, set the driver up, then arm it; no effect if armed."""
        if self.is_armed:
            return
        self.stop(play_out=False)
        # Each time, since a driver that was reset has lost its set-up.
        self.client.ask(self.setup)
        if self.provisional is not None:  # as if all had been played, so as not to count too little
            self.provisional.take_played(self._sent)
        self._sent = 0
        self.checks.begin(self.client.clock() - self._rested_s)
        # Before sending: an ARM whose delivery fails may still have arrived.
        self.stop_is_owed = True
        self._is_in_doubt = True
        try:
            self.client.ask(Arm())
        except DeviceFaultError:
            self.stop_is_owed = False
            raise
        self._is_in_doubt = False
        self.is_armed = True
        _LOG.info("%s: armed%s, %s", self.link.name, " for revisions" * revisable, self.limits)
        self._marks_sent = self.client.marked_count  # earlier marks are discarded
        self.provisional = Provisional(self.checks, self.client.status) if revisable else None

    def write(self, volts: npt.NDArray[np.float64]) -> None:
        """Check all samples, then send them as the driver has room for them."""
        checks = self.checks
        codes = checks.codes(volts, self.last_v)
        driven = checks.driven(volts, self._sent, self.last_v)
        if self.provisional is None:
            checks.check_window(driven)
        else:
            self.provisional.check_appended(driven)
        self._log_accepted(volts)
        self._send(volts, codes, driven)
        self.poll()

    def revise(self, first: int, volts: npt.NDArray[np.float64]) -> None:
        """Check samples, then send them to replace those queued from index `first` on."""
        provisional, setup = self.provisional, self.setup
        if provisional is None:
            raise DeviceError(
                "The device was armed for samples that stay; arm it with revisable=True."
            )
        codes = provisional.replace(first, volts, self.pace.most_revised_samples)
        message = Revise(first % INDEX_MODULUS, codes, setup.mode, provisional.number)
        before_v = self.last_v
        self._log_accepted(volts)
        self._is_in_doubt = True
        self.last_v = max(before_v, float(volts[-1]), key=abs)
        self.client.send(message)
        self._is_in_doubt = False
        self.last_v = before_v
        provisional.note_sent()

    @property
    def marks_waiting(self) -> int:
        """Number of marks that the driver has not reported as played."""
        return self._marks_sent - self.client.marked_count

    def mark(self, index: int, code: int) -> None:
        """Ask the driver to report when it plays a sample."""
        waiting = self.marks_waiting
        if waiting >= MOST_MARKS:
            raise DeviceError(
                f"{waiting} marks wait to be played, and a driver holds {MOST_MARKS}; mark fewer "
                "samples ahead."
            )
        self.client.send(Mark(index % INDEX_MODULUS, code))
        self._marks_sent += 1

    def note_mark(self) -> None:
        """Count a mark that a player in C sends."""
        self._marks_sent += 1

    def poll(self, is_fresh: bool = False, is_due: bool = False) -> None:
        """Read the driver's messages; raise its fault.

        If it reports at an interval, read once in that interval, or if `is_due`: a read may take
        a millisecond. With `is_fresh`, ask for a report and wait for it.
        """
        interval_s = self.setup.status_ms / 1e3
        waits = interval_s and not (is_fresh or is_due)
        if waits and self.client.clock() - self.client.status_s < interval_s:
            return
        asked_s = self.client.clock()  # a host that stalls after it has read knows no silence
        try:
            if is_fresh:
                self.client.synchronise()
            else:
                self.client.poll()
        finally:
            self._follow_fault()
        if self.provisional is not None:
            self.provisional.settle(self.client.status, self._sent)
        silent_s = asked_s - self.client.status_s
        if interval_s and self.is_armed and silent_s > self.setup.watchdog_ms / 1e3:
            raise DeviceDisconnectedError(
                f"{self.link.name} has sent nothing for {silent_s:.2g} s, though it should report "
                f"every {interval_s:g} s; check its cable and power, then open it again."
            )

    def lend(self) -> dict[str, object]:
        """Return the state from which a player in C goes on instead, as `hx_player_setup`.

        Until `take_back`, nobody else may send. The driver must be armed for revisions, and take a
        waveform.
        """
        status = self._status()
        return self.checks.lent() | {
            "link": -1 if self.link.descriptor is None else self.link.descriptor,
            "frame": self.pace.frame_samples,
            "most_ahead": self.pace.most_ahead(True),
            "rate_hz": float(self.setup.sample_rate_hz),
            "output_rate_hz": float(self.output_rate_hz),
            "bytes_per_s": self.pace.bytes_per_s or 0.0,
            "watchdog_s": self.setup.watchdog_ms / 1e3,
            "version": self.client.version,
            "sequence": self.client.sequence,
            "queued": status.queued_samples,
            "free": status.free_samples,
            "underruns": status.underruns,
        }

    def take_back(self, sent: int, fault: FaultReport | None) -> None:
        """Go on after a player in C, which has sent so many samples, and a STOP unless it failed.

        Raises `DeviceFaultError` if the driver has reported a fault.
        """
        self._sent += sent
        self.samples_sent += sent
        self.provisional = None  # the player has counted what it sent as driven
        self._is_in_doubt = True  # of where the output is; STOP ends that
        self.client.status_s = self.client.clock()
        self.client.fault = self.client.fault or fault
        self._follow_fault()

    def progress(self) -> Progress:
        """Return the driver's progress, by its last report."""
        status, provisional = self._status(), self.provisional
        played, room = self._played_and_room(status)
        return Progress(
            reported_s=self.client.status_s,
            samples_sent=self._sent,
            samples_played=played,
            room_samples=room,
            is_playing=status.state is DeviceState.PLAYING,
            clock_samples=status.clock_ticks * self.setup.sample_rate_hz / self.output_rate_hz,
            underruns=status.underruns,
            revisions=0 if provisional is None else provisional.obeyed,
            revisions_undone=0 if provisional is None else provisional.undone,
            margin_samples=status.margin_samples,
        )

    def _played_and_room(self, status: StatusReport) -> tuple[int, int]:
        """Return how many samples were played by a report, and how many the driver can accept."""
        played = self._sent - (self._sent - status.samples_played) % INDEX_MODULUS
        ahead = self._sent - played
        if status.state is DeviceState.PLAYING:
            # It has played at least this much since the report, which leaves as much space.
            since_s = _SLOWEST * (self.client.clock() - self.client.status_s)
            since = int(since_s * self.setup.sample_rate_hz)
            ahead -= min(max(0, since), status.queued_samples)
        room = status.queued_samples + status.free_samples - ahead
        most_ahead = self.pace.most_ahead(self.provisional is not None)
        return played, max(0, min(room, most_ahead - ahead))

    def stop(self, play_out: bool) -> None:
        """Bring the output to 0 V and deliver STOP, if one is owed; it stays owed if that fails."""
        if not self.stop_is_owed or self.client.is_inherited:
            return
        self.is_armed = False
        unplayed = 0
        try:
            # If the output's voltage is unknown, only the driver can ramp from it.
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
        """Close without raising: nobody can catch an error of a device that was collected."""
        with suppress(Exception):
            self.close(play_out=False)

    def _play_out(self) -> int:
        """Ramp to 0 V after the queue, wait for it, and return the number of unplayed samples."""
        rate_hz = self.setup.sample_rate_hz
        if self.last_v != 0.0:
            ramp = self.checks.ramp_to_zero(self.last_v)
            codes = self.checks.codes(ramp, self.last_v)
            self._send(ramp, codes, self.checks.driven(ramp, self._sent, self.last_v))
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
        # A driver that refuses STOP has stopped, too. If the last frame was in doubt, a refusal
        # only means that it had arrived, so that STOP did not have the next number.
        self._is_at_rest()
        if was_in_doubt:
            self.client.fault = None
        self.client.raise_fault()

    def _send(
        self,
        volts: npt.NDArray[np.float64],
        codes: npt.NDArray[np.int16],
        driven: npt.NDArray[np.float64],
    ) -> None:
        """Send samples as codes, and count the output that they make."""
        frame, each = self.pace.frame_samples, self.checks.each
        start = 0
        while start < codes.size:
            count = min(codes.size - start, self._room(codes.size - start))
            chunk = codes[start : start + count]
            frames = [
                StreamSamples(
                    (self._sent + at) % INDEX_MODULUS, chunk[at : at + frame], self.setup.mode
                )
                for at in range(0, count, frame)
            ]
            before_v, reached_v = self.last_v, float(volts[start + count - 1])
            self._is_in_doubt = True
            self.last_v = max(before_v, reached_v, key=abs)
            self.client.send(*frames)
            # After sending: the driver counts received samples, and STOP continues that count.
            self._is_in_doubt = False
            self.last_v = reached_v
            self._sent += count
            self.samples_sent += count
            if self.provisional is None:
                self.checks.take(driven[start * each : (start + count) * each])
            else:
                self.provisional.queue.append(volts[start : start + count])
            start += count

    def _room(self, wanted: int) -> int:
        """Return how many of these samples the driver can accept: at least one frame, or all."""
        wanted = min(wanted, _SAMPLES_PER_WRITE)
        least = min(wanted, self.pace.frame_samples)
        rate_hz, clock = self.setup.sample_rate_hz, self.client.clock
        stood_since_s = last_played = None
        while True:
            played, room = self._played_and_room(self._status())
            if played != last_played:
                stood_since_s = None
            elif stood_since_s is None:
                stood_since_s = clock()
            elif clock() - stood_since_s > _STANDS_S:
                raise DeviceError(
                    f"{self.link.name} has not played for two seconds; its clock has stopped. "
                    "Stop the device and open it again."
                )
            if room >= least:
                return min(wanted, room)
            if last_played is not None:
                clock.sleep(min((least - room) / rate_hz, 0.005))
            last_played = played
            self.client.synchronise()
            self._follow_fault()

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

    def _log_accepted(self, volts: npt.NDArray[np.float64]) -> None:
        if _LOG.isEnabledFor(logging.DEBUG) and volts.size:
            most_v = np.abs(volts).max()
            _LOG.debug("%s: limits accept %d, to %.4g V", self.link.name, volts.size, most_v)

    def _is_at_rest(self) -> None:
        _LOG.info("%s: at 0 V and disarmed after %d samples", self.link.name, self._sent)
        self.is_armed = self.stop_is_owed = self._is_in_doubt = False
        self.last_v = 0.0
        self._rested_s = self.client.clock()
