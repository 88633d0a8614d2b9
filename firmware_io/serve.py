"""``python -m firmware_io.serve``: a mock driver in real time, for hosts in other processes."""

from __future__ import annotations

import argparse
import gc
import hmac
import ipaddress
import math
import select
import signal
import socket
import sys
import threading
import time
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple, Self

import numpy as np

from firmware_io.clock import raise_priority
from firmware_io.device_errors import DeviceError, HaptixError
from firmware_io.links.mock import MockDriver
from firmware_io.links.tcp import ANSWER_BYTES, TOKEN_VARIABLE, answer_to, challenge, read_token

DEFAULT_PORT = 7420
_TURN_S = 0.002  # between two polls of the driver
_READ_BYTES = 65536
_SEND_S = 1.0
#: Reads between two looks for other hosts that want to connect.
_MOST_TURNS = 64
#: Time to answer the challenge [s], and how many hosts may be about to answer it.
_ANSWER_S, _MOST_NEWCOMERS = 2.0, 16


class _Newcomer(NamedTuple):
    """A host that has not answered the challenge yet."""

    challenge: bytes
    until_s: float
    said: bytearray


class DriverServer:
    """Serves one mock driver to one host at a time, over TCP.

    The connection of a second host is closed at once. However a host disconnects, the driver ramps
    to 0 V. Raises `DeviceError` if other machines could reach it, and there is no token; `OSError`
    if it cannot listen on that port.

    Parameters
    ----------
    driver : MockDriver
        The driver, at real pace.
    host : str
        Address to listen on.
    port : int
        Port; 0 for any free one.
    token : str
        Secret by which a host answers the challenge; without one, every host of this machine may.
    """

    def __init__(
        self, driver: MockDriver, host: str = "127.0.0.1", port: int = 0, token: str = ""
    ) -> None:
        if not token and not _is_this_machine(host):
            raise DeviceError(
                f"Other machines reach {host}, so hosts must show that they may drive the screen: "
                f"give a --token-file or {TOKEN_VARIABLE}, or listen on 127.0.0.1."
            )
        self.driver = driver
        self._token = token
        self._newcomers: dict[socket.socket, _Newcomer] = {}
        self._listener = socket.create_server((host, port))
        self._end = threading.Event()
        self._thread = threading.Thread(target=self.serve, name="firmware_io server", daemon=True)

    @property
    def port(self) -> int:
        """The port that it listens on."""
        return int(self._listener.getsockname()[1])

    @property
    def address(self) -> str:
        """The address for `open_device`."""
        return f"tcp:{self._listener.getsockname()[0]}:{self.port}"

    def serve(self) -> None:
        """Serve until `stop`."""
        raise_priority()  # on a board, interrupts do not wait for a busy computer
        client: socket.socket | None = None
        try:
            while not self._end.is_set():
                wanted = [self._listener, *self._newcomers, *([] if client is None else [client])]
                readable = select.select(wanted, [], [], _TURN_S)[0]
                # The old host first: it may have left, and may be the newcomer.
                for _ in range(_MOST_TURNS):
                    if client is None:
                        break
                    has_sent = bool(select.select([client], [], [], 0.0)[0])
                    if not self._exchange(client, has_sent):
                        client.close()
                        client = None
                        self.driver.release()
                    elif not has_sent:
                        break
                if client is None:
                    client = self._answered(readable)
                if self._listener in readable:
                    self._meet(self._listener.accept()[0])
                if client is not None:
                    self._show_out(self._newcomers)
        finally:
            self._show_out(self._newcomers)
            if client is not None:
                client.close()
            self.driver.release()
            self._listener.close()

    def stop(self) -> None:
        """End serving. Idempotent."""
        self._end.set()
        if self._thread.is_alive():
            self._thread.join()

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def _meet(self, newcomer: socket.socket) -> None:
        """Send a challenge; if too many hosts wait, disconnect the oldest."""
        newcomer.settimeout(_SEND_S)
        newcomer.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._newcomers[newcomer] = _Newcomer(
            challenge(), time.monotonic() + _ANSWER_S, bytearray()
        )
        self._show_out([*self._newcomers][:-_MOST_NEWCOMERS])
        with suppress(OSError):
            newcomer.send(self._newcomers[newcomer].challenge)

    def _answered(self, readable: Iterable[socket.socket]) -> socket.socket | None:
        """Return the first host that has answered its challenge."""
        late = [
            newcomer for newcomer, its in self._newcomers.items() if its.until_s < time.monotonic()
        ]
        self._show_out(late)
        for host in [host for host in self._newcomers if host in readable]:
            expected, _, said = self._newcomers[host]
            piece = b""
            with suppress(OSError):
                piece = host.recv(ANSWER_BYTES - len(said))
            said += piece
            if len(said) == ANSWER_BYTES and hmac.compare_digest(
                bytes(said), answer_to(expected, self._token)
            ):
                del self._newcomers[host]
                return host
            if not piece or len(said) == ANSWER_BYTES:
                self._show_out([host])
        return None

    def _show_out(self, hosts: Iterable[socket.socket]) -> None:
        for host in [*hosts]:
            del self._newcomers[host]
            host.close()

    def _exchange(self, client: socket.socket, has_sent: bool) -> bool:
        """Carry bytes both ways; return whether the host is still connected."""
        try:
            if has_sent:
                data = client.recv(_READ_BYTES)
                if not data:
                    return False
                self.driver.receive(data)
            answer = self.driver.transmit()
            if answer:
                client.sendall(answer)
        except OSError:
            return False
        return True


def _is_this_machine(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def main(arguments: list[str] | None = None) -> int:
    """Run the command; return its exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m firmware_io.serve",
        description="Serve a mock driver that plays in real time to hosts in other processes.",
    )
    parser.add_argument("--host", default="127.0.0.1", help="where to listen")
    parser.add_argument("--port", type=int, default=DEFAULT_PORT, help="0 for any free one")
    parser.add_argument(
        "--token-file",
        help=f"holds what hosts must know: tcp:HOST:PORT,token_file=..., or {TOKEN_VARIABLE} here "
        "and there; needed with a --host that other machines reach",
    )
    parser.add_argument("--sample-rate-hz", type=float, default=48e3)
    parser.add_argument("--full-scale-v", type=float, default=250.0)
    parser.add_argument("--ceiling-v", type=float, default=200.0)
    parser.add_argument("--serial", default="MOCK0001")
    parser.add_argument(
        "--record", type=Path, help="write the output to this .npy file (volts) at the end"
    )
    options = parser.parse_args(arguments)
    record = options.record
    if record is not None and record.exists() and not record.is_file():
        sys.stderr.write(f"--record: {record} is no regular file; name another\n")
        return 1
    try:
        driver = MockDriver(
            sample_rate_hz=options.sample_rate_hz,
            full_scale_v=options.full_scale_v,
            ceiling_v=options.ceiling_v,
            serial=options.serial,
            pace="real",
            # It may run for days, and no host can ask for its record.
            kept_s=1.0 if record is None else math.inf,
        )
        token = read_token(options.token_file)
        server = DriverServer(driver, options.host, options.port, token)
    except (HaptixError, OSError, OverflowError) as error:
        sys.stderr.write(f"{error}\n")
        return 1
    # SIGHUP: its terminal was closed.
    for ending in (signal.SIGTERM, getattr(signal, "SIGHUP", signal.SIGTERM)):
        signal.signal(ending, lambda *_: server.stop())
    sys.stdout.write(f"{server.address}\n")
    sys.stdout.flush()
    gc.freeze()  # a full collection of all imports takes milliseconds
    with suppress(KeyboardInterrupt):
        server.serve()
    if record is not None:
        try:
            with record.open("wb") as file:  # given a path, numpy would add an ending
                np.save(file, driver.output_v)
        except OSError as error:
            sys.stderr.write(f"cannot write {record}: {error.strerror or error}\n")
            return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
