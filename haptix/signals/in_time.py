"""Signals in time: steps, ramps, pulses, tones, sweeps, corners and recordings."""

from __future__ import annotations

from dataclasses import dataclass
from math import gcd, inf, log, pi
from pathlib import Path

import numpy as np

from haptix.checks import Length, NotNegative, Positive, choice
from haptix.errors import FileFormatError, InputError
from haptix.signals.audio import HIGHEST_RATE_HZ, MOST_SAMPLES, file_hash, read_audio
from haptix.signals.described import set_corners
from haptix.signals.signal import Array, Signal
from haptix.waves import Waveform, sine, turns


@dataclass(frozen=True)
class Step(Signal):
    """`before` until `at_s`, `after` from there on."""

    kind = "step"
    before: float
    after: float
    at_s: NotNegative
    length_s: Length = inf

    def _inside(self, first: int, count: int, sample_rate_hz: float) -> Array:
        n = np.arange(first, first + count)
        return np.where(n < round(self.at_s * sample_rate_hz), self.before, self.after)


@dataclass(frozen=True)
class Ramp(Signal):
    """A straight line from `start` at 0 to `end` at the length."""

    kind = "ramp"
    start: float
    end: float
    length_s: Positive

    def _inside(self, first: int, count: int, sample_rate_hz: float) -> Array:
        t = np.arange(first, first + count) / sample_rate_hz
        return np.asarray(self.start + (self.end - self.start) * (t / self.length_s))


@dataclass(frozen=True)
class Pulse(Signal):
    """`height` for `width_s` from `at_s` on, `rest` before and after."""

    kind = "pulse"
    height: float
    width_s: Positive
    at_s: NotNegative = 0.0
    rest: float = 0.0
    length_s: Length = inf

    def _inside(self, first: int, count: int, sample_rate_hz: float) -> Array:
        begin = round(self.at_s * sample_rate_hz)
        n = np.arange(first - begin, first - begin + count)
        within = (n >= 0) & (n < round(self.width_s * sample_rate_hz))
        return np.where(within, self.height, self.rest)


@dataclass(frozen=True)
class Sine(Signal):
    """``offset + amplitude * sin(2 pi f t + phase)``.

    Examples
    --------
    >>> signal = Sine(0.1, 100.0).lasting(0.5) + 0.3
    >>> signal.length_s
    0.5
    """

    kind = "sine"
    amplitude: float
    frequency_hz: Positive
    phase_rad: float = 0.0
    offset: float = 0.0
    length_s: Length = inf

    def _inside(self, first: int, count: int, sample_rate_hz: float) -> Array:
        below_nyquist(self.frequency_hz, sample_rate_hz)
        wave = sine(first, count, self.frequency_hz, sample_rate_hz, self.phase_rad)
        return self.offset + self.amplitude * wave


@dataclass(frozen=True)
class Square(Signal):
    """``offset + amplitude`` for the first `duty` of a period, ``offset - amplitude`` then."""

    kind = "square"
    amplitude: float
    frequency_hz: Positive
    duty: float = 0.5
    offset: float = 0.0
    length_s: Length = inf

    def __post_init__(self) -> None:
        super().__post_init__()
        Waveform("square", self.duty)  # checks the duty

    def _inside(self, first: int, count: int, sample_rate_hz: float) -> Array:
        below_nyquist(self.frequency_hz, sample_rate_hz)
        # A millionth of a sample early, so that an edge on a sample is not lost by rounding.
        early = 1e-6 * self.frequency_hz / sample_rate_hz
        phase = turns(first, count, self.frequency_hz, sample_rate_hz) + early
        return self.offset + self.amplitude * Waveform("square", self.duty).at(phase)


@dataclass(frozen=True)
class Chirp(Signal):
    """A sine whose frequency goes from `start_hz` to `end_hz`, linearly or by equal ratios."""

    kind = "chirp"
    amplitude: float
    start_hz: Positive
    end_hz: Positive
    length_s: Positive
    law: str = "linear"
    phase_rad: float = 0.0
    offset: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        choice("law", self.law, ("linear", "logarithmic"))

    def _inside(self, first: int, count: int, sample_rate_hz: float) -> Array:
        below_nyquist(max(self.start_hz, self.end_hz), sample_rate_hz)
        t = np.arange(first, first + count) / sample_rate_hz
        if self.law == "linear" or self.start_hz == self.end_hz:
            turns = t * (self.start_hz + t * ((self.end_hz - self.start_hz) / self.length_s / 2))
        else:
            rate = log(self.end_hz / self.start_hz) / self.length_s
            turns = self.start_hz / rate * np.expm1(rate * t)
        return np.asarray(
            self.offset + self.amplitude * np.sin(2 * pi * (turns % 1.0) + self.phase_rad)
        )


@dataclass(frozen=True)
class Points(Signal):
    """Straight lines between corners; the last corner is the end."""

    kind = "points"
    t_s: tuple[float, ...]
    values_at: tuple[float, ...]

    def __post_init__(self) -> None:
        set_corners(self, "t_s", "values_at")
        if self.t_s[0] != 0:
            raise InputError(f"t_s: expected the first corner at 0 s, got {self.t_s[0]:g} s")
        object.__setattr__(self, "length_s", self.t_s[-1])

    def _inside(self, first: int, count: int, sample_rate_hz: float) -> Array:
        t = np.arange(first, first + count) / sample_rate_hz
        return np.asarray(np.interp(t, self.t_s, self.values_at))


@dataclass(frozen=True)
class Recorded(Signal):
    """A recorded signal, once; resampled where rates differ.

    Parameters
    ----------
    file : str
        WAV or FLAC file of one channel.
    gain, offset : float
        ``offset + gain * sample``, samples being within -1 and 1.
    sha256 : str
        Hash that the file must have; its own where none is given.
    """

    kind = "recorded"
    file: str
    gain: float = 1.0
    offset: float = 0.0
    sha256: str = ""

    def __post_init__(self) -> None:
        super().__post_init__()
        data, rate = read_audio(self.file)
        digest = file_hash(Path(self.file))
        if data.shape[1] != 1 or not len(data):
            raise FileFormatError(
                f"file: expected one channel with samples in {self.file}, got {data.shape[1]} "
                f"channels of {len(data)} samples"
            )
        if self.sha256 not in ("", digest):
            raise FileFormatError(f"file: {self.file} is not the recording with that sha256")
        at_rate = {float(rate): data[:, 0]}
        for name, value in (
            ("_own_rate", rate), ("_at_rate", at_rate), ("sha256", digest),
            ("length_s", len(data) / rate),
        ):  # fmt: skip
            object.__setattr__(self, name, value)

    def _inside(self, first: int, count: int, sample_rate_hz: float) -> Array:
        rate, at_rate = self._own_rate, self._at_rate  # type: ignore[attr-defined]
        if sample_rate_hz not in at_rate:
            from scipy.signal import resample_poly

            is_whole = sample_rate_hz == int(sample_rate_hz) and sample_rate_hz <= HIGHEST_RATE_HZ
            if not is_whole or len(at_rate[rate]) * sample_rate_hz > MOST_SAMPLES * rate:
                raise InputError(f"{self.file}: cannot be resampled to {sample_rate_hz:g} Hz")
            common = gcd(int(sample_rate_hz), rate)
            up, down = int(sample_rate_hz) // common, rate // common
            at_rate[sample_rate_hz] = resample_poly(at_rate[rate], up, down)
        values = np.zeros(count)
        found = at_rate[sample_rate_hz][first : first + count]
        values[: len(found)] = found
        return self.offset + self.gain * values


def below_nyquist(frequency_hz: float, sample_rate_hz: float) -> None:
    """Refuse what the sample rate cannot carry."""
    if frequency_hz >= sample_rate_hz / 2:
        raise InputError(
            f"frequency_hz: expected less than half of the {sample_rate_hz:g} samples per second, "
            f"got {frequency_hz:g} Hz"
        )
