"""The mean field in full: tables of gaps against pressure, and the equilibrium on them."""

from __future__ import annotations

import torch
from torch import Tensor

from haptix.contact.finite_size import touching_log_pressure
from haptix.electro import AttractionTable
from haptix.equilibrium import LIGHT_CONTACT_LIMIT, lowest_branch
from haptix.fidelity.balance import Ability, Balance, Contact, Fidelity, Load
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
        self._touching: tuple[tuple[float, float], tuple[float, float]] | None = None

    def borrow(self, other: Fidelity) -> bool:
        """Use what another has tabulated, where its mean field is equal to this one's.

        Area fraction, finite size and contact spots may differ: the table does not depend on them.
        """
        if not isinstance(other, MeanFieldBalance) or other._kept is None:
            return False
        if not self.contact.field.equals(other.contact.field):
            return False
        self._kept, self._touching = other._kept, other._touching
        return True

    def prepare(self, applied_pa: Tensor, widest_gap_m: Tensor | None) -> None:
        """Solve the table for all of these loads."""
        table = self._table(applied_pa, widest_gap_m)
        if not self._keeps_table:
            self._kept = table  # until `release`: one table for all blocks, not one for each

    def release(self) -> None:
        """Drop a table that autograd records."""
        if not self._keeps_table:
            self._kept = None

    def solve(self, load: Load) -> Balance:
        """Return the equilibrium of every state on the lowest branch."""
        widest, pull = load.widest_gap_m, load.pull
        table = self._table(load.applied_pa, widest)
        floor = None
        if widest is not None:
            floor = touching_log_pressure(table.log_mean_gap, torch.log(widest))
        counts = self.contact.contact_spots == "included"
        attraction = table.attraction(pull, self.contact.area_fraction if counts else None, floor)
        found = lowest_branch(load.applied_pa, pull.strength, attraction)
        pressure = found.pressure_pa
        area = self.contact.area_fraction(pressure)
        log_pressure = torch.log(pressure)
        mean_gap = torch.exp(table.log_mean_gap(log_pressure))
        # Past its end a state has the values of the end, and so its voltage too.
        strength = torch.minimum(pull.strength, found.strength_at_end)
        return Balance(
            pressure_pa=pressure,
            area_fraction=area,
            gap_attraction_pa=strength * attraction.gaps(log_pressure),
            spot_attraction_pa=strength * area * pull.on_spots()[pull.own_column],
            mean_gap_m=mean_gap if widest is None else torch.minimum(mean_gap, widest),
            strength_at_end=found.strength_at_end,
            is_stable=found.is_stable,
        )

    def _table(self, applied_pa: Tensor, widest_gap_m: Tensor | None) -> AttractionTable:
        """Table that covers these loads up to the end of light contact."""
        low, high = map(float, applied_pa.detach().aminmax())
        if widest_gap_m is not None:
            touching = self._touching_pressures(*map(float, widest_gap_m.detach().aminmax()))
            low, high = min(low, *touching), max(high, *touching)
        high *= LIGHT_CONTACT_LIMIT
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

    def _touching_pressures(self, low_m: float, high_m: float) -> tuple[float, float]:
        """Pressures that enclose those at which the mean gap equals heights from low to high."""
        if self._touching is not None:
            (known_low, known_high), pressures = self._touching
            if known_low <= low_m and high_m <= known_high:
                return pressures
        scale = torch.log(self.contact.field.stress_rms_pa.detach())
        heights = scale.new_tensor([high_m, low_m])
        low, high = scale.expand_as(heights) - 40.0, scale.expand_as(heights) + 1.0
        with torch.no_grad():
            for _ in range(12):  # to some per cent: only to size the table
                middle = (low + high) / 2
                is_wider = self.contact.field.mean_gap(torch.exp(middle)) > heights
                low = torch.where(is_wider, middle, low)
                high = torch.where(is_wider, high, middle)
        of_high, of_low = torch.exp(low).tolist()
        if self._keeps_table:
            self._touching = (low_m, high_m), (of_high, of_low)
        return of_high, of_low
