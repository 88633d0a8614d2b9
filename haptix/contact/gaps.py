"""The distribution of gaps as masses in bins, and its inverse-square mean."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

_NARROW = 0.05  # below, what five terms of the series leave out is t^10/11 < 1e-14


@dataclass(frozen=True)
class GapHistogram:
    """Share of the nominal area whose gap lies in each bin, open gaps only."""

    edges_m: Tensor
    """Bin edges [m], shape (bins + 1,), from 0 up; the last bin also holds everything above."""
    mass: Tensor
    """Shares, shape (..., bins); they sum to ``1 - A/A0``. Under the "combined" distribution the
    strips that are closed to double precision have no width and are left out: 1.2 % of A in light
    contact, but most of what is still open near complete contact, where "plain" is better."""

    def inverse_square(self, h0_m: Tensor) -> Tensor:
        """``sum over gaps of 1/|u + h0|^2`` [1/m^2]; `h0_m` broadcasts with the batch of masses."""
        kernel = bin_inverse_square(self.edges_m, h0_m)
        return (self.mass * kernel).sum(-1)


def bin_inverse_square(edges_m: Tensor, h0_m: Tensor) -> Tensor:
    """Mean of ``1/|u + h0|^2`` over each bin, for every h0: shape ``h0.shape + (bins,)``.

    With h0 = a + i b the integral is an arctangent; written as ``atan(t)/t / D`` with
    ``D = b^2 + (u_low + a)(u_high + a)`` it covers real and complex h0 without cancellation.
    """
    h0 = h0_m[..., None]
    real = h0.real if h0.is_complex() else h0
    imaginary = h0.imag if h0.is_complex() else torch.zeros_like(real)
    low, high = edges_m[:-1] + real, edges_m[1:] + real
    # |u + h0|^2 itself at the lower edge for the open-ended last bin: what lies there is noise.
    divisor = imaginary**2 + low * high
    t = (high - low) * imaginary.abs() / divisor
    # Nearly all bins are narrow against their gaps, where a series gives atan(t)/t.
    square = t * t
    if float(square.detach().max()) < _NARROW**2:
        ratio = 1 - square * (1 / 3 - square * (1 / 5 - square * (1 / 7 - square / 9)))
    else:
        safe = torch.where(t < 1e-3, torch.ones_like(t), t)
        ratio = torch.where(t < 1e-3, 1 - square / 3, torch.atan(safe) / safe)
    return ratio / divisor
