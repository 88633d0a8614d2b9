"""The host's clock, and what tests put in its place."""

from __future__ import annotations

import time
from typing import Protocol


class Clock(Protocol):
    """Something that tells the time and waits; a test's stands until it is told to go on."""

    def __call__(self) -> float:
        """Return the time in seconds, from any moment on; it never goes back."""

    def sleep(self, seconds: float) -> None:
        """Let so much time pass."""


class HostClock:
    """The computer's."""

    def __call__(self) -> float:
        """Return the time in seconds."""
        return time.monotonic()

    def sleep(self, seconds: float) -> None:
        """Wait."""
        time.sleep(seconds)


HOST_CLOCK = HostClock()
