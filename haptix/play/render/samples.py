"""One block: from fingers on a texture to drive samples, and the counts of blocks."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from math import sqrt
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from firmware_io import Device, PlaybackStats
from firmware_io.reviser import percentile
from haptix.base.checks import Array, instance
from haptix.base.errors import InputError
from haptix.base.native import DOUBLES, NULL, Struct, ffi, library
from haptix.feel.layout import Layout
from haptix.feel.layout.program import TARGETS
from haptix.feel.materials import Evaluator, Feelable, check_feelable
from haptix.feel.motion import Motion
from haptix.model.finger import FingerResponse
from haptix.model.presets import DEFAULT_CARRIER_HZ
from haptix.model.status import LIMITS, Status
from haptix.model.surface import FrictionSurface, Slice
from haptix.model.waves import turns
from haptix.play.render.adapting import Adaptation
from haptix.play.render.drive import Drive, DriverCarrier, SineCarrier
from haptix.play.render.master import Mix
from haptix.play.render.settings import Combination, RenderSettings
from haptix.play.sensing import FingerEstimate

CONTROL_HZ = 12_000.0
"""Rate of the control points, at which friction is evaluated and inverted. Between them the
amplitude is a straight line. Skin feels up to 1 kHz; lines between points 12 times as dense follow
that within 3 %."""

_SHARES = 8
"""Steps of the share of the ripple's square that the finger follows, 0 to 1; linear in between."""

_ROUNDED = 1e-9  # of a quarter of a period: rounding must not move a point into the next quarter
_PARTS = 4  # places of the texture in a quarter of a period

_JOIN_S = 0.002  # over which a revised window is blended into the samples queued after it

COMBINATIONS: tuple[Combination, ...] = ("strongest", "first", "mean")
"""Numbers of the combinations."""

_BLOCK, _BYTES = ffi.typeof("hx_block *"), ffi.typeof("int8_t *")
_INT8 = np.dtype(np.int8)
_new, _address, _render = ffi.new, ffi.from_buffer, library.hx_render
_row, _FLOAT64 = np.ascontiguousarray, np.dtype(np.float64)
_ALL = Mix()  # full intensity, and no effects

_BLOCK_TIMES = 100_000  # that the statistics keep


class Fingers(NamedTuple):
    """Fingers of a block, and the share of the drive for each."""

    motion: Motion
    """The motion of the fingers at the control points."""
    gain: Array
    """Share of its amplitude that each finger gets, 0 to 1, of the motion's shape."""
    touch_ids: tuple[int, ...] = ()
    """Touch id of each finger; live fingers only."""

    @classmethod
    def none(cls, points: int) -> Fingers:
        """Return a block without fingers."""
        return cls(Motion.none(points), np.empty(0))


class RenderedBlock(NamedTuple):
    """Target and drive of a block; each control point is at the end of a step of samples."""

    first_sample: int
    """First sample of the block."""
    step: int
    """Samples from one point to the next."""
    fingers: int
    """Number of fingers that touched."""
    target_mu: Array
    """Friction that the texture wants, shape (fingers * points,)."""
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


@dataclass
class RenderStats(PlaybackStats):
    """Counts and times since the renderer was entered; those of a playback are 0 without one."""

    samples: int = 0
    """Samples rendered."""
    below: int = 0
    """Samples, of all fingers, whose target was below the friction without voltage."""
    above: int = 0
    """Samples whose target was above the friction that the highest voltage or the limits of the
    model allow."""
    outside: int = 0
    """Samples whose force was outside the surface's range."""
    finger: FingerEstimate | None = None
    """Latest estimate of the finger by sensing; None before the first one, or without sensing."""
    block_s: deque[float] = field(default_factory=lambda: deque(maxlen=_BLOCK_TIMES), repr=False)
    """Time to compute each of the last blocks [s]."""

    def add(self, block: RenderedBlock, seconds: float) -> None:
        """Count a block.

        Parameters
        ----------
        block : RenderedBlock
        seconds : float
            Time that it took to render [s].
        """
        self.samples += len(block.drive_v)
        self.block_s.append(seconds)
        if block.status.any():
            self.reached(np.bincount(block.status.ravel(), minlength=len(Status)) * block.step)

    def reached(self, samples: npt.NDArray[np.int64]) -> None:
        """Count samples by how their friction was reached.

        Parameters
        ----------
        samples : ndarray of int
            How many there are of each number of `Status`.
        """
        self.below += int(samples[Status.BELOW])
        self.above += int(sum(samples[status] for status in (Status.ABOVE, *LIMITS)))
        self.outside += int(samples[Status.OUT_OF_RANGE])

    def __str__(self) -> str:
        line = (
            f"{self.samples} samples ({self.below} below reach, {self.above} above, "
            f"{self.outside} outside the surface), {len(self.block_s)} blocks of "
            f"{self.p50_block_s * 1e3:.2f} ms (p99 {self.p99_block_s * 1e3:.2f}, longest "
            f"{self.max_block_s * 1e3:.2f}), {self.revisions} revisions, {self.underruns} underruns"
        )
        if self.finger is not None:
            line = f"{line}; finger: {self.finger}"
        return f"{line}; {self.advice}" if self.advice else line

    @property
    def p50_block_s(self) -> float:
        """Median time to compute a block [s]; nan without blocks."""
        return percentile(self.block_s, 50)

    @property
    def p99_block_s(self) -> float:
        """99th percentile of the time to compute a block [s]."""
        return percentile(self.block_s, 99)

    @property
    def max_block_s(self) -> float:
        """Longest time to compute a block [s]."""
        return percentile(self.block_s, 100)


class RenderCore:
    """Renders single blocks, without a clock, a thread or a state.

    The contact is too slow for a carrier, and follows its mean attraction. It partly follows the
    ripple of a direct drive, which has twice the drive's frequency. This raises the mean friction
    of a period, and more so for a faster finger. The rendered friction is that mean. It is nearly
    linear in the square of the ripple that the finger follows by its response.

    Parameters
    ----------
    surface : FrictionSurface
        Must hold the drive's frequency and the thickness; it is sliced at these.
    texture : FrictionField, Material or Layout
        What to feel.
    device : Device
        Gives the sample rate, and states whether the driver makes the carrier itself. Its limits
        are lowered where the screen has more capacitance to a body than they allow for.
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
            instance("drive", drive, Drive, "such as haptix.play.render.SineCarrier(4000)")
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
        highest_v, change_v_per_s = _highest_v(surface, device, drive, settings)
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
        # The drive must stay below the limit even after rounding.
        self._most_v = highest_v / (1.0 if peak <= 1 else 1 + 1e-12)
        self.most_step_v = change_v_per_s * self.step / rate
        self._period = drive.period(rate)
        self._period_at = (
            NULL if self._period is None else _address(DOUBLES, _row(self._period, _FLOAT64))
        )
        self.adapted: Adaptation | None = None
        self.texture = texture

    @property
    def texture(self) -> Feelable:
        """The texture; it can be replaced at any time, from the next block on."""
        return self._felt[0]

    @texture.setter
    def texture(self, texture: Feelable) -> None:
        self._feel(texture)

    def _feel(self, texture: Feelable) -> None:
        check_feelable("texture", texture)
        # One tuple, so that another thread that renders sees either the old or the new texture.
        evaluator = texture.evaluator
        span = self.settings.compress
        rendering = Struct(
            "hx_rendering",
            target=TARGETS.index(evaluator.target),
            compresses=span is not None and evaluator.target != "share",
            span_low=span[0] if span else 0.0,
            span_high=span[1] if span else 0.0,
            combination=COMBINATIONS.index(self.settings.combination),
            most_v=self._most_v,
            most_step_v=self.most_step_v,
            step=self.step,
            joined=max(1, round(_JOIN_S / self.step_s)),
        )
        self._felt = (texture, evaluator, rendering)

    @property
    def drives_at_rest(self) -> bool:
        """Whether the texture drives fingers that rest."""
        return self._felt[1].drives_at_rest

    def block(
        self,
        fingers: Fingers,
        first_sample: int,
        amplitude_v: float = 0.0,
        queued_v: Array | None = None,
        mix: Mix = _ALL,
    ) -> RenderedBlock:
        """Render the steps that end at the motion's points.

        Parameters
        ----------
        fingers : Fingers
            Where they are, and what each gets of the drive, at control points.
        first_sample : int
            Number of the block's first sample.
        amplitude_v : float
            Amplitude [V] before the block.
        queued_v : array, optional
            Amplitudes [V] already queued at the points: the last stays, the block blends into
            those before.
        mix : Mix
            Intensity, and effects that are added to the friction.
        """
        _, evaluator, rendering = self._felt
        motion, gain = fingers.motion, fingers.gain
        count, points, step = motion.fingers, motion.points, self.step
        idle_v = 0.0 if self.adapted is None else self.adapted.probe_v
        value = force = intensity = added = queued = NULL
        less, more, part, parts = self._compiled, NULL, 0.0, NULL
        if count:
            motion.reachable = self.reachable
            if self._averaged:
                values = self._over_the_quarter(evaluator, motion, first_sample)
                speed = motion.footprint_mm * self.sample_rate_hz / step
                cell, part = self._followed(np.float64(speed))
                pair = self._averaged[cell : cell + 2]
                less, more = (columns.compiled.at for columns in pair)
            else:
                if self.adapted is not None:
                    slices, along = self.adapted.over(self.slice, points)
                    less, more = (columns.compiled.at for columns in slices)
                    parts = _address(DOUBLES, along)
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
            parts, amplitude_v, queued, 0 if queued_v is None else len(queued_v), wave_at,
            len(wave), phase, idle_v,
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
        """Lowest and highest friction coefficient at forces and speeds, shape (points,).

        Parameters
        ----------
        normal_force_n : array, shape (points,)
        speed_mm_per_s : array, shape (points,)

        Examples
        --------
        >>> import haptix
        >>> model = haptix.ContactModel(haptix.Finger(), haptix.Screen(), fidelity="closed-form")
        >>> surface = haptix.FrictionSurface.build(model, {"frequency_hz": 240.0}, 0.01)
        >>> ribs = haptix.feel.Grating(period_mm=2.0)
        >>> with haptix.Renderer(surface, ribs, haptix.open_device("mock:")) as renderer:
        ...     low, high = renderer.reachable(np.array([0.5]), np.array([50.0]))
        >>> bool((low < high).all())
        True
        """
        try:
            normal_force_n = np.asarray(normal_force_n, dtype=np.float64)
            speed_mm_per_s = np.asarray(speed_mm_per_s, dtype=np.float64)
        except (TypeError, ValueError):
            raise InputError("reachable: expected rows of forces and speeds") from None
        lowest, highest = self._known.reach(normal_force_n)
        if not self._averaged:
            return lowest, highest
        highs = np.array([columns.reach(normal_force_n)[1] for columns in self._averaged])
        cell, part = self._followed(speed_mm_per_s)
        at = np.arange(highs.shape[1])
        return lowest, (1 - part) * highs[cell, at] + part * highs[cell + 1, at]

    def friction(self, normal_force_n: Array, speed_mm_per_s: Array, amplitude_v: Array) -> Array:
        """Friction coefficient at forces, speeds and amplitudes [V], each of shape (points,).

        Parameters
        ----------
        normal_force_n : array, shape (points,)
        speed_mm_per_s : array, shape (points,)
        amplitude_v : array, shape (points,)
            Amplitudes of the drive [V].
        """
        if not self._averaged:
            return self._known.mu(normal_force_n, amplitude_v)
        mu = np.array([columns.mu(normal_force_n, amplitude_v) for columns in self._averaged])
        cell, part = self._followed(speed_mm_per_s)
        at = np.arange(mu.shape[1])
        return np.asarray((1 - part) * mu[cell, at] + part * mu[cell + 1, at])

    @property
    def _known(self) -> Slice:
        """Slice of the finger that sensing has learned, or else of the surface's finger."""
        return self.slice if self.adapted is None else self.adapted.now(self.slice)

    @property
    def highest_v(self) -> float:
        """Highest amplitude [V] that the renderer sends."""
        return self._most_v

    def _over_the_quarter(self, evaluator: Evaluator, motion: Motion, first_sample: int) -> Array:
        """Numbers of the texture, averaged over the quarter of the drive's period around a point.

        The attraction comes in pulses, two in a period. They would turn faster changes of the
        texture into slow changes that it does not have. Both halves of a sine's pulse have the same
        weight, so that the mean friction over each half is that of the texture.
        """
        steps = self.sample_rate_hz / self.step / (4 * self.drive.frequency_hz)
        # A point is at the end of its step: where two quarters meet, it belongs to the first.
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
        """Gains; 0 for a finger while another one is on a region of higher priority."""
        priority = evaluator.priorities(motion)
        if priority is None:
            return gain
        rank = priority.reshape(motion.fingers, -1)
        return np.where(rank == rank.max(axis=0), gain.reshape(rank.shape), 0.0)


def carrier_hz(surface: FrictionSurface) -> float:
    """Return the default frequency [Hz] of the carrier for a surface."""
    frequency = surface.frequency_hz
    if frequency.is_absent:
        return DEFAULT_CARRIER_HZ
    return min(max(DEFAULT_CARRIER_HZ, frequency.low), frequency.high)


def driven_surface(surface: FrictionSurface, device: Device) -> FrictionSurface:
    """Return the surface at its default carrier, up to the amplitude that a renderer sends.

    The limits of the device are lowered to those of the screen, as a renderer does.
    """
    drive = _on_device(SineCarrier(carrier_hz(surface)), device)
    sliced = surface.driven_at(drive.frequency_hz)
    return sliced.limited(_highest_v(sliced, device, drive, RenderSettings())[0])


def _highest_v(
    surface: FrictionSurface, device: Device, drive: Drive, settings: RenderSettings
) -> tuple[float, float]:
    """Highest amplitude [V] of a drive, and how fast it changes at most [V/s]."""
    # The limit of the current through the person limits the slew: to 186 V at 4 kHz.
    screen = surface.info.get("model", {}).get("screen", {})
    if (capacitance_f := screen.get("body_capacitance_f")) is not None:
        device.raise_capacitance(max(capacitance_f, device.limits.capacitance_f))
    slew = device.limits.max_slew_v_per_s
    change_v_per_s = min(settings.slew_v_per_s, slew / 2)
    highest_v = drive.highest_v(slew, change_v_per_s, device.capabilities.sample_rate_hz)
    return min(surface.voltage_limit_v / max(drive.peak_per_sine, 1.0), highest_v), change_v_per_s


def _on_device(drive: Drive, device: Device) -> Drive:
    """Return the drive for the device: in envelope mode the driver makes the carrier itself."""
    if device.mode == "envelope":
        if not isinstance(drive, SineCarrier):
            raise InputError(
                "drive: expected a SineCarrier, since the device makes the carrier itself; open "
                "it with mode=waveform to send another wave"
            )
        drive = DriverCarrier(drive.frequency_hz)
    drive.check_rate(device.capabilities.sample_rate_hz)
    return drive
