"""Electrical breakdown of the gap and of the insulator."""

from __future__ import annotations

from torch import Tensor

NARROW_GAP_FIELD_V_PER_M = 350e6
"""What gaps under 1 um bear (physics page, section 3)."""

PASCHEN_MINIMUM_V = 327.0
PASCHEN_MINIMUM_GAP_M = 7.5e-6
"""Lowest voltage that breaks air down, and the gap at which it does."""


def peak_field(voltage_v: Tensor, thickness_m: Tensor) -> Tensor:
    """``V0 / |h0|`` [V/m], the field at the edge of a contact spot, the highest in any gap."""
    return voltage_v / thickness_m.abs()


def breaks_down(
    voltage_v: Tensor,
    thickness_m: Tensor,
    insulator_permittivity: float,
    insulator_strength_v_per_m: float,
) -> Tensor:
    """Whether a narrow gap, a gap at Paschen's minimum, or the insulator is beyond its limit.

    Parameters
    ----------
    voltage_v, thickness_m : Tensor
        Amplitude [V] and effective thickness h0 [m], real or complex; they broadcast.
    insulator_permittivity, insulator_strength_v_per_m : float
        eps1, and the field that the insulator bears [V/m].
    """
    field = peak_field(voltage_v, thickness_m)
    across = voltage_v * PASCHEN_MINIMUM_GAP_M / (PASCHEN_MINIMUM_GAP_M + thickness_m).abs()
    return (
        (field > NARROW_GAP_FIELD_V_PER_M)
        | (across > PASCHEN_MINIMUM_V)
        | (field / insulator_permittivity > insulator_strength_v_per_m)
    )
