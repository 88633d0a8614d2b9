"""The critical-voltage formula: light contact, in which area and attraction are proportional to p.

``I(p, h0) = Lambda(h0) p`` makes the equilibrium linear: ``p = p0 / (1 - (V0/Vc)^2)`` with
``Vc = 2 / sqrt(eps0 Lambda)`` (physics page, section 3). Lambda is taken from the mean field at one
pressure, so there is no table, and its slow fall with pressure is the error of this fidelity.
"""

from __future__ import annotations

from math import pi, sqrt

import torch
from torch import Tensor

from haptix.equilibrium import LIGHT_CONTACT_LIMIT
from haptix.fidelity.balance import Ability, Balance, Contact, Fidelity, Load
from haptix.terms import Stage


class ClosedForm(Fidelity):
    """Equilibria by the critical-voltage formula, without a table."""

    name = "closed-form"
    assumes = "assumes light elastic contact of infinite size, attracted in proportion to its load"
    honours = frozenset(Stage) - {Stage.GAPS, Stage.HARDNESS, Stage.PULL, Stage.SUPPLY}
    can = frozenset({Ability.TABULATE, Ability.INSTANTS})

    def __init__(self, contact: Contact) -> None:
        super().__init__(contact)
        field = contact.field
        pressure = torch.tensor([1.0, 1.1], dtype=torch.float64, device=field.device)
        pressure = contact.reference_pa * pressure
        self._mass = field.gap_histogram(pressure[:1]).mass
        gap = field.mean_gap(pressure)
        self._gap_m = gap[0]
        self._gap_fall_m = (gap[0] - gap[1]) / torch.log(pressure[1] / pressure[0])
        # Light contact, even where the reference pressure would close it: erf t = 2 t / sqrt(pi).
        light = 2 / sqrt(pi) * field.area.light
        self._area_per_pa = light * field.relative_pressure(pressure[0]) / pressure[0]

    def gap_mass(
        self, applied_pa: Tensor, widest_gap_m: Tensor | None, pressure_pa: Tensor
    ) -> Tensor:
        """Return the masses at the reference pressure: light contact keeps their proportions."""
        return self._mass.expand(len(pressure_pa), -1)

    def solve(self, load: Load) -> Balance:
        """Return the equilibrium of every state on the lowest branch."""
        column, strength = load.pull.own_column, load.pull.strength
        gap_pull = load.pull.on_gaps(self._mass)[0] / self.contact.reference_pa
        spot_pull = self._area_per_pa * load.pull.on_spots()
        counts = self.contact.contact_spots == "included"
        loading = (gap_pull + spot_pull if counts else gap_pull)[column]
        end = 1 - 1 / LIGHT_CONTACT_LIMIT
        share = strength * loading
        pressure = load.applied_pa / (1 - share.clamp(max=end))
        attraction = torch.minimum(strength, end / loading) * pressure
        # Logarithmic in p, as light contact has it.
        fall = self._gap_fall_m * torch.log(pressure / self.contact.reference_pa)
        return Balance(
            pressure_pa=pressure,
            area_fraction=(self._area_per_pa * pressure).clamp(max=1.0),
            gap_attraction_pa=attraction * gap_pull[column],
            spot_attraction_pa=attraction * spot_pull[column],
            mean_gap_m=(self._gap_m - fall).clamp(min=0.0),
            strength_at_end=end / loading,
            is_stable=share <= end,
            voltage_share=torch.ones_like(pressure),
        )
