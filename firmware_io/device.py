"""A device: the only way from the host to a link; it checks every sample."""

from __future__ import annotations

import logging
import weakref
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from typing import Self

import numpy as np
import numpy.typing as npt

from firmware_io.capabilities import (
    Capabilities,
    Mode,
    bounded_setup,
    changed_setup,
    choose_mode,
    choose_rate,
    first_setup,
    lowered_limits,
)
from firmware_io.clock import Clock
from firmware_io.device_errors import DeviceDisconnectedError, DeviceError, LimitError
from firmware_io.host_stream import Pace, Stream
from firmware_io.limits import DriveLimits
from firmware_io.link import Link
from firmware_io.links.mock import MockDriver, MockLink
from firmware_io.progress import CurrentReading, Marked, Progress
from firmware_io.protocol import SensorProblem, Setup, StreamMode, TouchReport
from firmware_io.protocol_client import ProtocolClient

_LOG = logging.getLogger("firmware_io.device")


class Device:
    """Streams voltages to one driver, within limits.

    As a context manager it arms on entry and always ends at 0 V; `close` closes the link. A device
    without references closes itself, at the latest when the interpreter exits. If STOP cannot be
    delivered, it is owed (`stop_is_owed`): `stop`, `close`, `arm` and leaving the context send it
    again, and meanwhile the driver's watchdog ends the output. Only one thread may use a device.

    Parameters
    ----------
    link : Link
        Carries the bytes. From now on only this object uses it; any error here closes it.
    limits : DriveLimits, optional
        Limits of every sample; they are lowered to those of the driver.
    mode : {"waveform", "envelope"}, optional
        Whether samples are the drive itself, or the amplitude of a carrier that the driver makes.
        Default: waveform; envelope through reports, or if the driver has no other mode.
    sample_rate_hz : float, optional
        One of the driver's rates in that mode; default: the highest that the link can carry.
    carrier_hz : float, optional
        Carrier in envelope mode; default: `firmware_io.capabilities.DEFAULT_CARRIER_HZ`.
    clock : Clock, optional
        Clock of the host in place of the link's, for tests.

    Raises
    ------
    ProtocolError
        If the device is no haptix driver, has another version, or offers no such mode or rate.
    DeviceError
        If a value is impossible.
    """

    def __init__(
        self,
        link: Link,
        limits: DriveLimits | None = None,
        *,
        mode: Mode | None = None,
        sample_rate_hz: float | None = None,
        carrier_hz: float | None = None,
        clock: Clock | None = None,
    ) -> None:
        try:
            client = ProtocolClient(link, link.clock if clock is None else clock)
            report = client.handshake()
            driver = Capabilities.from_report(report, report.output_rate_hz)
            mode = choose_mode(mode, driver, link)
            rate_hz = choose_rate(sample_rate_hz, mode, driver, link)
            limits = lowered_limits(limits or DriveLimits(), driver)
            output_rate_hz = report.output_rate_hz
            setup = first_setup(driver, mode, rate_hz, carrier_hz)
            setup = bounded_setup(setup, limits, driver, output_rate_hz)
            self._stream = Stream(client, limits, setup, driver.max_frame_samples, output_rate_hz)
        except BaseException:
            with suppress(Exception):
                link.close()
            raise
        self._capabilities = replace(driver, sample_rate_hz=float(rate_hz))
        self._is_closed = False
        self._sensor_problem = SensorProblem.NONE
        self._is_doubted = False  # the last reading
        _LOG.info("%s: opened, %s at %g Hz", link.name, mode, rate_hz)
        # Holds only the stream: a reference to the device would keep it from being collected.
        weakref.finalize(self, self._stream.abandon)

    def __repr__(self) -> str:
        driver = self._capabilities
        return f"Device({self.name}, {driver.sample_rate_hz:g} Hz, at most {driver.ceiling_v:g} V)"

    @property
    def capabilities(self) -> Capabilities:
        """The driver's capabilities."""
        return self._capabilities

    @property
    def clock(self) -> Clock:
        """The host's clock, by which `host_time_s`, `marked` and `progress` give times."""
        return self._stream.client.clock

    @property
    def name(self) -> str:
        """Name of the link, such as its address."""
        return self._stream.link.name

    @property
    def is_closed(self) -> bool:
        """Whether `close` was called."""
        return self._is_closed

    @property
    def mode(self) -> Mode:
        """Meaning of the samples: the drive ("waveform") or a carrier's amplitude ("envelope")."""
        return "envelope" if self._stream.setup.mode is StreamMode.ENVELOPE else "waveform"

    @property
    def carrier_hz(self) -> float | None:
        """Frequency of the carrier that the driver makes; None in waveform mode."""
        return self._stream.setup.carrier_mhz / 1e3 or None

    @property
    def watchdog_s(self) -> float:
        """Time after the last frame at which the driver is at 0 V by itself, at the latest."""
        return self._stream.setup.watchdog_ms / 1e3

    @property
    def pace(self) -> Pace:
        """Sizes of frames, writes and revisions."""
        return self._stream.pace

    @property
    def limits(self) -> DriveLimits:
        """The limits in force: the tighter of the host's and the driver's."""
        return self._stream.limits

    @property
    def is_armed(self) -> bool:
        """Whether samples can be written."""
        return self._stream.is_armed

    @property
    def stop_is_owed(self) -> bool:
        """Whether the driver may be armed: from the first ARM sent until a STOP arrived."""
        return self._stream.stop_is_owed

    @property
    def latency_s(self) -> float | None:
        """Latency of an interface behind the link, in seconds; None if unknown."""
        return self._stream.link.latency_s

    @property
    def frames_sent(self) -> int:
        """Frames delivered since construction, of every kind."""
        return self._stream.client.frames_sent

    @property
    def bytes_sent(self) -> int:
        """Bytes delivered since construction."""
        return self._stream.client.bytes_sent

    @property
    def samples_sent(self) -> int:
        """Samples delivered since construction, ramps included."""
        return self._stream.samples_sent

    @property
    def last_v(self) -> float:
        """The last voltage that may stand on the output: the last written, 0.0 when stopped.

        If the link was lost and the last frame may have arrived or not, this is the larger of the
        voltages before and after that frame, until a STOP arrives.
        """
        return self._stream.last_v

    @property
    def mock(self) -> MockDriver | None:
        """The driver behind a mock link, for tests and the demo; None for any other link."""
        link = self._stream.link
        return link.driver if isinstance(link, MockLink) else None

    def lower_ceiling(self, ceiling_v: float) -> None:
        """Lower the ceiling, for a screen that withstands less than the driver gives.

        If the output stands above the new ceiling, the device stops first.

        Raises
        ------
        LimitError
            If `ceiling_v` is above the present ceiling, or not finite and positive.
        DeviceError
            If the device had to stop and could not; the ceiling is lowered nevertheless.
        """
        stream = self._stream
        lowered = replace(stream.checks.stated, ceiling_v=ceiling_v)
        if ceiling_v > stream.limits.ceiling_v:
            raise LimitError(
                f"The ceiling is {stream.limits.ceiling_v!r} V and can only be lowered, but "
                f"{ceiling_v!r} V was asked for; open the device anew for a higher one."
            )
        self._lower(lowered, must_stop=abs(stream.last_v) > ceiling_v)

    def raise_capacitance(self, capacitance_f: float) -> None:
        """State a larger capacitance of finger and body: it lowers the slew limit.

        If the device is armed, it stops first.

        Raises
        ------
        LimitError
            If it is not finite, or below the present one: that would raise the voltage.
        DeviceError
            If the device had to stop and could not; the limit is lowered nevertheless.
        """
        stream = self._stream
        lowered = replace(stream.checks.stated, capacitance_f=capacitance_f)
        if capacitance_f < stream.limits.capacitance_f:
            raise LimitError(
                f"The capacitance is {stream.limits.capacitance_f!r} F and can only be raised, but "
                f"{capacitance_f!r} F was given; open the device anew for a smaller one."
            )
        self._lower(lowered, must_stop=True)

    def _lower(self, limits: DriveLimits, must_stop: bool) -> None:
        try:
            if must_stop:
                self._stream.stop(play_out=True)
        finally:
            self._bind(limits, self._stream.setup)

    def set_up(
        self,
        *,
        carrier_hz: float | None = None,
        lead_s: float | None = None,
        watchdog_s: float | None = None,
        status_s: float | None = None,
    ) -> None:
        """Change how the driver plays samples, from the next arming on.

        Parameters
        ----------
        carrier_hz : float, optional
            Carrier, in envelope mode.
        lead_s : float, optional
            Delay from sending the first sample to the begin of playback.
        watchdog_s : float, optional
            The driver is at 0 V by itself this long after the last frame. Lowers the lead to half
            of this time if it is longer.
        status_s : float, optional
            Interval of the driver's reports while it is armed; 0 for none.

        Raises
        ------
        DeviceError
            If the device is armed, or a value is impossible.
        """
        stream = self._stream
        if stream.is_armed:
            raise DeviceError("The device is armed, so its set-up is fixed; stop it first.")
        setup = changed_setup(
            stream.setup,
            self._capabilities.max_watchdog_s,
            carrier_hz=carrier_hz,
            lead_s=lead_s,
            watchdog_s=watchdog_s,
            status_s=status_s,
        )
        self._bind(stream.checks.stated, setup)

    def progress(self, is_fresh: bool = False, is_due: bool = False) -> Progress:
        """Read the driver's reports and return its progress.

        Parameters
        ----------
        is_fresh : bool
            Ask the driver for a report.
        is_due : bool
            Read even before the next report is due: a driver reports a refused revision at once.

        Raises
        ------
        DeviceFaultError
            If the driver has stopped by itself; it is at 0 V.
        DeviceDisconnectedError
            If the link is lost.
        """
        self._stream.poll(is_fresh, is_due)
        return self._stream.progress()

    def touches(self) -> list[TouchReport]:
        """Return the touches that the panel has reported since the last call, oldest first."""
        latest = self._stream.client.touches
        return [latest.popleft() for _ in range(len(latest))]

    def mark(self, sample_index: int, code: int = 0) -> None:
        """Ask the driver to report when it plays a sample: by its digital line, and in `marked`.

        The line is high for a millisecond from the sample's first output sample on. STOP discards
        marks whose samples were not played. On any error the output is brought to 0 V, as in
        `write`.

        Parameters
        ----------
        sample_index : int
            Number of samples before it since the device was armed; it may be sent later.
        code : int
            Number that `marked` repeats, 0 to 65535.

        Raises
        ------
        DeviceError
            If the driver takes no marks, is not armed, or holds as many as it can.
        """
        if not self._capabilities.takes_marks:
            raise DeviceError(
                f"{self.name} takes no marks; use the trigger channel of a stimulus file, or a "
                "driver whose firmware takes them."
            )
        if sample_index < 0 or not 0 <= code < 2**16:
            raise DeviceError(
                f"A mark has a sample index of 0 or more and a code of 0 to 65535, but "
                f"{sample_index} and {code} came."
            )
        with self._armed("mark its samples"):
            self._stream.mark(sample_index, code)

    @property
    def marks_waiting(self) -> int:
        """Number of marks that the driver still holds, at most `MOST_MARKS`."""
        return self._stream.marks_waiting

    def marked(self) -> list[Marked]:
        """Return the marked samples that were reported as played since the last call."""
        client = self._stream.client
        return [
            Marked.of(client.marked.popleft(), client.output_clock)
            for _ in range(len(client.marked))
        ]

    def readings(self) -> list[CurrentReading]:
        """Return the readings of the current that came since the last call, oldest first.

        Those that the driver does not believe are left out; `sensor_problem` says why. The list is
        empty if the driver has no sensor (`capabilities.sense_rate_hz`).
        """
        client, full_scale_v = self._stream.client, self._capabilities.full_scale_v
        believed = []
        for _ in range(len(client.readings)):
            reading = client.readings.popleft()
            problem = reading.problem
            # A lasting problem begins with zeros; a single doubtful reading is only left out.
            lasts = problem is SensorProblem.NONE or reading.driven == 0 or self._is_doubted
            self._is_doubted = problem is not SensorProblem.NONE
            if lasts and problem is not self._sensor_problem:
                self._sensor_problem = problem
                _LOG.info("%s: sensor: %s", self.name, problem.name)
            if not self._is_doubted:
                believed.append(CurrentReading.of(reading, client.output_clock, full_scale_v))
        return believed

    @property
    def sensor_problem(self) -> str | None:
        """Why the driver gives no readings, as of the last call of `readings`; None if it does."""
        return _SENSOR_PROBLEMS[self._sensor_problem]

    def host_time_s(self, clock_ticks: float) -> float:
        """Convert a time of the driver's clock to the host's clock, by its latest reports."""
        return self._stream.client.output_clock.time_of(clock_ticks)

    def arm(self, *, revisable: bool = False) -> None:
        """Prepare the driver to play, from sample index 0; no effect if armed.

        A STOP still owed is delivered first.

        Parameters
        ----------
        revisable : bool
            Keep the samples sent until they are played, for `revise`.

        Raises
        ------
        DeviceDisconnectedError
            If the device is closed or its link lost.
        DeviceError
            If the driver refuses, or cannot revise.
        """
        if revisable and not self._capabilities.guard_s:
            raise DeviceError(
                f"{self.name} cannot revise samples that it was sent; update its firmware, or arm "
                "it without revisable."
            )
        if self._is_closed:
            raise DeviceDisconnectedError("The device is closed; open it again before arming.")
        self._stream.arm(revisable)

    def write(self, volts: npt.ArrayLike) -> None:
        """Send samples; they are played after all earlier ones.

        All samples are checked before the first is sent. On any error the output is brought to
        0 V and the device is disarmed before the error is raised. A driver that receives nothing
        for its watchdog time stops by itself, and the next call raises `DeviceFaultError`.

        Parameters
        ----------
        volts : array_like, shape (n,)
            Real voltages, one per sample at `capabilities.sample_rate_hz`.

        Raises
        ------
        LimitError
            If a sample breaks a limit; none of `volts` is played.
        DeviceError
            If the device is not armed, `volts` is not a 1-D array of real numbers, or the driver
            fails.
        """
        with self._armed("write to it"):
            self._stream.write(_as_samples(volts))

    def revise(self, first_sample: int, volts: npt.NDArray[np.float64]) -> None:
        """Replace samples that were sent and have not been played.

        All limits are kept, at both seams too; energy and mean are those of the samples that are
        played. If a revision reaches the driver too late, the driver refuses it and all sent after
        it; `progress` reports this. On any error the output is brought to 0 V, as in `write`.

        Parameters
        ----------
        first_sample : int
            Index of the first of them, in samples since the device was armed.
        volts : ndarray of float64, shape (n,)
            At most `pace.most_revised_samples`; the last sample sent cannot be replaced.

        Raises
        ------
        LimitError
            If a sample breaks a limit.
        DeviceError
            If the device is not armed for it, the samples are not queued, or the driver fails.
        """
        with self._armed("revise its samples"):
            self._stream.revise(first_sample, _as_samples(volts))

    def stop(self) -> None:
        """Play the samples sent, bring the output to 0 V and disarm. Idempotent.

        Raises
        ------
        DeviceFaultError
            If the driver had stopped by itself before; it is at 0 V and nothing is owed.
        DeviceError
            If the ramp or STOP could not be delivered. The device is disarmed nevertheless; if
            STOP failed, `stop_is_owed` stays True and the next call tries again.
        """
        self._stream.stop(play_out=True)

    def stop_at_once(self) -> None:
        """Bring the output to 0 V without playing the queue, and disarm; errors as in `stop`.

        Idempotent.
        """
        self._stream.stop(play_out=False)

    def lend(self) -> Stream | None:
        """Return the stream, for a player in C that sends in its place, or None if it cannot.

        It can where the samples are the drive itself, and the link is a file descriptor, has a
        file for reports, or is two endpoints of USB.
        """
        stream, link = self._stream, self._stream.link
        ways = link.descriptor, link.reports_node, link.bulk
        return stream if self.mode == "waveform" and any(way is not None for way in ways) else None

    def close(self) -> None:
        """Stop, then close the link; it is closed even if `stop` fails. Idempotent."""
        if self._is_closed and not self.stop_is_owed:
            return
        self._is_closed = True
        _LOG.info("%s: closes", self.name)
        self._stream.close()

    def __enter__(self) -> Self:
        self.arm()
        return self

    def __exit__(self, kind: object, error: BaseException | None, traceback: object) -> None:
        if error is None:
            self.stop()
        else:
            self._stop_after(error)

    @contextmanager
    def _armed(self, use: str) -> Iterator[None]:
        """Refuse to use a device that is not armed; on any error in the body, end at 0 V."""
        if not self._stream.is_armed:
            raise DeviceError(
                f"The device must be armed to {use}, but is not; call arm() first, or use it in a "
                "with statement."
            )
        try:
            yield
        except BaseException as error:
            self._stop_after(error)
            raise

    def _stop_after(self, error: BaseException) -> None:
        """Stop because of `error`, and add a note to it if that fails."""
        what = "refused by a limit" if isinstance(error, LimitError) else type(error).__name__
        _LOG.info("%s: stops, %s: %s", self.name, what, error)
        try:
            self.stop_at_once()
        except Exception as failure:
            error.add_note(f"Bringing the output to 0 V failed as well: {failure}")

    def _bind(self, limits: DriveLimits, setup: Setup) -> None:
        """Set limits and set-up of the driver from the next arming on."""
        stream = self._stream
        bounded = bounded_setup(setup, limits, self._capabilities, stream.output_rate_hz)
        stream.bind(limits, bounded)


_SENSOR_PROBLEMS = {
    SensorProblem.NONE: None,
    SensorProblem.STUCK: "The converter's code does not change.",
    SensorProblem.LIES: "The converter gives a current of no load: inverted, late or clipped.",
    SensorProblem.LATE: "The converter gives no samples.",
    SensorProblem.DIRECT: "Sensing is off: the drive has no carrier to measure by, or one of a "
    "quarter of the output rate or more.",
}


def _as_samples(volts: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Return `volts` as a 1-D float64 array, or raise DeviceError."""
    try:
        array = np.asarray(volts)
    except (TypeError, ValueError, RuntimeError) as error:
        raise DeviceError(
            f"Voltages must be a 1-D array of real numbers, but could not be read as one: {error}"
        ) from error
    if array.ndim != 1 or array.dtype.kind not in "fiu":
        raise DeviceError(
            f"Voltages must be a 1-D array of real numbers, but came as {array.ndim}-D "
            f"{array.dtype} of shape {array.shape}; give one voltage per sample."
        )
    return np.ascontiguousarray(array, np.float64)
