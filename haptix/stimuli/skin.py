"""Attraction of a drive by the skin under a finger: the dispersion of its dielectric.

A gap u divides a voltage with the insulators frequency by frequency, ``E(f) = V(f)/(u + h0(f))``,
and attracts by the square of their sum in time, see docs/virtual-finger.md. Here one gap stands for
all of the contact: that by which the attraction of sine drives depends on frequency as the contact
model says, at the force of the touch and a low voltage.

Attractions are stated as those of a sine drive v of a reference frequency: ``v^2/2``.
The finger's response to an attraction is left out on both sides: a stimulus and the sine drive at
its detection threshold are felt at the same frequency, by the same finger at the same speed. The
data give no speed or force of the thresholds.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import torch
from scipy.fft import irfft, next_fast_len, rfft, rfftfreq

from haptix.checks import Array
from haptix.friction import ContactModel

MEMORY_S = 0.1
"""The drive this long before an instant counts: skin relaxes in some 10 ms."""

_FITTED_HZ = np.geomspace(20.0, 8000.0, 9)
_GAPS_M = np.append(0.0, np.geomspace(1e-9, 1e-4, 301))


class Skin:
    """Attraction of drives by one finger on a screen, over that of sines of a reference frequency.

    Parameters
    ----------
    model : ContactModel
        Finger and screen.
    normal_force_n : float
        Normal force [N].
    reference_hz : float
        Frequency whose sine drives attract with ``v^2/2``.
    h0_m : float, optional
        Effective thickness [m]; the default is the screen's own.
    """

    def __init__(
        self,
        model: ContactModel,
        normal_force_n: float,
        reference_hz: float,
        h0_m: float | None = None,
    ) -> None:
        self._model = model
        self._h0 = torch.tensor(model.screen.h0_m if h0_m is None else h0_m, dtype=torch.float64)
        pull = np.asarray(model.solve(normal_force_n, 1.0, _FITTED_HZ, h0_m).attraction_pa)
        thickness = self._thickness(_FITTED_HZ)
        by_gap = 1 / np.abs(_GAPS_M[:, None] + thickness) ** 2
        miss = np.log(by_gap / pull)
        self.gap_m = float(_GAPS_M[np.argmin(np.std(miss, axis=1))])
        """The gap that stands for all [m]."""
        self._reference = self.gap_m + self._thickness(np.array([reference_hz]))[0]
        self._divisor = lru_cache(maxsize=2)(self._over_reference)

    def _thickness(self, frequency_hz: Array) -> Array:
        thickness_m = self._model.solver.terms.thickness(self._h0, torch.from_numpy(frequency_hz))
        return np.asarray(thickness_m.detach().cpu().numpy())

    def pull(self, drive_hz: Array) -> Array:
        """Attraction of sine drives over that of one of the reference frequency."""
        return np.asarray(np.abs(self._reference / (self.gap_m + self._thickness(drive_hz))) ** 2)

    def voltage(self, drive_v: Array, sample_rate_hz: float) -> Array:
        """Voltage of the reference's skin with the field in the gap; the drive is 0 V before."""
        size = next_fast_len(len(drive_v) + round(MEMORY_S * sample_rate_hz), real=True)
        spectrum = rfft(drive_v, size) / self._divisor(size, sample_rate_hz)
        return np.asarray(irfft(spectrum, size)[: len(drive_v)])

    def _over_reference(self, size: int, rate_hz: float) -> Array:
        """Divisor of each frequency; numpy's transform is that of exp(i w t), h0 of exp(-i w t)."""
        divisor = self.gap_m + self._thickness(rfftfreq(size, 1 / rate_hz))
        return np.asarray(divisor.conj() / abs(self._reference))
