"""Equilibrium of applied pressure, contact pressure and attraction by the mean field.

``p = p0 + c I(p)`` with ``c = eps0 V0^2 / 4`` (paper, Eq. 2 and 3). As the voltage rises from zero,
p follows a branch. The branch ends where ``c(p) = (p - p0) / I(p)`` has its first maximum (a fold);
there the contact snaps in. Between p0 and the fold c(p) rises, so that the root is unique and
bracketed.

For self-affine roughness I grows a little more slowly than p, and the snap is a steep rise instead
of a fold: within a few volts of the critical voltage p grows a hundredfold. There mostly the
attraction holds the contact. The light branch therefore ends at `LIGHT_CONTACT_LIMIT` times p0 at
the latest. For a contact of finite size the touching pressure replaces p0 where it is larger.

`MeanFieldBalance` tabulates I(p); `ClosedForm` takes it as proportional to p.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from math import inf, log, pi, sqrt

import torch
from torch import Tensor

from haptix.model.contact.finite_size import Touching
from haptix.model.contact.tables import UniformCubic
from haptix.model.electro import Attraction, AttractionTable
from haptix.model.electro.attraction_table import WIDEST, WideningBranches
from haptix.model.fidelity.balance import (
    LIGHT_CONTACT_LIMIT,
    Ability,
    Balance,
    Contact,
    Fidelity,
    Load,
)
from haptix.model.terms import Stage

_BISECTIONS = 48
_FURTHEST = 1e4  # factor of the strength up to which an end is searched: a hundredfold voltage
_NEARBY = 1e-4  # in ln p: half the distance over which the curvature at the fold is taken
_LEAST_CURVATURE = 1e-6
_NEWTON_STEPS = 80
_STEPS_BETWEEN_CHECKS = 8  # on a GPU, where each check for convergence makes the CPU wait
_SETTLED = 1e-5  # relative: this step and the last one, which autograd records, square the error


@dataclass(frozen=True)
class Equilibrium:
    """Result per state, all tensors of the shape of the states."""

    pressure_pa: Tensor
    """Effective pressure p; at the end of the branch where there is no solution."""
    strength_at_end: Tensor
    """Largest c = eps0 V0^2 / 4 [N] at which the contact is light."""
    is_stable: Tensor
    """True where a solution exists on the lowest branch."""
    gaps: Tensor
    """I of the gaps alone."""
    log_gap_pressure: Tensor
    """ln of the pressure [Pa] whose mean gap the contact has."""


def lowest_branch(
    applied_pa: Tensor,
    strength: Tensor,
    attraction: Attraction | WideningBranches,
    of_end: bool = False,
) -> Equilibrium:
    """Solve a flat batch of states.

    Parameters
    ----------
    applied_pa : Tensor, shape (states,)
        p0 [Pa], inside the table.
    strength : Tensor, shape (states,)
        c = eps0 V0^2 / 4 [N].
    attraction : Attraction
        I(p) of each state.
    of_end : bool
        Whether the strength is a share of the one at which light contact ends.
    """
    light = torch.log(applied_pa)
    if attraction.touching is not None:
        light = attraction.touching.of_gap(light)
    light = light + log(LIGHT_CONTACT_LIMIT)
    if isinstance(attraction, WideningBranches):
        return Equilibrium(*attraction.solve(applied_pa, strength, light, of_end))
    log_limit = attraction.limit(light)
    log_fold = _first_fold(applied_pa, attraction, log_limit)
    log_end = log_limit if log_fold is None else torch.minimum(log_fold, log_limit)
    end = torch.exp(log_end)
    at_end = attraction(log_end)
    bearable = (end - applied_pa) / at_end[0]
    if of_end:
        strength = strength * bearable
    stable = strength <= bearable
    with torch.no_grad():
        # Where there is no root, a drive of zero is solved instead: it needs no steps.
        bearing = torch.where(stable, strength, torch.zeros_like(strength))
        start = _interpolated(applied_pa, bearing / bearable, attraction, end, at_end)
        root = _root(applied_pa, bearing, attraction, start, end)
        pressure = torch.where(stable, root, end)
    # One more Newton step, recorded for autograd, carries the implicit derivative dp = -dF/F'.
    value, slope = attraction(torch.log(pressure))
    mismatch = pressure - applied_pa - strength * value
    stiffness = (1 - strength * slope / pressure).detach()
    usable = stable & (stiffness > 1e-9)
    step = mismatch / torch.where(usable, stiffness, torch.ones_like(stiffness))
    pressure = torch.where(usable, pressure - step, end)
    at = torch.log(pressure)
    return Equilibrium(pressure, bearable, stable, attraction.gaps(at), attraction.of_gap(at))


def end_of_voltage(
    applied_pa: Tensor, attraction: Callable[[Tensor], Attraction | WideningBranches]
) -> Tensor:
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
        The strength c [N] at which `lowest_branch` ends if I is taken at c. It is infinite where
        the contact is still light at `_FURTHEST` times the strength at which it would end without
        that fall. It carries no gradients.
    """
    no_drive = torch.zeros_like(applied_pa)

    def bearable(log_strength: Tensor) -> Tensor:
        equilibrium = lowest_branch(applied_pa, no_drive, attraction(torch.exp(log_strength)))
        return torch.log(equilibrium.strength_at_end)

    with torch.no_grad():
        low = bearable(torch.full_like(applied_pa, -inf))  # I is largest at a strength of 0
        high = low + log(_FURTHEST)
        has_no_end = bearable(high) > high
        if not bool(has_no_end.all()):
            for _ in range(_BISECTIONS):
                middle = (low + high) / 2
                is_light = bearable(middle) > middle
                low, high = torch.where(is_light, middle, low), torch.where(is_light, high, middle)
        return torch.where(has_no_end, torch.full_like(low, inf), torch.exp(low))


def _first_fold(applied_pa: Tensor, attraction: Attraction, log_limit: Tensor) -> Tensor | None:
    """Return ln p of the first fold of each state, or None where no state has one.

    It is infinite for a state without a fold. At the fold the slope of (p - p0)/I is zero, and
    ``1 - (1 - p0/p) dlnI/dlnp`` turns negative.
    """
    with torch.no_grad():
        nodes, step = attraction.nodes, attraction.log_gaps.step
        slopes = attraction.log_slopes()
        # On the branch 1 - p0/p is at most 1 - 1/31, and below 1 for a finite size. Where the
        # slopes are too small for a fold, as usual, there is no search.
        least = 1.0 if attraction.touching is not None else 1 / (1 - 1 / LIGHT_CONTACT_LIMIT)
        if float(slopes.max()) <= least:
            return None
        share = (1 - applied_pa[:, None] * torch.exp(-nodes)).clamp(min=0.0)
        of_state = slopes.T[attraction.column]
        if attraction.slope_varies:
            of_state = torch.stack([_log_slope(attraction, node) for node in nodes], -1)
        falling = (share * of_state > 1) & (nodes < log_limit[:, None] + step)
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


def _interpolated(
    applied_pa: Tensor,
    share: Tensor,
    attraction: Attraction,
    end: Tensor,
    at_end: tuple[Tensor, Tensor],
) -> Tensor:
    """Pressure at a share of the strength that ends the branch, with I and dI/dlnp there.

    ``w = p0/p`` is a cubic of the strength. It has the slopes of the branch at both ends, but no
    more than three times the mean slope, so that it falls all the way.
    """
    least = applied_pa / end
    fall = 1 - least
    value, slope = at_end
    first = fall / least * attraction(torch.log(applied_pa))[0] / value
    last = least * fall / (1 - fall * slope / value).clamp(min=_LEAST_CURVATURE)
    first, last = first.clamp(max=3 * fall), last.clamp(max=3 * fall)
    rest = 1 - share
    bend = share * rest * ((fall - first) * rest + (last - fall) * share)
    return applied_pa / (1 - fall * share + bend)


def _root(
    applied_pa: Tensor, strength: Tensor, attraction: Attraction, start: Tensor, end: Tensor
) -> Tensor:
    """Newton's method, with bisection whenever a step would leave the bracket from p0 to the end.

    The unknown is ``w = p0/p``. Where I is proportional to p, the balance ``1 - w = c I/p`` is
    linear in w, so that few steps suffice even close to the critical voltage.
    """
    low, high, pressure = applied_pa, end, start
    settled = torch.zeros_like(pressure, dtype=torch.bool)
    patience = _STEPS_BETWEEN_CHECKS if pressure.is_cuda else 1
    for number in range(1, _NEWTON_STEPS + 1):
        value, slope = attraction(torch.log(pressure))
        share = applied_pa / pressure
        lack = 1 - share - strength * value / pressure
        low = torch.where(lack < 0, pressure, low)
        high = torch.where(lack < 0, high, pressure)
        steepness = 1 + (1 / share - 1) * (1 - slope / value)
        trial = applied_pa / (share + lack / steepness)
        # Near the root rounding decides which side of the bracket moves. A step as small as that
        # is taken even if it leaves the bracket. A settled state does not depend on the others.
        small = (trial - pressure).abs() <= _SETTLED * pressure
        inside = (trial > low) & (trial < high)
        trial = torch.where(inside | small, trial, (low + high) / 2)
        pressure, settled = torch.where(settled, pressure, trial), settled | small
        if number % patience == 0 and bool(settled.all()):
            break
    return pressure


class MeanFieldBalance(Fidelity):
    """Equilibria from a table that is solved once, and again when a load lies outside it."""

    name = "mean-field"
    assumes = "averages the attraction over the contact"
    honours = frozenset(Stage)
    can = frozenset({Ability.TABULATE, Ability.INSTANTS, Ability.RESCALE})

    def __init__(self, contact: Contact) -> None:
        super().__init__(contact)
        # A table belongs to one autograd graph, and must not outlive it.
        hardness = contact.hardness_pa
        is_learned = isinstance(hardness, Tensor) and hardness.requires_grad
        self._keeps_table = not (contact.field.stress_variance.requires_grad or is_learned)
        self._kept: AttractionTable | None = None
        self._log_mean_gap: UniformCubic | None = None
        self._touching: tuple[Tensor, Touching] | None = None
        self._widened = contact.contact_spots == "widened"
        self._yields_at = hardness if self._widened else None

    def borrow(self, other: Fidelity) -> bool:
        """Use the table of another fidelity with the same mean field; return whether it did.

        Area fraction, finite size and contact spots may differ, since the table does not depend on
        them; only widened spots need a table that was made for them, and for their hardness.
        """
        if not isinstance(other, MeanFieldBalance) or other._kept is None:
            return False
        if self.contact.field is not other.contact.field:
            return False
        if self._widened and other._kept.lifted is None:
            return False
        if self._yields_at != other._yields_at:  # it closes gaps of the table
            return False
        self._kept, self._log_mean_gap = other._kept, other._log_mean_gap
        return True

    def prepare(self, applied_pa: Tensor, widest_gap_m: Tensor | None) -> None:
        """Solve the table for all of these loads."""
        if not self._keeps_table and widest_gap_m is not None:
            self._log_mean_gap = self.contact.field.log_mean_gap()
        table = self._table(applied_pa, self._touching_of(widest_gap_m))
        if not self._keeps_table:
            self._kept = table  # until `release`: all blocks of states share one table

    def release(self) -> None:
        """Drop a table that autograd records."""
        if not self._keeps_table:
            self._kept, self._log_mean_gap = None, None

    def solve(self, load: Load) -> Balance:
        """Return the equilibrium of every state on the lowest branch."""
        pull, touching = load.pull, self._touching_of(load.widest_gap_m)
        table = self._table(load.applied_pa, touching)
        spots_attract = self.contact.contact_spots == "included"
        area_fraction = self.contact.area_fraction
        supply = None
        if load.voltage_share is not None:
            assert pull.circuit is not None and load.area_m2 is not None  # the solver sees to it
            supply = table.supply(
                pull.circuit, load.area_m2, load.voltage_share, area_fraction, touching
            )
        spots = area_fraction if spots_attract else None
        # Discharge limits the gaps at the voltage on the contact at rest: no state has more.
        rest = table.at(supply, load.applied_pa)

        def at(strength: Tensor) -> Attraction | WideningBranches:
            attracted = pull.held(strength * rest)
            return table.attraction(
                attracted, spots, touching, supply, load.applied_pa, by_contact=load.of_end
            )

        equilibrium = lowest_branch(load.applied_pa, pull.strength, at(pull.strength), load.of_end)
        end = equilibrium.strength_at_end
        if pull.most_pa is not None:
            end = end_of_voltage(load.applied_pa, at)
        pressure = equilibrium.pressure_pa
        area = area_fraction(pressure)
        # A state past the end of its branch has the values at the end, and so the voltage there.
        strength = pull.strength * equilibrium.strength_at_end if load.of_end else pull.strength
        strength = torch.minimum(strength, equilibrium.strength_at_end)
        left = table.at(supply, pressure)
        return Balance(
            pressure_pa=pressure,
            area_fraction=area,
            gap_attraction_pa=strength * equilibrium.gaps,
            spot_attraction_pa=strength * left * area * pull.on_spots()[pull.own_column],
            mean_gap_m=torch.exp(table.log_mean_gap(equilibrium.log_gap_pressure)),
            strength_at_end=end,
            is_stable=equilibrium.is_stable,
            voltage_share=left.sqrt(),
        )

    def gap_mass(
        self, applied_pa: Tensor, widest_gap_m: Tensor | None, pressure_pa: Tensor
    ) -> Tensor:
        """Return the table's masses at the pressures of solved states.

        For a contact of finite size they are the masses that its attraction uses.
        """
        touching, log_pressure = self._touching_of(widest_gap_m), torch.log(pressure_pa)
        table = self._table(applied_pa, touching)
        return table.mass_at(
            log_pressure if touching is None else touching.of_pull(log_pressure)[0]
        )

    def _table(self, applied_pa: Tensor, touching: Touching | None) -> AttractionTable:
        """Table that covers these loads up to the end of light contact."""
        low, high = map(float, applied_pa.detach().aminmax())
        high *= LIGHT_CONTACT_LIMIT
        if touching is not None:
            with torch.no_grad():
                light = touching.of_gap(torch.log(applied_pa)) + log(LIGHT_CONTACT_LIMIT)
                high = max(high, float(torch.exp(touching.of_gap(light).max())))
        if self._widened:  # the spots' own share of p comes on top of the gaps'
            high *= WIDEST
        lowest, highest = low, high
        if self._kept is not None:
            if self._kept.covers(low, high):
                # With gradients the whole table is used: `part` drops the stencil that they need.
                return self._kept.part(low, high) if self._keeps_table else self._kept
            nodes = self._kept.log_pressure.exp()
            lowest, highest = min(low, float(nodes[0])), max(high, float(nodes[-1]))
        hardness, split = self._yields_at, None
        if hardness is not None:
            split = partial(self.contact.plastic_split, hardness_pa=hardness)
        field, widened = self.contact.field, self._widened
        table = AttractionTable.solve(field, lowest, highest, widened, split)
        if not self._keeps_table:
            return table
        self._kept = table
        return table.part(low, high)

    def _touching_of(self, widest_gap_m: Tensor | None) -> Touching | None:
        """Finite size of states with these heights of the highest asperity."""
        if widest_gap_m is None:
            return None
        # `prepare` and `solve` come with the same states; with gradients nothing is cached.
        keeps = self._keeps_table and not widest_gap_m.requires_grad
        if keeps and self._touching and torch.equal(self._touching[0], widest_gap_m):
            return self._touching[1]
        table = self._log_mean_gap
        if table is None:
            table = self.contact.field.log_mean_gap()
            if self._keeps_table:
                self._log_mean_gap = table
        touching = self.contact.field.touching(widest_gap_m, table)
        if keeps:
            self._touching = widest_gap_m, touching
        return touching


class ClosedForm(Fidelity):
    """Equilibria by the critical-voltage formula, without a table.

    In light contact area and attraction are proportional to p. With ``I(p, h0) = Lambda(h0) p`` the
    equilibrium is ``p = p0 / (1 - (V0/Vc)^2)``, where ``Vc = 2 / sqrt(eps0 Lambda)`` (physics page,
    section 3). Lambda is that of the mean field at one pressure. In fact it falls slowly with
    pressure, which is the error of this fidelity.
    """

    name = "closed-form"
    assumes = "assumes light elastic contact of infinite size, attracted in proportion to its load"
    honours = frozenset(Stage) - {Stage.GAPS, Stage.HARDNESS, Stage.PULL, Stage.SUPPLY}
    can = frozenset({Ability.TABULATE, Ability.INSTANTS})

    def __init__(self, contact: Contact) -> None:
        super().__init__(contact)
        field = contact.field
        pressure = torch.tensor([1.0, 1.1], dtype=torch.float64, device=field.device)
        pressure = contact.reference_pa * pressure
        self._mass = field.gap_histogram(pressure[:1]).mass
        gap = field.mean_gap(pressure)
        self._gap_m = gap[0]
        self._gap_fall_m = (gap[0] - gap[1]) / torch.log(pressure[1] / pressure[0])
        # The law of light contact, erf t = 2 t / sqrt(pi), whatever the reference pressure.
        light = 2 / sqrt(pi) * field.area.light
        self._area_per_pa = light * field.relative_pressure(pressure[0]) / pressure[0]

    def gap_mass(
        self, applied_pa: Tensor, widest_gap_m: Tensor | None, pressure_pa: Tensor
    ) -> Tensor:
        """Return the masses at the reference pressure: light contact keeps their proportions."""
        return self._mass.expand(len(pressure_pa), -1)

    def solve(self, load: Load) -> Balance:
        """Return the equilibrium of every state on the lowest branch."""
        column, strength = load.pull.own_column, load.pull.strength
        gap_pull = load.pull.on_gaps(self._mass)[0] / self.contact.reference_pa
        spot_pull = self._area_per_pa * load.pull.on_spots()
        spots_attract = self.contact.contact_spots == "included"
        loading = (gap_pull + spot_pull if spots_attract else gap_pull)[column]
        end = 1 - 1 / LIGHT_CONTACT_LIMIT
        strength = strength * (end / loading) if load.of_end else strength
        share = strength * loading
        pressure = load.applied_pa / (1 - share.clamp(max=end))
        attraction = torch.minimum(strength, end / loading) * pressure
        # In light contact the mean gap falls with ln p.
        fall = self._gap_fall_m * torch.log(pressure / self.contact.reference_pa)
        return Balance(
            pressure_pa=pressure,
            area_fraction=(self._area_per_pa * pressure).clamp(max=1.0),
            gap_attraction_pa=attraction * gap_pull[column],
            spot_attraction_pa=attraction * spot_pull[column],
            mean_gap_m=(self._gap_m - fall).clamp(min=0.0),
            strength_at_end=end / loading,
            is_stable=share <= end,
            voltage_share=torch.ones_like(pressure),
        )
