"""Equilibrium of applied pressure, contact pressure and attraction, on the lowest branch.

``p = p0 + c I(p)`` with ``c = eps0 V0^2 / 4`` (paper, Eq. 2 and 3). As the voltage rises from zero
p follows a branch that ends where ``c(p) = (p - p0) / I(p)`` has its first maximum: there the
contact snaps in. Between p0 and that fold c(p) is monotone, so the root is unique and bracketed.

For self-affine roughness I grows a little slower than p, and the snap is a steep rise instead of a
fold: within a few volts of the critical voltage p grows a hundredfold. There the contact is held by
its own attraction, so the light branch is taken to end at `LIGHT_CONTACT_LIMIT` times p0 at most.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import log

import torch
from torch import Tensor

from haptix.interpolation import UniformCubic

LIGHT_CONTACT_LIMIT = 31.0
"""Largest p/p0 that counts as light contact: the bound of the reference solver (section 5)."""

_BISECTIONS = 48
_NEWTON_STEPS = 80


@dataclass(frozen=True)
class Equilibrium:
    """Result per state, all tensors of the shape of the states."""

    pressure_pa: Tensor
    """Effective pressure p; at the end of the branch where there is no solution."""
    strength_at_fold: Tensor
    """Largest c = eps0 V0^2 / 4 [N] that the light contact bears."""
    is_stable: Tensor
    """True where a solution exists on the lowest branch."""


def lowest_branch(
    applied_pa: Tensor, strength: Tensor, log_attraction: UniformCubic, column: Tensor
) -> Equilibrium:
    """Solve a flat batch of states.

    Parameters
    ----------
    applied_pa : Tensor, shape (states,)
        p0 [Pa], inside the table.
    strength : Tensor, shape (states,)
        c = eps0 V0^2 / 4 [N].
    log_attraction : UniformCubic
        ln I [1/m^2] against ln p [Pa], one column per h0.
    column : Tensor of int, shape (states,)
        Which h0 each state has.
    """
    with torch.no_grad():
        log_end = _end_of_branch(applied_pa, log_attraction, column)
        end = torch.exp(log_end)
        bearable = (end - applied_pa) * torch.exp(-log_attraction(log_end, column))
        stable = strength <= bearable
        root = _root(applied_pa, strength, log_attraction, column, end)
        pressure = torch.where(stable, root, end)
    # One more Newton step, recorded for autograd, carries the implicit derivative dp = -dF/F'.
    log_value, slope = log_attraction.with_slope(torch.log(pressure), column)
    pull = strength * torch.exp(log_value)
    mismatch = pressure - applied_pa - pull
    stiffness = (1 - pull * slope / pressure).detach()
    usable = stable & (stiffness > 1e-9)
    step = mismatch / torch.where(usable, stiffness, torch.ones_like(stiffness))
    return Equilibrium(torch.where(usable, pressure - step, pressure), bearable, stable)


def _end_of_branch(applied_pa: Tensor, log_attraction: UniformCubic, column: Tensor) -> Tensor:
    """Ln p where the light branch ends: at the fold, or at the limit of light contact.

    The fold is where the slope of (p - p0)/I vanishes: ``1 - (1 - p0/p) dlnI/dlnp`` turns negative.
    """
    start, step = log_attraction.start, log_attraction.step
    nodes = start + step * torch.arange(
        log_attraction.values.shape[0], dtype=applied_pa.dtype, device=applied_pa.device
    )
    log_applied = torch.log(applied_pa)
    limit = log_applied + log(LIGHT_CONTACT_LIMIT)
    share = (1 - applied_pa[:, None] * torch.exp(-nodes)).clamp(min=0.0)
    falling = (share * log_attraction.slopes.T[column] > 1) & (nodes < limit[:, None] + step)
    has_fold, first = falling.max(dim=-1)
    if not bool(has_fold.any()):
        return limit
    high = torch.where(has_fold, nodes[first], limit)
    low = torch.where(has_fold, torch.maximum(high - step, log_applied), limit)
    for _ in range(_BISECTIONS):
        middle = (low + high) / 2
        _, slope = log_attraction.with_slope(middle, column)
        rising = (1 - applied_pa * torch.exp(-middle)) * slope <= 1
        low, high = torch.where(rising, middle, low), torch.where(rising, high, middle)
    return torch.minimum(low, limit)


def _root(
    applied_pa: Tensor,
    strength: Tensor,
    log_attraction: UniformCubic,
    column: Tensor,
    end: Tensor,
) -> Tensor:
    """Newton from p0 upwards, with bisection whenever a step would leave the bracket."""
    low, high, pressure = applied_pa, end, applied_pa
    for _ in range(_NEWTON_STEPS):
        log_value, slope = log_attraction.with_slope(torch.log(pressure), column)
        pull = strength * torch.exp(log_value)
        mismatch = pressure - applied_pa - pull
        low = torch.where(mismatch < 0, pressure, low)
        high = torch.where(mismatch < 0, high, pressure)
        trial = pressure - mismatch / (1 - pull * slope / pressure)
        inside = (trial > low) & (trial < high)
        following = torch.where(inside, trial, (low + high) / 2)
        settled = (following - pressure).abs() <= 1e-14 * pressure
        pressure = following
        if bool(settled.all()):
            break
    return pressure
