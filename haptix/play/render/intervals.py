"""Plays one interval on a device, and returns its beginning and the panel's reports."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from firmware_io import Device
from firmware_io.clock import HOST_CLOCK
from firmware_io.progress import Marked
from firmware_io.protocol import TouchReport

_READINGS = 5
NO_FORCE = 65535  # the force of a panel that does not measure it


@dataclass(frozen=True)
class TouchSample:
    """One report of the panel; the force is None if it was not measured."""

    t_s: float
    x_mm: float
    y_mm: float
    normal_force_n: float | None
    contact: int
    phase: str


@dataclass(frozen=True)
class PlayedInterval:
    """An interval that was played."""

    onset_s: float
    """Time at which its first sample was played, by the clock of the log."""
    marked: tuple[Marked, ...]
    """The driver's marks of that sample; empty for a driver that takes no marks."""


def play(
    device: Device, drive_v: npt.NDArray[np.float64], clock: Callable[[], float], code: int = 0
) -> PlayedInterval:
    """Play to the end, and return when the output began.

    The driver marks the first sample with `code` and gives its time. For a driver that takes no
    marks the time follows from its count of samples. At the end, and after any error, the device is
    at 0 V and disarmed. Reports of the panel from before are dropped.
    """
    takes_marks = getattr(getattr(device, "capabilities", None), "takes_marks", False)
    if hasattr(device, "touches"):
        device.touches()
    if takes_marks:
        device.marked()
    with device:
        began, offset_s = clock(), _offset_s(clock, device)
        if takes_marks:
            device.mark(0, code)
        device.write(drive_v)
        first_s: float | None = None
        if hasattr(device, "progress"):  # a stand-in for a device may lack it
            progress = device.progress(is_fresh=True)
            if progress.is_playing and progress.samples_played:
                rate = device.capabilities.sample_rate_hz
                first_s = progress.reported_s - progress.samples_played / rate
    marked = tuple(device.marked()) if takes_marks else ()
    for mark in marked:
        if mark.time_s is not None:
            first_s = mark.time_s
    onset_s = began if first_s is None else max(began, first_s + offset_s)
    return PlayedInterval(onset_s, marked)


def reported(device: Device) -> list[TouchReport]:
    """Return the panel's reports since the interval began."""
    return device.touches() if hasattr(device, "touches") else []


def on_log_time(
    reports: Sequence[TouchReport], device: Device, clock: Callable[[], float]
) -> list[TouchSample]:
    """Return reports of a panel on the time of `clock`."""
    offset = _offset_s(clock, device)
    return [
        TouchSample(
            round(device.host_time_s(report.clock_ticks) + offset, 5),
            report.x_um / 1e3,
            report.y_um / 1e3,
            None if report.normal_force_mn == NO_FORCE else report.normal_force_mn / 1e3,
            report.contact,
            report.phase.name.lower(),
        )
        for report in reports
    ]


def _offset_s(clock: Callable[[], float], device: Device) -> float:
    """Time of a clock minus that of the device's host, by the quickest of several readings."""
    host: Callable[[], float] = getattr(device, "clock", HOST_CLOCK)
    readings = []
    for _ in range(_READINGS):
        before, at, after = host(), clock(), host()
        readings.append((after - before, at - (before + after) / 2))
    return min(readings)[1]


def code_of(trial: int, interval: int) -> int:
    """Return the code of a mark: 10 times the trial's number modulo 6000, plus the interval's."""
    return 10 * (trial % 6000) + interval + 1


def name_of(device: Device) -> str:
    """Address of a device, and the serial number of its driver."""
    serial = getattr(getattr(device, "capabilities", None), "serial", "")
    return " ".join(filter(None, (getattr(device, "name", ""), serial)))
