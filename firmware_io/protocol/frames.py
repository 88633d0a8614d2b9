"""The bytes of the wire: payloads, frames, their parser, HID reports, codes (PROTOCOL.md)."""

from __future__ import annotations

import struct
from binascii import crc32, crc_hqx
from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, NamedTuple, TypeVar

import numpy as np
import numpy.typing as npt

from firmware_io.device_errors import LimitError, ProtocolError
from firmware_io.protocol.messages import (
    MAX_SAMPLES,
    Arm,
    CapabilitiesReport,
    DeviceState,
    FaultCode,
    FaultReport,
    FrameKind,
    Hello,
    Mark,
    MarkedReport,
    Message,
    Ping,
    Rate,
    Revise,
    SenseReading,
    SenseReport,
    Setup,
    StatusReport,
    Stop,
    StreamMode,
    StreamSamples,
    TouchPhase,
    TouchReport,
)

_RATE = struct.Struct("<II")
_GUARD = struct.Struct("<I")
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
    # A row of these for each reading.
    FrameKind.SENSE: Packing(SenseReport, struct.Struct("<QiihH")),
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
    if isinstance(message, SenseReport):
        return kind, b"".join(LAYOUTS[kind].fields.pack(*row) for row in message.readings)
    return kind, LAYOUTS[kind].fields.pack(*vars(message).values())


def read_payload(kind: FrameKind, payload: bytes) -> Any:
    """Return the message that a payload of this kind holds."""
    layout = LAYOUTS[kind]
    if kind is FrameKind.CAPABILITIES:
        return _read_capabilities(payload, layout.fields)
    if kind is FrameKind.SENSE:
        readings = tuple(map(SenseReading._make, layout.fields.iter_unpack(payload)))
        if not readings:
            raise ProtocolError("A SENSE has one reading or more, but came with none.")
        return SenseReport(readings)
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
    *numbers, name, serial, calibration_id, touch, _, guard, marks, tested, cause, sense_hz = vars(
        report
    ).values()
    texts = (_text_bytes(text) for text in (name, serial, calibration_id))
    sense = (sense_hz // 125).bit_length() - 1 if sense_hz else 0
    flags = touch | marks << 1 | tested << 2 | cause << 3 | sense << 5
    head = LAYOUTS[FrameKind.CAPABILITIES].fields.pack(*numbers, *texts, flags, len(report.rates))
    rates = (_RATE.pack(r.sample_rate_hz, sum(1 << mode for mode in r.modes)) for r in report.rates)
    return head + b"".join(rates) + _GUARD.pack(guard)


def _read_capabilities(payload: bytes, fields: struct.Struct) -> CapabilitiesReport:
    *numbers, name, serial, calibration_id, flags, count = fields.unpack_from(payload)
    rates_end = fields.size + count * _RATE.size
    if not 1 <= count <= _MAX_RATES or len(payload) != rates_end + _GUARD.size:
        raise ProtocolError(
            f"CAPABILITIES of {count} sample rates came with {len(payload)} bytes; 1 to "
            f"{_MAX_RATES} rates of {_RATE.size} bytes follow on {fields.size}, and the guard."
        )
    rates = tuple(
        Rate(rate_hz, frozenset(mode for mode in StreamMode if modes >> mode & 1))
        for rate_hz, modes in _RATE.iter_unpack(payload[fields.size : rates_end])
    )
    texts = (_text(data) for data in (name, serial, calibration_id))
    sense = flags >> 5 & 7
    sense_hz = 125 << sense if sense else 0
    flagged = (bool(flags & 2), bool(flags & 4), flags >> 3 & 3, sense_hz)
    ends = (bool(flags & 1), rates, *_GUARD.unpack_from(payload, rates_end), *flagged)
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


MAGIC = b"HX"
VERSION = 4
#: HELLO is sent in it: a driver of that version can say that it speaks no other.
OLDEST_VERSION = 3
#: Sequence numbers count modulo this.
SEQUENCE_MODULUS = 2**16
#: Sample indices count modulo this.
INDEX_MODULUS = 2**32

_HEADER = struct.Struct("<2sBBHHH")
_HEADER_CHECK = struct.Struct("<H")
_INDEX = struct.Struct("<I")
_REVISE_HEAD = struct.Struct("<IH")
_CODES = np.dtype("<i2")
# Looked up once: a member of an enumeration takes as long as packing it.
_STREAM, _REVISE = int(FrameKind.STREAM), int(FrameKind.REVISE)
_CRC = struct.Struct("<I")
HEADER_BYTES = _HEADER.size + _HEADER_CHECK.size
#: Header and CRC-32 around a payload.
FRAME_OVERHEAD_BYTES = HEADER_BYTES + _CRC.size
#: Bytes of a STREAM frame besides its samples.
STREAM_OVERHEAD_BYTES = FRAME_OVERHEAD_BYTES + _INDEX.size


@dataclass(frozen=True)
class Frame:
    """One message and its number."""

    message: Message
    """Its content."""
    sequence: int
    """Its number, modulo 2**16."""


def encode(frame: Frame, version: int = VERSION) -> bytes:
    """Return the bytes of a frame, in a version of the protocol.

    Raises `ProtocolError` if a field does not fit the wire format, or codes have another type,
    shape or size.
    """
    message = frame.message
    mode = 0
    try:
        if isinstance(message, StreamSamples):
            mode = int(message.mode)
            if isinstance(message, Revise):
                kind, head = _REVISE, _REVISE_HEAD.pack(message.sample_index, message.revision)
            else:
                kind, head = _STREAM, _INDEX.pack(message.sample_index)
            payload = head + _code_bytes(message.codes)
        else:
            kind, payload = write_payload(message)
        header = _HEADER.pack(MAGIC, version, kind, frame.sequence, len(payload), mode)
    except (struct.error, UnicodeEncodeError) as error:
        raise ProtocolError(
            f"{frame} does not fit the wire format: {error}; correct it."
        ) from error
    header += _HEADER_CHECK.pack(crc_hqx(header, 0xFFFF))
    return b"".join((header, payload, _CRC.pack(crc32(payload, crc32(header)))))


def _code_bytes(codes: npt.NDArray[np.int16]) -> bytes:
    if codes.dtype != np.int16 or codes.ndim != 1:
        raise ProtocolError(
            f"codes must be a 1-D int16 array, but is {codes.ndim}-D {codes.dtype}; make codes "
            "with volts_to_codes."
        )
    if not 1 <= codes.size <= MAX_SAMPLES:
        raise ProtocolError(
            f"A frame carries 1 to {MAX_SAMPLES} samples, but has {codes.size}; split it."
        )
    return codes.astype(_CODES, copy=False).tobytes()


def decode(data: bytes) -> Frame:
    """Return the frame in `data`.

    Raises `ProtocolError` if `data` is not exactly one valid frame of a version that hosts speak.
    """
    if len(data) < FRAME_OVERHEAD_BYTES:
        raise ProtocolError(
            f"A frame has at least {FRAME_OVERHEAD_BYTES} bytes, but {len(data)} came; "
            "send whole frames."
        )
    kind, sequence, length, mode = read_header(data)
    if len(data) != length + FRAME_OVERHEAD_BYTES:
        raise ProtocolError(
            f"A frame with a payload of {length} bytes has {length + FRAME_OVERHEAD_BYTES} bytes, "
            f"but {len(data)} came; send exactly one whole frame."
        )
    return read_frame(data, kind, sequence, length, mode)


def read_header(data: bytes | bytearray | memoryview, offset: int = 0) -> tuple[int, int, int, int]:
    """Return kind, sequence, payload length and mode of the header at `offset`.

    Raises `ProtocolError` if there is no valid header of a version that hosts speak.
    """
    magic, version, kind, sequence, length, mode = _HEADER.unpack_from(data, offset)
    if magic != MAGIC:
        raise ProtocolError(
            f"A frame begins with {MAGIC!r}, but {magic!r} came; check that the sender speaks "
            "this protocol and is in step."
        )
    check = crc_hqx(data[offset : offset + _HEADER.size], 0xFFFF)
    (carried,) = _HEADER_CHECK.unpack_from(data, offset + _HEADER.size)
    if carried != check:
        raise ProtocolError(
            f"The header's CRC-16 is {carried:#06x}, but its bytes give {check:#06x}; "
            "it was damaged on the way."
        )
    # After the check, so that a damaged byte is reported as damage, not as another version.
    if not OLDEST_VERSION <= version <= VERSION:
        raise ProtocolError(
            f"This side speaks protocol version {VERSION}, but version {version} came; "
            "bring host and firmware to the same version."
        )
    return kind, sequence, length, mode


def read_frame(
    data: bytes | bytearray | memoryview, kind: int, sequence: int, length: int, mode: int
) -> Frame:
    """Return the frame in `data`, whose header was found valid.

    Raises `ProtocolError` if the rest is not valid.
    """
    (carried,) = _CRC.unpack_from(data, HEADER_BYTES + length)
    check = crc32(memoryview(data)[: HEADER_BYTES + length])
    if carried != check:
        raise ProtocolError(
            f"The frame's CRC-32 is {carried:#010x}, but its bytes give {check:#010x}; "
            "it was damaged on the way."
        )
    if kind in (_STREAM, _REVISE):
        is_revision = kind == _REVISE
        first = _REVISE_HEAD.size if is_revision else _INDEX.size
        if length < first + 2 or length % 2:
            raise ProtocolError(
                f"A {FrameKind(kind).name} payload is {first} bytes and whole samples, {first} + "
                f"2 n bytes, but has {length} bytes; send at least one sample."
            )
        (index,) = _INDEX.unpack_from(data, HEADER_BYTES)
        codes = np.frombuffer(data, _CODES, (length - first) // 2, HEADER_BYTES + first)
        samples = (index, codes.astype(np.int16), member(StreamMode, mode, "stream mode"))
        if not is_revision:
            return Frame(StreamSamples(*samples), sequence)
        _, revision = _REVISE_HEAD.unpack_from(data, HEADER_BYTES)
        return Frame(Revise(*samples, revision), sequence)
    if mode != 0:
        raise ProtocolError(f"Only STREAM and REVISE have a mode, but mode {mode} came; send 0.")
    if kind not in LAYOUTS:
        raise ProtocolError(f"This protocol has no kind {kind:#04x}; send a known one.")
    payload = bytes(data[HEADER_BYTES : HEADER_BYTES + length])
    try:
        return Frame(read_payload(FrameKind(kind), payload), sequence)
    except (struct.error, UnicodeDecodeError) as error:
        name = FrameKind(kind).name
        raise ProtocolError(
            f"The payload of a {name} frame cannot be read: {error}; the sender follows another "
            "document than PROTOCOL.md."
        ) from error


class FrameParser:
    """Finds frames in a stream of bytes that arrives in pieces of any size.

    Parameters
    ----------
    max_payload_bytes : int
        A header that announces more counts as damage.

    Attributes
    ----------
    skipped_bytes : int
        Number of bytes that belonged to no frame.
    """

    def __init__(self, max_payload_bytes: int = 4 + 2 * MAX_SAMPLES) -> None:
        self._max_payload_bytes = max_payload_bytes
        self._pending = bytearray()
        self.skipped_bytes = 0

    @property
    def is_amid_a_frame(self) -> bool:
        """Whether it holds bytes of an incomplete frame."""
        return bool(self._pending)

    def feed(self, data: bytes) -> list[Frame | ProtocolError]:
        """Add bytes; return the frames that they complete, in order.

        Returns
        -------
        list of Frame or ProtocolError
            Each valid frame, and an error, which is not raised, for each run of bytes that is no
            frame; parsing continues at the next header.
        """
        pending = self._pending
        pending += data
        items: list[Frame | ProtocolError] = []
        start = 0
        is_skipping = False
        while True:
            at = pending.find(MAGIC, start)
            if at < 0:
                # The first half of the magic at the very end may still be completed.
                at = len(pending) - (pending[start:][-1:] == MAGIC[:1])
            if at > start:
                if not is_skipping:
                    items.append(_no_frame(bytes(pending[start : min(at, start + 8)])))
                is_skipping = True
                self.skipped_bytes += at - start
                start = at
            if len(pending) - start < FRAME_OVERHEAD_BYTES:
                break
            try:
                kind, sequence, length, mode = read_header(pending, start)
                if length > self._max_payload_bytes:
                    raise ProtocolError(
                        f"A payload has at most {self._max_payload_bytes} bytes here, but a "
                        f"header announced {length}; send shorter frames."
                    )
                end = start + length + FRAME_OVERHEAD_BYTES
                if len(pending) < end:
                    break
                frame = read_frame(bytes(pending[start:end]), kind, sequence, length, mode)
            except ProtocolError as error:
                if not is_skipping:
                    items.append(error)
                # Skip one byte, not one frame: the length may be the damaged field.
                is_skipping = True
                self.skipped_bytes += 1
                start += 1
            else:
                items.append(frame)
                is_skipping = False
                start = end
        del pending[:start]
        return items

    def give_up(self) -> list[Frame | ProtocolError]:
        """Discard an incomplete frame; return the frames after its first byte."""
        if not self._pending:
            return []
        behind = bytes(self._pending[1:])
        self._pending.clear()
        self.skipped_bytes += 1
        lost: list[Frame | ProtocolError] = [
            ProtocolError("A frame broke off: bytes were lost on the way, or its sender stopped.")
        ]
        return lost + [item for item in self.feed(behind) if isinstance(item, Frame)]


def _no_frame(data: bytes) -> ProtocolError:
    return ProtocolError(
        f"Bytes that are not a frame came, beginning {data.hex(' ')}; check that the sender uses "
        "this protocol."
    )


#: The only report id, the same in both directions.
REPORT_ID = 1
#: Size of a report of a full-speed device, its id included.
REPORT_BYTES = 64
_BEGINS = 0x80
_PREFIX_BYTES = 2


def to_reports(frame: bytes, report_bytes: int = REPORT_BYTES) -> list[bytes]:
    """Return the reports that carry one frame, each `report_bytes` long, its id first."""
    room = report_bytes - _PREFIX_BYTES
    reports = []
    for start in range(0, len(frame), room):
        piece = frame[start : start + room]
        length = len(piece) | (_BEGINS if start == 0 else 0)
        reports.append(bytes((REPORT_ID, length)) + piece.ljust(room, b"\0"))
    return reports


def from_report(report: bytes) -> tuple[bytes, bool]:
    """Return the piece of a frame that a report carries, and whether a frame begins with it.

    Raises `ProtocolError` if it is not a report of this protocol.
    """
    if len(report) < _PREFIX_BYTES or report[0] != REPORT_ID:
        raise ProtocolError(
            f"A report begins with id {REPORT_ID} and a length, but {report[:2].hex(' ')!r} came; "
            "another device stands behind this address."
        )
    length = report[1] & ~_BEGINS
    if length > len(report) - _PREFIX_BYTES:
        raise ProtocolError(
            f"A report of {len(report)} bytes carries at most {len(report) - _PREFIX_BYTES}, but "
            f"announces {length}; bytes were lost on the way."
        )
    return report[_PREFIX_BYTES : _PREFIX_BYTES + length], bool(report[1] & _BEGINS)


def samples_per_frame(reports: int, report_bytes: int = REPORT_BYTES) -> int:
    """Return the number of samples in a STREAM frame that fills this many reports."""
    return ((report_bytes - _PREFIX_BYTES) * reports - STREAM_OVERHEAD_BYTES) // 2


#: The code of full scale. The range is symmetric: 0 V is a code, and so is -v with every +v.
FULL_SCALE_CODE = 32767


def volts_to_codes(
    volts: npt.ArrayLike, full_scale_v: float, ceiling_v: float | None = None
) -> npt.NDArray[np.int16]:
    """Quantise voltages to the nearest code that does not exceed the ceiling.

    Parameters
    ----------
    volts : array_like, any shape
        Voltages.
    full_scale_v : float
        The voltage of code 32767.
    ceiling_v : float, optional
        No code stands for more than this. A voltage less than half a step below the ceiling becomes
        the last code below it, even if the code above is nearer.

    Returns
    -------
    ndarray of int16, same shape
        Codes in -32767..32767.

    Raises
    ------
    LimitError
        If a voltage is not finite, or lies beyond full scale or the ceiling.

    Examples
    --------
    >>> codes_to_volts(volts_to_codes([0.0, -100.0], full_scale_v=250.0), 250.0).round(2).tolist()
    [0.0, -100.0]
    """
    values = np.asarray(volts, dtype=np.float64)
    limit = full_scale_v if ceiling_v is None else min(ceiling_v, full_scale_v)
    if values.size == 0:
        return np.zeros(values.shape, np.int16)
    lowest = float(np.minimum.reduce(values, axis=None))
    highest = float(np.maximum.reduce(values, axis=None))
    # Written so that NaN, which compares false with everything, counts as over the limit.
    if not (-limit <= lowest and highest <= limit):
        index = int((~(np.abs(values) <= limit)).argmax())
        raise LimitError(
            f"Sample {index} is {float(values.flat[index])!r} V, but codes reach {limit!r} V; "
            "lower the signal's amplitude."
        )
    top = top_code(limit, full_scale_v)
    codes = np.empty_like(values)
    np.divide(values, full_scale_v, out=codes)
    codes *= FULL_SCALE_CODE
    np.rint(codes, out=codes)
    if max(-lowest, highest) / full_scale_v * FULL_SCALE_CODE > top:
        np.clip(codes, -top, top, out=codes)
    return codes.astype(np.int16)


def top_code(limit_v: float, full_scale_v: float) -> int:
    """Return the highest code that stands for no more than a limit."""
    top = int(limit_v / full_scale_v * FULL_SCALE_CODE)
    return top - 1 if top / FULL_SCALE_CODE * full_scale_v > limit_v else top


def codes_to_volts(codes: npt.NDArray[np.int16], full_scale_v: float) -> npt.NDArray[np.float64]:
    """Return the voltages of codes, in volts, in the same shape.

    Parameters
    ----------
    codes : array of int16
    full_scale_v : float
        Voltage [V] of the largest code.

    Examples
    --------
    >>> codes_to_volts(np.array([0, 32767], np.int16), 200.0).tolist()
    [0.0, 200.0]
    """
    # Division first: code 32767 then gives exactly full scale.
    return codes / FULL_SCALE_CODE * full_scale_v
