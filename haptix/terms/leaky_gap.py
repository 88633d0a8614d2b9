"""Leaky gap: moisture between skin and screen conducts."""

import torch
from torch import Tensor

from haptix.electro import VACUUM_PERMITTIVITY
from haptix.terms.term import PNAS_2018, Properties, Term


class LeakyGap(Term):
    """The gap conducts: ``eps_g = 1 + i/(w eps0 rho_g)`` multiplies h0.

    By continuity of the current ``E_gap = V / (u + eps_g h0)``.
    """

    name = "leaky-gap"
    summary = "the gap conducts: eps_g = 1 + i/(w eps0 rho_g) multiplies h0"
    source = f"{PNAS_2018}, Fig. 4; physics page, section 3"
    uses = ("screen.gap_resistivity_ohm_m",)
    needs_frequency = True

    def insulators(self, h0_m: Tensor, frequency_hz: Tensor, given: Properties) -> Tensor:
        return h0_m * self.gap_permittivity(frequency_hz, given)

    def gap_permittivity(self, frequency_hz: Tensor, given: Properties) -> Tensor:
        resistivity = given.screen.gap_resistivity_ohm_m
        assert resistivity is not None  # the term is not possible without
        leak = 1 / (2 * torch.pi * frequency_hz * VACUUM_PERMITTIVITY * resistivity)
        return torch.complex(torch.ones_like(leak), leak)
