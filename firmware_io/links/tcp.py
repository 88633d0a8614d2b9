"""TCP: a mock driver in another process (`python -m firmware_io.serve`).

Before the first frame the server sends a challenge, a line with a random number, and the host
answers with a line: the HMAC-SHA256 of the challenge under the server's token (empty without one).
A web page can make a browser send any bytes to a port of this machine, but it cannot read the
challenge; and a token never crosses the wire.
"""

from __future__ import annotations

import hmac
import os
import secrets
import select
import socket
from contextlib import suppress
from pathlib import Path
from typing import Any

from firmware_io.device_errors import (
    DeviceBusyError,
    DeviceDisconnectedError,
    DeviceError,
    DeviceNotFoundError,
)
from firmware_io.link import Link, Scheme

_CONNECT_S = 2.0
_SEND_S = 1.0
_READ_BYTES = 65536
TOKEN_VARIABLE = "HAPTIX_DRIVER_TOKEN"
_GREETING = b"haptix driver 1 "
_GREETING_BYTES = len(_GREETING) + 32 + 1
ANSWER_BYTES = 64 + 1


def challenge() -> bytes:
    """Return a new challenge."""
    return _GREETING + secrets.token_hex(16).encode() + b"\n"


def answer_to(challenge: bytes, token: str) -> bytes:
    """Return the answer of a host that knows the token."""
    return hmac.digest(token.encode(), challenge, "sha256").hex().encode() + b"\n"


def read_token(file: str | Path | None) -> str:
    """Return the token that a file holds, or ``$HAPTIX_DRIVER_TOKEN``; empty without either.

    A token in a command or an address would be visible to all in the list of processes.
    """
    if file is None:
        return os.environ.get(TOKEN_VARIABLE, "")
    try:
        return Path(file).expanduser().read_text(encoding="utf-8").strip()
    except (OSError, ValueError) as error:
        raise DeviceError(f"cannot read the token's file {file}: {error}") from None


class TcpLink(Link):
    """A connection to a served driver.

    Raises `DeviceNotFoundError` if no server listens there; `DeviceError` if it is no server of a
    driver, or the file cannot be read.

    Parameters
    ----------
    host : str
        Host name or IP address.
    port : int
        Port of the server.
    token_file : path-like, optional
        Holds the server's token, if it has one; by default that is ``$HAPTIX_DRIVER_TOKEN``.
    """

    def __init__(self, host: str, port: int, token_file: str | Path | None = None) -> None:
        self.name = f"tcp:{host}:{port}"
        self._has_received = False
        token = read_token(token_file)
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
        try:
            self.send(answer_to(self._challenge(), token))
        except DeviceError:
            self.close()
            raise

    @property
    def descriptor(self) -> int | None:
        """The socket, which never waits since it has a time-out; see `Link.descriptor`."""
        return None if self._socket is None else self._socket.fileno()

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

    def _challenge(self) -> bytes:
        """Wait for the server's first line."""
        came = b""
        while len(came) < _GREETING_BYTES and (piece := self.receive(_CONNECT_S)):
            came += piece
        if len(came) != _GREETING_BYTES or not came.startswith(_GREETING):
            raise DeviceError(
                f"{self.name} does not begin as a served driver does: another program listens "
                "there, or an older haptix; start `python -m firmware_io.serve` of this version."
            )
        self._has_received = False  # of the driver itself
        return came

    def _connection(self) -> socket.socket:
        if self._socket is None:
            raise DeviceDisconnectedError(f"{self.name} is closed; open the device again.")
        return self._socket

    def _lost(self, why: str) -> DeviceError:
        if not self._has_received:
            # A server has one driver: it accepts a second host only to close the connection.
            return DeviceBusyError(
                f"{self.name} closed the connection at once ({why}), so it serves another host, "
                "which has to close first, or it wants its token (token_file=, or "
                f"{TOKEN_VARIABLE})."
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


SCHEME = Scheme(TcpLink, {"token_file": str}, split=_read_place)
