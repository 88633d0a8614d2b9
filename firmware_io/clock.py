"""The host's clock, and the interface of the clocks that tests use instead."""

from __future__ import annotations

import time
from typing import Protocol


class Clock(Protocol):
    """Tells the time and waits. A test's clock stands still until the test advances it."""

    def __call__(self) -> float:
        """Return the time in seconds since an arbitrary moment; it never decreases."""

    def sleep(self, seconds: float) -> None:
        """Wait."""


class HostClock:
    """The computer's monotonic clock."""

    def __call__(self) -> float:
        """Return the time in seconds."""
        return time.monotonic()

    def sleep(self, seconds: float) -> None:
        """Wait."""
        time.sleep(seconds)


HOST_CLOCK = HostClock()
