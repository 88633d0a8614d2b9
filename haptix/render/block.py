"""One block: from fingers on a texture to drive samples."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
import numpy.typing as npt

from haptix.errors import InputError
from haptix.finger_response import FingerResponse
from haptix.render.fingers import FingerPoints
from haptix.render.inverse import Amplitudes, SliceInverse, Wishes
from haptix.render.modulation import Carrier
from haptix.status import Status
from haptix.surface import FrictionSurface
from haptix.texture import FrictionField

Array = npt.NDArray[np.float64]

CONTROL_HZ = 12_000.0
"""Rate at which friction is asked for and inverted; the amplitude is a line in between. Skin feels
up to 1 kHz, and a line between points 12 times as dense follows that within 3 %."""

SLEW_V_PER_S = 4e5
"""Of the amplitude: an edge of the texture takes half a millisecond to the full 200 V. Faster, and
the screen clicks; a finger at 100 mm/s moves 50 um meanwhile."""

Combination = Literal["strongest", "first", "mean"]
"""Which amplitude the one electrode under several fingers gets."""


@dataclass(frozen=True, slots=True)
class RenderedBlock:
    """What was wanted and what was sent, at control points: the ends of equal steps of samples.

    Parameters
    ----------
    first_sample, step : int
        Of the block, and from one point to the next.
    fingers : int
        How many touched.
    target_mu : ndarray, shape (fingers * points,)
        Friction that the texture wants.
    status : ndarray of int, shape (fingers * points,)
        Numbers of `Status`.
    gain : ndarray, shape (fingers * points,)
        How much of its amplitude each finger was given: below 1 where it fades.
    amplitude_v : ndarray, shape (points,)
        Amplitude that was sent, fades and the electrode's other fingers included.
    drive_v : ndarray, shape (samples,)
        Drive signal.
    """

    first_sample: int
    step: int
    fingers: int
    target_mu: Array
    status: npt.NDArray[np.int8]
    gain: Array
    amplitude_v: Array
    drive_v: Array

    @property
    def sample(self) -> npt.NDArray[np.int64]:
        """Index of the sample at each point, shape (points,)."""
        points = np.arange(1, len(self.amplitude_v) + 1)
        return np.asarray(self.first_sample + self.step * points)


class BlockRenderer:
    """Renders blocks one after the other; the amplitude goes on from the last.

    A carrier is too fast for the contact, which follows the mean pull. A direct drive is not: its
    ripple, at twice its frequency, raises the mean friction of a period, the more the faster the
    finger slides. To second order that goes with the square of the ripple that the finger follows.

    Parameters
    ----------
    surface : FrictionSurface
        Sliced to the frequency of the wave.
    field : FrictionField
        What to feel.
    compress : (float, float) or None
        See `Wishes.span`.
    wave : Carrier
        What the amplitude modulates.
    step : int
        Samples from one control point to the next.
    combination : {"strongest", "first", "mean"}
        See `Combination`.
    slew_v_per_s : float
        Fastest change of the amplitude.
    """

    def __init__(
        self,
        surface: FrictionSurface,
        field: FrictionField,
        compress: tuple[float, float] | None,
        wave: Carrier,
        step: int,
        combination: Combination = "strongest",
        slew_v_per_s: float = SLEW_V_PER_S,
    ) -> None:
        if combination not in get_args(Combination):
            raise InputError(
                f'combination: expected "strongest", "first" or "mean", got {combination!r}'
            )
        if not slew_v_per_s > 0:
            raise InputError(f"slew_v_per_s: expected a number above 0, got {slew_v_per_s!r}")
        self._inverse = SliceInverse(surface, None, wave.peak_per_sine)
        pulls = wave.pulls
        self._averaged = None if pulls is None else SliceInverse(surface, pulls, wave.peak_per_sine)
        self._response = FingerResponse(surface.response_hz_per_mm_per_s)
        self._compress = compress
        self.field = field
        self._wave = wave
        self._step = step
        # Times the wave, rounding included, never above the limit.
        peak = wave.peak_per_sine
        self._most_v = surface.voltage_limit_v / (1.0 if peak <= 1 else peak * (1 + 1e-12))
        self._combination = combination
        self._most_step_v = slew_v_per_s * step / wave.sample_rate_hz
        self._share = np.arange(step) / step
        self._last_v = 0.0

    @property
    def field(self) -> FrictionField:
        """What to feel; another one counts from the next block."""
        return self._feels[0]

    @field.setter
    def field(self, field: FrictionField) -> None:
        # One tuple, so that a thread that renders sees the old pair or the new one.
        self._feels = (field, Wishes(field.target, self._compress))

    @property
    def step(self) -> int:
        """Samples from one control point to the next."""
        return self._step

    def begin(self) -> None:
        """Start from rest."""
        self._last_v = 0.0

    def render(self, fingers: FingerPoints, first_sample: int, points: int) -> RenderedBlock:
        """Render the steps that end at each of the fingers' points."""
        line = np.empty(points + 1)
        line[0] = self._last_v
        if fingers.count:
            found = self._amplitudes(fingers, points)
            amplitude = found.voltage_v * fingers.gain
            if fingers.count > 1:
                amplitude = self._combined(amplitude.reshape(fingers.count, points))
            np.minimum(amplitude, self._most_v, out=line[1:])
            wanted, status = found.wanted_mu, found.status
        else:
            line[1:] = 0.0
            wanted, status = _NO_WISH, _NO_STATUS
        change = line[1:] - line[:-1]
        if np.abs(change).max() > self._most_step_v:
            change = self._slewed(line)
        self._last_v = float(line[-1])
        drive = (line[:-1, None] + change[:, None] * self._share).ravel()
        drive_v = self._wave.modulate(drive, first_sample)
        return RenderedBlock(
            first_sample,
            self._step,
            fingers.count,
            wanted,
            status,
            fingers.gain,
            line[1:],
            drive_v,
        )

    def reachable(self, normal_force_n: Array, speed_mm_per_s: Array) -> tuple[Array, Array]:
        """Lowest and highest friction coefficient that a finger can be given, shape (points,)."""
        low, high = self._inverse.reachable(normal_force_n)
        if self._averaged is not None:
            _, ripples = self._averaged.reachable(normal_force_n)
            high = high + self._followed(speed_mm_per_s) * (ripples - high)
        return low, high

    def _amplitudes(self, fingers: FingerPoints, points: int) -> Amplitudes:
        """Of each finger at each point."""
        field, wishes = self._feels
        wish = field.friction(fingers.x_mm, fingers.y_mm, fingers.footprint_mm)
        found = self._inverted(self._inverse, fingers, wish, wishes, points)
        if self._averaged is None:
            return found
        ripples = self._inverted(self._averaged, fingers, wish, wishes, points)
        speed = fingers.footprint_mm * self._wave.sample_rate_hz / self._step
        share = self._followed(np.float64(speed))
        return Amplitudes(
            found.voltage_v + share * (ripples.voltage_v - found.voltage_v),
            found.wanted_mu + share * (ripples.wanted_mu - found.wanted_mu),
            np.where(found.status == Status.OK, ripples.status, found.status),
        )

    def _followed(self, speed_mm_per_s: Array | np.float64) -> Array | np.float64:
        """How much of the pull's ripple, squared, the contact of a sliding finger follows."""
        gain = self._response.gain(2 * self._wave.frequency_hz, speed_mm_per_s)
        return np.square(gain.real) + np.square(gain.imag)

    def _inverted(
        self,
        inverse: SliceInverse,
        fingers: FingerPoints,
        wish: Array,
        wishes: Wishes,
        points: int,
    ) -> Amplitudes:
        if fingers.row_force_n is None:
            return inverse(fingers.normal_force_n, wish, wishes)
        each = [
            inverse.row(force)(wish[i * points : (i + 1) * points], wishes)
            for i, force in enumerate(fingers.row_force_n)
        ]
        if len(each) == 1:
            return each[0]
        return Amplitudes(
            np.concatenate([one.voltage_v for one in each]),
            np.concatenate([one.wanted_mu for one in each]),
            np.concatenate([one.status for one in each]),
        )

    def _combined(self, each: Array) -> Array:
        if self._combination == "first":
            return np.asarray(each[0])
        if self._combination == "mean":
            return np.asarray(each.mean(axis=0))
        return np.asarray(each.max(axis=0))

    def _slewed(self, line: Array) -> Array:
        """Hold every step of `line` to the slew limit, in place; return the steps."""
        most = self._most_step_v
        values = line.tolist()
        for i in range(1, len(values)):
            before = values[i - 1]
            values[i] = min(max(values[i], before - most), before + most)
        line[:] = values
        return np.diff(line)


_NO_WISH = np.empty(0)
_NO_STATUS = np.empty(0, dtype=np.int8)
