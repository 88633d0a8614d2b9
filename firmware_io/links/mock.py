"""The mock link: a driver in the same process, with faults injected on the way to it."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from firmware_io.address import number, one_of, yes_or_no
from firmware_io.errors import DeviceDisconnectedError
from firmware_io.link import Link
from firmware_io.links.fault_injection import FaultInjection, InjectedFault
from firmware_io.mock import MockDriver
from firmware_io.protocol import REPORT_BYTES, to_reports
from firmware_io.scheme import Scheme


class MockLink(Link):
    """The link to a `MockDriver`.

    Parameters
    ----------
    driver : MockDriver, optional
        The driver at the other end; one with default properties if not given.
    report_bytes : int, optional
        Carry the frames in HID reports of this size, the driver's own; as bytes if not given.
    sleep : callable
        Waits for a number of seconds between two polls for an answer at real pace.

    Attributes
    ----------
    injected : FaultInjection
        The faults that will happen on this link.
    """

    def __init__(
        self,
        driver: MockDriver | None = None,
        report_bytes: int | None = None,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self.driver = MockDriver() if driver is None else driver
        self.injected = FaultInjection()
        self._report_bytes = report_bytes
        self._sleep = sleep
        self._is_closed = False

    @property
    def name(self) -> str:
        """The driver's name in messages."""
        return "mock"

    @property
    def report_bytes(self) -> int | None:
        """Size of the reports that carry the bytes; None where a write may be of any size."""
        return self._report_bytes

    def inject(self, fault: InjectedFault | str, after: int = 0, seconds: float = 0.0) -> None:
        """Let one fault happen; see `FaultInjection.add`."""
        self.injected.add(fault, after, seconds)

    def send(self, data: bytes) -> None:
        """Hand bytes to the driver; see `Link.send`."""
        self._check_open()
        size = self._report_bytes
        for transfer in [data] if size is None else to_reports(data, size):
            for event in self.injected.outward(transfer):
                self._apply(event)

    def receive(self, timeout_s: float = 0.0) -> bytes:
        """Return the driver's answers; see `Link.receive`."""
        driver = self.driver
        end_s = driver.clock() + timeout_s if driver.pace == "real" else 0.0
        while True:
            self._check_open()
            data = driver.transmit() if self._report_bytes is None else self._receive_reports()
            if data:
                data = self.injected.inward(data)
            if data or driver.pace == "virtual":
                return data
            now_s = driver.clock()
            if now_s >= end_s:
                return b""
            self._sleep(min(end_s - now_s, 1e-3))
            # A test's clock stands still while this thread waits, so the wait would never end.
            if driver.clock() == now_s:
                return b""

    def close(self) -> None:
        """Close the link; the driver ends at 0 V. Idempotent."""
        if not self._is_closed:
            self._is_closed = True
            self.driver.release()

    def _receive_reports(self) -> bytes:
        pieces = []
        while report := self.driver.transmit_report():
            pieces.append(report[2 : 2 + (report[1] & 0x7F)])
        return b"".join(pieces)

    def _apply(self, event: bytes | float | OSError) -> None:
        if isinstance(event, OSError):
            if self.injected.is_unplugged:
                self.driver.release()
                self._check_open()
            raise event
        if isinstance(event, float):
            if self.driver.pace == "virtual":
                self.driver.advance(event)
            else:
                self._sleep(event)
        elif event:
            if self._report_bytes is None:
                self.driver.receive(event)
            else:
                self.driver.receive_report(event)

    def _check_open(self) -> None:
        if self._is_closed:
            raise DeviceDisconnectedError("The mock link is closed; open the device again.")
        if self.injected.is_unplugged:
            raise DeviceDisconnectedError(
                "The mock's cable is unplugged (injected); plug it in and open the device again."
            )


def _open(reports: bool = False, **values: Any) -> MockLink:
    return MockLink(MockDriver(**values), REPORT_BYTES if reports else None)


SCHEME = Scheme(
    _open,
    {
        "pace": one_of("virtual", "real"),
        "reports": yes_or_no,
        "full_scale_v": number,
        "ceiling_v": number,
        "serial": str,
    },
    makes_rate=True,
)
