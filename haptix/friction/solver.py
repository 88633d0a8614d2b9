"""Solver of loads: from normal force and attraction to friction."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import NamedTuple

import torch
from torch import Tensor

from haptix.electro import Pull
from haptix.fidelity import Balance, Fidelity, Load
from haptix.terms import ActiveTerms, Stage

_BLOCK = 4096  # states solved together: bounds the memory, and fits the cache


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
        given, found = self.terms.given, self.fidelity.solve(load)
        shear = given.finger.frictional_shear_stress_pa
        return shear * found.area_fraction / (load.applied_pa * given.unit_pa), found

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
        blocks = [slice(i, i + _BLOCK) for i in range(0, len(normal_force_n), _BLOCK)]
        try:
            solved = [self._solve(self._load(pull_of(at), at_rest.part(at))) for at in blocks]
        finally:
            self.fidelity.release()
        mu, found = zip(*solved, strict=True)
        return torch.cat(mu), Balance.joined(found)

    def prepare(self, normal_force_n: Tensor) -> None:
        """Make what all states of these normal forces [N] share, such as tables."""
        at_rest = self._at_rest(normal_force_n)
        self.fidelity.prepare(at_rest.applied_pa, at_rest.widest_gap_m)

    def gap_masses(self, normal_force_n: Tensor, found: Balance, block: int) -> Iterator[Tensor]:
        """Share of the area in each bin of gaps of solved states, (block, bins) at a time."""
        self.prepare(normal_force_n)
        parts = zip(normal_force_n.split(block), found.pressure_pa.split(block), strict=True)
        try:
            for force, pressure in parts:
                at_rest = self._at_rest(force)
                yield self.fidelity.gap_mass(at_rest.applied_pa, at_rest.widest_gap_m, pressure)
        finally:
            self.fidelity.release()

    def _at_rest(self, normal_force_n: Tensor) -> _AtRest:
        area = self.terms.apparent_area_m2(normal_force_n)
        widest = self.terms.widest_gap_m(area, self.fidelity.contact.field)
        return _AtRest(area, normal_force_n / area / self.terms.given.unit_pa, widest)
