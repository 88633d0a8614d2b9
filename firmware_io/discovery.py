"""Connected devices: drivers that can be opened, and others on the same buses."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Self

from firmware_io.errors import DeviceError
from firmware_io.scheme import DeviceInfo, scheme, scheme_names


@dataclass(frozen=True)
class BusReport:
    """The result of searching one bus."""

    kind: str
    """Such as "usb"."""
    available: bool
    detail: str
    """The library and its version, or why it cannot be used and what to install."""
    devices: tuple[DeviceInfo, ...]


def list_devices() -> list[DeviceInfo]:
    """Return the mock and all devices on the buses, without opening any."""
    mock = DeviceInfo("mock:", "mock", "mock driver", True, "Plays into memory; always there.")
    return [mock, *(device for report in survey_buses() for device in report.devices)]


def survey_buses() -> list[BusReport]:
    """Search every bus, without opening a device.

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
        try:
            detail, devices = bus.search()
            reports.append(BusReport(kind, True, detail, tuple(devices)))
        # Whatever a third-party library raises is a finding about this computer, not our error.
        except Exception as error:
            # A missing extra names the command itself, which the remedy says as well.
            why = str(error).partition("; run: pip")[0] or type(error).__name__
            detail = f"{why} ({bus.remedy})"
            reports.append(BusReport(kind, False, detail, ()))
    return reports


class DeviceWatch:
    """Calls back when drivers are connected and disconnected.

    It searches the buses at an interval, in its own thread, and opens no device.

    Parameters
    ----------
    on_change : callable
        Called in that thread with the device, and whether it is connected now.
    interval_s : float
        Time between two searches, in seconds.
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
        """Begin to watch; devices that are connected already cause no call."""
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
            # An error in the reaction to one device must not end the watch over the others.
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
