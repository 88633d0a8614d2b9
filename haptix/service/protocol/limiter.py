"""The rate limiter of all doors, and the folder of the service."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import platformdirs


class Limiter:
    """The rate limiter of all doors: messages, batches and touches of sessions, REST, codes.

    It allows so many a second: more are delayed (`wait_s`) or refused (`takes`).

    Parameters
    ----------
    per_s : float
        The rate.
    now_s : callable
        The clock.
    at_once : float, optional
        How many may be taken at once after a rest; by default as many as in a second.
    """

    def __init__(
        self, per_s: float, now_s: Callable[[], float], at_once: float | None = None
    ) -> None:
        self._per_s, self._now_s = per_s, now_s
        self._most = per_s if at_once is None else at_once
        self._left, self._at_s = self._most, now_s()

    def wait_s(self, count: int = 1) -> float:
        """Take `count` and return how long to wait."""
        now_s = self._now_s()
        self._left = min(self._left + (now_s - self._at_s) * self._per_s, self._most) - count
        self._at_s = now_s
        return max(-self._left / self._per_s, 0.0)

    def takes(self) -> bool:
        """Take one if there is one."""
        self.wait_s(0)
        is_there = self._left >= 1
        self._left -= is_there
        return is_there


def service_folder() -> Path:
    """Return ``$HAPTIX_SERVICE``, or ``haptix/service`` in the user's state folder."""
    if chosen := os.environ.get("HAPTIX_SERVICE"):
        return Path(chosen).expanduser()
    return platformdirs.user_state_path("haptix", appauthor=False) / "service"
