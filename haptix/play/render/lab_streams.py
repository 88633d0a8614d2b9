"""Lab Streaming Layer: touches, the drive and markers, for the recorders of a laboratory.

Times are taken by the driver's clock. The driver reports its clock, which converts them to the
host's clock and from there to that of the Lab Streaming Layer.
"""

from __future__ import annotations

import time
from collections.abc import Iterable
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from firmware_io import Device
from firmware_io.clock import HOST_CLOCK, Clock
from firmware_io.progress import Marked
from firmware_io.protocol import TouchReport
from haptix.base.checks import Array, positive, row
from haptix.base.errors import InputError, from_extra
from haptix.play.render.intervals import NO_FORCE
from haptix.play.render.live import LiveRenderer
from haptix.play.render.played import COLUMNS, PlayedRecord
from haptix.play.touch import TouchEvent

_LOOK_S = 0.05  # between two looks for a recorder
_READINGS = 5  # of two clocks, one after the other; the quickest pair counts

TOUCH_CHANNELS = (("x", "mm"), ("y", "mm"), ("normal_force", "N"), ("contact", ""), ("phase", ""))
DRIVE_CHANNELS = (("voltage", "V"), ("friction", ""))
MARKER_CHANNELS = (("code", ""), ("sample", ""))

_PHASES = {"up": 0, "down": 1, "move": 2}
_TARGET = COLUMNS.index("wanted")
_FINAL_S = 0.02  # after this time no revision can change a sample any more


class LabOutlets:
    """Three streams of one driver: ``NAME-touch``, ``NAME-drive`` and ``NAME-markers``.

    Touches are numbers at irregular times: x, y [mm], normal force [N; NaN if it is not measured],
    the finger's number, and 0 up, 1 down, 2 move. The drive has the samples that were sent [V] and
    the friction that they are meant to give (NaN if none is given). Each has its own time, and the
    stream no nominal rate: between two intervals there are none, and readers that dejitter, such as
    pyxdf, would lay one line through both. The rate is in its description. Markers are texts: code
    and sample of each mark.

    Drive samples wait until a mark has reported when one of them was played: mark the first. Marks
    wait until somebody records them. Ends as a context manager; a recorder keeps the samples
    received so far. Raises `MissingExtraError` without the extra ``lab``.

    Parameters
    ----------
    device : Device
        Whose clock stamps the streams.
    name : str
        Beginning of the streams' names, and with the device's their source.
    clock : Clock
        The host's, as the device has it.
    drive_hz : float, optional
        Samples of the drive in a second; by default those of the device.
    """

    def __init__(
        self,
        device: Device,
        name: str = "haptix",
        clock: Clock = HOST_CLOCK,
        drive_hz: float | None = None,
    ) -> None:
        with from_extra("lab"):
            import pylsl
        self._lsl, self._clock, self._device = pylsl, clock, device
        self.unplayed = 0
        """Number of marks that came too late for the driver to time them."""
        rate = drive_hz or device.capabilities.sample_rate_hz
        source = f"{name}-{device.capabilities.serial}"
        self._rate = positive("sample_rate_hz", rate)
        self._touch = self._outlet(f"{name}-touch", "MoCap", TOUCH_CHANNELS, source)
        self._drive = self._outlet(f"{name}-drive", "Stimulus", DRIVE_CHANNELS, source)
        self._markers = self._outlet(f"{name}-markers", "Markers", MARKER_CHANNELS, source)
        self._origin: Marked | None = None
        self._waiting: list[tuple[int, Array]] = []
        self._unsent: list[tuple[list[str], float]] = []

    def _outlet(
        self, name: str, kind: str, channels: tuple[tuple[str, str], ...], source: str
    ) -> Any:
        form = self._lsl.cf_string if kind == "Markers" else self._lsl.cf_double64
        info = self._lsl.StreamInfo(name, kind, len(channels), 0.0, form, f"{source}-{kind}")
        if kind == "Stimulus":
            info.desc().append_child_value("sample_rate_hz", f"{self._rate:g}")
        described = info.desc().append_child("channels")
        for label, unit in channels:
            channel = described.append_child("channel")
            channel.append_child_value("label", label)
            channel.append_child_value("unit", unit)
        return self._lsl.StreamOutlet(info)

    def lsl_time_s(self, host_s: float) -> float:
        """Return a time of the host's clock as one of the Lab Streaming Layer's [s]."""
        readings = []
        for _ in range(_READINGS):
            before, lsl, after = self._clock(), self._lsl.local_clock(), self._clock()
            readings.append((after - before, lsl - (before + after) / 2))
        return float(host_s + min(readings)[1])

    def touch(
        self,
        host_s: float,
        x_mm: float,
        y_mm: float,
        normal_force_n: float = np.nan,
        contact: int = 0,
        phase: int = 2,
    ) -> None:
        """Send a touch, at a time of the host's clock."""
        values = [x_mm, y_mm, normal_force_n, float(contact), float(phase)]
        self._touch.push_sample(values, self.lsl_time_s(host_s))

    def drive(
        self, first_sample: int, volts: npt.ArrayLike, mu: npt.ArrayLike | None = None
    ) -> None:
        """Send samples of the drive, counted since the device was armed.

        Parameters
        ----------
        first_sample : int
            Number of the first.
        volts : array_like, shape (samples,)
            As they were written.
        mu : array_like, shape (samples,), optional
            Friction that they are meant to give.
        """
        drive = row("volts", volts)
        friction = np.full(len(drive), np.nan) if mu is None else row("mu", mu)
        if len(friction) != len(drive):
            raise InputError(
                f"mu: expected {len(drive)} values, as many as volts, got {len(friction)}"
            )
        self._waiting.append((first_sample, np.column_stack([drive, friction])))
        self._send_drive()

    def rows(self, host_s: float, volts: Array, mu: Array) -> None:
        """Send rows of the drive, of which the first was played at a time of the host's clock."""
        self._send_rows(host_s, np.column_stack([volts, mu]))

    def _send_rows(self, host_s: float, rows: Array) -> None:
        times = self.lsl_time_s(host_s) + np.arange(len(rows)) / self._rate
        self._drive.push_chunk(rows.tolist(), times.tolist())

    def marks(self, marked: Iterable[Marked]) -> None:
        """Send marks, as `Device.marked` returns them."""
        for mark in marked:
            if mark.time_s is None:
                self.unplayed += 1
                continue
            self._origin = mark
            texts = [str(mark.code), str(mark.sample_index)]
            self._unsent.append((texts, self.lsl_time_s(mark.time_s)))
        self._send_marks()
        self._send_drive()

    def _send_marks(self) -> None:
        if self._markers.have_consumers():
            for texts, at in self._unsent:
                self._markers.push_sample(texts, at)
            self._unsent.clear()

    def reports(self, reports: Iterable[TouchReport]) -> None:
        """Send touches, as `Device.touches` returns them."""
        for report in reports:
            force = np.nan if report.normal_force_mn == NO_FORCE else report.normal_force_mn / 1e3
            at = self._device.host_time_s(report.clock_ticks)
            place = (report.x_um / 1e3, report.y_um / 1e3)
            self.touch(at, *place, force, report.contact, int(report.phase))

    def follow(self) -> None:
        """Send the touches and marks that the device has read."""
        self.marks(self._device.marked())
        self.reports(self._device.touches())

    def _send_drive(self) -> None:
        if self._origin is None or self._origin.time_s is None:
            return
        for first, samples in self._waiting:
            after = (first - self._origin.sample_index) / self._rate
            self._send_rows(self._origin.time_s + after, samples)
        self._waiting.clear()

    def has_recorders(self) -> bool:
        """Whether somebody records all three streams."""
        outlets = (self._touch, self._drive, self._markers)
        return all(outlet.have_consumers() for outlet in outlets)

    def wait_for_recorders(self, most_s: float = 60.0) -> None:
        """Return as soon as somebody records all three streams.

        Raises `InputError` if nobody does within `most_s`.
        """
        until = time.monotonic() + positive("most_s", most_s)
        while not self.has_recorders():
            if time.monotonic() > until:
                raise InputError(
                    f"expected a recorder of the three streams within {most_s:g} s, got none; "
                    "start one, such as LabRecorder, and choose them, or leave out --lsl"
                )
            time.sleep(_LOOK_S)

    def close(self) -> None:
        """Send the marks that wait, and close the streams."""
        if self._markers is not None:
            self._send_marks()
        for name in ("_touch", "_drive", "_markers"):
            setattr(self, name, None)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()


class LiveOutlets:
    """Streams of a live renderer, as `LabOutlets` has them; follow them some ten times a second.

    Touches are those that the renderer took, by the times that they were stamped with. The drive
    has a row each millisecond: the amplitude that was sent [V], and the friction that the texture
    asked for under the finger that came down last; NaN without one. Its times are those of the
    samples, by the driver's clock. Markers are the marks of `LiveRenderer.mark`, by the same clock.

    Use it inside the renderer's context; on leaving, the record is sent to its end. Raises
    `InputError` if somebody else takes the renderer's record; `MissingExtraError` without the extra
    ``lab``.

    Parameters
    ----------
    renderer : LiveRenderer
        Entered, on a driver that takes marks and can revise. Its `record` and `taken` are used.
    name : str
        Beginning of the streams' names.
    """

    def __init__(self, renderer: LiveRenderer, name: str = "haptix") -> None:
        if renderer.record is not None or renderer.taken is not None:
            raise InputError("LiveOutlets: somebody takes what this renderer plays; end that first")
        self._renderer, self._record = renderer, PlayedRecord(renderer)
        drive_hz = 1 / self._record.row_s
        self._outlets = LabOutlets(renderer.device, name, drive_hz=drive_hz)
        renderer.record, renderer.taken = self._record, self._touch
        self.marks_sent = 0
        """Number of marks that the driver has reported."""

    def _touch(self, event: TouchEvent) -> None:
        is_up = event.kind == "up"
        at = (np.nan, np.nan) if is_up else (event.x_mm, event.y_mm)
        force = np.nan if event.normal_force_n is None else event.normal_force_n
        self._outlets.touch(event.t_s, *at, force, event.touch_id, _PHASES[event.kind])

    def follow(self) -> None:
        """Send the marks that the driver has reported, and the samples that it has played."""
        self._send_marks()
        self._send(self._renderer.now_s() - _FINAL_S)

    def _send_marks(self) -> None:
        marked = self._renderer.device.marked()
        self._outlets.marks(marked)
        self.marks_sent += len(marked)

    def _send(self, until_s: float) -> None:
        while (part := self._record.take(until_s)) is not None:
            volts = part.amplitude_v[:: self._record.per_row]
            friction = np.full(len(volts), np.nan)
            if part.rows:
                friction = part.rows[max(part.rows)][:, _TARGET]
            self._outlets.rows(part.t0_s, volts, friction)

    def has_recorders(self) -> bool:
        """Whether somebody records all three streams."""
        return self._outlets.has_recorders()

    def close(self) -> None:
        """Send the remaining marks and samples, and close the streams."""
        renderer = self._renderer
        renderer.record = renderer.taken = None
        self._send_marks()
        self._send(renderer.now_s())
        self._outlets.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: Any) -> None:
        self.close()
