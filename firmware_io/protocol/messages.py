"""The messages of host and device, faults among them, as Python objects (PROTOCOL.md)."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum
from typing import NamedTuple

import numpy as np
import numpy.typing as npt


class FaultCode(IntEnum):
    """Why the device refused a frame, or stopped by itself."""

    NONE = 0
    DAMAGED = 1
    VERSION = 2
    KIND = 3
    LENGTH = 4
    SEQUENCE = 5
    SAMPLE_INDEX = 6
    NOT_ARMED = 7
    ALREADY_ARMED = 8
    NOT_SET_UP = 9
    SETUP = 10
    MODE = 11
    CEILING = 12
    SLEW = 13
    QUEUE_FULL = 14
    STARVED = 15
    TRUNCATED = 16
    ENERGY = 17
    MEAN = 18
    PEAK_CURRENT = 19
    RMS_CURRENT = 20
    NO_CURRENT = 21
    OVERLOAD = 22


@dataclass(frozen=True)
class FaultReport:
    """Device: it refused a frame, or ended the stream by itself."""

    code: FaultCode
    """The first cause."""
    field_offset: int
    """For SETUP, the offset of the first impossible field in the payload; else 0."""
    sequence: int
    """Sequence of the refused frame; 0 if there is none."""
    expected: int
    got: int
    """Their meaning for each code is in PROTOCOL.md."""
    clock_ticks: int
    """Time, by the device's clock."""

    def __str__(self) -> str:
        return _SENTENCES[self.code].format(
            expected=self.expected,
            got=self.got,
            expected_v=self.expected / 1e3,
            got_v=self.got / 1e3,
            expected_s=self.expected / 1e3,
            field=_SETUP_FIELDS.get(self.field_offset, "payload"),
            name=_ONLY_DISARMED.get(self.got, "A frame"),
        )


_SETUP_FIELDS = {
    0: "mode",
    2: "watchdog_ms",
    4: "sample_rate_hz",
    8: "full_scale_mv",
    12: "ceiling_mv",
    16: "max_slew_v_per_s",
    20: "carrier_mhz",
    24: "lead_us",
    28: "status_ms",
}

#: Kinds of frames that are refused while armed.
_ONLY_DISARMED = {0x02: "SETUP", 0x03: "ARM"}

_SENTENCES = {
    FaultCode.NONE: "No fault.",
    FaultCode.DAMAGED: "A frame came damaged: a check sum of {expected:#x} was due, {got:#x} came.",
    FaultCode.VERSION: "The device speaks protocol version {expected}, but version {got} came.",
    FaultCode.KIND: "The device knows no frame of kind {got:#04x}.",
    FaultCode.LENGTH: "A payload of {expected} bytes was due, but {got} bytes came.",
    FaultCode.SEQUENCE: "Expected sequence {expected}, but {got} came.",
    FaultCode.SAMPLE_INDEX: "Expected sample index {expected}, but {got} came.",
    FaultCode.NOT_ARMED: "STREAM came while not armed.",
    FaultCode.ALREADY_ARMED: "{name} came while armed.",
    FaultCode.NOT_SET_UP: "ARM came before SETUP.",
    FaultCode.SETUP: "The set-up's {field} of {got} is refused, the bound is {expected}.",
    FaultCode.MODE: "Mode {expected} was due, but mode {got} came.",
    FaultCode.CEILING: "A sample of {got_v:g} V is above the ceiling of {expected_v:g} V.",
    FaultCode.SLEW: "Sample {got} of a frame breaks the slew limit of {expected} V/s.",
    FaultCode.QUEUE_FULL: "There was room for {expected} samples, but {got} came.",
    FaultCode.STARVED: (
        "The stream starved, no frame came within {expected_s:g} s; send samples earlier, with a "
        "longer lead or in longer blocks, and stop before a pause."
    ),
    FaultCode.TRUNCATED: "A frame broke off: {expected} bytes were due, but {got} came.",
    FaultCode.ENERGY: (
        "The rms voltage over a second would exceed {expected_v:g} V, with the time that a sample "
        "was held; lower the amplitude, or pause."
    ),
    FaultCode.MEAN: (
        "The mean voltage over a second would exceed {expected_v:g} V, with the time that a sample "
        "was held; remove the offset, send without pauses, and rest before trying again."
    ),
    FaultCode.PEAK_CURRENT: (
        "The current measured beside that of the panel exceeds 0.7 mA, by {got} codes of the "
        "converter of {expected}; look for a leak, or for what else touches the screen."
    ),
    FaultCode.RMS_CURRENT: (
        "The current measured beside that of the panel exceeds 0.5 mA rms, by {got} codes of the "
        "converter of {expected}; look for a leak, or for what else touches the screen."
    ),
    FaultCode.NO_CURRENT: (
        "The electrode draws less than half of the panel's current; it is broken, or the screen or "
        "its ground is not connected."
    ),
    FaultCode.OVERLOAD: (
        "The electrode draws more than twice the panel's current, or more than the converter "
        "measures; look for a short circuit and for a second body."
    ),
}


class FrameKind(IntEnum):
    """The kind of a frame; those from 0x81 on come from the device."""

    HELLO = 0x01
    SETUP = 0x02
    ARM = 0x03
    STREAM = 0x04
    STOP = 0x05
    PING = 0x06
    REVISE = 0x07
    MARK = 0x08
    CAPABILITIES = 0x81
    STATUS = 0x82
    FAULT = 0x83
    TOUCH = 0x84
    MARKED = 0x85
    SENSE = 0x86


class SensorProblem(IntEnum):
    """Why the driver does not believe its converter, and limits a computed current alone."""

    NONE = 0
    STUCK = 1
    LIES = 2
    LATE = 3
    DIRECT = 4


class StreamMode(IntEnum):
    """The meaning of a stream's samples: the drive itself, or the amplitude of a carrier."""

    WAVEFORM = 0
    ENVELOPE = 1


class DeviceState(IntEnum):
    """The state of the device."""

    IDLE = 0
    ARMED = 1
    PLAYING = 2
    RAMPING = 3


class TouchPhase(IntEnum):
    """What happened to a finger on the panel."""

    UP = 0
    DOWN = 1
    MOVE = 2


@dataclass(frozen=True)
class Hello:
    """Host: begin a session, and ask for the device's capabilities."""

    oldest_version: int = 4
    newest_version: int = 4
    """The protocol versions that the host speaks, 0 to 255."""


@dataclass(frozen=True)
class Setup:
    """Host: how to play the samples that follow."""

    mode: StreamMode
    """Whether samples are the drive, or the amplitude of a carrier that the device makes."""
    watchdog_ms: int
    """The output is at 0 V this long after the last accepted STREAM frame."""
    sample_rate_hz: int
    """Samples per second of the stream."""
    full_scale_mv: int
    """The voltage of code 32767 that the host assumes; the device refuses any but its own."""
    ceiling_mv: int
    """Largest sample to accept; at most the one in force."""
    max_slew_v_per_s: int
    """Largest slew to accept; at most the one in force."""
    carrier_mhz: int = 0
    """Carrier frequency in millihertz; 0 in waveform mode."""
    lead_us: int = 25_000
    """Playback begins this long after the first STREAM frame, in microseconds."""
    status_ms: int = 0
    """Interval of unrequested STATUS frames while armed; 0 for none."""


@dataclass(frozen=True)
class Arm:
    """Host: prepare to play, from sample index 0."""


@dataclass(frozen=True, eq=False)
class StreamSamples:
    """Host: the next samples (kind STREAM)."""

    sample_index: int
    """Samples sent since ARM before this frame, modulo 2**32."""
    codes: npt.NDArray[np.int16]
    """Codes, 1 <= n <= `MAX_SAMPLES`; shape (n,)."""
    mode: StreamMode = StreamMode.WAVEFORM
    """Their meaning; as in the set-up."""

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, StreamSamples):
            return NotImplemented
        return (self.sample_index, self.mode) == (other.sample_index, other.mode) and bool(
            np.array_equal(self.codes, other.codes)
        )

    __hash__ = None  # type: ignore[assignment]  # arrays have none


@dataclass(frozen=True, eq=False)
class Revise(StreamSamples):
    """Host: replace samples that are queued and not yet due (kind REVISE).

    Parameters
    ----------
    sample_index : int
        Index of the first of them, counted as in `StreamSamples`.
    codes : ndarray of int16, shape (n,)
        Codes, 1 <= n <= `MAX_SAMPLES` - 1.
    mode : StreamMode
        Their meaning; as in the set-up.
    revision : int
        Revisions obeyed since ARM, modulo 2**16: another one is refused.
    """

    revision: int = 0

    def __eq__(self, other: object) -> bool:
        return (
            isinstance(other, Revise)
            and self.revision == other.revision
            and super().__eq__(other) is True
        )

    __hash__ = None


@dataclass(frozen=True)
class Stop:
    """Host: ramp to 0 V and disarm."""


@dataclass(frozen=True)
class Ping:
    """Host: ask for a STATUS that carries this token, 0 to 2**32 - 1."""

    token: int = 0


@dataclass(frozen=True)
class Mark:
    """Host: tell when a sample is played, by the digital line and by MARKED."""

    sample_index: int
    """Index of the sample, counted as in `StreamSamples`; it may be sent later."""
    code: int = 0
    """What MARKED repeats, 0 to 65535."""


@dataclass(frozen=True)
class Rate:
    """A sample rate of the device, and its modes at that rate."""

    sample_rate_hz: int
    modes: frozenset[StreamMode]


@dataclass(frozen=True)
class CapabilitiesReport:
    """Device: its capabilities; the answer to HELLO."""

    oldest_version: int
    newest_version: int
    """Its protocol versions."""
    report_bytes: int
    """Size of its HID reports; 0 if it has none."""
    output_rate_hz: int
    """Rate of its output, and of its clock."""
    full_scale_mv: int
    """The voltage of code 32767."""
    ceiling_mv: int
    max_slew_v_per_s: int
    """Its hard limits."""
    queue_samples: int
    max_frame_samples: int
    """Depth of its queue, and length of its longest STREAM frame."""
    max_watchdog_ms: int
    """Its longest watchdog time."""
    name: str
    serial: str
    calibration_id: str
    """ASCII, at most 16 characters each."""
    reports_touch: bool
    """Whether it sends TOUCH."""
    rates: tuple[Rate, ...] = field(default_factory=tuple)
    """1 to 8 sample rates."""
    guard_ticks: int = 16
    """Output samples that a revision must begin ahead of the output; 0 if it takes none."""
    takes_marks: bool = False
    """Whether it takes MARK, and has a digital line for it."""
    has_tested_itself: bool = False
    """Whether its memory, program and limits passed its tests at power-up."""
    reset_cause: int = 0
    """0 unknown, 1 power, and its watchdog has been seen to reset it, 2 its watchdog."""
    sense_rate_hz: int = 0
    """Readings of its current a second: 250, 500, 1000, 2000 or 4000; 0 without a sensor."""


@dataclass(frozen=True)
class StatusReport:
    """Device: its state."""

    state: DeviceState
    """Its state at the moment."""
    fault: FaultCode
    """The first fault since the last accepted HELLO, SETUP or ARM."""
    next_sequence: int
    """The sequence after that of the last accepted frame."""
    token: int
    """Token of the last PING."""
    queued_samples: int
    free_samples: int
    """Samples in its queue, and how many more the host may send."""
    samples_played: int
    """Samples taken from the queue since ARM, modulo 2**32."""
    underruns: int
    faults: int
    """Counters since power-up."""
    clock_ticks: int
    """Output samples since power-up: the device's clock."""
    revisions: int = 0
    refused: int = 0
    """Revisions obeyed and refused since ARM, modulo 2**16."""
    margin_samples: int = 0
    """Samples from the output to the first of the last revision, when it came."""


@dataclass(frozen=True)
class TouchReport:
    """Device: one finger on the panel."""

    clock_ticks: int
    """Time, by the device's clock."""
    x_um: int
    y_um: int
    """Position, in micrometres from the upper left corner of the panel."""
    normal_force_mn: int
    """Normal force, in millinewtons; 65535 if the panel does not measure it."""
    contact: int
    """Number of the finger, 0 to 255."""
    phase: TouchPhase
    """What happened to it."""


@dataclass(frozen=True)
class MarkedReport:
    """Device: a sample that was marked is on the output."""

    clock_ticks: int
    """Time of its first output sample, at which the digital line rose, by the device's clock;
    `NEVER` if it had been played when the MARK came."""
    sample_index: int
    code: int
    """As in the MARK."""


class SenseReading(NamedTuple):
    """The current over whole periods of the carrier, or why none is measured."""

    clock_ticks: int
    """Time of its end, by the device's clock."""
    in_phase_na: int
    ahead_na: int
    """Amplitude in phase with the drive, and ahead of it by a quarter period, in nanoamperes."""
    driven: int
    """Amplitude driven, as a code."""
    flags: int
    """Bit 0: saturated; bits 1 to 3: a `SensorProblem`."""

    @property
    def problem(self) -> SensorProblem:
        """Why the driver does not believe it."""
        return SensorProblem(min(self.flags >> 1 & 7, SensorProblem.DIRECT))


@dataclass(frozen=True)
class SenseReport:
    """Device: readings of its current (kind SENSE)."""

    readings: tuple[SenseReading, ...]
    """Oldest first, at least one."""


#: Time of a mark that came too late.
NEVER = 2**64 - 1

HostMessage = Hello | Setup | Arm | StreamSamples | Revise | Stop | Ping | Mark
DeviceMessage = (
    CapabilitiesReport | StatusReport | FaultReport | TouchReport | MarkedReport | SenseReport
)
Message = HostMessage | DeviceMessage

#: Samples in a payload of 65535 bytes, after a sample index of four.
MAX_SAMPLES = (2**16 - 1 - 4) // 2
