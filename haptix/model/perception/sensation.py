"""Sensation level of an attraction that comes in blocks, by the rule of two channels."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass
from functools import lru_cache
from math import ceil, log10
from typing import Protocol

import numpy as np
import numpy.typing as npt
from scipy.fft import next_fast_len

from haptix.base.checks import Array
from haptix.model.perception.thresholds import Channel, Perception

_SKIRT_HZ = 8.0  # half the width of the filters' transition, which lies outside a channel's data
_FILTER_S = 2 / _SKIRT_HZ  # length of a Hann window with that transition
_OVERSAMPLED = 3.0  # rate at which energies are summed over the highest frequency
_ROUNDING = 1e-20  # share of the energy that counts as rounding
_SILENT = 1e-12  # energy 60 dB below the threshold
_LONGEST = 300.0  # number of time constants whose exponential fits into a float64


@dataclass(frozen=True)
class Loudest:
    """Highest sensation level of a stimulus.

    Attributes
    ----------
    channel : str or None
        Channel that mediates detection; None if nothing lies within the thresholds' data.
    sensation_db : float or None
        Its level above the detection threshold [dB]; felt where above 0.
    at_s : float or None
        When it is highest [s].
    edges_db : float or None
        Level of the click by which the attraction begins or ends at once, whichever is higher, by
        itself: no part of the other. None without such an edge.
    is_placeholder : bool
        Whether the thresholds or the time constant of that channel were not measured.
    outside_share : float
        Share of the energy of the attraction's changes whose frequencies have no thresholds. What
        it adds is not known.
    """

    channel: str | None
    sensation_db: float | None
    at_s: float | None
    is_placeholder: bool
    outside_share: float
    edges_db: float | None = None


class Pulls(Hashable, Protocol):
    """How the attraction of sine drives depends on their frequency."""

    def pull(self, drive_hz: Array) -> Array:
        """Attraction of sine drives at frequencies [Hz], over that of the reference drive."""


class SensationInTime:
    """Sensation level of an attraction that comes in blocks, by the rule of two channels.

    In each channel the attraction is filtered by the inverse of the detection thresholds and
    squared. The energy is summed with the channel's time constant T: ``E' = (e - E) / T``. A long
    tone has the level of `thresholds`; one of duration d has ``1 - exp(-d / T)`` of its energy
    (the form of Zwislocki, J. Acoust. Soc. Am. 32, 1046 (1960)). The highest level in time
    counts. The attraction is taken as constant before the first and after the last sample. Its
    sudden beginning and end are clicks, whose level is reported separately.

    Parameters
    ----------
    perception : Perception
        Detection thresholds.
    sample_rate_hz : float
        Samples per second.
    skin : Pulls, optional
        Attraction of the skin by a threshold's sine drive; by default, that of all drives alike.
    """

    def __init__(
        self, perception: Perception, sample_rate_hz: float, skin: Pulls | None = None
    ) -> None:
        self._channels, self._rate = perception.channels, sample_rate_hz
        self._design = _design(perception.channels, sample_rate_hz, skin)
        self._before = np.zeros(self._design.taps - 1)
        self._energy = np.zeros(len(self._channels))
        self._best = np.zeros(len(self._channels))
        self._best_at = np.zeros(len(self._channels))
        self._taken = 0
        self._known = self._changes = 0.0
        self._waiting = np.zeros(0)
        self._ends: tuple[float, float] | None = None
        self.changes = np.zeros(0)
        """Power spectrum of the changes of the last samples, in a Hann window."""

    def take(self, attraction: Array) -> None:
        """Take the next samples of ``v^2 / 2``, shape (samples,), for a drive v in volts."""
        if not len(attraction):
            return
        self._count_known(attraction)
        first, last = float(attraction[0]), float(attraction[-1])
        if self._ends is None:
            self._before += first
        self._ends = (first if self._ends is None else self._ends[0], last)
        if len(self._waiting):
            self._sum_up(self._waiting)
            self._taken += len(self._waiting)
        self._waiting = attraction

    def finish(self) -> Loudest:
        """Return the highest level; the attraction ends with the last sample that was taken."""
        begins, ends = self._ends or (0.0, 0.0)
        self._sum_up(np.concatenate([self._waiting, np.full(self._design.taps - 1, ends)]))
        click = max(begins, ends) ** 2 * max(self._design.clicks)
        edges_db = 5 * log10(click) if click > _SILENT else None
        outside = 0.0
        if self._changes > 0:
            outside = max(0.0, 1.0 - self._known / self._changes)
        best = int(np.argmax(self._best))
        if self._best[best] <= _SILENT:
            return Loudest(None, None, None, False, outside, edges_db)
        channel = self._channels[best]
        guessed = channel.is_placeholder or channel.summation_is_placeholder
        level = 5 * log10(float(self._best[best]))
        at_s = float(self._best_at[best])
        return Loudest(channel.name, level, at_s, guessed, outside, edges_db)

    def _count_known(self, attraction: Array) -> None:
        """Add the energy of the changes, and of those within the data of a channel."""
        taper, inside = self._design.taper(len(attraction))
        spectrum = np.fft.rfft((attraction - attraction.mean()) * taper)
        self.changes = energy = spectrum.real**2 + spectrum.imag**2
        total = float(energy.sum())
        if total > _ROUNDING * float(np.sum(attraction * attraction)) * len(attraction):
            self._changes += total
            self._known += float(energy[inside].sum())

    def _sum_up(self, attraction: Array) -> None:
        """Filter the next samples, and sum their energies."""
        values = np.concatenate([self._before, attraction])
        self._before = values[len(attraction) :]
        each, taps = self._design.each, self._design.taps
        # Cutting the spectrum short gives a signal with fewer samples per second. The circular
        # convolution corrupts the first samples only, which were summed before.
        few = 2 * next_fast_len(ceil(len(values) / each / 2), real=True)
        spectrum = np.fft.rfft(values, few * each)[: few // 2 + 1]
        at = np.arange(ceil((taps - 1) / each), ceil(len(values) / each))
        for index, response in enumerate(self._design.responses(few)):
            shares = np.fft.irfft(spectrum * response, few)[at] / each
            # Twice the square has a mean of 1 for a sine at its threshold.
            self._summed(index, 2 * shares * shares, at * each)

    def _summed(self, index: int, energy: Array, at: npt.NDArray[np.intp]) -> None:
        channel = self._channels[index]
        step = self._design.each / self._rate
        time_s = channel.summation_time_s
        piece = max(1, int(_LONGEST * time_s / step))
        for first in range(0, len(energy), piece):
            part = energy[first : first + piece]
            fall = np.exp(-step / time_s * np.arange(1, len(part) + 1))
            new = -np.expm1(-step / time_s) * np.cumsum(part / fall)
            summed = fall * (self._energy[index] + new)
            self._energy[index] = summed[-1]
            best = int(np.argmax(summed))
            if summed[best] > self._best[index]:
                self._best[index] = summed[best]
                sample = self._taken - (self._design.taps - 1) * 3 // 2 + at[first + best]
                self._best_at[index] = max(0.0, sample / self._rate)


class _Design:
    """Filters of some channels at a sample rate."""

    def __init__(self, channels: tuple[Channel, ...], rate_hz: float, skin: Pulls | None) -> None:
        self._channels, self._rate, self._skin = channels, rate_hz, skin
        highest = max(channel.felt_hz[-1] for channel in channels) + _SKIRT_HZ
        self.each = max(1, int(rate_hz / (_OVERSAMPLED * highest)))
        """Number of samples from one point at which energies are summed to the next."""
        self.taps = round(_FILTER_S * rate_hz) | 1
        """Length of a filter in samples."""
        self._filters = [self._filter(channel) for channel in channels]
        self.clicks = list(map(self._click, self._filters, channels))
        """Highest energy in each channel of an attraction of 1 V^2 that begins suddenly."""
        self.taper = lru_cache(maxsize=8)(self._taper)
        self.responses = lru_cache(maxsize=8)(self._responses)

    def _filter(self, channel: Channel) -> Array:
        """Impulse response, which turns the attraction into shares of its detection threshold."""
        size = 1 << (4 * self.taps).bit_length()
        felt = np.fft.rfftfreq(size, 1 / self._rate)
        low, high = channel.felt_hz[0], channel.felt_hz[-1]
        inside = (felt >= low - _SKIRT_HZ) & (felt <= high + _SKIRT_HZ)
        threshold_v = 10 ** (channel.thresholds(felt.clip(low, high)) / 20)
        drive_hz = felt.clip(low, high) / 2
        pull = 1.0 if self._skin is None else self._skin.pull(drive_hz)
        # A sine drive of amplitude V attracts with V^2 / 4.
        response = np.fft.irfft(np.where(inside, 4 / (pull * threshold_v**2), 0.0))
        return np.roll(response, self.taps // 2)[: self.taps] * np.hanning(self.taps + 2)[1:-1]

    def _click(self, impulse: Array, channel: Channel) -> float:
        shares = np.cumsum(impulse)
        after_s = np.arange(len(shares)) / self._rate
        time_s = channel.summation_time_s
        grown = np.cumsum(2 * shares * shares * np.exp(after_s / time_s)) * np.exp(
            -after_s / time_s
        )
        return float(grown.max() * -np.expm1(-1 / (self._rate * time_s)))

    def _responses(self, few: int) -> list[npt.NDArray[np.complex128]]:
        """Frequency responses for transforms of `few` times `each` samples."""
        size = few * self.each
        return [np.fft.rfft(impulse, size)[: few // 2 + 1] for impulse in self._filters]

    def _taper(self, size: int) -> tuple[Array, npt.NDArray[np.bool_]]:
        """Hann window of a length, and a mask of the lines of its spectrum that have thresholds."""
        felt = np.fft.rfftfreq(size, 1 / self._rate)
        inside = np.zeros(len(felt), bool)
        for channel in self._channels:
            low_hz, *_, high_hz = channel.felt_hz
            inside |= (felt >= low_hz - _SKIRT_HZ) & (felt <= high_hz + _SKIRT_HZ)
        return np.hanning(size + 2)[1:-1], inside


_design = lru_cache(maxsize=16)(_Design)
