"""From a stimulus to drive samples, block by block: made, checked, counted and written."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import lru_cache
from math import inf, sqrt

import numpy as np

from haptix.checks import Array
from haptix.devices import Current
from haptix.errors import InputError
from haptix.perception import SensationInTime
from haptix.status import Status
from haptix.stimuli.stimulus import Stimulus
from haptix.surface import Column
from haptix.waves import sine

BLOCK = 1 << 16
"""Samples per block. Sums run block by block, so that their last bits depend on it."""


@dataclass(frozen=True)
class Block:
    """Consecutive samples of a drive, and how well they give the friction asked for."""

    first: int
    drive_v: Array
    """Voltage, shape (samples,)."""
    amplitude_v: Array
    """Amplitude of the carrier, or of the sine with the mean attraction of the drive's period up to
    each sample, shape (samples,)."""
    instant_v: Array
    """Amplitude of the carrier, or of the sine with the attraction of the instant."""
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
        """Render `count` samples from number `first` on."""
        stimulus, response = self.stimulus, self.response
        values = stimulus.signal.values(first, count, self.sample_rate_hz)
        if stimulus.quantity == "volts":
            if stimulus.carrier_hz is None:
                mean = self._over_period(first, count)
                # The attraction of a sine is that of its mean square: here of the sine sqrt(2) |v|.
                instant = np.abs(values) * np.sqrt(2)
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

    def _carrier(self, first: int, count: int) -> Array:
        assert self.stimulus.carrier_hz is not None
        make = sine if first else _first_carrier
        return make(first, count, self.stimulus.carrier_hz, self.sample_rate_hz)

    def stream(self, threads: int = 1) -> Iterator[Block]:
        """Yield the blocks in order, rendered by `threads` threads, which change no number."""
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
    """Make blocks by several threads, a few ahead of the one that is handed out."""
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
