"""Touches and telemetry in bytes, little-endian.

Touches (client to server): a header of 16 bytes, then records of 24.

=====  ======  ==================================================================
at     type    header
=====  ======  ==================================================================
0      u8      1: touches
1      u8      1: version of this layout
2      u16     number of records, at most 1,024
4      u32     number of the batch; it rises by one
8      f64     base_s: a time of the client's clock [s]
=====  ======  ==================================================================

=====  ======  ==================================================================
at     type    record
=====  ======  ==================================================================
0      i32     time after base_s [us]
4      u8      touch_id, the same from down to up
5      u8      flags: bits 0-1 down 0, move 1, up 2; bit 2 the place is in pixels;
               bit 3 the force is known; bit 4 the area is known; bit 5 coalesced
6      u16     0
8      f32     x
12     f32     y
16     f32     normal_force_n
20     f32     contact_area_m2
=====  ======  ==================================================================

Telemetry (server to client): a header of 32 bytes, then rows of f32, NaN where nothing is known.

=====  ======  ==================================================================
at     type    header
=====  ======  ==================================================================
0      u8      2: telemetry
1      u8      stream: 1 stats, 2 friction, 3 felt
2      u8      touch_id
3      u8      number of columns
4      u16     number of rows
6      u16     0
8      u32     number of the frame; it rises by one for each stream and finger
12     u32     frames dropped so far because the client did not read them
16     f64     time of the first row, of the service's clock [s]
24     f64     time between rows [s]
=====  ======  ==================================================================
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from math import isfinite
from typing import Any, Literal, NamedTuple

import numpy as np
from pydantic import ValidationError

from haptix.base.checks import Array
from haptix.service.protocol.messages import MOST_TOUCHES, Problem, Stream, TouchMessage
from haptix.service.protocol.messages.reading import problem_of

_HEADER = struct.Struct("<BBHId")
_RECORD = struct.Struct("<iBBHffff")
_FRAME = struct.Struct("<BBBBHHIIdd")
_KINDS: dict[int, Literal["down", "move", "up"]] = {0: "down", 1: "move", 2: "up"}
_NUMBERS = {kind: number for number, kind in _KINDS.items()}
_PIXELS, _FORCE, _AREA = 4, 8, 16

COLUMNS: dict[Stream, tuple[str, ...]] = {
    "stats": (
        *("reaction_s", "reaction_p99_s", "underruns", "touches", "scene_s"),
        *("sensing", "attraction", "attraction_sd", "sensed_force_n", "sensed_force_sd"),
    ),
    "friction": (
        *("x_mm", "y_mm", "normal_force_n", "wanted", "reached", "low", "high"),
        "voltage_share",
    ),
    "felt": ("mu", "force_n"),
}
"""Columns of each stream, in the order of their numbers."""
STREAMS = tuple(COLUMNS)


class TouchBatch(NamedTuple):
    """Touches of one message, by the client's clock; a problem stands where one cannot be used."""

    number: int
    touches: list[TouchMessage | Problem]


def read_touches(data: bytes) -> TouchBatch:
    """Return the touches of a batch.

    Raises `Problem` if it is no batch.
    """
    if len(data) < _HEADER.size:
        raise Problem("message", f"expected a batch of touches, got {len(data)} bytes")
    what, version, count, number, base_s = _HEADER.unpack_from(data)
    if (what, version) != (1, 1):
        raise Problem("message", f"expected bytes of kind 1 in layout 1, got {what} in {version}")
    if count > MOST_TOUCHES:
        raise Problem("limit", f"expected at most {MOST_TOUCHES} touches, got {count}")
    if len(data) != _HEADER.size + count * _RECORD.size:
        expected = _HEADER.size + count * _RECORD.size
        raise Problem("message", f"{count} touches take {expected} bytes, got {len(data)}")
    if not isfinite(base_s):
        raise Problem("clock", "base_s: expected a finite time in seconds", "/base_s")
    return TouchBatch(
        number,
        [
            _touch(record, base_s, index)
            for index, record in enumerate(_RECORD.iter_unpack(data[16:]))
        ],
    )


def _touch(record: tuple[Any, ...], base_s: float, index: int) -> TouchMessage | Problem:
    """Return the touch of a record, or its fault."""
    after_us, touch_id, flags, zero, x, y, force_n, area_m2 = record
    if flags >= 64 or zero:
        wrong = f"unknown flags {flags:#x} or padding {zero}"
        return Problem("message", wrong, f"/touches/{index}")
    kind = _KINDS.get(flags & 3)
    if kind == "up" and not isfinite(x + y):
        x = y = 0.0  # its place is not used
    fields = {"t_s": base_s + after_us * 1e-6, "touch_id": touch_id, "kind": kind}
    fields |= {"x_px": x, "y_px": y} if flags & _PIXELS else {"x_mm": x, "y_mm": y}
    if flags & _FORCE:
        fields["normal_force_n"] = force_n
    if flags & _AREA:
        fields["contact_area_m2"] = area_m2
    try:
        return TouchMessage(**fields)
    except ValidationError as error:
        return problem_of(error, "touches", index)


def write_touches(touches: Sequence[TouchMessage], number: int) -> bytes:
    """Return a batch, as a client sends it. Times may lie 35 minutes around the first."""
    base_s = touches[0].t_s if touches else 0.0
    parts = [_HEADER.pack(1, 1, len(touches), number & 0xFFFFFFFF, base_s)]
    for touch in touches:
        in_pixels = touch.x_px is not None
        x, y = (touch.x_px, touch.y_px) if in_pixels else (touch.x_mm, touch.y_mm)
        flags = _NUMBERS[touch.kind] | _PIXELS * in_pixels
        flags |= _FORCE * (touch.normal_force_n is not None)
        flags |= _AREA * (touch.contact_area_m2 is not None)
        after_us = round((touch.t_s - base_s) * 1e6)
        force_n, area_m2 = touch.normal_force_n or 0.0, touch.contact_area_m2 or 0.0
        parts.append(
            _RECORD.pack(after_us, touch.touch_id, flags, 0, x or 0.0, y or 0.0, force_n, area_m2)
        )
    return b"".join(parts)


class TelemetryFrame(NamedTuple):
    """Rows of one stream, for one finger."""

    stream: Stream
    touch_id: int
    number: int
    dropped: int
    t0_s: float
    step_s: float
    rows: Array


def write_frame(frame: TelemetryFrame) -> bytes:
    """Return a frame of telemetry."""
    rows = np.asarray(frame.rows, dtype="<f4")
    count, columns = rows.shape
    head = _FRAME.pack(
        2,
        STREAMS.index(frame.stream) + 1,
        frame.touch_id,
        columns,
        count,
        0,
        frame.number & 0xFFFFFFFF,
        frame.dropped & 0xFFFFFFFF,
        frame.t0_s,
        frame.step_s,
    )
    return head + rows.tobytes()


def read_frame(data: bytes) -> TelemetryFrame:
    """Return a frame of telemetry, as a client reads it.

    Raises `Problem` if it is none.
    """
    if len(data) < _FRAME.size or data[0] != 2 or not 1 <= data[1] <= len(STREAMS):
        raise Problem("message", f"expected a frame of telemetry, got {len(data)} bytes")
    _, stream, touch_id, columns, count, _, number, dropped, t0_s, step_s = _FRAME.unpack_from(data)
    if len(data) != _FRAME.size + 4 * columns * count:
        raise Problem("message", f"{count} rows of {columns} columns do not take {len(data)} bytes")
    rows = np.frombuffer(data, "<f4", offset=_FRAME.size).reshape(count, columns)
    return TelemetryFrame(STREAMS[stream - 1], touch_id, number, dropped, t0_s, step_s, rows)


def numbered(data: bytes, number: int, dropped: int) -> bytes:
    """Return a frame with another number, and a count of those that were dropped before it."""
    return data[:8] + struct.pack("<II", number & 0xFFFFFFFF, dropped & 0xFFFFFFFF) + data[16:]
