"""Real-time playback: one thread makes samples, another owns the device and plays them."""

from __future__ import annotations

import signal
import threading
import weakref
from dataclasses import dataclass
from numbers import Real
from types import FrameType, TracebackType
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from firmware_io.clock import HOST_CLOCK, Clock
from firmware_io.device import Device
from firmware_io.errors import DeviceError
from firmware_io.feeder import Feeder

LONGEST_LEAD_S = 1.0
_JOIN_S = 5.0  # longer than any link waits before it gives up


@dataclass(frozen=True)
class PlaybackStats:
    """Counters since `Playback.start`.

    Parameters
    ----------
    lead_s : float
        Time from `put` to the output that is asked for, in seconds.
    underruns : int
        Number of times that samples ran out before the signal had come to rest.
    late_blocks : int
        Blocks put after samples had run out.
    samples_played : int
        Samples put that have gone to the device.
    device_rate_hz, drift_ppm : float or None
        Samples that the device plays per second of the host's clock, and the excess over its
        stated rate; None in the first second.
    stall_s : float
        Longest time in which the signal got no samples, in seconds; 0 if they never ran out.
    holding_lead_s : float or None
        Shortest lead that would have held, in seconds; None if this one has.
    """

    lead_s: float
    underruns: int
    late_blocks: int
    samples_played: int
    device_rate_hz: float | None
    drift_ppm: float | None
    stall_s: float = 0.0
    holding_lead_s: float | None = None

    @property
    def advice(self) -> str:
        """What to do if the lead did not hold; empty if it did."""
        if self.holding_lead_s is None:
            return ""
        held = f"a lead of {self.holding_lead_s * 1e3:.0f} ms would have held"
        if self.holding_lead_s > LONGEST_LEAD_S:
            held = f"no lead up to {LONGEST_LEAD_S:g} s would have held"
        return (
            f"cannot hold its lead of {self.lead_s * 1e3:.3g} ms: {self.underruns} underruns, "
            f"{self.late_blocks} late blocks, longest stall {self.stall_s * 1e3:.0f} ms; {held}. "
            "Choose a longer lead, or give the computer less to do"
        )

    def __str__(self) -> str:
        drift = "" if self.drift_ppm is None else f", drift {self.drift_ppm:.0f} ppm"
        line = (
            f"{self.samples_played} samples, lead {self.lead_s * 1e3:.3g} ms, {self.underruns} "
            f"underruns, {self.late_blocks} late blocks{drift}"
        )
        return f"{line}; {self.advice}" if self.advice else line


class Playback:
    """Plays samples in real time, through a thread that owns the device.

    The thread keeps the device's queue at the lead, by the device's own clock, so that the delay
    does not grow. When samples run out it ramps to 0 V, keeps the device fed with 0 V, and fades
    in when they return. However it ends (`stop`, an exception, Ctrl-C, SIGTERM, the interpreter's
    exit, or garbage collection), the output ends at 0 V and the thread ends. It can start again.

    Parameters
    ----------
    device : Device
        Open; only the playback may use it between `start` and `stop`.
    lead_s : float
        Time from `put` to the output, in seconds: the longest stall that is not felt.
    block_s : float
        Shortest write to the device, in seconds, unless its queue runs low; at most a third of
        the lead. With HID reports it is rounded up to whole frames.
    clock : Clock, optional
        For tests: there is no thread, and each call does the work that is due.

    Raises
    ------
    DeviceError
        If a time is out of range.
    """

    def __init__(
        self,
        device: Device,
        lead_s: float = 0.025,
        block_s: float = 0.001,
        *,
        clock: Clock | None = None,
    ) -> None:
        is_number = isinstance(lead_s, Real)
        if not (is_number and 0.003 <= lead_s <= LONGEST_LEAD_S):
            raise DeviceError(
                f"lead_s must lie in 0.003..{LONGEST_LEAD_S:g}, but is {lead_s!r}; "
                "0.025 is a usual lead."
            )
        if not (0.0 < block_s <= lead_s / 3):
            raise DeviceError(
                f"block_s must be above 0 and at most a third of lead_s, {lead_s / 3:g}, but is "
                f"{block_s!r}; shorten the block or lengthen the lead."
            )
        if device.mock is not None and device.mock.pace == "virtual":
            raise DeviceError(
                "This mock plays at once whatever it is sent, without a lead; open "
                '"mock:pace=real" for playback, or write to the device directly.'
            )
        self.device = device
        self.lead_s = lead_s
        self._clock = clock
        self._now = HOST_CLOCK if clock is None else clock
        self._block_s = block_s
        self._writer: _Writer | None = None
        self._finalizer: weakref.finalize[Any, Any] | None = None
        self._terminator: _Terminator | None = None
        self._turn = threading.RLock()  # one thread starts or stops at a time

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
        feeder = Feeder(self.device, self.lead_s, self._block_s, self._now)
        writer = _Writer(feeder)
        writer.feeder.begin()
        self._writer = writer
        # Holds only the writer: a reference to this object would keep it from being collected.
        self._finalizer = weakref.finalize(self, writer.abandon)
        self._terminator = _Terminator()
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

    def _stop(self, finalizer: weakref.finalize[Any, Any], writer: _Writer, drain: bool) -> None:
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

    def put(self, volts: npt.NDArray[np.float64]) -> None:
        """Append samples; the device plays them one lead later.

        Parameters
        ----------
        volts : ndarray of float64, shape (n,)
            Voltages at the device's sample rate, or amplitudes if it makes the carrier.

        Raises
        ------
        DeviceError
            If there is no room, or it does not run; once, the error that ended it.
        LimitError
            Once, if earlier samples broke a limit; the output is then at 0 V.
        """
        writer = self._running()
        values = np.asarray(volts)
        if values.ndim != 1 or values.dtype.kind not in "fiu":
            raise DeviceError(
                "Voltages must be a 1-D array of real numbers, but came as "
                f"{values.ndim}-D {values.dtype}; give one voltage per sample."
            )
        writer.feeder.put(values.astype(np.float64, copy=False))
        if self._clock is not None:
            self._step(writer)

    def wait_for_room(self, samples: int, timeout_s: float = 1.0) -> bool:
        """Wait until this many samples can be put without a longer delay.

        Returns
        -------
        bool
            Whether there is room; False after the timeout.

        Raises
        ------
        DeviceError, LimitError
            As from `put`.
        """
        writer = self._running()
        feeder = writer.feeder
        if samples > feeder.lead:
            raise DeviceError(
                f"The lead holds {feeder.lead} samples, but room for {samples} was asked for; "
                "put shorter blocks, or choose a longer lead."
            )
        end_s = self._now() + timeout_s
        if self._clock is not None:
            self._step(writer)
        while True:
            with feeder.ready:
                if not writer.is_over:
                    missing = samples - self._room(feeder)
                    left_s = end_s - self._now()
                    if missing <= 0:
                        return True
                    if left_s <= 0:
                        return False
                    wait_s = min(max(missing / feeder.rate_hz, 1e-4), left_s)
                    if self._clock is None:
                        feeder.ready.wait(wait_s)
            writer.raise_once()
            self._running()
            if self._clock is not None:
                self._clock.sleep(min(self._step(writer), wait_s))

    @property
    def room_samples(self) -> int:
        """Samples that can be put before the delay exceeds the lead; 0 if stopped."""
        if self._writer is None or self._writer.is_over:
            return 0
        with self._writer.feeder.ready:
            return self._room(self._writer.feeder)

    @property
    def samples_put(self) -> int:
        """Samples put since `start`."""
        return 0 if self._writer is None else self._writer.feeder.samples_put

    @property
    def queued_samples(self) -> int:
        """Samples between `put` and the output."""
        if self._writer is None or self._writer.is_over:
            return 0
        with self._writer.feeder.ready:
            return self._writer.feeder.queued

    @property
    def error(self) -> BaseException | None:
        """The error that ended the playback; None if there was none."""
        return None if self._writer is None else self._writer.error

    @property
    def is_running(self) -> bool:
        """Whether samples can be put."""
        return self._finalizer is not None and self._writer is not None and not self._writer.is_over

    @property
    def shortages(self) -> tuple[int, int]:
        """Underruns and late blocks, as in `stats`, for callers that ask often."""
        return (0, 0) if self._writer is None else self._writer.feeder.shortages

    @property
    def stats(self) -> PlaybackStats:
        """Counters since `start`."""
        if self._writer is None:
            return PlaybackStats(self.lead_s, 0, 0, 0, None, None)
        feeder = self._writer.feeder
        with feeder.ready:
            return PlaybackStats(
                self.lead_s,
                feeder.underruns,
                feeder.late_blocks,
                feeder.samples_taken,
                feeder.device_clock.rate_hz,
                feeder.device_clock.drift_ppm,
                feeder.longest_gap_s and self.lead_s + feeder.longest_gap_s,
                feeder.holding_lead_s,
            )

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

    def _room(self, feeder: Feeder) -> int:
        return max(0, min(feeder.lead - feeder.queued, feeder.ring.room))

    def _step(self, writer: _Writer) -> float:
        delay_s = writer.round()
        writer.raise_once()
        return delay_s

    def _running(self) -> _Writer:
        writer = self._writer
        if writer is not None:
            writer.raise_once()
        if self._finalizer is None or writer is None or writer.is_over:
            raise DeviceError(
                "The playback does not run; call start() or use it in a with statement."
            )
        return writer


class _Writer:
    """The thread that owns the device; it holds no reference to its `Playback`."""

    def __init__(self, feeder: Feeder) -> None:
        self.feeder = feeder
        self.error: BaseException | None = None
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
        while not self._over.is_set():
            delay_s = self.round()
            with feeder.ready:
                if not (self._must_end or self._over.is_set()):
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


class _Terminator:
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
