"""USB bulk, through pyusb and libusb; the USB numbers of a driver, and the udev rule for them."""

from __future__ import annotations

import ctypes
import errno
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import Any, NoReturn

from firmware_io.device_errors import (
    DeviceBusyError,
    DeviceDisconnectedError,
    DeviceError,
    DeviceNotFoundError,
    DevicePermissionError,
    ProtocolError,
)
from firmware_io.link import OTHER_DEVICE, Bulk, Bus, DeviceInfo, Link, Scheme, count, hexadecimal

#: pid.codes' numbers for testing; a board that is sold needs its own.
VENDOR_ID = 0x1209
PRODUCT_ID = 0x0001

#: Sorts before 73-seat-late.rules, which acts on the tag.
RULE_FILE = Path("etc/udev/rules.d/70-haptix.rules")

_RULE = """\
# haptix: the user who sits at this computer may open the touchscreen's driver.
SUBSYSTEM=="usb", ATTR{{idVendor}}=="{vid:04x}", ATTR{{idProduct}}=="{pid:04x}", TAG+="uaccess"
SUBSYSTEM=="hidraw", ATTRS{{idVendor}}=="{vid:04x}", ATTRS{{idProduct}}=="{pid:04x}", TAG+="uaccess"
"""

_VENDOR_CLASS = 0xFF
_BULK = 2
_IN = 0x80
_READ_BYTES = 16384
#: A queue of one second drains in one second; a device that accepts no bytes for longer is lost.
_WRITE_MS = 1000
_GONE = (errno.ENODEV, errno.EIO, errno.ENOENT, errno.ESHUTDOWN)


def udev_rule(vendor_id: int = VENDOR_ID, product_id: int = PRODUCT_ID) -> str:
    """Return the text of the rule for these USB numbers."""
    return _RULE.format(vid=vendor_id, pid=product_id)


def udev_rule_is_installed(root: Path = Path("/")) -> bool:
    """Return whether the rule file below `root` exists and has the right text."""
    try:
        path = root / RULE_FILE
        return path.is_file() and path.read_text() == udev_rule()
    except OSError:
        return False


def permission_remedy() -> str:
    """Return what to do if the operating system does not let this user open a device."""
    return (
        f"install the udev rule /{RULE_FILE} with `sudo haptix doctor --install-udev`, "
        "then replug the device"
    )


def backend() -> Any:
    """Return pyusb's backend: the system's libusb, or that of the package libusb-package.

    The backend is always passed on explicitly: pyusb keeps the one that a process found first.
    Raises `DeviceError` if neither is installed.
    """
    libusb1 = import_module("usb.backend.libusb1")
    libusb = libusb1.get_backend()
    if libusb is None:
        with suppress(ImportError):
            package = import_module("libusb_package")
            libusb = libusb1.get_backend(find_library=package.find_library)
    if libusb is None:
        raise DeviceError(
            "pyusb found no libusb; on Debian: apt install libusb-1.0-0, elsewhere: "
            "pip install libusb-package."
        )
    return libusb


def find_drivers(vendor_id: int = VENDOR_ID, product_id: int = PRODUCT_ID) -> list[Any]:
    """Return pyusb's object of each connected device with these numbers, without opening it."""
    core = import_module("usb.core")
    devices = core.find(find_all=True, idVendor=vendor_id, idProduct=product_id, backend=backend())
    return list(devices)


def serial_of(device: Any) -> str | None:
    """Return the serial number of a device; None if this user may not read it."""
    try:
        return str(device.serial_number or "")
    except (OSError, ValueError, NotImplementedError):
        return None


class UsbLink(Link):
    """A pair of bulk endpoints.

    Raises `DeviceNotFoundError` or `DeviceBusyError` or `DevicePermissionError` or `ProtocolError`
    if it cannot be opened.

    Parameters
    ----------
    serial : str, optional
        Serial number; needed if several drivers are connected.
    bus, address : int, optional
        Place on the bus.
    vendor_id, product_id : int
        USB numbers of the driver.
    """

    wakes_s = 1.0  # just plugged in, a board may still hold its output at 0 V

    def __init__(
        self,
        serial: str | None = None,
        bus: int | None = None,
        address: int | None = None,
        vendor_id: int = VENDOR_ID,
        product_id: int = PRODUCT_ID,
    ) -> None:
        self._core = import_module("usb.core")
        self._util = import_module("usb.util")
        wanted = f"{vendor_id:04x}:{product_id:04x}"
        devices = [
            device
            for device in find_drivers(vendor_id, product_id)
            if bus in (None, device.bus) and address in (None, device.address)
        ]
        if serial is not None:
            wanted += f" with serial {serial}"
            unreadable = [device for device in devices if serial_of(device) is None]
            devices = [device for device in devices if serial_of(device) == serial]
            if unreadable and not devices:
                raise DevicePermissionError(
                    f"The USB device {wanted} may be connected, but this user may not read serial "
                    f"numbers; {permission_remedy()}."
                )
        if not devices:
            raise DeviceNotFoundError(
                f"No USB device {wanted} is connected there; `haptix devices` lists those that are."
            )
        if len(devices) > 1:
            where = ", ".join(f"bus={d.bus},address={d.address}" for d in devices)
            raise DeviceError(
                f"{len(devices)} USB devices {wanted} are connected, at {where}; "
                "choose one by serial= or bus=,address=."
            )
        self._device: Any = devices[0]
        self.name = f"usb:bus={self._device.bus},address={self._device.address}"
        try:
            self._interface, self._out, self._in = self._find_endpoints()
            self._take_interface()
        except BaseException:
            self.close()
            raise

    @property
    def bulk(self) -> Bulk | None:
        """The endpoints; see `Link.bulk`."""
        # pyusb 1.3 has no public name for its handle, and other libraries than libusb 1.0.
        try:
            context = self._device._ctx
            transfer = context.backend.lib.libusb_bulk_transfer
            handle = context.handle.handle.value
        except AttributeError:
            return None
        address = ctypes.cast(transfer, ctypes.c_void_p).value
        return Bulk(address, handle, self._out, self._in) if address and handle else None

    def send(self, data: bytes) -> None:
        """Write bytes in one transfer; see `Link.send`."""
        device = self._open_device()
        try:
            written = device.write(self._out, data, _WRITE_MS)
        except self._core.USBError as error:
            self._raise(error, self._out)
        if written != len(data):
            raise DeviceDisconnectedError(
                f"{self.name} took {written} of {len(data)} bytes; stop it, or open it again."
            )

    def receive(self, timeout_s: float = 0.0) -> bytes:
        """Read one transfer; see `Link.receive`. libusb waits at least 1 ms for an empty one."""
        device = self._open_device()
        try:
            return bytes(device.read(self._in, _READ_BYTES, max(1, round(timeout_s * 1e3))))
        except self._core.USBTimeoutError:
            return b""
        except self._core.USBError as error:
            self._raise(error, self._in)

    def close(self) -> None:
        """Release the interface, to the kernel if the kernel had it before. Idempotent."""
        device, self._device = self._device, None
        if device is not None:
            with suppress(OSError):
                self._util.dispose_resources(device)

    def _open_device(self) -> Any:
        if self._device is None:
            raise DeviceDisconnectedError(f"{self.name} is closed; open the device again.")
        return self._device

    def _find_endpoints(self) -> tuple[int, int, int]:
        """Return the vendor interface with two bulk endpoints, and their addresses."""
        try:
            configuration = self._device.get_active_configuration()
        except self._core.USBError as error:
            self._raise(error)
        for interface in configuration:
            if interface.bInterfaceClass != _VENDOR_CLASS:
                continue
            bulk = [e.bEndpointAddress for e in interface if e.bmAttributes & 3 == _BULK]
            outward = [address for address in bulk if not address & _IN]
            inward = [address for address in bulk if address & _IN]
            if outward and inward:
                return interface.bInterfaceNumber, outward[0], inward[0]
        raise ProtocolError(
            f"{self.name} has no vendor interface with bulk endpoints both ways; it is another "
            "device with the same numbers, or speaks HID only: try hid:."
        )

    def _take_interface(self) -> None:
        try:
            with suppress(NotImplementedError):
                if self._device.is_kernel_driver_active(self._interface):
                    self._device.detach_kernel_driver(self._interface)
            self._util.claim_interface(self._device, self._interface)
            # Discard messages that an earlier host has left unread.
            for _ in range(64):
                if len(self._device.read(self._in, _READ_BYTES, 1)) == 0:
                    break
        except self._core.USBTimeoutError:
            return
        except self._core.USBError as error:
            self._raise(error)

    def _raise(self, error: OSError, endpoint: int | None = None) -> NoReturn:
        """Raise the error of this package that an error of libusb means."""
        if error.errno in (errno.EACCES, errno.EPERM):
            raise DevicePermissionError(
                f"This user may not open {self.name}; {permission_remedy()}."
            ) from error
        if error.errno == errno.EBUSY:
            raise DeviceBusyError(
                f"{self.name} is in use, by another program or this one; close it there first."
            ) from error
        if error.errno == errno.EPIPE and endpoint is not None:
            with suppress(OSError):
                self._device.clear_halt(endpoint)
            raise ProtocolError(
                f"{self.name} stalled its endpoint {endpoint:#04x}, so it refused a transfer; "
                "arm it again."
            ) from error
        if error.errno in _GONE:
            raise DeviceDisconnectedError(
                f"{self.name} is gone: {error}; plug it in and open it again."
            ) from error
        raise DeviceDisconnectedError(
            f"{self.name} failed: {error}; stop it, or open it again."
        ) from error


def _search() -> tuple[str, list[DeviceInfo]]:
    core = import_module("usb.core")
    devices = []
    for device in core.find(find_all=True, backend=backend()):
        where = f"usb:bus={device.bus},address={device.address}"
        numbers = f"{device.idVendor:04x}:{device.idProduct:04x}"
        if (device.idVendor, device.idProduct) != (VENDOR_ID, PRODUCT_ID):
            # The product's name could be read only by opening the device; its numbers can be read.
            devices.append(DeviceInfo(where, "usb", numbers, False, OTHER_DEVICE))
            continue
        serial = serial_of(device)
        note = f"Serial {serial}." if serial else "Its serial number cannot be read."
        devices.append(DeviceInfo(where, "usb", f"haptix driver {numbers}", True, note))
    return f"pyusb {import_module('usb').__version__}", devices


SCHEME = Scheme(
    UsbLink,
    {
        "serial": str,
        "bus": count,
        "address": count,
        "vendor_id": hexadecimal,
        "product_id": hexadecimal,
    },
    bus=Bus(_search, "pip install pyusb; on Debian: apt install libusb-1.0-0"),
)
