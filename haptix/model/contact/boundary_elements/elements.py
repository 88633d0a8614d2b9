"""Boundary elements: rough surfaces on an elastic solid, solved point by point."""

from __future__ import annotations

import hashlib
import os
from dataclasses import dataclass
from functools import cached_property
from math import inf, log, nan, pi
from typing import Any

import torch
from torch import Tensor

from haptix.base import checks
from haptix.base.display import Displayed
from haptix.base.errors import InputError
from haptix.base.threads import given_threads
from haptix.model.contact.boundary_elements.bounded import BoundedProblem, BoundedSolution
from haptix.model.contact.boundary_elements.coupled import (
    AttractedContacts,
    LocalAttraction,
    lowest_branch,
)
from haptix.model.contact.boundary_elements.ensemble import (
    Progress,
    Row,
    check_memory,
    run_ensemble,
    surfaces_that_fit,
)
from haptix.model.contact.boundary_elements.rough_surfaces import Surfaces
from haptix.model.contact.elasticity import ElasticSolid
from haptix.model.status import Status

# How far the pixels in contact reach beyond the contact, over the perimeter: a mean over the
# directions of its border (Yastrebov, Anciaux, Molinari, J. Mech. Phys. Solids 107 (2017), eq. 20).
_PERIMETER_SHARE = (pi - 1 + log(2)) / 24

GAP_LEVELS = (torch.arange(32, dtype=torch.float64) + 0.5) / 32
"""Shares at which the gap's distribution is given: the middles of 32 equal classes."""

# Power of the gaps' attraction by which the reported strength falls past the end of light contact:
# 1 % more attraction takes almost a tenth of the strength, so that no step is spent beyond.
_FALL = -8.0
# Largest mean attraction, over p0, with which a branch starts. A rough contact gives way by some
# h_rms/2 where its pressure grows e-fold, and only an attraction of about p0 then grows as much.
_FIRST_PULL = 0.3


@dataclass(frozen=True)
class ContactSolution(Displayed):
    """Solved states, all of shape (loads, surfaces) or (loads, strengths, surfaces)."""

    pressure_pa: Tensor
    """Applied nominal pressure p0 [Pa]."""
    strength: Tensor
    """Factor on the attraction, 0 without one."""
    area_fraction_raw: Tensor
    """Pixels with pressure, A/A0."""
    area_fraction: Tensor
    """The same, corrected for the pixels that stand over the contact's border: use this one."""
    plastic_fraction: Tensor
    """Share of the nominal area at the hardness."""
    mean_gap_m: Tensor
    """Mean gap over the nominal area [m]."""
    gap_quantiles_m: Tensor
    """Quantiles of the open gaps [m] at `GAP_LEVELS`, shape (..., levels); NaN without any."""
    attraction_gaps_pa: Tensor
    attraction_spots_pa: Tensor
    """Mean attraction [Pa] over the nominal area, of the open gaps and of the spots."""
    residual: Tensor
    """Largest violation of the contact conditions, over h_rms."""
    iterations: Tensor
    """Steps on the finest grid, all together."""
    converged: Tensor
    """Whether the residual is within the tolerance."""
    status: Tensor
    """`Status`: OK, or PULL_IN past the end of the lowest branch; values are those at its end."""
    snap_in_strength: Tensor
    """Strengths between which the lowest branch ends, shape (..., 2); NaN where it goes on."""

    @property
    def attraction_pa(self) -> Tensor:
        """Mean attraction [Pa], gaps and spots."""
        return self.attraction_gaps_pa + self.attraction_spots_pa


def corrected_area(contact: Tensor) -> Tensor:
    """Contact share of periodic masks, shape (..., n, n), corrected for its pixels.

    A pixel counts as contact or not, so that the contact's border is drawn out: the area is too
    large by ``(pi - 1 + ln 2)/24`` times the perimeter counted in pixel sides, times the side
    (Yastrebov, Anciaux, Molinari, J. Mech. Phys. Solids 107, 469 (2017)).
    """
    perimeter = sum(
        (contact ^ contact.roll(1, axis)).to(torch.float64).mean((-2, -1)) for axis in (-2, -1)
    )
    raw = contact.to(torch.float64).mean((-2, -1))
    # Of a few lone pixels the correction would leave less than a disc in each; never below 0.
    return (raw - _PERIMETER_SHARE * perimeter).clamp(min=0.0)


def open_quantiles(gap_m: Tensor, contact: Tensor) -> Tensor:
    """Quantiles of the open gaps of one surface, linear between neighbours; NaN without any."""
    rising = gap_m[~contact].sort().values
    levels = GAP_LEVELS.to(rising.device)
    if len(rising) == 0:
        return torch.full_like(levels, float("nan"))
    at = levels * (len(rising) - 1)
    below = at.floor().long()
    above = (below + 1).clamp(max=len(rising) - 1)
    return torch.lerp(rising[below], rising[above], at - below)


@dataclass(frozen=True)
class BoundaryElements:
    """Contact of periodic rough surfaces with an elastic solid, solved on their own pixels.

    The reference for the mean field: nothing is averaged before the contact is solved. Pressures
    are nominal, heights point towards the solid, all of it is double precision.
    """

    surfaces: Surfaces
    """Height maps."""
    modulus: ElasticSolid
    """The solid's ``E*(q)``."""
    hardness_pa: float | None = None
    """Pressure at which the solid yields [Pa]; by default it is elastic. Where it yields, the gap
    is counted as 0."""
    tolerance: float = 1e-5
    """Largest violation of the contact conditions at any point, over h_rms: 1e-5 leaves the gaps
    within about that of the exact ones on the grid, and fewer than one contact pixel in 10^3
    undecided."""
    device: torch.device | str = "cpu"
    """Device of the fields."""
    at_a_time: int | None = None
    """Surfaces in one batch: by default 1 on a CPU, where batches run side by side on its threads,
    and as many as fit on a GPU."""

    def __post_init__(self) -> None:
        if self.hardness_pa is not None:
            checks.positive("hardness_pa", self.hardness_pa)
        if not 1e-12 <= self.tolerance <= 1e-2:
            raise InputError(f"tolerance: expected 1e-12 to 1e-2, got {self.tolerance!r}")
        if self.at_a_time is not None:
            checks.whole("at_a_time", self.at_a_time, 1)

    def full_contact_pressure(self) -> Tensor:
        """Pressure [Pa] that closes every gap of an elastic solid, shape (surfaces,).

        It is the largest suction in the pressure whose displacement equals the heights.
        """
        grid = self._problem.levels[0]
        heights = self.surfaces.height_m.to(self.device)
        return torch.stack([-grid.pressure(h).amin() for h in heights]).cpu()

    def solve(
        self,
        pressure_pa: Any,
        checkpoint: str | os.PathLike[str] | None = None,
        progress: Progress | None = None,
    ) -> ContactSolution:
        """Solve all surfaces at every nominal pressure.

        Raises `InputError` if a pressure is not above 0, or closes every gap, or is above the
        hardness, or the memory does not suffice; `FileFormatError` if the checkpoint is damaged or
        belongs to something else.

        Parameters
        ----------
        pressure_pa : array_like, shape (loads,) or a number
            Nominal pressures [Pa], in any order.
        checkpoint : path, optional
            File (.npz) in which finished surfaces are kept: the same call resumes from it.
        progress : Progress, optional
            Called with the batches done and all batches.

        Returns
        -------
        ContactSolution
            Of shape (loads, surfaces).
        """
        pressure = self._checked_pressure(pressure_pa)
        batches = self._batches()

        def work(job: int) -> Row:
            rows = [self._measure(self._solve_batch(batches[job], p)) for p in pressure.tolist()]
            return {key: torch.stack([row[key] for row in rows]).cpu() for key in rows[0]}

        name = self._fingerprint(pressure, batches)
        rows = run_ensemble(len(batches), work, name, self._workers, checkpoint, progress)
        columns = {key: torch.cat([row[key] for row in rows], 1) for key in rows[0]}
        shape = columns["residual"].shape
        return ContactSolution(
            pressure_pa=pressure[:, None].expand(shape),
            strength=torch.zeros(shape, dtype=torch.float64),
            status=torch.full(shape, int(Status.OK)),
            snap_in_strength=torch.full((*shape, 2), nan, dtype=torch.float64),
            **columns,
        )

    def solve_attracted(
        self,
        pressure_pa: Any,
        attraction: LocalAttraction,
        strength: Any,
        checkpoint: str | os.PathLike[str] | None = None,
        progress: Progress | None = None,
        light_limit: float = inf,
    ) -> ContactSolution:
        """Solve all surfaces under an attraction that depends on the local gap.

        The lowest branch is followed from no attraction on; where it ends the contact snaps in,
        and stronger attractions have status PULL_IN and the values at the branch's end. Where all
        of the solid would yield the branch ends too.

        Parameters
        ----------
        pressure_pa : array_like, shape (loads,) or a number
            Applied nominal pressures p0 [Pa].
        attraction : callable
            Traction [Pa] at strength 1 for gaps [m] of any shape: above 0, and falling with the
            gap. For a voltage V on an insulator h0: ``eps0 / 4 / (u + h0)^2`` at strength V^2.
        strength : array_like, shape (strengths,) or a number
            Factors on the attraction, 0 or more, in rising order.
        checkpoint, progress
            As in `solve`.
        light_limit : float
            The branch also ends where the sum of p0 and the attraction of the open gaps exceeds
            this multiple of p0; stronger attractions are not solved.

        Returns
        -------
        ContactSolution
            Of shape (loads, strengths, surfaces).

        Raises
        ------
        InputError
            As `solve`; or if the strengths are not 0 or more and rising, or the attraction is not
            above 0 and falling with the gap. A checkpoint raises what it does in `solve`.
        """
        pressure = self._checked_pressure(pressure_pa)
        strengths = torch.as_tensor(strength, dtype=torch.float64).detach().cpu().reshape(-1)
        checks.number("strength", checks.increasing("strength", strengths)[0], 0)
        if not light_limit > 1:
            raise InputError(f"light_limit: expected a number above 1, got {light_limit!r}")
        _check_attraction(attraction, float(self.surfaces.h_rms_m.mean()))
        heights = self.surfaces.height_m
        at_once = min(self._workers, len(heights))
        check_memory(self.surfaces.points, at_once, True, torch.device(self.device))

        def work(job: int) -> Row:
            height = heights[job].to(self.device)
            paths = [
                self._follow(height, float(p), attraction, strengths, light_limit) for p in pressure
            ]
            return {key: torch.stack([path[key] for path in paths]) for key in paths[0]}

        probe = attraction(torch.linspace(0, 3, 31, dtype=torch.float64) * heights.std())
        name = self._fingerprint(
            torch.cat([pressure, strengths, probe]), len(pressure), light_limit
        )
        rows = run_ensemble(len(heights), work, name, self._workers, checkpoint, progress)
        columns = {key: torch.stack([row[key] for row in rows], 2) for key in rows[0]}
        shape = columns["residual"].shape
        return ContactSolution(
            pressure_pa=pressure[:, None, None].expand(shape),
            strength=strengths[:, None].expand(shape),
            **columns,
        )

    def fields(self, pressure_pa: float) -> BoundedSolution:
        """Pressure and gap of every point of all surfaces at one nominal pressure [Pa]."""
        pressure = float(self._checked_pressure(pressure_pa)[0])
        return self._solve_batch(slice(None), pressure)

    @cached_property
    def _problem(self) -> BoundedProblem:
        points, side_m = self.surfaces.points, self.surfaces.side_m
        device = torch.device(self.device)
        return BoundedProblem.on_grid(self.modulus, points, side_m, self.hardness_pa, device)

    @property
    def _workers(self) -> int:
        """Batches at a time: a GPU is filled by one."""
        return given_threads() if torch.device(self.device).type == "cpu" else 1

    def _checked_pressure(self, pressure_pa: Any) -> Tensor:
        pressure = torch.as_tensor(pressure_pa, dtype=torch.float64).detach().cpu()
        usable = bool(((pressure > 0) & pressure.isfinite()).all())
        if pressure.ndim > 1 or pressure.numel() == 0 or not usable:
            raise InputError(
                "pressure_pa: expected finite pressures above 0 [Pa], a number or one dimension, "
                f"got {pressure_pa!r}"
            )
        most = float(pressure.max())
        if self.hardness_pa is not None:
            if most >= self.hardness_pa:
                raise InputError(
                    f"pressure_pa: expected pressures below the hardness, {self.hardness_pa:g} Pa, "
                    f"got {most:g} Pa; the whole surface would yield"
                )
        elif most >= (full := float(self.full_contact_pressure().min())):
            raise InputError(
                f"pressure_pa: expected pressures below {full:.4g} Pa, which closes every gap of "
                f"a surface, got {most:g} Pa; nothing is left to solve there: A/A0 is 1"
            )
        return pressure.reshape(-1)

    def _batches(self) -> list[slice]:
        """Surfaces to be solved in one batch each."""
        box, device = self.surfaces, torch.device(self.device)
        size = self.at_a_time
        if size is None:
            size = 1 if device.type == "cpu" else surfaces_that_fit(box.points, device)
        size = min(size, len(box))
        check_memory(box.points, min(size * self._workers, len(box)), False, device)
        return [slice(i, i + size) for i in range(0, len(box), size)]

    def _solve_batch(self, batch: slice, pressure: float) -> BoundedSolution:
        height = self.surfaces.height_m[batch].to(self.device)
        scale = height.square().mean((-2, -1)).sqrt()
        mean = torch.full_like(scale, pressure)
        return self._problem.solve(height, mean, scale, self.tolerance)

    def _measure(self, solved: BoundedSolution) -> Row:
        contact = solved.pressure_pa > 0
        gap = solved.gap_m.clamp(min=0.0).masked_fill_(contact, 0.0)
        zero = torch.zeros_like(solved.residual)
        plastic = zero
        if self.hardness_pa is not None:
            plastic = (solved.pressure_pa >= self.hardness_pa).to(gap.dtype).mean((-2, -1))
        return {
            "area_fraction_raw": contact.to(gap.dtype).mean((-2, -1)),
            "area_fraction": corrected_area(contact),
            "plastic_fraction": plastic,
            "mean_gap_m": gap.mean((-2, -1)),
            "gap_quantiles_m": torch.stack(
                [open_quantiles(g, c) for g, c in zip(gap, contact, strict=True)]
            ),
            "attraction_gaps_pa": zero,
            "attraction_spots_pa": zero,
            "residual": solved.residual,
            "iterations": solved.iterations,
            "converged": solved.converged,
        }

    def _follow(
        self,
        height: Tensor,
        pressure: float,
        attraction: LocalAttraction,
        strengths: Tensor,
        light_limit: float,
    ) -> Row:
        """Solve one surface at one pressure along all strengths."""
        applied = height.new_full((1,), pressure)
        contact = AttractedContacts(
            self._problem, height[None], applied, attraction, self.tolerance
        )
        reached: list[Row] = []

        def record(strength: float, status: Status = Status.OK) -> None:
            reached.append(self._measure_attracted(contact, strength, status))

        unloaded = int((strengths == 0).sum())
        if unloaded:
            record(0.0)
        wanted = strengths.tolist()[unloaded:]
        bracket: tuple[float, float] = (nan, nan)
        if wanted:
            # The first strength's attraction if no gap closes may lie beyond the branch's end.
            first = min(wanted[0] * float(contact.traction.mean()), _FIRST_PULL * pressure)
            if self.hardness_pa is not None:
                first = min(first, _FIRST_PULL * (self.hardness_pa - pressure))

            def strength_at(attraction_pa: float) -> float:
                strength = float(contact.strength(applied.new_full((1,), attraction_pa)))
                # Falls with the gaps' attraction past the limit: the branch ends there.
                pull = float(contact.gaps_share * contact.attraction_pa)
                share = pull / ((light_limit - 1) * pressure)
                return strength if share <= 1 else strength * share**_FALL

            bracket = lowest_branch(wanted, first, strength_at, record) or bracket
        while len(reached) < len(strengths):
            record(bracket[0], Status.PULL_IN)
        rows = {key: torch.stack([row[key] for row in reached]) for key in reached[0]}
        rows["snap_in_strength"] = torch.tensor(bracket, dtype=torch.float64).repeat(
            len(strengths), 1
        )
        return rows

    def _measure_attracted(
        self, contact: AttractedContacts, strength: float, status: Status
    ) -> Row:
        row = {key: value[0].clone() for key, value in self._measure(contact.contact).items()}
        spots = contact.contact.pressure_pa[0] > 0
        traction = strength * contact.traction[0]
        row["attraction_spots_pa"] = (traction * spots).mean()
        row["attraction_gaps_pa"] = (traction * ~spots).mean()
        row["iterations"] = contact.iterations[0].clone()
        row["converged"] = contact.converged[0].clone()
        row["status"] = torch.tensor(int(status))
        return {key: value.cpu() for key, value in row.items()}

    def _fingerprint(self, *loads: Any) -> str:
        """Return a hash of everything that the results depend on."""
        digest = hashlib.sha256()
        grid = self._problem.levels[0]
        for field in (self.surfaces.height_m, grid.compliance.cpu()):
            digest.update(field.contiguous().numpy().tobytes())
        digest.update(repr((self.hardness_pa, self.tolerance)).encode())
        for load in loads:
            text = load.tolist() if isinstance(load, Tensor) else load
            digest.update(repr(text).encode())
        return digest.hexdigest()


def _check_attraction(attraction: LocalAttraction, h_rms: float) -> None:
    gaps = torch.linspace(0, 5, 101, dtype=torch.float64) * h_rms
    traction = attraction(gaps)
    if traction.shape != gaps.shape or not bool((traction > 0).all() and traction.isfinite().all()):
        raise InputError(
            "attraction: expected a finite traction above 0 [Pa] for every gap, of the gaps' shape"
        )
    if bool((traction.diff() > 0).any()):
        raise InputError("attraction: expected a traction that falls as the gap grows")
