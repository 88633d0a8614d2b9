"""TCP: a mock driver in another process (`python -m firmware_io.serve`)."""

from __future__ import annotations

import select
import socket
from contextlib import suppress
from typing import Any

from firmware_io.errors import (
    DeviceBusyError,
    DeviceDisconnectedError,
    DeviceError,
    DeviceNotFoundError,
)
from firmware_io.link import Link
from firmware_io.scheme import Scheme

_CONNECT_S = 2.0
_SEND_S = 1.0
_READ_BYTES = 65536


class TcpLink(Link):
    """A connection to a served driver.

    Parameters
    ----------
    host : str
        Host name or IP address.
    port : int
        Port of the server.
    token : str
        The server's, if it has one; sent as the first line.

    Raises
    ------
    DeviceNotFoundError
        If no server listens there.
    """

    def __init__(self, host: str, port: int, token: str = "") -> None:
        self.name = f"tcp:{host}:{port}"
        self._has_received = False
        self._socket: socket.socket | None = None
        try:
            self._socket = socket.create_connection((host, port), _CONNECT_S)
        except (OSError, UnicodeError) as error:  # Unicode: no name of a host
            raise DeviceNotFoundError(
                f"No server listens at {self.name}: {error}; start one with "
                f"`python -m firmware_io.serve --port {port}`."
            ) from error
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._socket.settimeout(_SEND_S)
        if token:
            self.send(token.encode() + b"\n")

    def send(self, data: bytes) -> None:
        """Send bytes; see `Link.send`."""
        connection = self._connection()
        try:
            connection.sendall(data)
        except OSError as error:
            raise self._lost(str(error)) from error

    def receive(self, timeout_s: float = 0.0) -> bytes:
        """Return the bytes that have come; see `Link.receive`."""
        connection = self._connection()
        try:
            if not select.select([connection], [], [], timeout_s)[0]:
                return b""
            data = connection.recv(_READ_BYTES)
        except OSError as error:
            raise self._lost(str(error)) from error
        if not data:
            raise self._lost("the other side closed the connection")
        self._has_received = True
        return data

    def close(self) -> None:
        """Close the connection. Idempotent."""
        connection, self._socket = self._socket, None
        if connection is not None:
            with suppress(OSError):
                connection.close()

    def _connection(self) -> socket.socket:
        if self._socket is None:
            raise DeviceDisconnectedError(f"{self.name} is closed; open the device again.")
        return self._socket

    def _lost(self, why: str) -> DeviceError:
        if not self._has_received:
            # A server has one driver: it accepts a second host only to close the connection.
            return DeviceBusyError(
                f"{self.name} closed the connection at once ({why}), so it serves another host, "
                "which has to close first, or it wants its token (token=)."
            )
        return DeviceDisconnectedError(
            f"The connection to {self.name} is lost: {why}; open the device again."
        )


def _read_place(selector: str) -> tuple[dict[str, Any], str]:
    """Return host and port, and what follows them."""
    place, _, rest = selector.partition(",")
    host, colon, port = place.rpartition(":")
    if not colon or not host or not (port.isascii() and port.isdigit() and 0 < int(port) < 65536):
        raise DeviceError(
            f'tcp: takes a host and a port, as in "tcp:localhost:7420", but {place!r} came.'
        )
    return {"host": host, "port": int(port)}, rest


SCHEME = Scheme(TcpLink, {"token": str}, split=_read_place)
