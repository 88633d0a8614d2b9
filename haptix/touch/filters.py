"""Filters of a touch's place: the interface, a plain Kalman filter and the One-Euro filter."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from math import hypot, tau

from haptix.checks import NotNegative, Positive, check_fields

FilterState = tuple[float, ...]
"""t [s], x, y [mm], vx, vy [mm/s]; the rest is the filter's own."""


class PlaceFilter(ABC):
    """A filter whose state is an immutable tuple, so that steps can be undone."""

    def __post_init__(self) -> None:
        check_fields(self)

    @abstractmethod
    def start(self, t_s: float, x_mm: float, y_mm: float) -> FilterState:
        """State after the first report."""

    @abstractmethod
    def step(self, state: FilterState, t_s: float, x_mm: float, y_mm: float) -> FilterState:
        """State after a report at `t_s`, which is not before that of `state`."""

    def ahead(self, state: FilterState, ahead_s: float) -> tuple[float, float, float, float]:
        """Place and velocity `ahead_s` after the state's report, or before it if below 0."""
        vx, vy = state[3], state[4]
        return (state[1] + vx * ahead_s, state[2] + vy * ahead_s, vx, vy)


@dataclass(frozen=True)
class ConstantVelocityKalman(PlaceFilter):
    """Velocity driven by white acceleration noise; both axes alike and independent.

    The discretised continuous-time model, so intervals may be irregular: over dt the covariance
    grows by ``q [[dt^3/3, dt^2/2], [dt^2/2, dt]]`` (Bar-Shalom, Li and Kirubarajan, *Estimation
    with Applications to Tracking and Navigation*, 2001, section 6.2.2). Because both axes are
    alike, one covariance serves them, and turning the screen turns the result. The rest of the
    state is that covariance: place with place, place with velocity, velocity with velocity.

    Parameters
    ----------
    acceleration_psd : float
        q, the power spectral density of the acceleration [mm^2/s^3]: the velocity wanders by
        sqrt(q dt) mm/s in dt.
    position_noise_mm : float
        Standard deviation of a report along each axis.
    first_speed_mm_s : float
        Standard deviation of the velocity, along each axis, of a finger that has just come down.
    """

    acceleration_psd: Positive = 2e4
    position_noise_mm: Positive = 0.1
    first_speed_mm_s: Positive = 60.0

    def start(self, t_s: float, x_mm: float, y_mm: float) -> FilterState:
        """State after the first report."""
        return (
            t_s, x_mm, y_mm, 0.0, 0.0, self.position_noise_mm**2, 0.0, self.first_speed_mm_s**2,
        )  # fmt: skip

    def step(self, state: FilterState, t_s: float, x_mm: float, y_mm: float) -> FilterState:
        """State after a report at `t_s`, which is not before that of `state`."""
        t0, x, y, vx, vy, place, both, speed = state
        q = self.acceleration_psd
        noise = self.position_noise_mm * self.position_noise_mm
        dt = t_s - t0
        grown = q * dt
        cross = both + dt * (speed + 0.5 * grown)
        place += dt * (both + both + dt * (speed + grown / 3.0))
        speed += grown
        total = place + noise
        gain = place / total
        gain_speed = cross / total
        x += vx * dt
        y += vy * dt
        dx = x_mm - x
        dy = y_mm - y
        speed -= gain_speed * cross
        return (
            t_s, x + gain * dx, y + gain * dy, vx + gain_speed * dx, vy + gain_speed * dy,
            noise * gain, noise * gain_speed, speed if speed > 0.0 else 0.0,
        )  # fmt: skip


@dataclass(frozen=True)
class OneEuroFilter(PlaceFilter):
    """A low pass whose cut-off rises with speed (Casiez, Roussel and Vogel, CHI 2012).

    As published, ``dx = (x - filtered x before) / dt`` is smoothed with a constant cut-off, and the
    place with ``min_cutoff + beta * speed``. Two choices are ours. The speed is that of both axes
    together, so that turning the screen turns the result. And since dx over-estimates the velocity
    by ``1 / alpha``, where alpha is the weight of the newest report, the velocity given here is
    alpha times the smoothed dx: that of the filtered place. The rest is the smoothed dx, dy.

    Parameters
    ----------
    min_cutoff_hz : float
        Cut-off for a finger at rest.
    beta_per_mm : float
        Rise of the cut-off [Hz] per speed [mm/s].
    derivative_cutoff_hz : float
        Cut-off for dx.
    """

    min_cutoff_hz: Positive = 5.0
    beta_per_mm: NotNegative = 1.0
    derivative_cutoff_hz: Positive = 36.0

    def start(self, t_s: float, x_mm: float, y_mm: float) -> FilterState:
        """State after the first report."""
        return (t_s, x_mm, y_mm, 0.0, 0.0, 0.0, 0.0)

    def step(self, state: FilterState, t_s: float, x_mm: float, y_mm: float) -> FilterState:
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
