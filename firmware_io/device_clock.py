"""The rate of the device's clock against the host's."""

from __future__ import annotations

import numpy as np

_SPACING_S = 0.5  # between the reports that are kept
_KEPT = 120  # a minute of them
_SHORTEST_S = 1.0  # below this a rate would say more about scheduling than about clocks


class DeviceClock:
    """Estimates the rate of the clock that a driver reports.

    A report may come late, never early. Of the reports in each spacing, the one with the least
    delay shows the driver furthest ahead of its nominal rate; that one is kept.

    Parameters
    ----------
    nominal_hz : float
        Samples per second that the driver states.
    """

    def __init__(self, nominal_hz: float) -> None:
        self.nominal_hz = nominal_hz
        self._host_s = np.zeros(_KEPT)
        self._clock = np.zeros(_KEPT)
        self._count = 0
        self._spacing_ends_s = 0.0
        self._latest_s = -np.inf

    def observe(self, host_s: float, clock_samples: float) -> None:
        """Add a report: the driver's clock at the host's time `host_s`."""
        if host_s < self._latest_s:
            return
        self._latest_s = host_s
        here = (self._count - 1) % _KEPT
        if self._count == 0 or host_s >= self._spacing_ends_s:
            here = self._count % _KEPT
            self._count += 1
            self._spacing_ends_s = host_s + _SPACING_S
        elif self._lead(host_s, clock_samples) <= self._lead(self._host_s[here], self._clock[here]):
            return
        self._host_s[here], self._clock[here] = host_s, clock_samples

    @property
    def rate_hz(self) -> float | None:
        """Samples per host second, over the last minute at most; None in the first second."""
        kept = min(self._count, _KEPT)
        host_s, clock = self._host_s[:kept], self._clock[:kept]
        if kept < 3 or host_s.max() - host_s.min() < _SHORTEST_S:
            return None
        t = host_s - host_s.mean()
        return float((t * (clock - clock.mean())).sum() / (t * t).sum())

    @property
    def drift_ppm(self) -> float | None:
        """Excess of the device's rate over nominal, in ppm; None in the first second."""
        rate_hz = self.rate_hz
        return None if rate_hz is None else (rate_hz / self.nominal_hz - 1.0) * 1e6

    def _lead(self, host_s: float, clock_samples: float) -> float:
        return clock_samples - host_s * self.nominal_hz
