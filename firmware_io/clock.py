"""The host's clock, and threads that must wake in time: priority, causes of delays, delays."""

from __future__ import annotations

import gc
import os
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Protocol

_WAIT_S = 0.003
_FIFO_PRIORITY = 10  # above every ordinary thread, and below the kernel's threads for devices


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


def raise_priority() -> bool:
    """Give the calling thread real-time priority if the platform allows it.

    On Linux this is SCHED_FIFO, for root or with an `rtprio` limit (limits.conf, or LimitRTPRIO
    of a service). Threads and processes that the thread starts have ordinary priority.

    Returns
    -------
    bool
        Whether it has real-time priority now.
    """
    if sys.platform != "linux":
        return False
    policy = os.SCHED_FIFO | os.SCHED_RESET_ON_FORK
    try:
        os.sched_setscheduler(0, policy, os.sched_param(_FIFO_PRIORITY))
    except OSError:
        return False
    return True


_SWITCH_S = 5e-4
"""How long a thread may hold the interpreter while another waits. With the usual 5 ms, a busy
thread delays a window by as much."""


@contextmanager
def ready_interpreter() -> Iterator[None]:
    """Keep garbage collection and thread switches short, and restore them.

    A full garbage collection takes some 100 ms here. It leaves out frozen objects. Objects that the
    program itself has frozen stay frozen.
    """
    switch_s = sys.getswitchinterval()
    was_frozen = gc.get_freeze_count() > 0
    if not was_frozen:
        gc.collect()
        gc.freeze()
    sys.setswitchinterval(min(switch_s, _SWITCH_S))
    try:
        yield
    finally:
        sys.setswitchinterval(switch_s)
        if not was_frozen:
            gc.unfreeze()


@dataclass(frozen=True)
class WakeUps:
    """How late a thread of a playback wakes on this machine now, in seconds."""

    is_real_time: bool
    """Whether it had real-time priority."""
    p50_s: float
    p99_s: float
    largest_s: float
    """Lateness: median, 99th percentile, and the longest."""


def measure_wake_ups(seconds: float = 0.5) -> WakeUps:
    """Measure how late a thread wakes that waits as a playback does."""
    late: list[float] = []
    has_priority: list[bool] = []

    def wake() -> None:
        has_priority.append(raise_priority())
        ready = threading.Condition()
        end_s = time.monotonic() + seconds
        while (due_s := time.monotonic() + _WAIT_S) < end_s or not late:
            with ready:
                ready.wait(_WAIT_S)
            late.append(max(0.0, time.monotonic() - due_s))

    thread = threading.Thread(target=wake, name="firmware_io wake-ups")
    thread.start()
    thread.join()
    late.sort()
    at = [late[int(share * (len(late) - 1))] for share in (0.5, 0.99, 1.0)]
    return WakeUps(has_priority[0], *at)
