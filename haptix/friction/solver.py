"""Solver of loads: from normal force and attraction to friction."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from math import pi
from typing import NamedTuple

import torch
from torch import Tensor

from haptix.electro import Circuit, Pull
from haptix.electro.attraction import bin_inverse, drive_strength, representative_gaps
from haptix.electro.breakdown import bearable_field, share_past
from haptix.fidelity import Balance, Fidelity, Load
from haptix.limits import LIMITS, past_limits
from haptix.states import GapSums
from haptix.status import Status
from haptix.terms import ActiveTerms, FieldInGap, Stage
from haptix.threads import one_thread

BLOCK = 16384  # states solved together: bounds the memory
_BLOCK_OF_OWN = 4096  # the same where each state has a column of its own in the table
_BLOCK_OF_STATUS = 2048  # the same for one sum, which the cache then holds
_BLOCK_OF_SUMS = 1024  # states whose gaps are summed together: bounds the memory


class _AtRest(NamedTuple):
    """States without attraction, each of shape (states,)."""

    area_m2: Tensor
    applied_pa: Tensor  # in the fidelity's unit
    widest_gap_m: Tensor | None

    def part(self, at: slice) -> _AtRest:
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
        properties, balance = self.terms.given, self.fidelity.solve(load)
        shear = properties.finger.frictional_shear_stress_pa
        return shear * balance.area_fraction / (load.applied_pa * properties.unit_pa), balance

    def spot_pressure_pa(self, mu: Tensor, balance: Balance) -> Tensor:
        """Mean pressure [Pa] in the contact spots: ``tau_f/mu`` by the load, and the attraction."""
        given = self.terms.given
        pull = given.unit_pa * (balance.gap_attraction_pa + balance.spot_attraction_pa)
        return given.finger.frictional_shear_stress_pa / mu + pull / balance.area_fraction

    def status(self, mu: Tensor, balance: Balance, field: FieldInGap) -> Tensor:
        """`haptix.Status` of states, but for the share of `past_breakdown`."""
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
        """Return those of some states whose attraction is past the limit of `Status.BREAKDOWN`.

        Parameters are those of `sum_gaps`. Where discharge holds the gaps, none is.
        """
        gaps, most = balance.gap_attraction_pa, LIMITS[Status.BREAKDOWN].most
        allowed = most * (gaps + balance.spot_attraction_pa)
        states = states[gaps[states] > allowed[states]]
        if not len(states) or Stage.PULL in self.terms.stages:
            return states[:0]
        edges, screen = self.fidelity.contact.field.gap_edges_m, self.terms.given.screen
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
            each = pull.strength[:, None] * pull.kernel[pull.own_column][:, 0]
            broken = torch.where(each > most_pa, each, 0.0)
            past.append(at[torch.linalg.vecdot(broken, mass) > allowed[at]])
        return torch.cat(past)

    def load(self, normal_force_n: Tensor, pull: Pull) -> Load:
        """Return what the fidelity is given for these states."""
        return self._load(pull, self._at_rest(normal_force_n))

    def _load(self, pull: Pull, at_rest: _AtRest) -> Load:
        pull = replace(pull, strength=pull.strength / self.terms.given.unit_pa)
        if Stage.SUPPLY not in self.terms.stages:
            return Load(at_rest.applied_pa, pull, at_rest.widest_gap_m)
        share = self.terms.voltage_share
        return Load(at_rest.applied_pa, pull, at_rest.widest_gap_m, at_rest.area_m2, share)

    def solve_in_blocks(
        self, normal_force_n: Tensor, pull_of: Callable[[slice], Pull]
    ) -> tuple[Tensor, Balance]:
        """Solve many states a block at a time, with the `Pull` that `pull_of` gives for each."""
        # Blocks come in the order of the forces: a table that grew with each would be solved often.
        at_rest = self._at_rest(normal_force_n)
        self.fidelity.prepare(at_rest.applied_pa, at_rest.widest_gap_m)
        own = pull_of(slice(0, 1)).column is None
        own = own or not {Stage.PULL, Stage.SUPPLY}.isdisjoint(self.terms.stages)
        block = _BLOCK_OF_OWN if own else BLOCK
        blocks = [slice(i, i + block) for i in range(0, len(normal_force_n), block)]
        try:
            solved = [self._solve(self._load(pull_of(at), at_rest.part(at))) for at in blocks]
        finally:
            self.fidelity.release()
        mu, balances = zip(*solved, strict=True)
        return torch.cat(mu), Balance.joined(balances)

    def prepare(self, normal_force_n: Tensor) -> None:
        """Make what all states of these normal forces [N] share, such as tables."""
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
        """Sum over the gaps of solved states, which most callers do without.

        Parameters
        ----------
        normal_force_n, voltage_v, frequency_hz : Tensor, shape (states,)
            Normal force [N], amplitude on the contact [V], and frequency [Hz] or None.
        circuit, balance : Circuit, Balance
            Of all states.
        pull_of : callable
            Attraction of states at amplitudes [V] with their part of the circuit.
        like : Tensor
            Gives shape and precision of the results.
        """
        edges, screen = self.fidelity.contact.field.gap_edges_m, self.terms.given.screen
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
        return _AtRest(area, normal_force_n / area / self.terms.given.unit_pa, widest)
