"""Finite size of the contact: its surfaces cannot be further apart than its highest asperity.

As the load falls, the mean gap of an infinite contact grows without end; a finite contact at last
rests on its highest asperity alone. Let p_N be the pressure at which the mean gap of the infinite
theory equals the height of that asperity. Three laws describe the transition:

- ``"capped"``: below p_N the gaps are those at p_N. It has the kink of the paper's Fig. 3C.
- ``"smooth"``: the mean gap is that of the infinite theory at ``(p^b + p_N^b)^(1/b)``, b = 2/3. Its
  slope ``du/dlnp`` is the infinite theory's times ``1 / (1 + (p_N/p)^b)``, after Pastewka et al.,
  PRE 87, 062809 (2013); b = 2/3 is Hertz' law for the last tip, ``u(0) - u ~ p^(2/3)``. Near the
  spots the gaps follow the area, which falls further with p. The attraction therefore uses the
  gaps' distribution at a pressure between p and that of the mean gap.
- ``"mean-gap"``: the mean gap is that of ``"smooth"``, and the attraction uses the distribution at
  p itself, as boundary elements show whose pixels resolve the gaps beside the spots
  (docs/mean-field.md).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import pi
from typing import Literal

import numpy as np
import torch
from torch import Tensor

from haptix.model.contact.roughness import RoughnessSpectrum
from haptix.model.contact.tables import UniformCubic

SizeLaw = Literal["capped", "smooth", "mean-gap"]

_HERTZ = 2 / 3
# Where the attraction's pressure lies in ln p: 0 is the load, 1 the pressure of the mean gap.
_SHARE_OF_GAP = {"smooth": 0.5, "mean-gap": 0.0}
_LONG_WAVES = 16.0  # times the roll-off: shorter waves add no height to an asperity
_NEWTON_STEPS = 4
_PEAK_STEPS = 8  # of Newton from above, on a convex function: to 1e-15 for any number of waves


@dataclass(frozen=True)
class Touching:
    """The pressure at which the highest asperity alone touches, for a batch of states."""

    log_pressure: Tensor
    """ln p_N [Pa]; shape (states,)."""
    law: SizeLaw
    """How the gaps change around it."""

    def of_gap(self, log_pressure: Tensor) -> Tensor:
        """Return ln p [Pa] at which an infinite contact has the mean gap, given ln p."""
        if self.law == "capped":
            return torch.maximum(log_pressure, self.log_pressure)
        return torch.logaddexp(_HERTZ * log_pressure, _HERTZ * self.log_pressure) / _HERTZ

    def of_pull(self, log_pressure: Tensor) -> tuple[Tensor, Tensor]:
        """Return ln p [Pa] at which an infinite contact has the attraction, and its slope."""
        if self.law == "capped":
            free = (log_pressure >= self.log_pressure).to(log_pressure.dtype)
            return self.of_gap(log_pressure), free
        free = torch.sigmoid(_HERTZ * (log_pressure - self.log_pressure))
        share = _SHARE_OF_GAP[self.law]
        return torch.lerp(log_pressure, self.of_gap(log_pressure), share), 1 + share * (free - 1)


def once_for_equals(of: Callable[[Tensor], Tensor], x: Tensor) -> Tensor:
    """Return ``of(x)``, elementwise; equal neighbours are computed once.

    A batch repeats a few forces over many voltages. On a GPU the CPU would have to wait for the
    number of runs, and autograd needs every element; there each element is computed.
    """
    if x.ndim != 1 or x.is_cuda or x.requires_grad:
        return of(x)
    _, run, count = torch.unique_consecutive(x.detach(), return_inverse=True, return_counts=True)
    if 2 * len(count) > len(x):
        return of(x)
    return of(x[count.cumsum(0) - count]).index_select(0, run)


def highest_asperity(h_rms_m: Tensor, rolloff_per_m: float, apparent_area_m2: Tensor) -> Tensor:
    """``h_rms sqrt(2 ln N)`` [m] with ``N = A0 (q_r / 2 pi)^2``, for A0 [m^2] of any shape.

    Source: physics page, section 2. N is at least 2: a contact smaller than one roll-off wavelength
    still has a height of the order of h_rms.
    """
    number = apparent_area_m2 * (rolloff_per_m / (2 * pi)) ** 2
    return h_rms_m * torch.sqrt(2 * torch.log(number.clamp(min=2.0)))


def peaks_per_area(spectrum: RoughnessSpectrum) -> Tensor:
    """Density [1/m^2] of the points that may be the highest: ``slope^2 / (2 h_rms^2 (2 pi)^1.5)``.

    The slope is that of the waves up to 16 times the roll-off. The peaks of random surfaces are
    within 4 % of the result (docs/mean-field.md).
    """
    slope_squared = spectrum.moment(3)
    end = _LONG_WAVES * spectrum.q_rolloff
    if end < spectrum.q1:
        slope_squared = slope_squared - spectrum.moment(3, slope_squared.new_tensor([end]))[0]
    peaks: Tensor = slope_squared / (2 * spectrum.moment(1) * (2 * pi) ** 1.5)
    return peaks


def highest_peak(h_rms_m: Tensor, peaks_per_m2: Tensor, apparent_area_m2: Tensor) -> Tensor:
    """Mean height [m] of the highest of all points of a random surface, for A0 [m^2].

    The expected number of separate regions above a height ``x h_rms`` is ``k x exp(-x^2/2)``, where
    k is A0 times `peaks_per_area` (Adler, The Geometry of Random Fields, 1981). We solve for the x
    at which it is 1; the mean of the maximum lies higher by Euler's constant over x (Gumbel). The 1
    that is added in the logarithm keeps x above 0 where k is small.
    """
    number = apparent_area_m2 * peaks_per_m2
    with torch.no_grad():
        # Both bounds lie above the solution.
        x = torch.minimum(1 + torch.sqrt(2 * torch.log1p(number)), 2 * number)
        for _ in range(_PEAK_STEPS):
            x = x - (x * x / 2 - torch.log1p(number * x)) / (x - number / (1 + number * x))
    # One Newton step, recorded by autograd: the area and the roughness move the height.
    slope = (x - number / (1 + number * x)).detach()
    x = x - (x * x / 2 - torch.log1p(number * x)) / slope
    height: Tensor = h_rms_m * (x + np.euler_gamma * x / (1 + x * x))
    return height


def touching_log_pressure(log_mean_gap: UniformCubic, log_height: Tensor) -> Tensor:
    """Return ln p [Pa] at which the mean gap equals heights, of any shape; all are logarithms."""
    step, values = log_mean_gap.step, log_mean_gap.values.detach()
    start = torch.as_tensor(log_mean_gap.start).detach()
    with torch.no_grad():
        # The gap falls with the pressure: find the cell, start on its chord, and use Newton in it.
        cell = torch.searchsorted(-values, -log_height.detach().contiguous())
        cell = cell.clamp(1, len(values) - 1) - 1
        share = (log_height - values[cell]) / (values[cell + 1] - values[cell])
        low = start + step * cell
        at = low + step * share.clamp(0, 1)
        for _ in range(_NEWTON_STEPS):
            value, slope = log_mean_gap.with_slope(at)
            at = at + (log_height - value) / slope.clamp(max=-1e-12)
            at = torch.minimum(torch.maximum(at, low), low + step)
    # One Newton step, recorded by autograd: the height moves the pressure.
    value, slope = log_mean_gap.with_slope(at)
    return at + (log_height - value) / slope.detach().clamp(max=-1e-12)
