"""Real contact area against pressure: Persson's law, and a correction that needs no fit.

Both are written as ``A/A0 = erf(t)``: Persson has ``t = p / tau``. His theory lets stress diffuse
the same way whether or not the spots are small; boundary elements find a third more area at light
load. Xu et al. let the diffusion slow down with the area that is lost (physics page, section 6b)::

    A = erf( p / (tau sqrt(g + (1 - g) A)) )

so that ``t sqrt(g + (1 - g) erf t) = p / tau``: the area is ``1/sqrt(g)`` times Persson's for light
contact, and his near complete contact.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi, sqrt

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
    """

    slowing: float = 1.0

    def __post_init__(self) -> None:
        if not 0 < self.slowing <= 1:
            raise InputError(f"slowing: expected a number in (0, 1], got {self.slowing:g}")

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
