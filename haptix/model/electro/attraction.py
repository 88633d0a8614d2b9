"""The electrostatic attraction of each gap of a contact, for every kind of drive.

- `Circuit`: the contact as part of a circuit. Each gap is in series with the insulators, and all
  gaps and spots are in parallel (physics page, section 3): ``C = eps0 A0 eps_g <1/(u + h0)>``.
  Where an insulator or a gap conducts, C is complex: with ``exp(-i w t)`` the admittance is
  ``-i w C``, so that the conductance is ``w Im C``.
- `field_in_time`: the field in a gap over one period of any drive.
- `Pull`: the attraction in each gap, for every kind of drive.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, partial
from math import pi
from typing import Self

import torch
from torch import Tensor
from torch.nn.functional import embedding_bag

from haptix.model.contact.persson import bin_inverse_square
from haptix.model.electro.dielectric import VACUUM_PERMITTIVITY
from haptix.model.waves import Waveform

_HARMONICS = 99  # that are summed of a waveform with steps, whose series does not end
# In complete contact there are no gaps, and without voltage there is no attraction. This share of
# the attraction of a gap of zero is added, so that the logarithm is finite there.
_LEAST_SHARE = 1e-15
# Step of the lattice of insulators, in ln|h0| and in the angle of h0. A cubic through four nodes
# each way changes mu by less than 1e-5.
_LATTICE_STEP = 0.1
_TURNS = round(2 * pi / _LATTICE_STEP)
_MANY = 256  # insulators; fewer are computed one by one, and so do not depend on each other
_FEW = 16  # the same where more will follow
_NODES_EACH = 8.0  # nodes for each insulator, at most, where more will follow

FieldLimit = Callable[[Tensor], Tensor]
"""Largest field [V/m] in gaps of given widths [m]."""


def bin_inverse(gap_edges_m: Tensor, thickness_m: Tensor) -> Tensor:
    """Mean of ``1/(u + h0)`` [1/m] over each bin, shape ``thickness_m.shape + (bins,)``.

    It is the first two terms of a series about the bin's middle. Bins are 4 % wide, so that the
    rest is below 1e-7.
    """
    middle, width = (gap_edges_m[:-1] + gap_edges_m[1:]) / 2, gap_edges_m.diff()
    inverse = 1 / (middle + thickness_m[..., None])
    return inverse * (1 + (width * inverse) ** 2 / 12)


@dataclass(frozen=True)
class Circuit:
    """Insulators and gaps of states, at one frequency each, as parts of a circuit."""

    thickness_m: Tensor
    """h0 [m], real or complex, shape (columns,)."""
    medium: Tensor
    """Relative permittivity eps_g of the gap's filling, shape (columns,); divided by the unit of
    length where that is not 1 m."""
    column: Tensor
    """The column of each state, shape (states,)."""

    @classmethod
    def of_one(cls, thickness_m: Tensor, medium: Tensor, states: int) -> Circuit:
        """Return the circuit of states that have one column.

        Parameters
        ----------
        thickness_m : Tensor
            h0 [m], one number, real or complex.
        medium : Tensor
            Permittivity of what fills the gap, one number.
        states : int
            How many states there are.
        """
        column = torch.zeros(states, dtype=torch.long, device=thickness_m.device)
        return cls(thickness_m.reshape(1), medium.reshape(1), column)

    def part(self, at: slice | Tensor) -> Circuit:
        """Return some of the states."""
        return replace(self, column=self.column[at])

    def shared(self) -> Circuit:
        """Return the circuit with one column for all states of equal insulators and medium.

        Columns that autograd records stay separate, since each has its gradient.
        """
        if self.thickness_m.requires_grad or self.medium.requires_grad:
            return self
        alike = torch.zeros(len(self.medium), dtype=torch.long, device=self.medium.device)
        for number in (self.thickness_m + 0j, self.medium + 0j):
            for part in (number.real, number.imag):
                place = part.unique(return_inverse=True)[1]
                alike = (alike * len(place) + place).unique(return_inverse=True)[1]
        first = alike.new_zeros(int(alike.max()) + 1)
        first[alike] = torch.arange(len(alike), device=alike.device)
        return Circuit(self.thickness_m[first], self.medium[first], alike[self.column])

    def capacitance_f(self, gaps: Tensor, area_fraction: Tensor, area_m2: Tensor) -> Tensor:
        """Complex capacitance [F] of each state's contact, from its mean of ``1/(u + h0)`` [1/m].

        All broadcast with (states,).

        Parameters
        ----------
        gaps : Tensor
            Mean of ``1/(u + h0)`` over the open gaps [1/m].
        area_fraction : Tensor
            A/A0 of the spots.
        area_m2 : Tensor
        """
        inverse = gaps + area_fraction / self.thickness_m[self.column]
        return VACUUM_PERMITTIVITY * self.medium[self.column] * area_m2 * inverse


def field_in_time(
    waveform: Waveform,
    gap_m: Tensor,
    voltage_v: float,
    frequency_hz: float,
    thickness_m: Callable[[Tensor], Tensor],
    phase: Tensor,
) -> Tensor:
    """Field [V/m] in gaps at each phase of a periodic voltage, shape (phases, gaps).

    The voltage divides over insulators and gap harmonic by harmonic, with the complex thickness
    ``h0(n f)`` of each. The attraction follows from the square of their sum. That a sine attracts
    at twice its frequency, with a full ripple, is thus a result and not an assumption.

    Parameters
    ----------
    waveform : Waveform
        Shape of the voltage.
    gap_m : Tensor, shape (gaps,)
        Gaps [m]; 0 is the edge of a contact spot.
    voltage_v, frequency_hz : float
        Amplitude and fundamental frequency.
    thickness_m : callable
        Complex h0 [m] at frequencies [Hz]; 0 Hz is one of them where the waveform has a mean.
    phase : Tensor, shape (phases,)
        Phases [rad].
    """
    series = waveform.harmonics(waveform.highest_harmonic or _HARMONICS)
    # Voltages here go with exp(-i n w t), as ``eps2 = eps + i/(w eps0 rho)`` does.
    coefficient = torch.from_numpy(series.conj())
    used = coefficient.abs() > 0
    n = torch.arange(len(used), dtype=torch.float64)[used].to(phase.device)
    thickness = thickness_m(n * frequency_hz)[:, None]
    turn = torch.exp(-1j * n * phase[:, None])
    voltage = voltage_v * coefficient[used].to(phase.device) * turn
    return (voltage @ (1 / (gap_m + thickness))).real


def drive_strength(voltage_v: Tensor) -> Tensor:
    """``eps0 V0^2 / 4`` [N]: times ``<1/|u + h0|^2>`` it is the mean attraction (paper, Eq. 1).

    Examples
    --------
    >>> low, high = drive_strength(torch.tensor([100.0, 200.0], dtype=torch.float64))
    >>> round(float(high / low), 9)  # by the square of the voltage
    4.0
    """
    return VACUUM_PERMITTIVITY / 4 * voltage_v**2


def drive_voltage(strength: Tensor) -> Tensor:
    """Invert `drive_strength`: amplitude V0 [V].

    Examples
    --------
    >>> round(float(drive_voltage(drive_strength(torch.tensor(100.0, dtype=torch.float64)))), 9)
    100.0
    """
    return (4 / VACUUM_PERMITTIVITY * strength).sqrt()


@dataclass(frozen=True)
class Pull:
    """Attraction ``strength * sum_k weight_k kernel_k(u)`` of states on gaps u."""

    strength: Tensor
    """Factor of the attraction, such as ``eps0 V0^2/4`` [N], shape (states,)."""
    kernels: Callable[[], Tensor]
    """Returns `kernel`, which is computed only where it is used."""
    spot: Tensor
    """Kernels in a contact spot, shape (columns, kernels)."""
    column: Tensor | None = None
    """The column of each state, shape (states,); None where every state has a separate column."""
    weight: Tensor | None = None
    """Weights of the kernels, shape (columns, states per column, kernels); None for a single kernel
    of weight 1."""
    thickness_m: Tensor | None = None
    """h0 [m] of each column, real or complex, for the mean of a sine; None for other drives."""
    circuit: Circuit | None = None
    """The contact as part of a circuit, for terms of the supply."""
    most_pa: Tensor | None = None
    """Largest attraction [Pa] of each bin of gaps, shape (bins,), for `held`; None for no limit."""

    @cached_property
    def kernel(self) -> Tensor:
        """Mean over each bin of the contact's `gap_edges_m`, shape (columns, kernels, bins).

        The states of one column have the same insulator, instant or stroke.
        """
        return self.kernels()

    @classmethod
    def of_sine(
        cls,
        gap_edges_m: Tensor,
        voltage_v: Tensor,
        thickness_m: Tensor,
        column: Tensor,
        limit: FieldLimit | None = None,
    ) -> Self:
        """Mean over the period of a sine of amplitude V0 [V], with h0 [m] for each column.

        A `limit` makes the attraction depend on the voltage; `held` applies it.

        Parameters
        ----------
        gap_edges_m : Tensor, shape (bins + 1,)
            Edges of the bins of gaps [m].
        voltage_v : Tensor, shape (states,)
        thickness_m : Tensor, shape (columns,)
            h0 [m] of each column, real or complex.
        column : Tensor, shape (states,)
            The column of each state.
        limit : callable, optional
            Largest field [V/m] in gaps [m].
        """
        used, column = column.unique(return_inverse=True)
        thickness_m = thickness_m[used]
        kernels = partial(_of_sine, gap_edges_m, thickness_m)
        spot = thickness_m.abs()[:, None] ** -2
        most = None
        if limit is not None:
            most = drive_strength(limit(representative_gaps(gap_edges_m)[:-1]))
        return cls(drive_strength(voltage_v), kernels, spot, column, None, thickness_m, None, most)

    @classmethod
    def of_field(
        cls,
        gap_edges_m: Tensor,
        field: Callable[[Tensor], Tensor],
        limit: FieldLimit | None = None,
    ) -> Self:
        """Attraction ``eps0 E^2 / 2`` at instants.

        Parameters
        ----------
        gap_edges_m : Tensor, shape (bins + 1,)
            Edges of the bins of gaps [m].
        field : callable
            E [V/m] in gaps [m], shape (instants, gaps); 0 is a contact spot.
        limit : callable, optional
            Largest field [V/m] in gaps [m]: all instants are scaled until none exceeds it.
        """
        gaps = representative_gaps(gap_edges_m)
        stress = VACUUM_PERMITTIVITY / 2 * field(gaps) ** 2
        if limit is not None:
            stress = stress * _held(stress.amax(0) / (VACUUM_PERMITTIVITY / 2), limit(gaps) ** 2)
        kernel, spot = stress[:, None, :-1], stress[:, -1:]
        return cls(torch.ones_like(spot[:, 0]), lambda: kernel, spot)

    @classmethod
    def of_ripple(
        cls,
        gap_edges_m: Tensor,
        voltage_v: Tensor,
        thickness_m: Tensor,
        swing: Tensor,
        limit: FieldLimit | None = None,
    ) -> Self:
        """Attraction of sines at instants, from the part of the attraction at twice the frequency.

        The squared field in a gap u is ``(|g|^2 + Re(g^2 swing)) / 2`` with ``g = 1/(u + h0)``.

        Parameters
        ----------
        gap_edges_m : Tensor, shape (bins + 1,)
            Edges of the bins of gaps [m].
        voltage_v, thickness_m : Tensor, shape (sines,)
            Amplitude [V] and complex h0 [m] of each.
        swing : Tensor of complex, shape (sines, instants)
            ``exp(-2 i w t)``, times the factor by which a response weakens it.
        limit : callable, optional
            Largest amplitude of the field [V/m] in gaps [m].
        """
        inverse = 1 / (representative_gaps(gap_edges_m) + thickness_m[:, None])
        square = inverse * inverse
        kernel = torch.stack([inverse.real**2 + inverse.imag**2, square.real, square.imag], 1)
        if limit is not None:
            amplitude = voltage_v[:, None] ** 2 * kernel[:, 0]
            factor = _held(amplitude, limit(representative_gaps(gap_edges_m)) ** 2)
            kernel = kernel * factor[:, None]
        weight = torch.stack([torch.ones_like(swing.real), swing.real, -swing.imag], -1)
        strength = drive_strength(voltage_v)[:, None].expand(swing.shape).reshape(-1)
        return cls(strength, lambda: kernel[..., :-1], kernel[..., -1], weight=weight)

    @classmethod
    def of_squares(
        cls,
        gap_edges_m: Tensor,
        squares: Tensor,
        basis: Tensor,
        reference_m: float,
        limit: FieldLimit | None = None,
    ) -> Self:
        """Attraction by the squared field at a few points in the gap, ``eps0 E^2 / 2``.

        Parameters
        ----------
        gap_edges_m : Tensor, shape (bins + 1,)
            Edges of the bins of gaps [m].
        squares : Tensor, shape (states, points)
            ``(E (u + reference))^2`` [V^2] at the points.
        basis : Tensor, shape (points, bins + 1)
            Weight of each point in `representative_gaps`.
        reference_m : float
            The length that `squares` are referred to [m].
        limit : callable, optional
            Largest amplitude of the field [V/m] in gaps [m]. A squared field is limited to half of
            the amplitude's square, its mean: exact for a carrier, whose `squares` are means.
        """
        stress = VACUUM_PERMITTIVITY / 2 * basis[None]
        gaps = bin_inverse_square(gap_edges_m, gap_edges_m.new_tensor(reference_m))
        kernel, spot = stress[..., :-1] * gaps, stress[..., -1] / reference_m**2
        ones = squares.new_ones(len(squares))
        if limit is None:
            return cls(ones, lambda: kernel, spot, weight=squares[None])
        most = drive_strength(limit(representative_gaps(gap_edges_m)[:-1]))
        attraction = torch.minimum((squares @ kernel[0]).clamp(min=0.0), most)
        spot = (squares @ spot[0])[:, None].clamp(min=0.0)
        return cls(ones, lambda: attraction[:, None], spot)

    def held(self, strength: Tensor) -> Self:
        """Return the attraction, limited to `most_pa` in every gap, at strengths, shape (states,).

        Every state then has a separate column, because the kernel depends on the strength.
        """
        if self.most_pa is None or self.column is None:
            return self
        kernel = self.kernel[self.column]
        # This form has a gradient at a strength of 0 too.
        limited = kernel * (
            self.most_pa / torch.maximum(strength[:, None, None] * kernel, self.most_pa)
        )
        spot = self.spot[self.column]
        return replace(self, kernels=lambda: limited, spot=spot, column=None, most_pa=None)

    def on_gaps(self, mass: Tensor) -> Tensor:
        """Attraction per strength, shape (distributions, columns), for masses of gap bins.

        The columns are those of `own_column`.

        Parameters
        ----------
        mass : Tensor, shape (distributions, bins)
            Share of the area in each bin.
        """
        by_kernel: Tensor = torch.tensordot(mass, self.kernel, dims=([-1], [-1]))
        if self.weight is None:
            return by_kernel[..., 0] + _LEAST_SHARE * self.kernel[:, 0].amax(-1)
        # Where the field passes through zero, rounding may give slightly negative sums.
        least = _LEAST_SHARE * self.kernel.detach().abs().amax()
        return _weighted(by_kernel, self.weight).clamp(min=0.0) + least

    def on_lattice(self, keeps: bool = False) -> Lattice | None:
        """Return the insulators of a lattice from which those of `own_column` are interpolated.

        Returns None where the lattice would save nothing, or h0 has a gradient.

        Parameters
        ----------
        keeps : bool
            Whether many more insulators follow, which share the nodes.
        """
        h0 = self.thickness_m
        if h0 is None or self.column is None or h0.requires_grad:
            return None
        if len(h0) < (_FEW if keeps else _MANY):
            return None
        place, weight = _near_nodes(torch.log(h0.abs()) / _LATTICE_STEP)
        if h0.is_complex():
            turn, of_turn = _near_nodes(h0.angle() / _LATTICE_STEP)
            place = (place[:, :, None] * _TURNS + turn[:, None]).flatten(1)
            weight = (weight[:, :, None] * of_turn[:, None]).flatten(1)
        # Nodes are whole numbers of a small range: counting them takes less time than sorting.
        first = place.min()
        counts = torch.bincount((place - first).reshape(-1))
        used = counts.nonzero()[:, 0]
        if len(used) >= len(h0) * (_NODES_EACH if keeps else 1):
            return None
        number = (counts > 0).cumsum(0) - 1
        return Lattice(used + first, number[place - first], weight, h0.is_complex())

    def on_spots(self) -> Tensor:
        """Attraction per strength in a contact spot, for the columns of `own_column`."""
        if self.weight is None:
            return self.spot[:, 0]
        return _weighted(self.spot[None], self.weight)[0].clamp(min=0.0)

    @property
    def own_column(self) -> Tensor:
        """The column of `on_gaps` of each state; with weights every state has a separate one."""
        if self.column is not None:
            return self.column
        return torch.arange(len(self.strength), device=self.strength.device)


@dataclass(frozen=True)
class Lattice:
    """Insulators of a lattice, and the weights that interpolate others from them.

    The weights belong to a cubic in ln|h0| and, where h0 is complex, to a second one in its angle.
    """

    used: Tensor
    """Nodes, each a whole number, shape (nodes,)."""
    near: Tensor
    """Numbers in `used` of the nodes about each insulator, shape (columns, near)."""
    weights: Tensor
    """Weights of these nodes, of the same shape."""
    is_complex: bool
    """Whether h0 is complex."""

    def interpolated(self, values: Tensor, rows: Tensor | None = None) -> Tensor:
        """Return values at the insulators from those at nodes.

        Parameters
        ----------
        values : Tensor, shape (nodes, ...)
            Values at the nodes.
        rows : Tensor, shape (used,), optional
            The row of `values` of each node in use; by default they are in the order of `used`.
        """
        near = self.near if rows is None else rows[self.near]
        mixed: Tensor = embedding_bag(
            near, values.flatten(1), per_sample_weights=self.weights, mode="sum"
        )
        interpolated: Tensor = mixed.unflatten(1, values.shape[1:])
        return interpolated

    def pull(self, gap_edges_m: Tensor, used: Tensor) -> Pull:
        """Return the attraction at some of the nodes, in the order given.

        Parameters
        ----------
        gap_edges_m : Tensor, shape (bins + 1,)
            Edges of the bins of gaps [m].
        used : Tensor
            Nodes.
        """
        if self.is_complex:
            turn = (used + _TURNS // 2) % _TURNS - _TURNS // 2
            size, angle = ((used - turn) // _TURNS).to(self.weights), turn.to(self.weights)
            at = torch.polar(torch.exp(size * _LATTICE_STEP), angle * _LATTICE_STEP)
        else:
            at = torch.exp(used.to(self.weights) * _LATTICE_STEP)
        column = torch.arange(len(used), device=used.device)
        return Pull.of_sine(gap_edges_m, torch.zeros_like(at.real), at, column)


def _near_nodes(place: Tensor) -> tuple[Tensor, Tensor]:
    """Four whole numbers about each place, and Lagrange's weights of values there."""
    first = place.floor()
    x = (place - first)[:, None]
    weights = (
        -x * (x - 1) * (x - 2) / 6,
        (x + 1) * (x - 1) * (x - 2) / 2,
        -x * (x + 1) * (x - 2) / 2,
        x * (x + 1) * (x - 1) / 6,
    )
    return first.long()[:, None] + torch.arange(-1, 3, device=place.device), torch.cat(weights, -1)


def _of_sine(gap_edges_m: Tensor, thickness_m: Tensor) -> Tensor:
    """Kernel of the mean of a sine, for h0 [m] of each column."""
    return bin_inverse_square(gap_edges_m, thickness_m)[:, None]


def _held(square: Tensor, most: Tensor) -> Tensor:
    """Factor that limits squared fields to `most`; 1 for the last of each row, a contact spot."""
    factor = most / torch.maximum(square, most)
    return torch.cat([factor[..., :-1], torch.ones_like(factor[..., -1:])], -1)


def _weighted(each: Tensor, weight: Tensor) -> Tensor:
    """Sum over kernels: (distributions, columns, kernels) to (distributions, states)."""
    by_column = torch.bmm(each.transpose(0, 1), weight.transpose(1, 2))
    return by_column.transpose(0, 1).reshape(len(each), -1)


def representative_gaps(gap_edges_m: Tensor) -> Tensor:
    """One gap [m] for each bin, then 0 for a contact spot: shape (bins + 1,).

    A bin's gap is the geometric mean of its edges; for wide gaps 1/u^2 takes its mean value there.
    """
    return torch.cat([(gap_edges_m[:-1] * gap_edges_m[1:]).sqrt(), gap_edges_m[:1]])
