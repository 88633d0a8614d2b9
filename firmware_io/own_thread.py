"""The thread that plays without the interpreter, which may be busy or stand still.

`haptix_player.c` does in it what `firmware_io.reviser.Reviser` does in a thread of Python. A pipe
leads there: whoever has its end, another process too, reports fingers. POSIX only.
"""

from __future__ import annotations

import os
import select
import struct
import sys
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from threading import Event, RLock, Thread
from typing import Any

import cffi

from firmware_io.c_library import load
from firmware_io.clock import HOST_CLOCK, raise_priority
from firmware_io.device import Device
from firmware_io.device_errors import DeviceDisconnectedError, DeviceError, LimitError
from firmware_io.link import Bulk
from firmware_io.playback import Writer
from firmware_io.protocol import FrameKind
from firmware_io.protocol.frames import read_payload
from firmware_io.reviser import STATUS_S, PlaybackStats, Sizes

QUIET_S = 1.0
"""If the interpreter stands still for so long, the output ends at 0 V."""

_ALIVE_S = 0.1
_REPORT = struct.Struct("=iiiiddddd")
_TOLD = struct.Struct("=dq")
_ALIVE, _FINGER, _CHANGED, _QUIT, _MARK_NEXT = range(5)
_TOLD_BYTES = 65536


@cache
def compiled() -> tuple[cffi.FFI, Any]:
    """Return the compiled player.

    Raises `DeviceError` if it is not there and cannot be built, or cannot be loaded.
    """
    return load("haptix-player", Path(__file__).parent / "player" / "haptix_player.h")


@dataclass(frozen=True)
class CompiledSource:
    """A source in C: addresses of its state, and of the functions of `hx_source` in order."""

    grid: int
    """See `firmware_io.Source`."""
    of: int
    functions: tuple[int, ...]
    kept: object
    """What must live as long as it plays."""


def finger_report(
    touch_id: int,
    t_s: float,
    x_mm: float,
    y_mm: float,
    normal_force_n: float | None = None,
    is_down: bool = True,
    arrival_s: float | None = None,
) -> bytes:
    """Return the bytes by which a finger is reported, to be written at once to `OwnThread.reports`.

    Parameters
    ----------
    touch_id : int
        Which finger.
    t_s, x_mm, y_mm : float
        Time by the host's clock, and place.
    normal_force_n : float, optional
        Force, if it was measured.
    is_down : bool
        Whether it is on the screen.
    arrival_s : float, optional
        When the report came to the host; the default is now.

    Examples
    --------
    >>> len(finger_report(0, 1.25, 10.0, 20.0))
    56
    """
    arrival_s = HOST_CLOCK() if arrival_s is None else arrival_s
    force_n = normal_force_n or 0.0
    return _REPORT.pack(_FINGER, touch_id, is_down, 0, arrival_s, t_s, x_mm, y_mm, force_n)


class OwnThread(Writer):
    """Plays a source in C in a thread of its own.

    The thread sends STOP and ends if a sample breaks a limit, the driver reports a fault or falls
    silent, the interpreter stands still for `QUIET_S`, or all ends of the pipe are closed.

    Parameters
    ----------
    device : Device
        Its link must have a file descriptor, and its samples be the drive; see `why_not`.
    source : CompiledSource
        Makes the samples.
    stats : PlaybackStats
        Counters; they follow ten times a second.
    on_count : callable, optional
        Called after the counters were copied, with the times that the last windows took [s].

    Attributes
    ----------
    reports : int
        File descriptor of the pipe. Bytes written there at once are one report, see
        `finger_report`.
    """

    def __init__(
        self,
        device: Device,
        source: CompiledSource,
        stats: PlaybackStats,
        on_count: Callable[[list[float]], None] = lambda windows_s: None,
    ) -> None:
        super().__init__(device, stats)
        self._source = source
        self._on_count = on_count
        self._reactions = self._windows = 0  # that have been copied
        self._returned = Event()
        self._pipe = RLock()  # a number of a closed end may be another file's
        self.reports = self._read_end = self._reports_of_hid = -1
        self._told = self._tells = -1  # a pipe by which the driver's frames come
        self._part = b""  # of them, whose rest has not come
        self._reader: BulkReader | None = None

    @staticmethod
    def why_not(device: Device) -> str:
        """Return why the thread cannot play to a device; nothing if it can.

        Parameters
        ----------
        device : Device
        """
        if sys.platform == "win32" or device.clock is not HOST_CLOCK or device.lend() is None:
            return f"{device.name} has no waveform that goes through a file descriptor"
        try:
            compiled()
        except DeviceError as error:
            return str(error)
        return ""

    def begin(self) -> None:
        """Arm the device and prepare the player."""
        device, source = self.device, self._source
        device.set_up(lead_s=0.0, status_s=STATUS_S)
        device.arm(revisable=True)
        stream = device.lend()
        if stream is None:
            device.stop_at_once()
            raise DeviceError(f"{device.name} cannot be played without the interpreter.")
        self._stream = stream
        ffi, lib = compiled()
        sizes = Sizes.of(device, source.grid, self.stats.horizon_s)
        self._read_end, self.reports = os.pipe()
        self._told, self._tells = os.pipe()
        for end in (self._read_end, self.reports, self._told, self._tells):
            os.set_blocking(end, False)
        lent = stream.lend()
        for name in ("window", "limits"):
            lent[name] = ffi.cast("void *", _address(lent[name]))
        setup = ffi.new("hx_player_setup *", lent)
        if (node := stream.link.reports_node) is not None:
            self._reports_of_hid = setup.link = self._opened(node)
            setup.report_bytes = stream.link.report_bytes
        elif (bulk := stream.link.bulk) is not None:
            self._reader = BulkReader(bulk)
            setup.link, setup.bulk = self._reader.came, self._reader.bulk[0]
        setup.told = self._tells
        setup.reports, setup.grid, setup.revised = self._read_end, source.grid, sizes.window
        setup.piece, setup.least, setup.horizon = sizes.piece, sizes.least, sizes.horizon
        setup.reaction_s, setup.guard_s = self.stats.reaction_s, device.capabilities.guard_s
        setup.least_interval_s, setup.quiet_s = sizes.least_interval_s, QUIET_S
        made = ffi.new("hx_source *")
        made.of = ffi.cast("void *", source.of)
        names = [name for name, _ in ffi.typeof("hx_source").fields][1:]
        for name, at in zip(names, source.functions, strict=True):
            setattr(made, name, ffi.cast(ffi.typeof(getattr(made, name)), at))
        self._memory = ffi.new("double[]", lib.hx_player_bytes() // 8 + 1)
        self._player = ffi.cast("hx_player *", self._memory)
        if not lib.hx_player_init(self._player, setup, made):
            self._forget_pipe()
            device.stop_at_once()
            raise DeviceError(
                f"{device.name} has a queue, a rate or frames that the player has no room for."
            )
        self._alive = Thread(target=self._say_alive, name="firmware_io owner", daemon=True)

    def _opened(self, node: Path) -> int:
        """Return another descriptor of the device's node."""
        try:
            return os.open(node, os.O_RDWR | os.O_NONBLOCK | os.O_CLOEXEC)
        except OSError as error:
            self._forget_pipe()
            self.device.stop_at_once()
            raise DeviceError(
                f"{node} cannot be opened twice: {error}; play without own_thread."
            ) from error

    @property
    def began_s(self) -> float:
        """When sample 0 was played, by the host's clock; 0 before the first sample."""
        return float(self._look().began_s)

    def report(self, report: bytes) -> None:
        """Report a finger; see `finger_report`. Without effect once it has ended."""
        # A pipe is full if the thread has not run for a second.
        with self._pipe, suppress(OSError):
            if self.reports >= 0:
                os.write(self.reports, report)

    def touch(self, touched_s: float) -> None:
        """Wake the thread: something has changed at a time of the host's clock."""
        self.report(_REPORT.pack(_CHANGED, 0, 0, 0, touched_s, 0.0, 0.0, 0.0, 0.0))

    def mark(self, code: int) -> None:
        """Mark the next sample that the driver has not received, see `Device.mark`.

        Parameters
        ----------
        code : int
            Number that `Device.marked` repeats.

        Raises
        ------
        DeviceError
            If too many wait for room in the driver.
        """
        kept: int = compiled()[1].HX_MARKS_KEPT
        if self._stream.marks_waiting >= kept:
            raise DeviceError(
                f"{kept} marks wait for room in {self.device.name}; mark fewer samples."
            )
        self._stream.note_mark()
        self.report(_REPORT.pack(_MARK_NEXT, code, 0, 0, 0.0, 0.0, 0.0, 0.0, 0.0))

    def round(self) -> float:
        """Do nothing, since the thread does it."""
        return _ALIVE_S

    def _quit(self) -> None:
        self.report(_REPORT.pack(_QUIT, 0, 0, 0, 0.0, 0.0, 0.0, 0.0, 0.0))

    def _say_alive(self) -> None:
        """Tell the thread ten times a second that the interpreter goes on; take its frames."""
        due_s, come = HOST_CLOCK(), select.poll()
        come.register(self._told, select.POLLIN)
        while not self._returned.is_set():
            come.poll(1e3 * max(0.0, due_s - HOST_CLOCK()))
            self._take_frames()
            if HOST_CLOCK() >= due_s:
                due_s = HOST_CLOCK() + _ALIVE_S
                self.report(_REPORT.pack(_ALIVE, 0, 0, 0, 0.0, 0.0, 0.0, 0.0, 0.0))
                self._count()

    def _take_frames(self) -> None:
        with suppress(BlockingIOError):
            while came := os.read(self._told, _TOLD_BYTES):
                self._part += came
        told, at = self._part, 0
        while len(told) - at >= _TOLD.size:
            at_s, count = _TOLD.unpack_from(told, at)
            begin, end = at + _TOLD.size, at + _TOLD.size + count
            if end > len(told):
                break
            self._stream.client.take(told[begin:end], at_s)
            at = end
        self._part = told[at:]

    def _run(self) -> None:
        raise_priority()
        self._alive.start()
        if self._reader is not None:
            self._reader.start()
        # The call lets the interpreter go, and does not need it until it returns.
        compiled()[1].hx_player_run(self._player)
        self._returned.set()
        os.close(self._tells)  # which wakes the other thread
        self._tells = -1
        if self._reader is not None:
            self._reader.end()
        if self._reports_of_hid >= 0:
            with suppress(DeviceError):  # the player has read them, too
                self._stream.link.receive()
        self._alive.join()
        self._take_frames()
        self._count()
        try:
            self._take_back()
        except BaseException as error:
            self._fail(error)
        else:
            self._end()
        finally:
            self._forget_pipe()

    def _look(self) -> Any:
        """Return the player's counters of now; any thread may ask."""
        ffi, lib = compiled()
        counts = ffi.new("hx_player_counts *")
        lib.hx_player_count(self._player, counts)
        return counts

    def _count(self) -> None:
        """Copy the counters."""
        counts, stats = self._look(), self.stats
        stats.samples_played, stats.underruns = counts.sent, counts.underruns
        stats.revisions, stats.refused = counts.revisions, counts.refused
        stats.late_samples, stats.longest_stall_s = counts.late_samples, counts.longest_stall_s
        stats.reactions_s.extend(_newest(counts.reaction_s, counts.reactions, self._reactions))
        windows_s = _newest(counts.window_s, counts.windows, self._windows)
        self._reactions, self._windows = counts.reactions, counts.windows
        self._on_count(windows_s)

    def _take_back(self) -> None:
        """Let the device go on, and raise why the player has ended by itself."""
        counts, stream = self._look(), self._stream
        ffi, lib = compiled()
        outcome, fault = counts.outcome, None
        if outcome == lib.HX_IN_FAULT:
            fault = read_payload(FrameKind.FAULT, bytes(ffi.buffer(counts.fault)))
        stream.client.take_back(counts.sequence, counts.frames_sent, counts.bytes_sent)
        stream.take_back(counts.sent, fault)
        name = self.device.name
        if outcome == lib.HX_OVER_SAMPLE:
            limits = stream.limits
            raise LimitError(
                f"A sample of the layout breaks the ceiling of {limits.ceiling_v:g} V or the slew "
                f"of {limits.max_slew_v_per_s:g} V/s; compile it for this device."
            )
        if outcome == lib.HX_OVER_WINDOW:
            raise stream.checks.refusal(counts.verdict, counts.sample, counts.found)
        if outcome == lib.HX_LOST:
            error = counts.error or (self._reader.error if self._reader is not None else 0)
            why = os.strerror(error) if error else "the other side closed it"
            raise stream.client.lost(OSError(error, why))
        if outcome == lib.HX_SILENT:
            raise DeviceDisconnectedError(
                f"{name} has reported nothing within its watchdog time; check its cable and power, "
                "then open it again."
            )
        if outcome == lib.HX_QUIET:
            raise DeviceError(
                f"The interpreter stood still for {QUIET_S:g} s, so the output was brought to "
                "0 V; start again."
            )

    def _forget_pipe(self) -> None:
        with self._pipe:
            for end in (self.reports, self._read_end, self._told, self._tells):
                if end >= 0:
                    os.close(end)
            self.reports = self._read_end = self._told = self._tells = -1
        if self._reader is not None:
            self._reader.close()
        if self._reports_of_hid >= 0:
            os.close(self._reports_of_hid)
            self._reports_of_hid = -1


def _newest(ring: Any, end: int, begin: int) -> list[float]:
    """Return the numbers of a ring from one count to another, as far as they are kept."""
    return [ring[number % len(ring)] for number in range(max(begin, end - len(ring)), end)]


class BulkReader:
    """A thread that reads a bulk endpoint without the interpreter, into a pipe."""

    def __init__(self, bulk: Bulk) -> None:
        ffi, _ = compiled()
        self.came, self._to = os.pipe()
        for end in (self.came, self._to):  # it is full if nobody has read for many seconds
            os.set_blocking(end, False)
        self.error = 0
        """Number of the error by which the endpoint failed, or 0."""
        self._is_over = ffi.new("int32_t *")
        self.bulk = ffi.new("hx_bulk *")
        self.bulk.transfer = ffi.cast(ffi.typeof(self.bulk.transfer), bulk.transfer)
        self.bulk.handle = ffi.cast("void *", bulk.handle)
        self.bulk.outward, self.bulk.inward = bulk.outward, bulk.inward
        self._thread = Thread(target=self._run, name="firmware_io reader", daemon=True)

    def start(self) -> None:
        """Begin to read."""
        self._thread.start()

    def _run(self) -> None:
        raise_priority()
        self.error = compiled()[1].hx_bulk_read(self.bulk, self._to, self._is_over)
        if self.error:
            os.close(self._to)  # which the player sees
            self._to = -1

    def end(self) -> None:
        """Read no more; return when nothing of it is under way."""
        self._is_over[0] = 1
        self._thread.join()

    def close(self) -> None:
        """Close the pipe."""
        for end in (self.came, self._to):
            if end >= 0:
                os.close(end)
        self.came = self._to = -1


def _address(pointer: object) -> int:
    """Return the address that a pointer of any library holds."""
    return int(cffi.FFI().cast("uintptr_t", pointer))
