"""Dielectric of the stratum corneum."""

from __future__ import annotations

from typing import Annotated, Self

import torch
from pydantic import Field, PositiveFloat, model_validator
from torch import Tensor

from haptix.documents import Part
from haptix.interpolation import PiecewiseLinear

VACUUM_PERMITTIVITY = 8.8541878128e-12
"""eps0 [F/m], CODATA 2018."""


class SkinDielectric(Part):
    """Permittivity and resistivity of the stratum corneum against frequency.

    ``eps2(w) = eps_SC + i / (w eps0 rho_SC)`` (paper, Eq. 4), log-log interpolated; beyond its ends
    the table holds its last values. The built-in table is an order of magnitude only and says so.

    Parameters
    ----------
    frequency_hz, permittivity, resistivity_ohm_m : tuple of float
        Columns of the table, frequency increasing. A single row means constants.
    scale : float
        Factor on the skin's effective thickness ``d2/eps2``, which a calibration may fit: 2 for a
        skin that insulates twice as much as the table says.
    is_placeholder : bool
        True while the numbers are not measured ones.
    source : str
        Where the numbers come from.
    """

    frequency_hz: tuple[PositiveFloat, ...] = (1e1, 1e2, 1e3, 1e4, 1e5, 1e6)
    permittivity: tuple[PositiveFloat, ...] = (1e4, 3e3, 1.5e3, 1e3, 6e2, 3e2)
    resistivity_ohm_m: tuple[PositiveFloat, ...] = (1e5, 1e5, 3e4, 8e3, 2e3, 3e2)
    # A table as it stands is written and hashed as it was before there was a scale.
    scale: Annotated[PositiveFloat, Field(exclude_if=lambda scale: scale == 1)] = 1.0
    is_placeholder: bool = True
    source: str = "order of magnitude after Yamamoto & Yamamoto (1976); not measured values"

    @model_validator(mode="after")
    def _columns_match(self) -> Self:
        rows = len(self.frequency_hz)
        if not rows or rows != len(self.permittivity) or rows != len(self.resistivity_ohm_m):
            raise ValueError("expected three columns of one length, 1 or more")
        if list(self.frequency_hz) != sorted(set(self.frequency_hz)):
            raise ValueError("expected frequencies in increasing order")
        return self

    def relative_permittivity(self, frequency_hz: Tensor) -> Tensor:
        """Complex eps2 at frequencies [Hz] of any shape, the scale included."""
        log_f = torch.log(frequency_hz)
        permittivity = torch.exp(self._interpolate(log_f, self.permittivity))
        resistivity = torch.exp(self._interpolate(log_f, self.resistivity_ohm_m))
        loss = 1 / (2 * torch.pi * frequency_hz * VACUUM_PERMITTIVITY * resistivity)
        return torch.complex(permittivity, loss) / self.scale

    def _interpolate(self, log_f: Tensor, column: tuple[float, ...]) -> Tensor:
        nodes, values = log_f.new_tensor([self.frequency_hz, column]).log().unbind()
        if len(nodes) == 1:
            return values[0].expand_as(log_f)
        return PiecewiseLinear.through(nodes, values)(log_f.clamp(nodes[0], nodes[-1]))
