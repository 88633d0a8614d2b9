"""From an address to a device, and what the buses of this computer show."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import TypedDict, cast

from firmware_io.device import Device
from firmware_io.errors import DeviceError, DeviceNotFoundError
from firmware_io.mock import MockDriver, MockLink

_HARDWARE_SCHEMES = ("usb", "hid", "audio")
_NOT_USABLE = "Seen on the bus; this version carries no link to real hardware."


class _MockSelector(TypedDict, total=False):
    sample_rate_hz: float
    full_scale_v: float
    ceiling_v: float
    lead_s: float
    watchdog_s: float


@dataclass(frozen=True)
class DeviceInfo:
    """One device that was found.

    Parameters
    ----------
    address : str
        What `open_device` takes.
    kind : str
        "mock", "usb", "hid" or "audio".
    name : str
        For people.
    usable : bool
        Whether this version can open it.
    note : str
        What to know about it.
    """

    address: str
    kind: str
    name: str
    usable: bool
    note: str


@dataclass(frozen=True)
class BusReport:
    """What one bus showed.

    Parameters
    ----------
    kind : str
        "usb", "hid" or "audio".
    available : bool
        Whether the bus could be looked at.
    detail : str
        The library and its version, or why it is missing and what to install.
    devices : tuple of DeviceInfo
        What is connected.
    """

    kind: str
    available: bool
    detail: str
    devices: tuple[DeviceInfo, ...]


def open_device(address: str) -> Device:
    """Open the device at an address.

    Parameters
    ----------
    address : str
        A scheme, a colon and an optional selector of comma-separated key=value pairs, such as
        ``"mock:"`` or ``"mock:sample_rate_hz=250000,ceiling_v=150"``. The keys of the mock are
        sample_rate_hz, full_scale_v (default 250), ceiling_v (default 200), lead_s (default 0.025)
        and watchdog_s (default 0.25).

    Returns
    -------
    Device
        Not yet armed.

    Raises
    ------
    DeviceNotFoundError
        If the scheme is unknown, or this version has no link for it.
    DeviceError
        If the address is no string, or the selector cannot be understood or describes no possible
        device.
    LimitError
        If the selector asks for a ceiling above the absolute one.
    """
    if not isinstance(address, str):
        raise DeviceError(
            f"An address is a string, but {address!r} came, of type {type(address).__name__}; "
            'use for example "mock:".'
        )
    scheme, colon, selector = address.partition(":")
    if colon and scheme in _HARDWARE_SCHEMES:
        raise DeviceNotFoundError(
            f'There is no link for "{scheme}:" in this version, which carries only the mock '
            f'link, but {address!r} was asked for; use "mock:".'
        )
    if not colon or scheme != "mock":
        raise DeviceNotFoundError(
            f"An address begins with mock:, usb:, hid: or audio:, but {address!r} does not; "
            'use "mock:".'
        )
    return Device(MockLink(MockDriver(**_parse_mock_selector(selector))))


def list_devices() -> list[DeviceInfo]:
    """Return the mock and whatever the buses show, without opening anything."""
    mock = DeviceInfo("mock:", "mock", "mock driver", True, "Plays into memory; always there.")
    return [mock, *(device for report in survey_buses() for device in report.devices)]


def survey_buses() -> list[BusReport]:
    """Look at USB, HID and audio, without opening anything.

    Returns
    -------
    list of BusReport
        One for each bus. A library that is missing or fails is reported, never raised.
    """
    return [
        _survey("usb", _usb, "pip install pyusb; on Debian: apt install libusb-1.0-0"),
        _survey("hid", _hid, "pip install hidapi, not the package called hid, which hides it"),
        _survey("audio", _audio, "pip install sounddevice; on Debian: apt install libportaudio2"),
    ]


def _parse_mock_selector(selector: str) -> _MockSelector:
    keys = _MockSelector.__annotations__
    known = ", ".join(keys)
    options: dict[str, float] = {}
    for pair in selector.split(",") if selector else ():
        key, _, text = (part.strip() for part in pair.partition("="))
        if key not in keys or key in options:
            raise DeviceError(
                f"The mock takes key=value pairs, each key once, but {pair!r} came; "
                f"the keys are {known}."
            )
        try:
            options[key] = float(text)
        except ValueError:
            raise DeviceError(
                f"The mock's {key} must be a number, but {text!r} came; write for example "
                f'"mock:{key}=1". The keys are {known}.'
            ) from None
    return cast(_MockSelector, options)


def _survey(kind: str, look: Callable[[], tuple[str, list[DeviceInfo]]], remedy: str) -> BusReport:
    try:
        detail, devices = look()
    # Whatever a third-party library raises here is a finding about this computer, not our error.
    except Exception as error:
        return BusReport(kind, False, f"{str(error) or type(error).__name__} ({remedy})", ())
    return BusReport(kind, True, detail, tuple(devices))


def _seen(kind: str, selector: str, name: str) -> DeviceInfo:
    return DeviceInfo(f"{kind}:{selector}", kind, name, False, _NOT_USABLE)


def _usb() -> tuple[str, list[DeviceInfo]]:
    core = import_module("usb.core")
    # Product names would need the device to be opened; the numbers come with the enumeration.
    devices = [
        _seen(
            "usb",
            f"bus={device.bus},address={device.address}",
            f"{device.idVendor:04x}:{device.idProduct:04x}",
        )
        for device in core.find(find_all=True)
    ]
    return f"pyusb {import_module('usb').__version__}", devices


def _hid() -> tuple[str, list[DeviceInfo]]:
    hid = import_module("hid")
    devices = []
    for found in hid.enumerate():
        numbers = f"{found['vendor_id']:04x}:{found['product_id']:04x}"
        path = found["path"].decode(errors="replace")
        devices.append(_seen("hid", f"path={path}", found["product_string"] or numbers))
    return f"hidapi {hid.version_str()}", devices


def _audio() -> tuple[str, list[DeviceInfo]]:
    sounddevice = import_module("sounddevice")
    devices = [
        _seen("audio", f"index={index}", found["name"])
        for index, found in enumerate(sounddevice.query_devices())
        if found["max_output_channels"] > 0
    ]
    version = sounddevice.get_portaudio_version()[1]
    return f"sounddevice {sounddevice.__version__}, {version}", devices
