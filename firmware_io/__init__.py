"""Voltages to electrovibration screens: frames, links, limits.

`open_device` turns an address into a `Device`; a device, used in a with statement, takes
voltages and always ends at 0 V::

    with firmware_io.open_device("mock:") as device:
        device.write(volts)

In real time `Playback` plays through a device from a thread of its own. Every sample passes the
limits of limits.py on the host, and the driver's own behind the wire. The package speaks volts and
samples and knows no physics. A new kind of hardware is a new `Link`; the wire format is described
in PROTOCOL.md.
"""

from firmware_io.capabilities import Capabilities
from firmware_io.device import Device
from firmware_io.discovery import (
    BusReport,
    DeviceInfo,
    DeviceWatch,
    list_devices,
    survey_buses,
)
from firmware_io.errors import (
    DeviceBusyError,
    DeviceDisconnectedError,
    DeviceError,
    DeviceFaultError,
    DeviceNotFoundError,
    DevicePermissionError,
    HaptixError,
    LimitError,
    ProtocolError,
)
from firmware_io.limits import ABSOLUTE_CEILING_V, DriveLimits
from firmware_io.link import Link
from firmware_io.links.mock import MockLink
from firmware_io.mock import MockDriver
from firmware_io.opening import open_device
from firmware_io.playback import Playback, PlaybackStats
from firmware_io.protocol import codes_to_volts, volts_to_codes
from firmware_io.stream import Progress

__all__ = [
    "ABSOLUTE_CEILING_V",
    "BusReport",
    "Capabilities",
    "Device",
    "DeviceBusyError",
    "DeviceDisconnectedError",
    "DeviceError",
    "DeviceFaultError",
    "DeviceInfo",
    "DeviceNotFoundError",
    "DevicePermissionError",
    "DeviceWatch",
    "DriveLimits",
    "HaptixError",
    "LimitError",
    "Link",
    "MockDriver",
    "MockLink",
    "Playback",
    "PlaybackStats",
    "Progress",
    "ProtocolError",
    "codes_to_volts",
    "list_devices",
    "open_device",
    "survey_buses",
    "volts_to_codes",
]
