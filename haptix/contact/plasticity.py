"""Elastoplastic contact: the stress distribution is cut off at the hardness.

In Persson's theory the distribution of contact stress P(sigma) broadens by diffusion as shorter
waves are added, with the variance ``tau^2 / 2`` at magnification zeta. Stress that falls to zero is
area lost, stress that rises to the hardness sigma_Y is area that yields: two absorbing walls.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi

import torch
from torch import Tensor

_TERMS = 40
# Both series converge to double precision within _TERMS on their own side of this ratio.
_SPREAD_AT_SWITCH = 0.08


@dataclass(frozen=True)
class PlasticSplit:
    """Shares of the nominal area, of the shape of the pressures."""

    elastic: Tensor
    plastic: Tensor

    @property
    def total(self) -> Tensor:
        """A/A0, elastic and plastic."""
        return self.elastic + self.plastic


def elastoplastic_area(
    pressure_pa: Tensor, stress_rms_pa: Tensor, hardness_pa: float | Tensor
) -> PlasticSplit:
    """Elastic and plastic share of the contact area at full magnification.

    Source: Persson, J. Chem. Phys. 115, 3840 (2001); Phys. Rev. Lett. 87, 116101 (2001). With
    ``a_n = n pi p / sigma_Y`` the elastic share is ``(2/pi) sum sin(a_n)/n (1 - (-1)^n) exp(-a_n^2
    G)``; the plastic share follows from the load balance, since its own series converges as 1/N.
    For stresses that spread little the same two sums are taken over mirror images instead, which
    converge where the series does not.

    Parameters
    ----------
    pressure_pa : Tensor
        Nominal pressure p [Pa], any shape.
    stress_rms_pa : Tensor
        ``tau(1, zeta)`` [Pa].
    hardness_pa : float or Tensor
        sigma_Y [Pa].

    Returns
    -------
    PlasticSplit
        Where p reaches the hardness all of the area is plastic.
    """
    # In units of the hardness; the walls are at 0 and 1.
    mean = (pressure_pa / hardness_pa).clamp(max=1.0)
    spread = torch.as_tensor(stress_rms_pa / hardness_pa).expand_as(mean) / 2**0.5
    wide = spread > _SPREAD_AT_SWITCH
    series = _by_modes(mean, spread.clamp(min=_SPREAD_AT_SWITCH))
    images = _by_images(mean, spread.clamp(max=_SPREAD_AT_SWITCH))
    return PlasticSplit(
        torch.where(wide, series.elastic, images.elastic),
        torch.where(wide, series.plastic, images.plastic),
    )


def _by_modes(mean: Tensor, spread: Tensor) -> PlasticSplit:
    """Sine series of the elastic area and of the load it carries; the rest of the load yields."""
    n = torch.arange(1, _TERMS + 1, dtype=mean.dtype, device=mean.device)
    sign = 1 - 2 * (n % 2)  # (-1)^n
    wave = n * pi
    mode = torch.sin(wave * mean[..., None]) * torch.exp(-((wave * spread[..., None]) ** 2) / 2)
    elastic = 2 / pi * ((1 - sign) / n * mode).sum(-1)
    load = -2 / pi * (sign / n * mode).sum(-1)
    plastic = (mean - load).clamp(min=0.0)
    # Rounding of the difference of two nearly equal loads; real plastic shares are far larger.
    plastic = torch.where(plastic < 1e-13 * mean, torch.zeros_like(plastic), plastic)
    return PlasticSplit(elastic.clamp(0.0, 1.0), plastic)


def _by_images(mean: Tensor, spread: Tensor) -> PlasticSplit:
    """Gaussians mirrored at the walls: what lies beyond a wall has been absorbed there."""
    width = 2**0.5 * spread

    def beyond(wall: float) -> Tensor:
        return torch.erfc((wall - mean) / width) - torch.erfc((wall + mean) / width)

    plastic = beyond(1.0) + beyond(3.0)
    elastic = torch.erf(mean / width) + beyond(2.0) + beyond(4.0) - plastic
    return PlasticSplit(elastic.clamp(0.0, 1.0), plastic)
