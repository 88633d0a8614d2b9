"""The field in gaps within a drive period, for any periodic voltage.

The voltage divides over insulators and gap harmonic by harmonic, with the complex thickness
``h0(n f)`` of each. The attraction follows from the square of the field that they add up to. So a
sine attracts at twice its frequency, with a full ripple; this is a result and not an assumption.
"""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor

from haptix.waves import Waveform

_HARMONICS = 99  # of a wave with steps


def field_in_time(
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
