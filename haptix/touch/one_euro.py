"""The One-Euro filter, for a place on a plane."""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot, tau

from haptix.checks import NotNegative, Positive, check_fields

OneEuroState = tuple[float, float, float, float, float, float, float]
"""t [s], filtered x, y [mm], vx, vy [mm/s], and the smoothed derivatives along x and y [mm/s]."""


@dataclass(frozen=True)
class OneEuroFilter:
    """A low pass whose cut-off rises with speed (Casiez, Roussel and Vogel, CHI 2012).

    As published, ``dx = (x - filtered x before) / dt`` is smoothed with a constant cut-off, and the
    place with ``min_cutoff + beta * speed``. Two choices are ours. The speed is that of both axes
    together, so that turning the screen turns the result. And since dx over-estimates the velocity
    by ``1 / alpha``, where alpha is the weight of the newest report, the velocity given here is
    alpha times the smoothed dx: that of the filtered place.

    Parameters
    ----------
    min_cutoff_hz : float
        Cut-off for a finger at rest.
    beta_per_mm : float
        How much the cut-off rises [Hz] per speed [mm/s].
    derivative_cutoff_hz : float
        Cut-off for dx.
    """

    min_cutoff_hz: Positive = 5.0
    beta_per_mm: NotNegative = 1.0
    derivative_cutoff_hz: Positive = 36.0

    def __post_init__(self) -> None:
        check_fields(self)

    def start(self, t_s: float, x_mm: float, y_mm: float) -> OneEuroState:
        """State after the first report."""
        return (t_s, x_mm, y_mm, 0.0, 0.0, 0.0, 0.0)

    def step(self, state: OneEuroState, t_s: float, x_mm: float, y_mm: float) -> OneEuroState:
        """State after a report at `t_s`, which is not before that of `state`."""
        t0, x, y, _, _, sx, sy = state
        dt = t_s - t0
        if dt <= 0.0:
            return state
        # alpha = 1 / (1 + tau / dt) with tau = 1 / (2 pi cutoff), and alpha / dt without 0 / 0.
        turns = tau * dt * self.derivative_cutoff_hz
        weight = turns / (1.0 + turns)
        dx = x_mm - x
        dy = y_mm - y
        sx += weight * (dx / dt - sx)
        sy += weight * (dy / dt - sy)
        turns = tau * dt * (self.min_cutoff_hz + self.beta_per_mm * hypot(sx, sy))
        weight = turns / (1.0 + turns)
        return (t_s, x + weight * dx, y + weight * dy, weight * sx, weight * sy, sx, sy)

    def ahead(self, state: OneEuroState, ahead_s: float) -> tuple[float, float, float, float]:
        """Place and velocity `ahead_s` after the state's report, or before it if below 0."""
        vx, vy = state[3], state[4]
        return (state[1] + vx * ahead_s, state[2] + vy * ahead_s, vx, vy)
