"""Attraction within a drive period, for any periodic voltage.

The voltage divides over insulators and gap harmonic by harmonic, with the complex thickness
``h0(n f)`` of each. The stress follows from the square of the field that they add up to. So a sine
attracts at twice its frequency, with a full ripple; this is a result and not an assumption.
"""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor

from haptix.electro.dielectric import VACUUM_PERMITTIVITY
from haptix.waves import Waveform

_HARMONICS = 99  # of a wave with steps


def fields(
    waveform: Waveform,
    gap_m: Tensor,
    voltage_v: float,
    frequency_hz: float,
    thickness_m: Callable[[Tensor], Tensor],
    phase: Tensor,
) -> Tensor:
    """Field [V/m] in gaps at each phase, shape (phases, gaps).

    Parameters
    ----------
    waveform : Waveform
        Shape of the voltage.
    gap_m : Tensor, shape (gaps,)
        Gaps [m]; 0 is the edge of a contact spot.
    voltage_v, frequency_hz : float
        Amplitude and fundamental frequency.
    thickness_m : callable
        Complex h0 [m] at frequencies [Hz], zero among them where the waveform has a mean.
    phase : Tensor, shape (phases,)
        Phases [rad].
    """
    series = waveform.harmonics(waveform.highest_harmonic or _HARMONICS)
    # Voltages here go with exp(-i n w t), as ``eps2 = eps + i/(w eps0 rho)`` does.
    coefficient = torch.from_numpy(series.conj())
    used = coefficient.abs() > 0
    n = torch.arange(len(used), dtype=torch.float64)[used].to(phase.device)
    thickness = thickness_m(n * frequency_hz)[:, None]
    turn = torch.exp(-1j * n * phase[:, None])
    voltage = voltage_v * coefficient[used].to(phase.device) * turn
    return (voltage @ (1 / (gap_m + thickness))).real


def pulls(
    waveform: Waveform,
    gap_edges_m: Tensor,
    voltage_v: float,
    frequency_hz: float,
    thickness_m: Callable[[Tensor], Tensor],
    phase: Tensor,
) -> tuple[Tensor, Tensor]:
    """Stress ``eps0 E^2 / 2`` [Pa] on a gap in each bin, and on a contact spot, at each phase.

    Parameters
    ----------
    gap_edges_m : Tensor, shape (bins + 1,)
        Edges of the bins [m].
    waveform, voltage_v, frequency_hz, thickness_m, phase
        See `fields`.

    Returns
    -------
    (Tensor, Tensor), of shapes (phases, bins) and (phases,)
    """
    # Where gaps are wide 1/u^2 averages to 1/(u_low u_high) over a bin; elsewhere h0 dominates.
    centre = (gap_edges_m[:-1] * gap_edges_m[1:]).sqrt()
    gap = torch.cat([centre, torch.zeros_like(centre[:1])])
    field = fields(waveform, gap, voltage_v, frequency_hz, thickness_m, phase)
    stress = VACUUM_PERMITTIVITY / 2 * field**2
    return stress[:, :-1], stress[:, -1]
