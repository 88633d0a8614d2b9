"""One user per device: a claim holds across processes and ends with its process."""

from __future__ import annotations

import errno
import socket
import sys

from firmware_io.errors import DeviceBusyError


class Claim:
    """The exclusive right to use a device, until `release` or the end of this process.

    hidraw would let two hosts open a device. A socket name in Linux's abstract namespace belongs
    to one process and leaves no file behind if that process is killed.

    Parameters
    ----------
    what : str
        The device, such as its path; the same text for every user of one device.

    Raises
    ------
    DeviceBusyError
        If another process, or another object of this one, holds it.
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
        """Release the device. Idempotent."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None
