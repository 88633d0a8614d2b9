"""A spectrum over wavenumber that is linear in log-log between its nodes, and its moments."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi

import torch
from torch import Tensor

from haptix.base.display import Displayed


@dataclass(frozen=True)
class PowerLaws(Displayed):
    """A density over wavenumbers, a power law between each two nodes."""

    wavenumber: Tensor
    """Increasing wavenumbers q [1/m], shape (nodes,); the first and last bound the spectrum."""
    density: Tensor
    """C at the nodes [m^4], shape (nodes,), positive."""

    @property
    def q0(self) -> float:
        """Lowest wavenumber of the spectrum [1/m]."""
        return float(self.wavenumber[0])

    @property
    def q1(self) -> float:
        """Highest wavenumber of the spectrum [1/m]."""
        return float(self.wavenumber[-1])

    def __call__(self, q: Tensor) -> Tensor:
        """C [m^4] at wavenumbers inside the band, any shape."""
        segment, exponent = self._segment(q)
        return self.density[segment] * (q / self.wavenumber[segment]) ** exponent

    def moment(self, power: int, above: Tensor | None = None) -> Tensor:
        """``2 pi int_q^q1 q'^power C dq'`` in closed form, for each lower limit in `above`.

        ``moment(1, q)`` is the mean square of the roughness above the wavenumber q.

        Parameters
        ----------
        power : int
            Power of the wavenumber: 1 for heights, 3 for slopes.
        above : Tensor, optional
            Lower limits q [1/m], of any shape; all waves if not given.

        Examples
        --------
        >>> from haptix.model.contact import RoughnessSpectrum
        >>> rough = RoughnessSpectrum.self_affine(2e-6, hurst=0.8, q0=1e3, q_rolloff=1e4, q1=1e7)
        >>> round(float(rough.moment(1)) ** 0.5 * 1e6, 6)  # the heights' root mean square, in um
        2.0
        """
        q, c = self.wavenumber, self.density
        exponent = torch.log(c[1:] / c[:-1]) / torch.log(q[1:] / q[:-1])
        whole = _power_integral(
            c[:-1] * q[:-1] ** (power + 1), q[1:] / q[:-1], power + 1 + exponent
        )
        tails = torch.cat([whole.flip(0).cumsum(0).flip(0), whole.new_zeros(1)])
        if above is None:
            return 2 * pi * tails[0]
        segment, exponent_here = self._segment(above)
        prefactor = self(above) * above ** (power + 1)
        ratio = q[segment + 1] / above
        rest = _power_integral(prefactor, ratio, power + 1 + exponent_here)
        return 2 * pi * (rest + tails[segment + 1])

    def _segment(self, q: Tensor) -> tuple[Tensor, Tensor]:
        segment = torch.searchsorted(self.wavenumber, q.detach().contiguous(), right=True) - 1
        segment = segment.clamp(0, self.wavenumber.shape[0] - 2)
        rise = torch.log(self.density[segment + 1] / self.density[segment])
        return segment, rise / torch.log(self.wavenumber[segment + 1] / self.wavenumber[segment])


def _power_integral(value_times_q: Tensor, ratio: Tensor, exponent: Tensor) -> Tensor:
    """``int f dq`` over a segment where ``q f ~ q^exponent``; ``(ratio^e - 1)/e``, stable at 0."""
    span = torch.log(ratio)
    growth = exponent * span
    small = growth.abs() < 1e-6
    safe = torch.where(small, torch.ones_like(growth), growth)
    factor = torch.where(small, 1 + growth / 2, torch.expm1(safe) / safe)
    return value_times_q * span * factor
