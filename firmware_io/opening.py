"""Open a device by its address; search the buses for connected devices."""

from __future__ import annotations

import threading
import time
import weakref
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, Self

from firmware_io.device import Device
from firmware_io.device_errors import DeviceBusyError, DeviceError
from firmware_io.link import (
    SETTING_KEYS,
    DeviceInfo,
    Scheme,
    read_selector,
    scheme,
    scheme_names,
    split_address,
)

_OPENED: weakref.WeakSet[Device] = weakref.WeakSet()


def open_device(address: str) -> Device:
    """Open the device at an address; it stays open until its `close`, also after a with statement.

    Parameters
    ----------
    address : str
        A scheme, a colon, and comma-separated key=value pairs; `haptix devices` lists all that are
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
    try:
        device = Device(link.open(**values), **settings)
        try:
            device.set_up(**later)
        except BaseException:
            device.close()
            raise
    except DeviceBusyError as error:
        for own in _OPENED:
            if not own.is_closed and own.name in str(error):
                raise DeviceBusyError(
                    f"{error} This program has it open: a with statement ends the output and "
                    "keeps the device; call its close()."
                ) from error
        raise
    _OPENED.add(device)
    return device


def read_address(address: str) -> tuple[Scheme, dict[str, Any]]:
    """Return the scheme of an address and the values of its keys; nothing is opened.

    Raises `DeviceError` if the address cannot be read.
    """
    name, selector = split_address(address, scheme_names())
    link = scheme(name)
    values, pairs = link.split(selector)
    return link, values | read_selector(name, pairs, {**link.keys, **SETTING_KEYS})


@dataclass(frozen=True)
class BusReport:
    """The result of searching one bus.

    Parameters
    ----------
    devices : tuple of DeviceInfo
        The devices that were found.
    """

    kind: str
    """Such as "usb"."""
    available: bool
    detail: str
    """The library and its version, or why it cannot be used and what to install."""
    devices: tuple[DeviceInfo, ...]


def list_devices(most_age_s: float = 0.0) -> list[DeviceInfo]:
    """Return the mock and all devices on the buses, without opening any.

    Parameters
    ----------
    most_age_s : float
        Age up to which an earlier search of a slow bus (audio) counts, in seconds.

    Examples
    --------
    >>> "mock:" in [device.address for device in list_devices()]
    True
    """
    mock = DeviceInfo("mock:", "mock", "mock driver", True, "Plays into memory; always there.")
    return [mock, *(device for report in survey_buses(most_age_s) for device in report.devices)]


def survey_buses(most_age_s: float = 0.0) -> list[BusReport]:
    """Search every bus, without opening a device; see `list_devices`.

    There is one report for each bus. A library that is missing or fails is reported, never raised.
    """
    reports = []
    for kind in scheme_names():
        try:
            bus = scheme(kind).bus
        except DeviceError as error:
            reports.append(BusReport(kind, False, str(error), ()))
            continue
        if bus is None:
            continue
        if bus.is_slow and kind in _KEPT and time.monotonic() - _KEPT[kind][0] < most_age_s:
            reports.append(_KEPT[kind][1])
            continue
        try:
            detail, devices = bus.search()
            reports.append(BusReport(kind, True, detail, tuple(devices)))
        # An error of a third-party library is part of the report, and no error of haptix.
        except Exception as error:
            # The error of a missing extra has the command already, and the remedy repeats it.
            why = str(error).partition("; run: pip")[0] or type(error).__name__
            detail = f"{why} ({bus.remedy})"
            reports.append(BusReport(kind, False, detail, ()))
        _KEPT[kind] = (time.monotonic(), reports[-1])
    return reports


_KEPT: dict[str, tuple[float, BusReport]] = {}
"""The last search of each bus, and its time."""
_WATCHED = partial(list_devices, 5.0)  # as a watch searches: a slow bus every five seconds


class DeviceWatch:
    """Calls back when drivers are connected and disconnected.

    It searches the buses at an interval, in its own thread, and opens no device.

    Parameters
    ----------
    on_change : callable
        Called in that thread with the device, and whether it is connected now.
    interval_s : float
        Time between two searches, in seconds; at least five for audio.
    look : callable
        Returns the devices; `list_devices` by default.

    Attributes
    ----------
    error : Exception or None
        The last exception of `on_change`; the watch continues.
    """

    def __init__(
        self,
        on_change: Callable[[DeviceInfo, bool], None],
        interval_s: float = 0.5,
        look: Callable[[], list[DeviceInfo]] = _WATCHED,
    ) -> None:
        self.error: Exception | None = None
        self._on_change = on_change
        self._interval_s = interval_s
        self._look = look
        self._known: dict[str, DeviceInfo] = {}
        self._end = threading.Event()
        self._thread: threading.Thread | None = None

    def start(self) -> None:
        """Begin to watch; devices that are already connected cause no call."""
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
        """Search once; report and return the changes, disconnected devices first."""
        now = self._usable()
        changes = [(device, False) for key, device in self._known.items() if key not in now]
        changes += [(device, True) for key, device in now.items() if key not in self._known]
        self._known = now
        for device, is_there in changes:
            try:
                self._on_change(device, is_there)
            # An error of `on_change` for one device must not end the watch over the others.
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
