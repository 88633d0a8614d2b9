"""Equilibrium of applied pressure, contact pressure and attraction, on the lowest branch.

``p = p0 + c I(p)`` with ``c = eps0 V0^2 / 4`` (paper, Eq. 2 and 3). As the voltage rises from zero
p follows a branch that ends where ``c(p) = (p - p0) / I(p)`` has its first maximum: there the
contact snaps in. Between p0 and that fold c(p) is monotone, so the root is unique and bracketed.

For self-affine roughness I grows a little slower than p, and the snap is a steep rise instead of a
fold: within a few volts of the critical voltage p grows a hundredfold. There the contact is held by
its own attraction, so the light branch is taken to end at `LIGHT_CONTACT_LIMIT` times p0 at most
(times the touching pressure, where a contact of finite size has the larger one).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import inf, log

import torch
from torch import Tensor

from haptix.electro import Attraction

LIGHT_CONTACT_LIMIT = 31.0
"""Largest p/p0 that counts as light contact: the bound of the reference solver (section 5)."""

_BISECTIONS = 48
_FURTHEST = 1e4  # of a strength: a hundred times the voltage
_NEARBY = 1e-4  # in ln p: distance of the difference that gives the fold its curvature
_LEAST_CURVATURE = 1e-6
_NEWTON_STEPS = 80
_STEPS_UNASKED = 8  # on a GPU: to ask whether all are settled makes the CPU wait for it
_SETTLED = 1e-13  # relative; the step that follows is below rounding


@dataclass(frozen=True)
class Equilibrium:
    """Result per state, all tensors of the shape of the states."""

    pressure_pa: Tensor
    """Effective pressure p; at the end of the branch where there is no solution."""
    strength_at_end: Tensor
    """Largest c = eps0 V0^2 / 4 [N] at which the contact is light."""
    is_stable: Tensor
    """True where a solution exists on the lowest branch."""


def lowest_branch(applied_pa: Tensor, strength: Tensor, attraction: Attraction) -> Equilibrium:
    """Solve a flat batch of states.

    Parameters
    ----------
    applied_pa : Tensor, shape (states,)
        p0 [Pa], inside the table.
    strength : Tensor, shape (states,)
        c = eps0 V0^2 / 4 [N].
    attraction : Attraction
        I(p) of each state.
    """
    light = torch.log(applied_pa)
    if attraction.touching is not None:
        light = attraction.touching.of_gap(light)
    log_limit = light + log(LIGHT_CONTACT_LIMIT)
    log_fold = _first_fold(applied_pa, attraction, log_limit)
    log_end = log_limit if log_fold is None else torch.minimum(log_fold, log_limit)
    end = torch.exp(log_end)
    bearable = (end - applied_pa) / attraction(log_end)[0]
    stable = strength <= bearable
    with torch.no_grad():
        # A drive of zero in place of one that has no root: it is found at once.
        bearing = torch.where(stable, strength, torch.zeros_like(strength))
        pressure = torch.where(stable, _root(applied_pa, bearing, attraction, end), end)
    # One more Newton step, recorded for autograd, carries the implicit derivative dp = -dF/F'.
    value, slope = attraction(torch.log(pressure))
    mismatch = pressure - applied_pa - strength * value
    stiffness = (1 - strength * slope / pressure).detach()
    usable = stable & (stiffness > 1e-9)
    step = mismatch / torch.where(usable, stiffness, torch.ones_like(stiffness))
    return Equilibrium(torch.where(usable, pressure - step, end), bearable, stable)


def end_of_voltage(applied_pa: Tensor, attraction: Callable[[Tensor], Attraction]) -> Tensor:
    """Strength at which light contact ends where I(p) itself falls with the strength.

    Parameters
    ----------
    applied_pa : Tensor, shape (states,)
        p0 [Pa].
    attraction : callable
        I(p) of each state at strengths [N], shape (states,).

    Returns
    -------
    Tensor, shape (states,)
        The strength c [N] at which `lowest_branch` with I of c ends; infinite where light contact
        bears `_FURTHEST` times the strength at which it would end without that fall. No gradients.
    """
    none = torch.zeros_like(applied_pa)

    def bearable(log_strength: Tensor) -> Tensor:
        found = lowest_branch(applied_pa, none, attraction(torch.exp(log_strength)))
        return torch.log(found.strength_at_end)

    with torch.no_grad():
        low = bearable(torch.full_like(applied_pa, -inf))  # I of no strength is the largest
        high = low + log(_FURTHEST)
        for_ever = bearable(high) > high
        if not bool(for_ever.all()):
            for _ in range(_BISECTIONS):
                middle = (low + high) / 2
                is_light = bearable(middle) > middle
                low, high = torch.where(is_light, middle, low), torch.where(is_light, high, middle)
        return torch.where(for_ever, torch.full_like(low, inf), torch.exp(low))


def _first_fold(applied_pa: Tensor, attraction: Attraction, log_limit: Tensor) -> Tensor | None:
    """Return ln p of the first fold of each state, infinite where there is none; None without any.

    The fold is where the slope of (p - p0)/I vanishes: ``1 - (1 - p0/p) dlnI/dlnp`` turns negative.
    """
    with torch.no_grad():
        nodes, step = attraction.nodes, attraction.log_gaps.step
        slopes = attraction.log_slopes()
        # 1 - p0/p is at most 1 - 1/31 on the branch, and below 1 for a finite size: the usual case
        # has no fold, and is spared the search.
        least = 1.0 if attraction.touching is not None else 1 / (1 - 1 / LIGHT_CONTACT_LIMIT)
        if float(slopes.max()) <= least:
            return None
        share = (1 - applied_pa[:, None] * torch.exp(-nodes)).clamp(min=0.0)
        own = slopes.T[attraction.column]
        if attraction.touching is not None:
            own = torch.stack([_log_slope(attraction, node) for node in nodes], -1)
        falling = (share * own > 1) & (nodes < log_limit[:, None] + step)
        has_fold, first = falling.max(dim=-1)
        if not bool(has_fold.any()):
            return None
        high = torch.where(has_fold, nodes[first], log_limit)
        low = torch.where(has_fold, torch.maximum(high - step, torch.log(applied_pa)), log_limit)
        for _ in range(_BISECTIONS):
            middle = (low + high) / 2
            rising = _rise(applied_pa, attraction, middle) >= 0
            low, high = torch.where(rising, middle, low), torch.where(rising, high, middle)
        curvature = _rise(applied_pa, attraction, low + _NEARBY)
        curvature = (curvature - _rise(applied_pa, attraction, low - _NEARBY)) / (2 * _NEARBY)
    # One Newton step, recorded by autograd: load and material move the fold.
    drift = _rise(applied_pa, attraction, low) / curvature.clamp(max=-_LEAST_CURVATURE)
    fold = low - (drift - drift.detach())
    return torch.where(has_fold, fold, torch.full_like(fold, inf))


def _log_slope(attraction: Attraction, log_pressure: Tensor) -> Tensor:
    """dlnI/dlnp of every state at one ln p."""
    value, slope = attraction(log_pressure.expand(attraction.column.shape))
    return slope / value


def _rise(applied_pa: Tensor, attraction: Attraction, log_pressure: Tensor) -> Tensor:
    """``1 - (1 - p0/p) dlnI/dlnp``: above 0 where (p - p0)/I rises with p."""
    value, slope = attraction(log_pressure)
    return 1 - (1 - applied_pa * torch.exp(-log_pressure)) * slope / value


def _root(applied_pa: Tensor, strength: Tensor, attraction: Attraction, end: Tensor) -> Tensor:
    """Newton from p0 upwards, with bisection whenever a step would leave the bracket.

    The unknown is ``w = p0/p``: where I is proportional to p the balance ``1 - w = c I/p`` is
    linear in it, so that few steps do even close to the critical voltage.
    """
    low, high, pressure = applied_pa, end, applied_pa
    patience = _STEPS_UNASKED if pressure.is_cuda else 1
    for number in range(1, _NEWTON_STEPS + 1):
        value, slope = attraction(torch.log(pressure))
        share = applied_pa / pressure
        lack = 1 - share - strength * value / pressure
        low = torch.where(lack < 0, pressure, low)
        high = torch.where(lack < 0, high, pressure)
        steepness = 1 + (1 / share - 1) * (1 - slope / value)
        trial = applied_pa / (share + lack / steepness)
        # At the root rounding decides on which side of it the bracket closes: a step that small
        # is taken wherever it leads.
        settled = (trial - pressure).abs() <= _SETTLED * pressure
        inside = (trial > low) & (trial < high)
        pressure = torch.where(inside | settled, trial, (low + high) / 2)
        if number % patience == 0 and bool(settled.all()):
            break
    return pressure
