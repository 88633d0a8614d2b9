"""A clock for mock drivers at real pace that a busy machine cannot starve."""

import threading
import time
from typing import Any

from firmware_io import MockDriver


class SteadyClock:
    """The wall's clock, but standing while nobody looks at it.

    A machine that stalls for longer than a driver's watchdog would otherwise find the driver
    starved, though no program under test was slow: the watchdog counts the wall's time. Here a
    stall counts as `longest_s` at most, however long it lasts.

    Parameters
    ----------
    longest_s : float
        Most time that passes between two looks.
    speed : float
        Seconds of this clock per second of the wall's. Below 1 where the driver and its host run
        in threads or processes that may stall one without the other.
    """

    def __init__(self, longest_s: float = 0.05, speed: float = 1.0) -> None:
        self.longest_s = longest_s
        self._speed = speed
        self._now_s = 0.0
        self._looked_s = time.perf_counter()
        # Threads look: one that was interrupted amid its look would set the clock back afterwards.
        self._lock = threading.Lock()

    def __call__(self) -> float:
        with self._lock:
            looked_s = time.perf_counter()
            self._now_s += min(looked_s - self._looked_s, self.longest_s) * self._speed
            self._looked_s = looked_s
            return self._now_s


def steady_driver(**options: Any) -> MockDriver:
    """Return a driver at real pace, in the process of its host."""
    return MockDriver(**{"pace": "real", "clock": SteadyClock(), **options})
