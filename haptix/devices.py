"""Opening of devices, with the profile that is installed for them."""

from __future__ import annotations

import firmware_io
from firmware_io import Device
from haptix.profiles import profile_of


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
