"""Open a device by its address."""

from __future__ import annotations

from typing import Any

from firmware_io.address import SETTING_KEYS, read_selector, split_address
from firmware_io.device import Device
from firmware_io.scheme import Scheme, scheme, scheme_names


def open_device(address: str) -> Device:
    """Open the device at an address.

    Parameters
    ----------
    address : str
        A scheme, a colon, and comma-separated key=value pairs; `haptix devices` lists what is
        connected. ``"mock:"``, ``"mock:pace=real,ceiling_v=150"``; ``"usb:"`` (the only one that is
        connected), ``"usb:serial=ABC"``; ``"hid:path=/dev/hidraw0"``;
        ``"audio:device=scarlett,full_scale_v=200"``;
        ``"daq:channel=Dev1/ao0,amplifier_gain=50,watchdog=yes"``; ``"tcp:localhost:7420"``. All
        schemes also take ``mode`` (waveform or envelope), ``sample_rate_hz`` and ``carrier_hz``.
        docs/devices.md lists every key; the error for an unknown key lists those of its scheme.

    Returns
    -------
    Device
        Open, not yet armed.

    Raises
    ------
    DeviceNotFoundError, DeviceBusyError, DevicePermissionError, ProtocolError
        If none is there, another program uses it, this user may not, or it is no haptix driver.
    DeviceError
        If the address cannot be read or describes an impossible device.
    LimitError
        If the address asks for a ceiling above the absolute one.

    Examples
    --------
    >>> with open_device("mock:ceiling_v=150") as device:
    ...     device.capabilities.ceiling_v
    150.0
    """
    link, values = read_address(address)
    names = ["mode", "carrier_hz"] if link.makes_rate else ["mode", "carrier_hz", "sample_rate_hz"]
    settings = {key: values.pop(key) for key in names if key in values}
    later = {key: values.pop(key) for key in ("lead_s", "watchdog_s") if key in values}
    device = Device(link.open(**values), **settings)
    try:
        device.set_up(**later)
    except BaseException:
        device.close()
        raise
    return device


def read_address(address: str) -> tuple[Scheme, dict[str, Any]]:
    """Return the scheme of an address and the values of its keys; nothing is opened.

    Raises
    ------
    DeviceError
        If the address cannot be read.
    """
    name, selector = split_address(address, scheme_names())
    link = scheme(name)
    values, pairs = link.split(selector)
    return link, values | read_selector(name, pairs, {**link.keys, **SETTING_KEYS})
