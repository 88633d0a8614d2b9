"""Which sample a driver plays at a time of the host's clock."""

from __future__ import annotations

from collections import deque

_KEPT_S = 1.0  # in which clocks that differ by 100 ppm part by 0.1 ms


class OutputClock:
    """Follows the output of a driver by its reports.

    A report may be read late, never early. So the one that shows the driver furthest ahead is the
    best of the last second.

    Parameters
    ----------
    rate_hz : float
        Samples per second.
    """

    def __init__(self, rate_hz: float) -> None:
        self.rate_hz = rate_hz
        self._origins: deque[tuple[float, float]] = deque()
        self._origin = 0.0

    def restart(self, host_s: float, played: float) -> None:
        """Forget earlier reports: from here on the output goes on without a gap."""
        self._origins.clear()
        self.observe(host_s, played)

    def observe(self, host_s: float, played: float) -> None:
        """Take a report, read at `host_s`, of how many samples were played."""
        origins, origin = self._origins, played - host_s * self.rate_hz
        while origins and (origins[-1][1] <= origin or origins[0][0] < host_s - _KEPT_S):
            # Those that are not further ahead can never be the best again.
            if origins[-1][1] <= origin:
                origins.pop()
            else:
                origins.popleft()
        origins.append((host_s, origin))
        self._origin = origins[0][1]

    def played(self, host_s: float) -> float:
        """Return how many samples the driver has played at a time, fractions included."""
        return self._origin + host_s * self.rate_hz

    def time_of(self, index: float) -> float:
        """Return when a sample is played, by the host's clock."""
        return (index - self._origin) / self.rate_hz
