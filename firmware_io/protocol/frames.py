"""Messages to bytes and back, one frame at a time (PROTOCOL.md)."""

from __future__ import annotations

import struct
from binascii import crc32, crc_hqx
from dataclasses import dataclass

import numpy as np

from firmware_io.errors import ProtocolError
from firmware_io.protocol.messages import FrameKind, Message, Revise, StreamMode, StreamSamples
from firmware_io.protocol.payloads import LAYOUTS, member, read_payload, write_payload

MAGIC = b"HX"
VERSION = 4
#: The oldest one that a host speaks, and sends HELLO in.
OLDEST_VERSION = 3
#: Sequence numbers count modulo this.
SEQUENCE_MODULUS = 2**16
#: Sample indices count modulo this.
INDEX_MODULUS = 2**32

_HEADER = struct.Struct("<2sBBHHH")
_HEADER_CHECK = struct.Struct("<H")
_INDEX = struct.Struct("<I")
_REVISION = struct.Struct("<H")
_CRC = struct.Struct("<I")
HEADER_BYTES = _HEADER.size + _HEADER_CHECK.size
#: Header and CRC-32 around a payload.
FRAME_OVERHEAD_BYTES = HEADER_BYTES + _CRC.size
#: Bytes of a STREAM frame besides its samples.
STREAM_OVERHEAD_BYTES = FRAME_OVERHEAD_BYTES + _INDEX.size


@dataclass(frozen=True)
class Frame:
    """One message and its number.

    Parameters
    ----------
    message : Message
        Its content.
    sequence : int
        Its number, modulo 2**16.
    """

    message: Message
    sequence: int


def encode(frame: Frame, version: int = VERSION) -> bytes:
    """Return the bytes of a frame, in a version of the protocol.

    Raises
    ------
    ProtocolError
        If a field does not fit the wire format.
    """
    message = frame.message
    mode = 0
    try:
        if isinstance(message, StreamSamples):
            kind = FrameKind.STREAM
            mode = message.mode
            payload = _INDEX.pack(message.sample_index)
            if isinstance(message, Revise):
                kind = FrameKind.REVISE
                payload += _REVISION.pack(message.revision)
            payload += message.codes.astype("<i2").tobytes()
        else:
            kind, payload = write_payload(message)
        header = _HEADER.pack(MAGIC, version, kind, frame.sequence, len(payload), mode)
    except (struct.error, UnicodeEncodeError) as error:
        raise ProtocolError(
            f"{frame} does not fit the wire format: {error}; correct it."
        ) from error
    body = header + _HEADER_CHECK.pack(crc_hqx(header, 0xFFFF)) + payload
    return body + _CRC.pack(crc32(body))


def decode(data: bytes) -> Frame:
    """Return the frame in `data`.

    Raises
    ------
    ProtocolError
        If `data` is not exactly one valid frame of a version that hosts speak.
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

    Raises
    ------
    ProtocolError
        If there is no valid header of a version that hosts speak.
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

    Raises
    ------
    ProtocolError
        If the rest is not valid.
    """
    (carried,) = _CRC.unpack_from(data, HEADER_BYTES + length)
    check = crc32(memoryview(data)[: HEADER_BYTES + length])
    if carried != check:
        raise ProtocolError(
            f"The frame's CRC-32 is {carried:#010x}, but its bytes give {check:#010x}; "
            "it was damaged on the way."
        )
    if kind in (FrameKind.STREAM, FrameKind.REVISE):
        is_revision = kind == FrameKind.REVISE
        first = _INDEX.size + (_REVISION.size if is_revision else 0)
        if length < first + 2 or length % 2:
            raise ProtocolError(
                f"A {FrameKind(kind).name} payload is {first} bytes and whole samples, {first} + "
                f"2 n bytes, but has {length} bytes; send at least one sample."
            )
        (index,) = _INDEX.unpack_from(data, HEADER_BYTES)
        codes = np.frombuffer(data, "<i2", (length - first) // 2, HEADER_BYTES + first)
        samples = (index, codes.astype(np.int16), member(StreamMode, mode, "stream mode"))
        if not is_revision:
            return Frame(StreamSamples(*samples), sequence)
        (revision,) = _REVISION.unpack_from(data, HEADER_BYTES + _INDEX.size)
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
