"""Amplitude to drive signal, and back."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from haptix.errors import InputError, check_positive

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Carrier:
    """A sine of given frequency on the device's sample clock, continuous across blocks.

    Parameters
    ----------
    frequency_hz : float
        At most a quarter of the sample rate: below that a period has too few samples to carry its
        amplitude.
    sample_rate_hz : float
        Of the device.
    """

    frequency_hz: float
    sample_rate_hz: float

    def __post_init__(self) -> None:
        check_positive("frequency_hz", self.frequency_hz)
        check_positive("sample_rate_hz", self.sample_rate_hz)
        if self.frequency_hz > self.sample_rate_hz / 4:
            raise InputError(
                f"frequency_hz: expected at most a quarter of the device's {self.sample_rate_hz:g} "
                f"samples per second, got {self.frequency_hz:g} Hz; choose a lower carrier"
            )

    def modulate(self, amplitude_v: Array, first_sample: int) -> Array:
        """Drive signal [V] for amplitudes at consecutive samples, shape (samples,)."""
        return amplitude_v * self._wave(first_sample, len(amplitude_v))

    def demodulate(self, drive_v: Array) -> tuple[Array, Array]:
        """Sample index at the middle, and amplitude [V], of every whole carrier period.

        The amplitude is the least-squares one of the known carrier within each period; the signal
        starts at sample 0 of the clock.
        """
        period = self.sample_rate_hz / self.frequency_hz
        bounds = np.arange(0, len(drive_v) + 1e-9, period).round().astype(int)
        wave = self._wave(0, len(drive_v))
        starts = bounds[:-1]
        product = np.add.reduceat(drive_v[: bounds[-1]] * wave[: bounds[-1]], starts)
        energy = np.add.reduceat(wave[: bounds[-1]] ** 2, starts)
        return (bounds[:-1] + bounds[1:] - 1) / 2, product / energy

    def _wave(self, first_sample: int, count: int) -> Array:
        # The phase in periods, reduced before the sine: hours of samples keep their precision.
        turns = np.arange(first_sample, first_sample + count) * (
            self.frequency_hz / self.sample_rate_hz
        )
        return np.asarray(np.sin(2 * np.pi * (turns % 1.0)))
