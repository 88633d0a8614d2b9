"""A ring of samples between the thread that makes them and the one that owns the device."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from firmware_io.errors import DeviceError


class SampleRing:
    """First in, first out, in memory that is allocated once. Its owner holds the lock.

    Parameters
    ----------
    capacity : int
        Most samples that it holds.
    """

    def __init__(self, capacity: int) -> None:
        self._samples = np.zeros(capacity)
        self._first = 0
        self.queued = 0

    @property
    def room(self) -> int:
        """Samples that can be put."""
        return self._samples.size - self.queued

    def put(self, volts: npt.NDArray[np.float64]) -> None:
        """Append samples, shape (n,).

        Raises
        ------
        DeviceError
            If there is no room for all of them; none is taken then.
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
        """Remove and return the oldest `count` samples, which must be there, as a copy."""
        head = min(count, self._samples.size - self._first)
        taken = np.empty(count)
        taken[:head] = self._samples[self._first : self._first + head]
        taken[head:] = self._samples[: count - head]
        self._first = (self._first + count) % self._samples.size
        self.queued -= count
        return taken

    def clear(self) -> None:
        """Forget all samples."""
        self._first = self.queued = 0
