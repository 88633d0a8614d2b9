"""The mean field in full: tables of gaps against pressure, and the equilibrium on them."""

from __future__ import annotations

from math import log

import torch
from torch import Tensor

from haptix.contact.finite_size import Touching
from haptix.electro import Attraction, AttractionTable
from haptix.equilibrium import LIGHT_CONTACT_LIMIT, end_of_voltage, lowest_branch
from haptix.fidelity.balance import Ability, Balance, Contact, Fidelity, Load
from haptix.interpolation import UniformCubic
from haptix.terms import Stage


class MeanFieldBalance(Fidelity):
    """Equilibria from tables that are solved once and extended when a load lies beyond them."""

    name = "mean-field"
    assumes = "averages the attraction over the contact"
    honours = frozenset(Stage)
    can = frozenset({Ability.TABULATE, Ability.INSTANTS, Ability.RESCALE})

    def __init__(self, contact: Contact) -> None:
        super().__init__(contact)
        # A table belongs to one autograd graph, and must not outlive it.
        self._keeps_table = not contact.field.stress_variance.requires_grad
        self._kept: AttractionTable | None = None
        self._log_mean_gap: UniformCubic | None = None
        self._touching: tuple[Tensor, Touching] | None = None

    def borrow(self, other: Fidelity) -> bool:
        """Use what another has tabulated, where its mean field is equal to this one's.

        Area fraction, finite size and contact spots may differ: the table does not depend on them.
        """
        if not isinstance(other, MeanFieldBalance) or other._kept is None:
            return False
        if not self.contact.field.equals(other.contact.field):
            return False
        self._kept, self._log_mean_gap = other._kept, other._log_mean_gap
        return True

    def prepare(self, applied_pa: Tensor, widest_gap_m: Tensor | None) -> None:
        """Solve the table for all of these loads."""
        if not self._keeps_table and widest_gap_m is not None:
            self._log_mean_gap = self.contact.field.log_mean_gap()
        table = self._table(applied_pa, self._touching_of(widest_gap_m))
        if not self._keeps_table:
            self._kept = table  # until `release`: one table for all blocks, not one for each

    def release(self) -> None:
        """Drop a table that autograd records."""
        if not self._keeps_table:
            self._kept, self._log_mean_gap = None, None

    def solve(self, load: Load) -> Balance:
        """Return the equilibrium of every state on the lowest branch."""
        pull, touching = load.pull, self._touching_of(load.widest_gap_m)
        table = self._table(load.applied_pa, touching)
        counts = self.contact.contact_spots == "included"
        area_fraction = self.contact.area_fraction
        supply = None
        if load.voltage_share is not None:
            assert pull.circuit is not None and load.area_m2 is not None  # the solver sees to it
            supply = table.supply(
                pull.circuit, load.area_m2, load.voltage_share, area_fraction, touching
            )
        spots = area_fraction if counts else None
        # Gaps are held by the voltage that the contact has at rest, the largest share of all.
        rest = table.at(supply, load.applied_pa)

        def at(strength: Tensor) -> Attraction:
            return table.attraction(pull.held(strength * rest), spots, touching, supply)

        attraction = at(pull.strength)
        found = lowest_branch(load.applied_pa, pull.strength, attraction)
        end = found.strength_at_end
        if pull.most_pa is not None:
            end = end_of_voltage(load.applied_pa, at)
        pressure = found.pressure_pa
        area = area_fraction(pressure)
        log_pressure = torch.log(pressure)
        of_gap = log_pressure if touching is None else touching.of_gap(log_pressure)
        # Past its end a state has the values of the end, and so its voltage too.
        strength = torch.minimum(pull.strength, found.strength_at_end)
        left = attraction.supply(log_pressure)
        return Balance(
            pressure_pa=pressure,
            area_fraction=area,
            gap_attraction_pa=strength * attraction.gaps(log_pressure),
            spot_attraction_pa=strength * left * area * pull.on_spots()[pull.own_column],
            mean_gap_m=torch.exp(table.log_mean_gap(of_gap)),
            strength_at_end=end,
            is_stable=found.is_stable,
            voltage_share=left.sqrt(),
        )

    def gap_mass(
        self, applied_pa: Tensor, widest_gap_m: Tensor | None, pressure_pa: Tensor
    ) -> Tensor:
        """Return the masses that the table holds at the pressures of solved states.

        With finite size those that attract.
        """
        touching, log_pressure = self._touching_of(widest_gap_m), torch.log(pressure_pa)
        table = self._table(applied_pa, touching)
        return table.mass_at(
            log_pressure if touching is None else touching.of_pull(log_pressure)[0]
        )

    def _table(self, applied_pa: Tensor, touching: Touching | None) -> AttractionTable:
        """Table that covers these loads up to the end of light contact."""
        low, high = map(float, applied_pa.detach().aminmax())
        high *= LIGHT_CONTACT_LIMIT
        if touching is not None:
            with torch.no_grad():
                light = touching.of_gap(torch.log(applied_pa)) + log(LIGHT_CONTACT_LIMIT)
                high = max(high, float(torch.exp(touching.of_gap(light).max())))
        if self._kept is not None:
            if self._kept.covers(low, high):
                # A part would leave out the stencil through which gradients pass.
                return self._kept.part(low, high) if self._keeps_table else self._kept
            nodes = self._kept.log_pressure.exp()
            low, high = min(low, float(nodes[0])), max(high, float(nodes[-1]))
        table = AttractionTable.solve(self.contact.field, low, high)
        if self._keeps_table:
            self._kept = table
        return table

    def _touching_of(self, widest_gap_m: Tensor | None) -> Touching | None:
        """Finite size of states with these heights of the highest asperity."""
        if widest_gap_m is None:
            return None
        # `prepare` and `solve` ask for the same states; autograd needs each for itself.
        keeps = self._keeps_table and not widest_gap_m.requires_grad
        if keeps and self._touching and torch.equal(self._touching[0], widest_gap_m):
            return self._touching[1]
        table = self._log_mean_gap
        if table is None:
            table = self.contact.field.log_mean_gap()
            if self._keeps_table:
                self._log_mean_gap = table
        touching = self.contact.field.touching(widest_gap_m, table)
        if keeps:
            self._touching = widest_gap_m, touching
        return touching
