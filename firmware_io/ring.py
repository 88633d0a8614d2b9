"""A ring of samples between the thread that makes them and the one that owns the device."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from firmware_io.errors import DeviceError


class SampleRing:
    """A first-in, first-out buffer of fixed size. Its owner holds the lock.

    Parameters
    ----------
    capacity : int
        Largest number of samples in it.
    """

    def __init__(self, capacity: int) -> None:
        self._samples = np.zeros(capacity)
        self._first = 0
        self.queued = 0

    @property
    def room(self) -> int:
        """Number of samples that can be added."""
        return self._samples.size - self.queued

    def put(self, volts: npt.NDArray[np.float64]) -> None:
        """Append samples, shape (n,).

        Raises
        ------
        DeviceError
            If there is no room for all of them; none is added then.
        """
        if volts.size > self.room:
            raise DeviceError(
                f"There is room for {self.room} samples, but {volts.size} came; "
                "wait for room first, or choose a longer lead."
            )
        start = (self._first + self.queued) % self._samples.size
        head = min(volts.size, self._samples.size - start)
        self._samples[start : start + head] = volts[:head]
        self._samples[: volts.size - head] = volts[head:]
        self.queued += volts.size

    def take(self, count: int) -> npt.NDArray[np.float64]:
        """Remove and return the oldest `count` samples; the ring must hold as many."""
        head = min(count, self._samples.size - self._first)
        taken = np.empty(count)
        taken[:head] = self._samples[self._first : self._first + head]
        taken[head:] = self._samples[: count - head]
        self._first = (self._first + count) % self._samples.size
        self.queued -= count
        return taken

    def clear(self) -> None:
        """Remove all samples."""
        self._first = self.queued = 0
