"""The critical-voltage formula: light contact, in which area and pull are proportional to p.

``I(p, h0) = Lambda(h0) p`` makes the equilibrium linear: ``p = p0 / (1 - (V0/Vc)^2)`` with
``Vc = 2 / sqrt(eps0 Lambda)`` (physics page, section 3). Lambda is taken from the mean field at one
pressure, so there is no table, and its slow fall with pressure is the error of this fidelity.
"""

from __future__ import annotations

from math import pi, sqrt

import torch
from torch import Tensor

from haptix.contact import ContactSpots, MeanField
from haptix.contact.gaps import GapHistogram
from haptix.equilibrium import LIGHT_CONTACT_LIMIT
from haptix.fidelity.balance import Balance, Load

_LEAST_SHARE = 1e-15  # of the area, as gaps of zero


class ClosedForm:
    """See the module.

    Parameters
    ----------
    contact : MeanField
        The contact.
    reference_pa : float
        Pressure at which Lambda and the mean gap are taken.
    contact_spots : {"excluded", "included"}
        Whether the pull inside the spots loads the contact.
    """

    def __init__(
        self, contact: MeanField, reference_pa: float, contact_spots: ContactSpots
    ) -> None:
        self._contact_spots = contact_spots
        self._reference_pa = reference_pa
        pressure = torch.tensor([1.0, 1.1], dtype=torch.float64, device=contact.device)
        pressure = reference_pa * pressure
        self._gaps: GapHistogram = contact.gap_histogram(pressure[:1])
        gap = contact.mean_gap(pressure)
        self._gap_m = gap[0]
        self._gap_fall_m = (gap[0] - gap[1]) / torch.log(pressure[1] / pressure[0])
        self._area_per_pa = 2 / sqrt(pi) * contact.area.light / contact.stress_rms_pa

    def prepare(self, applied_pa: Tensor, apparent_area_m2: Tensor) -> None:
        """Nothing: there is no table."""

    def solve(self, load: Load) -> Balance:
        """Return the equilibrium of every state on the lowest branch."""
        # In complete contact no gap is left; the least share keeps the voltage of its end finite.
        open_share = load.gap_pull @ self._gaps.mass[0] + _LEAST_SHARE * load.gap_pull.amax(-1)
        gap_pull = open_share / self._reference_pa
        spot_pull = self._area_per_pa * load.spot_pull
        loading = gap_pull + spot_pull if self._contact_spots == "included" else gap_pull
        share = load.strength * loading[load.column]
        end = 1 - 1 / LIGHT_CONTACT_LIMIT
        stable = share <= end
        pressure = load.applied_pa / (1 - share.clamp(max=end))
        pull = torch.minimum(load.strength, end / loading[load.column]) * pressure
        return Balance(
            pressure_pa=pressure,
            area_fraction=(self._area_per_pa * pressure).clamp(max=1.0),
            gap_attraction_pa=pull * gap_pull[load.column],
            spot_attraction_pa=pull * spot_pull[load.column],
            mean_gap_m=self._mean_gap(pressure),
            strength_at_end=end / loading[load.column],
            is_stable=stable,
        )

    def _mean_gap(self, pressure: Tensor) -> Tensor:
        """Logarithmic in p, as light contact has it."""
        fall = self._gap_fall_m * torch.log(pressure / self._reference_pa)
        return (self._gap_m - fall).clamp(min=0.0)
