"""A force sensor under the screen: what it reads of what the finger feels."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
import numpy.typing as npt

from haptix import checks
from haptix.virtual_finger.felt import Felt

Array = npt.NDArray[np.float64]
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

    force_noise_n: float = 0.0
    drift_n_per_s: float = 0.0
    crosstalk: float = 0.0
    offset_n: float = 0.0
    tangential_sign: int = 1
    latency_s: float = 0.0
    axis: Axis = "motion"

    def __post_init__(self) -> None:
        for name in ("force_noise_n", "latency_s"):
            checks.number(name, getattr(self, name), 0.0)
        for name in ("drift_n_per_s", "crosstalk", "offset_n"):
            checks.number(name, getattr(self, name))
        checks.choice("tangential_sign", self.tangential_sign, (1, -1))
        checks.choice("axis", self.axis, get_args(Axis))

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
