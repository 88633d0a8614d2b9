"""The contact as a part of a circuit: its capacitance and conductance, from the gaps.

Each gap is in series with the insulators, and all gaps and spots are side by side (physics page,
section 3): ``C = eps0 A0 eps_g <1/(u + h0)>``. Where an insulator or a gap conducts, C is complex:
with ``exp(-i w t)`` the admittance is ``-i w C``, so that the conductance is ``w Im C``.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from haptix.electro.dielectric import VACUUM_PERMITTIVITY


def bin_inverse(gap_edges_m: Tensor, thickness_m: Tensor) -> Tensor:
    """Mean of ``1/(u + h0)`` [1/m] over each bin, shape ``thickness_m.shape + (bins,)``.

    The two first terms about the bin's middle: bins are 4 % wide, which leaves out 1e-7.
    """
    middle, width = (gap_edges_m[:-1] + gap_edges_m[1:]) / 2, gap_edges_m.diff()
    inverse = 1 / (middle + thickness_m[..., None])
    return inverse * (1 + (width * inverse) ** 2 / 12)


@dataclass(frozen=True)
class Circuit:
    """Insulators and gaps of states, at one frequency each, as parts of a circuit."""

    thickness_m: Tensor
    """h0 [m], real or complex, shape (columns,)."""
    medium: Tensor
    """eps_g of what fills the gap, shape (columns,); over the unit of length, where that is not
    1 m."""
    column: Tensor
    """The column of each state, shape (states,)."""

    @classmethod
    def of_one(cls, thickness_m: Tensor, medium: Tensor, states: int) -> Circuit:
        """Return the circuit of states that have one column."""
        column = torch.zeros(states, dtype=torch.long, device=thickness_m.device)
        return cls(thickness_m.reshape(1), medium.reshape(1), column)

    def part(self, at: slice | Tensor) -> Circuit:
        """Return some of the states."""
        return replace(self, column=self.column[at])

    def capacitance_f(self, gaps: Tensor, area_fraction: Tensor, area_m2: Tensor) -> Tensor:
        """Complex capacitance [F] of each state's contact, from its mean of ``1/(u + h0)`` [1/m].

        Shapes broadcast with (states,): the gaps' mean, A/A0 of the spots and A0 [m^2].
        """
        own = self.thickness_m[self.column]
        return (
            VACUUM_PERMITTIVITY * self.medium[self.column] * area_m2 * (gaps + area_fraction / own)
        )
