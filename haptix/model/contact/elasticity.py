"""Elastic response of the skin to a wave of wavenumber q: half-space, or layer on half-space."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import torch
from torch import Tensor

from haptix.base import checks
from haptix.base.display import Displayed
from haptix.base.errors import InputError


class ElasticSolid(Protocol):
    """Anything with an effective modulus ``E*(q)``, [Pa] for wavenumbers [1/m] of any shape."""

    def effective_modulus(self, q: Tensor) -> Tensor:
        """Return ``E*(q)`` [Pa]."""
        ...


def _check_poisson(name: str, value: float | Tensor) -> None:
    if not -1 < float(value) <= 0.5:
        raise InputError(f"{name}: expected a Poisson ratio in (-1, 0.5], got {float(value):g}")


@dataclass(frozen=True)
class HalfSpace(Displayed):
    """Homogeneous elastic half-space, ``E* = E / (1 - nu^2)``.

    Parameters
    ----------
    youngs_modulus_pa : float or Tensor
        E [Pa].
    poisson_ratio : float
        nu, in (-1, 0.5].

    Examples
    --------
    >>> HalfSpace(0.75, 0.5).effective_modulus(torch.ones(2, dtype=torch.float64)).tolist()
    [1.0, 1.0]
    """

    youngs_modulus_pa: float | Tensor
    poisson_ratio: float = 0.5

    def __post_init__(self) -> None:
        checks.positive("youngs_modulus_pa", self.youngs_modulus_pa)
        _check_poisson("poisson_ratio", self.poisson_ratio)

    def effective_modulus(self, q: Tensor) -> Tensor:
        """``E*`` [Pa], the same at every wavenumber.

        Examples
        --------
        >>> HalfSpace(3e6, 0.5).effective_modulus(torch.tensor([1e3, 1e6])).tolist()  # of any wave
        [4000000.0, 4000000.0]
        """
        return self.youngs_modulus_pa / (1 - self.poisson_ratio**2) * torch.ones_like(q)


@dataclass(frozen=True)
class Layered(Displayed):
    """A layer (the stratum corneum) bonded to a half-space (the tissue below).

    ``E*(q) = E_layer* / S(q d)``: short waves feel the layer, long waves the half-space. S is the
    surface-response ratio of a bonded layer (physics page, section 3; Persson, Scaraggi 2014),
    rewritten so that no digits are lost for thin layers (q d -> 0) or large contrasts.

    Parameters
    ----------
    layer_modulus_pa, bulk_modulus_pa : float or Tensor
        Young's moduli [Pa].
    layer_poisson_ratio, bulk_poisson_ratio : float
        Poisson ratios, in (-1, 0.5].
    thickness_m : float or Tensor
        Thickness d of the layer [m].

    Examples
    --------
    >>> skin = Layered(4e7, 0.5, 2e-4, 1e4, 0.5)
    >>> short, long = skin.effective_modulus(torch.tensor([1e6, 1.0], dtype=torch.float64))
    >>> round(float(short / HalfSpace(4e7).effective_modulus(torch.tensor(1.0))), 2)  # the layer
    1.0
    """

    layer_modulus_pa: float | Tensor
    layer_poisson_ratio: float
    thickness_m: float | Tensor
    bulk_modulus_pa: float | Tensor
    bulk_poisson_ratio: float

    def __post_init__(self) -> None:
        for name in ("layer_modulus_pa", "thickness_m", "bulk_modulus_pa"):
            checks.positive(name, getattr(self, name))
        for name in ("layer_poisson_ratio", "bulk_poisson_ratio"):
            _check_poisson(name, getattr(self, name))

    def effective_modulus(self, q: Tensor) -> Tensor:
        """``E*(q)`` [Pa] for wavenumbers [1/m] of any shape.

        Examples
        --------
        >>> skin = Layered(1e7, 0.5, thickness_m=1e-4, bulk_modulus_pa=1e5, bulk_poisson_ratio=0.5)
        >>> short, long = skin.effective_modulus(torch.tensor([1e7, 1e2]))
        >>> bool(short > long)  # short waves feel the stiff layer, long ones what lies below
        True
        """
        layer = self.layer_modulus_pa / (1 - self.layer_poisson_ratio**2)
        return layer / self.surface_response(q * self.thickness_m)

    def surface_response(self, x: Tensor) -> Tensor:
        """S(x), x = q d: the layered surface's compliance over that of the layer's material."""
        nu0, nu1 = self.layer_poisson_ratio, self.bulk_poisson_ratio
        shear_ratio = (self.layer_modulus_pa / (1 + nu0)) / (self.bulk_modulus_pa / (1 + nu1))
        m = (shear_ratio - 1) / (shear_ratio + 3 - 4 * nu0)
        not_m = 4 * (1 - nu0) / (shear_ratio + 3 - 4 * nu0)
        not_n = 4 * (1 - nu0) / (1 + shear_ratio * (3 - 4 * nu1))
        n = 1 - not_n
        decay = torch.exp(-2 * x)
        rise = -torch.expm1(-2 * x)
        # (1 - decay)^2 - 4 x^2 decay = 4 decay (sinh^2 x - x^2), of order x^4: by series below 1/2.
        small = torch.clamp(x, max=0.5)
        x2 = small**2
        tail = 1 + x2 / 20 * (1 + x2 / 42 * (1 + x2 / 72 * (1 + x2 / 110 * (1 + x2 / 156))))
        sinh_minus_x = small**3 / 6 * tail
        series = 4 * decay * sinh_minus_x * (sinh_minus_x + 2 * small)
        bending = torch.where(x < 0.5, series, rise**2 - 4 * x**2 * decay)
        above = not_m + m * not_n + m * n * (1 + decay) * rise + 4 * m * x * decay
        below = not_m * not_n + not_m * n * rise + m * not_n * rise * decay + m * bending
        return above / below
