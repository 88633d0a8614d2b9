"""Voltages to electrovibration screens: frames, links, limits.

`open_device` turns an address into a `Device`; a device, used in a with statement, takes
voltages and always ends at 0 V::

    with firmware_io.open_device("mock:") as device:
        device.write(volts)

Every sample passes `DriveLimits.check` on the host and the driver's own ceiling behind the
wire. The package speaks volts and samples and knows no physics. A new kind of hardware is a
new `Link`; the wire format is described in PROTOCOL.md.
"""

from firmware_io.device import Device
from firmware_io.discovery import BusReport, DeviceInfo, list_devices, open_device, survey_buses
from firmware_io.errors import (
    DeviceDisconnectedError,
    DeviceError,
    DeviceFaultError,
    DeviceNotFoundError,
    HaptixError,
    LimitError,
    ProtocolError,
)
from firmware_io.limits import ABSOLUTE_CEILING_V, DriveLimits
from firmware_io.link import Capabilities, Link
from firmware_io.mock import MockDriver, MockLink
from firmware_io.protocol import (
    Frame,
    FrameKind,
    StreamMode,
    codes_to_volts,
    decode,
    encode,
    volts_to_codes,
)

__all__ = [
    "ABSOLUTE_CEILING_V",
    "BusReport",
    "Capabilities",
    "Device",
    "DeviceDisconnectedError",
    "DeviceError",
    "DeviceFaultError",
    "DeviceInfo",
    "DeviceNotFoundError",
    "DriveLimits",
    "Frame",
    "FrameKind",
    "HaptixError",
    "LimitError",
    "Link",
    "MockDriver",
    "MockLink",
    "ProtocolError",
    "StreamMode",
    "codes_to_volts",
    "decode",
    "encode",
    "list_devices",
    "open_device",
    "survey_buses",
    "volts_to_codes",
]
