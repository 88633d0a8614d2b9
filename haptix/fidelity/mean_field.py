"""The mean field in full: tables of gaps against pressure, and the equilibrium on them."""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor

from haptix.contact import ContactSpots, MeanField
from haptix.contact.finite_size import touching_log_pressure
from haptix.electro import AreaFraction, Attraction, AttractionTable
from haptix.equilibrium import LIGHT_CONTACT_LIMIT, lowest_branch
from haptix.fidelity.balance import Balance, Load

Height = Callable[[Tensor], Tensor]


class MeanFieldBalance:
    """Equilibria from tables that are solved once and grown when a load lies beyond them.

    Parameters
    ----------
    contact : MeanField
        The contact.
    area_fraction : callable
        A/A0 at pressures [Pa]: elastic, or elastoplastic.
    highest_asperity_m : callable or None
        Largest possible mean gap [m] at apparent areas [m^2]; None for infinite size.
    contact_spots : {"excluded", "included"}
        Whether the pull inside the spots loads the contact.
    keeps_table : bool
        False where the table belongs to one autograd graph and must not outlive it.
    """

    def __init__(
        self,
        contact: MeanField,
        area_fraction: AreaFraction,
        highest_asperity_m: Height | None,
        contact_spots: ContactSpots,
        keeps_table: bool = True,
    ) -> None:
        self._contact = contact
        self._area_fraction = area_fraction
        self._highest_asperity_m = highest_asperity_m
        self._contact_spots = contact_spots
        self._keeps_table = keeps_table
        self._kept: AttractionTable | None = None
        self._touching: tuple[tuple[float, float], tuple[float, float]] | None = None

    def share_table(self, other: MeanFieldBalance) -> None:
        """Use what another has tabulated, whose contact must be equal to this one's.

        The area fraction, finite size and contact spots may differ: the table has none of them.
        """
        self._kept, self._touching = other._kept, other._touching

    def prepare(self, applied_pa: Tensor, apparent_area_m2: Tensor) -> None:
        """Solve the table for all of these loads, where it is kept."""
        if self._keeps_table:
            self.table(applied_pa, apparent_area_m2)

    def solve(self, load: Load) -> Balance:
        """Return the equilibrium of every state on the lowest branch."""
        table = self.table(load.applied_pa, load.apparent_area_m2)
        floor, height = self._finite_size(table, load.apparent_area_m2)
        spots = self._area_fraction if self._contact_spots == "included" else None
        attraction = Attraction(
            table.log_pull(load.gap_pull), load.column, load.spot_pull, spots, floor
        )
        found = lowest_branch(load.applied_pa, load.strength, attraction)
        pressure = found.pressure_pa
        area = self._area_fraction(pressure)
        log_pressure = torch.log(pressure)
        mean_gap = torch.exp(table.log_mean_gap(log_pressure))
        # Past its end a state has the values of the end, and so its voltage too.
        strength = torch.minimum(load.strength, found.strength_at_end)
        return Balance(
            pressure_pa=pressure,
            area_fraction=area,
            gap_attraction_pa=strength * attraction.gaps(log_pressure),
            spot_attraction_pa=strength * area * load.spot_pull[load.column],
            mean_gap_m=mean_gap if height is None else torch.minimum(mean_gap, height),
            strength_at_end=found.strength_at_end,
            is_stable=found.is_stable,
        )

    def table(self, applied_pa: Tensor, apparent_area_m2: Tensor) -> AttractionTable:
        """Table that covers these loads up to the end of light contact."""
        low, high = float(applied_pa.detach().min()), float(applied_pa.detach().max())
        if self._highest_asperity_m is not None:
            heights = self._highest_asperity_m(torch.stack(apparent_area_m2.detach().aminmax()))
            touching = self._touching_pressures(*map(float, heights.detach()))
            low, high = min(low, *touching), max(high, *touching)
        high *= LIGHT_CONTACT_LIMIT
        if self._kept is not None:
            if self._kept.covers(low, high):
                return self._kept
            nodes = self._kept.log_pressure.exp()
            low, high = min(low, float(nodes[0])), max(high, float(nodes[-1]))
        table = AttractionTable.solve(self._contact, low, high)
        if self._keeps_table:
            self._kept = table
        return table

    def _finite_size(
        self, table: AttractionTable, apparent_area_m2: Tensor
    ) -> tuple[Tensor | None, Tensor | None]:
        if self._highest_asperity_m is None:
            return None, None
        height = self._highest_asperity_m(apparent_area_m2)
        return touching_log_pressure(table.log_mean_gap, torch.log(height)), height

    def _touching_pressures(self, low_m: float, high_m: float) -> tuple[float, float]:
        """Pressures that enclose those at which the mean gap equals heights from low to high."""
        if self._touching is not None:
            (known_low, known_high), pressures = self._touching
            if known_low <= low_m and high_m <= known_high:
                return pressures
        heights = self._contact.stress_rms_pa.detach().new_tensor([high_m, low_m])
        of_high, of_low = self._touching_pressure(heights).tolist()
        if self._keeps_table:
            self._touching = (low_m, high_m), (of_high, of_low)
        return of_high, of_low

    def _touching_pressure(self, height_m: Tensor) -> Tensor:
        """Where the mean gap equals heights, to some per cent: only to size the table."""
        scale = torch.log(self._contact.stress_rms_pa.detach())
        low, high = scale.expand_as(height_m) - 40.0, scale.expand_as(height_m) + 1.0
        with torch.no_grad():
            for _ in range(12):
                middle = (low + high) / 2
                is_wider = self._contact.mean_gap(torch.exp(middle)) > height_m
                low = torch.where(is_wider, middle, low)
                high = torch.where(is_wider, high, middle)
        return torch.exp(low)
