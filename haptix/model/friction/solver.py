"""Solver of loads: from normal force and attraction to friction."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from math import pi
from typing import NamedTuple

import torch
from torch import Tensor

from haptix.base.threads import one_thread
from haptix.model.electro import Circuit, Pull
from haptix.model.electro.attraction import bin_inverse, drive_strength, representative_gaps
from haptix.model.electro.breakdown import bearable_field, share_past
from haptix.model.fidelity import Balance, Fidelity, Load
from haptix.model.states import GapSums
from haptix.model.status import LIMITS, Status, past_limits
from haptix.model.terms import ActiveTerms, FieldInGap, Stage

# Numbers of states that are computed together; they bound the memory.
BLOCK = 16384
_BLOCK_OF_COLUMNS = 4096  # where each state has a separate column in the table
_COLUMNS = 1024  # of a shared table in one block: more would not fit the CPU's cache
_BLOCK_OF_STATUS = 2048  # for the sum of `past_breakdown`: its arrays then fit the CPU's cache
_BLOCK_OF_SUMS = 1024  # for the sums over gaps


class _AtRest(NamedTuple):
    """States without attraction, each of shape (states,)."""

    area_m2: Tensor
    applied_pa: Tensor  # in the fidelity's unit
    widest_gap_m: Tensor | None

    def part(self, at: slice | Tensor) -> _AtRest:
        widest = self.widest_gap_m
        return _AtRest(
            self.area_m2[at], self.applied_pa[at], None if widest is None else widest[at]
        )


class FrictionSolver:
    """Solves flat batches of states, with the `terms` that are on and a `fidelity`."""

    def __init__(self, terms: ActiveTerms, fidelity: Fidelity) -> None:
        self.terms = terms
        self.fidelity = fidelity

    def solve(self, normal_force_n: Tensor, pull: Pull) -> tuple[Tensor, Balance]:
        """Return mu and the equilibrium of each state, for normal forces [N] and attractions."""
        return self._solve(self.load(normal_force_n, pull))

    def _solve(self, load: Load) -> tuple[Tensor, Balance]:
        shear, balance = self.terms.shear_stress_pa(), self.fidelity.solve(load)
        pressure = load.applied_pa * self.terms.properties.unit_pa
        return shear * balance.area_fraction / pressure, balance

    def spot_pressure_pa(self, mu: Tensor, balance: Balance) -> Tensor:
        """Mean pressure [Pa] in the contact spots: the load's ``tau_f/mu`` plus the attraction."""
        unit_pa = self.terms.properties.unit_pa
        pull = unit_pa * (balance.gap_attraction_pa + balance.spot_attraction_pa)
        return self.terms.shear_stress_pa() / mu + pull / balance.area_fraction

    def status(self, mu: Tensor, balance: Balance, field: FieldInGap) -> Tensor:
        """`haptix.Status` of states; `past_breakdown` then finds those that break down."""
        status = self.terms.status(balance.is_stable, field)
        return past_limits(status, mu, self.spot_pressure_pa(mu, balance))

    @one_thread()
    @torch.no_grad()
    def past_breakdown(
        self,
        states: Tensor,
        normal_force_n: Tensor,
        voltage_v: Tensor,
        circuit: Circuit,
        pull_of: Callable[[Tensor, Circuit], Pull],
        balance: Balance,
    ) -> Tensor:
        """Return those of the `states` whose attraction is past the limit of `Status.BREAKDOWN`.

        Other parameters are those of `sum_gaps`. With the term that models discharge, no state
        exceeds that limit.
        """
        gaps, most = balance.gap_attraction_pa, LIMITS[Status.BREAKDOWN].most
        allowed = most * (gaps + balance.spot_attraction_pa)
        states = states[gaps[states] > allowed[states]]
        if not len(states) or Stage.PULL in self.terms.stages:
            return states[:0]
        edges, screen = self.fidelity.contact.field.gap_edges_m, self.terms.properties.screen
        bearable = bearable_field(
            representative_gaps(edges)[:-1],
            screen.insulator_permittivity,
            screen.insulator_strength_v_per_m,
        )
        most_pa, past = drive_strength(bearable), []
        for at in states.split(_BLOCK_OF_STATUS):
            at_rest = self._at_rest(normal_force_n[at])
            mass = self.fidelity.gap_mass(
                at_rest.applied_pa, at_rest.widest_gap_m, balance.pressure_pa[at]
            )
            pull = pull_of(voltage_v[at], circuit.part(at))
            attraction = pull.strength[:, None] * pull.kernel[pull.own_column][:, 0]
            broken = torch.where(attraction > most_pa, attraction, 0.0)
            # A share, since a theory may lift the gaps beside spots: they attract less than here.
            share = torch.linalg.vecdot(broken, mass) / torch.linalg.vecdot(attraction, mass)
            past.append(at[share * gaps[at] > allowed[at]])
        return torch.cat(past)

    def load(self, normal_force_n: Tensor, pull: Pull) -> Load:
        """Return the load of these states, as the fidelity takes it."""
        return self._load(pull, self._at_rest(normal_force_n))

    def _load(self, pull: Pull, at_rest: _AtRest, of_end: bool = False) -> Load:
        if not of_end:
            pull = replace(pull, strength=pull.strength / self.terms.properties.unit_pa)
        load = Load(at_rest.applied_pa, pull, at_rest.widest_gap_m, of_end=of_end)
        if Stage.SUPPLY not in self.terms.stages:
            return load
        return replace(load, area_m2=at_rest.area_m2, voltage_share=self.terms.voltage_share)

    def solve_in_blocks(
        self,
        normal_force_n: Tensor,
        pull_of: Callable[[slice | Tensor], Pull],
        column: Tensor | None = None,
        of_end: bool = False,
    ) -> tuple[Tensor, Balance]:
        """Solve many states block by block; `pull_of` gives the `Pull` of a block.

        States are sorted by `column`, so that each block has few columns. With `of_end` a pull's
        strength is a share of the one at which light contact ends.
        """
        # One table for all forces: a table that grows block by block would be solved many times.
        at_rest = self._at_rest(normal_force_n)
        self.fidelity.prepare(at_rest.applied_pa, at_rest.widest_gap_m)
        has_columns = pull_of(slice(0, 1)).column is None
        has_columns = has_columns or not {Stage.PULL, Stage.SUPPLY}.isdisjoint(self.terms.stages)
        block = _BLOCK_OF_COLUMNS if has_columns else BLOCK
        states = len(normal_force_n)
        if column is not None:  # as many states as have these columns, on average
            block = min(block, max(1, states // (int(column.max()) + 1)) * _COLUMNS)
        blocks: Sequence[slice | Tensor] = [slice(i, i + block) for i in range(0, states, block)]
        back: slice | Tensor = slice(None)
        if column is not None and states > block:
            order = column.argsort(stable=True)
            blocks, back = order.split(block), torch.empty_like(order)
            back[order] = torch.arange(states, device=order.device)
        try:
            solved = [
                self._solve(self._load(pull_of(at), at_rest.part(at), of_end)) for at in blocks
            ]
        finally:
            self.fidelity.release()
        mu, balances = zip(*solved, strict=True)
        return torch.cat(mu)[back], Balance.joined(balances, lambda parts: torch.cat(parts)[back])

    def prepare(self, normal_force_n: Tensor) -> None:
        """Make the tables that all states of these normal forces [N] share."""
        at_rest = self._at_rest(normal_force_n)
        self.fidelity.prepare(at_rest.applied_pa, at_rest.widest_gap_m)

    @one_thread()
    def sum_gaps(
        self,
        normal_force_n: Tensor,
        voltage_v: Tensor,
        frequency_hz: Tensor | None,
        circuit: Circuit,
        pull_of: Callable[[Tensor, Circuit], Pull],
        balance: Balance,
        like: Tensor,
    ) -> GapSums:
        """Sum over the gaps of solved states; it is separate because most callers do not need it.

        Parameters
        ----------
        normal_force_n, voltage_v, frequency_hz : Tensor, shape (states,)
            Normal force [N], amplitude on the contact [V], and frequency [Hz] or None.
        circuit, balance : Circuit, Balance
            Circuit and equilibrium of all states.
        pull_of : callable
            Gives the attraction of states from amplitudes [V] and their part of the circuit.
        like : Tensor
            A tensor of the shape and precision of the results.
        """
        edges, screen = self.fidelity.contact.field.gap_edges_m, self.terms.properties.screen
        bearable = bearable_field(
            edges, screen.insulator_permittivity, screen.insulator_strength_v_per_m
        )
        shares, capacitances = [], []
        self.prepare(normal_force_n)
        try:
            states = torch.arange(len(normal_force_n), device=edges.device)
            for at in states.split(_BLOCK_OF_SUMS):
                at_rest = self._at_rest(normal_force_n[at])
                mass = self.fidelity.gap_mass(
                    at_rest.applied_pa, at_rest.widest_gap_m, balance.pressure_pa[at]
                )
                part, volts = circuit.part(at), voltage_v[at]
                thickness = part.thickness_m[part.column]
                pull = pull_of(volts, part)
                pull = pull.held(pull.strength)
                field = volts[:, None] / (edges + thickness[:, None]).abs()
                attraction = mass * pull.kernel[pull.own_column][:, 0]
                shares.append(share_past(attraction, field, bearable))
                gaps = (mass * bin_inverse(edges, thickness)).sum(-1)
                capacitances.append(
                    part.capacitance_f(gaps, balance.area_fraction[at], at_rest.area_m2)
                )
        finally:
            self.fidelity.release()
        capacitance = torch.cat(capacitances) + 0j
        angular = torch.zeros_like(voltage_v) if frequency_hz is None else 2 * pi * frequency_hz
        current = angular * voltage_v * capacitance.abs()
        share, farads, siemens, amperes = (
            value.to(like.dtype).reshape(like.shape)
            for value in (torch.cat(shares), capacitance.real, angular * capacitance.imag, current)
        )
        return GapSums(share, farads, siemens, None if frequency_hz is None else amperes)

    def _at_rest(self, normal_force_n: Tensor) -> _AtRest:
        area = self.terms.apparent_area_m2(normal_force_n)
        widest = self.terms.widest_gap_m(area, self.fidelity.contact.field)
        return _AtRest(area, normal_force_n / area / self.terms.properties.unit_pa, widest)
