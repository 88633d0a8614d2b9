"""What stands between a frame's header and its CRC, for every kind but STREAM."""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import astuple
from enum import IntEnum
from typing import TypeVar

from firmware_io.errors import ProtocolError
from firmware_io.protocol.faults import FaultCode, FaultReport
from firmware_io.protocol.messages import (
    Arm,
    CapabilitiesReport,
    DeviceState,
    FrameKind,
    Hello,
    Message,
    Ping,
    Rate,
    Setup,
    StatusReport,
    Stop,
    StreamMode,
    TouchPhase,
    TouchReport,
)

_HELLO = struct.Struct("<BB")
_SETUP = struct.Struct("<HHIIIIIIH")
_PING = struct.Struct("<I")
_CAPABILITIES = struct.Struct("<BBHIIIIIHH16s16s16sHH")
_RATE = struct.Struct("<II")
_STATUS = struct.Struct("<BBHIIIIIIQ")
_FAULT = struct.Struct("<BBHIIQ")
_TOUCH = struct.Struct("<QIIHBB")
STATUS_BYTES = _STATUS.size
FAULT_BYTES = _FAULT.size
_MAX_RATES = 8

_Member = TypeVar("_Member", bound=IntEnum)


def member(of: type[_Member], value: int, what: str) -> _Member:
    """Return the member of an enumeration that a number stands for, or raise ProtocolError."""
    try:
        return of(value)
    except ValueError:
        known = ", ".join(str(member.value) for member in of)
        raise ProtocolError(
            f"A {what} is one of {known}, but {value} came; bring host and firmware to the same "
            "version."
        ) from None


def _write_setup(setup: Setup) -> bytes:
    return _SETUP.pack(*astuple(setup))


def _read_setup(payload: bytes) -> Setup:
    mode, *rest = _SETUP.unpack(payload)
    return Setup(member(StreamMode, mode, "stream mode"), *rest)


def _write_capabilities(report: CapabilitiesReport) -> bytes:
    if not 1 <= len(report.rates) <= _MAX_RATES:
        raise ProtocolError(
            f"A device has 1 to {_MAX_RATES} sample rates, but {len(report.rates)} are given; "
            "correct the list."
        )
    texts = [_text_bytes(t) for t in (report.name, report.serial, report.calibration_id)]
    head = _CAPABILITIES.pack(
        report.oldest_version,
        report.newest_version,
        report.report_bytes,
        report.output_rate_hz,
        report.full_scale_mv,
        report.ceiling_mv,
        report.max_slew_v_per_s,
        report.queue_samples,
        report.max_frame_samples,
        report.max_watchdog_ms,
        *texts,
        report.reports_touch,
        len(report.rates),
    )
    rates = (_RATE.pack(r.sample_rate_hz, sum(1 << mode for mode in r.modes)) for r in report.rates)
    return head + b"".join(rates)


def _read_capabilities(payload: bytes) -> CapabilitiesReport:
    fields = _CAPABILITIES.unpack_from(payload)
    count = fields[-1]
    if not 1 <= count <= _MAX_RATES or len(payload) != _CAPABILITIES.size + count * _RATE.size:
        raise ProtocolError(
            f"CAPABILITIES of {count} sample rates came with {len(payload)} bytes; 1 to "
            f"{_MAX_RATES} rates of {_RATE.size} bytes follow on {_CAPABILITIES.size}."
        )
    name, serial, calibration_id = (_text(data) for data in fields[10:13])
    rates = tuple(
        Rate(rate_hz, frozenset(mode for mode in StreamMode if modes >> mode & 1))
        for rate_hz, modes in _RATE.iter_unpack(payload[_CAPABILITIES.size :])
    )
    numbers: tuple[int, int, int, int, int, int, int, int, int, int] = fields[:10]
    return CapabilitiesReport(
        *numbers, name, serial, calibration_id, reports_touch=bool(fields[13] & 1), rates=rates
    )


def _text_bytes(text: str) -> bytes:
    data = text.encode("ascii")
    if len(data) > 16 or b"\0" in data:
        raise ProtocolError(
            f"Names on the wire have at most 16 ASCII characters, but {text!r} came; shorten it."
        )
    return data


def _text(data: bytes) -> str:
    return data.split(b"\0", 1)[0].decode("ascii")


def read_status(payload: bytes) -> StatusReport:
    """Return what the payload of a STATUS says."""
    state, fault, *rest = _STATUS.unpack(payload)
    return StatusReport(
        member(DeviceState, state, "device state"), member(FaultCode, fault, "fault code"), *rest
    )


def read_fault(payload: bytes) -> FaultReport:
    """Return what the payload of a FAULT says."""
    code, *rest = _FAULT.unpack(payload)
    return FaultReport(member(FaultCode, code, "fault code"), *rest)


def _read_touch(payload: bytes) -> TouchReport:
    clock, x_um, y_um, force_mn, contact, phase = _TOUCH.unpack(payload)
    known = member(TouchPhase, phase, "touch phase")
    return TouchReport(clock, x_um, y_um, force_mn, contact, known)


def _read_nothing(message: Message) -> Callable[[bytes], Message]:
    nothing = struct.Struct("<")

    def read(payload: bytes) -> Message:
        nothing.unpack(payload)
        return message

    return read


WRITERS: dict[type, tuple[FrameKind, Callable[..., bytes]]] = {
    Hello: (FrameKind.HELLO, lambda m: _HELLO.pack(m.oldest_version, m.newest_version)),
    Setup: (FrameKind.SETUP, _write_setup),
    Arm: (FrameKind.ARM, lambda _: b""),
    Stop: (FrameKind.STOP, lambda _: b""),
    Ping: (FrameKind.PING, lambda m: _PING.pack(m.token)),
    CapabilitiesReport: (FrameKind.CAPABILITIES, _write_capabilities),
    StatusReport: (FrameKind.STATUS, lambda m: _STATUS.pack(*astuple(m))),
    FaultReport: (FrameKind.FAULT, lambda m: _FAULT.pack(*astuple(m))),
    TouchReport: (FrameKind.TOUCH, lambda m: _TOUCH.pack(*astuple(m))),
}

READERS: dict[int, Callable[[bytes], Message]] = {
    FrameKind.HELLO: lambda p: Hello(*_HELLO.unpack(p)),
    FrameKind.SETUP: _read_setup,
    FrameKind.ARM: _read_nothing(Arm()),
    FrameKind.STOP: _read_nothing(Stop()),
    FrameKind.PING: lambda p: Ping(*_PING.unpack(p)),
    FrameKind.CAPABILITIES: _read_capabilities,
    FrameKind.STATUS: read_status,
    FrameKind.FAULT: read_fault,
    FrameKind.TOUCH: _read_touch,
}
