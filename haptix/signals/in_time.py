"""Signals in time: steps, ramps, pulses, tones, sweeps, corners and recordings."""

from __future__ import annotations

from functools import cached_property
from math import gcd, inf, log, pi
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from haptix.errors import FileFormatError, InputError
from haptix.kinds import AnyAsset
from haptix.signals.audio import HIGHEST_RATE_HZ, MOST_SAMPLES, file_hash, read_audio
from haptix.signals.signal import Array, Length, NotNegative, Number, Positive, Row, Signal
from haptix.waves import Waveform, sine, turns


class Step(Signal):
    """`before` until `at_s`, `after` from there on."""

    before: Number
    after: Number
    at_s: NotNegative
    length_s: Length = inf
    kind: Literal["step"] = "step"

    def _inside(self, first: int, count: int, sample_rate_hz: float) -> Array:
        n = np.arange(first, first + count)
        return np.where(n < round(self.at_s * sample_rate_hz), self.before, self.after)


class Ramp(Signal):
    """A straight line from `start` at 0 to `end` at the length."""

    start: Number
    end: Number
    length_s: Positive
    kind: Literal["ramp"] = "ramp"

    def _inside(self, first: int, count: int, sample_rate_hz: float) -> Array:
        t = np.arange(first, first + count) / sample_rate_hz
        return np.asarray(self.start + (self.end - self.start) * (t / self.length_s))


class Pulse(Signal):
    """`height` for `width_s` from `at_s` on, `rest` before and after."""

    height: Number
    width_s: Positive
    at_s: NotNegative = 0.0
    rest: Number = 0.0
    length_s: Length = inf
    kind: Literal["pulse"] = "pulse"

    def _inside(self, first: int, count: int, sample_rate_hz: float) -> Array:
        begin = round(self.at_s * sample_rate_hz)
        n = np.arange(first - begin, first - begin + count)
        within = (n >= 0) & (n < round(self.width_s * sample_rate_hz))
        return np.where(within, self.height, self.rest)


class Sine(Signal):
    """``offset + amplitude * sin(2 pi f t + phase)``.

    Examples
    --------
    >>> signal = Sine(0.1, 100.0).lasting(0.5) + 0.3
    >>> signal.length_s
    0.5
    """

    amplitude: Number
    frequency_hz: Positive
    phase_rad: Number = 0.0
    offset: Number = 0.0
    length_s: Length = inf
    kind: Literal["sine"] = "sine"

    def _inside(self, first: int, count: int, sample_rate_hz: float) -> Array:
        below_nyquist(self.frequency_hz, sample_rate_hz)
        wave = sine(first, count, self.frequency_hz, sample_rate_hz, self.phase_rad)
        return self.offset + self.amplitude * wave


class Square(Signal):
    """``offset + amplitude`` for the first `duty` of a period, ``offset - amplitude`` then."""

    amplitude: Number
    frequency_hz: Positive
    duty: Annotated[Number, Field(gt=0, lt=1)] = 0.5
    offset: Number = 0.0
    length_s: Length = inf
    kind: Literal["square"] = "square"

    def _inside(self, first: int, count: int, sample_rate_hz: float) -> Array:
        below_nyquist(self.frequency_hz, sample_rate_hz)
        # A millionth of a sample early, so that an edge on a sample is not lost by rounding.
        early = 1e-6 * self.frequency_hz / sample_rate_hz
        phase = turns(first, count, self.frequency_hz, sample_rate_hz) + early
        return self.offset + self.amplitude * Waveform("square", self.duty).at(phase)


class Chirp(Signal):
    """A sine whose frequency goes from `start_hz` to `end_hz`, linearly or by equal ratios."""

    amplitude: Number
    start_hz: Positive
    end_hz: Positive
    length_s: Positive
    law: Literal["linear", "logarithmic"] = "linear"
    phase_rad: Number = 0.0
    offset: Number = 0.0
    kind: Literal["chirp"] = "chirp"

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


class Points(Signal):
    """Straight lines between corners; the last corner is the end."""

    t_s: Row
    values_at: Row
    kind: Literal["points"] = "points"

    @model_validator(mode="after")
    def _is_a_line(self) -> Self:
        self._check_corners("t_s", "values_at")
        if self.t_s[0] != 0:
            raise InputError(f"t_s: expected the first corner at 0 s, got {self.t_s[0]:g} s")
        return self

    @property
    def length_s(self) -> float:
        """Time of the last corner."""
        return self.t_s[-1]

    def _inside(self, first: int, count: int, sample_rate_hz: float) -> Array:
        t = np.arange(first, first + count) / sample_rate_hz
        return np.asarray(np.interp(t, self.t_s, self.values_at))


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

    file: AnyAsset
    gain: Number = 1.0
    offset: Number = 0.0
    sha256: str = ""
    kind: Literal["recorded"] = "recorded"

    @model_validator(mode="after")
    def _is_the_recording(self) -> Self:
        data, _ = self._recording
        if data.shape[1] != 1 or not len(data):
            raise FileFormatError(
                f"file: expected one channel with samples in {self.file.path}, got "
                f"{data.shape[1]} channels of {len(data)} samples"
            )
        digest = file_hash(self.file.path)
        if self.sha256 not in ("", digest):
            raise FileFormatError(f"file: {self.file.path} is not the recording with that sha256")
        object.__setattr__(self, "sha256", digest)
        return self

    @cached_property
    def _recording(self) -> tuple[Array, int]:
        return read_audio(self.file.path)

    @cached_property
    def _at_rate(self) -> dict[float, Array]:
        data, rate = self._recording
        return {float(rate): data[:, 0]}

    @property
    def length_s(self) -> float:
        """Length of the recording."""
        data, rate = self._recording
        return len(data) / rate

    def _inside(self, first: int, count: int, sample_rate_hz: float) -> Array:
        (_, rate), at_rate = self._recording, self._at_rate
        if sample_rate_hz not in at_rate:
            from scipy.signal import resample_poly

            is_whole = sample_rate_hz == int(sample_rate_hz) and sample_rate_hz <= HIGHEST_RATE_HZ
            if not is_whole or len(at_rate[rate]) * sample_rate_hz > MOST_SAMPLES * rate:
                raise InputError(f"{self.file.path}: cannot be resampled to {sample_rate_hz:g} Hz")
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
