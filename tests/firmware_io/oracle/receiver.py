"""The receiver of the oracle: frames, and damage, from bytes and reports."""

from __future__ import annotations

import struct
from binascii import crc32, crc_hqx
from dataclasses import dataclass
from typing import Protocol

from firmware_io.protocol import (
    FRAME_OVERHEAD_BYTES,
    MAGIC,
    OLDEST_VERSION,
    REPORT_ID,
    VERSION,
    FaultCode,
    FrameKind,
)
from firmware_io.protocol.frames import HEADER_BYTES

WORK_PER_BYTE = 2
WORK_FRAMES = 3
_NEVER = 2**31
_HEAD = struct.Struct("<2sBBHHHH")


@dataclass(frozen=True)
class Head:
    """The fields of a header."""

    kind: int
    sequence: int
    length: int
    mode: int


class FrameHandler(Protocol):
    """Acts on received frames and on damage."""

    is_armed: bool

    def take_frame(self, head: Head, payload: bytes) -> None:
        """Obey or refuse a whole frame."""

    def meet_damage(self, sequence: int, expected: int, got: int) -> None:
        """Handle bytes that are not a frame."""

    def refuse(self, code: FaultCode, sequence: int, expected: int, got: int) -> None:
        """Refuse a frame."""


class Receiver:
    """Finds frames in bytes.

    Parameters
    ----------
    handler : FrameHandler
        Acts on the frames.
    longest_payload : int
        A header that announces more is refused.
    pause_ticks : int
        A frame whose bytes pause for this long is given up.
    """

    def __init__(self, handler: FrameHandler, longest_payload: int, pause_ticks: int) -> None:
        self._handler = handler
        self._longest_payload = longest_payload
        self._most_pause_ticks = pause_ticks
        self._pause_ticks = 0
        self._pending = bytearray()
        self._has_paused = False
        self._most_work = (longest_payload + FRAME_OVERHEAD_BYTES) * WORK_FRAMES
        self._work = self._most_work
        self._awaited = 0  # bytes of a frame whose header was checked

    def receive(self, data: bytes) -> None:
        """Take bytes from the host."""
        self.look_again()
        if data:
            self._pause_ticks = 0
        while data:
            # No further than the next decision.
            piece = data[: self._bytes_due() - len(self._pending)]
            data = data[len(piece) :]
            self._pending += piece
            self._work = min(self._work + len(piece) * WORK_PER_BYTE, self._most_work)
            if len(self._pending) >= self._awaited:
                self._take_frames()

    def receive_report(self, report: bytes) -> None:
        """Take one HID report from the host."""
        self.look_again()
        if len(report) < 2 or report[0] != REPORT_ID or (report[1] & 0x7F) > len(report) - 2:
            self._handler.meet_damage(0, 0, 0)
            return
        if report[1] & 0x80 and self._pending:
            self._refuse_rest()
            self._forget()
        self.receive(report[2 : 2 + (report[1] & 0x7F)])

    def clear(self) -> None:
        """Discard the bytes of an incomplete frame."""
        self._forget()
        self._pause_ticks = 0
        self._has_paused = False

    @property
    def ticks_to_event(self) -> int:
        """Output samples until an incomplete frame is given up."""
        if not self._pending or self._has_paused:
            return _NEVER
        return self._most_pause_ticks - self._pause_ticks

    def pass_time(self, ticks: int) -> None:
        """Give up an incomplete frame if its bytes have paused for too long."""
        if not self._pending or self._has_paused:
            return
        self._pause_ticks += ticks
        if self._pause_ticks >= self._most_pause_ticks:
            self._refuse_rest()
            self._pause_ticks = 0
            self._has_paused = True

    def look_again(self) -> None:
        """Parse the bytes of a frame that was given up, without its first one."""
        if self._has_paused:
            self._has_paused = False
            self._awaited = 0
            del self._pending[:1]
            self._take_frames()

    def _forget(self) -> None:
        self._pending.clear()
        self._awaited = 0

    def _spend(self, work: int) -> bool:
        """Pay for a check sum or a move; if that is too much, discard what is held."""
        if self._work >= work:
            self._work -= work
            return True
        self._work = 0
        self._forget()
        return False

    def _bytes_due(self) -> int:
        if len(self._pending) < HEADER_BYTES:
            return HEADER_BYTES
        return FRAME_OVERHEAD_BYTES + int.from_bytes(self._pending[6:8], "little")

    def _refuse_rest(self) -> None:
        if self._handler.is_armed:
            due = FRAME_OVERHEAD_BYTES
            if len(self._pending) >= HEADER_BYTES:
                due += int.from_bytes(self._pending[6:8], "little")
            self._handler.refuse(FaultCode.TRUNCATED, 0, due, len(self._pending))

    def _take_frames(self) -> None:
        """Take every whole frame, and skip every byte that belongs to none."""
        before = len(self._pending)
        is_checked = self._awaited > 0
        self._awaited = 0
        while self._pending and self._take_one(is_checked):
            is_checked = False
        if 0 < len(self._pending) < before:
            self._spend(len(self._pending))  # a board moves what is left to its buffer's start

    def _take_one(self, is_checked: bool) -> bool:
        """Take the next frame or skip what is none; return whether that was possible yet."""
        pending = self._pending
        at = pending.find(MAGIC)
        if at < 0:
            at = len(pending) - pending.endswith(MAGIC[:1])
        if at:
            self._handler.meet_damage(0, 0, 0)
            del pending[:at]
            return True
        if len(pending) < HEADER_BYTES:
            return False
        if not is_checked and not self._spend(HEADER_BYTES):
            return True
        head = self._believed_header()
        if head is None:
            del pending[:1]
            return True
        due = FRAME_OVERHEAD_BYTES + head.length
        if len(pending) < due:
            self._awaited = due
            return False
        if not self._spend(due):
            return True
        body = bytes(pending[: due - 4])
        carried = int.from_bytes(pending[due - 4 : due], "little")
        if crc32(body) == carried:
            del pending[:due]
            self._handler.take_frame(head, body[HEADER_BYTES:])
        else:
            self._handler.meet_damage(head.sequence, crc32(body), carried)
            del pending[:1]
        return True

    def _believed_header(self) -> Head | None:
        _, version, kind, sequence, length, mode, carried = _HEAD.unpack_from(self._pending)
        due = crc_hqx(self._pending[:10], 0xFFFF)
        if carried != due:
            self._handler.meet_damage(0, due, carried)
        elif version != VERSION and (
            kind != FrameKind.HELLO or not OLDEST_VERSION <= version <= VERSION
        ):
            self._handler.refuse(FaultCode.VERSION, sequence, VERSION, version)
        elif length > self._longest_payload:
            self._handler.refuse(FaultCode.LENGTH, sequence, self._longest_payload, length)
        else:
            return Head(kind, sequence, length, mode)
        return None
