"""Versioned wire frames: what the host and the driver say to each other (see PROTOCOL.md)."""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np
import numpy.typing as npt

from firmware_io.errors import LimitError, ProtocolError

MAGIC = b"HX"
VERSION = 1
#: The code of full scale. The range is symmetric, so that 0 V is a code and +v and -v are alike.
FULL_SCALE_CODE = 32767
#: Sequence numbers count modulo this.
SEQUENCE_MODULUS = 2**32

_HEADER = struct.Struct("<2sBBIQHBB")
_TRAILER = struct.Struct("<I")
_OVERHEAD = _HEADER.size + _TRAILER.size
_MAX_SAMPLES = 2**16 - 1


class FrameKind(IntEnum):
    """What a frame asks of the driver."""

    ARM = 1
    STREAM = 2
    STOP = 3


class StreamMode(IntEnum):
    """What the samples of a frame mean."""

    WAVEFORM = 0


def _no_samples() -> npt.NDArray[np.int16]:
    return np.empty(0, dtype=np.int16)


@dataclass(frozen=True, eq=False)
class Frame:
    """One message from host to driver.

    Parameters
    ----------
    kind : FrameKind
        What the frame asks for.
    sequence : int
        Number of the frame, modulo 2**32.
    sample_index : int
        Samples sent since ARM before this frame; 0 for ARM.
    samples : ndarray of int16, shape (n,)
        Codes, n <= 65535; none unless the kind is STREAM.
    mode : StreamMode
        What the samples mean.

    Raises
    ------
    ProtocolError
        If a field does not fit the wire format.
    """

    kind: FrameKind
    sequence: int
    sample_index: int
    samples: npt.NDArray[np.int16] = field(default_factory=_no_samples)
    mode: StreamMode = StreamMode.WAVEFORM

    def __post_init__(self) -> None:
        if not 0 <= self.sequence < SEQUENCE_MODULUS:
            raise ProtocolError(
                f"sequence must lie in 0..2**32-1, but is {self.sequence}; wrap it."
            )
        if not 0 <= self.sample_index < 2**64:
            raise ProtocolError(
                f"sample_index must lie in 0..2**64-1, but is {self.sample_index}; arm again."
            )
        if self.samples.dtype != np.int16 or self.samples.ndim != 1:
            raise ProtocolError(
                f"samples must be a 1-D int16 array, but is {self.samples.ndim}-D "
                f"{self.samples.dtype}; make codes with volts_to_codes."
            )
        if self.samples.size > _MAX_SAMPLES:
            raise ProtocolError(
                f"A frame carries at most {_MAX_SAMPLES} samples, but has {self.samples.size}; "
                "split it."
            )
        if self.samples.size and self.kind is not FrameKind.STREAM:
            raise ProtocolError(
                f"Only STREAM frames carry samples, but this {self.kind.name} frame has "
                f"{self.samples.size}; send them in a STREAM frame."
            )


def encode(frame: Frame) -> bytes:
    """Return the bytes of a frame: header, samples, CRC-32."""
    header = _HEADER.pack(
        MAGIC,
        VERSION,
        frame.kind,
        frame.sequence,
        frame.sample_index,
        frame.samples.size,
        frame.mode,
        0,
    )
    body = header + frame.samples.astype("<i2").tobytes()
    return body + _TRAILER.pack(zlib.crc32(body))


def decode(data: bytes) -> Frame:
    """Return the frame that `data` holds.

    Raises
    ------
    ProtocolError
        If `data` is not exactly one well-formed frame of this protocol version.
    """
    if len(data) < _OVERHEAD:
        raise ProtocolError(
            f"A frame has at least {_OVERHEAD} bytes, but {len(data)} came; send whole frames."
        )
    magic, version, kind, sequence, sample_index, count, mode, reserved = _HEADER.unpack_from(data)
    if magic != MAGIC:
        raise ProtocolError(
            f"A frame begins with {MAGIC!r}, but {magic!r} came; check that the sender speaks "
            "this protocol and is in step."
        )
    if version != VERSION:
        raise ProtocolError(
            f"This side speaks protocol version {VERSION}, but version {version} came; "
            "bring host and firmware to the same version."
        )
    expected = _OVERHEAD + 2 * count
    if len(data) != expected:
        raise ProtocolError(
            f"A frame of {count} samples has {expected} bytes, but {len(data)} came; "
            "send exactly one whole frame."
        )
    (crc,) = _TRAILER.unpack_from(data, len(data) - _TRAILER.size)
    actual = zlib.crc32(data[: -_TRAILER.size])
    # Before the fields below: a damaged byte should be reported as damage, not as a strange kind.
    if crc != actual:
        raise ProtocolError(
            f"The frame's CRC-32 is {crc:#010x}, but its bytes give {actual:#010x}; "
            "it was damaged on the way, send it anew after arming."
        )
    if kind not in {k.value for k in FrameKind}:
        raise ProtocolError(f"Frame kinds are 1, 2 and 3, but kind {kind} came; send a known one.")
    if mode not in {m.value for m in StreamMode}:
        raise ProtocolError(f"The only stream mode is 0, but mode {mode} came; send mode 0.")
    if reserved != 0:
        raise ProtocolError(f"The reserved byte must be 0, but is {reserved}; send 0.")
    samples = np.frombuffer(data, dtype="<i2", count=count, offset=_HEADER.size).astype(np.int16)
    return Frame(FrameKind(kind), sequence, sample_index, samples, StreamMode(mode))


def volts_to_codes(
    volts: npt.ArrayLike, full_scale_v: float, ceiling_v: float | None = None
) -> npt.NDArray[np.int16]:
    """Quantise voltages to the nearest code; rounding never goes above the ceiling.

    Parameters
    ----------
    volts : array_like, any shape
        Voltages.
    full_scale_v : float
        The voltage of code 32767.
    ceiling_v : float, optional
        No code that stands for more than this is used: a voltage less than half a step below the
        ceiling becomes the last code under it, even where the code above would be nearer.

    Returns
    -------
    ndarray of int16, same shape
        Codes in -32767..32767.

    Raises
    ------
    LimitError
        If a voltage is not finite, or lies beyond full scale or the ceiling.
    """
    values = np.asarray(volts, dtype=np.float64)
    limit = full_scale_v if ceiling_v is None else min(ceiling_v, full_scale_v)
    over = ~(np.abs(values) <= limit)
    if over.any():
        index = int(over.argmax())
        raise LimitError(
            f"Sample {index} is {float(values.flat[index])!r} V, but codes reach {limit!r} V; "
            "lower the signal's amplitude."
        )
    top = int(limit / full_scale_v * FULL_SCALE_CODE)
    if top / FULL_SCALE_CODE * full_scale_v > limit:
        top -= 1
    codes = np.rint(values / full_scale_v * FULL_SCALE_CODE)
    return np.clip(codes, -top, top).astype(np.int16)


def codes_to_volts(codes: npt.NDArray[np.int16], full_scale_v: float) -> npt.NDArray[np.float64]:
    """Return the voltages that codes stand for, in volts, in the same shape."""
    # Divided first: code 32767 then gives full scale exactly, not one rounding above it.
    return codes / FULL_SCALE_CODE * full_scale_v
