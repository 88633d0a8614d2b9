"""The electrostatic attraction of each gap of a contact, for every kind of drive.

- `Circuit`: the contact as part of a circuit. Each gap is in series with the insulators, and all
  gaps and spots are side by side (physics page, section 3): ``C = eps0 A0 eps_g <1/(u + h0)>``.
  Where an insulator or a gap conducts, C is complex: with ``exp(-i w t)`` the admittance is
  ``-i w C``, so that the conductance is ``w Im C``.
- `field_in_time`, `Pull`: the field in a gap, and what it attracts, for every kind of drive.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Self

import torch
from torch import Tensor

from haptix.contact.meanfield import bin_inverse_square
from haptix.electro.dielectric import VACUUM_PERMITTIVITY
from haptix.waves import Waveform

_HARMONICS = 99  # of a wave with steps
# In complete contact no gap is left to attract, and at no voltage nothing does; this share of what
# a gap of zero would add keeps logarithms finite there.
_LEAST_SHARE = 1e-15

FieldLimit = Callable[[Tensor], Tensor]
"""Largest field [V/m] in gaps of given widths [m]."""


def bin_inverse(gap_edges_m: Tensor, thickness_m: Tensor) -> Tensor:
    """Mean of ``1/(u + h0)`` [1/m] over each bin, shape ``thickness_m.shape + (bins,)``.

    The two first terms about the bin's middle: bins are 4 % wide, which leaves out 1e-7.
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
    """eps_g of what fills the gap, shape (columns,); over the unit of length, where that is not
    1 m."""
    column: Tensor
    """The column of each state, shape (states,)."""

    @classmethod
    def of_one(cls, thickness_m: Tensor, medium: Tensor, states: int) -> Circuit:
        """Return the circuit of states that have one column."""
        column = torch.zeros(states, dtype=torch.long, device=thickness_m.device)
        return cls(thickness_m.reshape(1), medium.reshape(1), column)

    def part(self, at: slice | Tensor) -> Circuit:
        """Return some of the states."""
        return replace(self, column=self.column[at])

    def capacitance_f(self, gaps: Tensor, area_fraction: Tensor, area_m2: Tensor) -> Tensor:
        """Complex capacitance [F] of each state's contact, from its mean of ``1/(u + h0)`` [1/m].

        Shapes broadcast with (states,): the gaps' mean, A/A0 of the spots and A0 [m^2].
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
    ``h0(n f)`` of each. The attraction follows from the square of the field that they add up to. So
    a sine attracts at twice its frequency, with a full ripple; this is a result and not an
    assumption.

    Parameters
    ----------
    waveform : Waveform
        Shape of the voltage.
    gap_m : Tensor, shape (gaps,)
        Gaps [m]; 0 is the edge of a contact spot.
    voltage_v, frequency_hz : float
        Amplitude and fundamental frequency.
    thickness_m : callable
        Complex h0 [m] at frequencies [Hz], zero among them where the waveform has a mean.
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
    """``eps0 V0^2 / 4`` [N]: times ``<1/|u + h0|^2>`` it is the mean attraction (paper, Eq. 1)."""
    return VACUUM_PERMITTIVITY / 4 * voltage_v**2


def drive_voltage(strength: Tensor) -> Tensor:
    """Invert `drive_strength`: amplitude V0 [V]."""
    return (4 / VACUUM_PERMITTIVITY * strength).sqrt()


@dataclass(frozen=True)
class Pull:
    """Attraction ``strength * sum_k weight_k kernel_k(u)`` of states on gaps u."""

    strength: Tensor
    """Factor of the attraction, such as ``eps0 V0^2/4`` [N], shape (states,)."""
    kernel: Tensor
    """Mean over each bin of the contact's `gap_edges_m`, shape (columns, kernels, bins). A column
    is what states have in common: an insulator, an instant or a stroke."""
    spot: Tensor
    """Kernels in a contact spot, shape (columns, kernels)."""
    column: Tensor | None = None
    """The column of each state, shape (states,); None where each has one of its own."""
    weight: Tensor | None = None
    """Weights of the kernels, shape (columns, states of each, kernels); None where there is one
    kernel, of weight 1."""
    thickness_m: Tensor | None = None
    """h0 [m] of each column, real or complex, for the mean of a sine; None for other drives."""
    circuit: Circuit | None = None
    """The contact as part of a circuit, for terms of the supply."""
    most_pa: Tensor | None = None
    """Largest attraction [Pa] of each bin of gaps, shape (bins,), for `held`; None for no limit."""

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

        Its dependence on the voltage, where a `limit` makes one, is left to `held`.
        """
        used, column = column.unique(return_inverse=True)
        thickness_m = thickness_m[used]
        kernel = bin_inverse_square(gap_edges_m, thickness_m)[:, None]
        spot = thickness_m.abs()[:, None] ** -2
        most = None
        if limit is not None:
            most = drive_strength(limit(representative_gaps(gap_edges_m)[:-1]))
        return cls(drive_strength(voltage_v), kernel, spot, column, None, thickness_m, None, most)

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
        field : callable
            E [V/m] in gaps [m], shape (instants, gaps); 0 is a contact spot.
        limit : callable, optional
            Field [V/m] at which the largest of these instants is held, in gaps [m].
        """
        gaps = representative_gaps(gap_edges_m)
        stress = VACUUM_PERMITTIVITY / 2 * field(gaps) ** 2
        if limit is not None:
            stress = stress * _held(stress.amax(0) / (VACUUM_PERMITTIVITY / 2), limit(gaps) ** 2)
        kernel, spot = stress[:, None, :-1], stress[:, -1:]
        return cls(torch.ones_like(spot[:, 0]), kernel, spot)

    @classmethod
    def of_ripple(
        cls,
        gap_edges_m: Tensor,
        voltage_v: Tensor,
        thickness_m: Tensor,
        swing: Tensor,
        limit: FieldLimit | None = None,
    ) -> Self:
        """Attraction of sines whose part at twice the frequency is given, at instants of each.

        The squared field in a gap u is ``(|g|^2 + Re(g^2 swing)) / 2`` with ``g = 1/(u + h0)``.

        Parameters
        ----------
        voltage_v, thickness_m : Tensor, shape (sines,)
            Amplitude [V] and complex h0 [m] of each.
        swing : Tensor of complex, shape (sines, instants)
            ``exp(-2 i w t)``, times what a response leaves of it.
        limit : callable, optional
            Field [V/m] at which amplitudes are held, in gaps [m].
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
        return cls(strength, kernel[..., :-1], kernel[..., -1], weight=weight)

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
        squares : Tensor, shape (states, points)
            ``(E (u + reference))^2`` [V^2] at the points.
        basis : Tensor, shape (points, bins + 1)
            Weight of each point in `representative_gaps`.
        reference_m : float
            The length that `squares` are referred to [m].
        limit : callable, optional
            Amplitude of the field [V/m] in gaps [m] at whose mean square, half of its square, the
            squares are held: exact for a carrier, whose squares are means.
        """
        stress = VACUUM_PERMITTIVITY / 2 * basis[None]
        gaps = bin_inverse_square(gap_edges_m, gap_edges_m.new_tensor(reference_m))
        kernel, spot = stress[..., :-1] * gaps, stress[..., -1] / reference_m**2
        ones = squares.new_ones(len(squares))
        if limit is None:
            return cls(ones, kernel, spot, weight=squares[None])
        most = drive_strength(limit(representative_gaps(gap_edges_m)[:-1]))
        each = torch.minimum((squares @ kernel[0]).clamp(min=0.0), most)
        return cls(ones, each[:, None], (squares @ spot[0])[:, None].clamp(min=0.0))

    def held(self, strength: Tensor) -> Self:
        """Return the attraction whose gaps have `most_pa` at most, at strengths, shape (states,).

        Every state then has a column of its own: a drive of another strength has another kernel.
        """
        if self.most_pa is None or self.column is None:
            return self
        kernel = self.kernel[self.column]
        # Written so that no drive at all has a gradient too.
        kernel = kernel * (
            self.most_pa / torch.maximum(strength[:, None, None] * kernel, self.most_pa)
        )
        return replace(self, kernel=kernel, spot=self.spot[self.column], column=None, most_pa=None)

    def on_gaps(self, mass: Tensor) -> Tensor:
        """Attraction per strength, shape (distributions, own columns), for masses of gap bins.

        Parameters
        ----------
        mass : Tensor, shape (distributions, bins)
            Share of the area in each bin.
        """
        each: Tensor = torch.tensordot(mass, self.kernel, dims=([-1], [-1]))
        if self.weight is None:
            return each[..., 0] + _LEAST_SHARE * self.kernel[:, 0].amax(-1)
        # Rounding leaves a little below zero where the field passes through it.
        least = _LEAST_SHARE * self.kernel.detach().abs().amax()
        return _weighted(each, self.weight).clamp(min=0.0) + least

    def on_spots(self) -> Tensor:
        """Attraction per strength in a contact spot, shape (own columns,)."""
        if self.weight is None:
            return self.spot[:, 0]
        return _weighted(self.spot[None], self.weight)[0].clamp(min=0.0)

    @property
    def own_column(self) -> Tensor:
        """Which of the columns of `on_gaps` each state has: with weights, one of its own."""
        if self.column is not None:
            return self.column
        return torch.arange(len(self.strength), device=self.strength.device)


def _held(square: Tensor, most: Tensor) -> Tensor:
    """Factor of squared fields that holds these at most; the last of each, a spot, is no gap."""
    factor = most / torch.maximum(square, most)
    return torch.cat([factor[..., :-1], torch.ones_like(factor[..., -1:])], -1)


def _weighted(each: Tensor, weight: Tensor) -> Tensor:
    """Sum over kernels: (distributions, columns, kernels) to (distributions, states)."""
    by_column = torch.bmm(each.transpose(0, 1), weight.transpose(1, 2))
    return by_column.transpose(0, 1).reshape(len(each), -1)


def representative_gaps(gap_edges_m: Tensor) -> Tensor:
    """A gap [m] for each bin, shape (bins + 1,), and 0 for a contact spot.

    The geometric mean of a bin's edges: where gaps are wide, 1/u^2 has its mean there.
    """
    return torch.cat([(gap_edges_m[:-1] * gap_edges_m[1:]).sqrt(), gap_edges_m[:1]])
