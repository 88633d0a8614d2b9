"""The interface that the firmware in C and its reference in Python share."""

from __future__ import annotations

from enum import IntEnum
from typing import Literal, Protocol

import numpy as np
import numpy.typing as npt

from firmware_io.protocol import FaultReport, StatusReport, TouchReport

CoreName = Literal["auto", "c", "python"]


class Output(IntEnum):
    """The kind of an output sample: none, of the stream, held, of the safety ramp."""

    IDLE = 0
    STREAM = 1
    HELD = 2
    RAMP = 3


#: Added to the kind of an output sample while the digital line is high.
LINE = 0x80


class Core(Protocol):
    """The device side of the protocol: it takes bytes, answers with bytes, and plays samples.

    Its only clock is the number of samples played. It is not safe for several threads at once.
    """

    name: str

    @property
    def pending_ticks(self) -> int:
        """Output samples until only zeros or a held sample are left to play."""

    def receive(self, data: bytes) -> None:
        """Take bytes from the host, in pieces of any size."""

    def receive_report(self, report: bytes) -> None:
        """Take one HID report from the host, its id first."""

    def transmit(self) -> bytes:
        """Return the frames that wait for the host; empty if there are none."""

    def transmit_report(self) -> bytes:
        """Return one HID report for the host; empty if there is none."""

    def play(self, ticks: int) -> tuple[npt.NDArray[np.int16], npt.NDArray[np.uint8]]:
        """Return the next output samples as codes, and the kind of each: `Output`, and `LINE`."""

    def status(self) -> StatusReport:
        """Return the state of the device, without a frame on the wire."""

    def fault(self) -> FaultReport | None:
        """Return the first fault since the last accepted HELLO, SETUP or ARM."""

    def touch(self, touch: TouchReport) -> bool:
        """Report a finger, at the present clock; False if the host has not read the last eight."""

    def release(self) -> None:
        """Handle the loss of the host: a bus reset, a closed connection."""
