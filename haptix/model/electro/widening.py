"""Attraction beside the contact spots: it widens them, and the gaps keep less of their pull.

The attraction t(u) of a gap loads the contact where it acts. Gaps are ranked by size: the gap of
rank n is larger than a share n of the area, contact spots (A) included.

- The area is that at the pressure ``p_A = p0 + int g t dn``. A traction beside a spot drives the
  spot's edge outwards more than a distant one does. For spots in the form of periodic strips, ``g =
  sin th / sqrt(sin^2 th - sin^2 al)`` with ``th = pi n/2`` and ``al = pi A/2`` (Westergaard, J.
  Appl. Mech. 6, A49 (1939)). The mean of g is 1, so that an even attraction acts as a pressure.
- The mean gap moves as under the pressure ``p_g = p0 + int v t dn``, where ``v = (du/dp) /
  (dubar/dp)`` at constant n. By reciprocity (Betti), a traction moves the mean gap as much as the
  mean pressure moves the gap at the traction. So this sum is the virtual work of the attraction.
- The gaps are those at p_A, lifted while the load falls from p_A to p_g. Spots that stay as they
  are give a flat punch: the lift is linear in the load (Johnson, Kendall, Roberts, Proc. R. Soc. A
  324, 301 (1971)). Spots that open as they closed give the mean gap at p_g. The lift is the mean of
  these two: it then satisfies Maxwell's relation ``dubar/dc = -dC/dp0``, where c is the strength
  of the attraction and C the capacitance (docs/mean-field.md). Within reach of the attraction the
  gaps are lifted by half of that: a cohesive zone opens a crack half as far as its far field would
  (Dugdale, J. Mech. Phys. Solids 8, 100 (1960)).
- The gaps beside an edge close as in contact without attraction where the lift is small against the
  attraction's reach. Where it is large, they are lifted like the others (JKR). Let z be the lift
  over the reach. Between these limits a share ``z/(1 + z)`` of the lift counts; z follows from the
  factor ``(1 + z)^-2`` by which lifting all of these gaps would weaken their attraction. Below
  ranks of 0.03 A, v is a root that joins the mean field's own.
- Skin that yields sinks until the narrowest gaps close and the area bears the load. The yielded
  spots' area follows from the load alone: only that of elastic spots counts what acts beside them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from math import pi

import torch
from torch import Tensor

from haptix.model.contact.tables import differences, polynomial, polynomial_with_slope

_LIFT_STEPS = (0, 4, 10, 20, 34, 50)  # steps of the lattice from p_u to p_A: a ratio of up to 120
_PUNCH_SHARE = 0.5  # of a flat punch's lift, for gaps within reach of the attraction
_FIXED_SHARE = 0.5  # of a lift by spots that stay as they are; the rest is that of opening spots
_NEAR_EDGE = 0.03  # of the spots' area: ranks below which the mean field has gaps of no width
_STEEPEST = 4.0  # bound of v, above that of any gap: nearly empty bins have meaningless quotients
_TINY = 1e-300
_NONE_LEFT = 1e-9  # of gaps and edges where all of it yields: they need a logarithm
# ln p_A/p0 at which the effect of an attraction is computed; between them it is a polynomial.
_RISES = (0.0, 0.3, 0.9, 1.8, 2.8, 3.8, 4.8)
LARGEST_RISE = _RISES[-1]
"""Largest ln p_A/p0 of the table, beyond the end of light contact."""
_COLUMNS = 128  # computed together: few calls, and arrays that fit the CPU's cache
_NEWTON_STEPS = 2  # for the lift; more steps would move mu by 6e-12


@cache
def _monomials(places: tuple[float, ...]) -> Tensor:
    """Matrix from values at places to coefficients of 1, x, x^2, ..."""
    powers = torch.vander(torch.tensor(places, dtype=torch.float64), increasing=True)
    inverse: Tensor = torch.linalg.inv(powers)
    return inverse


def _combined(weights: Tensor, parts: Sequence[Tensor]) -> Tensor:
    """Sum of the parts with each row of weights, in a fixed order.

    A matrix product could give other bits for another number of nodes.
    """
    columns = weights.T.reshape(len(parts), -1, *[1] * parts[0].ndim)
    total = columns[0] * parts[0]
    for column, part in zip(columns[1:], parts[1:], strict=True):
        total = torch.addcmul(total, column, part)
    return total


def edge_weight(area: Tensor, open_share: Tensor) -> Tensor:
    """Return ``int (g - 1) dn`` from A to ``A + open_share``; the integral over all gaps is A.

    Parameters
    ----------
    area : Tensor
        A/A0.
    open_share : Tensor
        Share of the area in gaps up to some size; it broadcasts with `area`.
    """
    start = pi / 2 * area
    beyond = torch.minimum(pi / 2 * open_share, pi / 2 - start)
    # arccos(cos(start + beyond) / cos(start)), without cancellation where both are small.
    cosine = torch.cos(start).clamp(min=_TINY)
    fall = torch.sin(start + beyond / 2) * torch.sin(beyond / 2) / cosine
    angle = 2 * torch.asin(fall.clamp(0.0, 0.5).sqrt())
    return 2 / pi * (angle - beyond)


def sunk(edges_m: Tensor, mass: Tensor, closed: Tensor) -> Tensor:
    """Gaps of skin that sinks until a share of the area has closed: all are narrower by as much.

    Parameters
    ----------
    edges_m : Tensor, shape (bins + 1,)
        Edges of the bins [m].
    mass : Tensor, shape (nodes, bins)
        Share of the area in each bin.
    closed : Tensor, shape (nodes,)
        Share of the area that closes.
    """
    narrower = torch.cat([torch.zeros_like(mass[:, :1]), mass.cumsum(-1)], -1)
    closed = closed[:, None]
    above = torch.searchsorted(narrower.detach(), closed.detach()).clamp(1, mass.shape[1])
    low, high = narrower.gather(1, above - 1), narrower.gather(1, above)
    part = ((closed - low) / (high - low).clamp(min=_TINY)).clamp(0.0, 1.0)
    place = edges_m + torch.lerp(edges_m[above - 1], edges_m[above], part)
    above = torch.searchsorted(edges_m, place.detach()).clamp(1, mass.shape[1])
    part = ((place - edges_m[above - 1]) / (edges_m[above] - edges_m[above - 1])).clamp(0.0, 1.0)
    left = torch.lerp(narrower.gather(1, above - 1), narrower.gather(1, above), part) - closed
    return left.clamp(min=0.0).diff(dim=-1) + _NONE_LEFT * mass


@dataclass(frozen=True)
class LiftedGaps:
    """Gap distributions at the nodes of a table, for each of a few lifts."""

    lifts: Tensor
    """``ln p_A/p_u`` of each lift, shape (lifts,): the lifted gaps have the mean gap of p_u."""
    mass: Tensor
    """Share of the area in each bin of gaps, the same weighted by v, and the same weighted by
    g - 1, shape (nodes, 3, lifts, bins)."""

    @classmethod
    def of_table(
        cls,
        edges_m: Tensor,
        mass: Tensor,
        area: Tensor,
        mean_gap_m: Tensor,
        step: float,
        elastic: Tensor | None = None,
    ) -> LiftedGaps:
        """Lift the gaps of a table.

        Parameters
        ----------
        edges_m : Tensor, shape (bins + 1,)
            Edges of the bins [m].
        mass : Tensor, shape (nodes, bins)
            Share of the area in each bin.
        area : Tensor, shape (nodes,)
            A/A0.
        mean_gap_m : Tensor, shape (more + nodes,)
            Mean gap [m] at the nodes, and at the `more` nodes below them that the largest lift
            needs.
        step : float
            Step of ln p from node to node.
        elastic : Tensor, shape (nodes,), optional
            Share of the spots' area that does not yield; None for all.
        """
        nodes, more = len(mass), len(mean_gap_m) - len(mass)
        rank = area[:, None] + torch.cat([torch.zeros_like(area)[:, None], mass.cumsum(-1)], -1)
        rising, width = differences(rank) / step, edges_m.diff()
        work = ((rising[:, 1:] + rising[:, :-1]) / 2 * width).clamp(min=0.0)
        work = torch.where(mass > 0, work, torch.zeros_like(work))
        work = work / work.sum(-1, keepdim=True).clamp(min=_TINY)
        work = torch.minimum(work, _STEEPEST * mass)
        middle = torch.cat([edges_m[1:2] / 2, (edges_m[1:-1] * edges_m[2:]).sqrt()])
        reach = work / mass.clamp(min=_TINY)
        # The mean field's narrowest gaps have no width, and would stay closed. Beside an edge a
        # flat punch opens as the root of the distance.
        place = rank[:, 1:] - area[:, None] - mass / 2
        near = _NEAR_EDGE * area[:, None]
        first = torch.searchsorted(rank[:, 1:] - area[:, None], near).clamp(max=mass.shape[1] - 1)
        root = reach.gather(1, first) * (place / near.clamp(min=_TINY)).clamp(0.0, 1.0).sqrt()
        reach = torch.where(place < near, root, reach)
        low = mean_gap_m[more:]
        edge = edge_weight(area[:, None], rank[:, 1:] - area[:, None])
        edge = torch.cat([edge[:, :1], edge.diff(dim=-1)], -1).clamp(min=0.0)
        if elastic is not None:
            edge = edge * elastic.clamp(min=_NONE_LEFT)[:, None]
        moved, lifted = torch.stack([mass, work, edge], 1), []
        for steps in _LIFT_STEPS:
            lift = (mean_gap_m[more - steps : more - steps + nodes] - low).clamp(min=0.0)
            place = middle + _PUNCH_SHARE * lift[:, None] * reach
            above = torch.searchsorted(middle, place.detach()).clamp(1, len(middle) - 1)
            part = (place - middle[above - 1]) / (middle[above] - middle[above - 1])
            part, above = part.clamp(0.0, 1.0)[:, None], above[:, None].expand_as(moved)
            # A lifted bin is divided between the two bins about its new place.
            upper = torch.zeros_like(moved).scatter_add(-1, above, moved * part)
            lifted.append(upper.scatter_add(-1, above - 1, moved * (1 - part)))
        lifts = step * torch.tensor(_LIFT_STEPS, dtype=mass.dtype, device=mass.device)
        return cls(lifts, torch.stack(lifted, 2))

    def part(self, at: slice) -> LiftedGaps:
        """Return the gaps at some of the nodes."""
        return LiftedGaps(self.lifts, self.mass[at])


LOWER_NODES = _LIFT_STEPS[-1]
"""Nodes below a table at which `LiftedGaps.of_table` needs the mean gap."""


def by_rise(
    lifted: LiftedGaps, on_gaps: Callable[[Tensor], Tensor], rise: Tensor | None = None
) -> Tensor:
    """Polynomials of an attraction's effect against the rise ``ln p_A/p0`` that it causes.

    Parameters
    ----------
    lifted : LiftedGaps
        Gaps of the nodes.
    on_gaps : callable
        Attraction per strength of gap distributions, shape (distributions, columns).
    rise : Tensor, shape (nodes, columns), optional
        The rise of each column at each node, where it is known. The polynomials then are constants.

    Returns
    -------
    Tensor, shape (3, powers, nodes, columns)
        Coefficients of ln I, of ln of the gaps' share of I, and of the lift: ln of p_A over the
        pressure whose mean gap the contact has.
    """
    to_lifts = _monomials(tuple(lifted.lifts.tolist())).to(lifted.mass.device)
    bounds = -float(lifted.lifts[1]), float(lifted.lifts[-1])

    def of_columns(sums: Tensor, rises: Tensor) -> Tensor:
        pull, work, beside = sums.unbind(1)
        relative_lift = (beside[:, :1] / beside).clamp(min=1.0).sqrt() - 1  # z: lift over reach
        edge = beside[:, :1] / (1 + relative_lift**2 / (1 + relative_lift)) ** 2
        logs = torch.log(torch.stack([pull, edge, work]))
        return _at_rises(_combined(to_lifts, logs.unbind(2)), rises, bounds)

    sums = on_gaps(lifted.mass.flatten(0, 2)).unflatten(0, lifted.mass.shape[:3])
    columns = sums.split(_COLUMNS, -1)
    if rise is not None:
        parts = zip(columns, rise[None].split(_COLUMNS, -1), strict=True)
        return torch.cat([of_columns(*part) for part in parts], -1)
    rises = sums.new_tensor(_RISES)[:, None, None]
    results = torch.cat([of_columns(part, rises) for part in columns], -1)
    return _combined(_monomials(_RISES).to(results.device), results.unbind(1)).movedim(0, 1)


def _at_rises(parts: Tensor, rises: Tensor, bounds: tuple[float, float]) -> Tensor:
    """Ln I, ln of the gaps' share and the lift at rises.

    The parts are polynomials of the lift, shape (powers, 3, nodes, columns): ln of the gaps'
    attraction, of that at the edges, and of that weighted by v.
    """
    shares = -torch.expm1(-rises)  # of p_A: the part that is the attraction

    def lift_of(lift: Tensor) -> tuple[Tensor, Tensor]:
        """Lift that the attraction causes in gaps lifted by `lift`, and its slope."""
        values, slopes = polynomial_with_slope(parts.unbind(), lift[:, None])
        pull, spots, moved = torch.exp(values).unbind(1)
        pull_slope, spots_slope, moved_slope = slopes.unbind(1)
        total = pull + spots
        kept = moved / total
        total_slope = (pull * pull_slope + spots * spots_slope) / total
        left = (1 - shares * (1 - kept)).clamp(min=1e-9)  # p_g/p_A
        left_slope = shares * kept * (moved_slope - total_slope)
        opening, opening_slope = -torch.log(left), -left_slope / left
        lifted = torch.lerp(opening, 1 - left, _FIXED_SHARE)
        return lifted, torch.lerp(opening_slope, -left_slope, _FIXED_SHARE)

    # The lift is at most the rise. Newton's steps start there and fall to the fixed point.
    lift = (rises + torch.zeros_like(parts[0, 0])).detach().clamp(*bounds)
    with torch.no_grad():
        for _ in range(_NEWTON_STEPS):
            value, slope = lift_of(lift)
            lift = (lift + (value - lift) / (1 - slope)).clamp(*bounds)
    # One more step, recorded by autograd: contact and drive move the lift.
    value, slope = lift_of(lift)
    lift = (lift + (value - lift) / (1 - slope.detach())).clamp(*bounds)
    pull, spots = polynomial(parts[:, :2].unbind(), lift[:, None]).unbind(1)
    total = torch.logaddexp(pull, spots)
    return torch.stack([total, pull - total, lift])
