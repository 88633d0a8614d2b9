"""What a card's input reads of its output, against what was written."""

from __future__ import annotations

from collections import deque
from typing import Any

import numpy as np
import numpy.typing as npt

from firmware_io.errors import DeviceError

#: What the monitor may read beside what was written: its own noise and gain error. It reads with
#: an edge what the output had before it, or has after it if that settles soon.
_MONITOR_SHARE = 0.02
_MONITOR_BEFORE = 2  # samples
#: Wrong readings until the output ends, each of which this many right ones make good: a glitch
#: passes; an output that stands or has another gain does not, though it is right between crests.
_MONITOR_MOST = 8
_MONITOR_FORGIVEN = 1 / 16


class DaqMonitor:
    """Compares readings with samples, of one clock.

    Parameters
    ----------
    task : nidaqmx.Task
        Reads one input by the output's clock.
    full_v : float
        Volts of the card at digital full scale.
    most_waiting : int
        Samples that may be written and not yet read.
    """

    def __init__(self, task: Any, full_v: float, most_waiting: int) -> None:
        self.task = task
        self._full_v = full_v
        self._sent: deque[float] = deque(maxlen=most_waiting + _MONITOR_BEFORE)
        self._written = self._seen = 0  # samples
        self._strange = 0.0

    def take(self, volts: npt.NDArray[np.float64]) -> None:
        """Note samples that were written [V at the card]."""
        self._sent.extend(volts.tolist())
        self._written += volts.size

    def compare(self) -> None:
        """Compare what the input has read since.

        Raises
        ------
        DeviceError
            If it reads other volts, for longer than a glitch.
        """
        count = self.task.in_stream.avail_samp_per_chan
        if count == 0:
            return
        read = np.asarray(self.task.read(number_of_samples_per_channel=count), dtype=float)
        oldest = self._written - len(self._sent)
        sent = np.fromiter(self._sent, float, len(self._sent))
        off = beyond(read, sent, self._seen - oldest, self._full_v)
        self._seen += count
        for is_off in off:
            self._strange = max(0.0, self._strange + (1.0 if is_off else -_MONITOR_FORGIVEN))
            if self._strange >= _MONITOR_MOST:
                raise DeviceError("its monitor reads other volts than were written")


def beyond(
    read: npt.NDArray[np.float64], sent: npt.NDArray[np.float64], first: int, full_v: float
) -> npt.NDArray[np.bool_]:
    """Return where readings lie outside of the last samples until theirs, from index `first`."""
    places = first + np.arange(read.size)[:, None]
    around = places + np.arange(-_MONITOR_BEFORE, 1)
    near = np.where(around < 0, 0.0, sent[np.clip(around, 0, sent.size - 1)])
    room = _MONITOR_SHARE * full_v
    return np.asarray((read < near.min(axis=1) - room) | (read > near.max(axis=1) + room))
