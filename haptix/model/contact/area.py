"""Real contact area against pressure: Persson's law, a correction that needs no fit, plasticity.

Both laws of elastic contact are written as ``A/A0 = erf(t)``. In Persson's law ``t = p / tau``.
There the stress diffuses in the same way for small and for large spots; boundary elements give a
third more area at light load. In the law of Xu et al. the diffusion slows down as area is lost
(physics page, section 6b)::

    A = erf( p / (tau sqrt(g + (1 - g) A)) )

so that ``t sqrt(g + (1 - g) erf t) = p / tau``. In light contact the area is ``1/sqrt(g)`` times
Persson's; near complete contact it equals Persson's.

A light contact rests on few asperities. Each is a rounded tip at the scale of its spot, and waves
much longer than the spot do not spread its stress. The radius of a spot grows as p^(1/3) (Hertz).
Let ``<f> = int f dT`` over the waves, where T is the stress variance that they add. Waves of
``q_c^2 = <q^-2> / <q^-4>`` set the curvature of the tips, and ``T_c = <q^-2> q_c^2`` their stress.
Short waves add nothing to these moments, so that both are valid for any band. ``tau^2`` is then
replaced by

    T_s(p) = int dT / (1 + (q_s/q)^2),    q_s^2 = c q_c^2 (p^2 / T_c)^(-1/3)

and the area of a light contact falls as p^(2/3) where its spots are smooth, and as p where waves
shorter than ``1/q_s`` roughen them (docs/mean-field.md).

In elastoplastic contact the stress distribution is cut off at the hardness. In Persson's theory the
distribution of contact stress P(sigma) broadens by diffusion as shorter waves are added; its
variance is ``tau^2 / 2`` at magnification zeta. Where the stress falls to zero, contact is lost;
where it rises to the hardness sigma_Y, the skin yields. Both are absorbing walls of the diffusion.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, pi, sqrt

import torch
from torch import Tensor

from haptix.base.errors import InputError

_TERMS = 40
# Spread over hardness: above it the sine series converges within _TERMS, below it the images do.
_SPREAD_AT_SWITCH = 0.08
# Newton's steps by the smallest g of `slowing` for which they suffice: the gradient is the slope
# before the last step, which autograd records. The worst y are in the middle.
_NEWTON_STEPS = {0.4: 4, 1e-3: 6, 0.0: 8}


@dataclass(frozen=True)
class AreaLaw:
    """Area against ``y = p / tau``.

    Parameters
    ----------
    slowing : float
        g, in (0, 1]; 1 is Persson's law.
    tips : float
        c, 0 or more; 0 counts all waves in every spot.
    """

    slowing: float = 1.0
    tips: float = 0.0

    def __post_init__(self) -> None:
        if not 0 < self.slowing <= 1:
            raise InputError(f"slowing: expected a number in (0, 1], got {self.slowing:g}")
        if not 0 <= self.tips < inf:
            raise InputError(f"tips: expected a number of 0 or more, got {self.tips:g}")

    @property
    def light(self) -> float:
        """Ratio of the area of a light contact to Persson's."""
        return 1 / sqrt(self.slowing)

    def argument(self, y: Tensor) -> Tensor:
        """Return t for y of any shape; the area is ``erf(t)``."""
        if self.slowing == 1.0:
            return y
        with torch.no_grad():
            t = y / torch.sqrt(self.slowing + (1 - self.slowing) * torch.erf(y))
            value, slope = self._stretched(t)
            steps = next(steps for g, steps in _NEWTON_STEPS.items() if self.slowing >= g)
            for _ in range(steps - 1):
                t = t - (value - y) / slope
                value, slope = self._stretched(t)
        # The last step, recorded by autograd.
        return t - (value - y) / slope

    def growth(self, y: Tensor) -> Tensor:
        """Return dt/dy for y of any shape."""
        return 1 / self._stretched(self.argument(y))[1]

    def _stretched(self, t: Tensor) -> tuple[Tensor, Tensor]:
        """Return y of t, and dy/dt."""
        rest = 1 - self.slowing
        area = self.slowing + rest * torch.erf(t)
        root = torch.sqrt(area)
        return t * root, root + t * rest * torch.exp(-t * t) / (sqrt(pi) * root)


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
    G)``. The plastic share follows from the load balance, because its series converges only as 1/N.
    Where stresses spread little, the series converges slowly, and sums over mirror images replace
    it.

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
        From the pressure at which p reaches the hardness, all of the area is plastic.
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
    """Shares by the sine series: elastic area and its load; the plastic area bears the rest."""
    n = torch.arange(1, _TERMS + 1, dtype=mean.dtype, device=mean.device)
    sign = 1 - 2 * (n % 2)  # (-1)^n
    wave = n * pi
    mode = torch.sin(wave * mean[..., None]) * torch.exp(-((wave * spread[..., None]) ** 2) / 2)
    elastic = 2 / pi * ((1 - sign) / n * mode).sum(-1)
    load = -2 / pi * (sign / n * mode).sum(-1)
    plastic = (mean - load).clamp(min=0.0)
    # So small a difference of two nearly equal loads is rounding: real plastic shares are larger.
    plastic = torch.where(plastic < 1e-13 * mean, torch.zeros_like(plastic), plastic)
    return PlasticSplit(elastic.clamp(0.0, 1.0), plastic)


def _by_images(mean: Tensor, spread: Tensor) -> PlasticSplit:
    """Shares by Gaussians that are mirrored at the walls; a wall absorbs the part beyond it."""
    width = 2**0.5 * spread

    def beyond(wall: float) -> Tensor:
        return torch.erfc((wall - mean) / width) - torch.erfc((wall + mean) / width)

    plastic = beyond(1.0) + beyond(3.0)
    elastic = torch.erf(mean / width) + beyond(2.0) + beyond(4.0) - plastic
    return PlasticSplit(elastic.clamp(0.0, 1.0), plastic)
