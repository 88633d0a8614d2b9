"""USB by the kernel's own messages of USB/IP, over a socket pair whose other end vhci_hcd has."""

import errno
import socket
import struct
from collections import namedtuple
from contextlib import suppress
from pathlib import Path

_CONTROLLER = Path("/sys/devices/platform/vhci_hcd.0")
_SUBMIT, _UNLINK, _SUBMIT_REPLY, _UNLINK_REPLY = 1, 2, 3, 4
_HEADER_BYTES = 48
_HIGH_SPEED = 3

#: A transfer that the host asks for. `length` is what may come, of one towards the host.
Transfer = namedtuple("Transfer", "number endpoint is_inward length setup data")


class Cable:
    """From a free port of the virtual host controller to a device.

    Attributes
    ----------
    withdrawn : set of int
        Numbers of the transfers that the host has given up.
    """

    def __init__(self, port):
        ours, theirs = socket.socketpair()
        for end in (ours, theirs):
            end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 1 << 20)
        (_CONTROLLER / "attach").write_text(
            f"{port} {theirs.fileno()} {0x10000 + port + 1} {_HIGH_SPEED}"
        )
        theirs.close()
        self._socket = ours
        self._received = bytearray()
        self._waiting = set()

    def fileno(self):
        """For select."""
        return self._socket.fileno()

    def pull(self):
        """Take it out: the host loses whatever was on its way."""
        self._socket.close()

    def transfers(self):
        """Receive, and yield each transfer; a withdrawn one is answered here, and yielded as None.

        Raises
        ------
        EOFError
            If the host has closed the port.
        """
        data = self._socket.recv(1 << 18)
        if not data:
            raise EOFError
        self._received += data
        while (transfer := self._next()) is not None:
            yield transfer

    def answer(self, transfer, status=0, data=b"", taken=None):
        """End a transfer, unless the host has given it up."""
        if transfer.number in self._waiting:
            self._waiting.remove(transfer.number)
            length = len(data) if transfer.is_inward else taken
            if length is None:
                length = transfer.length if status == 0 else 0
            self._send(_SUBMIT_REPLY, transfer.number, -status, length, data)

    def is_waiting(self, transfer):
        """Whether the host still wants it."""
        return transfer.number in self._waiting

    def _next(self):
        while len(self._received) >= _HEADER_BYTES:
            kind, number, _, is_inward, endpoint = struct.unpack_from(">5I", self._received)
            if kind == _UNLINK:
                given_up = struct.unpack_from(">I", self._received, 20)[0]
                del self._received[:_HEADER_BYTES]
                was_waiting = given_up in self._waiting
                self._waiting.discard(given_up)
                self._send(_UNLINK_REPLY, number, -errno.ECONNRESET if was_waiting else 0)
                continue
            length = struct.unpack_from(">i", self._received, 24)[0]
            size = _HEADER_BYTES + (0 if is_inward else length)
            if len(self._received) < size:
                return None
            setup = bytes(self._received[40:48])
            data = bytes(self._received[_HEADER_BYTES:size])
            del self._received[:size]
            self._waiting.add(number)
            return Transfer(number, endpoint, bool(is_inward), length, setup, data)
        return None

    def _send(self, kind, number, status, length=0, data=b""):
        header = struct.pack(">5I5i8x", kind, number, 0, 0, 0, status, length, 0, 0, 0)
        # A host that has closed the port is told by transfers().
        with suppress(BrokenPipeError, ConnectionResetError):
            self._socket.sendall(header + data)
