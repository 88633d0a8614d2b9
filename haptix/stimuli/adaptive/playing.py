"""Plays one interval on a device, and says when it began."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from firmware_io import Device
from firmware_io.clock import HOST_CLOCK
from haptix.stimuli.adaptive.touch_log import TouchSample

_NO_FORCE = 65535  # of a panel that measures none


def play(device: Device, drive_v: npt.NDArray[np.float64], clock: Callable[[], float]) -> float:
    """Play to the end, and return when the output began, by `clock`.

    Afterwards the device is at 0 V and disarmed, whatever happens. What the panel reported before
    is dropped.
    """
    if hasattr(device, "touches"):
        device.touches()
    with device:
        began, host_s = clock(), HOST_CLOCK()
        device.write(drive_v)
        delay = 0.0
        if hasattr(device, "progress"):  # a stand-in for a device has none
            found = device.progress(is_fresh=True)
            if found.is_playing and found.samples_played:
                rate = device.capabilities.sample_rate_hz
                delay = found.reported_s - found.samples_played / rate - host_s
        return began + max(0.0, delay)


def touched(device: Device, clock: Callable[[], float]) -> list[TouchSample]:
    """Return what the panel has reported since the interval began, on the time of `clock`."""
    if not hasattr(device, "touches"):
        return []
    reports = device.touches()
    offset = clock() - HOST_CLOCK()
    return [
        TouchSample(
            round(device.host_time_s(one.clock_ticks) + offset, 5),
            one.x_um / 1e3,
            one.y_um / 1e3,
            None if one.normal_force_mn == _NO_FORCE else one.normal_force_mn / 1e3,
            one.contact,
            one.phase.name.lower(),
        )
        for one in reports
    ]


def name_of(device: Device) -> str:
    """Address of a device, and the serial number of its driver."""
    serial = getattr(getattr(device, "capabilities", None), "serial", "")
    return " ".join(filter(None, (getattr(device, "name", ""), serial)))
