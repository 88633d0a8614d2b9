"""Lab Streaming Layer: touches, the drive and markers, for the recorders of a laboratory.

Times are those of the driver's clock, carried to the host's by the reports that a driver sends of
it, and from there to that of the Lab Streaming Layer.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from firmware_io import Device
from firmware_io.clock import HOST_CLOCK, Clock
from firmware_io.errors import from_extra
from firmware_io.progress import Marked
from firmware_io.protocol import TouchReport
from haptix.checks import Array, positive, row
from haptix.errors import InputError
from haptix.stimuli.adaptive.playing import NO_FORCE

_READINGS = 5  # of two clocks one after the other; the closest pair counts

TOUCH_CHANNELS = (("x", "mm"), ("y", "mm"), ("normal_force", "N"), ("contact", ""), ("phase", ""))
DRIVE_CHANNELS = (("voltage", "V"), ("friction", ""))
MARKER_CHANNELS = (("code", ""), ("sample", ""))


class LabOutlets:
    """Three streams of one driver: ``NAME-touch``, ``NAME-drive`` and ``NAME-markers``.

    Touches are numbers at irregular times: x, y [mm], normal force [N; NaN if it is not measured],
    the finger's number, and 0 up, 1 down, 2 move. The drive has the samples that were sent [V] and
    the friction that they are meant to give (NaN if none is given), at the device's rate. Markers
    are texts: code and sample of each mark.

    Drive samples wait until a mark has told when one of them was played: mark the first. Ends as a
    context manager; a recorder keeps what it has received.

    Parameters
    ----------
    device : Device
        Whose clock stamps the streams.
    name : str
        Beginning of the streams' names, and with the device's their source.
    clock : Clock
        The host's, as the device has it.
    drive_hz : float, optional
        Rate of the drive's stream; by default that of the device's samples.

    Raises
    ------
    MissingExtraError
        Without the extra ``lab``.
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
        """Marks that came too late for the driver to time them."""
        rate = drive_hz or device.capabilities.sample_rate_hz
        source = f"{name}-{device.capabilities.serial}"
        self._touch = self._outlet(f"{name}-touch", "MoCap", TOUCH_CHANNELS, 0.0, source)
        self._drive = self._outlet(f"{name}-drive", "Stimulus", DRIVE_CHANNELS, rate, source)
        self._markers = self._outlet(f"{name}-markers", "Markers", MARKER_CHANNELS, 0.0, source)
        self._rate = positive("sample_rate_hz", rate)
        self._origin: Marked | None = None
        self._waiting: list[tuple[int, Array]] = []

    def _outlet(
        self, name: str, kind: str, channels: tuple[tuple[str, str], ...], rate: float, source: str
    ) -> Any:
        form = self._lsl.cf_string if kind == "Markers" else self._lsl.cf_double64
        info = self._lsl.StreamInfo(name, kind, len(channels), rate, form, f"{source}-{kind}")
        described = info.desc().append_child("channels")
        for label, unit in channels:
            one = described.append_child("channel")
            one.append_child_value("label", label)
            one.append_child_value("unit", unit)
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
        last_s = host_s + (len(volts) - 1) / self._rate
        self._drive.push_chunk(np.column_stack([volts, mu]).tolist(), self.lsl_time_s(last_s))

    def marks(self, marked: Iterable[Marked]) -> None:
        """Send marks, as `Device.marked` returns them."""
        for one in marked:
            if one.time_s is None:
                self.unplayed += 1
                continue
            self._origin = one
            texts = [str(one.code), str(one.sample_index)]
            self._markers.push_sample(texts, self.lsl_time_s(one.time_s))
        self._send_drive()

    def reports(self, reports: Iterable[TouchReport]) -> None:
        """Send touches, as `Device.touches` returns them."""
        for one in reports:
            force = np.nan if one.normal_force_mn == NO_FORCE else one.normal_force_mn / 1e3
            at = self._device.host_time_s(one.clock_ticks)
            self.touch(at, one.x_um / 1e3, one.y_um / 1e3, force, one.contact, int(one.phase))

    def follow(self) -> None:
        """Send the touches and marks that the device has read."""
        self.marks(self._device.marked())
        self.reports(self._device.touches())

    def _send_drive(self) -> None:
        if self._origin is None or self._origin.time_s is None:
            return
        for first, samples in self._waiting:
            last = first + len(samples) - 1 - self._origin.sample_index
            at = self.lsl_time_s(self._origin.time_s + last / self._rate)
            self._drive.push_chunk(samples.tolist(), at)  # the time is that of its last sample
        self._waiting.clear()

    def has_recorders(self) -> bool:
        """Whether somebody records all three streams."""
        return all(one.have_consumers() for one in (self._touch, self._drive, self._markers))

    def close(self) -> None:
        """Close the streams."""
        for name in ("_touch", "_drive", "_markers"):
            setattr(self, name, None)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()
