"""Real contact area against pressure: Persson's law, a correction that needs no fit, plasticity.

The two laws of elastic contact are written as ``A/A0 = erf(t)``: Persson has ``t = p / tau``. His
theory lets stress diffuse the same way whether or not the spots are small; boundary elements find a
third more area at light load. Xu et al. let the diffusion slow down with the area that is lost
(physics page, section 6b)::

    A = erf( p / (tau sqrt(g + (1 - g) A)) )

so that ``t sqrt(g + (1 - g) erf t) = p / tau``: the area is ``1/sqrt(g)`` times Persson's for light
contact, and his near complete contact.

A light contact rests on few asperities, each a rounded tip at the scale of its own spot: waves much
longer than the spot do not spread its stress. A tip's radius grows as p^(1/3) (Hertz). With
``<f> = int f dT`` over the waves, T the stress variance that they add, the curvature of the tips is
set by waves of ``q_c^2 = <q^-2> / <q^-4>`` and their stress by ``T_c = <q^-2> q_c^2``: moments in
which short waves do not count, so that both hold for any band. Then ``tau^2`` is replaced by

    T_s(p) = int dT / (1 + (q_s/q)^2),    q_s^2 = c q_c^2 (p^2 / T_c)^(-1/3)

and the area of a light contact falls as p^(2/3) where its spots are smooth, and as p where waves
shorter than ``1/q_s`` roughen them (docs/mean-field.md).

In elastoplastic contact the stress distribution is cut off at the hardness. In Persson's theory the
distribution of contact stress P(sigma) broadens by diffusion as shorter waves are added, with the
variance ``tau^2 / 2`` at magnification zeta. Stress that falls to zero is area lost, stress that
rises to the hardness sigma_Y is area that yields: two absorbing walls.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, pi, sqrt

import torch
from torch import Tensor

from haptix.errors import InputError

_TERMS = 40
# Both series converge to double precision within _TERMS on their own side of this ratio.
_SPREAD_AT_SWITCH = 0.08
_NEWTON_STEPS = 7  # three suffice in the middle, and the start is exact at both ends


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
            for _ in range(_NEWTON_STEPS):
                value, slope = self._stretched(t)
                t = t - (value - y) / slope
            _, slope = self._stretched(t)
        # One more step, recorded by autograd.
        return t - (self._stretched(t)[0] - y) / slope

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
