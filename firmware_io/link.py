"""The interface that every way to a driver implements, hardware or simulated."""

from __future__ import annotations

from abc import ABC, abstractmethod

from firmware_io.clock import HOST_CLOCK, Clock


class Link(ABC):
    """Carries bytes to one driver and back.

    A link knows neither limits nor frames. `firmware_io.Device` owns it and speaks the protocol
    through it. An implementation turns its library's errors into those of `firmware_io.errors`; it
    may let an OSError pass, which counts as a lost link. Only one thread uses a link at a time.
    """

    name: str
    """The driver's name in messages, such as its address."""
    clock: Clock = HOST_CLOCK
    """Clock by which the host waits for the driver."""
    report_bytes: int | None = None
    """Size of the reports that carry the bytes (HID); None if a write may have any size."""
    bytes_per_s: float | None = None
    """Bytes that the link carries in a second; None if it has no limit of its own."""

    @property
    def latency_s(self) -> float | None:
        """Delay that the link adds between a sample and the output, in seconds; None if unknown."""
        return 0.0

    @abstractmethod
    def send(self, data: bytes) -> None:
        """Deliver all bytes, in order.

        Raises
        ------
        DeviceDisconnectedError
            If the link is closed or lost. The bytes may or may not have arrived.
        """

    @abstractmethod
    def receive(self, timeout_s: float = 0.0) -> bytes:
        """Return the bytes from the driver; empty if none came within the timeout.

        Raises
        ------
        DeviceDisconnectedError
            If the link is closed or lost.
        """

    @abstractmethod
    def close(self) -> None:
        """Close the link. The driver ends at 0 V, at the latest by its watchdog. Idempotent."""
