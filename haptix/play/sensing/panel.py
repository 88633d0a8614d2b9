"""The capacitance of the untouched panel, and how it drifts."""

from __future__ import annotations

from cmath import isfinite
from math import nan


class PanelBaseline:
    """Average of the untouched panel that follows a steady drift without lag.

    An average and the average of that, each over `span_s` (double exponential smoothing; Brown,
    Smoothing, Forecasting and Prediction of Discrete Time Series, 1963).

    Parameters
    ----------
    span_s : float
        Time constant of both [s].
    voltage_v : float
        Amplitude at which it is measured [V], until a reading has stated it.
    """

    def __init__(self, span_s: float, voltage_v: float) -> None:
        self._span_s = span_s
        self.farads = complex(nan, nan)
        """Now [F]."""
        self.drift_f_per_s = 0.0
        """Size of its change [F/s]."""
        self.sd_f = 0.0
        """Standard deviation of each part of `farads` by the readings' noise [F]."""
        self.voltage_v = voltage_v
        """Mean amplitude at which it was measured [V]."""
        self.t_s = nan
        """Time of the last reading [s]."""
        self._began_s = nan
        self._averages = self.farads, self.farads
        self._variance_f2 = 0.0

    @property
    def is_measured(self) -> bool:
        """Whether it is known."""
        return isfinite(self.farads)

    def read(self, t_s: float, farads: complex, voltage_v: float) -> None:
        """Take a reading of the untouched panel."""
        first, second = self._averages
        share = 1.0
        if isfinite(first):
            known_s = t_s - self._began_s
            share = min(1.0, (t_s - self.t_s) / min(self._span_s, known_s))
        else:
            first = second = farads
            self._began_s = t_s
            known_s = 0.0
        off = farads - first
        self._variance_f2 += share * (abs(off) ** 2 / 2 - self._variance_f2)
        first += share * off
        second += share * (first - second)
        self.voltage_v += share * (voltage_v - self.voltage_v)
        self._averages, self.t_s = (first, second), t_s
        rise = first - second
        self.farads = first + rise
        # At first the second average lags by a quarter of the time, and then by the span.
        self.drift_f_per_s = abs(rise) / min(self._span_s, known_s / 4) if known_s else 0.0
        self.sd_f = (1.25 * share * self._variance_f2) ** 0.5  # of the sum of both averages
