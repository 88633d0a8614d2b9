"""The attraction of a batch of states as a function of the gap, for every kind of drive."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Self

import torch
from torch import Tensor

from haptix.contact.gaps import bin_inverse_square
from haptix.electro.dielectric import VACUUM_PERMITTIVITY

# In complete contact no gap is left to attract, and at no voltage nothing does; this share of what
# a gap of zero would add keeps logarithms finite there.
_LEAST_SHARE = 1e-15


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
    """The column of each state, shape (states,); not needed with weights."""
    weight: Tensor | None = None
    """Weights of the kernels, shape (columns, states of each, kernels); None where there is one
    kernel, of weight 1."""
    thickness_m: Tensor | None = None
    """h0 [m] of each column, real or complex, for the mean of a sine; None for other drives."""

    @classmethod
    def of_sine(
        cls, gap_edges_m: Tensor, voltage_v: Tensor, thickness_m: Tensor, column: Tensor
    ) -> Self:
        """Mean over the period of a sine of amplitude V0 [V], with h0 [m] for each column."""
        used, column = column.unique(return_inverse=True)
        thickness_m = thickness_m[used]
        kernel = bin_inverse_square(gap_edges_m, thickness_m)[:, None]
        spot = thickness_m.abs()[:, None] ** -2
        return cls(drive_strength(voltage_v), kernel, spot, column, None, thickness_m)

    @classmethod
    def of_field(cls, gap_edges_m: Tensor, field: Callable[[Tensor], Tensor]) -> Self:
        """Attraction ``eps0 E^2 / 2`` at instants.

        Parameters
        ----------
        field : callable
            E [V/m] in gaps [m], shape (instants, gaps); 0 is a contact spot.
        """
        stress = VACUUM_PERMITTIVITY / 2 * field(representative_gaps(gap_edges_m)) ** 2
        column = torch.arange(len(stress), device=stress.device)
        kernel, spot = stress[:, None, :-1], stress[:, -1:]
        return cls(torch.ones_like(spot[:, 0]), kernel, spot, column)

    @classmethod
    def of_ripple(
        cls, gap_edges_m: Tensor, voltage_v: Tensor, thickness_m: Tensor, swing: Tensor
    ) -> Self:
        """Attraction of sines whose part at twice the frequency is given, at instants of each.

        The squared field in a gap u is ``(|g|^2 + Re(g^2 swing)) / 2`` with ``g = 1/(u + h0)``.

        Parameters
        ----------
        voltage_v, thickness_m : Tensor, shape (sines,)
            Amplitude [V] and complex h0 [m] of each.
        swing : Tensor of complex, shape (sines, instants)
            ``exp(-2 i w t)``, times what a response leaves of it.
        """
        inverse = 1 / (representative_gaps(gap_edges_m) + thickness_m[:, None])
        square = inverse * inverse
        kernel = torch.stack([inverse.real**2 + inverse.imag**2, square.real, square.imag], 1)
        weight = torch.stack([torch.ones_like(swing.real), swing.real, -swing.imag], -1)
        strength = drive_strength(voltage_v)[:, None].expand(swing.shape).reshape(-1)
        return cls(strength, kernel[..., :-1], kernel[..., -1], weight=weight)

    @classmethod
    def of_squares(
        cls, gap_edges_m: Tensor, squares: Tensor, basis: Tensor, reference_m: float
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
        """
        stress = VACUUM_PERMITTIVITY / 2 * basis[None]
        gaps = bin_inverse_square(gap_edges_m, gap_edges_m.new_tensor(reference_m))
        kernel, spot = stress[..., :-1] * gaps, stress[..., -1] / reference_m**2
        return cls(squares.new_ones(len(squares)), kernel, spot, weight=squares[None])

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


def _weighted(each: Tensor, weight: Tensor) -> Tensor:
    """Sum over kernels: (distributions, columns, kernels) to (distributions, states)."""
    by_column = torch.bmm(each.transpose(0, 1), weight.transpose(1, 2))
    return by_column.transpose(0, 1).reshape(len(each), -1)


def representative_gaps(gap_edges_m: Tensor) -> Tensor:
    """A gap [m] for each bin, shape (bins + 1,), and 0 for a contact spot.

    The geometric mean of a bin's edges: where gaps are wide, 1/u^2 has its mean there.
    """
    return torch.cat([(gap_edges_m[:-1] * gap_edges_m[1:]).sqrt(), gap_edges_m[:1]])
