"""The bytes between header and CRC, for every kind but STREAM and REVISE (PROTOCOL.md)."""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import astuple
from enum import IntEnum
from typing import Any, NamedTuple, TypeVar

from firmware_io.errors import ProtocolError
from firmware_io.protocol.faults import FaultCode, FaultReport
from firmware_io.protocol.messages import (
    Arm,
    CapabilitiesReport,
    DeviceState,
    FrameKind,
    Hello,
    Mark,
    MarkedReport,
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

_RATE = struct.Struct("<II")
_GUARD = struct.Struct("<I")
_STATUS_3_BYTES = 36  # of version 3, which has no revisions
_MAX_RATES = 8

_Member = TypeVar("_Member", bound=IntEnum)


class Packing(NamedTuple):
    """How the fields of a message follow each other, and which of them are enumerations."""

    message: type[Any]
    fields: struct.Struct
    enumerations: Mapping[int, tuple[type[IntEnum], str]] = {}


#: Every kind whose payload is one row of fields; CAPABILITIES adds its rates behind them.
LAYOUTS: Mapping[int, Packing] = {
    FrameKind.HELLO: Packing(Hello, struct.Struct("<BB")),
    FrameKind.SETUP: Packing(Setup, struct.Struct("<HHIIIIIIH"), {0: (StreamMode, "stream mode")}),
    FrameKind.ARM: Packing(Arm, struct.Struct("<")),
    FrameKind.STOP: Packing(Stop, struct.Struct("<")),
    FrameKind.PING: Packing(Ping, struct.Struct("<I")),
    FrameKind.CAPABILITIES: Packing(CapabilitiesReport, struct.Struct("<BBHIIIIIHH16s16s16sHH")),
    FrameKind.STATUS: Packing(
        StatusReport,
        struct.Struct("<BBHIIIIIIQHHi"),
        {0: (DeviceState, "device state"), 1: (FaultCode, "fault code")},
    ),
    FrameKind.FAULT: Packing(FaultReport, struct.Struct("<BBHIIQ"), {0: (FaultCode, "fault code")}),
    FrameKind.TOUCH: Packing(
        TouchReport, struct.Struct("<QIIHBB"), {5: (TouchPhase, "touch phase")}
    ),
    FrameKind.MARK: Packing(Mark, struct.Struct("<IH")),
    FrameKind.MARKED: Packing(MarkedReport, struct.Struct("<QIH")),
}
_KINDS = {layout.message: FrameKind(kind) for kind, layout in LAYOUTS.items()}


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


def write_payload(message: Message) -> tuple[FrameKind, bytes]:
    """Return the kind and the payload of a message."""
    kind = _KINDS[type(message)]
    if isinstance(message, CapabilitiesReport):
        return kind, _write_capabilities(message)
    return kind, LAYOUTS[kind].fields.pack(*astuple(message))


def read_payload(kind: FrameKind, payload: bytes) -> Any:
    """Return the message that a payload of this kind holds."""
    layout = LAYOUTS[kind]
    if kind is FrameKind.CAPABILITIES:
        return _read_capabilities(payload, layout.fields)
    if kind is FrameKind.STATUS and len(payload) == _STATUS_3_BYTES:
        payload = payload.ljust(layout.fields.size, b"\0")
    values = list(layout.fields.unpack(payload))
    for place, (enumeration, what) in layout.enumerations.items():
        values[place] = member(enumeration, values[place], what)
    return layout.message(*values)


def _write_capabilities(report: CapabilitiesReport) -> bytes:
    if not 1 <= len(report.rates) <= _MAX_RATES:
        raise ProtocolError(
            f"A device has 1 to {_MAX_RATES} sample rates, but {len(report.rates)} are given; "
            "correct the list."
        )
    *numbers, name, serial, calibration_id, touch, _, guard, marks = vars(report).values()
    texts = (_text_bytes(text) for text in (name, serial, calibration_id))
    head = LAYOUTS[FrameKind.CAPABILITIES].fields.pack(
        *numbers, *texts, touch | marks << 1, len(report.rates)
    )
    rates = (_RATE.pack(r.sample_rate_hz, sum(1 << mode for mode in r.modes)) for r in report.rates)
    return head + b"".join(rates) + _GUARD.pack(guard)


def _read_capabilities(payload: bytes, fields: struct.Struct) -> CapabilitiesReport:
    *numbers, name, serial, calibration_id, flags, count = fields.unpack_from(payload)
    rates_end = fields.size + count * _RATE.size
    guard = payload[rates_end:] or bytes(_GUARD.size)  # version 3 has none
    if not 1 <= count <= _MAX_RATES or len(payload) < rates_end or len(guard) != _GUARD.size:
        raise ProtocolError(
            f"CAPABILITIES of {count} sample rates came with {len(payload)} bytes; 1 to "
            f"{_MAX_RATES} rates of {_RATE.size} bytes follow on {fields.size}, and the guard."
        )
    rates = tuple(
        Rate(rate_hz, frozenset(mode for mode in StreamMode if modes >> mode & 1))
        for rate_hz, modes in _RATE.iter_unpack(payload[fields.size : rates_end])
    )
    texts = (_text(data) for data in (name, serial, calibration_id))
    ends = (bool(flags & 1), rates, *_GUARD.unpack(guard), bool(flags & 2))
    values: tuple[Any, ...] = (*numbers, *texts, *ends)
    return CapabilitiesReport(*values)


def _text_bytes(text: str) -> bytes:
    data = text.encode("ascii")
    if len(data) > 16 or b"\0" in data:
        raise ProtocolError(
            f"Names on the wire have at most 16 ASCII characters, but {text!r} came; shorten it."
        )
    return data


def _text(data: bytes) -> str:
    return data.split(b"\0", 1)[0].decode("ascii")
