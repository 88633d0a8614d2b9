"""Frames in HID reports: pieces of fixed size, each with an id and a length (PROTOCOL.md)."""

from __future__ import annotations

from firmware_io.errors import ProtocolError
from firmware_io.protocol.frames import STREAM_OVERHEAD_BYTES

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

    Raises
    ------
    ProtocolError
        If it is not a report of this protocol.
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


def overhead_share(samples: int, report_bytes: int = REPORT_BYTES) -> float:
    """Return the share of report bytes that carry no sample, for frames of `samples`."""
    frame_bytes = STREAM_OVERHEAD_BYTES + 2 * samples
    reports = -(-frame_bytes // (report_bytes - _PREFIX_BYTES))
    return 1 - 2 * samples / (reports * report_bytes)
