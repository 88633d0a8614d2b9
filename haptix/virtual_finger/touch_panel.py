"""A touch panel: what it reports of the finger's true path, and when."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from haptix import checks
from haptix.motion import LIFTED_BELOW_N, Trajectory

Array = npt.NDArray[np.float64]


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

    rate_hz: float = 100.0
    latency_s: float = 0.02
    place_noise_mm: float = 0.0
    force_noise_n: float = 0.0
    resolution_mm: float = 0.0

    def __post_init__(self) -> None:
        checks.positive("rate_hz", self.rate_hz)
        for name in ("latency_s", "place_noise_mm", "force_noise_n", "resolution_mm"):
            checks.number(name, getattr(self, name), 0.0)

    def read(self, path: Trajectory, seed: int = 0) -> SensedTouch:
        """Report a true path; the same seed gives the same noise."""
        time = (
            path.t_s[0] + np.arange(int(path.duration_s * self.rate_hz + 1e-6) + 1) / self.rate_hz
        )
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
