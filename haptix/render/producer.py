"""Real time: a thread that renders a lead ahead of what is played."""

from __future__ import annotations

import gc
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager

import numpy as np
import numpy.typing as npt

from firmware_io import Device, Playback, PlaybackStats

SWITCH_S = 5e-4
"""How long a thread may hold the interpreter while another waits. With the usual 5 ms, a busy
thread delays a block by as much."""

_FOLLOW = 0.02  # share of the difference from the device's clock that each block corrects
_LOST_S = 0.05  # a larger difference is no jitter: the clock is set anew


@contextmanager
def ready_interpreter() -> Iterator[None]:
    """Keep garbage collection and thread switches short, and restore them.

    A full garbage collection takes some 100 ms here. Frozen objects are left out of it.
    """
    switch_s = sys.getswitchinterval()
    gc.collect()
    gc.freeze()
    sys.setswitchinterval(min(switch_s, SWITCH_S))
    try:
        yield
    finally:
        sys.setswitchinterval(switch_s)
        gc.unfreeze()


class Producer:
    """Thread that renders blocks as the device needs them.

    Parameters
    ----------
    device : Device
        A `Playback` owns it and plays on it meanwhile.
    render : callable
        Returns the samples of the next block, for the time at which its first is played.
    samples : int
        Number of samples of a block.
    lead_s : float
        See `firmware_io.Playback`.
    """

    def __init__(
        self,
        device: Device,
        render: Callable[[float], npt.NDArray[np.float64]],
        samples: int,
        lead_s: float,
    ) -> None:
        self._rate_hz = device.capabilities.sample_rate_hz
        block_s = samples / self._rate_hz
        self._playback = Playback(device, lead_s, min(block_s, lead_s / 3))
        self._render = render
        self._samples = samples
        self._must_end = threading.Event()
        self._error: BaseException | None = None
        self._thread = threading.Thread(target=self._run, name="haptix renderer", daemon=True)

    @property
    def stats(self) -> PlaybackStats:
        """Counts of the playback."""
        return self._playback.stats

    @property
    def shortages(self) -> tuple[int, int]:
        """Underruns and late blocks of the playback."""
        return self._playback.shortages

    def start(self) -> None:
        """Arm the device and start the thread."""
        # The collection comes first: it takes long, and an armed driver does not wait.
        with ExitStack() as stack:
            stack.enter_context(ready_interpreter())
            self._playback.start()
            self._interpreter = stack.pop_all()
        self._thread.start()

    def raise_once(self) -> None:
        """Raise the error that ended the thread, once."""
        error, self._error = self._error, None
        if error is not None:
            raise error

    def stop(self, error: BaseException | None) -> None:
        """End at 0 V; raise the error that ended the thread, unless another one is being raised."""
        self._must_end.set()
        self._thread.join()
        self._interpreter.close()
        try:
            self._playback.stop(drain=error is None)
        except BaseException as failure:
            if error is None:
                raise
            if failure is not error:
                error.add_note(f"Stopping the playback failed as well: {failure}")
        if error is None:
            self.raise_once()

    def _run(self) -> None:
        playback, block_s = self._playback, self._samples / self._rate_hz
        at_s: float | None = None
        try:
            while not self._must_end.is_set():
                if not playback.wait_for_room(self._samples, 0.1):
                    continue
                # When the first sample of this block will be played.
                due_s = time.monotonic() + playback.queued_samples / self._rate_hz
                if at_s is None or abs(due_s - at_s) > _LOST_S:
                    at_s = due_s
                at_s += _FOLLOW * (due_s - at_s)
                playback.put(self._render(at_s))
                at_s += block_s
        except BaseException as error:
            self._error = error
