"""The oracle: the device side of the protocol in Python, written from PROTOCOL.md.

It plays the same samples and answers the same bytes as the firmware in C; the conformance tests
compare the two.
"""

from __future__ import annotations

import struct
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from firmware_io.firmware.core import LINE, Sensor
from firmware_io.protocol import (
    FULL_SCALE_CODE,
    INDEX_MODULUS,
    NEVER,
    SEQUENCE_MODULUS,
    VERSION,
    CapabilitiesReport,
    DeviceMessage,
    DeviceState,
    FaultCode,
    FaultReport,
    Frame,
    FrameKind,
    Mark,
    MarkedReport,
    SenseReport,
    Setup,
    StatusReport,
    StreamMode,
    TouchPhase,
    TouchReport,
    encode,
    to_reports,
)
from firmware_io.protocol.frames import LAYOUTS, read_payload
from tests.firmware_io.oracle.board import (
    DRY_MS,
    MIN_CARRIER_MHZ,
    MIN_WATCHDOG_MS,
    PAUSE_MS,
    RAMP_MS,
    ceiling_code,
    check_board,
    lowest_slew,
)
from tests.firmware_io.oracle.output import Codes, OracleOutput, Playing, Whats
from tests.firmware_io.oracle.receiver import Head, Receiver
from tests.firmware_io.oracle.sensor import OracleSensor
from tests.firmware_io.oracle.window import MAX_RMS_MV, MEAN_DIVISOR, Window

MAX_TOUCHES = MAX_MARKS = 8
MARK_MS = 1
READINGS_IN_A_FRAME = 8
CUT = 20

_SETUP = LAYOUTS[FrameKind.SETUP].fields
#: Bytes in front of the samples of a payload.
_SAMPLE_HEADS: dict[FrameKind, int] = {FrameKind.STREAM: 4, FrameKind.REVISE: 6}


class Oracle:
    """The firmware in Python, with the calls of `firmware_io.firmware.core.Core`.

    Parameters
    ----------
    config : CapabilitiesReport
        Capabilities of the device.
    sensor : Sensor, optional
        Its converter, if it states a rate of readings.

    Raises
    ------
    DeviceError
        If `config` describes no possible device.
    """

    def __init__(self, config: CapabilitiesReport, sensor: Sensor | None = None) -> None:
        check_board(config, sensor or Sensor(0.0, 0.0))
        self._config = replace(config, oldest_version=VERSION, newest_version=VERSION)
        self._setup: Setup | None = None
        rate_hz = config.output_rate_hz
        ramp_ticks = -(-rate_hz * RAMP_MS // 1000)
        top_code = ceiling_code(config, config.ceiling_mv)
        self._output = OracleOutput(
            ramp_ticks,
            rate_hz * DRY_MS // 1000 - ramp_ticks,
            Window(rate_hz, config.full_scale_mv, top_code, ramp_ticks),
        )
        self._forget_setup()
        self._longest_stream = 4 + 2 * config.max_frame_samples
        self._receiver = Receiver(
            self,
            max(self._longest_stream + 2, _SETUP.size),
            config.output_rate_hz * PAUSE_MS // 1000,
        )
        self.is_armed = False
        self._next_sequence = 0
        self._next_index = 0
        self._last_queued = 0
        self._revisions = self._refused = self._margin = 0
        self._silent_ticks = 0
        self._since_status_ticks = 0
        self._clock = 0
        self._faults = 0
        self._token = 0
        self._fault: FaultReport | None = None
        self._capabilities_due = self._fault_due = self._status_due = False
        self._answer_sequence = 0
        self._reports: list[bytes] = []
        self._marks: list[tuple[Mark, int | None]] = []  # and when its sample was played
        self._line_until = 0
        self._touches: list[TouchReport] = []
        has_sensor = sensor is not None and config.sense_rate_hz
        self._sensor = OracleSensor(config, sensor, self) if sensor and has_sensor else None

    # Bytes in

    def receive(self, data: bytes) -> None:
        """Take bytes from the host."""
        self._receiver.receive(data)

    def receive_report(self, report: bytes) -> None:
        """Take one HID report from the host."""
        self._receiver.receive_report(report)

    # Frames

    def take_frame(self, head: Head, payload: bytes) -> None:
        """Obey a whole frame, or refuse it."""
        last_kind = FrameKind.MARK if self._config.takes_marks else FrameKind.REVISE
        if not FrameKind.HELLO <= head.kind <= last_kind:
            return self.refuse(FaultCode.KIND, head.sequence, 0, head.kind)
        kind = FrameKind(head.kind)
        if kind in _SAMPLE_HEADS:
            least, longest = _SAMPLE_HEADS[kind] + 2, self._longest_stream - 4 + _SAMPLE_HEADS[kind]
            if head.length < least or head.length % 2 or head.length > longest:
                return self.refuse(FaultCode.LENGTH, head.sequence, longest, head.length)
        elif head.length != (length := LAYOUTS[kind].fields.size):
            return self.refuse(FaultCode.LENGTH, head.sequence, length, head.length)
        elif head.mode:
            return self.refuse(FaultCode.MODE, head.sequence, 0, head.mode)
        if kind is FrameKind.HELLO:
            return self._take_hello(head.sequence, payload)
        if self.is_armed:
            if head.sequence != self._next_sequence:
                self.refuse(FaultCode.SEQUENCE, head.sequence, self._next_sequence, head.sequence)
                self._status_due |= kind is FrameKind.STOP
                return None
            if kind in (FrameKind.SETUP, FrameKind.ARM):
                return self.refuse(FaultCode.ALREADY_ARMED, head.sequence, 0, kind)
        if kind is FrameKind.SETUP:
            self._take_setup(head.sequence, payload)
        elif kind is FrameKind.ARM:
            self._take_arm(head.sequence)
        elif kind is FrameKind.STREAM:
            self._take_stream(head, payload)
        elif kind is FrameKind.REVISE:
            self._take_revise(head, payload)
        elif kind is FrameKind.MARK:
            self._take_mark(head.sequence, payload)
        else:
            self._accept(head.sequence)
            self._status_due = True
            if kind is FrameKind.PING:
                self._token = int.from_bytes(payload, "little")
            else:
                self._end_output()
        return None

    def _take_hello(self, sequence: int, payload: bytes) -> None:
        oldest, newest = payload
        self._end_output()
        self._forget_setup()
        self._clear_fault()
        self._status_due = False
        self._marks = []
        self._forget_readings()
        self._token = 0
        if oldest <= VERSION <= newest:
            self._accept(sequence)
            self._capabilities_due = True
        else:
            self.refuse(
                FaultCode.VERSION, sequence, VERSION, oldest if oldest > VERSION else newest
            )

    def _take_setup(self, sequence: int, payload: bytes) -> None:
        mode, *rest = _SETUP.unpack(payload)
        wrong = self._impossible(mode, *rest)
        if wrong is not None:
            field, bound, got = wrong
            self._setup = None
            return self.refuse(FaultCode.SETUP, sequence, bound, got, field)
        self._setup = Setup(StreamMode(mode), *rest)
        self._ceiling_mv = self._setup.ceiling_mv
        self._max_slew_v_per_s = self._setup.max_slew_v_per_s
        self._clear_fault()
        self._accept(sequence)
        self._status_due = True
        return None

    def _impossible(
        self,
        mode: int,
        watchdog_ms: int,
        rate_hz: int,
        full_scale_mv: int,
        ceiling_mv: int,
        slew: int,
        carrier_mhz: int,
        lead_us: int,
        _status_ms: int,
    ) -> tuple[int, int, int] | None:
        """Return offset, bound and value of the first impossible field."""
        config = self._config
        if mode not in set(StreamMode):
            return 0, 1, mode
        envelope = mode == StreamMode.ENVELOPE
        is_played = any(r.sample_rate_hz == rate_hz and mode in r.modes for r in config.rates)
        carriers = (MIN_CARRIER_MHZ, config.output_rate_hz * 500) if envelope else (0, 0)
        if not MIN_WATCHDOG_MS <= watchdog_ms <= config.max_watchdog_ms:
            is_short = watchdog_ms < MIN_WATCHDOG_MS
            return 2, MIN_WATCHDOG_MS if is_short else config.max_watchdog_ms, watchdog_ms
        if not is_played:
            return 4, config.rates[0].sample_rate_hz, rate_hz
        ranges = (
            (8, config.full_scale_mv, config.full_scale_mv, full_scale_mv),
            (12, 1, self._ceiling_mv, ceiling_mv),
            (16, lowest_slew(config, ceiling_mv), self._max_slew_v_per_s, slew),
            (20, *carriers, carrier_mhz),
            (24, 0, watchdog_ms * 1000, lead_us),
        )
        for offset, low, high, value in ranges:
            if not low <= value <= high:
                return offset, low if value < low else high, value
        return None

    def _take_arm(self, sequence: int) -> None:
        if self._setup is None:
            return self.refuse(FaultCode.NOT_SET_UP, sequence, 0, 0)
        self._clear_fault()
        self._accept(sequence)
        self.is_armed = True
        self._next_index = self._last_queued = self._since_status_ticks = 0
        self._revisions = self._refused = self._margin = 0
        self._output.samples_played = 0
        self._status_due = True
        return None

    def _take_stream(self, head: Head, payload: bytes) -> None:
        sequence, setup, output = head.sequence, self._setup, self._output
        (index,) = struct.unpack_from("<I", payload)
        codes = np.frombuffer(payload, "<i2", offset=4).astype(np.int64)
        if not self.is_armed or setup is None:
            return self.refuse(FaultCode.NOT_ARMED, sequence, 0, 0)
        if index != self._next_index:
            return self.refuse(FaultCode.SAMPLE_INDEX, sequence, self._next_index, index)
        if not self._may_be_queued(head, codes, setup):
            return None
        steep = self._first_too_steep(codes, self._last_queued, setup)
        if steep is not None:
            return self.refuse(FaultCode.SLEW, sequence, setup.max_slew_v_per_s, steep)
        free = self._config.queue_samples - output.queue.size
        if codes.size > free:
            return self.refuse(FaultCode.QUEUE_FULL, sequence, free, codes.size)
        output.queue = np.concatenate([output.queue, codes.astype(np.int16)])
        if not output.has_begun:
            rate = self._config.output_rate_hz
            output.begin(
                setup.lead_us * rate // 1_000_000,
                Playing(
                    setup.mode,
                    rate // setup.sample_rate_hz,
                    setup.carrier_mhz * 2**32 // (rate * 1000),
                    self._step_codes(setup),
                    ceiling_code(self._config, setup.ceiling_mv),
                ),
            )
        self._last_queued = int(codes[-1])
        self._next_index = (index + codes.size) % INDEX_MODULUS
        self._silent_ticks = 0
        return self._accept(sequence)

    def _take_revise(self, head: Head, payload: bytes) -> None:
        sequence, setup, output = head.sequence, self._setup, self._output
        index, revision = struct.unpack_from("<IH", payload)
        codes = np.frombuffer(payload, "<i2", offset=6).astype(np.int64)
        if not self.is_armed or setup is None:
            return self.refuse(FaultCode.NOT_ARMED, sequence, 0, 0)
        # Counted from the output, whole numbers of either sign.
        ahead = _signed(index - output.samples_played)
        end, queued = index + codes.size, output.queue.size
        if ahead > queued or _signed(self._next_index - end) < 0:
            got = end % INDEX_MODULUS
            return self.refuse(FaultCode.SAMPLE_INDEX, sequence, self._next_index, got)
        if not self._may_be_queued(head, codes, setup):
            return None
        self._margin = ahead
        guard = -(-self._config.guard_ticks * setup.sample_rate_hz // self._config.output_rate_hz)
        if ahead < guard or revision != self._revisions:
            self._refused = (self._refused + 1) % SEQUENCE_MODULUS
            self._status_due = True
            return self._accept(sequence)
        # With the sample behind, where there is one: that seam must hold as well.
        seam = output.queue[ahead + codes.size : ahead + codes.size + 1]
        steep = self._first_too_steep(
            np.concatenate([codes, seam]), int(output.queue[ahead - 1]), setup
        )
        if steep is not None:
            return self.refuse(FaultCode.SLEW, sequence, setup.max_slew_v_per_s, steep)
        output.queue = output.queue.copy()
        output.queue[ahead : ahead + codes.size] = codes
        self._last_queued = int(output.queue[-1])
        self._revisions = (self._revisions + 1) % SEQUENCE_MODULUS
        self._silent_ticks = 0
        return self._accept(sequence)

    def _take_mark(self, sequence: int, payload: bytes) -> None:
        if not self.is_armed:
            return self.refuse(FaultCode.NOT_ARMED, sequence, 0, 0)
        if len(self._marks) == MAX_MARKS:
            return self.refuse(FaultCode.QUEUE_FULL, sequence, 0, 1)
        mark: Mark = read_payload(FrameKind.MARK, payload)
        is_late = _signed(mark.sample_index - self._output.samples_played) < 0
        self._marks.append((mark, NEVER if is_late else None))
        return self._accept(sequence)

    def _meet_marks(self, what: Whats) -> None:
        """Note marks whose samples were just played, and add the line to the kinds of samples."""
        ticks = -(-self._config.output_rate_hz * MARK_MS // 1000)
        what[: max(0, self._line_until - self._clock)] |= LINE
        for offset, first, count, each in self._output.taken:
            for place, (mark, clock) in enumerate(self._marks):
                ahead = (mark.sample_index - first) % INDEX_MODULUS
                if clock is None and ahead < count:
                    at = offset + ahead * each
                    self._marks[place] = (mark, self._clock + at)
                    what[at : at + ticks] |= LINE
                    self._line_until = max(self._line_until, self._clock + at + ticks)

    def _may_be_queued(self, head: Head, codes: npt.NDArray[np.int64], setup: Setup) -> bool:
        """Whether mode and ceiling hold for samples; refuse them if not."""
        full_scale_mv = self._config.full_scale_mv
        peak = int(np.abs(codes).max())
        top = ceiling_code(self._config, setup.ceiling_mv)
        if head.mode != setup.mode:
            self.refuse(FaultCode.MODE, head.sequence, setup.mode, head.mode)
        elif peak > top:
            peak_mv = -(-peak * full_scale_mv // FULL_SCALE_CODE)
            self.refuse(FaultCode.CEILING, head.sequence, setup.ceiling_mv, peak_mv)
        else:
            return True
        return False

    def _step_codes(self, setup: Setup) -> int:
        """Return the whole codes by which the slew lets an output sample differ from the last."""
        codes_per_s = setup.max_slew_v_per_s * 1000 * FULL_SCALE_CODE // setup.full_scale_mv
        return codes_per_s // self._config.output_rate_hz

    def _first_too_steep(self, codes: npt.NDArray[np.int64], last: int, setup: Setup) -> int | None:
        before = np.concatenate([[last], codes[:-1]])
        slews = np.abs(codes - before) * setup.sample_rate_hz
        if setup.mode is StreamMode.ENVELOPE:
            carrier_rad_per_s = -(-setup.carrier_mhz * 411775 // 65536000)
            size = np.maximum(np.abs(codes), np.abs(before))
            slews = slews + carrier_rad_per_s * size
        over = slews > self._step_codes(setup) * self._config.output_rate_hz
        return int(over.argmax()) if over.any() else None

    def _accept(self, sequence: int) -> None:
        self._next_sequence = (sequence + 1) % SEQUENCE_MODULUS

    # Faults

    def refuse(
        self, code: FaultCode, sequence: int, expected: int, got: int, field: int = 0
    ) -> None:
        """End the output, keep and count the first fault, and send a FAULT."""
        if self._fault is None:
            self._fault = FaultReport(code, field, sequence, expected, got, self._clock)
            self._faults += 1
        self._fault_due = True
        self._end_output()

    def meet_damage(self, sequence: int, expected: int, got: int) -> None:
        """Refuse bytes that are not a frame; while disarmed they are no fault."""
        if self.is_armed:
            self.refuse(FaultCode.DAMAGED, sequence, expected, got)

    def _clear_fault(self) -> None:
        self._fault, self._fault_due = None, False

    def _end_output(self, ramp_step: int = 1) -> None:
        self.is_armed = False
        self._marks = [one for one in self._marks if one[1] is not None]
        self._output.end(ramp_step)

    def _forget_setup(self) -> None:
        self._setup = None
        self._ceiling_mv = self._config.ceiling_mv
        self._max_slew_v_per_s = self._config.max_slew_v_per_s

    def release(self) -> None:
        """Handle the loss of the host."""
        self._end_output()
        self._forget_setup()
        self._receiver.clear()
        self._capabilities_due = self._fault_due = self._status_due = False
        self._reports.clear()
        self._touches.clear()
        self._forget_readings()
        self._marks = []

    # The current

    @property
    def is_playing(self) -> bool:
        """Whether a playback is under way."""
        return self._output.is_playing

    def sense(self, sent: Codes, raw: Codes) -> None:
        """Take the measured current of the output samples that were played last, as codes."""
        if self._sensor is not None:
            self._sensor.sense(sent, raw)

    def cut(self, code: FaultCode, expected: int, got: int) -> None:
        """End the output by what was measured."""
        self._end_output(CUT)
        self.refuse(code, 0, expected, got)

    def _forget_readings(self) -> None:
        if self._sensor is not None:
            self._sensor.readings.clear()

    # Time

    @property
    def pending_ticks(self) -> int:
        """Output samples until only zeros or a held sample are left to play."""
        return self._output.pending_ticks

    def play(self, ticks: int) -> tuple[Codes, Whats]:
        """Return the next output samples, and the kind of each."""
        pieces: list[tuple[Codes, Whats]] = []
        while ticks:
            count = min(ticks, self._ticks_to_event())
            pieces.append(self._output.play(count))
            self._meet_marks(pieces[-1][1])
            began_at = self._output.began_at
            if self._sensor is not None and began_at is not None:
                assert self._setup is not None
                self._sensor.begin(self._setup, self._clock + began_at)
            count = pieces[-1][0].size
            ticks -= count
            self._pass_time(count)
            if self._output.broken is not FaultCode.NONE:
                mean_mv = self._config.ceiling_mv // MEAN_DIVISOR
                is_mean = self._output.broken is FaultCode.MEAN
                self.refuse(self._output.broken, 0, mean_mv if is_mean else MAX_RMS_MV, 0)
        if self._sensor is not None:
            self._sensor.pass_time(self._clock)
        if not pieces:
            return np.empty(0, np.int16), np.empty(0, np.uint8)
        codes, what = zip(*pieces, strict=True)
        return np.concatenate(codes), np.concatenate(what)

    def play_out(self) -> list[tuple[Codes, Whats]]:
        """Play until only zeros or a held sample are left."""
        played = []
        while ticks := self.pending_ticks:
            played.append(self.play(ticks))
        return played

    def _watchdog_tick(self) -> int:
        assert self._setup is not None
        ticks = self._setup.watchdog_ms * self._config.output_rate_hz // 1000
        return ticks - self._output.ramp_ticks

    def _status_ticks(self) -> int:
        assert self._setup is not None
        return self._setup.status_ms * self._config.output_rate_hz // 1000

    def _ticks_to_event(self) -> int:
        distances = [2**31]
        if self.is_armed and self._output.has_begun:
            distances.append(self._watchdog_tick() - self._silent_ticks)
        if self.is_armed and self._status_ticks():
            distances.append(self._status_ticks() - self._since_status_ticks)
        return min(*distances, self._receiver.ticks_to_event)

    def _pass_time(self, ticks: int) -> None:
        """Advance the time by these ticks; no event is due before the last of them."""
        self._clock += ticks
        self._status_due |= self._output.has_ended_ramp
        self._output.has_ended_ramp = False
        if self.is_armed and self._output.has_begun:
            self._silent_ticks += ticks
            if self._silent_ticks >= self._watchdog_tick():
                assert self._setup is not None
                self.refuse(FaultCode.STARVED, 0, self._setup.watchdog_ms, 0)
        if self.is_armed and self._status_ticks():
            self._since_status_ticks += ticks
            if self._since_status_ticks >= self._status_ticks():
                self._since_status_ticks = 0
                self._status_due = True
        self._receiver.pass_time(ticks)

    # Bytes out

    def status(self) -> StatusReport:
        """Return where the device stands."""
        output = self._output
        if self.is_armed:
            state = DeviceState.PLAYING if output.is_playing else DeviceState.ARMED
        else:
            state = DeviceState.RAMPING if output.ramp_ticks_left else DeviceState.IDLE
        return StatusReport(
            state,
            FaultCode.NONE if self._fault is None else self._fault.code,
            self._next_sequence,
            self._token,
            output.queue.size,
            self._config.queue_samples - output.queue.size,
            output.samples_played,
            output.underruns,
            self._faults,
            self._clock,
            self._revisions,
            self._refused,
            self._margin,
        )

    def fault(self) -> FaultReport | None:
        """Return the first cause since HELLO, SETUP or ARM was last accepted."""
        return self._fault

    def touch(self, touch: TouchReport) -> bool:
        """Report a finger."""
        if self._sensor is not None:
            self._sensor.touch(touch.contact, touch.phase is not TouchPhase.UP)
        if len(self._touches) == MAX_TOUCHES:
            return False
        self._touches.append(
            TouchReport(
                self._clock,
                touch.x_um,
                touch.y_um,
                touch.normal_force_mn,
                touch.contact,
                touch.phase,
            )
        )
        return True

    def transmit(self) -> bytes:
        """Return the frames that wait for the host."""
        frames = b""
        self._receiver.look_again()
        while message := self._next_message():
            frames += self._encode(message)
        return frames

    def transmit_report(self) -> bytes:
        """Return one HID report for the host."""
        size = self._config.report_bytes
        if not size:
            return b""
        self._receiver.look_again()
        if not self._reports and (message := self._next_message()):
            self._reports = to_reports(self._encode(message), size)
        return self._reports.pop(0) if self._reports else b""

    def _encode(self, message: DeviceMessage) -> bytes:
        frame = encode(Frame(message, self._answer_sequence))
        self._answer_sequence = (self._answer_sequence + 1) % SEQUENCE_MODULUS
        return frame

    def _next_message(self) -> DeviceMessage | None:
        """Return the most urgent message and mark it as sent."""
        if self._capabilities_due:
            self._capabilities_due = False
            return self._config
        if self._fault_due and self._fault is not None:
            self._fault_due = False
            return self._fault
        if self._status_due:
            self._status_due = False
            return self.status()
        for place, (mark, clock) in enumerate(self._marks):
            if clock is not None:
                del self._marks[place]
                return MarkedReport(clock, mark.sample_index, mark.code)
        if self._touches:
            return self._touches.pop(0)
        if self._sensor is not None and self._sensor.readings:
            waiting = self._sensor.readings
            told, self._sensor.readings = (
                waiting[:READINGS_IN_A_FRAME],
                waiting[READINGS_IN_A_FRAME:],
            )
            return SenseReport(tuple(told))
        return None


def _signed(difference: int) -> int:
    """Return a difference of sample indices as a number of either sign."""
    return (difference + INDEX_MODULUS // 2) % INDEX_MODULUS - INDEX_MODULUS // 2
