"""Electrostatic attraction of the whole contact against pressure, tabulated once per solid."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, exp, floor, log

import torch
from torch import Tensor

from haptix.contact import ContactSpots, MeanField
from haptix.contact.gaps import GapHistogram, bin_inverse_square
from haptix.electro.dielectric import VACUUM_PERMITTIVITY
from haptix.interpolation import UniformCubic

# ln p steps of one lattice for all tables, so that a node's place, and with it every result, does
# not depend on which pressures were asked for. 24 a decade: the cubic is within 1e-6 of the solver.
_STEP = log(10) / 24
_MARGIN = 3  # nodes beyond the ends, so that every slope in use has its full stencil
_TINY = 1e-300
_FLOOR = 1e-9


def drive_strength(voltage_v: Tensor) -> Tensor:
    """``eps0 V0^2 / 4`` [N]: times ``<1/|u + h0|^2>`` it is the time-averaged pull (Eq. 1)."""
    return VACUUM_PERMITTIVITY / 4 * voltage_v**2


def drive_voltage(strength: Tensor) -> Tensor:
    """Invert `drive_strength`: amplitude V0 [V]."""
    return (4 / VACUUM_PERMITTIVITY * strength).sqrt()


@dataclass(frozen=True)
class AttractionTable:
    """Gap distributions and mean gaps at pressures on a logarithmic lattice.

    Parameters
    ----------
    contact : MeanField
        The contact that was solved.
    log_pressure : Tensor, shape (nodes,)
        ln p [Pa] of the nodes.
    gaps : GapHistogram, batch (nodes,)
        Gap distribution at each node.
    log_mean_gap : UniformCubic
        ln of the mean gap [m] against ln p.
    """

    contact: MeanField
    log_pressure: Tensor
    gaps: GapHistogram
    log_mean_gap: UniformCubic

    @classmethod
    def solve(cls, contact: MeanField, lowest_pa: float, highest_pa: float) -> AttractionTable:
        """Tabulate from `lowest_pa` to `highest_pa`."""
        first = floor(log(lowest_pa) / _STEP) - _MARGIN
        last = ceil(log(highest_pa) / _STEP) + _MARGIN
        nodes = torch.arange(first, last + 1, dtype=torch.float64, device=contact.device)
        log_pressure = nodes * _STEP
        pressure = torch.exp(log_pressure)
        mean_gap = torch.log(contact.mean_gap(pressure).clamp(min=_TINY))
        return cls(
            contact,
            log_pressure,
            contact.gap_histogram(pressure),
            UniformCubic.through(float(log_pressure[0]), _STEP, mean_gap),
        )

    def covers(self, lowest_pa: float, highest_pa: float) -> bool:
        """Whether every slope between these pressures has its full stencil."""
        low = exp(float(self.log_pressure[_MARGIN]))
        high = exp(float(self.log_pressure[-1 - _MARGIN]))
        return low <= lowest_pa and highest_pa <= high

    def log_inverse_square(self, h0_m: Tensor, contact_spots: ContactSpots) -> UniformCubic:
        """Ln I(p, h0) against ln p, one column for each of `h0_m` (1-D, real or complex)."""
        inverse_square = self.gaps.mass @ bin_inverse_square(self.gaps.edges_m, h0_m).T
        if contact_spots == "included":
            area = self.contact.area_fraction(torch.exp(self.log_pressure))
            inverse_square = inverse_square + area[:, None] / h0_m.abs() ** 2
        # In complete contact no gap is left to pull; a share of the peak keeps ln I smooth.
        floor = _FLOOR * inverse_square.amax(0)
        log_table = torch.log(inverse_square + floor)
        return UniformCubic.through(float(self.log_pressure[0]), _STEP, log_table)
