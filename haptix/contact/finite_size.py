"""Finite size of the contact: its surfaces cannot be further apart than its highest asperity.

Below the pressure at which the infinite theory's mean gap reaches that height, a finite contact
rests on its highest asperity, and its gaps widen no further. This is the kink of the paper's
Fig. 3C, and what makes friction under voltage rise as the force falls.
"""

from __future__ import annotations

from math import pi

import torch
from torch import Tensor

from haptix.interpolation import UniformCubic

_BISECTIONS = 60


def highest_asperity(h_rms_m: Tensor, rolloff_per_m: float, apparent_area_m2: Tensor) -> Tensor:
    """``h_rms sqrt(2 ln N)`` [m] with ``N = A0 (q_r / 2 pi)^2``, for A0 [m^2] of any shape.

    Source: physics page, section 2. N is at least 2: a contact smaller than one roll-off wavelength
    still has a height of the order of h_rms.
    """
    number = apparent_area_m2 * (rolloff_per_m / (2 * pi)) ** 2
    return h_rms_m * torch.sqrt(2 * torch.log(number.clamp(min=2.0)))


def touching_log_pressure(log_mean_gap: UniformCubic, log_height: Tensor) -> Tensor:
    """Return ln p [Pa] at which the mean gap equals heights, of any shape; all are logarithms."""
    step = log_mean_gap.step
    low = torch.zeros_like(log_height) + torch.as_tensor(log_mean_gap.start).detach()
    high = low + step * (log_mean_gap.values.shape[0] - 1)
    with torch.no_grad():
        for _ in range(_BISECTIONS):
            middle = (low + high) / 2
            wider = log_mean_gap(middle) > log_height
            low, high = torch.where(wider, middle, low), torch.where(wider, high, middle)
    # One Newton step, recorded by autograd: the height moves the pressure.
    value, slope = log_mean_gap.with_slope(low)
    return low + (log_height - value) / slope.detach().clamp(max=-1e-12)
