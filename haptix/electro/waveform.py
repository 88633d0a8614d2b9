"""Attraction within a drive period, for any periodic voltage.

The voltage divides over insulators and gap harmonic by harmonic, with the complex thickness
``h0(n f)`` of each; the stress follows from the square of the field that they add up to. That a
sine pulls at twice its frequency, with a full ripple, is a result of this and no assumption.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import pi
from typing import Any, Self

import torch
from torch import Tensor

from haptix.contact.gaps import GapHistogram
from haptix.electro.dielectric import VACUUM_PERMITTIVITY
from haptix.errors import InputError


@dataclass(frozen=True)
class Waveform:
    """One period of a voltage of amplitude 1, as ``V(t) = Re sum_n c_n exp(-i n w t)``, n from 0.

    The sign of the exponent is that of ``eps2 = eps + i/(w eps0 rho)``.

    Parameters
    ----------
    name : str
        What to call it.
    coefficient : Tensor of complex, shape (harmonics + 1,)
        c_n; c_0 is the mean.
    """

    name: str
    coefficient: Tensor

    @classmethod
    def sine(cls) -> Self:
        """cos(w t), the drive of the paper."""
        return cls("sine", torch.tensor([0.0, 1.0], dtype=torch.complex128))

    @classmethod
    def square(cls, harmonics: int = 99) -> Self:
        """Square wave between -1 and 1, cut off after `harmonics`."""
        n = torch.arange(harmonics + 1, dtype=torch.float64)
        odd = n % 2 == 1
        size = torch.where(odd, 4 / (pi * n.clamp(min=1)) * torch.sin(n * pi / 2), 0.0)
        return cls("square", size.to(torch.complex128))

    @classmethod
    def from_samples(cls, samples: Any, name: str = "samples") -> Self:
        """One period, sampled evenly; scaled so that its largest magnitude is 1."""
        v = torch.as_tensor(samples, dtype=torch.float64)
        if v.ndim != 1 or len(v) < 4 or not bool(v.isfinite().all()) or not bool(v.any()):
            raise InputError(
                "samples: expected one period of at least 4 finite values that are not all zero, "
                f"got shape {tuple(v.shape)}"
            )
        spectrum = torch.fft.rfft(v / v.abs().max()) / len(v)
        spectrum[1:] *= 2
        if len(v) % 2 == 0:
            spectrum[-1] /= 2  # the highest harmonic has no partner of negative frequency
        return cls(name, spectrum.conj())

    def at(self, phase: Tensor) -> Tensor:
        """Voltage at phases [rad] of any shape."""
        n = torch.arange(len(self.coefficient), dtype=phase.dtype, device=phase.device)
        turn = torch.exp(-1j * n * phase[..., None])
        return (self.coefficient.to(phase.device) * turn).sum(-1).real

    def fields(
        self,
        gap_m: Tensor,
        voltage_v: float,
        frequency_hz: float,
        thickness_m: Callable[[Tensor], Tensor],
        phase: Tensor,
    ) -> Tensor:
        """Field [V/m] in gaps at each phase, shape (phases, gaps).

        Parameters
        ----------
        gap_m : Tensor, shape (gaps,)
            Gaps [m]; 0 is the edge of a contact spot.
        voltage_v, frequency_hz : float
            Amplitude and fundamental frequency.
        thickness_m : callable
            Complex h0 [m] at frequencies [Hz], zero among them where the waveform has a mean.
        phase : Tensor, shape (phases,)
            Phases [rad].
        """
        used = self.coefficient.abs() > 0
        n = torch.arange(len(used), dtype=torch.float64)[used].to(phase.device)
        thickness = thickness_m(n * frequency_hz)[:, None]
        turn = torch.exp(-1j * n * phase[:, None])
        voltage = voltage_v * self.coefficient[used].to(phase.device) * turn
        return (voltage @ (1 / (gap_m + thickness))).real

    def pulls(
        self,
        gap_edges_m: Tensor,
        voltage_v: float,
        frequency_hz: float,
        thickness_m: Callable[[Tensor], Tensor],
        phase: Tensor,
    ) -> tuple[Tensor, Tensor]:
        """Stress [Pa] on a gap in each bin, and on a contact spot, at each phase: eps0 E^2 / 2.

        `gap_edges_m`, shape (bins + 1,), are the edges of the bins [m]; the rest is that of
        `fields`.

        Returns
        -------
        (Tensor, Tensor), of shapes (phases, bins) and (phases,)
        """
        # Where gaps are wide 1/u^2 averages to 1/(u_low u_high) over a bin; elsewhere h0 dominates.
        centre = (gap_edges_m[:-1] * gap_edges_m[1:]).sqrt()
        gap = torch.cat([centre, torch.zeros_like(centre[:1])])
        stress = (
            VACUUM_PERMITTIVITY
            / 2
            * self.fields(gap, voltage_v, frequency_hz, thickness_m, phase) ** 2
        )
        return stress[:, :-1], stress[:, -1]

    def stress_pa(
        self,
        gaps: GapHistogram,
        area_fraction: Tensor,
        voltage_v: float,
        frequency_hz: float,
        thickness_m: Callable[[Tensor], Tensor],
        phase: Tensor,
    ) -> tuple[Tensor, Tensor]:
        """Mean pull [Pa] of the open gaps and of the contact spots, shape (..., phases).

        `gaps` and `area_fraction` have the batch shape (...,); the rest is that of `pulls`.
        """
        of_gap, of_spot = self.pulls(gaps.edges_m, voltage_v, frequency_hz, thickness_m, phase)
        return gaps.mass @ of_gap.T, area_fraction[..., None] * of_spot
