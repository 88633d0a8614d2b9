"""Noise with a given spectrum: stationary, endless, and computed from any sample on."""

from __future__ import annotations

from functools import lru_cache
from math import inf
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import BeforeValidator, Field, model_validator

from haptix.errors import InputError
from haptix.signals.in_time import below_nyquist
from haptix.signals.signal import Array, Length, NotNegative, Number, Row, Signal

_HOP = 1 << 16
_FADE = np.sin(np.pi / 2 * (np.arange(_HOP) + 0.5) / _HOP)


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
    """

    deviation: NotNegative
    frequency_hz: Row
    seed: Annotated[int, Field(strict=True, ge=0), BeforeValidator(_whole)]
    density: Row = ()
    mean: Number = 0.0
    length_s: Length = inf
    exponent: Number = 0.0
    kind: Literal["time-noise"] = "time-noise"

    @classmethod
    def upgrade(cls, fields: dict[str, Any], version: int) -> dict[str, Any]:
        """Read the kind ``noise`` of version 0.1, whose fields had other names."""
        if fields["kind"] != "noise":
            return fields
        names = {"rms": "deviation", "offset": "mean"}
        now = {names.get(name, name): value for name, value in fields.items()}
        return now | {"kind": "time-noise"}

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
    power[[0, -1]] = 0.0  # mean and Nyquist have no phase
    total = power.sum()
    if total == 0:
        raise InputError(
            f"frequency_hz: the band is narrower than the {sample_rate_hz / 2 / _HOP:g} Hz that "
            "noise resolves; widen it"
        )
    draw = np.random.Generator(np.random.Philox(key=seed, counter=[0, 0, 0, index]))
    kept = np.flatnonzero(power)
    spectrum = np.zeros(len(frequency), dtype=complex)
    # Each line is A cos + B sin of variance P / total: the transform of size N carries N / 2 of it.
    pair = draw.standard_normal((2, len(kept)))
    spectrum[kept] = (pair[0] + 1j * pair[1]) * (np.sqrt(power[kept] / total) * _HOP)
    return np.asarray(np.fft.irfft(spectrum, 2 * _HOP))
