"""The universal separation integral J(y) of Persson's theory, tabulated once per gamma."""

from __future__ import annotations

from math import log

import numpy as np
import torch
from torch import Tensor

from haptix.contact.area import AreaLaw
from haptix.errors import InputError
from haptix.interpolation import UniformCubic

# J falls as exp(-y^2); beyond this it is below 1e-15 of its values at y ~ 1 and is set to zero.
# A strip so deep in contact has a theoretical gap of some 1e-23 m: it is closed.
Y_MAX = 5.6
_Y_MIN = 1e-6
_NODES = 2048


class SeparationIntegral:
    """``J(y) = int_y^inf dx/x [gamma + n (1 - gamma) erf(t)^(n-1)] exp(-t^2) dt/dx``.

    Source: Yang & Persson, J. Phys.: Condens. Matter 20, 215214 (2008); physics page, section 2.
    The elastic energy depends on the area A as ``gamma A + (1 - gamma) A^n``; Persson has n = 3 and
    t = x. With another law of the area than erf(x) it follows that one.

    Parameters
    ----------
    gamma : float
        Share of the elastic energy that is proportional to the area, in (0, 1]; about 0.45.
    device : str
        Device of the table.
    area : AreaLaw
        Gives t at x.
    power : float
        n, above 1.
    """

    def __init__(
        self,
        gamma: float,
        device: torch.device | str = "cpu",
        area: AreaLaw | None = None,
        power: float = 3.0,
    ) -> None:
        self._area = area or AreaLaw()
        if not 0 < gamma <= 1:
            raise InputError(f"gamma: expected a number in (0, 1], got {gamma:g}")
        if not power > 1:
            raise InputError(f"power: expected a number above 1, got {power:g}")
        self.gamma, self.power = gamma, power
        log_y = torch.linspace(log(_Y_MIN), log(Y_MAX), _NODES, dtype=torch.float64)
        # Six-point Gauss in every cell, summed from the far end so that small J keep their digits;
        # the tail from Y_MAX on is summed the same way on an extension of the grid.
        step = float(log_y[1] - log_y[0])
        beyond = log_y[-1] + step * torch.arange(1, 400, dtype=torch.float64)
        edges = torch.cat([log_y, beyond])
        points, weights = (torch.from_numpy(a) for a in np.polynomial.legendre.leggauss(6))
        at = torch.exp(edges[:-1, None] + step * (points + 1) / 2)
        cells = (self._integrand(at) * weights).sum(-1) * step / 2
        total = cells.flip(0).cumsum(0).flip(0)[:_NODES]
        slope = -self._integrand(torch.exp(log_y)) / total
        self._log_j = UniformCubic(log(_Y_MIN), step, torch.log(total).to(device), slope.to(device))

    def _integrand(self, x: Tensor) -> Tensor:
        t = self._area.argument(x)
        rest = self.power * (1 - self.gamma)
        energy = self.gamma + rest * torch.erf(t) ** (self.power - 1)
        return energy * torch.exp(-t * t) * self._area.growth(x)

    def __call__(self, y: Tensor) -> Tensor:
        """J(y) for y > 0 of any shape; exactly zero beyond `Y_MAX`."""
        log_y = torch.log(y)
        inside = torch.exp(self._log_j(log_y.clamp(log(_Y_MIN), log(Y_MAX))))
        # For small y the bracket is gamma, and J grows as gamma ln(1/y) dt/dy.
        small = self.gamma * self._area.light * torch.clamp(log(_Y_MIN) - log_y, min=0.0)
        return torch.where(y < Y_MAX, inside + small, torch.zeros_like(y))
