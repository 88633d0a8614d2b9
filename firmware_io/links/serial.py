"""A serial port, through pyserial: a board's USART, or CDC over USB."""

from __future__ import annotations

import errno
from contextlib import suppress
from importlib import import_module
from typing import Any

from firmware_io.device_errors import (
    DeviceBusyError,
    DeviceDisconnectedError,
    DeviceError,
    DeviceNotFoundError,
    DevicePermissionError,
    from_extra,
)
from firmware_io.link import OTHER_DEVICE, Bus, DeviceInfo, Link, Scheme, count, yes_or_no
from firmware_io.links.usb import PRODUCT_ID, VENDOR_ID

BAUD = 2_000_000
"""Bits a second, of which ten make a byte: samples of 16 bits at 48 kHz need 1.1 million."""

_WRITE_S = 1.0
_WAKES_S = 3.0  # a board whose reset is wired to DTR: boot loader, then a second at 0 V


def pyserial() -> Any:
    """Return the module `serial`.

    Raises `MissingExtraError` if it is not installed.
    """
    with from_extra("serial"):
        return import_module("serial")


def _ports() -> list[tuple[Any, bool]]:
    """Return pyserial's description of each port, and whether its USB numbers are haptix's."""
    pyserial()
    ports = import_module("serial.tools.list_ports").comports()
    return [(port, (port.vid, port.pid) == (VENDOR_ID, PRODUCT_ID)) for port in ports]


class SerialLink(Link):
    """A serial port that nobody else may open meanwhile.

    Raises `DeviceNotFoundError` or `DeviceBusyError` or `DevicePermissionError` if the port cannot
    be opened; `DeviceError` if pyserial is missing, or the port cannot have that speed.

    Parameters
    ----------
    port : str, optional
        Such as ``/dev/ttyUSB0`` or ``COM3``; without, the only port with haptix's USB numbers.
    baud : int
        Bits a second. CDC over USB ignores it.
    flow : bool
        Whether the board's RTS holds this side back.
    dtr, rts : bool, optional
        Level that this side's lines keep, for a board that they reset; by default both are raised,
        as the system does on opening.
    """

    wakes_s = _WAKES_S

    def __init__(
        self,
        port: str | None = None,
        baud: int = BAUD,
        flow: bool = False,
        dtr: bool | None = None,
        rts: bool | None = None,
    ) -> None:
        self._serial = pyserial()
        place = port or _only_port()
        self.name = f"serial:port={place}"
        self.bytes_per_s = baud / 10
        self._port: Any = None
        try:
            self._port = self._serial.Serial(
                None, baud, timeout=0, write_timeout=_WRITE_S, rtscts=flow, exclusive=True
            )
            for line, level in (("dtr", dtr), ("rts", rts)):
                if level is not None:
                    setattr(self._port, line, level)
            self._port.port = place
            self._port.open()
        except ValueError as error:
            raise DeviceError(f"{self.name} cannot have baud={baud}: {error}.") from error
        except OSError as error:
            raise _refusal(self.name, error) from error
        # Discard messages that an earlier host has left unread.
        self._port.reset_input_buffer()

    @property
    def descriptor(self) -> int | None:
        """The port, which pyserial opens so that it never waits; see `Link.descriptor`."""
        # Not on Windows, where a port is no file descriptor.
        return getattr(self._port, "fd", None)

    def send(self, data: bytes) -> None:
        """Write bytes; see `Link.send`."""
        port = self._open_port()
        try:
            written = port.write(data)
        except OSError as error:
            raise self._lost(error) from error
        if written != len(data):
            raise self._lost(f"it took {written} of {len(data)} bytes")

    def receive(self, timeout_s: float = 0.0) -> bytes:
        """Return what has come; see `Link.receive`."""
        port = self._open_port()
        try:
            port.timeout = timeout_s
            first = port.read(1)
            return bytes(first + port.read(port.in_waiting)) if first else b""
        # pyserial raises a TypeError if the port disappears during a call.
        except (OSError, TypeError) as error:
            raise self._lost(error) from error

    def close(self) -> None:
        """Close the port. Idempotent."""
        port, self._port = self._port, None
        if port is not None:
            with suppress(OSError):
                port.close()

    def _open_port(self) -> Any:
        if self._port is None:
            raise DeviceDisconnectedError(f"{self.name} is closed; open the device again.")
        return self._port

    def _lost(self, why: object) -> DeviceDisconnectedError:
        return DeviceDisconnectedError(
            f"{self.name} is lost: {why}; check its cable, then open the device again."
        )


def _only_port() -> str:
    ports = [port for port, is_driver in _ports() if is_driver]
    if len(ports) == 1:
        return str(ports[0].device)
    if not ports:
        raise DeviceNotFoundError(
            f"No serial port has the USB numbers {VENDOR_ID:04x}:{PRODUCT_ID:04x}; name one, as in "
            '"serial:port=/dev/ttyUSB0".'
        )
    names = ", ".join(f"port={port.device}" for port in ports)
    raise DeviceError(f"{len(ports)} serial ports may be a driver; choose one of {names}.")


def _refusal(name: str, error: OSError) -> DeviceError:
    """Return the error of this package for a port that cannot be opened."""
    if error.errno in (errno.EACCES, errno.EPERM):
        return DevicePermissionError(
            f"This user may not open {name}; on Debian: sudo adduser $USER dialout, then log in "
            "again."
        )
    # pyserial reports a port that is locked with EAGAIN or EWOULDBLOCK.
    if error.errno in (errno.EBUSY, errno.EAGAIN):
        return DeviceBusyError(
            f"{name} is in use, by another program or this one; close it there first."
        )
    return DeviceNotFoundError(f"{name} cannot be opened: {error}; look with `haptix devices`.")


def _search() -> tuple[str, list[DeviceInfo]]:
    devices = [
        DeviceInfo(
            f"serial:port={port.device}",
            "serial",
            str(port.description),
            is_driver,
            "A driver by its USB numbers." if is_driver else OTHER_DEVICE,
        )
        for port, is_driver in _ports()
        if port.vid is not None  # a built-in port does not identify the device on it
    ]
    return f"pyserial {pyserial().__version__}", devices


SCHEME = Scheme(
    SerialLink,
    {"port": str, "baud": count, "flow": yes_or_no, "dtr": yes_or_no, "rts": yes_or_no},
    bus=Bus(_search, 'pip install "haptix-electrovibration[serial]"'),
)
