"""The elastic solid on a periodic grid: pressure to displacement and back in Fourier space."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi

import torch
from torch import Tensor

from haptix.contact.elasticity import ElasticSolid


@dataclass(frozen=True)
class PeriodicSolid:
    """Surface compliance ``2 / (q E*(q))`` at every wavenumber of a square periodic box.

    The mean of the pressure moves a half-space bodily, which the gap's free level takes up: the
    compliance of the mean is set to 0, and displacements have no mean.
    """

    compliance: Tensor
    """Displacement per pressure [m/Pa], shape (n, n // 2 + 1), ordered as `torch.fft.rfft2`."""
    stiffness: Tensor
    """Its inverse ``q E*(q) / 2`` [Pa/m], and 0 for the mean."""

    @classmethod
    def on_grid(
        cls, solid: ElasticSolid, points: int, side_m: float, device: torch.device | None = None
    ) -> PeriodicSolid:
        """Sample `solid` at the wavenumbers of `points` x `points` pixels on `side_m` [m]."""
        q = wavenumbers(points, side_m)
        q[0, 0] = q[0, 1]  # any; the mean is set below
        stiffness = q * solid.effective_modulus(q).detach() / 2
        compliance = 1 / stiffness
        stiffness[0, 0] = compliance[0, 0] = 0.0
        return cls(compliance.to(device), stiffness.to(device))

    def displacement(self, pressure_pa: Tensor) -> Tensor:
        """Inward displacement [m] under a pressure, shape (..., n, n), without its mean."""
        return _filtered(pressure_pa, self.compliance)

    def pressure(self, displacement_m: Tensor) -> Tensor:
        """Pressure [Pa] that makes this displacement, shape (..., n, n), without its mean."""
        return _filtered(displacement_m, self.stiffness)


def wavenumbers(points: int, side_m: float) -> Tensor:
    """``|q|`` [1/m] of the half spectrum of `torch.fft.rfft2`, shape (n, n // 2 + 1)."""
    step = 2 * pi / side_m
    rows = torch.fft.fftfreq(points, 1 / points, dtype=torch.float64)[:, None]
    columns = torch.fft.rfftfreq(points, 1 / points, dtype=torch.float64)
    return step * torch.hypot(rows, columns)


def _filtered(field: Tensor, factor: Tensor) -> Tensor:
    waves = torch.fft.rfft2(field)
    torch.mul(waves, factor, out=waves)
    answer: Tensor = torch.fft.irfft2(waves, s=field.shape[-2:])
    return answer
