"""Messages to bytes and back, one frame at a time (PROTOCOL.md)."""

from __future__ import annotations

import struct
from binascii import crc32, crc_hqx
from dataclasses import dataclass

import numpy as np

from firmware_io.errors import ProtocolError
from firmware_io.protocol.messages import FrameKind, Message, StreamMode, StreamSamples
from firmware_io.protocol.payloads import LAYOUTS, member, read_payload, write_payload

MAGIC = b"HX"
VERSION = 3
#: Sequence numbers count modulo this.
SEQUENCE_MODULUS = 2**16
#: Sample indices count modulo this.
INDEX_MODULUS = 2**32

_HEADER = struct.Struct("<2sBBHHH")
_HEADER_CHECK = struct.Struct("<H")
_INDEX = struct.Struct("<I")
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


def encode(frame: Frame) -> bytes:
    """Return the bytes of a frame.

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
            payload = _INDEX.pack(message.sample_index) + message.codes.astype("<i2").tobytes()
        else:
            kind, payload = write_payload(message)
        header = _HEADER.pack(MAGIC, VERSION, kind, frame.sequence, len(payload), mode)
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
        If `data` is not exactly one valid frame of this protocol version.
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
        If there is no valid header of this version.
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
    if version != VERSION:
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
    if kind == FrameKind.STREAM:
        if length < _INDEX.size + 2 or length % 2:
            raise ProtocolError(
                f"A STREAM payload is a sample index and whole samples, 4 + 2 n bytes, but has "
                f"{length} bytes; send at least one sample."
            )
        (index,) = _INDEX.unpack_from(data, HEADER_BYTES)
        codes = np.frombuffer(data, "<i2", (length - 4) // 2, HEADER_BYTES + 4).astype(np.int16)
        return Frame(StreamSamples(index, codes, member(StreamMode, mode, "stream mode")), sequence)
    if mode != 0:
        raise ProtocolError(f"Only STREAM has a mode, but mode {mode} came; send 0.")
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
