"""A Kalman filter of constant velocity, for a place on a plane."""

from __future__ import annotations

from dataclasses import dataclass

from haptix.checks import Positive, check_fields

KalmanState = tuple[float, float, float, float, float, float, float, float]
"""t [s], x, y [mm], vx, vy [mm/s], and the covariance of each axis: place, both, velocity."""


@dataclass(frozen=True)
class ConstantVelocityKalman:
    """Velocity driven by white acceleration noise; both axes alike and independent.

    The discretised continuous-time model, so intervals may be irregular: over dt the covariance
    grows by ``q [[dt^3/3, dt^2/2], [dt^2/2, dt]]`` (Bar-Shalom, Li and Kirubarajan, *Estimation
    with Applications to Tracking and Navigation*, 2001, section 6.2.2). Because both axes are
    alike, one covariance serves them, and turning the screen turns the result.

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

    def __post_init__(self) -> None:
        check_fields(self)

    def start(self, t_s: float, x_mm: float, y_mm: float) -> KalmanState:
        """State after the first report."""
        return (
            t_s, x_mm, y_mm, 0.0, 0.0, self.position_noise_mm**2, 0.0, self.first_speed_mm_s**2,
        )  # fmt: skip

    def step(self, state: KalmanState, t_s: float, x_mm: float, y_mm: float) -> KalmanState:
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

    def ahead(self, state: KalmanState, ahead_s: float) -> tuple[float, float, float, float]:
        """Place and velocity `ahead_s` after the state's report, or before it if below 0."""
        vx, vy = state[3], state[4]
        return (state[1] + vx * ahead_s, state[2] + vy * ahead_s, vx, vy)
