"""Frames between the service's processes: a length, a kind, and bytes.

Standard input and output carry them, on every system and in one order; the end of the file is the
death of the other side. `Outbox` writes them, `FrameReader` and `read_frame` read them.
"""

from __future__ import annotations

import json
import os
import queue
import struct
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from math import isnan, nan
from typing import Any, BinaryIO

import numpy as np

from haptix.base.checks import Array
from haptix.base.errors import HaptixError
from haptix.play.touch.events import KINDS, TouchEvent

HEADER = struct.Struct("<IB")
JSON, TOUCHES, TELEMETRY, AMPLITUDE, BEAT = range(5)
MOST_BYTES = 64 * 2**20
_READ_BYTES = 2**18
_TOUCH = struct.Struct("<dHHdddd")
_AMPLITUDE = struct.Struct("<dd")
_NUMBERS = {kind: number for number, kind in enumerate(KINDS)}


def frame(kind: int, data: bytes) -> bytes:
    """Return a frame."""
    return HEADER.pack(len(data), kind) + data


def json_frame(value: dict[str, Any]) -> bytes:
    """Return a frame of JSON."""
    return frame(JSON, json.dumps(value, separators=(",", ":")).encode())


def touch_frame(reports: list[TouchEvent]) -> bytes:
    """Return a frame of touches by the service's clock."""
    records = (
        _TOUCH.pack(
            t_s,
            touch_id,
            _NUMBERS[kind],
            x_mm,
            y_mm,
            nan if force_n is None else force_n,
            nan if area_m2 is None else area_m2,
        )
        for t_s, touch_id, x_mm, y_mm, kind, force_n, area_m2 in reports
    )
    return frame(TOUCHES, b"".join(records))


def touches_of(data: bytes) -> list[TouchEvent]:
    """Return the touches of a frame."""
    return [
        TouchEvent(
            t_s,
            touch_id,
            x_mm,
            y_mm,
            KINDS[kind],
            None if isnan(force_n) else force_n,
            None if isnan(area_m2) else area_m2,
        )
        for t_s, touch_id, kind, x_mm, y_mm, force_n, area_m2 in _TOUCH.iter_unpack(data)
    ]


def amplitude_frame(t0_s: float, step_s: float, amplitude_v: Array) -> bytes:
    """Return a frame of played amplitudes [V] at even times, for the virtual finger."""
    samples = np.asarray(amplitude_v, dtype="<f4").tobytes()
    return frame(AMPLITUDE, _AMPLITUDE.pack(t0_s, step_s) + samples)


def amplitude_of(data: bytes) -> tuple[float, float, Array]:
    """Return time, step and amplitudes of a frame."""
    t0_s, step_s = _AMPLITUDE.unpack_from(data)
    return t0_s, step_s, np.frombuffer(data, "<f4", offset=_AMPLITUDE.size).astype(np.float64)


class FrameReader:
    """Frames as they come: all that are there at once, so that a late reader sees how late it is.

    Parameters
    ----------
    number : int
        File descriptor.
    """

    def __init__(self, number: int) -> None:
        self._number, self._left = number, bytearray()

    def read(self) -> list[tuple[int, bytes]]:
        """Wait for frames, and return the kind and bytes of each; none at the end of the file."""
        frames: list[tuple[int, bytes]] = []
        while not frames:
            data = os.read(self._number, _READ_BYTES)
            if not data:
                break
            self._left += data
            at = 0
            while len(self._left) >= at + HEADER.size:
                length, kind = HEADER.unpack_from(self._left, at)
                if length > MOST_BYTES:
                    return []  # these are no frames
                begin = at + HEADER.size
                if len(self._left) < begin + length:
                    break
                frames.append((kind, bytes(self._left[begin : begin + length])))
                at = begin + length
            del self._left[:at]
        return frames


def read_frame(stream: BinaryIO) -> tuple[int, bytes] | None:
    """Return the next frame's kind and bytes; None at the end of the stream."""
    head = _exactly(stream, HEADER.size)
    if head is None:
        return None
    length, kind = HEADER.unpack(head)
    data = _exactly(stream, length) if length <= MOST_BYTES else None
    return None if data is None else (kind, data)


def _exactly(stream: BinaryIO, count: int) -> bytes | None:
    parts = bytearray()
    while len(parts) < count:
        part = stream.read(count - len(parts))
        if not part:
            return None
        parts += part
    return bytes(parts)


_MOST_WAITING = 64  # frames of telemetry that the other side has not taken


def answer_of(do: str, call: Callable[[], dict[str, Any] | None], code: str) -> dict[str, Any]:
    """Return a call's answer to the front, or its problem; `code` is that of a `HaptixError`."""
    try:
        return call() or {}
    except HaptixError as error:
        problem = {"code": code, "sentence": str(error), "path": getattr(error, "path", "")}
    except MemoryError:
        problem = {"code": "limit", "sentence": f"{do}: needs more memory than it may have"}
    except Exception as error:  # a fault of ours ends no process
        sys.excepthook(type(error), error, error.__traceback__)
        problem = {"code": "internal", "sentence": f"{do}: {type(error).__name__}: {error}"}
    return {"problem": problem}


class Outbox:
    """Writes frames in a thread of its own: the sender never waits for the reader.

    Parameters
    ----------
    output : binary file
        Where frames go.
    """

    def __init__(self, output: BinaryIO) -> None:
        self._output = output
        self._waiting: queue.SimpleQueue[bytes | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._writes, name="haptix outbox", daemon=True)
        self._thread.start()

    def say(self, **message: Any) -> None:
        """Send a message."""
        self._waiting.put(json_frame(message))

    def tell(self, data: bytes) -> None:
        """Send a frame of telemetry, or drop it if nobody reads."""
        if self._waiting.qsize() < _MOST_WAITING:
            self._waiting.put(data)

    def close(self) -> None:
        """Send the waiting frames, for a second at most."""
        self._waiting.put(None)
        self._thread.join(1.0)

    def _writes(self) -> None:
        with suppress(OSError):  # the other side is gone; our input ends as well
            while (data := self._waiting.get()) is not None:
                self._output.write(data)
                self._output.flush()


def frame_output() -> BinaryIO:
    """Return the standard output for frames; the output of libraries goes to the standard error."""
    output = os.fdopen(os.dup(1), "wb", buffering=0)
    os.dup2(2, 1)
    return output
