"""The mock: the firmware in this process, a converter of its current, and a link to it."""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from numbers import Real
from typing import Any, Literal, get_args

import numpy as np
import numpy.typing as npt

from firmware_io.capabilities import DEFAULT_CARRIER_HZ, MOCK_NAME
from firmware_io.clock import SteppedClock
from firmware_io.device_errors import DeviceDisconnectedError, DeviceError
from firmware_io.firmware.core import LINE, Core, Output, Sensor
from firmware_io.limits import ABSOLUTE_CEILING_V, DEFAULT_MAX_SLEW_V_PER_S, WATCHDOG_S, DriveLimits
from firmware_io.link import Link, Scheme, count, number, one_of, yes_or_no
from firmware_io.protocol import (
    FULL_SCALE_CODE,
    REPORT_BYTES,
    VERSION,
    CapabilitiesReport,
    DeviceState,
    Rate,
    StatusReport,
    StreamMode,
    TouchPhase,
    TouchReport,
    codes_to_volts,
    from_report,
    to_reports,
)

Pace = Literal["virtual", "real", "stepped"]
Codes = npt.NDArray[np.int16]
Kinds = npt.NDArray[np.uint8]
Farads = complex | Callable[[float, float], complex]
Failure = Literal["dead", "stuck", "noise", "inverted", "saturated", "late", "silent"]

RATES_HZ = (250, 500, 1000, 2000, 4000)

# Slower rates of the mock, if they divide its own: HID can carry these.
_SLOWER_RATES_HZ = (16_000, 8_000)
_BOTH = frozenset(StreamMode)
_KEPT_S = 60.0
# Tolerances in codes: of the ADC, and of an amplifier that lags behind a carrier.
_READ_BACK_TOLERANCE = 3000
# Pieces a second that are played, then measured: a limit holds by that much later.
_CONVERTED_HZ = 4000
# So few bytes that no queue overflows, whichever frames they hold.
_LEAST_PIECE_BYTES = 512
# By the kind of an output sample: whether it is one of the stream or of a ramp.
_IS_PLAYED = np.isin(np.arange(256) & ~LINE, (Output.STREAM, Output.RAMP))


class MockConverter:
    """Measures the current of a `MockDriver`.

    Parameters
    ----------
    farads : complex or callable
        Complex capacitance to earth [F], its imaginary part negative for losses; or a function of
        the amplitude driven [V] and the time since power-up [s], such as that of a virtual finger.
    rate_hz : int
        Readings a second: 250, 500, 1000, 2000 or 4000.
    carrier_hz : float
        The carrier at which that capacitance holds [Hz]: the driver's own.
    full_scale_a : float
        Current of the highest code [A].
    panel_f : float
        Capacitance of the untouched panel in the firmware's configuration [F].
    bits : int
        Bits of the converter.
    noise_a : float
        Standard deviation of each sample [A].
    late_samples : int
        Delay of its samples when it fails "late".
    source : callable, optional
        Returns raw codes, shape (n,) of int16, for as many output samples, in place of all above.
    seed : int
        Of the noise.

    Attributes
    ----------
    failure : str or None
        The fault: "dead" (0 always), "stuck" (the last code for ever), "noise" (alone: a broken
        electrode), "inverted", "saturated", "late", "silent" (no samples).

    Raises
    ------
    DeviceError
        If a value is impossible.

    Examples
    --------
    >>> from firmware_io import Device, MockDriver, MockLink
    >>> driver = MockDriver(converter=MockConverter(2e-9))
    >>> with Device(MockLink(driver), mode="envelope") as device:
    ...     device.write(np.linspace(0, 100, 1600))
    >>> abs(device.readings()[-1].quadrature_a) > 4e-3  # 2 pi 4 kHz 2 nF 95 V
    True
    """

    def __init__(
        self,
        farads: Farads = 2e-9,
        *,
        rate_hz: int = 250,
        carrier_hz: float = DEFAULT_CARRIER_HZ,
        full_scale_a: float = 0.02,
        panel_f: float = 2e-9,
        bits: int = 12,
        noise_a: float = 1e-5,
        late_samples: int = 3,
        source: Callable[[Codes], Codes] | None = None,
        seed: int = 0,
    ) -> None:
        if rate_hz not in RATES_HZ:
            raise DeviceError(f"rate_hz must be one of {RATES_HZ}, but is {rate_hz!r}; correct it.")
        if not 4 <= bits <= 16:
            raise DeviceError(f"bits must lie in 4 to 16, but is {bits!r}; correct it.")
        self.farads = farads
        self.rate_hz = int(rate_hz)
        self.carrier_hz = carrier_hz
        self.full_scale_a = full_scale_a
        self.panel_f = panel_f
        self.failure: Failure | None = None
        self._source = source
        self._step = 2 ** (16 - bits)
        self._noise_codes = noise_a / full_scale_a * FULL_SCALE_CODE
        self._random = np.random.default_rng(seed)
        self._late = np.zeros(late_samples, np.int16)
        self._before = self._last = self._played = 0

    def measure(self, sent: Codes, about: CapabilitiesReport) -> Codes | None:
        """Return raw codes of output samples, shape (n,), at the left of 16 bits; None if silent.

        Parameters
        ----------
        sent : ndarray of int16, shape (n,)
            Output samples.
        about : CapabilitiesReport
            Rate and full scale of the output.
        """
        if self._source is None:
            codes = self._convert(self._current(sent, about))
        else:
            codes = self._source(sent)
        delayed = np.concatenate([self._late, codes])
        self._late = delayed[codes.size :]
        match self.failure:
            case "silent":
                return None
            case "dead":
                return np.zeros_like(codes)
            case "stuck":
                return np.full_like(codes, self._last)
            case "noise":
                return self._convert(np.zeros(codes.size))
            case "inverted":
                return -np.maximum(codes, -FULL_SCALE_CODE)
            case "saturated":
                return np.where(codes < 0, -32768, FULL_SCALE_CODE).astype(np.int16)
            case "late":
                return delayed[: codes.size]
        self._last = int(codes[-1])
        return codes

    def _current(self, sent: Codes, about: CapabilitiesReport) -> npt.NDArray[np.float64]:
        """Return the current of output samples, in codes of the converter, without noise."""
        volts = np.empty(sent.size + 1)
        volts[0], volts[1:] = self._before, sent
        volts *= about.full_scale_mv / 1e3 / FULL_SCALE_CODE
        self._before = int(sent[-1])
        # Of a sine, v(t) cos(x) - v(t - dt) is sin(x) times v a quarter later, x = 2 pi f dt.
        turn = 2 * math.pi * self.carrier_hz / about.output_rate_hz
        ahead = (volts[1:] * math.cos(turn) - volts[:-1]) / math.sin(turn)
        amplitude_v = math.sqrt((volts[1:] ** 2 + ahead**2).max())
        self._played += sent.size
        time_s = self._played / about.output_rate_hz
        farads = self.farads(amplitude_v, time_s) if callable(self.farads) else self.farads
        siemens = 2j * math.pi * self.carrier_hz * complex(farads)
        current = siemens.real * volts[1:] + siemens.imag * ahead
        return current / self.full_scale_a * FULL_SCALE_CODE

    def _convert(self, current: npt.NDArray[np.float64]) -> Codes:
        codes = current + self._random.normal(0.0, self._noise_codes, current.size)
        codes /= self._step
        np.rint(codes, out=codes)
        codes *= self._step
        np.maximum(codes, -32768, out=codes)
        np.minimum(codes, 32768 - self._step, out=codes)
        return codes.astype(np.int16)


class MockDriver:
    """A driver without a board: the firmware in C, and a clock.

    In virtual time it plays its queue at once, and time passes only in `advance`. In real time it
    follows a clock: each call first plays the samples that were due. In steps it does the same, by
    a clock that advances only while its host waits. Threads may share it.

    Parameters
    ----------
    sample_rate_hz : float
        Output samples per second, a whole number.
    full_scale_v : float
        The voltage of code 32767, to the millivolt.
    ceiling_v : float
        The driver's own ceiling, enforced independently of the host.
    max_frame_samples : int
        Largest number of samples in a frame.
    queue_samples : int, optional
        Depth of its queue; default: 12 frames or 12288 samples, a quarter of a second at 48 kHz,
        whichever is more.
    max_slew_v_per_s : float
        The driver's own slew limit.
    max_watchdog_s : float
        Longest watchdog time that it accepts.
    rates_hz : sequence of int, optional
        Its sample rates, in both modes; each divides `sample_rate_hz`. Default: `sample_rate_hz`,
        and 16 kHz and 8 kHz if they divide it.
    serial, calibration_id : str
        Texts in its capabilities.
    pace : {"virtual", "real", "stepped"}
        Whether time passes on demand, by the clock, or while the host waits.
    clock : callable
        Returns the time in seconds, for the real pace.
    kept_s : float, optional
        Least length of the record of its output, in seconds. Default: all of the output at the
        virtual pace and in steps, which play only a program's samples; a minute at the real pace,
        which never ends.
    tests_itself : bool
        Whether it does the tests of a board at power-up, which take some milliseconds.
    converter : MockConverter, optional
        Measures its current; without one it has no sensor.

    Raises
    ------
    DeviceError
        If a number describes no possible driver.
    LimitError
        If the ceiling is above the absolute one.
    """

    def __init__(
        self,
        sample_rate_hz: float = 48_000.0,
        full_scale_v: float = 250.0,
        ceiling_v: float = ABSOLUTE_CEILING_V,
        max_frame_samples: int = 1024,
        queue_samples: int | None = None,
        max_slew_v_per_s: float = DEFAULT_MAX_SLEW_V_PER_S,
        max_watchdog_s: float = WATCHDOG_S,
        rates_hz: Sequence[int] | None = None,
        serial: str = "MOCK0001",
        calibration_id: str = "",
        pace: Pace = "virtual",
        clock: Callable[[], float] = time.perf_counter,
        kept_s: float | None = None,
        tests_itself: bool = False,
        converter: MockConverter | None = None,
    ) -> None:
        if pace not in get_args(Pace):
            paces = ", ".join(get_args(Pace))
            raise DeviceError(f"The mock's pace is one of {paces}, but {pace!r} was given.")
        limits = DriveLimits(ceiling_v=ceiling_v, max_slew_v_per_s=max_slew_v_per_s)
        rate_hz = _whole("sample_rate_hz", sample_rate_hz, 1000, 1_000_000)
        frame = _whole("max_frame_samples", max_frame_samples, 1, 32765)
        queue = max(12 * frame, 12_288) if queue_samples is None else queue_samples
        if rates_hz is None:
            rates_hz = (rate_hz, *(r for r in _SLOWER_RATES_HZ if r < rate_hz and not rate_hz % r))
        self.about = CapabilitiesReport(
            oldest_version=VERSION,
            newest_version=VERSION,
            report_bytes=REPORT_BYTES,
            output_rate_hz=rate_hz,
            full_scale_mv=_whole("full_scale_v", full_scale_v, 1, 1_000_000, "mV", 1e3),
            # Rounded down, so that no limit grows.
            ceiling_mv=math.floor(limits.ceiling_v * 1e3),
            max_slew_v_per_s=min(math.floor(limits.max_slew_v_per_s), 2**32 - 1),
            queue_samples=_whole("queue_samples", queue, 1, 2**32 - 1),
            max_frame_samples=frame,
            max_watchdog_ms=_whole(
                "max_watchdog_s", max_watchdog_s, 10, round(WATCHDOG_S * 1e3), "ms", 1e3
            ),
            name=MOCK_NAME,
            serial=serial,
            calibration_id=calibration_id,
            reports_touch=True,
            rates=tuple(Rate(_whole("rates_hz", rate, 1, rate_hz), _BOTH) for rate in rates_hz),
            takes_marks=True,
            sense_rate_hz=0 if converter is None else converter.rate_hz,
        )
        #: Stands for amplifier and ADC: returns measured codes for sent ones; None measures none.
        self.amplifier: Callable[[Codes], Codes] | None = None
        self.pace = pace
        self.clock = SteppedClock() if pace == "stepped" else clock
        self.bytes_received = 0
        self.converter = converter
        sensor = None if converter is None else Sensor(converter.full_scale_a, converter.panel_f)
        self.core = Core(self.about, sensor)
        if tests_itself:
            self.about = self.core.test_itself(self.about)
        # The queue may be empty while an incomplete frame waits.
        self._piece_bytes = max(2 * (self.about.queue_samples - frame), _LEAST_PIECE_BYTES)
        self._lock = threading.RLock()
        self._began_s = 0.0 if pace == "virtual" else self.clock()
        self._ticks = self._played = self._remembered = 0
        most_kept_s = _KEPT_S if pace == "real" else math.inf
        self._kept_ticks = (most_kept_s if kept_s is None else kept_s) * rate_hz
        self._pieces = deque([(np.empty(0, np.int16), np.empty(0, np.uint8))])

    @property
    def status(self) -> StatusReport:
        """Its state."""
        with self._up_to_now():
            return self.core.status()

    @property
    def is_armed(self) -> bool:
        """Whether STREAM frames are accepted."""
        return self.status.state in (DeviceState.ARMED, DeviceState.PLAYING)

    @property
    def fault(self) -> str | None:
        """Why it refused a frame or stopped by itself; None if it did not since it was armed."""
        with self._up_to_now():
            fault = self.core.fault()
            return None if fault is None else str(fault)

    @property
    def faults(self) -> int:
        """Faults since construction."""
        return self.status.faults

    @property
    def underruns(self) -> int:
        """Number of times that the queue was empty when a sample was due, since construction."""
        return self.status.underruns

    @property
    def samples_played(self) -> int:
        """Output samples played since construction: streams and ramps, without pauses."""
        with self._up_to_now():
            return self._played

    @property
    def played_codes(self) -> Codes:
        """Every code of streams and ramps since construction, shape (samples_played,).

        The 0 V between streams and the samples held in an underrun are left out.
        """
        codes, kinds = self.output
        return codes[_IS_PLAYED[kinds]]

    @property
    def played_v(self) -> npt.NDArray[np.float64]:
        """Every voltage of streams and ramps since construction, shape (samples_played,)."""
        return codes_to_volts(self.played_codes, self.about.full_scale_mv / 1e3)

    @property
    def output(self) -> tuple[Codes, Kinds]:
        """Every output sample since construction, and the kind of each (an `Output`)."""
        with self._up_to_now():
            codes, kinds = map(np.concatenate, zip(*self._pieces, strict=True))
            self._pieces = deque([(codes, kinds)])
            return codes.copy(), kinds.copy()

    @property
    def output_v(self) -> npt.NDArray[np.float64]:
        """The output voltage since construction, at `sample_rate_hz`."""
        return codes_to_volts(self.output[0], self.about.full_scale_mv / 1e3)

    def receive(self, data: bytes) -> None:
        """Take bytes from the wire, in pieces of any size."""
        with self._up_to_now():
            self.bytes_received += len(data)
            for start in range(0, len(data), self._piece_bytes):
                self.core.receive(data[start : start + self._piece_bytes])
                self._play_out()

    def receive_report(self, report: bytes) -> None:
        """Take one HID report, its id first."""
        with self._up_to_now():
            self.bytes_received += len(report)
            self.core.receive_report(report)
            self._play_out()

    def transmit(self) -> bytes:
        """Return the frames that wait for the host; empty if none do."""
        with self._up_to_now():
            return self.core.transmit()

    def transmit_report(self) -> bytes:
        """Return one HID report for the host; empty if there is nothing to say."""
        with self._up_to_now():
            return self.core.transmit_report()

    def touch(
        self,
        x_mm: float,
        y_mm: float,
        normal_force_n: float | None = None,
        contact: int = 0,
        phase: TouchPhase = TouchPhase.MOVE,
    ) -> bool:
        """Report a finger on the panel; False if the host has not read the last eight reports.

        Parameters
        ----------
        x_mm, y_mm : float
        normal_force_n : float, optional
            Normal force [N], if the panel measures it.
        contact : int
        phase : TouchPhase
            Whether it comes down, moves or lifts.
        """
        force_mn = 65535 if normal_force_n is None else round(normal_force_n * 1e3)
        report = TouchReport(0, round(x_mm * 1e3), round(y_mm * 1e3), force_mn, contact, phase)
        with self._up_to_now():
            return self.core.touch(report)

    def release(self) -> None:
        """Ramp to 0 V, disarm and forget the set-up, as when the host disconnects."""
        with self._up_to_now():
            self.core.release()
            self._play_out()

    def advance(self, seconds: float) -> None:
        """Let virtual time pass.

        Raises
        ------
        DeviceError
            If the pace is real.
        """
        if self.pace != "virtual":
            raise DeviceError("A mock at this pace follows its clock; advance the clock instead.")
        with self._lock:
            self._play(round(seconds * self.about.output_rate_hz))

    @contextmanager
    def _up_to_now(self) -> Iterator[None]:
        """Hold the lock, and have played the samples that were due, by a clock."""
        with self._lock:
            if self.pace != "virtual":
                passed_s = self.clock() - self._began_s
                self._play(math.floor(passed_s * self.about.output_rate_hz) - self._ticks)
            yield

    def _play_out(self) -> None:
        """Play the whole queue, in virtual time."""
        if self.pace == "virtual":
            while ticks := self.core.pending_ticks:
                self._play(ticks if self.converter is None else min(ticks, self._piece))

    def _play(self, ticks: int) -> None:
        while ticks > 0:
            codes, kinds = self.core.play(min(ticks, self._piece))
            ticks -= codes.size
            self._record(codes, kinds)

    @property
    def _piece(self) -> int:
        """Output samples at once: a second, as the last call may be long ago; less if measured."""
        rate_hz = self.about.output_rate_hz
        is_idle = self.core.pending_ticks == 0 and not self._pieces[-1][0][-1:].any()
        if self.converter is not None and not is_idle:
            return max(1, rate_hz // _CONVERTED_HZ)
        return rate_hz if self.amplifier is None else max(1, rate_hz // 1000)

    def _record(self, codes: Codes, kinds: Kinds) -> None:
        if self.amplifier is not None:
            self.core.read_back(codes, self.amplifier(codes), _READ_BACK_TOLERANCE)
        if self.converter is not None:
            raw = self.converter.measure(codes, self.about)
            if raw is not None:
                self.core.sense(codes, raw)
        self._ticks += codes.size
        self._played += int(np.count_nonzero(_IS_PLAYED[kinds]))
        self._pieces.append((codes, kinds))
        self._remembered += codes.size
        while len(self._pieces) > 1 and (
            self._remembered - self._pieces[0][0].size >= self._kept_ticks
        ):
            self._remembered -= self._pieces.popleft()[0].size


def _whole(
    name: str, value: float, least: int, most: int, unit: str = "", factor: float = 1.0
) -> int:
    """Return a number, times a factor, as the integer of the wire, or raise DeviceError."""
    if not isinstance(value, Real) or isinstance(value, bool):
        raise DeviceError(f"{name} must be a number, but is {value!r}; correct it.")
    value, unit = float(value) * factor, unit and f" {unit}"
    if not (math.isfinite(value) and least <= round(value) <= most):
        raise DeviceError(
            f"{name} must lie in {least} to {most}{unit}, but is {value:g}{unit}; correct it."
        )
    # 1e-6: the rounding of decimal fractions to binary.
    if abs(value - round(value)) > 1e-6 * max(1.0, abs(value)):
        raise DeviceError(
            f"{name} must be a whole number of{unit or ' samples'}, but is {value!r}{unit}; "
            "round it."
        )
    return round(value)


class MockLink(Link):
    """The link to a `MockDriver`.

    Parameters
    ----------
    driver : MockDriver, optional
        The driver at the other end; one with default properties if not given.
    report_bytes : int, optional
        Carry the frames in HID reports of this size, the driver's own; as bytes if not given.
    sleep : callable, optional
        Waits for a number of seconds between two polls for an answer; default: as `clock` does.
    """

    name = "mock"

    def __init__(
        self,
        driver: MockDriver | None = None,
        report_bytes: int | None = None,
        sleep: Callable[[float], None] | None = None,
    ) -> None:
        self.driver = MockDriver() if driver is None else driver
        self.report_bytes = report_bytes
        if isinstance(self.driver.clock, SteppedClock):  # one for both sides
            self.clock = self.driver.clock
        self._sleep = self.clock.sleep if sleep is None else sleep
        self._is_closed = False

    def send(self, data: bytes) -> None:
        """Hand bytes to the driver; see `Link.send`."""
        self._check_open()
        if self.report_bytes is None:
            self.driver.receive(data)
            return
        for report in to_reports(data, self.report_bytes):
            self.driver.receive_report(report)

    def receive(self, timeout_s: float = 0.0) -> bytes:
        """Return the driver's answers; see `Link.receive`."""
        driver = self.driver
        end_s = driver.clock() + timeout_s if driver.pace != "virtual" else 0.0
        while True:
            self._check_open()
            data = driver.transmit() if self.report_bytes is None else self._receive_reports()
            if data or driver.pace == "virtual":
                return data
            now_s = driver.clock()
            if now_s >= end_s:
                return b""
            self._sleep(min(end_s - now_s, 1e-3))
            # A test's clock stands still while this thread waits, so the wait would never end.
            if driver.clock() == now_s:
                return b""

    def close(self) -> None:
        """Close the link; the driver ends at 0 V. Idempotent."""
        if not self._is_closed:
            self._is_closed = True
            self.driver.release()

    def _receive_reports(self) -> bytes:
        reports = iter(self.driver.transmit_report, b"")
        return b"".join(from_report(report)[0] for report in reports)

    def _check_open(self) -> None:
        if self._is_closed:
            raise DeviceDisconnectedError("The mock link is closed; open the device again.")


def _open(reports: bool = False, sense_rate_hz: int = 0, **values: Any) -> MockLink:
    if sense_rate_hz:
        values["converter"] = MockConverter(rate_hz=sense_rate_hz)
    return MockLink(MockDriver(**values), REPORT_BYTES if reports else None)


SCHEME = Scheme(
    _open,
    {
        "tests_itself": yes_or_no,
        "sense_rate_hz": count,
        "pace": one_of(*get_args(Pace)),
        "reports": yes_or_no,
        "full_scale_v": number,
        "ceiling_v": number,
        "serial": str,
    },
    makes_rate=True,
)
