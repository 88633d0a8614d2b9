"""Drives: from an amplitude to a drive signal and back."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from math import pi, sqrt
from typing import Literal

import numpy as np
import numpy.typing as npt

from haptix.base import checks
from haptix.base.checks import Array
from haptix.base.display import Displayed
from haptix.base.errors import InputError
from haptix.model.waves import Waveform, sine_table, turns

_LEAST_DC_FREE = 1e-6
"""Largest mean of a waveform over its peak, as the rounding of a thousand samples may leave it."""
_PLACES = 4096  # samples in a period of a square wave
_AMPLITUDES = np.ones(1)


@dataclass(frozen=True)
class Drive(ABC):
    """A periodic voltage on the device's sample clock, continuous across blocks.

    Parameters
    ----------
    frequency_hz : float
        At most a quarter of the device's sample rate: a shorter period has too few samples to
        carry its amplitude.
    """

    frequency_hz: float

    def __post_init__(self) -> None:
        checks.positive("frequency_hz", self.frequency_hz)

    def check_rate(self, sample_rate_hz: float) -> None:
        """Raise `InputError` unless a device of this sample rate can play the drive."""
        checks.positive("sample_rate_hz", sample_rate_hz)
        if self.frequency_hz > sample_rate_hz / 4:
            raise InputError(
                f"frequency_hz: expected at most a quarter of the device's {sample_rate_hz:g} "
                f"samples per second, got {self.frequency_hz:g} Hz; choose a lower carrier"
            )

    @property
    def peak_per_sine(self) -> float:
        """Peak of the drive over the amplitude of the sine with the same mean attraction."""
        return 1.0

    @property
    def attraction(self) -> Array | None:
        """Attraction at even times of a period over its mean; None if the contact follows the mean.

        The contact is too slow for a carrier, and a constant attraction has no ripple.
        """
        return None

    def highest_v(self, slew_v_per_s: float, change_v_per_s: float, sample_rate_hz: float) -> float:
        """Highest amplitude [V] whose drive keeps a slew limit while the amplitude changes.

        Parameters
        ----------
        slew_v_per_s : float
            The limit [V/s].
        change_v_per_s : float
            How fast the amplitude changes at most [V/s].
        sample_rate_hz : float
        """
        # The slopes of wave and amplitude peak a quarter of a period apart, and so add as squares.
        wave_v_per_s = sqrt(max(slew_v_per_s**2 - change_v_per_s**2, 0.0))
        return wave_v_per_s / (2 * pi * self.frequency_hz)

    def modulate(self, amplitude_v: Array, first_sample: int, sample_rate_hz: float) -> Array:
        """Drive signal [V] for amplitudes at consecutive samples, shape (samples,).

        Parameters
        ----------
        amplitude_v : array, shape (samples,)
        first_sample : int
            Number of the first, on the clock of samples.
        sample_rate_hz : float

        Examples
        --------
        >>> import numpy as np
        >>> from haptix.play import SineCarrier
        >>> SineCarrier(1000.0).modulate(np.full(4, 50.0), 0, 4000.0).round(6).tolist()
        [0.0, 50.0, 0.0, -50.0]
        """
        period = self.period(sample_rate_hz)
        if period is None:
            return amplitude_v * self.wave(first_sample, len(amplitude_v), sample_rate_hz)
        at = first_sample % len(period) + np.arange(len(amplitude_v))
        return amplitude_v * np.take(period, at, mode="wrap")

    def demodulate(self, drive_v: Array, sample_rate_hz: float) -> tuple[Array, Array]:
        """Sample index at the middle, and amplitude [V], of every whole period.

        The amplitude is a least-squares fit of the known wave within each period. The signal
        starts at sample 0 of the clock.

        Parameters
        ----------
        drive_v : array, shape (samples,)
            The signal [V].
        sample_rate_hz : float

        Examples
        --------
        >>> import numpy as np
        >>> from haptix.play import SineCarrier
        >>> drive_v = SineCarrier(1000.0).modulate(np.full(480, 50.0), 0, 48000.0)
        >>> _, amplitude_v = SineCarrier(1000.0).demodulate(drive_v, 48000.0)
        >>> float(amplitude_v.max().round(3))
        50.0
        """
        period = sample_rate_hz / self.frequency_hz
        bounds = np.arange(0, len(drive_v) + 1e-9, period).round().astype(int)
        wave = self.modulate(np.ones(len(drive_v)), 0, sample_rate_hz)
        starts = bounds[:-1]
        product = np.add.reduceat(drive_v[: bounds[-1]] * wave[: bounds[-1]], starts)
        energy = np.add.reduceat(wave[: bounds[-1]] ** 2, starts)
        return (bounds[:-1] + bounds[1:] - 1) / 2, product / energy

    def period(self, sample_rate_hz: float) -> Array | None:
        """Samples of a wave of 1 V from sample 0 until it repeats; None if that takes too many."""
        return None

    @abstractmethod
    def wave(self, first_sample: int, count: int, sample_rate_hz: float) -> Array:
        """Samples of the wave of amplitude 1 V, shape (count,).

        Parameters
        ----------
        first_sample : int
            Number of the first, on the clock of samples.
        count : int
        sample_rate_hz : float

        Examples
        --------
        >>> from haptix.play import SineCarrier
        >>> SineCarrier(1000.0).wave(0, 4, 4000.0).round(6).tolist()
        [0.0, 1.0, 0.0, -1.0]
        """


@dataclass(frozen=True)
class SineCarrier(Drive):
    """A sine whose frequency is too high to be felt; its amplitude is the envelope.

    Examples
    --------
    >>> SineCarrier(4000.0).frequency_hz
    4000.0
    """

    def period(self, sample_rate_hz: float) -> Array | None:
        """Samples until the sine comes again, see `Drive.period`."""
        return sine_table(self.frequency_hz, sample_rate_hz)

    def wave(self, first_sample: int, count: int, sample_rate_hz: float) -> Array:
        """Samples of the sine, see `Drive.wave`."""
        # For blocks of a millisecond this is twice as fast as `haptix.model.waves.sine`.
        phase = turns(first_sample, count, self.frequency_hz, sample_rate_hz)
        return np.sin(2 * np.pi * phase)


@dataclass(frozen=True)
class DriverCarrier(SineCarrier):
    """A carrier that the driver makes itself; the samples are its envelope."""

    def check_rate(self, sample_rate_hz: float) -> None:
        """Accept any rate: the samples hold only the envelope."""
        checks.positive("sample_rate_hz", sample_rate_hz)

    def highest_v(self, slew_v_per_s: float, change_v_per_s: float, sample_rate_hz: float) -> float:
        """Highest amplitude [V]; the driver counts the slews of amplitude and carrier together."""
        return max(slew_v_per_s - change_v_per_s, 0.0) / (2 * pi * self.frequency_hz)

    def period(self, sample_rate_hz: float) -> Array | None:
        """A constant 1 V, because the amplitudes themselves are sent."""
        return _AMPLITUDES

    def demodulate(self, drive_v: Array, sample_rate_hz: float) -> tuple[Array, Array]:
        """Sample index and amplitude [V] of every sample."""
        return np.arange(len(drive_v), dtype=float), drive_v


@dataclass(frozen=True)
class DirectWave(Displayed, Drive):
    """A wave of any shape at the frequency that is felt.

    Contact area follows the mean of the squared voltage, so an amplitude is that of the sine with
    the same mean attraction: a square wave of amplitude A peaks at ``A / sqrt(2)``.

    Parameters
    ----------
    waveform : "sine", "square" or array_like, shape (samples,)
        One period, or its samples. They may not all be 0. Their mean must be 0, since a constant
        voltage charges the skin and then attracts no more.

    Examples
    --------
    >>> wave = DirectWave(125.0).wave(0, 4, sample_rate_hz=500.0)
    >>> (wave + 0.0).round(6).tolist()
    [0.0, 1.0, 0.0, -1.0]
    """

    waveform: Literal["sine", "square"] | npt.ArrayLike = "sine"

    def __post_init__(self) -> None:
        super().__post_init__()
        mean = self._waveform.mean
        if abs(mean) > _LEAST_DC_FREE:
            raise InputError(
                f"waveform: expected a mean of 0, got {mean:.3g} of its peak; subtract the mean"
            )

    @cached_property
    def _waveform(self) -> Waveform:
        if not isinstance(self.waveform, str):
            return Waveform.of_samples(self.waveform)
        if self.waveform == "sine":
            return Waveform()
        if self.waveform == "square":
            # Steep edges that cross 0: a sample on an edge must not depend on rounding.
            places = np.sin(2 * np.pi * np.arange(_PLACES) / _PLACES)
            return Waveform.of_samples(np.sign(places.round(12)))
        raise InputError(f'waveform: expected "sine", "square" or samples, got {self.waveform!r}')

    @cached_property
    def peak_per_sine(self) -> float:
        """Peak of the drive over the amplitude of the sine with the same mean attraction."""
        return sqrt(0.5 / self._waveform.mean_square)

    def highest_v(self, slew_v_per_s: float, change_v_per_s: float, sample_rate_hz: float) -> float:
        """Highest amplitude [V], by the wave's largest step from one sample to the next."""
        phase = np.arange(_PLACES) / _PLACES
        after = self._waveform.at((phase + self.frequency_hz / sample_rate_hz) % 1.0)
        step = self.peak_per_sine * float(np.abs(after - self._waveform.at(phase)).max())
        most_v = (slew_v_per_s - self.peak_per_sine * change_v_per_s) / sample_rate_hz
        return max(most_v, 0.0) / step

    @property
    def attraction(self) -> Array | None:
        """Attraction at even times of a period over its mean; None if it is constant.

        Examples
        --------
        >>> DirectWave(125.0, "square").attraction is None  # steady: a square's square
        True
        """
        # 64 times suffice for the mean of a period; the offset keeps them away from edges.
        attraction = np.square(self._waveform.at((np.arange(64) + 0.37) / 64))
        attraction /= attraction.mean()
        return None if np.ptp(attraction) < 0.1 else attraction

    def wave(self, first_sample: int, count: int, sample_rate_hz: float) -> Array:
        """Samples of the wave, see `Drive.wave`."""
        phase = turns(first_sample, count, self.frequency_hz, sample_rate_hz)
        return self.peak_per_sine * self._waveform.at(phase)
