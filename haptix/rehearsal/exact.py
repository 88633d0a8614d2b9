"""Amplitudes without the surface: the contact model itself, inverted."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

from haptix.friction import ContactModel

Array = npt.NDArray[np.float64]

_ITERATIONS = (
    5  # of the secant: 1/mu is nearly linear in V^2, and the surface is near to begin with
)


def exact_amplitude(
    model: ContactModel,
    mu: Array,
    normal_force_n: Array,
    frequency_hz: float | None,
    h0_m: float,
    near_v: Array,
) -> Array:
    """Amplitudes [V] at which the model itself has a friction, from amplitudes that are near.

    Parameters
    ----------
    mu, normal_force_n, near_v : ndarray, shape (points,)
        Wanted friction, above that without voltage; force [N]; the surface's amplitude [V].
    frequency_hz, h0_m : float
        Of the drive and of the screen.
    """
    force, goal = torch.from_numpy(normal_force_n), torch.from_numpy(1 / mu)
    most = model.screen.max_voltage_v**2

    def miss(square: Tensor) -> Tensor:
        return 1 / model.solve(force, square.sqrt(), frequency_hz, h0_m).mu - goal

    before = torch.from_numpy(near_v**2).clamp(1e-6, most)
    square = (before * 0.999).clamp(min=1e-6)
    miss_before, miss_now = miss(before), miss(square)
    for _ in range(_ITERATIONS):
        slope = (miss_now - miss_before) / (square - before)
        step = torch.where(slope < 0, -miss_now / slope, 0.0)
        before, miss_before = square, miss_now
        # A point that has converged would divide nothing by nothing.
        square = torch.where(miss_now.abs() > 1e-13 * goal, square + step, square * (1 - 1e-12))
        square = square.clamp(1e-6, most)
        miss_now = miss(square)
    return np.asarray(square.sqrt().numpy())
