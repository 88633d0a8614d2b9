"""Electrical breakdown of the gap and of the insulator (physics page, section 3)."""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor

NARROW_GAP_FIELD_V_PER_M = 350e6
"""Breakdown field of gaps under 1 um."""

PASCHEN_MINIMUM_V = 327.0
PASCHEN_MINIMUM_GAP_M = 7.5e-6
"""Lowest voltage that breaks air down, and the gap at which it does."""


def peak_field(voltage_v: Tensor, thickness_m: Tensor) -> Tensor:
    """``V0 / |h0|`` [V/m], the field at the edge of a contact spot, the highest in any gap."""
    return voltage_v / thickness_m.abs()


def bearable_field(
    gap_m: Tensor, insulator_permittivity: float, insulator_strength_v_per_m: float
) -> Tensor:
    """Largest field [V/m] that gaps of given widths [m], and the insulator beside them, withstand.

    In wide gaps it is Paschen's law scaled to its minimum, ``V = 327 V x / (1 + ln x)`` with
    ``x = u / 7.5 um``. Under some 3 um that law would give more than 350 V/um, at which electrons
    leave the surface; there the limit is 350 V/um.

    Parameters
    ----------
    gap_m : Tensor
        Widths [m] of 0 or more, any shape; 0 is the edge of a contact spot.
    insulator_permittivity, insulator_strength_v_per_m : float
        eps1, and the field that the insulator withstands [V/m].
    """
    least = PASCHEN_MINIMUM_V / PASCHEN_MINIMUM_GAP_M
    # The logarithm is cut off at some picometres, so that a gap of 0 has a gradient too.
    law = 1 + torch.log((gap_m / PASCHEN_MINIMUM_GAP_M).clamp(min=1e-6))
    air = least / law.clamp(min=least / NARROW_GAP_FIELD_V_PER_M)
    return air.clamp(max=insulator_strength_v_per_m * insulator_permittivity)


def breakdown_voltage(
    thickness_m: Tensor, insulator_permittivity: float, insulator_strength_v_per_m: float
) -> Tensor:
    """Amplitude [V] at which a narrow gap, one at Paschen's minimum, or the insulator breaks down.

    Parameters
    ----------
    thickness_m : Tensor
        Effective thickness h0 [m], real or complex, any shape.
    insulator_permittivity, insulator_strength_v_per_m : float
        As for `bearable_field`.
    """
    gaps, borne = _weakest(insulator_permittivity, insulator_strength_v_per_m)
    narrow, wide = (
        field * (gap + thickness_m).abs() for gap, field in zip(gaps, borne, strict=True)
    )
    return torch.minimum(narrow, wide)


def breaks_down(
    field: Callable[[float], Tensor],
    insulator_permittivity: float,
    insulator_strength_v_per_m: float,
) -> Tensor:
    """Whether a narrow gap, one at Paschen's minimum, or the insulator breaks down.

    Parameters
    ----------
    field : callable
        Magnitude of the field [V/m], any shape, in a gap of given width [m].
    insulator_permittivity, insulator_strength_v_per_m : float
        As for `bearable_field`.
    """
    gaps, borne = _weakest(insulator_permittivity, insulator_strength_v_per_m)
    narrow, wide = (field(gap) > most for gap, most in zip(gaps, borne, strict=True))
    return narrow | wide


def _weakest(permittivity: float, strength_v_per_m: float) -> tuple[tuple[float, ...], list[float]]:
    """Gaps [m] that break down first, and the fields [V/m] that they withstand."""
    gaps = (0.0, PASCHEN_MINIMUM_GAP_M)
    borne = bearable_field(torch.tensor(gaps, dtype=torch.float64), permittivity, strength_v_per_m)
    return gaps, borne.tolist()


def share_past(attraction: Tensor, field_at_edges: Tensor, bearable_at_edges: Tensor) -> Tensor:
    """Share of an attraction that comes from gaps whose field is above what they withstand.

    Parameters
    ----------
    attraction : Tensor, shape (..., bins)
        Attraction of the gaps in each bin, in any unit.
    field_at_edges, bearable_at_edges : Tensor, shape (..., bins + 1)
        Field [V/m], and the field that a gap withstands, at the bins' edges.
    """
    # A bin that the boundary crosses counts in part: its excess is taken as linear across the bin.
    excess = field_at_edges - bearable_at_edges
    low, high = excess[..., :-1], excess[..., 1:]
    span = (low.abs() + high.abs()).clamp(min=1e-300)
    part = (low.clamp(min=0) + high.clamp(min=0)) / span
    total = attraction.sum(-1)
    return (attraction * part).sum(-1) / total.clamp(min=1e-300)
