"""One user per device: claims that hold across processes and end with whoever made them."""

from __future__ import annotations

import errno
import socket
import sys

from firmware_io.errors import DeviceBusyError


class Claim:
    """The right to a device, until `release` or the end of this process.

    hidraw and TCP would let two hosts in. A socket in Linux's abstract namespace is a name that
    one process can hold, with no file left behind if it is killed.

    Parameters
    ----------
    what : str
        The device, such as its path; the same for everyone who means the same device.

    Raises
    ------
    DeviceBusyError
        If somebody holds it.
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
                f"{what} is in use, by another program or another device object of this one; "
                "close it there first."
            ) from None
        self._socket = holder

    def release(self) -> None:
        """Give the device free. Idempotent."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None
