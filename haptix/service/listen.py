"""Where the service listens: on this machine, or for others by TLS."""

from __future__ import annotations

import socket
import ssl
from pathlib import Path
from typing import NamedTuple

from haptix.errors import DeviceError, InputError


class Listen(NamedTuple):
    """Where other machines reach the service, always by TLS.

    Parameters
    ----------
    host : str
        Name or address of this machine that clients use.
    certificate, key : Path
        Certificate of that name and its key, in PEM.
    """

    host: str
    certificate: Path
    key: Path


def listens(host: str, port: int) -> socket.socket:
    """Return a socket whose connections send at once.

    Raises
    ------
    DeviceError
        If the port is taken.
    """
    try:
        listener = socket.create_server((host, port))
    except OSError as error:
        raise DeviceError(
            f"cannot listen on {host}, port {port}: {error.strerror or error}; give a name of this "
            "machine and a --port that no other service has"
        ) from None
    # asyncio does so only for sockets that it made itself. Otherwise a ping or an event waits until
    # the client's system acknowledges the one before, 40 ms later (Nagle's algorithm, RFC 896).
    listener.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return listener


def check_certificate(listen: Listen) -> None:
    """Raise `InputError` if TLS cannot use the certificate."""
    try:
        ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER).load_cert_chain(listen.certificate, listen.key)
    except OSError as error:  # an SSLError is one
        raise InputError(
            f"expected a certificate and its key in PEM, got {listen.certificate} and "
            f"{listen.key}: {error}"
        ) from None
