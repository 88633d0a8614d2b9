"""Samples that a driver holds and has not played, which may be revised."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from firmware_io.drive_check import DriveCheck
from firmware_io.errors import DeviceError
from firmware_io.protocol import INDEX_MODULUS, SEQUENCE_MODULUS, StatusReport
from firmware_io.revisable import Revisable

_Volts = npt.NDArray[np.float64]


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
        self._full_scale_v = checks.setup.full_scale_mv / 1e3
        self._seen = seen
        self._revised = self._refused = 0

    def note_sent(self) -> None:
        """Count a revision that was sent."""
        self._revised += 1

    @property
    def number(self) -> int:
        """Number of the next revision."""
        return self._revised % SEQUENCE_MODULUS

    def check_appended(self, driven: _Volts) -> None:
        """Reject what would break a limit behind the queue."""
        queue = self.queue
        waiting = self._checks.driven(queue.values, queue.first, self.before_v)
        self._checks.check_window(np.concatenate([waiting, driven]))

    def replace(self, first: int, volts: _Volts, most: int) -> npt.NDArray[np.int16]:
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
                queue.values[start : start + volts.size + 1], queue[first - 1], self._full_scale_v
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
