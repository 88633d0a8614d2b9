"""The receiver of the reference: frames, and damage, from bytes and reports."""

from __future__ import annotations

import struct
from binascii import crc32, crc_hqx
from dataclasses import dataclass
from typing import Protocol

from firmware_io.protocol import FRAME_OVERHEAD_BYTES, MAGIC, REPORT_ID, VERSION, FaultCode
from firmware_io.protocol.frames import HEADER_BYTES

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

    def receive(self, data: bytes) -> None:
        """Take bytes from the host."""
        if data:
            self._pause_ticks = 0
            self._pending += data
            self._take_frames()

    def receive_report(self, report: bytes) -> None:
        """Take one HID report from the host."""
        if len(report) < 2 or report[0] != REPORT_ID or (report[1] & 0x7F) > len(report) - 2:
            self._handler.meet_damage(0, 0, 0)
            return
        if report[1] & 0x80 and self._pending:
            self._refuse_rest()
            self._pending.clear()
        self.receive(report[2 : 2 + (report[1] & 0x7F)])

    def clear(self) -> None:
        """Discard the bytes of an incomplete frame."""
        self._pending.clear()
        self._pause_ticks = 0

    @property
    def ticks_to_event(self) -> int:
        """Output samples until an incomplete frame is given up."""
        return self._most_pause_ticks - self._pause_ticks if self._pending else _NEVER

    def pass_time(self, ticks: int) -> None:
        """Give up an incomplete frame if its bytes have paused for too long."""
        if not self._pending:
            return
        self._pause_ticks += ticks
        if self._pause_ticks >= self._most_pause_ticks:
            self._refuse_rest()
            self._pause_ticks = 0
            # Only its first byte: the bytes behind may be whole frames.
            del self._pending[:1]
            self._take_frames()

    def _refuse_rest(self) -> None:
        if self._handler.is_armed:
            due = FRAME_OVERHEAD_BYTES
            if len(self._pending) >= HEADER_BYTES:
                due += int.from_bytes(self._pending[6:8], "little")
            self._handler.refuse(FaultCode.TRUNCATED, 0, due, len(self._pending))

    def _take_frames(self) -> None:
        """Take every whole frame, and skip every byte that belongs to none."""
        pending = self._pending
        while pending:
            at = pending.find(MAGIC)
            if at < 0:
                at = len(pending) - pending.endswith(MAGIC[:1])
            if at:
                self._handler.meet_damage(0, 0, 0)
                del pending[:at]
                continue
            if len(pending) < HEADER_BYTES:
                return
            head = self._believed_header()
            if head is None:
                del pending[:1]
                continue
            due = FRAME_OVERHEAD_BYTES + head.length
            if len(pending) < due:
                return
            body = bytes(pending[: due - 4])
            carried = int.from_bytes(pending[due - 4 : due], "little")
            if crc32(body) == carried:
                del pending[:due]
                self._handler.take_frame(head, body[HEADER_BYTES:])
            else:
                self._handler.meet_damage(head.sequence, crc32(body), carried)
                del pending[:1]

    def _believed_header(self) -> Head | None:
        _, version, kind, sequence, length, mode, carried = _HEAD.unpack_from(self._pending)
        due = crc_hqx(self._pending[:10], 0xFFFF)
        if carried != due:
            self._handler.meet_damage(0, due, carried)
        elif version != VERSION:
            self._handler.refuse(FaultCode.VERSION, sequence, VERSION, version)
        elif length > self._longest_payload:
            self._handler.refuse(FaultCode.LENGTH, sequence, self._longest_payload, length)
        else:
            return Head(kind, sequence, length, mode)
        return None
