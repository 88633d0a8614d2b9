"""Devices, for rooms that know no wire: opened with their profile, and what limits a drive."""

from __future__ import annotations

import firmware_io
from firmware_io import Device
from firmware_io.drive_check import DriveWindow
from firmware_io.limits import (
    BODY_CAPACITANCE_F,
    MAX_PEAK_A,
    MAX_RMS_A,
    Current,
    DriveLimits,
    series_capacitance_f,
)
from haptix.profiles import profile_of

__all__ = [
    "BODY_CAPACITANCE_F",
    "MAX_PEAK_A",
    "MAX_RMS_A",
    "Current",
    "Device",
    "DriveLimits",
    "DriveWindow",
    "open_device",
    "series_capacitance_f",
]


def open_device(address: str) -> Device:
    """Open the device at an address; see `firmware_io.open_device`.

    Warns
    -----
    CalibrationWarning
        If the device names a calibration other than the profile that is installed for its serial
        number (`haptix.profiles`).
    """
    device = firmware_io.open_device(address)
    try:
        profile_of(device)
    except BaseException:
        device.close()
        raise
    return device
