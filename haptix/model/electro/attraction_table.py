"""The whole contact's attraction against pressure, tabulated once per solid.

`AttractionTable` holds the gaps of a contact at the pressures of a lattice. `Attraction` is the
attraction that loads a batch of states; `WideningAttraction` replaces it where the attraction
beside the spots widens them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from math import ceil, exp, floor, log

import torch
from torch import Tensor

from haptix.base.native import doubles, ffi, library, room
from haptix.model.contact import MeanField
from haptix.model.contact.area import PlasticSplit
from haptix.model.contact.finite_size import Touching
from haptix.model.contact.persson import LATTICE_STEP, GapHistogram
from haptix.model.contact.tables import UniformCubic, polynomial, polynomial_with_slope
from haptix.model.electro.attraction import Circuit, Lattice, Pull, bin_inverse
from haptix.model.electro.widening import LARGEST_RISE, LOWER_NODES, LiftedGaps, by_rise, sunk

_MARGIN = 3  # nodes beyond the ends, so that every slope in use has its full stencil
_LIFTED_MARGIN = 2  # further nodes: lifted gaps are themselves differences from node to node
_TINY = 1e-300
_LIMIT_STEPS = 2
_STEEPNESS = 0.05, 1.0  # bounds of the slope of ln(p0 + gaps' attraction) against ln p_A

# States, and states per column, from which torch's cubics of whole columns are the cheaper way.
_STATES, _STATES_PER_COLUMN = 2048, 32
_ROWS = 7  # of nodes, as room for the library in C
_CONTACTS_PER_COLUMN = 4  # up to which each contact has a table of its own
_DRIVES = 8  # of each contact, from which it has one too
_CONTACTS = 256  # whose tables are made together: their arrays fit the CPU's cache
_MOST_EFFECTS = 1024  # insulators of the lattice whose effects are kept, at 20 kB each

WIDEST = 4.0
"""Largest ratio of p_A to the sum of applied pressure and the gaps' attraction."""

AreaFraction = Callable[[Tensor], Tensor]
"""A/A0 at pressures [Pa]: elastic, or elastoplastic."""

VoltageShare = Callable[[Tensor], Tensor]
"""Complex share of the drive's voltage that lies on a contact, from its capacitance [F]."""


class _LatticeEffects:
    """Effects of attractions at insulators of the lattice, each computed once."""

    def __init__(self, edges_m: Tensor, lifted: LiftedGaps) -> None:
        self._edges, self._lifted = edges_m, lifted
        # The row of each node, and the effects. They are replaced together, for other threads.
        self._kept: tuple[dict[tuple[bool, int], int], list[Tensor]] = {}, []

    def of(self, places: Lattice) -> Tensor:
        """Return the effects at the insulators, shape (columns, powers, 3, nodes)."""
        keys = [(places.is_complex, node) for node in places.used.tolist()]
        rows, effects = self._kept if len(self._kept[0]) <= _MOST_EFFECTS else ({}, [])
        new = [number for number, key in enumerate(keys) if key not in rows]
        if new:
            pull = places.pull(self._edges, places.used[new])
            with torch.no_grad():
                more = by_rise(self._lifted, pull.on_gaps).permute(3, 1, 0, 2)
            rows = rows | {keys[number]: len(rows) + row for row, number in enumerate(new)}
            effects = [torch.cat([*effects, more])]
            self._kept = rows, effects
        at = torch.tensor([rows[key] for key in keys], device=places.used.device)
        return places.interpolated(effects[0], at)


@dataclass(frozen=True)
class AttractionTable:
    """Gap distributions and mean gaps at pressures on a logarithmic lattice."""

    contact: MeanField
    log_pressure: Tensor
    """ln p [Pa] of the nodes."""
    gaps: GapHistogram
    """Gap distribution at each node."""
    log_mean_gap: UniformCubic
    """ln of the mean gap [m] against ln p."""
    lifted: LiftedGaps | None = None
    """The gaps lifted by the attraction, where it widens the spots."""
    kept_effects: tuple[_LatticeEffects, int] | None = None
    """Effects at insulators of the lattice, of a table of which this one begins at that node."""

    @classmethod
    def solve(
        cls,
        contact: MeanField,
        lowest_pa: float,
        highest_pa: float,
        widened: bool = False,
        split: Callable[[Tensor], PlasticSplit] | None = None,
    ) -> AttractionTable:
        """Tabulate from `lowest_pa` to `highest_pa`; `widened` also tabulates the lifted gaps.

        Parameters
        ----------
        contact : MeanField
            The rough contact.
        lowest_pa, highest_pa : float
            Pressures [Pa] that the table must cover.
        widened : bool
            Whether the attraction widens the contact spots.
        split : callable, optional
            Areas that yield and that do not at pressures [Pa], where widened spots yield.
        """
        anchor = float(torch.log(contact.stress_rms_pa.detach()))
        margin = _MARGIN + _LIFTED_MARGIN
        first = floor((log(lowest_pa) - anchor) / LATTICE_STEP) - margin
        last = ceil((log(highest_pa) - anchor) / LATTICE_STEP) + margin
        log_pressure = contact.log_lattice(first, last)
        mass, edges_m = contact.lattice_mass(first, last), contact.gap_edges_m
        more = LOWER_NODES if widened else 0
        mean_gap = contact.lattice_mean_gap(first - more, last)
        lifted = None
        if widened:
            area, elastic = contact.area_fraction(torch.exp(log_pressure)), None
            if split is not None:
                yielding = split(torch.exp(log_pressure))
                mass = sunk(edges_m, mass, (yielding.total - area).clamp(min=0.0))
                area, elastic = yielding.total, yielding.elastic / yielding.total
            lifted = LiftedGaps.of_table(edges_m, mass, area, mean_gap, LATTICE_STEP, elastic)
        log_gap = torch.log(mean_gap[more:].clamp(min=_TINY))
        log_mean_gap = UniformCubic.through(log_pressure[0], LATTICE_STEP, log_gap)
        effects = None if lifted is None else (_LatticeEffects(edges_m, lifted), 0)
        gaps = GapHistogram(edges_m, mass)
        return cls(contact, log_pressure, gaps, log_mean_gap, lifted, effects)

    def covers(self, lowest_pa: float, highest_pa: float) -> bool:
        """Whether every slope between these pressures has its full stencil.

        Parameters
        ----------
        lowest_pa, highest_pa : float
        """
        margin = _MARGIN + _LIFTED_MARGIN
        low = exp(float(self.log_pressure[margin].detach()))
        high = exp(float(self.log_pressure[-1 - margin].detach()))
        return low <= lowest_pa and highest_pa <= high

    def part(self, lowest_pa: float, highest_pa: float) -> AttractionTable:
        """Return the nodes that are used between these pressures, which must be covered.

        Parameters
        ----------
        lowest_pa, highest_pa : float
        """
        start, last = self.log_pressure[0].detach(), len(self.log_pressure)
        first = max(0, floor((log(lowest_pa) - float(start)) / LATTICE_STEP) - _MARGIN)
        last = min(last, ceil((log(highest_pa) - float(start)) / LATTICE_STEP) + _MARGIN + 1)
        at, gap = slice(first, last), self.log_mean_gap
        log_pressure = self.log_pressure[at]
        return replace(
            self,
            log_pressure=log_pressure,
            gaps=replace(self.gaps, mass=self.gaps.mass[at]),
            log_mean_gap=replace(
                gap, start=log_pressure[0], values=gap.values[at], slopes=gap.slopes[at]
            ),
            lifted=None if self.lifted is None else self.lifted.part(at),
            kept_effects=self.kept_effects and (self.kept_effects[0], self.kept_effects[1] + first),
        )

    def mass_at(self, log_pressure: Tensor) -> Tensor:
        """Share of the area in each bin of gaps at ln p, shape (states, bins)."""
        cell, part = self._cell(log_pressure)
        low, high = (self.gaps.mass.index_select(0, cell + k) for k in (0, 1))
        return torch.lerp(low, high, part[:, None])

    def attraction(
        self,
        pull: Pull,
        spots: AreaFraction | None = None,
        touching: Touching | None = None,
        supply: Tensor | None = None,
        applied_pa: Tensor | None = None,
        by_contact: bool = False,
    ) -> Attraction | WideningBranches:
        """Attraction of a batch of states against pressure.

        Parameters
        ----------
        pull : Pull
            Attraction of each gap.
        spots, touching
            Fields of `Attraction`.
        supply : Tensor, shape (nodes, states), optional
            ln of the squared share of the voltage, from the method `supply`.
        applied_pa : Tensor, shape (states,), optional
            p0 [Pa], needed where the attraction widens the spots.
        by_contact : bool
            Whether neighbouring states mostly differ in the drive alone, and share a table.
        """
        if self.lifted is not None and applied_pa is not None:
            return self._widening(self.lifted, pull, touching, supply, applied_pa, by_contact)
        log_gaps, column = torch.log(pull.on_gaps(self.gaps.mass)), pull.own_column
        spot_pull = None if spots is None else pull.on_spots()
        log_supply = None
        if supply is not None:  # the share of the voltage differs by state: so does the column
            log_supply = self._against_pressure(supply)
            log_gaps = log_gaps[:, column]
            spot_pull = None if spot_pull is None else spot_pull[column]
            column = torch.arange(len(column), device=column.device)
        gaps = self._against_pressure(log_gaps)
        return Attraction(gaps, column, spot_pull, spots, touching, log_supply)

    def _widening(
        self,
        lifted: LiftedGaps,
        pull: Pull,
        touching: Touching | None,
        supply: Tensor | None,
        applied_pa: Tensor,
        by_contact: bool,
    ) -> WideningAttraction | WideningBranches:
        log_applied, column = torch.log(applied_pa), pull.own_column
        if pull.column is None:  # every column belongs to one state, and so has one p0
            effect = by_rise(lifted, pull.on_gaps, self._rise(log_applied).T)
            powers, skipped = effect.permute(3, 1, 0, 2), 0
        else:
            powers, skipped = self._by_powers(lifted, pull, by_contact)
        recorded = [powers, applied_pa, pull.strength]
        recorded += [] if touching is None else [touching.log_pressure]
        is_plain = not any(part.requires_grad or part.is_cuda for part in recorded)
        is_few = by_contact or len(column) < _STATES + _STATES_PER_COLUMN * len(powers)
        if supply is None and is_plain and is_few:
            start = float(self.log_pressure[0]) - skipped * LATTICE_STEP
            return WideningBranches(start, powers, column, touching, by_contact)
        powers = powers[..., skipped : skipped + len(self.log_pressure)]
        first = torch.ones_like(column, dtype=torch.bool)
        first[1:] = (column[1:] != column[:-1]) | (applied_pa[1:] != applied_pa[:-1])
        most = max(_CONTACTS_PER_COLUMN * len(powers), len(column) // _DRIVES)
        if by_contact and supply is None and int(first.sum()) <= most:
            # Contacts whose states differ in the drive alone: each has one p0.
            of_contact, each = first.nonzero()[:, 0], powers.unbind(1)
            rise = self._rise(log_applied[of_contact])[:, None]
            parts = column[of_contact].split(_CONTACTS), rise.split(_CONTACTS)
            effects = [_at_rise(each, *part) for part in zip(*parts, strict=True)]
            effect = torch.cat(effects).permute(1, 2, 0)[:, None].contiguous()
            column = first.cumsum(0) - 1
        else:
            effect = powers.permute(2, 1, 3, 0).contiguous()
            if supply is not None:
                effect = effect[..., column]
                column = torch.arange(len(column), device=column.device)
        total, pulled, lift = (self._against_pressure(part.movedim(0, 1)) for part in effect)
        log_supply = None if supply is None else self._against_pressure(supply)
        return WideningAttraction(
            total, column, None, None, touching, log_supply, log_applied, pulled, lift
        )

    def _rise(self, log_applied: Tensor) -> Tensor:
        """Ln p_A/p0 of contacts at the nodes, shape (contacts, nodes), where it is fitted."""
        rise = self.log_pressure - log_applied[:, None]
        return rise.clamp(-_MARGIN * LATTICE_STEP, LARGEST_RISE)

    def _by_powers(self, lifted: LiftedGaps, pull: Pull, by_contact: bool) -> tuple[Tensor, int]:
        """Coefficients of `by_rise`, shape (columns, powers, 3, nodes), and nodes to skip first."""
        places = pull.on_lattice(keeps=by_contact)
        if places is None:
            return by_rise(lifted, pull.on_gaps).permute(3, 1, 0, 2).contiguous(), 0
        # The effect is smooth in h0, and an interpolation is far cheaper than computing it.
        if self.kept_effects is None or lifted.mass.requires_grad:
            lattice = places.pull(self.gaps.edges_m, places.used)
            effect = by_rise(lifted, lattice.on_gaps).permute(3, 1, 0, 2)
            return places.interpolated(effect), 0
        effects, start = self.kept_effects
        return effects.of(places), start

    def supply(
        self,
        circuit: Circuit,
        area_m2: Tensor,
        share: VoltageShare,
        area_fraction: AreaFraction,
        touching: Touching | None,
    ) -> Tensor:
        """Return ln of the squared share of the voltage at each node, shape (nodes, states).

        Parameters
        ----------
        circuit : Circuit
            Insulators and gaps of the states.
        area_m2 : Tensor, shape (states,)
            Apparent areas A0 [m^2].
        share : callable
            Share of the voltage that a capacitance [F] gets.
        area_fraction : callable
            A/A0 at pressures [Pa].
        touching : Touching or None
            Finite size of each state.
        """
        mass, edges = self.gaps.mass, self.gaps.edges_m
        inverse = bin_inverse(edges, circuit.thickness_m)
        gaps = mass.to(inverse.dtype) @ inverse.T
        if touching is None:
            gaps = gaps[:, circuit.column]
        else:
            cell, part = self._cell(touching.of_pull(self.log_pressure[:, None])[0])
            low, high = (gaps[cell + k, circuit.column] for k in (0, 1))
            gaps = torch.lerp(low, high, part.to(gaps.dtype))
        spots = area_fraction(torch.exp(self.log_pressure))[:, None]
        left = share(circuit.capacitance_f(gaps, spots, area_m2))
        return 2 * torch.log(left.abs())

    def at(self, supply: Tensor | None, pressure_pa: Tensor) -> Tensor:
        """Squared share of the voltage of each state at a pressure [Pa], see `supply`.

        Parameters
        ----------
        supply : Tensor or None
            What `supply` returned; None for the whole voltage.
        pressure_pa : Tensor, shape (states,)
            Pressure of each state [Pa].
        """
        if supply is None:
            return torch.ones_like(pressure_pa)
        states = torch.arange(len(pressure_pa), device=pressure_pa.device)
        return torch.exp(self._against_pressure(supply)(torch.log(pressure_pa), states))

    def _cell(self, log_pressure: Tensor) -> tuple[Tensor, Tensor]:
        """Node below ln p of any shape, and the share of the step to the next one."""
        place = (log_pressure - self.log_pressure[0]) / LATTICE_STEP
        cell = place.detach().floor().clamp(0, len(self.log_pressure) - 2).long()
        return cell, place - cell

    def _against_pressure(self, values: Tensor) -> UniformCubic:
        return UniformCubic.through(self.log_pressure[0], LATTICE_STEP, values)


@dataclass(frozen=True)
class Attraction:
    """``I(p)`` of a batch of states: the attraction that loads the contact, per drive strength."""

    log_gaps: UniformCubic
    """ln of the gaps' share against ln p, one column per thickness."""
    column: Tensor
    """The column of each state."""
    spot_pull: Tensor | None = None
    """Attraction of a contact spot in each column, such as ``1/|h0|^2``."""
    spots: AreaFraction | None = None
    """A/A0 at pressures [Pa], where the attraction inside the spots loads the contact."""
    touching: Touching | None = None
    """Finite size of each state, which makes its gaps narrower than those of an infinite
    contact."""
    log_supply: UniformCubic | None = None
    """ln of the squared share of the drive's voltage on the contact, against ln p."""

    def gaps(self, log_pressure: Tensor) -> Tensor:
        """I of the gaps alone at ln p, shape (states,)."""
        return torch.exp(self._log_gaps(log_pressure)[0]) * self.supply(log_pressure)

    def of_gap(self, log_pressure: Tensor) -> Tensor:
        """Ln of the pressure whose mean gap a contact at ln p has, shape (states,)."""
        return log_pressure if self.touching is None else self.touching.of_gap(log_pressure)

    def limit(self, log_limit: Tensor) -> Tensor:
        """Ln p at which ln of applied pressure plus gaps' attraction is `log_limit`, by state."""
        return log_limit

    def supply(self, log_pressure: Tensor) -> Tensor:
        """Squared share of the drive's voltage on the contact at ln p, shape (states,)."""
        if self.log_supply is None:
            return torch.ones_like(log_pressure)
        return torch.exp(self.log_supply(log_pressure, self.column))

    def __call__(self, log_pressure: Tensor) -> tuple[Tensor, Tensor]:
        """I and dI/dlnp at ln p, shape (states,)."""
        log_gaps, slope = self._log_gaps(log_pressure)
        value = torch.exp(log_gaps)
        slope = value * slope
        if self.spot_pull is not None and self.spots is not None:
            area, area_slope = _with_slope(self.spots, log_pressure)
            weight = self.spot_pull[self.column]
            value, slope = value + weight * area, slope + weight * area_slope
        if self.log_supply is not None:
            log_share, log_slope = self.log_supply.with_slope(log_pressure, self.column)
            share = torch.exp(log_share)
            value, slope = value * share, (slope + value * log_slope) * share
        return value, slope

    def _log_gaps(self, log_pressure: Tensor) -> tuple[Tensor, Tensor]:
        if self.touching is None:
            return self.log_gaps.with_slope(log_pressure, self.column)
        at, share = self.touching.of_pull(log_pressure)
        value, slope = self.log_gaps.with_slope(at, self.column)
        return value, slope * share

    @property
    def slope_varies(self) -> bool:
        """Whether dlnI/dlnp of states of one column differs from `log_slopes`."""
        return self.touching is not None

    @property
    def nodes(self) -> Tensor:
        """Return ln p of the table's nodes."""
        count = self.log_gaps.values.shape[0]
        steps = torch.arange(count, dtype=torch.float64, device=self.column.device)
        return self.log_gaps.start + self.log_gaps.step * steps

    def log_slopes(self) -> Tensor:
        """dlnI/dlnp at the nodes of each column, shape (nodes, columns), for infinite size.

        These slopes suffice to exclude a fold: finite size only lowers the gaps' part of the slope,
        and the spots' part is below 1.
        """
        slope = self.log_gaps.slopes
        if self.spot_pull is not None and self.spots is not None:
            gaps = torch.exp(self.log_gaps.values)
            area, area_slope = _with_slope(self.spots, self.nodes)
            area, area_slope = area[:, None] * self.spot_pull, area_slope[:, None] * self.spot_pull
            slope = (gaps * slope + area_slope) / (gaps + area)
        return slope if self.log_supply is None else slope + self.log_supply.slopes


@dataclass(frozen=True)
class WideningAttraction(Attraction):
    """``I(p_A)`` of attractions that widen the contact spots, at p0 of each state.

    `log_gaps` holds ln I. Its parts are coefficients of the powers of ``ln p_A/p0``. Where each
    column has one p0, there is a single coefficient (`haptix.model.electro.widening`). The gaps are
    always those at p_A, as the size law "mean-gap" has it.
    """

    log_applied: Tensor = field(default_factory=lambda: torch.empty(0))
    """ln p0 [Pa] of each state."""
    log_share: UniformCubic | None = None
    """ln of the gaps' share of I, in the same form."""
    lift: UniformCubic | None = None
    """ln of p_A over the pressure whose mean gap the contact has, in the same form."""

    def gaps(self, log_pressure: Tensor) -> Tensor:
        """I of the gaps alone at ln p, shape (states,)."""
        share = self._at(self.log_share, log_pressure).clamp(max=0.0)
        return torch.exp(self._at(self.log_gaps, log_pressure) + share) * self.supply(log_pressure)

    def of_gap(self, log_pressure: Tensor) -> Tensor:
        """Ln of the pressure whose mean gap a contact at ln p has, shape (states,)."""
        return super().of_gap(log_pressure - self._at(self.lift, log_pressure).clamp(min=0.0))

    @property
    def slope_varies(self) -> bool:
        """Whether dlnI/dlnp of states of one column differs from `log_slopes`."""
        return self.log_gaps.values.shape[1] > 1

    def limit(self, log_limit: Tensor) -> Tensor:
        """Ln p at which ln of applied pressure plus gaps' attraction is `log_limit`, by state."""
        last, at = log_limit + log(WIDEST), log_limit + log(WIDEST) / 2
        with torch.no_grad():
            for _ in range(_LIMIT_STEPS):
                at = (at + self._limit_step(log_limit, at)).clamp(log_limit, last)
        # One more step, recorded by autograd: load and material move the limit. The gaps'
        # attraction is at most the whole one, so that the result is at least `log_limit`.
        return (at + self._limit_step(log_limit, at)).clamp(log_limit, last)

    def _limit_step(self, log_limit: Tensor, log_pressure: Tensor) -> Tensor:
        """Newton's step of ln p to the limit."""
        log_share, slope = self._with_slope(self.log_share, log_pressure)
        rise, share = log_pressure - self.log_applied, torch.exp(log_share)
        gaps = torch.expm1(rise) * share  # over p0
        steepness = ((torch.exp(rise) * share + gaps * slope) / (1 + gaps)).detach()
        lack = log_limit - self.log_applied - torch.log1p(gaps)
        return lack / steepness.clamp(*_STEEPNESS)

    def log_slopes(self) -> Tensor:
        """Largest dlnI/dlnp over all rises, at the nodes of each column, taken as p0."""
        steepest = self.log_gaps.slopes[:, 0]
        if self.slope_varies:
            device = self.column.device
            rises = torch.linspace(0, LARGEST_RISE, 13, dtype=torch.float64, device=device)
            values = self.log_gaps.values.detach()[..., None].unbind(1)
            slopes = self.log_gaps.slopes[..., None].unbind(1)
            steep = polynomial(slopes, rises) + polynomial_with_slope(values, rises)[1]
            steepest = steep.amax(-1)
        return steepest if self.log_supply is None else steepest + self.log_supply.slopes

    def _log_gaps(self, log_pressure: Tensor) -> tuple[Tensor, Tensor]:
        return self._with_slope(self.log_gaps, log_pressure)

    def _at(self, table: UniformCubic | None, log_pressure: Tensor) -> Tensor:
        """Value at ln p of a table whose parts are coefficients."""
        assert table is not None
        cubics, t = table.cubic(log_pressure, self.column)
        return polynomial(polynomial(cubics.unbind(1), self._rise(log_pressure)).unbind(), t)

    def _rise(self, log_pressure: Tensor) -> Tensor:
        """Ln p_A/p0 within the fitted range: the polynomials grow without bound beyond it."""
        return (log_pressure - self.log_applied).clamp(max=LARGEST_RISE)

    def _with_slope(self, table: UniformCubic | None, at: Tensor) -> tuple[Tensor, Tensor]:
        """Value and slope at ln p of a table whose parts are coefficients."""
        assert table is not None
        cubics, t = table.cubic(at, self.column)
        # Of each coefficient of the cubic, the polynomial in the rise.
        values, by_rise = polynomial_with_slope(cubics.unbind(1), self._rise(at))
        value, slope = polynomial_with_slope(values.unbind(), t)
        return value, slope / table.step + polynomial(by_rise.unbind(), t)


@dataclass(frozen=True)
class WideningBranches:
    """The same attractions as plain numbers, whose equilibria the library in C finds.

    It takes the steps that torch takes with a `WideningAttraction`, where gradients are recorded.
    """

    start: float
    """ln p_A [Pa] of the first node."""
    powers: Tensor
    """Coefficients of `by_rise`, shape (columns, powers, 3, nodes)."""
    column: Tensor
    """The column of each state."""
    touching: Touching | None
    """Finite size of each state."""
    by_contact: bool
    """Whether states that differ in the drive alone share one function of ln p_A."""

    def solve(
        self, applied_pa: Tensor, strength: Tensor, log_limit: Tensor, of_end: bool
    ) -> tuple[Tensor, ...]:
        """Return the fields of `haptix.model.fidelity.mean_field.Equilibrium`, in their order.

        Parameters
        ----------
        applied_pa, strength : Tensor, shape (states,)
            p0 [Pa] and c [N].
        log_limit : Tensor, shape (states,)
            ln of applied pressure plus gaps' attraction at which light contact ends.
        of_end : bool
            Whether the strength is a share of the one at which light contact ends.
        """
        effect = doubles(self.powers.numpy())
        table = ffi.new(
            "hx_widening *",
            {
                "start": self.start,
                "step": LATTICE_STEP,
                "nodes": self.powers.shape[-1],
                "powers": self.powers.shape[1],
                "effect": effect,
                "least_rise": -_MARGIN * LATTICE_STEP,
                "largest_rise": LARGEST_RISE,
                "log_widest": log(WIDEST),
                "flattest": _STEEPNESS[0],
                "steepest": _STEEPNESS[1],
                "by_contact": self.by_contact,
            },
        )
        solved = [torch.empty_like(applied_pa) for _ in range(4)]
        stable = torch.empty(len(applied_pa), dtype=torch.bool)
        pressure, at_end, gaps, lift = (doubles(part.numpy()) for part in solved)
        library.hx_widening_branches(
            table,
            len(applied_pa),
            ffi.from_buffer("int64_t *", self.column.contiguous().numpy()),
            *(doubles(part.numpy()) for part in (applied_pa, log_limit, strength)),
            of_end,
            room(_ROWS * self.powers.shape[-1])[1],
            pressure,
            at_end,
            ffi.from_buffer("uint8_t *", stable.numpy()),
            gaps,
            lift,
        )
        of_gap = torch.log(solved[0]) - solved[3].clamp(min=0.0)
        of_gap = of_gap if self.touching is None else self.touching.of_gap(of_gap)
        return solved[0], solved[1], stable, solved[2], of_gap


def _at_rise(powers: Sequence[Tensor], column: Tensor, rise: Tensor) -> Tensor:
    """Polynomials of columns at rises, shape (contacts, 1, nodes)."""
    return polynomial([power.index_select(0, column) for power in powers], rise)


def _with_slope(area_fraction: AreaFraction, log_pressure: Tensor) -> tuple[Tensor, Tensor]:
    """A/A0 and dA/dlnp; the slope serves Newton's steps only and carries no gradient."""
    with torch.enable_grad():
        at = log_pressure.detach().requires_grad_()
        (slope,) = torch.autograd.grad(area_fraction(torch.exp(at)).sum(), at)
    return area_fraction(torch.exp(log_pressure)), slope
