"""The host's parser: frames from a stream of bytes."""

from __future__ import annotations

from firmware_io.errors import ProtocolError
from firmware_io.protocol.frames import (
    FRAME_OVERHEAD_BYTES,
    MAGIC,
    Frame,
    read_frame,
    read_header,
)
from firmware_io.protocol.messages import MAX_SAMPLES


class FrameParser:
    """Finds frames in a stream of bytes that arrives in pieces of any size.

    Parameters
    ----------
    max_payload_bytes : int
        A header that announces more is taken for damage.

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
            Each valid frame. For each run of bytes that is not a frame an error, which is not
            raised; parsing continues at the next header.
        """
        pending = self._pending
        pending += data
        found: list[Frame | ProtocolError] = []
        start = 0
        is_skipping = False
        while True:
            at = pending.find(MAGIC, start)
            if at < 0:
                # The first half of the magic at the very end may still be completed.
                at = len(pending) - (pending[start:][-1:] == MAGIC[:1])
            if at > start:
                if not is_skipping:
                    found.append(_no_frame(bytes(pending[start : min(at, start + 8)])))
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
                    found.append(error)
                # Skip one byte, not one frame: the length may be the damaged field.
                is_skipping = True
                self.skipped_bytes += 1
                start += 1
            else:
                found.append(frame)
                is_skipping = False
                start = end
        del pending[:start]
        return found

    def give_up(self) -> list[Frame | ProtocolError]:
        """Give up an incomplete frame; return the frames behind its first byte."""
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
