"""Real contact area against pressure: Persson's law, and a correction that needs no fit.

Both are written as ``A/A0 = erf(t)``: Persson has ``t = p / tau``. His theory lets stress diffuse
the same way whether or not the spots are small; boundary elements find a third more area at light
load. Xu et al. let the diffusion slow down with the area that is lost (physics page, section 6b)::

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
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, pi, sqrt

import torch
from torch import Tensor

from haptix.errors import InputError

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
