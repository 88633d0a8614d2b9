"""From a stimulus to drive samples, block by block and by several threads."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from haptix.errors import InputError
from haptix.status import Status
from haptix.stimuli.stimulus import Stimulus
from haptix.surface import Column
from haptix.waves import sine

Array = npt.NDArray[np.float64]

BLOCK = 1 << 16
"""Samples of a block. Sums run block by block, so the last bits depend on it."""


@dataclass(frozen=True)
class Block:
    """Consecutive samples of a drive, and how well they give the friction asked for."""

    first: int
    drive_v: Array
    """Voltage, shape (samples,)."""
    amplitude_v: Array
    """Amplitude of the carrier, or of the sine with the same attraction, shape (samples,)."""
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
    """A stimulus for one response.

    Parameters
    ----------
    stimulus : Stimulus
        The signal, with its force and carrier.
    response : Column
        What voltage does; decides the volts for friction, and the friction for volts.
    sample_rate_hz : float
        Samples per second.
    """

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
        """Render some samples."""
        stimulus, response = self.stimulus, self.response
        values = stimulus.signal.values(first, count, self.sample_rate_hz)
        if stimulus.quantity == "volts":
            if stimulus.carrier_hz is None:
                # The attraction of a sine is that of its mean square: here of the sine sqrt(2) |v|.
                return Block(first, values, np.abs(values) * np.sqrt(2), np.nan, np.nan, 0, 0)
            drive = values * self._carrier(first, count)
            return Block(first, drive, np.abs(values), np.nan, np.nan, 0, 0)
        mu = values
        if stimulus.quantity == "contrast":
            mu = (1 + values) * response.lowest_mu
        low, high = float(mu.min()), float(mu.max())
        amplitude, status = response.voltage(mu)
        below = int(np.count_nonzero(status == Status.BELOW))
        above = int(np.count_nonzero(status == response.ends_by))
        return Block(
            first, amplitude * self._carrier(first, count), amplitude, low, high, below, above
        )

    def _carrier(self, first: int, count: int) -> Array:
        assert self.stimulus.carrier_hz is not None
        return sine(first, count, self.stimulus.carrier_hz, self.sample_rate_hz)

    def stream(self, threads: int = 1) -> Iterator[Block]:
        """Blocks in their order, rendered by `threads` threads; the numbers do not depend on it."""
        return in_order(
            lambda first: self.block(first, min(BLOCK, self.samples - first)),
            range(0, self.samples, BLOCK),
            threads,
        )

    def whole(self, threads: int = 1) -> Array:
        """All drive samples [V] at once, for short stimuli."""
        return np.concatenate([block.drive_v for block in self.stream(threads)])


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
