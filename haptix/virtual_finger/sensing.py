"""What a virtual finger feels, and what a force sensor and a touch panel read of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
import numpy.typing as npt

from haptix.checks import Array, NotNegative, Positive, check_fields, choice
from haptix.motion import LIFTED_BELOW_N, Trajectory


@dataclass(frozen=True)
class Felt:
    """What the finger felt; arrays of shape (samples,), evenly spaced in time."""

    t_s: Array
    """Time [s], on the clock of the path."""
    x_mm: Array
    y_mm: Array
    """True place of the finger [mm]."""
    speed_mm_per_s: Array
    """Sliding speed [mm/s]."""
    normal_force_n: Array
    """Normal force [N]."""
    mu: Array
    """Friction coefficient; NaN where the finger stands or is lifted, since nothing slides."""
    friction_force_n: Array
    """Friction force against the motion [N]; 0 where nothing slides, since static friction equals a
    push that is not known."""
    status: npt.NDArray[np.int64]
    """`haptix.Status`: `PULL_IN` where the contact snaps in (values at the branch's end),
    `BREAKDOWN` where that term is on and the field too high, else `OK`."""

    @property
    def is_sliding(self) -> npt.NDArray[np.bool_]:
        """Whether the finger slides, so that there is friction."""
        return np.isfinite(self.mu)


Axis = Literal["motion", "x", "y"]


@dataclass(frozen=True)
class SensedForce:
    """Readings; arrays of shape (samples,)."""

    t_s: Array
    """Time at which the reading arrived [s]."""
    tangential_force_n: Array
    """Tangential force [N]."""
    normal_force_n: Array
    """Normal force [N]."""


@dataclass(frozen=True)
class SensorModel:
    """Noise, drift, crosstalk, offset, sign and latency of a two-axis force sensor.

    Parameters
    ----------
    force_noise_n : float
        Standard deviation of each reading of either force [N]: white, normal.
    drift_n_per_s : float
        Rise of the tangential reading [N/s], from the first sample on.
    crosstalk : float
        Share of each force that shows in the other's reading.
    offset_n : float
        Tangential reading without load [N].
    tangential_sign : int
        1, or -1 for a sensor mounted the other way round.
    latency_s : float
        Age of the force when its reading arrives [s]; before the first sample the first is read.
    axis : {"motion", "x", "y"}
        The tangential force along the motion, always positive; or the component along an axis of
        the screen of the force with which the finger drags it, positive towards larger x or y.
    """

    force_noise_n: NotNegative = 0.0
    drift_n_per_s: float = 0.0
    crosstalk: float = 0.0
    offset_n: float = 0.0
    tangential_sign: int = 1
    latency_s: NotNegative = 0.0
    axis: Axis = "motion"

    def __post_init__(self) -> None:
        check_fields(self)
        choice("tangential_sign", self.tangential_sign, (1, -1))
        choice("axis", self.axis, get_args(Axis))

    def read(self, felt: Felt, seed: int = 0) -> SensedForce:
        """Read what a finger felt; the same seed gives the same noise."""
        then = felt.t_s - self.latency_s
        tangential = np.interp(then, felt.t_s, self._tangential(felt))
        normal = np.interp(then, felt.t_s, felt.normal_force_n)
        noise = np.random.default_rng(seed).normal(0.0, self.force_noise_n, (2, len(felt.t_s)))
        drift = self.drift_n_per_s * (felt.t_s - felt.t_s[0])
        read = self.tangential_sign * tangential + self.crosstalk * normal + self.offset_n + drift
        return SensedForce(
            t_s=felt.t_s,
            tangential_force_n=read + noise[0],
            normal_force_n=normal + self.crosstalk * tangential + noise[1],
        )

    def _tangential(self, felt: Felt) -> Array:
        if self.axis == "motion":
            return felt.friction_force_n
        step_x, step_y = np.gradient(felt.x_mm), np.gradient(felt.y_mm)
        size = np.hypot(step_x, step_y)
        along = step_x if self.axis == "x" else step_y
        share = np.divide(along, size, out=np.zeros_like(size), where=size > 0)
        return np.asarray(felt.friction_force_n * share)


@dataclass(frozen=True)
class SensedTouch:
    """Reports while the finger touches; arrays of shape (reports,)."""

    t_s: Array
    """Time at which the panel scanned [s]."""
    arrival_s: Array
    """Time at which the report arrives, `latency_s` later [s]."""
    x_mm: Array
    y_mm: Array
    """Reported place [mm]."""
    normal_force_n: Array
    """Reported normal force [N], above 0."""


@dataclass(frozen=True)
class TouchPanel:
    """Rate, latency and noise of a touch panel with a force axis.

    Parameters
    ----------
    rate_hz : float
        Reports per second; panels give 60 to 240 (physics page, section 7).
    latency_s : float
        From the scan to the arrival of its report [s]; 14 to 30 ms are usual.
    place_noise_mm, force_noise_n : float
        Standard deviation of each coordinate and of the force: white, normal.
    resolution_mm : float
        Step of the reported place; 0 for none.
    """

    rate_hz: Positive = 100.0
    latency_s: NotNegative = 0.02
    place_noise_mm: NotNegative = 0.0
    force_noise_n: NotNegative = 0.0
    resolution_mm: NotNegative = 0.0

    def __post_init__(self) -> None:
        check_fields(self)

    def read(self, path: Trajectory, seed: int = 0) -> SensedTouch:
        """Report a true path; the same seed gives the same noise."""
        scans = int(path.duration_s * self.rate_hz + 1e-6) + 1
        time = path.t_s[0] + np.arange(scans) / self.rate_hz
        x, y, force = path.at(time)
        random = np.random.default_rng(seed)
        place = np.stack([x, y]) + random.normal(0.0, self.place_noise_mm, (2, len(time)))
        if self.resolution_mm:
            place = np.rint(place / self.resolution_mm) * self.resolution_mm
        noisy = force + random.normal(0.0, self.force_noise_n, len(time))
        touching = (force >= LIFTED_BELOW_N) & (noisy > 0)
        return SensedTouch(
            t_s=time[touching],
            arrival_s=time[touching] + self.latency_s,
            x_mm=place[0, touching],
            y_mm=place[1, touching],
            normal_force_n=noisy[touching],
        )
