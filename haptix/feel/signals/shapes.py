"""Signals in time: steps, ramps, pulses, tones, sweeps, corners, recordings, noise, mixtures."""

from __future__ import annotations

from functools import cached_property, lru_cache
from math import gcd, inf, log, pi, sqrt
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import BeforeValidator, Field, model_validator

from haptix.base.errors import FileFormatError, InputError
from haptix.base.kinds import AnyAsset
from haptix.feel.signals.audio_files import HIGHEST_RATE_HZ, MOST_SAMPLES, file_hash, read_audio
from haptix.feel.signals.signal import (
    AnySignal,
    Array,
    Length,
    NotNegative,
    Number,
    Positive,
    Row,
    Signal,
)
from haptix.model.waves import Waveform, sine, turns

_HOP = 1 << 16
_FADE = np.sin(np.pi / 2 * (np.arange(_HOP) + 0.5) / _HOP)
_BLOCK = 1 << 16  # samples


class Step(Signal):
    """`before` until `at_s`, `after` from there on.

    Parameters
    ----------
    before, after : float
        Value before the step, and from it on.
    at_s : float
        When it steps [s].
    length_s : float
        Length of the signal [s]; endless if not given.

    Examples
    --------
    >>> Step(0.0, 1.0, at_s=1.0).values(0, 4, 2.0).tolist()
    [0.0, 0.0, 1.0, 1.0]
    """

    before: Number
    after: Number
    at_s: NotNegative
    length_s: Length = inf
    kind: Literal["step"] = "step"

    def _inside(self, first: int, count: int, sample_rate_hz: float) -> Array:
        n = np.arange(first, first + count)
        return np.where(n < round(self.at_s * sample_rate_hz), self.before, self.after)


class Ramp(Signal):
    """A straight line from `start` at 0 to `end` at the length.

    Parameters
    ----------
    start, end : float
        First and last value.
    length_s : float

    Examples
    --------
    >>> Ramp(0.0, 1.0, length_s=1.0).values(0, 4, 4.0).tolist()
    [0.0, 0.25, 0.5, 0.75]
    """

    start: Number
    end: Number
    length_s: Positive
    kind: Literal["ramp"] = "ramp"

    def _inside(self, first: int, count: int, sample_rate_hz: float) -> Array:
        t = np.arange(first, first + count) / sample_rate_hz
        return np.asarray(self.start + (self.end - self.start) * (t / self.length_s))


class Pulse(Signal):
    """`height` for `width_s` from `at_s` on, `rest` before and after.

    Parameters
    ----------
    height, rest : float
        Value within the pulse, and outside.
    width_s : float
        Its width [s].
    at_s : float
        When it begins [s].
    length_s : float
        Length of the signal [s]; endless if not given.

    Examples
    --------
    >>> Pulse(height=1.0, width_s=0.5, at_s=0.5).values(0, 4, 2.0).tolist()
    [0.0, 1.0, 0.0, 0.0]
    """

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

    Parameters
    ----------
    amplitude, offset : float
        Amplitude, and the value about which it swings.
    frequency_hz : float
    phase_rad : float
        Phase at the start [rad].
    length_s : float
        Length [s]; endless if not given.

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
    """``offset + amplitude`` for the first `duty` of a period, ``offset - amplitude`` then.

    Parameters
    ----------
    amplitude, offset : float
        Amplitude, and the value about which it swings.
    frequency_hz : float
    duty : float
        Share of a period with the higher value, between 0 and 1.
    length_s : float
        Length [s]; endless if not given.

    Examples
    --------
    >>> Square(1.0, frequency_hz=1.0).values(0, 4, 4.0).tolist()
    [1.0, 1.0, -1.0, -1.0]
    """

    amplitude: Number
    frequency_hz: Positive
    duty: Annotated[Number, Field(gt=0, lt=1)] = 0.5
    offset: Number = 0.0
    length_s: Length = inf
    kind: Literal["square"] = "square"

    def _inside(self, first: int, count: int, sample_rate_hz: float) -> Array:
        below_nyquist(self.frequency_hz, sample_rate_hz)
        # Start a millionth of a sample early, so that rounding cannot move an edge off a sample.
        early = 1e-6 * self.frequency_hz / sample_rate_hz
        phase = turns(first, count, self.frequency_hz, sample_rate_hz) + early
        return self.offset + self.amplitude * Waveform("square", self.duty).at(phase)


class Chirp(Signal):
    """A sine whose frequency goes from `start_hz` to `end_hz`, linearly or by equal ratios.

    Parameters
    ----------
    amplitude, offset : float
        Amplitude of the sine, and the value about which it swings.
    start_hz, end_hz : float
        First and last frequency [Hz].
    length_s : float
    law : str
        "linear", or "logarithmic" for equal ratios in equal times.
    phase_rad : float
        Phase at the start [rad].

    Examples
    --------
    >>> Chirp(1.0, start_hz=50.0, end_hz=400.0, length_s=2.0).length_s
    2.0
    """

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
    """Straight lines between corners; the last corner is the end.

    Parameters
    ----------
    t_s : sequence of float
        Times of the corners [s], increasing.
    values_at : sequence of float
        Values at them.

    Examples
    --------
    >>> Points(t_s=(0.0, 1.0, 2.0), values_at=(0.0, 1.0, 0.0)).values(0, 5, 2.0).tolist()
    [0.0, 0.5, 1.0, 0.5, 0.0]
    """

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
            # The ends go on as they are. Each phase of the filter has a gain of its own, within
            # 7e-4, that a constant shows.
            both = np.column_stack([at_rate[rate], np.ones_like(at_rate[rate])])
            values, gain = resample_poly(both, up, down, padtype="edge").T
            at_rate[sample_rate_hz] = values / gain
        values = np.zeros(count)
        part = at_rate[sample_rate_hz][first : first + count]
        values[: len(part)] = part
        return self.offset + self.gain * values


def below_nyquist(frequency_hz: float, sample_rate_hz: float) -> None:
    """Raise `InputError` for a frequency that the sample rate cannot carry."""
    if frequency_hz >= sample_rate_hz / 2:
        raise InputError(
            f"frequency_hz: expected less than half of the {sample_rate_hz:g} samples per second, "
            f"got {frequency_hz:g} Hz"
        )


def _whole(seed: Any) -> Any:
    return int(seed) if isinstance(seed, np.integer) else seed


class TimeNoise(Signal):
    """Gaussian noise of a given deviation and shape of spectrum.

    Pieces of twice 65,536 samples are drawn in the frequency domain, each from the seed and its own
    number. They overlap by half with gains whose squares add to 1. So the variance is the same
    everywhere, the spectrum is resolved to the inverse of a piece's length (0.4 Hz at 48 kHz), and
    any block can be made without those before it.

    Parameters
    ----------
    deviation : float
        Standard deviation.
    frequency_hz : tuple of float
        Corners of the spectrum [Hz], increasing; no power outside.
    density : tuple of float
        Relative power per hertz at the corners, linear in between; by default a flat band.
    seed : int
        Same seed, same noise.
    exponent : float
        Power falls as ``1/f`` to this: 1 is pink, 2 brown noise; within the corners, which begin
        above 0 Hz then.
    mean : float
        Mean value.
    length_s : float
        Length [s].

    Examples
    --------
    >>> noise = TimeNoise(0.1, frequency_hz=(50.0, 500.0), seed=1, length_s=1.0)
    >>> bool((noise.values(0, 9, 48000.0) == noise.values(0, 9, 48000.0)).all())
    True
    """

    deviation: NotNegative
    frequency_hz: Row
    seed: Annotated[int, Field(strict=True, ge=0), BeforeValidator(_whole)]
    density: Row = ()
    mean: Number = 0.0
    length_s: Length = inf
    exponent: Number = 0.0
    kind: Literal["time-noise"] = "time-noise"

    @model_validator(mode="after")
    def _has_a_spectrum(self) -> Self:
        if not self.density:
            object.__setattr__(self, "density", (1.0,) * len(self.frequency_hz))
        self._check_corners("frequency_hz", "density")
        if self.frequency_hz[0] < 0 or min(self.density) < 0 or max(self.density) == 0:
            raise InputError("frequency_hz and density: expected 0 or more, and some density")
        if self.exponent and self.frequency_hz[0] == 0:
            raise InputError("frequency_hz: 1/f noise has no end of power at 0 Hz; begin above it")
        return self

    def _inside(self, first: int, count: int, sample_rate_hz: float) -> Array:
        below_nyquist(self.frequency_hz[-1], sample_rate_hz)
        values = np.empty(count)
        done = 0
        while done < count:
            hop, start = divmod(first + done, _HOP)
            run = min(count - done, _HOP - start)
            part = slice(start, start + run)
            # The second half of the piece before, the first of this one.
            old, new = (
                _piece(
                    self.frequency_hz, self.density, self.exponent, self.seed, index, sample_rate_hz
                )
                for index in (hop, hop + 1)
            )
            values[done : done + run] = (
                old[_HOP:][part] * _FADE[::-1][part] + new[:_HOP][part] * _FADE[part]
            )
            done += run
        return self.mean + self.deviation * values


@lru_cache(maxsize=8)
def _piece(
    corners_hz: tuple[float, ...],
    density: tuple[float, ...],
    exponent: float,
    seed: int,
    index: int,
    sample_rate_hz: float,
) -> Array:
    """Two hops of noise of variance 1."""
    frequency = np.fft.rfftfreq(2 * _HOP, 1 / sample_rate_hz)
    power = np.interp(frequency, corners_hz, density, left=0.0, right=0.0)
    if exponent:
        power *= np.maximum(frequency, frequency[1]) ** -exponent
    power[[0, -1]] = 0.0  # no power in the mean and at the Nyquist frequency, which have no phase
    total = power.sum()
    if total == 0:
        raise InputError(
            f"frequency_hz: the band is narrower than the {sample_rate_hz / 2 / _HOP:g} Hz that "
            "noise resolves; widen it"
        )
    draw = np.random.Generator(np.random.Philox(key=seed, counter=[0, 0, 0, index]))
    lines = np.flatnonzero(power)
    spectrum = np.zeros(len(frequency), dtype=complex)
    # Each line is A cos + B sin of variance P / total; in a transform of size N its factor is N /
    # 2.
    pair = draw.standard_normal((2, len(lines)))
    spectrum[lines] = (pair[0] + 1j * pair[1]) * (np.sqrt(power[lines] / total) * _HOP)
    return np.asarray(np.fft.irfft(spectrum, 2 * _HOP))


class Morph(Signal):
    """A mixture of two finite signals of one length.

    ``m + s x``: x is ``(1 - share) (a - a_mean) + share (b - b_mean)`` over its own deviation. Mean
    m and deviation s lie between those of the two in proportion to `share`. So two unlike noises do
    not become weaker half way, by a factor of sqrt(2), as they do where they are only faded.

    Parameters
    ----------
    start, end : Signal
        At shares of 0 and 1.
    share : float
        0 to 1.
    """

    start: AnySignal
    end: AnySignal
    share: Annotated[Number, Field(ge=0, le=1)]
    kind: Literal["morph"] = "morph"

    @model_validator(mode="after")
    def _is_of_one_length(self) -> Self:
        start_s, end_s = self.start.length_s, self.end.length_s
        if not start_s == end_s < inf:
            raise InputError(
                f"start and end: expected one length for both, got {start_s:g} s and {end_s:g} s; "
                "give it with .lasting(seconds), or as an excerpt"
            )
        return self

    @property
    def length_s(self) -> float:
        """Length of both."""
        return self.start.length_s

    def samples(self, sample_rate_hz: float) -> int | None:
        """Length in samples."""
        return self.start.samples(sample_rate_hz)

    def _inside(self, first: int, count: int, sample_rate_hz: float) -> Array:
        a_mean, b_mean, mean, scale = _even(self, sample_rate_hz)
        a = self.start.values(first, count, sample_rate_hz) - a_mean
        b = self.end.values(first, count, sample_rate_hz) - b_mean
        return np.asarray(mean + scale * ((1 - self.share) * a + self.share * b))


@lru_cache(maxsize=64)
def _even(morph: Morph, sample_rate_hz: float) -> tuple[float, float, float, float]:
    """Means of both, mean of the mixture, and the factor of its changes."""
    total = morph.samples(sample_rate_hz) or 0
    sums, products = np.zeros(2), np.zeros((2, 2))
    first_values: Array | None = None
    for first in range(0, total, _BLOCK):
        count = min(_BLOCK, total - first)
        both = [part.values(first, count, sample_rate_hz) for part in (morph.start, morph.end)]
        if first_values is None:
            first_values = np.array([values[0] for values in both])
        changes = [values - at for values, at in zip(both, first_values, strict=True)]
        sums += [float(change.sum()) for change in changes]
        # Not np.dot, whose last bit depends on the threads of the algebra library.
        products += [[float(np.sum(a * b)) for b in changes] for a in changes]
    assert first_values is not None  # a signal has a sample
    mean = sums / total
    covariance = products / total - np.outer(mean, mean)
    weights = np.array([1 - morph.share, morph.share])
    deviations = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    mixed = sqrt(max(float(weights @ covariance @ weights), 0.0))
    wanted = float(weights @ deviations)
    if mixed <= 1e-9 * wanted:
        raise InputError("start and end: they cancel each other at this share; choose another")
    means = mean + first_values
    scale = wanted / mixed if mixed > 0 else 1.0
    return float(means[0]), float(means[1]), float(weights @ means), scale
