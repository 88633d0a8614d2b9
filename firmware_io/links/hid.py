"""HID reports through hidapi, which uses the kernel's hidraw or libusb."""

from __future__ import annotations

import errno
import os
import socket
import sys
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import Any

from firmware_io.device_errors import (
    DeviceBusyError,
    DeviceDisconnectedError,
    DeviceError,
    DeviceNotFoundError,
    DevicePermissionError,
    ProtocolError,
)
from firmware_io.link import OTHER_DEVICE, Bus, DeviceInfo, Link, Scheme, hexadecimal, one_of
from firmware_io.links.usb import PRODUCT_ID, VENDOR_ID, permission_remedy
from firmware_io.protocol import REPORT_BYTES, from_report, to_reports


class Claim:
    """The exclusive right to use a device, until `release` or the end of this process.

    hidraw would let two hosts open a device. A socket name in Linux's abstract namespace belongs to
    one process and leaves no file behind if that process is killed. Raises `DeviceBusyError` if
    another process, or another object of this one, holds it.

    Parameters
    ----------
    what : str
        The device, such as its path; the same text for every user of one device.
    """

    def __init__(self, what: str) -> None:
        self._socket: socket.socket | None = None
        if sys.platform != "linux":
            return
        name = f"\0firmware_io/{what}"[:100]
        holder = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            holder.bind(name)
        except OSError as error:
            holder.close()
            if error.errno != errno.EADDRINUSE:
                raise
            raise DeviceBusyError(
                f"{what} is in use, by another program or this one; close it there first."
            ) from None
        self._socket = holder

    def release(self) -> None:
        """Release the device. Idempotent."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None


#: hidapi's two modules. hidraw first: libusb takes the device from the kernel.
BACKENDS = ("hidraw", "hid")
#: Reports in one read: twice the kernel's queue, since a device may send without end.
_MOST_REPORTS = 128


def enumerate_drivers(
    backend: str, vendor_id: int = VENDOR_ID, product_id: int = PRODUCT_ID
) -> list[dict[str, Any]]:
    """Return hidapi's record of each connected device with these numbers."""
    return list(import_module(backend).enumerate(vendor_id, product_id))


class HidLink(Link):
    """Reports of fixed size.

    Raises `DeviceNotFoundError` or `DeviceBusyError` or `DevicePermissionError` if it cannot be
    opened.

    Parameters
    ----------
    path : str, optional
        Path in hidapi's form: below /dev for hidraw, bus and port for libusb.
    serial : str, optional
        Serial number.
    backend : {"hidraw", "hid"}, optional
        Module of hidapi; by default the one that fits the path, or the first to find the device.
    vendor_id, product_id : int
        USB numbers of the driver; ignored with a path.
    """

    report_bytes = REPORT_BYTES
    wakes_s = 1.0  # just plugged in, a board may still hold its output at 0 V

    def __init__(
        self,
        path: str | None = None,
        serial: str | None = None,
        backend: str | None = None,
        vendor_id: int = VENDOR_ID,
        product_id: int = PRODUCT_ID,
    ) -> None:
        if backend not in (None, *BACKENDS):
            raise DeviceError(f"The backend is hidraw or hid, but is {backend!r}; correct it.")
        if path is not None:
            module = backend or ("hidraw" if path.startswith("/dev/") else "hid")
            place = path.encode()
        else:
            backends = BACKENDS if backend is None else (backend,)
            module, place = _find(backends, serial, vendor_id, product_id)
        self.name = f"hid:path={place.decode(errors='replace')}"
        self._node = Path(os.fsdecode(place)) if module == "hidraw" else None
        self._claim = Claim(self.name)
        self._handle: Any = None
        try:
            self._handle = import_module(module).device()
            self._open(place, module)
        except BaseException:
            self.close()
            raise

    @property
    def reports_node(self) -> Path | None:
        """Linux's node, where hidapi uses it; see `Link.reports_node`."""
        is_there = self._handle is not None and sys.platform == "linux"
        return self._node if is_there else None

    def send(self, data: bytes) -> None:
        """Write one frame, report by report; see `Link.send`."""
        handle = self._open_handle()
        for report in to_reports(data, REPORT_BYTES):
            try:
                written = handle.write(report)
            except (OSError, ValueError) as error:
                raise self._gone(error) from error
            # hidraw reports a lost device by a short write, without an exception.
            if written < len(report):
                raise self._gone(f"it took {written} of {len(report)} bytes")

    def receive(self, timeout_s: float = 0.0) -> bytes:
        """Read all reports that have come; see `Link.receive`.

        The kernel keeps only the latest 63 reports, and hidapi with libusb only 32.
        """
        handle = self._open_handle()
        pieces: list[bytes] = []
        timeout_ms = round(timeout_s * 1e3)
        for _ in range(_MOST_REPORTS):
            try:
                report = handle.read(REPORT_BYTES, timeout_ms)
            except (OSError, ValueError) as error:
                raise self._gone(error) from error
            if not report:
                break
            with suppress(ProtocolError):  # the parser reports the frame that lacks these bytes
                pieces.append(from_report(bytes(report))[0])
            timeout_ms = 0
        return b"".join(pieces)

    def close(self) -> None:
        """Close the device. Idempotent."""
        handle, self._handle = self._handle, None
        if handle is not None:
            with suppress(OSError, ValueError):
                handle.close()
        self._claim.release()

    def _open(self, path: bytes, backend: str) -> None:
        try:
            self._handle.open_path(path)
            # Otherwise a read without a timeout waits for ever.
            self._handle.set_nonblocking(True)
            for _ in range(_MOST_REPORTS):
                if not self._handle.read(REPORT_BYTES):  # left unread by an earlier host
                    break
        except OSError as error:
            node = Path(os.fsdecode(path))
            if backend == "hidraw" and not node.exists():
                raise DeviceNotFoundError(
                    f"There is no {node}; `haptix devices` lists all connected ones."
                ) from error
            if backend == "hid" and path not in [
                f["path"] for f in import_module(backend).enumerate()
            ]:
                raise DeviceNotFoundError(
                    f"No HID device is at {node}; `haptix devices` lists all connected ones."
                ) from error
            if backend == "hid":
                node = _usb_node(path)
            if node.exists() and not os.access(node, os.R_OK | os.W_OK):
                raise DevicePermissionError(
                    f"This user may not open {self.name}; {permission_remedy()}."
                ) from error
            raise DeviceBusyError(
                f"{self.name} could not be opened, though this user may: {error}; close it in "
                "other programs first."
            ) from error

    def _open_handle(self) -> Any:
        if self._handle is None:
            raise DeviceDisconnectedError(f"{self.name} is closed; open the device again.")
        return self._handle

    def _gone(self, why: object) -> DeviceDisconnectedError:
        return DeviceDisconnectedError(f"{self.name} is gone: {why}; plug it in and open it again.")


def _usb_node(path: bytes) -> Path:
    """Return the file that libusb opens for a path of hidapi such as 1-2:1.0."""
    port = Path("/sys/bus/usb/devices") / os.fsdecode(path).partition(":")[0]
    try:
        bus, device = (int((port / name).read_text()) for name in ("busnum", "devnum"))
    except (OSError, ValueError):
        return Path(os.fsdecode(path))
    return Path(f"/dev/bus/usb/{bus:03d}/{device:03d}")


def _find(
    backends: tuple[str, ...], serial: str | None, vendor_id: int, product_id: int
) -> tuple[str, bytes]:
    wanted = f"{vendor_id:04x}:{product_id:04x}" + (f" with serial {serial}" if serial else "")
    for backend in backends:
        places = {
            bytes(entry["path"])
            for entry in enumerate_drivers(backend, vendor_id, product_id)
            if serial is None or entry["serial_number"] == serial
        }
        if len(places) > 1:
            paths = ", ".join(sorted(path.decode(errors="replace") for path in places))
            raise DeviceError(
                f"{len(places)} HID devices {wanted} are connected, at {paths}; choose one by "
                "path= or serial=."
            )
        if places:
            return backend, places.pop()
    raise DeviceNotFoundError(
        f"No HID device {wanted} is connected; `haptix devices` lists those that are."
    )


def _search() -> tuple[str, list[DeviceInfo]]:
    # hidraw asks the kernel; with libusb hidapi opens every device to read its strings.
    try:
        hid = import_module("hidraw")
    except ImportError:
        hid = import_module("hid")
    devices = []
    for entry in hid.enumerate():
        numbers = f"{entry['vendor_id']:04x}:{entry['product_id']:04x}"
        where = f"hid:path={entry['path'].decode(errors='replace')}"
        is_ours = (entry["vendor_id"], entry["product_id"]) == (VENDOR_ID, PRODUCT_ID)
        note = f"Serial {entry.get('serial_number') or 'unknown'}." if is_ours else OTHER_DEVICE
        name = entry["product_string"] or numbers
        devices.append(DeviceInfo(where, "hid", name, is_ours, note))
    return f"hidapi {hid.version_str()}", devices


SCHEME = Scheme(
    HidLink,
    {
        "path": str,
        "serial": str,
        "backend": one_of(*BACKENDS),
        "vendor_id": hexadecimal,
        "product_id": hexadecimal,
    },
    bus=Bus(_search, "pip install hidapi, not the package called hid, which hides it"),
)
