"""The interface that the firmware in C and its reference in Python share."""

from __future__ import annotations

from enum import IntEnum
from typing import Literal, Protocol

import numpy as np
import numpy.typing as npt

from firmware_io.protocol import FaultReport, StatusReport, TouchReport

CoreName = Literal["auto", "c", "python"]


class Output(IntEnum):
    """What an output sample is."""

    IDLE = 0
    STREAM = 1
    HELD = 2
    RAMP = 3


class Core(Protocol):
    """The device side of the protocol: bytes in, bytes out, and one output sample after the other.

    It knows no clock but the samples that were played. Not safe for several threads at once.
    """

    name: str

    @property
    def pending_ticks(self) -> int:
        """Output samples until nothing is left to play but zeros or a held sample."""

    def receive(self, data: bytes) -> None:
        """Take bytes from the host, in pieces of any size."""

    def receive_report(self, report: bytes) -> None:
        """Take one HID report from the host, its id first."""

    def transmit(self) -> bytes:
        """Return the frames that wait for the host; empty if none do."""

    def transmit_report(self) -> bytes:
        """Return one HID report for the host; empty if there is nothing to say."""

    def play(self, ticks: int) -> tuple[npt.NDArray[np.int16], npt.NDArray[np.uint8]]:
        """Return the next output samples as codes, and what each is (an `Output`)."""

    def status(self) -> StatusReport:
        """Return where the device stands, without a word on the wire."""

    def fault(self) -> FaultReport | None:
        """Return the first cause since HELLO, SETUP or ARM was last accepted."""

    def touch(self, touch: TouchReport) -> bool:
        """Report a finger, at the present clock; False if the host has not read the last eight."""

    def release(self) -> None:
        """Learn that the host has gone away: a bus reset, a closed connection."""
