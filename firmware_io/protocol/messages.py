"""The messages of host and device, as Python objects (bytes: see frames.py, PROTOCOL.md)."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np
import numpy.typing as npt

from firmware_io.errors import ProtocolError
from firmware_io.protocol.faults import FaultCode, FaultReport


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
    """Host: begin a session, and ask for the device's capabilities.

    Parameters
    ----------
    oldest_version, newest_version : int
        The protocol versions that the host speaks, 0 to 255.
    """

    oldest_version: int = 3
    newest_version: int = 4


@dataclass(frozen=True)
class Setup:
    """Host: how to play the samples that follow.

    Parameters
    ----------
    mode : StreamMode
        Whether samples are the drive, or the amplitude of a carrier that the device makes.
    watchdog_ms : int
        The output is at 0 V this long after the last accepted STREAM frame.
    sample_rate_hz : int
        Samples per second of the stream.
    full_scale_mv : int
        The voltage of code 32767 that the host assumes; the device refuses any but its own.
    ceiling_mv : int
        Largest sample to accept; at most the one in force.
    max_slew_v_per_s : int
        Largest slew to accept; at most the one in force.
    carrier_mhz : int
        Carrier frequency in millihertz; 0 in waveform mode.
    lead_us : int
        Playback begins this long after the first STREAM frame, in microseconds.
    status_ms : int
        Interval of unrequested STATUS frames while armed; 0 for none.
    """

    mode: StreamMode
    watchdog_ms: int
    sample_rate_hz: int
    full_scale_mv: int
    ceiling_mv: int
    max_slew_v_per_s: int
    carrier_mhz: int = 0
    lead_us: int = 25_000
    status_ms: int = 0


@dataclass(frozen=True)
class Arm:
    """Host: prepare to play, from sample index 0."""


@dataclass(frozen=True, eq=False)
class StreamSamples:
    """Host: the next samples (kind STREAM).

    Parameters
    ----------
    sample_index : int
        Samples sent since ARM before this frame, modulo 2**32.
    codes : ndarray of int16, shape (n,)
        Codes, 1 <= n <= `MAX_SAMPLES`.
    mode : StreamMode
        Their meaning; as in the set-up.

    Raises
    ------
    ProtocolError
        If `codes` has another type, shape or size.
    """

    sample_index: int
    codes: npt.NDArray[np.int16]
    mode: StreamMode = StreamMode.WAVEFORM

    def __post_init__(self) -> None:
        if self.codes.dtype != np.int16 or self.codes.ndim != 1:
            raise ProtocolError(
                f"codes must be a 1-D int16 array, but is {self.codes.ndim}-D {self.codes.dtype}; "
                "make codes with volts_to_codes."
            )
        if not 1 <= self.codes.size <= MAX_SAMPLES:
            raise ProtocolError(
                f"A frame carries 1 to {MAX_SAMPLES} samples, but has {self.codes.size}; split it."
            )

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
    """Host: tell when a sample is played, by the digital line and by MARKED.

    Parameters
    ----------
    sample_index : int
        Index of the sample, counted as in `StreamSamples`; it may be sent later.
    code : int
        What MARKED repeats, 0 to 65535.
    """

    sample_index: int
    code: int = 0


@dataclass(frozen=True)
class Rate:
    """A sample rate of the device, and its modes at that rate."""

    sample_rate_hz: int
    modes: frozenset[StreamMode]


@dataclass(frozen=True)
class CapabilitiesReport:
    """Device: its capabilities; the answer to HELLO.

    Parameters
    ----------
    oldest_version, newest_version : int
        Its protocol versions.
    report_bytes : int
        Size of its HID reports; 0 if it has none.
    output_rate_hz : int
        Rate of its output, and of its clock.
    full_scale_mv : int
        The voltage of code 32767.
    ceiling_mv, max_slew_v_per_s : int
        Its hard limits.
    queue_samples, max_frame_samples : int
        Depth of its queue, and length of its longest STREAM frame.
    max_watchdog_ms : int
        Its longest watchdog time.
    name, serial, calibration_id : str
        ASCII, at most 16 characters each.
    reports_touch : bool
        Whether it sends TOUCH.
    rates : tuple of Rate
        1 to 8 sample rates.
    guard_ticks : int
        Output samples that a revision must begin ahead of the output; 0 if it takes none.
    takes_marks : bool
        Whether it takes MARK, and has a digital line for it.
    """

    oldest_version: int
    newest_version: int
    report_bytes: int
    output_rate_hz: int
    full_scale_mv: int
    ceiling_mv: int
    max_slew_v_per_s: int
    queue_samples: int
    max_frame_samples: int
    max_watchdog_ms: int
    name: str
    serial: str
    calibration_id: str
    reports_touch: bool
    rates: tuple[Rate, ...] = field(default_factory=tuple)
    guard_ticks: int = 16
    takes_marks: bool = False


@dataclass(frozen=True)
class StatusReport:
    """Device: its state.

    Parameters
    ----------
    state : DeviceState
        What it does at the moment.
    fault : FaultCode
        The first fault since the last accepted HELLO, SETUP or ARM.
    next_sequence : int
        The sequence after that of the last accepted frame.
    token : int
        Token of the last PING.
    queued_samples, free_samples : int
        Samples in its queue, and how many more the host may send.
    samples_played : int
        Samples taken from the queue since ARM, modulo 2**32.
    underruns, faults : int
        Counters since power-up.
    clock_ticks : int
        Output samples since power-up: the device's clock.
    revisions, refused : int
        Revisions obeyed and refused since ARM, modulo 2**16.
    margin_samples : int
        Samples from the output to the first of the last revision, when it came.
    """

    state: DeviceState
    fault: FaultCode
    next_sequence: int
    token: int
    queued_samples: int
    free_samples: int
    samples_played: int
    underruns: int
    faults: int
    clock_ticks: int
    revisions: int = 0
    refused: int = 0
    margin_samples: int = 0


@dataclass(frozen=True)
class TouchReport:
    """Device: one finger on the panel.

    Parameters
    ----------
    clock_ticks : int
        Time, by the device's clock.
    x_um, y_um : int
        Position, in micrometres from the upper left corner of the panel.
    normal_force_mn : int
        Normal force, in millinewtons; 65535 if the panel does not measure it.
    contact : int
        Number of the finger, 0 to 255.
    phase : TouchPhase
        What happened to it.
    """

    clock_ticks: int
    x_um: int
    y_um: int
    normal_force_mn: int
    contact: int
    phase: TouchPhase


@dataclass(frozen=True)
class MarkedReport:
    """Device: a sample that was marked is on the output.

    Parameters
    ----------
    clock_ticks : int
        Time of its first output sample, at which the digital line rose, by the device's clock;
        `NEVER` if it had been played when the MARK came.
    sample_index, code : int
        As in the MARK.
    """

    clock_ticks: int
    sample_index: int
    code: int


#: Time of a mark that came too late.
NEVER = 2**64 - 1

HostMessage = Hello | Setup | Arm | StreamSamples | Revise | Stop | Ping | Mark
DeviceMessage = CapabilitiesReport | StatusReport | FaultReport | TouchReport | MarkedReport
Message = HostMessage | DeviceMessage

#: Samples in a payload of 65535 bytes, behind a sample index of four.
MAX_SAMPLES = (2**16 - 1 - 4) // 2
