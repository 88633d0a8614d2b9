"""Queued values, which can be replaced until they are used."""

from __future__ import annotations

from collections import deque

import numpy as np
import numpy.typing as npt

from firmware_io.device_errors import DeviceError
from firmware_io.drive_check import DriveCheck
from firmware_io.protocol import INDEX_MODULUS, SEQUENCE_MODULUS, StatusReport

_Values = npt.NDArray[np.float64]


class Revisable:
    """A queue of numbers by index; a replacement can be undone until it is accepted.

    Attributes
    ----------
    first : int
        Index of the oldest value.
    """

    def __init__(self) -> None:
        self.first = 0
        self.values: _Values = np.empty(0)
        self._replaced: deque[tuple[int, _Values]] = deque()  # the former values

    @property
    def end(self) -> int:
        """Index after the last value."""
        return self.first + self.values.size

    def __getitem__(self, index: int) -> float:
        """Return the value at an index from `first` on."""
        if not self.first <= index < self.end:
            raise IndexError(index)
        return float(self.values[index - self.first])

    def append(self, values: _Values) -> None:
        """Add values after the last one."""
        self.values = np.concatenate([self.values, values])

    def replace(self, first: int, values: _Values) -> None:
        """Replace values from index `first` on."""
        start = first - self.first
        place = slice(start, start + values.size)
        self._replaced.append((first, self.values[place].copy()))
        self.values[place] = values

    def accept(self, count: int) -> None:
        """Make the oldest `count` replacements final."""
        for _ in range(min(count, len(self._replaced))):
            self._replaced.popleft()

    def undo(self) -> int:
        """Undo all replacements that were not accepted; return their number."""
        count = len(self._replaced)
        while self._replaced:
            first, before = self._replaced.pop()
            gone = max(0, self.first - first)
            if gone < before.size:
                start = first + gone - self.first
                self.values[start : start + before.size - gone] = before[gone:]
        return count

    def undo_last(self) -> None:
        """Undo the newest replacement, before anything was dropped."""
        first, before = self._replaced.pop()
        self.values[first - self.first : first - self.first + before.size] = before

    def drop_before(self, index: int) -> _Values:
        """Remove the values before an index; return those of them that were accepted.

        A replacement that is accepted is so before its first value is used. One that was still on
        its way then came too late.
        """
        count = min(max(0, index - self.first), self.values.size)
        gone, self.values = self.values[:count].copy(), self.values[count:]
        for first, before in reversed(self._replaced):
            late = before[max(0, self.first - first) : max(0, self.first + count - first)]
            start = max(0, first - self.first)
            gone[start : start + late.size] = late
        self.first += count
        return gone


class Provisional:
    """The host's copy of a driver's queue, and the revisions under way.

    Parameters
    ----------
    checks : DriveCheck
        Limits; it counts the samples that are played.
    seen : StatusReport or None
        The last report before the driver was armed.

    Attributes
    ----------
    queue : Revisable
        The samples, by index.
    before_v : float
        The sample before the queue.
    obeyed, undone : int
        Revisions that the driver has obeyed, and those that it has refused or will refuse.
    """

    def __init__(self, checks: DriveCheck, seen: StatusReport | None) -> None:
        self.queue = Revisable()
        self.before_v = 0.0
        self.obeyed = self.undone = 0
        self._checks = checks
        self._seen = seen
        self._revised = self._refused = 0

    def note_sent(self) -> None:
        """Count a revision that was sent."""
        self._revised += 1

    @property
    def number(self) -> int:
        """Number of the next revision."""
        return self._revised % SEQUENCE_MODULUS

    def check_appended(self, driven: _Values) -> None:
        """Reject output that would break a limit after the queue."""
        queue = self.queue
        waiting = self._checks.driven(queue.values, queue.first, self.before_v)
        self._checks.check_window(np.concatenate([waiting, driven]))

    def replace(self, first: int, volts: _Values, most: int) -> npt.NDArray[np.int16]:
        """Replace queued samples from an index on, and return their codes.

        Samples that break a limit are rejected.
        """
        queue, end = self.queue, first + volts.size
        if not (0 < volts.size <= most):
            raise DeviceError(
                f"A revision has 1 to {most} samples, but {volts.size} came; split it."
            )
        # The last queued sample stays: appended samples follow it, whether this is obeyed or not.
        if not queue.first < first <= end < queue.end:
            raise DeviceError(
                f"Samples {queue.first + 1} to {queue.end - 2} can be revised, but {first} to "
                f"{end - 1} came; begin later, or end earlier."
            )
        start = first - queue.first
        queue.replace(first, volts)
        try:
            codes = self._checks.codes(
                queue.values[start : start + volts.size + 1], queue[first - 1]
            )
            self._checks.check_window(self._checks.driven(queue.values, queue.first, self.before_v))
        except BaseException:
            queue.undo_last()
            raise
        return codes[:-1]

    def settle(self, status: StatusReport | None, sent: int) -> None:
        """Read from the last report which revisions were obeyed, and which samples were played."""
        if status is None or status is self._seen:
            return
        self._seen = status
        obeyed = (status.revisions - self.obeyed) % SEQUENCE_MODULUS
        self.obeyed += obeyed
        self.queue.accept(obeyed)
        # The driver also refuses revisions that were sent after a refused one: they were counted.
        if 0 < (status.refused - self._refused) % SEQUENCE_MODULUS < SEQUENCE_MODULUS // 2:
            undone = self.queue.undo()
            self._refused += undone
            self.undone += undone
            self._revised = self.obeyed
        self.take_played(sent - (sent - status.samples_played) % INDEX_MODULUS)

    def take_played(self, index: int) -> None:
        """Count samples before an index as driven; they cannot be replaced any more."""
        first = self.queue.first
        volts = self.queue.drop_before(index)
        if volts.size:
            self._checks.take(self._checks.driven(volts, first, self.before_v))
            self.before_v = float(volts[-1])
