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


def breakdown_voltage(
    thickness_m: Tensor, insulator_permittivity: float, insulator_strength_v_per_m: float
) -> Tensor:
    """Amplitude [V] at which a narrow gap, one at Paschen's minimum, or the insulator breaks down.

    Parameters
    ----------
    thickness_m : Tensor
        Effective thickness h0 [m], real or complex, any shape.
    insulator_permittivity, insulator_strength_v_per_m : float
        eps1, and the field that the insulator withstands [V/m].
    """
    narrow = _bearable_field(insulator_permittivity, insulator_strength_v_per_m) * thickness_m.abs()
    # The share of the voltage that falls over such a gap is u / |u + h0|.
    wide = (PASCHEN_MINIMUM_GAP_M + thickness_m).abs() / PASCHEN_MINIMUM_GAP_M * PASCHEN_MINIMUM_V
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
        As for `breakdown_voltage`.
    """
    bearable = _bearable_field(insulator_permittivity, insulator_strength_v_per_m)
    wide_v = field(PASCHEN_MINIMUM_GAP_M) * PASCHEN_MINIMUM_GAP_M
    return (field(0.0) > bearable) | (wide_v > PASCHEN_MINIMUM_V)


def _bearable_field(insulator_permittivity: float, insulator_strength_v_per_m: float) -> float:
    """Field [V/m] at a spot's edge up to which narrow gap and insulator both hold."""
    return min(NARROW_GAP_FIELD_V_PER_M, insulator_strength_v_per_m * insulator_permittivity)
