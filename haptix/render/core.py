"""One block: from fingers on a texture to drive samples."""

from __future__ import annotations

from dataclasses import dataclass
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
from haptix.render.drive import Drive, DriverCarrier, SineCarrier
from haptix.render.settings import RenderSettings
from haptix.render.target import Amplitudes, Target
from haptix.status import Status
from haptix.surface import FrictionSurface, Slice
from haptix.texture import Evaluator, Feelable, check_feelable
from haptix.waves import turns

CONTROL_HZ = 12_000.0
"""Rate at which friction is asked for and inverted; the amplitude is a line in between. Skin feels
up to 1 kHz, and a line between points 12 times as dense follows that within 3 %."""

_SHARES = 8
"""Parts of the ripple's square, from none to all of it followed, between which lines will do."""

_ROUNDED = 1e-9  # of a quarter: rounding does not move a point into the next one
_PARTS = 4  # places of the texture in a quarter of a period

_JOIN_S = 0.002  # over which a window that is rendered again meets what is queued behind it

DEFAULT_CARRIER_HZ = 4000.0
"""Above what skin feels, and a whole twelfth of the usual 48 kHz."""


class Fingers(NamedTuple):
    """Fingers of a block, and what each gets of the drive."""

    motion: Motion
    """Where they are, at the control points."""
    gain: Array
    """Share of its amplitude that each finger gets, 0 to 1, of the motion's shape."""
    force_n: list[float] | None = None
    """One force for each finger [N], where it hardly changes during the block."""
    touch_ids: tuple[int, ...] = ()
    """Which finger each is; live ones only."""

    @classmethod
    def none(cls, points: int) -> Fingers:
        """No finger touches."""
        return cls(Motion.none(points), np.empty(0))


@dataclass(frozen=True, slots=True)
class RenderedBlock:
    """Target and drive at control points, which end equal steps of samples.

    Parameters
    ----------
    first_sample, step : int
        First sample of the block; samples from one point to the next.
    fingers : int
        How many touched.
    target_mu : ndarray, shape (fingers * points,)
        Friction that the texture asks for.
    status : ndarray of int, shape (fingers * points,)
        Numbers of `Status`.
    gain : ndarray, shape (fingers * points,)
        Share of its amplitude that each finger got: below 1 where it fades.
    amplitude_v : ndarray, shape (points,)
        Amplitude sent, after fades and the combination of fingers.
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
        self.points = max(1, round(settings.block_s * rate / self.step))
        self.texture = texture
        peak, ripple = drive.peak_per_sine, drive.attraction
        # The current through the person limits the slew: at 4 kHz, 186 V.
        screen = surface.info.get("model", {}).get("screen", {})
        if (capacitance_f := screen.get("body_capacitance_f")) is not None:
            device.raise_capacitance(max(capacitance_f, device.limits.capacitance_f))
        slew = device.limits.max_slew_v_per_s
        change_v_per_s = min(settings.slew_v_per_s, slew / 2)
        highest_v = drive.highest_v(slew, change_v_per_s, rate)
        highest_v = min(surface.voltage_limit_v / max(peak, 1.0), highest_v)
        self._slice = Slice.of(surface.table, highest_v)
        self._averaged = (
            []
            if ripple is None
            else [
                self._slice.averaged(1 + sqrt(share / _SHARES) * (ripple - 1))
                for share in range(_SHARES + 1)
            ]
        )
        self._response = FingerResponse(surface.response_hz_per_mm_per_s)
        # The drive stays below the limit, rounding included.
        self._most_v = highest_v / (1.0 if peak <= 1 else 1 + 1e-12)
        self._most_step_v = change_v_per_s * self.step / rate
        self._share = np.arange(self.step) / self.step
        joined = max(1, round(_JOIN_S / self.step_s))
        self._join_share = np.arange(1, joined + 1) / joined
        # How far from an end its slope lets the points before it be.
        self._reach_v = self._most_step_v * np.arange(highest_v // self._most_step_v + 1, -1, -1)

    @property
    def texture(self) -> Feelable:
        """What to feel. Another one may be given at any time, and counts from the next block."""
        return self._felt[0]

    @texture.setter
    def texture(self, texture: Feelable) -> None:
        check_feelable("texture", texture)
        # One tuple, so that a thread that renders sees the old one or the new one.
        evaluator = texture.evaluator
        self._attach(texture)
        self._felt = (texture, evaluator, Target(evaluator.target, self.settings.compress))
        self._changed()

    def _attach(self, texture: Feelable) -> None:
        """Give a layout the clock of a session."""

    def _changed(self) -> None:
        """What is felt has changed, other than by a touch."""

    @property
    def step_s(self) -> float:
        """Time from one control point to the next."""
        return self.step / self.sample_rate_hz

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
    ) -> RenderedBlock:
        """Render the steps that end at a motion's points, from the amplitude before them.

        Of amplitudes `queued_v` that are queued at the points, the last stays, and those before it
        are blended into.
        """
        motion, gain = fingers.motion, fingers.gain
        self._note(fingers, first_sample)
        line = np.empty(motion.points + 1)
        line[0] = amplitude_v
        if motion.fingers:
            found = self._amplitudes(fingers, first_sample)
            each = (found.voltage_v * gain).reshape(motion.fingers, motion.points)
            np.minimum(self._combined(each, motion), self._most_v, out=line[1:])
            target, status = found.target_mu, found.status
        else:
            line[1:] = 0.0
            target, status = np.empty(0), np.empty(0, dtype=np.int8)
        if queued_v is not None:
            self._join(line, queued_v)
        change = self._slewed(line)
        amplitude = (line[:-1, None] + change[:, None] * self._share).ravel()
        drive_v = self.drive.modulate(amplitude, first_sample, self.sample_rate_hz)
        counts = (first_sample, self.step, motion.fingers)
        return RenderedBlock(*counts, target, status, gain, line[1:], drive_v)

    def reachable(self, normal_force_n: Array, speed_mm_per_s: Array) -> tuple[Array, Array]:
        """Lowest and highest friction coefficient at forces and speeds, shape (points,)."""
        try:
            normal_force_n = np.asarray(normal_force_n, dtype=np.float64)
            speed_mm_per_s = np.asarray(speed_mm_per_s, dtype=np.float64)
        except (TypeError, ValueError):
            raise InputError("reachable: expected rows of forces and speeds") from None
        column = self._slice.columns_at(normal_force_n)
        if not self._averaged:
            return column.lowest_mu, column.highest_mu
        highs = np.array([one.columns_at(normal_force_n).highest_mu for one in self._averaged])
        cell, part = self._followed(speed_mm_per_s)
        at = np.arange(highs.shape[1])
        return column.lowest_mu, (1 - part) * highs[cell, at] + part * highs[cell + 1, at]

    def friction(self, normal_force_n: Array, speed_mm_per_s: Array, amplitude_v: Array) -> Array:
        """Friction coefficient at forces, speeds and amplitudes [V], each of shape (points,)."""
        if not self._averaged:
            return self._slice.columns_at(normal_force_n).mu(amplitude_v)
        mu = np.array([one.columns_at(normal_force_n).mu(amplitude_v) for one in self._averaged])
        cell, part = self._followed(speed_mm_per_s)
        at = np.arange(mu.shape[1])
        return np.asarray((1 - part) * mu[cell, at] + part * mu[cell + 1, at])

    @property
    def highest_v(self) -> float:
        """Highest amplitude [V] that is ever sent."""
        return self._most_v

    def _amplitudes(self, fingers: Fingers, first_sample: int) -> Amplitudes:
        """Amplitudes for each finger at each point of the block that begins with a sample."""
        _, evaluator, target = self._felt
        motion = fingers.motion.within(self.reachable)
        if not self._averaged:
            value = evaluator.wanted(motion)
            return _inverted(
                self._slice, fingers, target, value, *self._mixed(motion, first_sample)
            )
        value = self._over_the_quarter(evaluator, motion, first_sample)
        speed = motion.footprint_mm * self.sample_rate_hz / self.step
        cell, part = self._followed(np.float64(speed))
        mixed = self._mixed(motion, first_sample)
        less, more = (
            _inverted(one, fingers, target, value, *mixed)
            for one in self._averaged[cell : cell + 2]
        )
        return Amplitudes(
            less.voltage_v + part * (more.voltage_v - less.voltage_v),
            less.target_mu + part * (more.target_mu - less.target_mu),
            np.where(less.status == Status.OK, more.status, less.status),
        )

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

    def _note(self, fingers: Fingers, first_sample: int) -> None:
        """Take notice of a block that is rendered; a session does."""

    def _mixed(self, motion: Motion, first_sample: int) -> tuple[float | Array, Array | None]:
        """Intensity at each point, and shares of the reachable range to add; a session has them."""
        return 1.0, None

    def _combined(self, each: Array, motion: Motion) -> Array:
        if len(each) > 1 and isinstance(self._felt[1], Layout):
            priority = self._felt[1].priorities(motion)
            if priority is not None:
                rank = priority.reshape(each.shape)
                each = np.where(rank == rank.max(axis=0), each, 0.0)
        if len(each) == 1 or self.settings.combination == "first":
            return np.asarray(each[0])
        is_mean = self.settings.combination == "mean"
        return np.asarray(each.mean(axis=0) if is_mean else each.max(axis=0))

    def _join(self, line: Array, queued_v: Array) -> None:
        """Let `line` end in place at the last of the amplitudes that are queued."""
        points = min(len(queued_v), len(self._join_share))
        share = self._join_share
        if points < len(share):
            share = np.arange(1, points + 1) / points
        end = line[-points:]
        end += share * (queued_v[-points:] - end)
        self._slewed(line)
        # No further from the end than its slope allows: of two such limits the slope is kept.
        tail, last = line[1:][-len(self._reach_v) :], float(queued_v[-1])
        reach = self._reach_v[-len(tail) :]
        np.minimum(tail, last + reach, out=tail)
        np.maximum(tail, last - reach, out=tail)

    def _slewed(self, line: Array) -> Array:
        """Limit the slope of `line` in place, and return its steps."""
        most, change = self._most_step_v, line[1:] - line[:-1]
        if np.maximum.reduce(change) <= most and np.minimum.reduce(change) >= -most:
            return change
        values = line.tolist()
        caught_up = 0
        for at in (np.abs(change) > most).nonzero()[0].tolist():
            # From each step that is too steep to where the line is met again.
            i = at + 1
            while i > caught_up and i < len(values):
                before, wanted = values[i - 1], values[i]
                values[i] = min(max(wanted, before - most), before + most)
                if values[i] == wanted:
                    break
                i += 1
            caught_up = max(caught_up, i)
        line[:] = values
        return np.asarray(line[1:] - line[:-1])


def _inverted(
    slice_: Slice,
    fingers: Fingers,
    target: Target,
    value: Array,
    intensity: float | Array,
    added: Array | None,
) -> Amplitudes:
    motion, force_n = fingers.motion, fingers.force_n
    if force_n is None:
        if isinstance(intensity, np.ndarray):
            intensity = np.tile(intensity, motion.fingers)
        column = slice_.columns_at(motion.normal_force_n)
        return Amplitudes.of(column, target, value, intensity, added)
    rows = value.reshape(-1, motion.points)
    more = [None] * len(rows) if added is None else added.reshape(rows.shape)
    each = [
        Amplitudes.of(slice_.column(force), target, row, intensity, one)
        for force, row, one in zip(force_n, rows, more, strict=True)
    ]
    return each[0] if len(each) == 1 else Amplitudes(*map(np.concatenate, zip(*each, strict=True)))


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
