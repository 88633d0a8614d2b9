"""Values on their way, of which those that have not been used can be replaced."""

from __future__ import annotations

from collections import deque

import numpy as np
import numpy.typing as npt

from firmware_io.drive_check import DriveCheck
from firmware_io.errors import DeviceError
from firmware_io.protocol import INDEX_MODULUS, SEQUENCE_MODULUS, StatusReport

_Values = npt.NDArray[np.float64]


class Revisable:
    """A queue of numbers by index, whose replacements are in doubt until they are accepted.

    Attributes
    ----------
    first : int
        Index of the oldest value that it holds.
    """

    def __init__(self) -> None:
        self.first = 0
        self.values: _Values = np.empty(0)
        self._replaced: deque[tuple[int, _Values]] = deque()  # what stood there before

    @property
    def end(self) -> int:
        """Index behind the last value."""
        return self.first + self.values.size

    def __getitem__(self, index: int) -> float:
        """Return the value at an index from `first` on."""
        if not self.first <= index < self.end:
            raise IndexError(index)
        return float(self.values[index - self.first])

    def append(self, values: _Values) -> None:
        """Add values behind the last."""
        self.values = np.concatenate([self.values, values])

    def replace(self, first: int, values: _Values) -> None:
        """Replace values that it holds, from index `first` on."""
        start = first - self.first
        place = slice(start, start + values.size)
        self._replaced.append((first, self.values[place].copy()))
        self.values[place] = values

    def accept(self, count: int) -> None:
        """Take the oldest `count` replacements as final."""
        for _ in range(min(count, len(self._replaced))):
            self._replaced.popleft()

    def undo(self) -> int:
        """Take back all replacements that were not accepted; return how many there were."""
        count = len(self._replaced)
        while self._replaced:
            first, before = self._replaced.pop()
            gone = max(0, self.first - first)
            if gone < before.size:
                start = first + gone - self.first
                self.values[start : start + before.size - gone] = before[gone:]
        return count

    def undo_last(self) -> None:
        """Take back the newest replacement, before anything was dropped."""
        first, before = self._replaced.pop()
        self.values[first - self.first : first - self.first + before.size] = before

    def drop_before(self, index: int) -> _Values:
        """Remove the values before an index and return them."""
        count = min(max(0, index - self.first), self.values.size)
        gone, self.values = self.values[:count], self.values[count:]
        self.first += count
        return gone


class Provisional:
    """What a driver holds, as the host believes it, and the revisions under way.

    Parameters
    ----------
    checks : DriveCheck
        Limits; it takes what is played.
    seen : StatusReport or None
        The last report before the driver was armed.

    Attributes
    ----------
    queue : Revisable
        The samples, by index.
    before_v : float
        The sample before those.
    obeyed, undone : int
        Revisions that the driver has obeyed, and that it has refused or will.
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
        """Reject what would break a limit behind the queue."""
        queue = self.queue
        waiting = self._checks.driven(queue.values, queue.first, self.before_v)
        self._checks.check_window(np.concatenate([waiting, driven]))

    def replace(self, first: int, volts: _Values, most: int) -> npt.NDArray[np.int16]:
        """Replace queued samples from an index on, and return their codes.

        What breaks a limit is rejected.
        """
        queue, end = self.queue, first + volts.size
        if not (0 < volts.size <= most):
            raise DeviceError(
                f"A revision has 1 to {most} samples, but {volts.size} came; split it."
            )
        # The last one queued stays: what is appended goes on from it, whatever becomes of this.
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
        """Learn from the last report which revisions were obeyed, and what was played."""
        if status is None or status is self._seen:
            return
        self._seen = status
        obeyed = (status.revisions - self.obeyed) % SEQUENCE_MODULUS
        self.obeyed += obeyed
        self.queue.accept(obeyed)
        # Those sent behind a refused one are refused as well, whenever they come: counted already.
        if 0 < (status.refused - self._refused) % SEQUENCE_MODULUS < SEQUENCE_MODULUS // 2:
            undone = self.queue.undo()
            self._refused += undone
            self.undone += undone
            self._revised = self.obeyed
        self.take_played(sent - (sent - status.samples_played) % INDEX_MODULUS)

    def take_played(self, index: int) -> None:
        """Count samples before an index as driven: nothing can replace them any more."""
        first = self.queue.first
        volts = self.queue.drop_before(index)
        if volts.size:
            self._checks.take(self._checks.driven(volts, first, self.before_v))
            self.before_v = float(volts[-1])
