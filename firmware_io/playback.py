"""Real-time playback with a long queue and a short reaction: queued samples are revised."""

from __future__ import annotations

import logging
import signal
import threading
import weakref
from abc import ABC, abstractmethod
from collections.abc import Callable
from numbers import Real
from types import FrameType
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from firmware_io.clock import HOST_CLOCK, raise_priority
from firmware_io.device import Device
from firmware_io.device_errors import DeviceError
from firmware_io.reviser import PlaybackStats, Reviser, Source

_LOG = logging.getLogger("firmware_io.playback")

LONGEST_HORIZON_S = 0.11
"""Longest horizon: with the spare beyond it, the most revisable samples that a driver may hold."""

JOIN_S = 5.0  # longer than any link waits


class WaveSource:
    """A source whose samples are the same at every request, so that nothing is revised.

    Parameters
    ----------
    samples : callable
        Takes an index and a count; returns the volts of so many samples from it, shape (count,).

    Examples
    --------
    >>> tone = WaveSource(lambda first, count: np.sin(0.1 * np.arange(first, first + count)))
    """

    grid = 1
    is_live = False

    def __init__(self, samples: Callable[[int, int], npt.NDArray[np.float64]]) -> None:
        self._samples = samples

    def window(
        self, first: int, count: int, at_s: float, is_revision: bool
    ) -> npt.NDArray[np.float64]:
        """Return samples from index `first` on.

        Parameters
        ----------
        first, count, at_s, is_revision
            As in `Source.window`.
        """
        return self._samples(first, count)

    def settle(self, obeyed: int, undone: bool) -> None:
        """Nothing is revised.

        Parameters
        ----------
        obeyed, undone
            As in `Source.settle`.
        """

    def played(self, index: int) -> None:
        """Nothing is kept."""


class Playback:
    """Plays the samples of a source, and makes queued ones again until they are played.

    One thread owns the device. It takes samples from the source up to the horizon ahead. On each
    touch, and at least every 15 ms, it takes the samples that are played next again and revises the
    queue. A stall up to the horizon is no underrun. However it ends (`stop`, an exception, Ctrl-C,
    SIGTERM, the interpreter's exit, or garbage collection), the output ends at 0 V and the thread
    ends. It can start again.

    On a device with a clock of its own there is no thread: `step` and `run_until` do the work, by
    that clock.

    Parameters
    ----------
    device : Device
        Open; only the playback may use it between `start` and `stop`.
    source : Source
        Makes the samples, in the thread of the playback.
    reaction_s : float
        Time from a touch to the first sample that knows of it: wake-up, rendering, transport and
        the driver's guard. If these take longer, the reaction is as short as they allow.
    horizon_s : float
        Longest stall that is no underrun.
    stats : PlaybackStats, optional
        Counters.
    writer : callable, optional
        Makes the thread that plays, such as `firmware_io.own_thread.OwnThread`; the source is then
        not asked.
    on_read : callable, optional
        Called in the thread that plays, some 500 times a second, after the driver's reports were
        read: there `Device.readings` has new ones.

    Attributes
    ----------
    has_thread : bool
        Whether a thread plays, by the host's own clock.

    Raises
    ------
    DeviceError
        If a time is out of range, or the device is a mock that plays at once.
    """

    def __init__(
        self,
        device: Device,
        source: Source,
        reaction_s: float = 0.003,
        horizon_s: float = 0.1,
        *,
        stats: PlaybackStats | None = None,
        on_read: Callable[[], None] | None = None,
        writer: Callable[[], Writer] | None = None,
    ) -> None:
        for name, value, least, most in (
            ("reaction_s", reaction_s, 0.001, 0.1),
            ("horizon_s", horizon_s, 0.02, LONGEST_HORIZON_S),
        ):
            if not (isinstance(value, Real) and least <= value <= most):
                raise DeviceError(f"{name} must lie in {least:g}..{most:g}, but is {value!r}.")
        if device.mock is not None and device.mock.pace == "virtual":
            raise DeviceError(
                'This mock plays at once whatever it is sent; open "mock:pace=real", or '
                '"mock:pace=stepped" for a clock of its own, or write to the device directly.'
            )
        self.device = device
        self.stats = counts = PlaybackStats() if stats is None else stats
        counts.reaction_s, counts.horizon_s = reaction_s, horizon_s
        # Without a reference to this object, which would keep it from being collected.
        self._writer = writer or (lambda: RevisingWriter(Reviser(device, source, counts, on_read)))
        self._clock = device.clock
        self.has_thread = self._clock is HOST_CLOCK
        self.writer: Writer | None = None
        self._finalizer: weakref.finalize[Any, Any] | None = None
        self._terminator: Terminator | None = None
        self._turn = threading.RLock()  # one thread starts or stops at a time

    def start(self) -> None:
        """Arm the device and begin with 0 V; no effect if it runs.

        Raises
        ------
        DeviceError
            If the device cannot be armed, or its driver cannot revise.
        """
        with self._turn:
            if self._finalizer is not None:
                return
            writer = self._writer()
            writer.begin()
            stats = self.stats
            _LOG.info("begins: reaction %g s, horizon %g s", stats.reaction_s, stats.horizon_s)
            self.writer = writer
            # Holds only the writer: a reference to this object would keep it from being collected.
            self._finalizer = weakref.finalize(self, writer.abandon)
            self._terminator = Terminator()
            if self.has_thread:
                writer.thread.start()

    def stop(self) -> None:
        """Ramp to 0 V at once, disarm, and end the thread. Idempotent.

        Raises
        ------
        DeviceError, LimitError
            The error that ended the playback, unless it was raised before.
        """
        with self._turn:
            if self._finalizer is None or self.writer is None:
                return
            self._finalizer.detach()
            self._finalizer = None
            try:
                self.writer.end()
            finally:
                if self._terminator is not None:
                    self._terminator.restore()
                    self._terminator = None
            self.raise_once()

    def touch(self, touched_s: float | None = None) -> None:
        """Say that the source has changed, at a time of the device's clock or now.

        Raises
        ------
        DeviceError, LimitError
            Once, the error that ended the playback.
        """
        self._running().touch(self._clock() if touched_s is None else touched_s)

    def step(self) -> float:
        """Do the work that is due, without a thread; return the time to the next step, in seconds.

        Raises
        ------
        DeviceError, LimitError
            Once, the error that ended the playback.
        """
        delay_s = self._running().round()
        self.raise_once()
        return delay_s

    def run_until(self, end_s: float) -> None:
        """Wait until a time of the device's clock, and do the work meanwhile if there is no thread.

        Raises
        ------
        DeviceError, LimitError
            Once, the error that ended the playback.
        """
        clock = self._clock
        while not self.has_thread and (delay_s := self.step()) < end_s - clock():
            clock.sleep(max(delay_s, _LEAST_STEP_S))
        clock.sleep(max(0.0, end_s - clock()))

    def raise_once(self) -> None:
        """Raise the error that ended the playback, unless it was raised before."""
        if self.writer is not None:
            self.writer.raise_once()

    @property
    def error(self) -> BaseException | None:
        """The error that ended the playback; None if there was none."""
        return None if self.writer is None else self.writer.error

    @property
    def is_running(self) -> bool:
        """Whether it plays."""
        return self._finalizer is not None and self.writer is not None and not self.writer.is_over

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(self, _: object, error: BaseException | None, __: object) -> None:
        try:
            self.stop()
        except BaseException as failure:
            if error is None:
                raise
            if failure is not error:
                error.add_note(f"Stopping the playback failed as well: {failure}")

    def _running(self) -> Writer:
        self.raise_once()
        writer = self.writer
        if self._finalizer is None or writer is None or writer.is_over:
            raise DeviceError(
                "The playback does not run; call start() or use it in a with statement."
            )
        return writer


_LEAST_STEP_S = 1e-5  # half a sample, so that a driver's clock moves between two steps


class Writer(ABC):
    """A thread that owns the device; it holds no reference to its `Playback`.

    Parameters
    ----------
    device : Device
        Armed by `begin`.
    stats : PlaybackStats
        Counters.
    """

    def __init__(self, device: Device, stats: PlaybackStats) -> None:
        self.device, self.stats = device, stats
        self.error: BaseException | None = None
        self._over = threading.Event()
        # A daemon, so that an interpreter that exits does not wait for it before `abandon` runs.
        self.thread = threading.Thread(target=self._run, name="firmware_io playback", daemon=True)
        self._was_raised = False

    @abstractmethod
    def begin(self) -> None:
        """Arm the device."""

    @abstractmethod
    def touch(self, touched_s: float) -> None:
        """Wake the thread: something has changed at a time of the host's clock."""

    @abstractmethod
    def round(self) -> float:
        """Do one round of the work without a thread; return the time to the next, in seconds."""

    @abstractmethod
    def _run(self) -> None:
        """Play until the end, in the thread."""

    @abstractmethod
    def _quit(self) -> None:
        """Let the thread end soon."""

    @property
    def is_over(self) -> bool:
        """Whether it has ended, by `stop` or by an error."""
        return self._over.is_set()

    def end(self) -> None:
        """End at 0 V, and wait for the end of the thread if there is one."""
        if self.thread.ident is None:
            if not self.is_over:
                self._end()
            return
        self._quit()
        if self.thread is threading.current_thread():  # called by the garbage collector
            return
        self.thread.join(JOIN_S)
        if self.thread.is_alive():
            raise DeviceError(
                f"The link did not return within {JOIN_S:g} s, so the host could not bring the "
                "output to 0 V; the driver's watchdog does. Unplug the device and open it again."
            )

    def abandon(self) -> None:
        """End without raising: nobody can catch an error of a playback that was collected."""
        try:
            self.end()
        except Exception:
            self.error = self.error or DeviceError("The playback was collected and did not end.")

    def raise_once(self) -> None:
        """Raise the error that ended the playback, the first time."""
        if self.error is not None and not self._was_raised:
            self._was_raised = True
            raise self.error

    def _end(self) -> None:
        try:
            # At once: queued samples are provisional and are not played out.
            self.device.stop_at_once()
        except BaseException as error:
            self._fail(error)
        self._close()

    def _fail(self, error: BaseException) -> None:
        self.error = error
        _LOG.info("fails, %s: %s", type(error).__name__, error)
        try:
            self.device.stop_at_once()
        except Exception as failure:
            if failure is not error:
                error.add_note(f"Bringing the output to 0 V failed as well: {failure}")
        self._close()

    def _close(self) -> None:
        _LOG.info("ends: %s", self.stats)
        self._over.set()


class RevisingWriter(Writer):
    """A thread of the interpreter, or without one whoever calls `round`."""

    def __init__(self, reviser: Reviser) -> None:
        super().__init__(reviser.device, reviser.stats)
        self.reviser = reviser
        self._must_end = False

    def begin(self) -> None:
        """Arm the device."""
        self.reviser.begin()

    def touch(self, touched_s: float) -> None:
        """Wake the thread: something has changed at a time of the host's clock."""
        self.reviser.touch(touched_s)

    def round(self) -> float:
        """Do one round of the work; keep an error, which ends the playback."""
        try:
            return self.reviser.step()
        except BaseException as error:
            self._fail(error)
            return 0.0

    def _quit(self) -> None:
        with self.reviser.ready:
            self._must_end = True
            self.reviser.ready.notify_all()

    def _run(self) -> None:
        reviser = self.reviser
        raise_priority()
        while not self._over.is_set():
            delay_s = self.round()
            with reviser.ready:
                if not (self._must_end or self._over.is_set() or reviser.has_touch):
                    reviser.ready.wait(delay_s)
                must_end = self._must_end
            if must_end and not self._over.is_set():
                self._end()

    def _close(self) -> None:
        with self.reviser.ready:
            super()._close()
            self.reviser.ready.notify_all()


class Terminator:
    """Turns SIGTERM into SystemExit while a playback runs, so that with statements end.

    Only if no other handler is set, and only from the main thread, as Python requires.
    """

    def __init__(self) -> None:
        self._is_ours = (
            threading.current_thread() is threading.main_thread()
            and signal.getsignal(signal.SIGTERM) is signal.SIG_DFL
        )
        if self._is_ours:
            signal.signal(signal.SIGTERM, self._exit)

    def restore(self) -> None:
        """Restore the default, unless another handler was set since."""
        in_main = threading.current_thread() is threading.main_thread()
        if self._is_ours and in_main and signal.getsignal(signal.SIGTERM) == self._exit:
            signal.signal(signal.SIGTERM, signal.SIG_DFL)

    def _exit(self, number: int, frame: FrameType | None) -> None:
        raise SystemExit(128 + number)
