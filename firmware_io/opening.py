"""From an address to a device."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from firmware_io.address import (
    SETTING_KEYS,
    Read,
    count,
    hexadecimal,
    number,
    one_of,
    read_selector,
    split_address,
    yes_or_no,
)
from firmware_io.device import Device
from firmware_io.errors import DeviceError
from firmware_io.link import Link
from firmware_io.links.mock import MockLink
from firmware_io.mock import MockDriver
from firmware_io.protocol import REPORT_BYTES

_NUMBERS = {"vendor_id": hexadecimal, "product_id": hexadecimal}
_USB_KEYS: Mapping[str, Read] = {"serial": str, "bus": count, "address": count, **_NUMBERS}
_HID_KEYS: Mapping[str, Read] = {
    "path": str,
    "serial": str,
    "backend": one_of("hidraw", "hid"),
    **_NUMBERS,
}
_AUDIO_KEYS: Mapping[str, Read] = {
    "device": str,
    "profile": str,
    "full_scale_v": number,
    "dac_full_scale_v": number,
    "amplifier_gain": number,
    "ceiling_v": number,
    "trigger": yes_or_no,
}
#: Those that say nothing of the driver itself.
_SETTINGS = [key for key in SETTING_KEYS if key != "sample_rate_hz"]
_MOCK_KEYS: Mapping[str, Read] = {
    "pace": one_of("virtual", "real"),
    "reports": yes_or_no,
    "full_scale_v": number,
    "ceiling_v": number,
    "serial": str,
}


def open_device(address: str) -> Device:
    """Open the device at an address.

    Parameters
    ----------
    address : str
        A scheme, a colon, and comma-separated key=value pairs; `haptix devices` lists what is
        there. ``"mock:"``, ``"mock:pace=real,ceiling_v=150"``; ``"usb:"`` (the only one that is
        connected), ``"usb:serial=ABC"``; ``"hid:path=/dev/hidraw0"``;
        ``"audio:device=scarlett,full_scale_v=200"``; ``"tcp:localhost:7420"``. All but audio's
        own also take ``mode`` (waveform or envelope), ``sample_rate_hz`` and ``carrier_hz``. The
        whole list is in docs/devices.md; a wrong key is answered with the keys of its scheme.

    Returns
    -------
    Device
        Not yet armed.

    Raises
    ------
    DeviceNotFoundError, DeviceBusyError, DevicePermissionError, ProtocolError
        If there is none, another program has it, this user may not, or it is no haptix driver.
    DeviceError
        If the address cannot be understood or describes no possible device.
    LimitError
        If the address asks for a ceiling above the absolute one.
    """
    scheme, selector = split_address(address, tuple(_OPENERS))
    return _OPENERS[scheme](selector)


def _open(
    scheme: str, selector: str, keys: Mapping[str, Read], link: Callable[..., Link]
) -> Device:
    values = read_selector(scheme, selector, {**keys, **SETTING_KEYS})
    setting = {key: values.pop(key) for key in SETTING_KEYS if key in values}
    return _set_up(link(**values), setting)


def _open_usb(selector: str) -> Device:
    from firmware_io.links.usb import UsbLink

    return _open("usb", selector, _USB_KEYS, UsbLink)


def _open_hid(selector: str) -> Device:
    from firmware_io.links.hid import HidLink

    return _open("hid", selector, _HID_KEYS, HidLink)


def _open_audio(selector: str) -> Device:
    from firmware_io.links.audio import AudioLink, AudioProfile, read_audio_profile

    values = read_selector("audio", selector, {**_AUDIO_KEYS, **SETTING_KEYS})
    setting = {key: values.pop(key) for key in _SETTINGS if key in values}
    path = values.pop("profile", None)
    if isinstance(values.get("device"), str) and values["device"].isdigit():
        values["device"] = int(values["device"])
    known = {} if path is None else read_audio_profile(path)
    return _set_up(AudioLink(AudioProfile(**{**known, **values})), setting)


def _open_tcp(selector: str) -> Device:
    from firmware_io.links.tcp import TcpLink

    place, _, rest = selector.partition(",")
    host, colon, port = place.rpartition(":")
    if not colon or not host or not port.isdigit() or not 0 < int(port) < 65536:
        raise DeviceError(
            f'tcp: takes a host and a port, as in "tcp:localhost:7420", but {place!r} came.'
        )
    return _open("tcp", rest, {}, lambda: TcpLink(host, int(port)))


def _open_mock(selector: str) -> Device:
    values = read_selector("mock", selector, {**_MOCK_KEYS, **SETTING_KEYS})
    # The mock has the rate that is asked for as its own.
    setting = {key: values.pop(key) for key in _SETTINGS if key in values}
    report_bytes = REPORT_BYTES if values.pop("reports", False) else None
    return _set_up(MockLink(MockDriver(**values), report_bytes), setting)


def _set_up(link: Link, setting: dict[str, Any]) -> Device:
    later = {key: setting.pop(key) for key in ("lead_s", "watchdog_s") if key in setting}
    device = Device(link, **setting)
    try:
        device.set_up(**later)
    except BaseException:
        device.close()
        raise
    return device


_OPENERS: dict[str, Callable[[str], Device]] = {
    "mock": _open_mock,
    "usb": _open_usb,
    "hid": _open_hid,
    "audio": _open_audio,
    "tcp": _open_tcp,
}
