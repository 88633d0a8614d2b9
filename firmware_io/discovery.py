"""What is connected: drivers that can be opened, and what else the buses show."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import Self

from firmware_io.links.identity import PRODUCT_ID, VENDOR_ID
from firmware_io.links.usb import backend, serial_of

_OTHER = "Another device, not a haptix driver by its numbers."
_AUDIO = "Say what its full scale means on the screen: full_scale_v=."


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
        Whether `open_device` would try to drive it.
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


class DeviceWatch:
    """Tells when drivers are connected and disconnected, by looking now and then.

    It opens nothing, has a thread of its own, and touches nobody else's.

    Parameters
    ----------
    on_change : callable
        Called in that thread with the device, and whether it is there now.
    interval_s : float
        Between two looks, in seconds.
    look : callable
        Returns what is there; `list_devices` by default.

    Attributes
    ----------
    error : Exception or None
        What `on_change` raised last; the watch goes on.
    """

    def __init__(
        self,
        on_change: Callable[[DeviceInfo, bool], None],
        interval_s: float = 0.5,
        look: Callable[[], list[DeviceInfo]] = list_devices,
    ) -> None:
        self.error: Exception | None = None
        self._on_change = on_change
        self._interval_s = interval_s
        self._look = look
        self._known: dict[str, DeviceInfo] = {}
        self._end = threading.Event()
        self._thread: threading.Thread | None = None

    def start(self) -> None:
        """Begin to watch; what is there already is not told."""
        if self._thread is None:
            self._known = self._usable()
            self._end.clear()
            self._thread = threading.Thread(target=self._run, name="firmware_io watch", daemon=True)
            self._thread.start()

    def stop(self) -> None:
        """End watching. Idempotent."""
        self._end.set()
        if self._thread is not None and self._thread is not threading.current_thread():
            self._thread.join()
        self._thread = None

    def poll(self) -> list[tuple[DeviceInfo, bool]]:
        """Look once; tell and return the changes, those that went first."""
        now = self._usable()
        changes = [(device, False) for key, device in self._known.items() if key not in now]
        changes += [(device, True) for key, device in now.items() if key not in self._known]
        self._known = now
        for device, is_there in changes:
            try:
                self._on_change(device, is_there)
            # A fault in what somebody does about a device must not end the watch over all.
            except Exception as error:
                self.error = error
        return changes

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(self, *error: object) -> None:
        self.stop()

    def _usable(self) -> dict[str, DeviceInfo]:
        return {device.address: device for device in self._look() if device.usable}

    def _run(self) -> None:
        while not self._end.wait(self._interval_s):
            self.poll()


def _survey(kind: str, look: Callable[[], tuple[str, list[DeviceInfo]]], remedy: str) -> BusReport:
    try:
        detail, devices = look()
    # Whatever a third-party library raises here is a finding about this computer, not our error.
    except Exception as error:
        return BusReport(kind, False, f"{str(error) or type(error).__name__} ({remedy})", ())
    return BusReport(kind, True, detail, tuple(devices))


def _usb() -> tuple[str, list[DeviceInfo]]:
    core = import_module("usb.core")
    devices = []
    for device in core.find(find_all=True, backend=backend()):
        where = f"usb:bus={device.bus},address={device.address}"
        numbers = f"{device.idVendor:04x}:{device.idProduct:04x}"
        if (device.idVendor, device.idProduct) != (VENDOR_ID, PRODUCT_ID):
            # Product names would need the device to be opened; the numbers come by themselves.
            devices.append(DeviceInfo(where, "usb", numbers, False, _OTHER))
            continue
        serial = serial_of(device)
        note = f"Serial {serial}." if serial else "Its serial number cannot be read."
        devices.append(DeviceInfo(where, "usb", f"haptix driver {numbers}", True, note))
    return f"pyusb {import_module('usb').__version__}", devices


def _hid() -> tuple[str, list[DeviceInfo]]:
    # hidraw asks the kernel; libusb's side of hidapi opens every device for its strings.
    try:
        hid = import_module("hidraw")
    except ImportError:
        hid = import_module("hid")
    devices = []
    for found in hid.enumerate():
        numbers = f"{found['vendor_id']:04x}:{found['product_id']:04x}"
        where = f"hid:path={found['path'].decode(errors='replace')}"
        is_ours = (found["vendor_id"], found["product_id"]) == (VENDOR_ID, PRODUCT_ID)
        note = f"Serial {found.get('serial_number') or 'unknown'}." if is_ours else _OTHER
        name = found["product_string"] or numbers
        devices.append(DeviceInfo(where, "hid", name, is_ours, note))
    return f"hidapi {hid.version_str()}", devices


def _audio() -> tuple[str, list[DeviceInfo]]:
    sounddevice = import_module("sounddevice")
    devices = [
        DeviceInfo(f"audio:device={index}", "audio", found["name"], True, _AUDIO)
        for index, found in enumerate(sounddevice.query_devices())
        if found["max_output_channels"] > 0
    ]
    version = sounddevice.get_portaudio_version()[1]
    return f"sounddevice {sounddevice.__version__}, {version}", devices
