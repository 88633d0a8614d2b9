"""Contact and an attraction that depends on the gap, solved together along the lowest branch.

The attraction is ``p_a phi(x)``, with ``phi`` of mean 1 the shape ``f(g)/<f(g)>`` of the traction
f. It presses on the solid like an outer load, so that the contact is one of the heights
``h - p_a K phi`` under the mean pressure ``p0 + p_a``; its gaps give the next shape. Anderson's
mixing (J. ACM 12, 547 (1965)) makes this iteration converge in a few steps. The attraction acts on
every point; inside a spot the contact's own pressure balances it.

Where the attraction grows faster than the contact resists, the strength (the squared voltage) does
not determine a state, but the mean attraction p_a does. So the branch is followed along p_a. Each
step computes the strength that sustains p_a, and the requested strengths are found on the way. The
contact snaps in where the strength stops rising with p_a.
"""

from __future__ import annotations

from collections.abc import Callable
from math import exp, inf, log
from typing import NamedTuple

import torch
from torch import Tensor

from haptix.model.contact.boundary_elements.bounded import BoundedProblem

LocalAttraction = Callable[[Tensor], Tensor]
"""Traction [Pa] at unit strength for gaps [m] of any shape: above 0, and falling with the gap."""

_MOST_ROUNDS = 200
_HISTORY = 3
# Mean change of the shape in a step: the strength then moves by less than half of it.
_SETTLED = 3e-4
_FIRST_TOLERANCE = 1e-3
# The effect of a contact's residual on the attraction depends on the gap that halves it: contacts
# are solved to a smaller residual where that gap is below a twelfth of h_rms. Otherwise the
# iteration for a skin of 22 um on an insulator of 0.1 um does not converge below the error of their
# contacts. The residual is never smaller than rounding allows.
_HALVINGS = 12.0
_SHARPEST = 1e-5

_LARGEST_STEP = 0.5
# Relative; near the end of the branch the area changes four times as much.
_STRENGTH_TOLERANCE = 3e-4
_SNAP_TOLERANCE = 0.02  # of the strength: half of it of the voltage
_MOST_STEPS = 30
Point = tuple[float, float]  # logarithms of a mean attraction and of its strength
Measure = Callable[[float], Point]  # solves at the logarithm of a mean attraction


class AttractedContacts:
    """A batch of surfaces, each under an attraction of given mean, from solve to solve.

    Surfaces, applied pressures and insulators may differ within the batch: a GPU solves many at a
    time. Each solve starts from the one before.

    Parameters
    ----------
    problem : BoundedProblem
        Solid and grid.
    height_m : Tensor, shape (batch, n, n)
        Heights.
    pressure_pa : Tensor, shape (batch,)
        Applied pressure p0 [Pa].
    attraction : LocalAttraction
        Traction against gaps of shape (batch, ..., ...).
    tolerance : float
        Residual of a contact, over h_rms or over 12 times the gap at which the traction has
        fallen to half, whichever is less.
    """

    def __init__(
        self,
        problem: BoundedProblem,
        height_m: Tensor,
        pressure_pa: Tensor,
        attraction: LocalAttraction,
        tolerance: float,
    ) -> None:
        self._problem = problem
        self._height = height_m
        self._scale = height_m.square().mean((-2, -1)).sqrt()
        self._pressure = pressure_pa
        self._attraction = attraction
        halvings = _HALVINGS * _half_fall(attraction, self._scale) / self._scale
        self._sharpness = halvings.clamp(_SHARPEST, 1.0)
        self._tolerance = tolerance * self._sharpness
        self._hardness = inf if problem.ceiling_pa is None else problem.ceiling_pa
        self.attraction_pa = torch.zeros_like(pressure_pa)
        self.contact = problem.solve(height_m, pressure_pa, self._scale, self._tolerance)
        self.iterations = self.contact.iterations.clone()
        self.converged = torch.ones_like(self.contact.converged)
        self.traction, self.shape = self._from_gap()

    def strength(self, attraction_pa: Tensor) -> Tensor:
        """Solve at mean attractions [Pa]; return the strengths that sustain them, shape (batch,).

        Where all of the solid yields, no strength sustains the attraction: the result is half of
        the strength of full contact, and the state stays that of the solve before.
        """
        solid = self._pressure + attraction_pa < self._hardness
        self.attraction_pa = torch.where(solid, attraction_pa, self.attraction_pa)
        self.converged = self.converged & ~solid
        mixings = [_Anderson() for _ in solid]
        tolerance = (_FIRST_TOLERANCE * self._sharpness).clamp(min=self._tolerance)
        inputs, left = self.shape.clone(), solid.nonzero()[:, 0]
        for _ in range(_MOST_ROUNDS):
            if not len(left):
                break
            self._solve_contacts(left, inputs[left], tolerance[left])
            self.traction, self.shape = self._from_gap()
            misses = (self.shape - inputs).abs().mean((-2, -1))
            # On small grids one pixel that closes or opens changes the shape more than that.
            settled = (self.shape.amax((-2, -1)) / inputs[0].numel()).clamp(min=_SETTLED)
            done = (misses <= settled) & (tolerance == self._tolerance)
            self.converged[left] = (done & self.contact.converged)[left]
            left = left[~done[left]]
            # A contact need not be solved more exactly than its attraction is known.
            enough = torch.minimum(tolerance, 0.03 * self._sharpness * misses)
            tolerance[left] = torch.maximum(self._tolerance, enough)[left]
            for row in left.tolist():
                inputs[row] = mixings[row].next(inputs[row], self.shape[row])
        zero_gap = torch.zeros_like(attraction_pa)[:, None, None]
        at_full_contact = self._attraction(zero_gap)[:, 0, 0]
        sustained = self.attraction_pa / self.traction.mean((-2, -1))
        return torch.where(solid, sustained, attraction_pa / at_full_contact / 2)

    @property
    def gaps_share(self) -> Tensor:
        """Share of the attraction that acts on the open gaps, shape (batch,)."""
        spots = self.contact.pressure_pa > 0
        return 1 - (self.shape * spots).mean((-2, -1))

    def _solve_contacts(self, rows: Tensor, shape: Tensor, tolerance: Tensor) -> None:
        attraction = self.attraction_pa[rows]
        # The displacement by the attraction, subtracted from the heights.
        lowered = self._problem.levels[0].displacement(shape).mul_(attraction[:, None, None])
        solved = self._problem.solve(
            lowered.add_(self._height[rows]),
            self._pressure[rows] + attraction,
            self._scale[rows],
            tolerance,
            self.contact.pressure_pa[rows],
        )
        for name, value in vars(solved).items():
            getattr(self.contact, name)[rows] = value
        self.iterations[rows] += solved.iterations

    def _from_gap(self) -> tuple[Tensor, Tensor]:
        traction = self._attraction(self.contact.gap_m.clamp(min=0.0))
        return traction, traction / traction.mean((-2, -1), keepdim=True)


def _half_fall(attraction: LocalAttraction, h_rms_m: Tensor) -> Tensor:
    """Smallest gap [m], to a tenth, at which the traction is half of that in contact."""
    gaps = torch.logspace(-9, 1, 241, dtype=torch.float64, device=h_rms_m.device)
    gaps = h_rms_m[:, None, None] * torch.cat([gaps.new_zeros(1), gaps])
    traction = attraction(gaps)
    halved = traction[..., 1:] <= traction[..., :1] / 2
    first = gaps[..., 1:].gather(-1, halved.to(torch.int8).argmax(-1, keepdim=True))
    return torch.where(halved.any(-1, keepdim=True), first, inf)[:, 0, 0]


class _Anderson:
    """Anderson's mixing of the last steps of a fixed-point iteration."""

    def __init__(self) -> None:
        self._inputs: list[Tensor] = []
        self._misses: list[Tensor] = []

    def next(self, shape: Tensor, result: Tensor) -> Tensor:
        """Return the next input, after the input `shape` gave `result`."""
        miss = (result - shape).flatten()
        if self._misses and miss.norm() > self._misses[-1].norm():
            # The iteration is not linear where pixels close: its history predicts little.
            self._inputs.clear()
            self._misses.clear()
        self._inputs.append(result.flatten())
        self._misses.append(miss)
        del self._inputs[: -_HISTORY - 1], self._misses[: -_HISTORY - 1]
        if len(self._misses) == 1:
            return result
        change = torch.stack([miss - old for old in self._misses[:-1]], 1)
        moved = torch.stack([self._inputs[-1] - old for old in self._inputs[:-1]], 1)
        normal = change.T @ change
        # Without a ridge of the size of rounding, two steps that hardly differ make it singular.
        ridge = 1e-10 * normal.diagonal().sum() * torch.eye(len(normal)).to(normal)
        weights = torch.linalg.solve(normal + ridge, change.T @ miss)
        mixed: Tensor = self._inputs[-1] - moved @ weights
        return mixed.clamp_(min=0.0).reshape(result.shape)


class SnapIn(NamedTuple):
    """Strengths between which the lowest branch ends; higher ones are not reached."""

    low: float
    high: float


def lowest_branch(
    strengths: list[float],
    first_pa: float,
    strength_at: Callable[[float], float],
    reached: Callable[[float], None],
) -> SnapIn | None:
    """Walk up the branch; return where the contact snaps in before the last strength, or None.

    Parameters
    ----------
    strengths : list of float
        Strengths to find, above 0 and rising.
    first_pa : float
        Mean attraction on the branch to start with [Pa]. That of the first strength with the gaps
        held open is a lower bound, but may lie beyond the end.
    strength_at : callable
        Solves at a mean attraction [Pa], and returns the strength that sustains it.
    reached : callable
        Called with each strength in turn, when the state last solved is that of this strength.
    """

    def measure(at: float) -> Point:
        return at, log(strength_at(exp(at)))

    last = measure(log(first_pa))
    before: Point | None = None
    top, left, right = last, before, last  # the highest strength so far, and its neighbours
    for strength in strengths:
        target = log(strength)
        while last[1] < target - _STRENGTH_TOLERANCE:
            new = measure(last[0] + _step(before, last, target))
            if new[1] < top[1] - _SNAP_TOLERANCE:
                summit = _summit(left, top, right if top != last else new, target, measure)
                if isinstance(summit, SnapIn):
                    return summit
                new = summit
            if new[1] >= target:
                last, before = _between(top, new, target, measure)
            else:
                last, before = new, last
            # A shallow dip is a row of pixels that close one by one: continue past it.
            if last[1] > top[1]:
                top, left = last, before
            elif top == before:
                right = last
        reached(strength)
    return None


def _step(before: Point | None, last: Point, target: float) -> float:
    """Step in the attraction's logarithm by the slope so far, a little beyond the target."""
    slope = 1.0 if before is None else (last[1] - before[1]) / (last[0] - before[0])
    slope = min(max(slope, 0.05), 1.0)
    # Towards the end of the branch the slope falls: shorter steps do not overshoot it.
    return min(1.02 * (target - last[1]) / slope, _LARGEST_STEP * max(slope, 0.2))


def _between(low: Point, high: Point, target: float, measure: Measure) -> tuple[Point, Point]:
    """Regula falsi (Illinois) between a point below the target strength and one not below it.

    Returns that point and one on its left.
    """
    if high[1] - target <= _STRENGTH_TOLERANCE:
        return high, low
    below, above = low[1] - target, high[1] - target
    left, right = low[0], high[0]
    point = high
    for _ in range(_MOST_STEPS):
        at = (left * above - right * below) / (above - below)
        point = measure(at)
        miss = point[1] - target
        if abs(miss) <= _STRENGTH_TOLERANCE:
            break
        if miss < 0:
            left, below, above = at, miss, above / 2
        else:
            right, above, below = at, miss, below / 2
    return point, low


def _summit(
    before: Point | None, top: Point, after: Point, target: float, measure: Measure
) -> Point | SnapIn:
    """Narrow down the highest strength between three points, or find one that is high enough.

    The logarithm of a strength rises no steeper than that of its attraction, which bounds the
    strength between two points.
    """
    left = (top[0] - _LARGEST_STEP, top[1] - _LARGEST_STEP) if before is None else before
    right = after
    bound = top[1]
    for _ in range(_MOST_STEPS):
        bound = max(left[1] + top[0] - left[0], top[1] + right[0] - top[0])
        if bound - top[1] <= _SNAP_TOLERANCE:
            break
        at = top[0] + (right[0] - left[0]) * _lean(left, top, right)
        new = measure(at)
        if new[1] >= target:
            return new
        if new[1] > top[1]:
            left, top, right = (top, new, right) if at > top[0] else (left, new, top)
        elif at > top[0]:
            right = new
        else:
            left = new
    measure(top[0])  # leaves the last state of the branch
    return SnapIn(exp(top[1]), exp(bound))


def _lean(left: Point, top: Point, right: Point) -> float:
    """Next place to solve, relative to the top, as a share of the bracket: in its longer part."""
    longer = right[0] - top[0], top[0] - left[0]
    width = right[0] - left[0]
    return 0.5 * longer[0] / width if longer[0] >= longer[1] else -0.5 * longer[1] / width
