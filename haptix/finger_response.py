"""The finger's response: how its friction follows electrovibration.

Friction follows the attraction like a first-order system whose cut-off rises in proportion to the
sliding speed (physics page, section 7). Such a cut-off is a fixed length: at r Hz per mm/s, 1/e of
an old state is left after 1/(2 pi r) mm of sliding (11.5 um for 13.8), however the speed changes.
Over slid distance the equation has constant coefficients, and one step of it is exact.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from haptix import checks
from haptix.checks import Array

_STANDING_MM_PER_S = 1e-3  # gains of slower fingers are those at this speed


@dataclass(frozen=True)
class FingerResponse:
    """A first-order low-pass filter over slid distance.

    Parameters
    ----------
    response_hz_per_mm_per_s : float
        Cut-off frequency per sliding speed, see `Finger`.
    """

    response_hz_per_mm_per_s: float

    def __post_init__(self) -> None:
        checks.positive("response_hz_per_mm_per_s", self.response_hz_per_mm_per_s)

    def gain(
        self, frequency_hz: float | Array, speed_mm_per_s: float | Array
    ) -> npt.NDArray[np.complex128]:
        """Complex gain ``1/(1 + i f/f_c)`` at a frequency of the attraction; both broadcast."""
        cutoff_hz = self.response_hz_per_mm_per_s * np.maximum(speed_mm_per_s, _STANDING_MM_PER_S)
        return np.asarray(1 / (1 + 1j * np.asarray(frequency_hz) / cutoff_hz))

    def power(
        self, frequency_hz: float | Array, speed_mm_per_s: float | Array
    ) -> npt.NDArray[np.float64]:
        """Squared size of `gain`. A ripple adds to mean friction nearly in proportion to it."""
        gain = self.gain(frequency_hz, speed_mm_per_s)
        return np.asarray(np.square(gain.real) + np.square(gain.imag))

    def follow(self, drive: Array, distance_mm: Array, before: Array | None = None) -> Array:
        """Filter a drive that is linear in slid distance between samples, without an error.

        Solves ``dy/ds = 2 pi r (drive - y)``.

        Parameters
        ----------
        drive : ndarray, shape (rows, samples)
            Signal that friction follows, such as the attraction.
        distance_mm : ndarray, shape (samples,)
            Slid distance of two samples or more, not decreasing.
        before : ndarray, shape (rows,), optional
            y at the first sample; by default that of the drive.

        Returns
        -------
        ndarray, shape (rows, samples)
        """
        from scipy.linalg import solve_banded  # slow to import; rendering uses `gain` alone

        if before is None:
            before = drive[:, 0]
        step = 2 * np.pi * self.response_hz_per_mm_per_s * np.diff(distance_mm)
        decay = np.exp(-step)
        # (1 - exp(-d))/d, by expm1 without cancellation; 1 - d/2 where the finger hardly moves.
        moving = np.where(step > 1e-9, step, 1.0)
        share = np.where(step > 1e-9, -np.expm1(-step) / moving, 1 - step / 2)
        gain = (share - decay) * drive[:, :-1] + (1 - share) * drive[:, 1:]
        # y_k = decay_k y_(k-1) + gain_k from y_0 = before: a matrix of two bands.
        bands = np.stack([np.ones(len(step) + 1), np.append(-decay, 0.0)])
        right = np.concatenate([before[:, None], gain], axis=1)
        return np.asarray(solve_banded((1, 0), bands, right.T, check_finite=False).T)
