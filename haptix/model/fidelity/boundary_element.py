"""The contact solved point by point on random surfaces: exact within its band, and slow."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, fields
from math import ceil, inf
from time import perf_counter

import torch
from torch import Tensor

from haptix.base.errors import InputError
from haptix.base.threads import given_threads
from haptix.model.contact.boundary_elements import (
    BoundaryElements,
    ContactSolution,
    ResolutionWarning,
)
from haptix.model.contact.boundary_elements.bounded import PeriodicSolid
from haptix.model.contact.boundary_elements.ensemble import check_memory
from haptix.model.fidelity.balance import (
    LIGHT_CONTACT_LIMIT,
    Ability,
    Balance,
    Contact,
    Fidelity,
    Load,
)
from haptix.model.status import Status
from haptix.model.terms import Stage

# Fourier transforms for one surface at one voltage: 500 where the grid resolves h0, 2,000 to 10,000
# where it does not.
_TRANSFORMS = 8000
_FEW_PIXELS = 100  # in contact: one pixel is then a hundredth of the area

Place = tuple[float, complex]
"""Applied pressure [Pa] and h0 [m]. States of one place differ in voltage only."""


class UnsettledWarning(UserWarning):
    """Some surfaces did not reach the tolerance; the message has their number."""


@dataclass(frozen=True)
class Scatter(Balance):
    """Equilibria of every surface, all of shape (..., surfaces).

    `strength_at_end` is infinite where the search did not reach the end of the branch.
    """

    converged: Tensor
    """Whether the state is solved to the tolerance."""


class BoundaryElementBalance(Fidelity):
    """Equilibria as the mean over the surfaces of a box.

    The attraction acts on every point. In a contact spot the contact pressure balances it, which
    the mean field calls spots "excluded": ``pressure_pa`` is ``p0`` plus the attraction of the
    gaps. A state has pulled in when half of its surfaces have snapped in, or when their gaps
    attract them so much that the contact is no longer light (`LIGHT_CONTACT_LIMIT`).
    """

    name = "boundary-element"
    assumes = "has a highest asperity of its own in its box, and the drive's voltage on every gap"
    honours = frozenset(Stage) - {Stage.GAPS, Stage.PULL, Stage.SUPPLY}
    can = frozenset({Ability.SCATTER})

    def __init__(self, contact: Contact) -> None:
        if contact.contact_spots == "included":
            raise InputError(
                'contact_spots: expected "excluded" with fidelity "boundary-element", got '
                '"included": the attraction acts on every point, and inside a spot the contact '
                "itself balances it"
            )
        assert contact.boxed is not None  # a fidelity that can scatter has a box
        super().__init__(contact)
        self.boxed = contact.boxed
        self.device = contact.field.device
        self.on_progress = contact.on_progress
        self._known: dict[Place, dict[float, Scatter]] = {}
        box = self.boxed.box
        check_memory(box.points, min(given_threads(), box.surfaces), True, self.device)
        hardness = None if contact.hardness_pa is None else float(contact.hardness_pa)
        self._elements = BoundaryElements(
            self.boxed.surfaces, contact.field.modulus, hardness, box.tolerance, self.device
        )

    def solve(self, load: Load) -> Balance:
        """Return the mean equilibrium of every state on the lowest branch."""
        scattered = self.scatter(load)
        names = [field.name for field in fields(Balance)]
        mean = {name: getattr(scattered, name).double().mean(-1) for name in names}
        mean["strength_at_end"] = scattered.strength_at_end.median(-1).values
        mean["is_stable"] = mean["is_stable"] > 0.5
        return Balance(**mean)

    def scatter(self, load: Load) -> Scatter:
        """Return every state of every surface; a state is solved only once."""
        thickness = self._thickness(load)
        columns = (load.applied_pa, load.pull.own_column, load.pull.strength)
        states = [
            ((applied, thickness[column]), strength)
            for applied, column, strength in zip(*(t.tolist() for t in columns), strict=True)
        ]
        missing: dict[Place, set[float]] = {}
        for place, strength in states:
            if strength not in self._known.get(place, {}):
                missing.setdefault(place, set()).add(strength)
        self._check_amount(sum(map(len, missing.values())))
        for number, (place, strengths) in enumerate(missing.items(), start=1):
            self.follow_loads(place, sorted(strengths))
            if self.on_progress is not None:
                self.on_progress(number / len(missing))
        rows = [self._known[place][strength] for place, strength in states]
        return Scatter.joined(rows, lambda column: torch.stack(column).to(self.device))

    def seconds_per_state(self) -> float:
        """Rough time [s] of one state, from the time of a transform on this machine."""
        box = self.boxed.box
        grid = PeriodicSolid.on_grid(
            self.contact.field.modulus, box.points, self.boxed.side_m, self.device
        )
        height = self.boxed.surfaces.height_m[:1].to(self.device)
        grid.displacement(height)
        began = perf_counter()
        for _ in range(3):
            grid.displacement(height)
        if self.device.type == "cuda":
            torch.cuda.synchronize(self.device)
        each = (perf_counter() - began) / 3
        return _TRANSFORMS * each * ceil(box.surfaces / min(given_threads(), box.surfaces))

    def _check_amount(self, states: int) -> None:
        most = self.boxed.box.most_states
        if states > most:
            raise InputError(
                f"expected at most {most} states that are new to the boundary elements in one "
                f"call, got {states}, about {states * self.seconds_per_state() / 60:.2g} min; ask "
                "for fewer, build a FrictionSurface, or raise BoundaryElementBox.most_states"
            )

    @staticmethod
    def _thickness(load: Load) -> list[complex]:
        thickness = load.pull.thickness_m
        assert thickness is not None  # only the mean of a sine: no ability to solve instants
        tensors = (load.applied_pa, load.pull.strength, thickness)
        if any(tensor.requires_grad for tensor in tensors):
            raise InputError(
                "expected values that need no gradient: boundary elements have none, got one that "
                'requires grad; detach it, or use fidelity "mean-field"'
            )
        return [complex(value) for value in thickness.tolist()]

    def follow_loads(self, place: Place, strengths: list[float]) -> None:
        """Solve one place along its rising strengths.

        Parameters
        ----------
        place : tuple of float and complex
            Applied pressure [Pa] and h0 [m].
        strengths : list of float
            Strengths of the attraction, rising.
        """
        applied, thickness = place
        if strengths[-1] > 0 and self.boxed.gap_step_m > abs(thickness):
            coarse = self.boxed.gap_step_m / abs(thickness)  # pixel size over that of a step h0
            warnings.warn(
                f"the gap changes by {self.boxed.gap_step_m:.2g} m from pixel to pixel, "
                f"{coarse:.2g} times h0: the attraction next to the spots is not resolved. At 1.5, "
                "3 and 6 times the attraction of the gaps is some 10, 25 and 40 % too weak, and "
                "the area that voltage adds up to 10, 10 and 65 % off; "
                f"this band needs {ceil(self.boxed.box.points * coarse)} points along a side: "
                "take more points or a smaller box",
                ResolutionWarning,
                stacklevel=2,
            )

        def per_strength(gap: Tensor) -> Tensor:  # 1/|u + h0|^2
            return ((gap + thickness.real) ** 2 + thickness.imag**2).reciprocal()

        solution = self._elements.solve_attracted(
            [applied], per_strength, strengths, light_limit=LIGHT_CONTACT_LIMIT
        )
        lost = int((~solution.converged & (solution.status == int(Status.OK))).sum())
        if lost:
            warnings.warn(
                f"{lost} of {solution.converged.numel()} states of single surfaces at "
                f"{applied:.4g} Pa were not solved to the tolerance: few pixels close and open in "
                "turn; take more points",
                UnsettledWarning,
                stacklevel=2,
            )
        pixels = float(solution.area_fraction_raw[0, 0].mean()) * self.boxed.box.points**2
        if pixels < _FEW_PIXELS:
            warnings.warn(
                f"{pixels:.2g} pixels of a surface are in contact at {applied:.4g} Pa: their area "
                "is a count of pixels; take more points, or larger forces",
                ResolutionWarning,
                stacklevel=2,
            )
        rows = [_row(solution, number) for number in range(len(strengths))]
        self._known.setdefault(place, {}).update(zip(strengths, rows, strict=True))


def _row(solution: ContactSolution, strength: int) -> Scatter:
    at = (0, strength)
    end = solution.snap_in_strength[at].mean(-1)
    return Scatter(
        solution.pressure_pa[at] + solution.attraction_gaps_pa[at],
        solution.area_fraction[at],
        solution.attraction_gaps_pa[at],
        solution.attraction_spots_pa[at],
        solution.mean_gap_m[at],
        torch.where(end.isnan(), inf, end),
        solution.status[at] == int(Status.OK),
        torch.ones_like(solution.mean_gap_m[at]),
        solution.converged[at],
    )
