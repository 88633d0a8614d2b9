"""One block: from fingers on a texture to drive samples."""

from __future__ import annotations

from math import sqrt
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from firmware_io import Device
from haptix.checks import Array, instance
from haptix.errors import InputError
from haptix.finger_response import FingerResponse
from haptix.layout import Layout
from haptix.motion import Motion
from haptix.native import DOUBLES, NULL, Struct, ffi, library
from haptix.render.drive import Drive, DriverCarrier, SineCarrier
from haptix.render.master import Mix
from haptix.render.settings import Combination, RenderSettings
from haptix.surface import FrictionSurface, Slice
from haptix.texture import Evaluator, Feelable, TargetKind, check_feelable
from haptix.waves import turns

CONTROL_HZ = 12_000.0
"""Rate at which friction is asked for and inverted; the amplitude is a line in between. Skin feels
up to 1 kHz, and a line between points 12 times as dense follows that within 3 %."""

_SHARES = 8
"""Parts of the ripple's square, from none to all of it followed, between which lines will do."""

_ROUNDED = 1e-9  # of a quarter: rounding does not move a point into the next one
_PARTS = 4  # places of the texture in a quarter of a period

_JOIN_S = 0.002  # over which a window that is rendered again meets what is queued behind it

_TARGETS: tuple[TargetKind, ...] = ("mu", "contrast", "share")
_COMBINATIONS: tuple[Combination, ...] = ("strongest", "first", "mean")
_BLOCK, _BYTES = ffi.typeof("hx_block *"), ffi.typeof("int8_t *")
_INT8 = np.dtype(np.int8)
_new, _address, _render = ffi.new, ffi.from_buffer, library.hx_render
_row, _FLOAT64 = np.ascontiguousarray, np.dtype(np.float64)
_ALL = Mix()  # full intensity, and no effects

DEFAULT_CARRIER_HZ = 4000.0
"""Above what skin feels, and a whole twelfth of the usual 48 kHz."""


class Fingers(NamedTuple):
    """Fingers of a block, and what each gets of the drive."""

    motion: Motion
    """Where they are, at the control points."""
    gain: Array
    """Share of its amplitude that each finger gets, 0 to 1, of the motion's shape."""
    touch_ids: tuple[int, ...] = ()
    """Which finger each is; live ones only."""

    @classmethod
    def none(cls, points: int) -> Fingers:
        """No finger touches."""
        return cls(Motion.none(points), np.empty(0))


class RenderedBlock(NamedTuple):
    """Target and drive at control points, which end equal steps of samples."""

    first_sample: int
    """First sample of the block."""
    step: int
    """Samples from one point to the next."""
    fingers: int
    """How many touched."""
    target_mu: Array
    """Friction that the texture asks for, shape (fingers * points,)."""
    status: npt.NDArray[np.int8]
    """Numbers of `Status`, shape (fingers * points,)."""
    gain: Array
    """Share of its amplitude that each finger got, below 1 where it fades, of the same shape."""
    amplitude_v: Array
    """Amplitude sent, after fades and the combination of fingers, shape (points,)."""
    drive_v: Array
    """Drive signal, shape (samples,)."""

    @property
    def sample(self) -> npt.NDArray[np.int64]:
        """Index of the sample at each point, shape (points,)."""
        points = np.arange(1, len(self.amplitude_v) + 1)
        return np.asarray(self.first_sample + self.step * points)


class RenderCore:
    """Renders single blocks; it holds no clock and no thread, and remembers nothing.

    The contact is too slow for a carrier and follows the mean attraction. It follows part of the
    ripple of a direct drive, at twice the drive's frequency: this raises the mean friction of a
    period, the more the faster the finger slides. Friction is that mean, with the finger's
    response: nearly linear in the square of the ripple that the finger follows.

    Parameters
    ----------
    surface : FrictionSurface
        Must hold the drive's frequency and the thickness; it is sliced at these.
    texture : FrictionField, Material or Layout
        What to feel.
    device : Device
        Gives the sample rate, and says whether the driver makes the carrier itself.
    drive : Drive, optional
        The default is a sine carrier at the surface's own frequency, or where the surface spans
        several or leaves frequency out, at the one nearest to `DEFAULT_CARRIER_HZ`.
    settings : RenderSettings, optional
        How friction becomes an amplitude.

    Raises
    ------
    InputError
        If the device cannot play the drive, or the surface does not hold it.
    """

    _settings_kind: type[RenderSettings] = RenderSettings

    def __init__(
        self,
        surface: FrictionSurface,
        texture: Feelable,
        device: Device,
        drive: Drive | None = None,
        settings: RenderSettings | None = None,
    ) -> None:
        order = "the order is (surface, texture, device)"
        instance("surface", surface, FrictionSurface, order)
        check_feelable("texture", texture)
        instance("device", device, Device, f"{order}; haptix.open_device('mock:') opens one")
        if drive is not None:
            instance("drive", drive, Drive, "such as haptix.render.SineCarrier(4000)")
        if settings is not None:
            instance("settings", settings, self._settings_kind)
        self.settings = settings = RenderSettings() if settings is None else settings
        rate = device.capabilities.sample_rate_hz
        self.drive = drive = _on_device(drive or SineCarrier(carrier_hz(surface)), device)
        self.surface = surface = surface.driven_at(drive.frequency_hz, settings.h0_m)
        self.sample_rate_hz = rate
        self.step = max(1, int(rate / CONTROL_HZ))
        self.step_s = self.step / rate
        """Time from one control point to the next."""
        self.points = max(1, round(settings.block_s * rate / self.step))
        peak, ripple = drive.peak_per_sine, drive.attraction
        # The current through the person limits the slew: at 4 kHz, 186 V.
        screen = surface.info.get("model", {}).get("screen", {})
        if (capacitance_f := screen.get("body_capacitance_f")) is not None:
            device.raise_capacitance(max(capacitance_f, device.limits.capacitance_f))
        slew = device.limits.max_slew_v_per_s
        change_v_per_s = min(settings.slew_v_per_s, slew / 2)
        highest_v = drive.highest_v(slew, change_v_per_s, rate)
        highest_v = min(surface.voltage_limit_v / max(peak, 1.0), highest_v)
        self.slice = Slice.of(surface.table, highest_v)
        self._compiled = self.slice.compiled.at
        self._averaged = (
            []
            if ripple is None
            else [
                self.slice.averaged(1 + sqrt(share / _SHARES) * (ripple - 1))
                for share in range(_SHARES + 1)
            ]
        )
        self._response = FingerResponse(surface.response_hz_per_mm_per_s)
        # The drive stays below the limit, rounding included.
        self._most_v = highest_v / (1.0 if peak <= 1 else 1 + 1e-12)
        self.most_step_v = change_v_per_s * self.step / rate
        self._period = drive.period(rate)
        self._period_at = (
            NULL if self._period is None else _address(DOUBLES, _row(self._period, _FLOAT64))
        )
        self.texture = texture

    @property
    def texture(self) -> Feelable:
        """What to feel. Another one may be given at any time, and counts from the next block."""
        return self._felt[0]

    @texture.setter
    def texture(self, texture: Feelable) -> None:
        self._feel(texture)

    def _feel(self, texture: Feelable) -> None:
        check_feelable("texture", texture)
        # One tuple, so that a thread that renders sees the old one or the new one.
        evaluator = texture.evaluator
        span = self.settings.compress
        rendering = Struct(
            "hx_rendering",
            target=_TARGETS.index(evaluator.target),
            compresses=span is not None and evaluator.target != "share",
            span_low=span[0] if span else 0.0,
            span_high=span[1] if span else 0.0,
            combination=_COMBINATIONS.index(self.settings.combination),
            most_v=self._most_v,
            most_step_v=self.most_step_v,
            step=self.step,
            joined=max(1, round(_JOIN_S / self.step_s)),
        )
        self._felt = (texture, evaluator, rendering)

    @property
    def drives_at_rest(self) -> bool:
        """Whether what is felt gives drive to fingers that rest."""
        return self._felt[1].drives_at_rest

    def block(
        self,
        fingers: Fingers,
        first_sample: int,
        amplitude_v: float = 0.0,
        queued_v: Array | None = None,
        mix: Mix = _ALL,
    ) -> RenderedBlock:
        """Render the steps that end at a motion's points, from the amplitude before them.

        Of amplitudes `queued_v` that are queued at the points, the last stays, and those before it
        are blended into. `mix` has the intensity, and effects that are added to what is felt.
        """
        _, evaluator, rendering = self._felt
        motion, gain = fingers.motion, fingers.gain
        count, points, step = motion.fingers, motion.points, self.step
        value = force = intensity = added = queued = NULL
        less, more, part = self._compiled, NULL, 0.0
        if count:
            motion.reachable = self.reachable
            if self._averaged:
                values = self._over_the_quarter(evaluator, motion, first_sample)
                speed = motion.footprint_mm * self.sample_rate_hz / step
                cell, part = self._followed(np.float64(speed))
                less, more = (one.compiled.at for one in self._averaged[cell : cell + 2])
            else:
                values = evaluator.wanted(motion)
            if values.size != count * points:
                raise InputError(
                    f"texture: expected an answer for each of {count * points} points, got "
                    f"{values.size}"
                )
            value = _address(DOUBLES, _row(values, _FLOAT64))
            share = mix.intensity
            if isinstance(share, np.ndarray) or share != 1.0:
                intensity = _address(DOUBLES, np.full(points, share, dtype=np.float64))
            if mix.effects:
                added = _address(DOUBLES, _row(mix.added(motion), _FLOAT64))
            if count > 1 and isinstance(evaluator, Layout):
                gain = self._shared(gain, evaluator, motion)
            force = _address(DOUBLES, _row(motion.normal_force_n, _FLOAT64))
        if queued_v is not None:
            queued = _address(DOUBLES, _row(queued_v, _FLOAT64))
        samples = points * step
        wave, wave_at, phase = self._period, self._period_at, 0
        if wave is None:
            wave = _row(self.drive.wave(first_sample, samples, self.sample_rate_hz), _FLOAT64)
            wave_at = _address(DOUBLES, wave)
        else:
            phase = first_sample % len(wave)
        gain_at = _address(DOUBLES, _row(gain, _FLOAT64))
        block = _new(_BLOCK, (
            count, points, value, force, gain_at, intensity, added, less, more, part,
            amplitude_v, queued, 0 if queued_v is None else len(queued_v), wave_at, len(wave),
            phase,
        ))  # fmt: skip
        targets = count * points
        end = targets + points
        numbers, status = np.empty(end + samples), np.empty(targets, _INT8)
        _render(rendering.at, block, _address(DOUBLES, numbers), _address(_BYTES, status))
        return RenderedBlock(
            first_sample, step, count, numbers[:targets], status, fingers.gain,
            numbers[targets:end], numbers[end:],
        )  # fmt: skip

    def reachable(self, normal_force_n: Array, speed_mm_per_s: Array) -> tuple[Array, Array]:
        """Lowest and highest friction coefficient at forces and speeds, shape (points,)."""
        try:
            normal_force_n = np.asarray(normal_force_n, dtype=np.float64)
            speed_mm_per_s = np.asarray(speed_mm_per_s, dtype=np.float64)
        except (TypeError, ValueError):
            raise InputError("reachable: expected rows of forces and speeds") from None
        lowest, highest = self.slice.reach(normal_force_n)
        if not self._averaged:
            return lowest, highest
        highs = np.array([one.reach(normal_force_n)[1] for one in self._averaged])
        cell, part = self._followed(speed_mm_per_s)
        at = np.arange(highs.shape[1])
        return lowest, (1 - part) * highs[cell, at] + part * highs[cell + 1, at]

    def friction(self, normal_force_n: Array, speed_mm_per_s: Array, amplitude_v: Array) -> Array:
        """Friction coefficient at forces, speeds and amplitudes [V], each of shape (points,)."""
        if not self._averaged:
            return self.slice.mu(normal_force_n, amplitude_v)
        mu = np.array([one.mu(normal_force_n, amplitude_v) for one in self._averaged])
        cell, part = self._followed(speed_mm_per_s)
        at = np.arange(mu.shape[1])
        return np.asarray((1 - part) * mu[cell, at] + part * mu[cell + 1, at])

    @property
    def highest_v(self) -> float:
        """Highest amplitude [V] that is ever sent."""
        return self._most_v

    def _over_the_quarter(self, evaluator: Evaluator, motion: Motion, first_sample: int) -> Array:
        """Numbers of the texture, averaged over the quarter of the drive's period around a point.

        The attraction comes in pulses, two in a period. What the texture changes faster would be
        felt as a slow change that it does not have. A pulse of a sine weighs its halves alike, so
        that the mean friction over each of them is that of the texture.
        """
        steps = self.sample_rate_hz / self.step / (4 * self.drive.frequency_hz)
        # A point ends its step: where two quarters meet, it belongs to the first.
        last = 4 * turns(first_sample + self.step, 1, self.drive.frequency_hz, self.sample_rate_hz)
        passed = 1 - (_ROUNDED - last - np.arange(motion.points) / steps) % 1.0
        ahead = steps * ((np.arange(_PARTS)[:, None] + 0.5) / _PARTS - passed)
        footprint_mm = motion.footprint_mm * max(1.0, steps / _PARTS)
        value = evaluator.wanted(motion.ahead(ahead, footprint_mm))
        return np.asarray(value.reshape(_PARTS, -1).mean(axis=0))

    def _followed(self, speed_mm_per_s: Array | np.float64) -> tuple[Any, Any]:
        """Place among the averaged slices, by the share of the ripple that the finger follows."""
        place = _SHARES * self._response.power(2 * self.drive.frequency_hz, speed_mm_per_s)
        cell = np.minimum(place.astype(int), _SHARES - 1)
        return cell, place - cell

    @staticmethod
    def _shared(gain: Array, evaluator: Layout, motion: Motion) -> Array:
        """Gains without those of fingers that another one's priority leaves out."""
        priority = evaluator.priorities(motion)
        if priority is None:
            return gain
        rank = priority.reshape(motion.fingers, -1)
        return np.where(rank == rank.max(axis=0), gain.reshape(rank.shape), 0.0)


def carrier_hz(surface: FrictionSurface) -> float:
    """Return the frequency of the carrier that a surface is driven at where none is chosen."""
    frequency = surface.frequency_hz
    if frequency.is_absent:
        return DEFAULT_CARRIER_HZ
    return min(max(DEFAULT_CARRIER_HZ, frequency.low), frequency.high)


def _on_device(drive: Drive, device: Device) -> Drive:
    """Return the drive as the device plays it: a driver in envelope mode makes the carrier."""
    if device.mode == "envelope":
        if not isinstance(drive, SineCarrier):
            raise InputError(
                "drive: expected a SineCarrier, since the device makes the carrier itself; open "
                "it with mode=waveform to send another wave"
            )
        drive = DriverCarrier(drive.frequency_hz)
    drive.check_rate(device.capabilities.sample_rate_hz)
    return drive
