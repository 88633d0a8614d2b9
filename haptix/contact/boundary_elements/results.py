"""Results of a solved contact: area, gaps, attraction, and how exactly it was solved."""

from __future__ import annotations

from dataclasses import dataclass
from math import log, pi

import torch
from torch import Tensor

# Of the perimeter: how far the pixels in contact reach beyond the contact, on average over the
# directions of its border (Yastrebov, Anciaux, Molinari, J. Mech. Phys. Solids 107 (2017), eq. 20).
_PERIMETER_SHARE = (pi - 1 + log(2)) / 24

GAP_LEVELS = (torch.arange(32, dtype=torch.float64) + 0.5) / 32
"""Shares at which the gap's distribution is given: the middles of 32 equal classes."""


@dataclass(frozen=True)
class ContactSolution:
    """Solved states, all of shape (loads, surfaces) or (loads, strengths, surfaces)."""

    pressure_pa: Tensor
    """Applied nominal pressure p0 [Pa]."""
    strength: Tensor
    """Factor on the attraction, 0 without one."""
    area_fraction_raw: Tensor
    """Pixels with pressure, A/A0."""
    area_fraction: Tensor
    """The same, corrected for the pixels that stand over the contact's border: use this one."""
    plastic_fraction: Tensor
    """Share of the nominal area at the hardness."""
    mean_gap_m: Tensor
    """Mean gap over the nominal area [m]."""
    gap_quantiles_m: Tensor
    """Quantiles of the open gaps [m] at `GAP_LEVELS`, shape (..., levels); NaN without any."""
    attraction_gaps_pa: Tensor
    attraction_spots_pa: Tensor
    """Mean attraction [Pa] over the nominal area, of the open gaps and of the spots."""
    residual: Tensor
    """Largest violation of the contact conditions, over h_rms."""
    iterations: Tensor
    """Steps on the finest grid, all together."""
    converged: Tensor
    """Whether the residual is within the tolerance."""
    status: Tensor
    """`Status`: OK, or PULL_IN past the end of the lowest branch; values are those at its end."""
    snap_in_strength: Tensor
    """Strengths between which the lowest branch ends, shape (..., 2); NaN where it was not met."""

    @property
    def attraction_pa(self) -> Tensor:
        """Mean attraction [Pa], gaps and spots."""
        return self.attraction_gaps_pa + self.attraction_spots_pa


def corrected_area(contact: Tensor) -> Tensor:
    """Contact share of periodic masks, shape (..., n, n), corrected for its pixels.

    A pixel counts as contact or not, so that the contact's border is drawn out: the area is too
    large by ``(pi - 1 + ln 2)/24`` times the perimeter counted in pixel sides, times the side
    (Yastrebov, Anciaux, Molinari, J. Mech. Phys. Solids 107, 469 (2017)).
    """
    perimeter = sum(
        (contact ^ contact.roll(1, axis)).to(torch.float64).mean((-2, -1)) for axis in (-2, -1)
    )
    raw = contact.to(torch.float64).mean((-2, -1))
    # Of a few lone pixels the correction would leave less than a disc in each; never below 0.
    return (raw - _PERIMETER_SHARE * perimeter).clamp(min=0.0)


def open_quantiles(gap_m: Tensor, contact: Tensor) -> Tensor:
    """Quantiles of the open gaps of one surface, linear between neighbours; NaN without any."""
    rising = gap_m[~contact].sort().values
    levels = GAP_LEVELS.to(rising.device)
    if len(rising) == 0:
        return torch.full_like(levels, float("nan"))
    at = levels * (len(rising) - 1)
    below = at.floor().long()
    above = (below + 1).clamp(max=len(rising) - 1)
    return torch.lerp(rising[below], rising[above], at - below)
