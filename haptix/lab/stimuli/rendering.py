"""Rendering of a stimulus to drive samples, block by block, by surfaces of fingers and screen."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from math import inf, sqrt
from typing import Any

import numpy as np
import torch
from scipy.fft import irfft, next_fast_len, rfft, rfftfreq

from haptix.base.checks import Array
from haptix.base.errors import InputError
from haptix.base.files import digest
from haptix.lab.population import Population
from haptix.lab.stimuli.stimulus import Stimulus
from haptix.model.finger import Finger, FingerResponse
from haptix.model.friction import ContactModel
from haptix.model.perception.sensation import SensationInTime
from haptix.model.screen import Screen
from haptix.model.states import ContactState
from haptix.model.status import Status, limits_passed
from haptix.model.surface import Column, FrictionSurface, cached_surface
from haptix.model.waves import sine
from haptix.play.devices import BODY_CAPACITANCE_F, Current, DriveLimits
from haptix.play.render.drive import DirectWave

MEMORY_S = 0.1
"""The drive this long before an instant counts: skin relaxes in some 10 ms."""

_FITTED_HZ = np.geomspace(20.0, 8000.0, 9)
_GAPS_M = np.append(0.0, np.geomspace(1e-9, 1e-4, 301))


class Skin:
    """Attraction of drives by one finger on a screen, over that of sines of a reference frequency.

    A gap u divides a voltage with the insulators by frequency, ``E(f) = V(f)/(u + h0(f))``, and
    attracts by the square of their sum in time, see docs/virtual-finger.md. Here one gap stands for
    all of the contact: that by which the attraction of sine drives depends on frequency as the
    contact model computes, at the force of the touch and a low voltage. Attractions are stated as
    those of a sine drive v of a reference frequency: ``v^2/2``.

    The finger's response to an attraction is left out on both sides: a stimulus and the sine drive
    at its detection threshold are felt at the same frequency, by the same finger at the same speed.
    The data give no speed or force of the thresholds.

    Parameters
    ----------
    model : ContactModel
        Finger and screen.
    normal_force_n : float
        Normal force [N].
    reference_hz : float
        Frequency whose sine drives attract with ``v^2/2``.
    h0_m : float, optional
        Effective thickness [m]; the default is the screen's own.
    """

    def __init__(
        self,
        model: ContactModel,
        normal_force_n: float,
        reference_hz: float,
        h0_m: float | None = None,
    ) -> None:
        self._model = model
        self._h0 = torch.tensor(model.screen.h0_m if h0_m is None else h0_m, dtype=torch.float64)
        pull = np.asarray(model.solve(normal_force_n, 1.0, _FITTED_HZ, h0_m).attraction_pa)
        thickness = self._thickness(_FITTED_HZ)
        by_gap = 1 / np.abs(_GAPS_M[:, None] + thickness) ** 2
        miss = np.log(by_gap / pull)
        self.gap_m = float(_GAPS_M[np.argmin(np.std(miss, axis=1))])
        """The gap that stands for all [m]."""
        self._reference = self.gap_m + self._thickness(np.array([reference_hz]))[0]
        self._divisor = lru_cache(maxsize=2)(self._over_reference)

    def _thickness(self, frequency_hz: Array) -> Array:
        thickness_m = self._model.solver.terms.thickness(self._h0, torch.from_numpy(frequency_hz))
        return np.asarray(thickness_m.detach().cpu().numpy())

    def pull(self, drive_hz: Array) -> Array:
        """Attraction of sine drives over that of one of the reference frequency."""
        return np.asarray(np.abs(self._reference / (self.gap_m + self._thickness(drive_hz))) ** 2)

    def voltage(self, drive_v: Array, sample_rate_hz: float) -> Array:
        """Voltage of the reference's skin with the field in the gap; the drive is 0 V before."""
        size = next_fast_len(len(drive_v) + round(MEMORY_S * sample_rate_hz), real=True)
        spectrum = rfft(drive_v, size) / self._divisor(size, sample_rate_hz)
        return np.asarray(irfft(spectrum, size)[: len(drive_v)])

    def _over_reference(self, size: int, rate_hz: float) -> Array:
        """Divisor of each frequency; numpy's transform is that of exp(i w t), h0 of exp(-i w t)."""
        divisor = self.gap_m + self._thickness(rfftfreq(size, 1 / rate_hz))
        return np.asarray(divisor.conj() / abs(self._reference))


TOLERANCE = "0.02 JND"
"""Tolerance of the surfaces; a stimulus may be off by a quarter of a JND in all."""

_PLACES = 257  # of a speed profile, over the stimulus
_NODES = 65  # amplitudes at which a contact is solved


@dataclass(frozen=True)
class ContactTable:
    """Contact of the first finger against the amplitude of the drive, linear between its nodes.

    All stimuli of one touch use it, so that no stimulus depends on the others of its set.
    """

    amplitude_v: Array
    """Amplitudes [V], increasing from 0, shape (nodes,); the others have the same shape."""
    capacitance_f: Array
    conductance_s: Array
    pull_past_breakdown: Array
    x: float
    """``p0/(E* slope)``, see `haptix.model.ContactState`."""
    warnings: tuple[str, ...]
    """How it lies beyond what the theory and the finger's contact area were compared with."""

    def at(self, name: str, amplitude_v: float) -> float:
        """Return one of the tables at an amplitude; that of the last node above it."""
        return float(np.interp(amplitude_v, self.amplitude_v, getattr(self, name)))


@dataclass(frozen=True, eq=False)
class Apparatus:
    """Fingers on a screen.

    Parameters
    ----------
    models : tuple of ContactModel
        One per finger; the same screen in all.
    surfaces : tuple of FrictionSurface
        One per finger.
    fingers : str
        Name of the one finger, or how several were drawn.
    """

    models: tuple[ContactModel, ...]
    surfaces: tuple[FrictionSurface, ...]
    fingers: str
    _known: dict[Any, Any] = field(default_factory=dict, init=False, repr=False)

    def __post_init__(self) -> None:
        if not self.models or len(self.models) != len(self.surfaces):
            raise InputError("models and surfaces: expected one surface for each finger")

    @classmethod
    def build(
        cls,
        finger: Finger | Population,
        screen: Screen,
        stimuli: Sequence[Stimulus],
        ceiling_v: float | None = None,
    ) -> Apparatus:
        """Build, or find in the cache, the surfaces that some stimuli need.

        The stimuli's forces, frequencies and thicknesses are the ranges of the surfaces.

        Parameters
        ----------
        finger : Finger or Population
            Who feels.
        screen : Screen
            On what.
        stimuli : sequence of Stimulus
            The stimulus.
        ceiling_v : float, optional
            Highest amplitude [V]; never above the screen's limit.
        """
        return cls.over(finger, screen, cls.ranges(screen, stimuli, ceiling_v))

    @classmethod
    def over(
        cls, finger: Finger | Population, screen: Screen, ranges: Mapping[str, Any]
    ) -> Apparatus:
        """Build, or find in the cache, the surfaces over some `ranges`.

        Parameters
        ----------
        finger : Finger or Population
            Who feels.
        screen : Screen
            On what.
        ranges : mapping
            Ranges as in `FrictionSurface.build`.
        """
        people = finger.fingers if isinstance(finger, Population) else (finger,)
        names = finger.statement if isinstance(finger, Population) else finger.name
        models = tuple(ContactModel(finger, screen) for finger in people)
        surfaces = tuple(cached_surface(model, ranges, TOLERANCE)[0] for model in models)
        return cls(models, surfaces, names)

    @staticmethod
    def ranges(
        screen: Screen, stimuli: Sequence[Stimulus], ceiling_v: float | None = None
    ) -> dict[str, Any]:
        """Ranges of the surfaces that some stimuli need, see `build`.

        Parameters
        ----------
        screen, stimuli, ceiling_v
            As in `build`.
        """
        forces = [stimulus.normal_force_n for stimulus in stimuli]
        frequencies = []
        for stimulus in stimuli:
            if stimulus.frequency_hz is None:
                raise InputError(
                    f"{stimulus.name}: drive_hz: expected the frequency of the drive, at which "
                    "skin and insulator are taken, since there is no carrier"
                )
            frequencies.append(stimulus.frequency_hz)
        thicknesses = [
            screen.h0_m if stimulus.h0_m is None else stimulus.h0_m for stimulus in stimuli
        ]
        return {
            "normal_force_n": (min(forces), max(forces)),
            "frequency_hz": (min(frequencies), max(frequencies)),
            "h0_m": (min(thicknesses), max(thicknesses)),
            "voltage_v": (0.0, min(ceiling_v or screen.max_voltage_v, screen.max_voltage_v)),
        }

    @property
    def screen(self) -> Screen:
        """The screen."""
        return self.models[0].screen

    def responses(self, stimulus: Stimulus) -> tuple[Column, tuple[Column, ...]]:
        """Return the median finger's response to a stimulus's drive, and that of each.

        Without a carrier friction is the mean over a period of a sine. The finger follows the
        ripple of the attraction by its response at the stimulus's speeds, and wholly where no speed
        is given.
        """
        ripple = [_ripple(stimulus, surface.response_hz_per_mm_per_s) for surface in self.surfaces]
        touch = stimulus.normal_force_n, stimulus.frequency_hz, stimulus.h0_m
        key = (
            "responses",
            *touch,
            *(None if shares is None else shares.tobytes() for shares in ripple),
        )
        if key not in self._known:
            # The current through a person limits fast carriers below the ceiling.
            body_f = max(self.screen.body_capacitance_f, BODY_CAPACITANCE_F)
            highest_v = DriveLimits(capacitance_f=body_f).highest_sine_v(touch[1] or 0.0)
            each = tuple(
                surface.column(*touch, part).limited(highest_v)
                for surface, part in zip(self.surfaces, ripple, strict=True)
            )
            self._known[key] = Column.median(each), each
        columns: tuple[Column, tuple[Column, ...]] = self._known[key]
        return columns

    def contact(self, stimulus: Stimulus) -> ContactTable:
        """Contact of the first finger at a stimulus's force and drive, up to the ceiling."""
        touch = stimulus.normal_force_n, stimulus.frequency_hz, stimulus.h0_m
        key = ("contact", *touch)
        if key not in self._known:
            end_v = self.responses(stimulus)[1][0].end_v
            amplitude = np.linspace(0.0, end_v, _NODES)
            state = self.models[0].solve(touch[0], amplitude, *touch[1:])
            self._known[key] = ContactTable(
                amplitude,
                np.asarray(state.capacitance_f),
                np.asarray(state.conductance_s),
                np.asarray(state.pull_past_breakdown),
                float(state.x.max()),
                (*_beyond(state), *self.models[0].finger.area_warnings(touch[0])),
            )
        table: ContactTable = self._known[key]
        return table

    def skin(self, stimulus: Stimulus) -> Skin:
        """Attraction of the first finger's skin by a stimulus's drive."""
        assert stimulus.frequency_hz is not None  # the apparatus refuses a stimulus without one
        key = ("skin", stimulus.normal_force_n, stimulus.frequency_hz, stimulus.h0_m)
        if key not in self._known:
            self._known[key] = Skin(self.models[0], *key[1:])
        skin: Skin = self._known[key]
        return skin

    def placeholders(self) -> list[str]:
        """Names of the placeholders that the predictions use."""
        return sorted({name for model in self.models for name in model.placeholders()})

    def profiles(self) -> dict[str, Any]:
        """Profiles of the screen and of all fingers, as plain values."""
        return {
            "screen": self.screen.model_dump(mode="json"),
            "fingers": [model.finger.model_dump(mode="json") for model in self.models],
        }

    def profile_hash(self) -> str:
        """Hash of `profiles`."""
        return self._profile_hash

    @cached_property
    def _profile_hash(self) -> str:
        return digest(self.profiles())

    def surface_keys(self) -> list[str]:
        """Hashes of everything that decides the surfaces' numbers."""
        return [str(surface.info["key"]) for surface in self.surfaces]


def _beyond(state: ContactState) -> list[str]:
    """Warnings of a contact but for limits of the drive, at which its surface ends."""
    ends = limits_passed(state.status)
    return [warning for warning in state.warnings() if warning not in ends]


def _ripple(stimulus: Stimulus, response_hz_per_mm_per_s: float) -> Array | None:
    """Attraction over its mean that the finger follows within a period; None with a carrier."""
    if stimulus.carrier_hz is not None or stimulus.drive_hz is None:
        return None
    share = 1.0
    if stimulus.speed is not None:
        t = np.linspace(0.0, stimulus.length_s, _PLACES)
        speed = np.abs(np.diff(stimulus.speed.position_mm(t))) / (t[1] - t[0])
        followed = FingerResponse(response_hz_per_mm_per_s).power(2 * stimulus.drive_hz, speed)
        share = float(np.mean(followed))
    attraction = DirectWave(stimulus.drive_hz).attraction
    assert attraction is not None  # a sine has a ripple
    return 1 + sqrt(share) * (attraction - 1)


BLOCK = 1 << 16
"""Samples per block. Sums run block by block, so that their last bits depend on it."""


@dataclass(frozen=True)
class Block:
    """Consecutive samples of a drive, and their error of friction against the target."""

    first: int
    drive_v: Array
    """Voltage, shape (samples,)."""
    amplitude_v: Array
    """Amplitude of the carrier, or of the sine with the mean attraction of the drive's period up to
    each sample, shape (samples,)."""
    instant_v: Array
    """Amplitude of the carrier, or of the sine of the drive's frequency with the attraction of the
    instant."""
    mu: Array
    """Predicted friction, shape (samples,)."""
    target_low: float
    """Lowest friction asked for; NaN for volts."""
    target_high: float
    """Highest friction asked for; NaN for volts."""
    below: int
    """Samples whose friction is below that without voltage."""
    above: int
    """Samples whose friction is above that of the highest voltage."""


@dataclass(frozen=True)
class Rendering:
    """A stimulus with the response that converts between its volts and friction."""

    stimulus: Stimulus
    response: Column
    sample_rate_hz: float = 48_000.0
    skin: Skin | None = None
    """Of a drive without a carrier; by default, one without dispersion."""

    def __post_init__(self) -> None:
        carrier = self.stimulus.carrier_hz
        if carrier is not None and carrier > self.sample_rate_hz / 4:
            raise InputError(
                f"carrier_hz: expected at most a quarter of the {self.sample_rate_hz:g} samples "
                f"per second, got {carrier:g} Hz"
            )

    @property
    def samples(self) -> int:
        """Length in samples."""
        count = self.stimulus.signal.samples(self.sample_rate_hz)
        assert count is not None  # a stimulus ends
        return count

    def block(self, first: int, count: int) -> Block:
        """Render `count` samples from number `first` on.

        Parameters
        ----------
        first : int
            Number of the first sample.
        count : int
        """
        stimulus, response = self.stimulus, self.response
        values = stimulus.signal.values(first, count, self.sample_rate_hz)
        if stimulus.quantity == "volts":
            if stimulus.carrier_hz is None:
                mean = self._over_period(first, count)
                # The attraction of a sine is that of its mean square: here of the sine sqrt(2) |v|.
                instant = np.abs(self._on_skin(first, count, values)) * np.sqrt(2)
                return Block(first, values, mean, instant, response.mu(mean), np.nan, np.nan, 0, 0)
            drive, size = values * self._carrier(first, count), np.abs(values)
            return Block(first, drive, size, size, response.mu(size), np.nan, np.nan, 0, 0)
        mu = values
        if stimulus.quantity == "contrast":
            mu = (1 + values) * response.lowest_mu
        elif stimulus.quantity == "share":
            mu = response.lowest_mu + values * (response.highest_mu - response.lowest_mu)
        low, high = float(mu.min()), float(mu.max())
        amplitude, status = response.voltage(mu)
        below = int(np.count_nonzero(status == Status.BELOW))
        above = int(np.count_nonzero(status == response.ends_by))
        drive = amplitude * self._carrier(first, count)
        nearest = mu.clip(response.lowest_mu, response.highest_mu)
        return Block(first, drive, amplitude, amplitude, nearest, low, high, below, above)

    def _over_period(self, first: int, count: int) -> Array:
        """Amplitude of the sine with the same mean attraction over the drive's period."""
        rate, frequency = self.sample_rate_hz, self.stimulus.drive_hz
        period = 1 if frequency is None else max(1, round(rate / frequency))
        begin = max(0, first - period + 1)
        end = max(first + count, min(period, self.samples))
        values = self.stimulus.signal.values(begin, end - begin, rate)
        amplitude = over_period(values, period)
        return amplitude[first - begin :][:count]

    def _on_skin(self, first: int, count: int, values: Array) -> Array:
        """Voltage with which the skin's field is that of the drive's frequency."""
        if self.skin is None:
            return values
        begin = max(0, first - round(MEMORY_S * self.sample_rate_hz))
        before = self.stimulus.signal.values(begin, first - begin, self.sample_rate_hz)
        field_v = self.skin.voltage(np.concatenate([before, values]), self.sample_rate_hz)
        return field_v[first - begin :]

    def _carrier(self, first: int, count: int) -> Array:
        assert self.stimulus.carrier_hz is not None
        make = sine if first else _first_carrier
        return make(first, count, self.stimulus.carrier_hz, self.sample_rate_hz)

    def stream(self, threads: int = 1) -> Iterator[Block]:
        """Yield the blocks in order; their numbers do not depend on the number of threads."""
        return in_order(
            lambda first: self.block(first, min(BLOCK, self.samples - first)),
            range(0, self.samples, BLOCK),
            threads,
        )

    def whole(self, threads: int = 1) -> Array:
        """Return all drive samples [V] at once, for short stimuli."""
        return np.concatenate([block.drive_v for block in self.stream(threads)])


@lru_cache(maxsize=2)
def _first_carrier(first: int, count: int, frequency_hz: float, sample_rate_hz: float) -> Array:
    """Carrier of a first block: a set has many of one length."""
    carrier = sine(first, count, frequency_hz, sample_rate_hz)
    carrier.flags.writeable = False
    return carrier


def over_period(drive_v: Array, period: int) -> Array:
    """Amplitude of the sine with the mean attraction of the `period` samples up to each.

    The first ones, without a whole period before them, have the amplitude of the first period.
    """
    period = min(period, len(drive_v))
    total = np.concatenate([np.zeros(1), np.cumsum(np.square(drive_v))])
    mean = np.maximum(total[period:] - total[:-period], 0.0) / period
    return np.asarray(np.sqrt(2 * np.concatenate([np.full(period - 1, mean[0]), mean])))


def in_order(make: Callable[[int], Block], starts: range, threads: int) -> Iterator[Block]:
    """Make blocks by several threads, a few ahead of the one that is returned."""
    if threads <= 1:
        yield from map(make, starts)
        return
    with ThreadPoolExecutor(threads) as pool:
        waiting: deque[Future[Block]] = deque()
        try:
            for start in starts:
                waiting.append(pool.submit(make, start))
                if len(waiting) > 2 * threads:
                    yield waiting.popleft().result()
            while waiting:
                yield waiting.popleft().result()
        finally:
            for future in waiting:
                future.cancel()


@dataclass
class Friction:
    """Mean, spread and extremes of the predicted friction."""

    samples: int = 0
    total: float = 0.0
    square: float = 0.0
    ground: float | None = None
    low: float = inf
    high: float = -inf

    def take(self, mu: Array) -> None:
        """Add the friction at some samples."""
        if self.ground is None:
            self.ground = float(mu[0])
        change = mu - self.ground  # rounding is that of the changes
        self.samples += len(mu)
        self.total += float(np.sum(change))
        self.square += float(np.sum(change * change))
        self.low, self.high = min(self.low, float(mu.min())), max(self.high, float(mu.max()))

    def describe(self) -> dict[str, float]:
        """Mean, rms of the changes about it, and depth (highest - lowest) / (their sum)."""
        mean = self.total / max(self.samples, 1)
        changes = sqrt(max(self.square / max(self.samples, 1) - mean**2, 0.0))
        depth = (self.high - self.low) / (self.high + self.low)
        return {"mean": mean + (self.ground or 0.0), "rms_change": changes, "depth": depth}


@dataclass
class Tally:
    """Extremes, counts and sensation of a rendered stimulus, gathered block by block."""

    sensation: SensationInTime
    friction: Friction = field(default_factory=Friction)
    samples: int = 0
    peak_v: float = 0.0
    square_sum: float = 0.0
    steepest_step_v: float = 0.0
    step_square_sum: float = 0.0
    last_v: float = 0.0
    lowest_amplitude_v: float = inf
    highest_amplitude_v: float = 0.0
    target_low: float = inf
    target_high: float = -inf
    below: int = 0
    above: int = 0
    only: Block | None = None
    """The block, as long as there is one."""
    past_the_surface: int = 0
    """Samples of a drive in volts beyond the end of the surface."""
    limits: list[str] = field(default_factory=list)

    def take(self, block: Block, response: Column) -> None:
        """Add a block."""
        drive, amplitude = block.drive_v, block.amplitude_v
        self.samples += len(drive)
        self.peak_v = max(self.peak_v, float(drive.max()), -float(drive.min()))
        # Not np.dot: its last bit depends on the threads of the algebra library.
        self.square_sum += float(np.sum(drive * drive))
        steps = np.diff(drive, prepend=self.last_v)
        self.steepest_step_v = max(self.steepest_step_v, float(np.abs(steps).max()))
        self.step_square_sum += float(np.sum(steps * steps))
        self.last_v = float(drive[-1])
        low, high = float(amplitude.min()), float(amplitude.max())
        self.lowest_amplitude_v = min(self.lowest_amplitude_v, low)
        self.highest_amplitude_v = max(self.highest_amplitude_v, high)
        if block.target_low == block.target_low:  # not NaN
            self.target_low = min(self.target_low, block.target_low)
            self.target_high = max(self.target_high, block.target_high)
        elif high > response.end_v:
            self.past_the_surface += int(np.count_nonzero(amplitude > response.end_v))
        self.below += block.below
        self.above += block.above
        # The attraction is a^2 / 4 for a sine of amplitude a.
        self.sensation.take(np.square(block.instant_v) / 4)
        self.friction.take(block.mu)
        self.only = block if self.samples == len(drive) else None

    @property
    def rms_v(self) -> float:
        """Root mean square of the drive [V]."""
        return sqrt(self.square_sum / max(self.samples, 1))

    def current(self, sample_rate_hz: float, capacitance_f: float) -> Current:
        """Return the current through the person that is expected."""
        rms_step_v = sqrt(self.step_square_sum / max(self.samples, 1))
        peak, rms = self.steepest_step_v * sample_rate_hz, rms_step_v * sample_rate_hz
        return Current.of_slew(peak, rms, capacitance_f)

    @property
    def is_reached(self) -> bool:
        """Whether all friction asked for is reachable."""
        return self.below == 0 and self.above == 0
