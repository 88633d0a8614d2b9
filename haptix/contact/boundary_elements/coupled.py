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

from haptix.contact.boundary_elements.bounded import BoundedProblem, BoundedSolution

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


class AttractedContact:
    """One surface under an attraction of given mean; each solve starts from the one before.

    Parameters
    ----------
    problem : BoundedProblem
        Solid and grid.
    height_m : Tensor, shape (n, n)
        Heights.
    pressure_pa : float
        Applied pressure p0 [Pa].
    attraction : LocalAttraction
        Traction against gap.
    tolerance : float
        Residual of the contact, over h_rms or over 12 times the gap at which the traction has
        fallen to half, whichever is less.
    """

    def __init__(
        self,
        problem: BoundedProblem,
        height_m: Tensor,
        pressure_pa: float,
        attraction: LocalAttraction,
        tolerance: float,
    ) -> None:
        self._problem = problem
        self._height = height_m[None]
        self._scale = height_m.square().mean().sqrt()[None]
        self._pressure = pressure_pa
        self._attraction = attraction
        h_rms = float(self._scale)
        halvings = _HALVINGS * _half_fall(attraction, h_rms) / h_rms
        self._sharpness = min(1.0, max(_SHARPEST, halvings))
        self._tolerance = tolerance * self._sharpness
        self._hardness = problem.ceiling_pa
        self.attraction_pa = 0.0
        self.iterations = 0
        self.converged = True
        self.contact = self._solve_contact(0.0, None, self._tolerance)
        self.traction, self.shape = self._from_gap()

    def strength(self, attraction_pa: float) -> float:
        """Solve at the mean attraction `attraction_pa` [Pa]; return the strength that sustains it.

        Where all of the solid yields, no strength sustains the attraction: the result is half of
        the strength of full contact, and the state stays that of the solve before.
        """
        if self._hardness is not None and self._pressure + attraction_pa >= self._hardness:
            return attraction_pa / float(self._attraction(self.traction.new_zeros(1))) / 2
        self.attraction_pa = attraction_pa
        mixing = _Anderson()
        shape = self.shape
        self.converged = False
        tolerance = max(self._tolerance, _FIRST_TOLERANCE * self._sharpness)
        for _ in range(_MOST_ROUNDS):
            self.contact = self._solve_contact(attraction_pa, shape, tolerance)
            self.traction, new_shape = self._from_gap()
            miss = float((new_shape - shape).abs().mean())
            # On small grids one pixel that closes or opens changes the shape more than that.
            settled = max(_SETTLED, float(new_shape.max()) / new_shape.numel())
            if miss <= settled and tolerance == self._tolerance:
                self.converged = bool(self.contact.converged)
                break
            # A contact need not be solved more exactly than its attraction is known.
            tolerance = max(self._tolerance, min(tolerance, 0.03 * self._sharpness * miss))
            shape = mixing.next(shape, new_shape)
        self.shape = new_shape
        return attraction_pa / float(self.traction.mean())

    @property
    def gaps_share(self) -> float:
        """Share of the attraction that acts on the open gaps."""
        spots = self.contact.pressure_pa > 0
        return 1 - float((self.shape * spots).mean())

    def _solve_contact(
        self, attraction_pa: float, shape: Tensor | None, tolerance: float
    ) -> BoundedSolution:
        height = self._height
        start = None
        if shape is not None:
            # The displacement by the attraction, subtracted from the heights.
            height = height + attraction_pa * self._problem.levels[0].displacement(shape)
            start = self.contact.pressure_pa
        mean = torch.full_like(self._scale, self._pressure + attraction_pa)
        solved = self._problem.solve(height, mean, self._scale, tolerance, start)
        self.iterations += int(solved.iterations)
        return solved

    def _from_gap(self) -> tuple[Tensor, Tensor]:
        traction = self._attraction(self.contact.gap_m.clamp(min=0.0))
        return traction, traction / traction.mean()


def _half_fall(attraction: LocalAttraction, h_rms_m: float) -> float:
    """Smallest gap [m], to a tenth, at which the traction is half of that in contact."""
    gaps = h_rms_m * torch.logspace(-9, 1, 241, dtype=torch.float64)
    traction = attraction(torch.cat([gaps.new_zeros(1), gaps]))
    halved = traction[1:] <= traction[0] / 2
    return float(gaps[halved.to(torch.int8).argmax()]) if bool(halved.any()) else inf


class _Anderson:
    """Anderson's mixing of the last steps of a fixed-point iteration."""

    def __init__(self) -> None:
        self._inputs: list[Tensor] = []
        self._misses: list[Tensor] = []

    def next(self, shape: Tensor, result: Tensor) -> Tensor:
        """Return the next input, after the input `shape` gave `result`."""
        miss = (result - shape).flatten()
        if self._misses and miss.norm() > self._misses[-1].norm():
            # The iteration is not linear where pixels close: its history says little.
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
