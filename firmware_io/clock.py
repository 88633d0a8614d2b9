"""The host's clock, and the interface of the clocks that tests use instead."""

from __future__ import annotations

import time
from typing import Protocol


class Clock(Protocol):
    """Gives the time and waits. A test's clock stands still until the test advances it."""

    def __call__(self) -> float:
        """Return the time in seconds since an arbitrary moment; it never decreases."""

    def sleep(self, seconds: float) -> None:
        """Wait."""


class HostClock:
    """The computer's monotonic clock."""

    __call__ = staticmethod(time.monotonic)
    sleep = staticmethod(time.sleep)


class SteppedClock:
    """A clock that advances only when somebody waits, so that a run can be repeated exactly."""

    def __init__(self) -> None:
        self._now_s = 0.0

    def __call__(self) -> float:
        """Return the time in seconds."""
        return self._now_s

    def sleep(self, seconds: float) -> None:
        """Advance by so many seconds."""
        self._now_s += seconds


HOST_CLOCK = HostClock()
