"""A link: the one interface that hardware and simulation both implement."""

from __future__ import annotations

from abc import ABC, abstractmethod


class Link(ABC):
    """Carries bytes to one driver and back.

    A link knows neither limits nor frames: `firmware_io.Device` speaks the protocol through it,
    and is the only one to hold it. An implementation turns its library's errors into those of
    `firmware_io.errors`; an OSError may pass, and counts as a lost link. One thread at a time.
    """

    @property
    @abstractmethod
    def name(self) -> str:
        """What to call the driver in a message, such as its address."""

    @property
    def report_bytes(self) -> int | None:
        """Size of the reports that carry the bytes (HID); None where a write may be of any size."""
        return None

    @property
    def latency_s(self) -> float | None:
        """What it adds to the time between a sample and the output; None if nobody knows."""
        return 0.0

    @abstractmethod
    def send(self, data: bytes) -> None:
        """Deliver bytes, in order and as a whole.

        Raises
        ------
        DeviceDisconnectedError
            If the link is closed or lost. The bytes may have arrived or not.
        """

    @abstractmethod
    def receive(self, timeout_s: float = 0.0) -> bytes:
        """Return what has come from the driver, empty if nothing came within the timeout.

        Raises
        ------
        DeviceDisconnectedError
            If the link is closed or lost.
        """

    @abstractmethod
    def close(self) -> None:
        """Let the driver go, which then ends at 0 V, at the latest by its watchdog. Idempotent."""
