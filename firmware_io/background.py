"""A thread that owns a device while it plays, and ends at 0 V however it ends."""

from __future__ import annotations

import signal
import threading
import weakref
from abc import ABC, abstractmethod
from types import FrameType, TracebackType
from typing import Any, Generic, Protocol, Self, TypeVar

from firmware_io.clock import HOST_CLOCK, Clock
from firmware_io.device import Device
from firmware_io.errors import DeviceError
from firmware_io.real_time import raise_priority

_JOIN_S = 5.0  # longer than any link waits before it gives up


class Feeds(Protocol):
    """The work of the thread: samples to the device. Its condition guards what others read."""

    ready: threading.Condition
    device: Device
    has_news: bool
    """Whether something has come since the step before."""

    def begin(self) -> None:
        """Arm the device."""

    def step(self) -> float:
        """Do what is due; return the time to the next step, in seconds."""

    def end(self, drain: bool) -> None:
        """Stop the device at 0 V, with `drain` after what was given has been played."""


F = TypeVar("F", bound=Feeds)


class BackgroundPlayback(ABC, Generic[F]):
    """Plays on a device through a thread; see `Playback` and `RevisedPlayback`.

    Parameters
    ----------
    device : Device
        Open; only the playback may use it between `start` and `stop`.
    clock : Clock, optional
        For tests: there is no thread, and each call does the work that is due.

    Raises
    ------
    DeviceError
        If the device is a mock in virtual time.
    """

    def __init__(self, device: Device, clock: Clock | None) -> None:
        if device.mock is not None and device.mock.pace == "virtual":
            raise DeviceError(
                "This mock plays at once whatever it is sent, without a lead; open "
                '"mock:pace=real" for playback, or write to the device directly.'
            )
        self.device = device
        self._clock = clock
        self._now = HOST_CLOCK if clock is None else clock
        self._writer: Writer[F] | None = None
        self._finalizer: weakref.finalize[Any, Any] | None = None
        self._terminator: Terminator | None = None
        self._turn = threading.RLock()  # one thread starts or stops at a time

    @abstractmethod
    def _feeder(self) -> F:
        """Return what feeds the device, not yet begun."""

    def start(self) -> None:
        """Arm the device and begin with 0 V; no effect if it runs.

        Raises
        ------
        DeviceError
            If the device cannot be armed.
        """
        with self._turn:
            if self._finalizer is None:
                self._start()

    def _start(self) -> None:
        writer = Writer(self._feeder())
        writer.feeder.begin()
        self._writer = writer
        # Holds only the writer: a reference to this object would keep it from being collected.
        self._finalizer = weakref.finalize(self, writer.abandon)
        self._terminator = Terminator()
        if self._clock is None:
            writer.thread.start()

    def stop(self, drain: bool = True) -> None:
        """End at 0 V, disarm, and end the thread. Idempotent.

        Parameters
        ----------
        drain : bool
            Play the samples put, at most two leads of them; otherwise ramp down at once.

        Raises
        ------
        DeviceError, LimitError
            The error that ended the playback, unless `put` has raised it.
        """
        with self._turn:
            if self._finalizer is not None and self._writer is not None:
                self._stop(self._finalizer, self._writer, drain)

    def _stop(self, finalizer: weakref.finalize[Any, Any], writer: Writer[F], drain: bool) -> None:
        finalizer.detach()
        self._finalizer = None
        try:
            if self._clock is None:
                writer.ask_to_end(drain)
            else:
                writer.end_stepping(drain)
        finally:
            if self._terminator is not None:
                self._terminator.restore()
                self._terminator = None
        writer.raise_once()

    @property
    def error(self) -> BaseException | None:
        """The error that ended the playback; None if there was none."""
        return None if self._writer is None else self._writer.error

    @property
    def is_running(self) -> bool:
        """Whether samples can be put."""
        return self._finalizer is not None and self._writer is not None and not self._writer.is_over

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        if error is None:
            self.stop()
            return
        try:
            self.stop(drain=False)
        except Exception as failure:
            if failure is not error:
                error.add_note(f"Stopping the playback failed as well: {failure}")

    def _step(self, writer: Writer[F]) -> float:
        delay_s = writer.round()
        writer.raise_once()
        return delay_s

    def _running(self) -> Writer[F]:
        writer = self._writer
        if writer is not None:
            writer.raise_once()
        if self._finalizer is None or writer is None or writer.is_over:
            raise DeviceError(
                "The playback does not run; call start() or use it in a with statement."
            )
        return writer


class Writer(Generic[F]):
    """The thread that owns the device; it holds no reference to its `Playback`."""

    def __init__(self, feeder: F) -> None:
        self.feeder = feeder
        self.error: BaseException | None = None
        self.is_real_time = False
        self._over = threading.Event()
        # A daemon, so that an interpreter that exits does not wait for it before `abandon` runs.
        self.thread = threading.Thread(target=self._run, name="firmware_io playback", daemon=True)
        self._is_told = False
        self._must_end = False
        self._drain = False

    @property
    def is_over(self) -> bool:
        """Whether it has ended, by `stop` or by an error."""
        return self._over.is_set()

    def round(self) -> float:
        """Do one round of the feeder; keep an error, which ends the playback."""
        try:
            return self.feeder.step()
        except BaseException as error:
            self._fail(error)
            return 0.0

    def ask_to_end(self, drain: bool) -> None:
        """Tell the thread to end at 0 V, and wait until it has."""
        with self.feeder.ready:
            self._must_end, self._drain = True, drain
            self.feeder.ready.notify_all()
        if self.thread is threading.current_thread():  # called by the garbage collector
            return
        self.thread.join(_JOIN_S)
        if self.thread.is_alive():
            raise DeviceError(
                f"The link did not return within {_JOIN_S:g} s, so the host could not bring the "
                "output to 0 V; the driver's watchdog does. Unplug the device and open it again."
            )

    def end_stepping(self, drain: bool) -> None:
        """Do the work at the thread's end, without a thread."""
        if not self.is_over:
            self._end(drain)

    def abandon(self) -> None:
        """End without raising, for a playback that was collected: nobody can catch an error."""
        try:
            if self.thread.ident is None:
                if not self.is_over:
                    self._end(False)
            else:
                self.ask_to_end(False)
        except Exception:
            self.error = self.error or DeviceError("The playback was collected and did not end.")

    def raise_once(self) -> None:
        """Raise the error that ended the playback, the first time."""
        if self.error is not None and not self._is_told:
            self._is_told = True
            raise self.error

    def _run(self) -> None:
        feeder = self.feeder
        self.is_real_time = raise_priority()
        while not self._over.is_set():
            delay_s = self.round()
            with feeder.ready:
                if not (self._must_end or self._over.is_set() or feeder.has_news):
                    feeder.ready.wait(delay_s)
                must_end = self._must_end
            if must_end and not self._over.is_set():
                self._end(self._drain)

    def _end(self, drain: bool) -> None:
        try:
            self.feeder.end(drain)
        except BaseException as error:
            self._fail(error)
        self._close()

    def _fail(self, error: BaseException) -> None:
        self.error = error
        try:
            self.feeder.device.stop_at_once()
        except Exception as failure:
            if failure is not error:
                error.add_note(f"Bringing the output to 0 V failed as well: {failure}")
        self._close()

    def _close(self) -> None:
        with self.feeder.ready:
            self._over.set()
            self.feeder.ready.notify_all()


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
