"""A hosted link in a process of its own, so that its library can end or hang no other program.

PortAudio knows the interfaces of the moment when it was initialised. Where JACK's server has ended
since, it waits ten minutes for the end of a stream, and aborts the process when it is terminated
(`findings/portaudio_after_jack.sh`). A new process for each opening has neither problem. When the
program dies, however it does, this process ramps the output to 0 V.
"""

from __future__ import annotations

import gc
import json
import os
import queue
import signal
import struct
import subprocess
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from firmware_io import device_errors
from firmware_io.clock import raise_priority
from firmware_io.device_errors import DeviceDisconnectedError, DeviceError
from firmware_io.link import Link
from firmware_io.links.hosted import HostedLink

_HEAD = struct.Struct("<BI")  # kind and bytes of a message of the process
_BYTES, _OPENED, _FAILED = range(3)
_START_S = 60.0  # on a machine that is busy
_END_S = 3.0  # a ramp, and the queue of the output
_HANG_S = 1.5  # a ramp, and the end of its library
_TURN_S = 0.002  # between two looks for reports of the firmware
_SWITCH_S = 5e-4


class OwnProcessLink(Link):
    """The program's end of a link whose firmware and output are in another process.

    Raises `DeviceError` as the link raises it there.

    Parameters
    ----------
    module : str
        Has a function `serve`, which calls `serve_link`.
    values : dict
        What opens the link there, as JSON.
    """

    def __init__(self, module: str, values: dict[str, Any]) -> None:
        self.name = module
        self._latency_s: float | None = None
        self._came: queue.SimpleQueue[bytes] = queue.SimpleQueue()
        self._failure: DeviceError | None = None
        self._is_known = threading.Event()
        self._is_open = True
        self._process = _start(module, "serve", stdin=subprocess.PIPE)
        self._reader = threading.Thread(target=self._read, name="firmware_io link", daemon=True)
        self._reader.start()
        try:
            self._write(json.dumps(values).encode() + b"\n")
            if not self._is_known.wait(_START_S):
                raise DeviceError(f"{module} did not start within {_START_S:g} s; try again.")
            self._check()
        except BaseException:
            self.close()
            raise

    @property
    def latency_s(self) -> float | None:
        """Latency that the output stated when it was opened, in seconds; None if unknown."""
        return self._latency_s

    def send(self, data: bytes) -> None:
        """Hand bytes to the firmware; see `Link.send`."""
        self._check()
        try:
            self._write(data)
        except OSError as error:
            self._reader.join(_END_S)  # it has the reason
            self._check()
            raise DeviceDisconnectedError(f"{self.name} is gone: {error}.") from error

    def receive(self, timeout_s: float = 0.0) -> bytes:
        """Return the firmware's answers; see `Link.receive`."""
        try:
            data = self._came.get(timeout_s > 0, timeout_s)
            while not self._came.empty():
                data += self._came.get()
        except queue.Empty:
            data = b""
        if not data:
            self._check()
        return data

    def close(self) -> None:
        """Let the process ramp to 0 V and end. Idempotent."""
        if not self._is_open:
            return
        self._is_open = False
        pipe = self._process.stdin
        assert pipe is not None
        with suppress(OSError):
            pipe.close()
        try:
            self._process.wait(_END_S + (self._latency_s or 0.0))
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._reader.join()

    def _write(self, data: bytes) -> None:
        pipe = self._process.stdin
        assert pipe is not None
        while data:
            data = data[pipe.write(data) :]

    def _check(self) -> None:
        if (failure := self._failure) is not None:
            # A new one each time: the frames of each raise would keep the device for ever.
            raise type(failure)(*failure.args)
        if not self._is_open:
            raise DeviceDisconnectedError(f"{self.name} is closed; open the device again.")

    def _read(self) -> None:
        """Take the messages of the process, until it ends; a thread's body."""
        pipe = self._process.stdout
        assert pipe is not None
        with pipe:
            while head := _exactly(pipe, _HEAD.size):
                kind, size = _HEAD.unpack(head)
                data = _exactly(pipe, size)
                if kind == _BYTES:
                    self._came.put(data)
                    continue
                about = json.loads(data)
                if kind == _OPENED:
                    self.name, self._latency_s = about["name"], about["latency_s"]
                else:
                    known = getattr(device_errors, about["kind"], DeviceError)
                    self._failure = self._failure or known(about["text"])
                self._is_known.set()
        self._failure = self._failure or DeviceDisconnectedError(
            f"{self.name} is gone: its process has ended; open the device again."
        )
        self._is_known.set()
        self._came.put(b"")  # wakes who waits


def ask_in_own_process(module: str, function: str) -> Any:
    """Return the JSON that a function of a module writes to its standard output.

    Raises `DeviceError` if its process fails.
    """
    with _start(module, function, stdin=subprocess.DEVNULL) as process:
        try:
            text, _ = process.communicate(timeout=_START_S)
        except subprocess.TimeoutExpired:
            process.kill()
            raise DeviceError(f"{module} did not answer within {_START_S:g} s.") from None
    try:
        return json.loads(text)
    except ValueError:
        raise DeviceError(f"{module} ended with code {process.returncode}.") from None


def _start(module: str, function: str, stdin: int) -> subprocess.Popen[bytes]:
    # ALSA and JACK write to the standard error what they tried and did not find. Without -P, a file
    # of the working folder could take a module's place.
    return subprocess.Popen(
        [sys.executable, "-P", "-c", f"from {module} import {function}; {function}()"],
        bufsize=0,
        stdin=stdin,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
    )


def _exactly(pipe: Any, size: int) -> bytes:
    """Return so many bytes; none at the end."""
    data = b""
    while len(data) < size:
        piece = pipe.read(size - len(data))
        if not piece:
            return b""
        data += piece
    return data


def serve_link(open_link: Callable[..., HostedLink]) -> None:
    """Open a link with the values that come, and carry its bytes until the program's end closes.

    Parameters
    ----------
    open_link : callable
        Takes the values by name.
    """
    for number in (signal.SIGINT, signal.SIGTERM):  # the program ends first, and then this one
        signal.signal(number, signal.SIG_IGN)
    output, writing, ended = os.fdopen(os.dup(1), "wb"), threading.Lock(), threading.Event()
    os.dup2(2, 1)  # a library's prints are no message

    def say(kind: int, data: bytes) -> None:
        with suppress(OSError), writing:  # nobody may be there any more
            output.write(_HEAD.pack(kind, len(data)) + data)
            output.flush()

    def pass_on(link: HostedLink) -> None:
        if answers := link.receive():
            say(_BYTES, answers)

    def hear(link: HostedLink) -> None:
        raise_priority()
        try:
            while data := os.read(0, 2**16):
                link.send(data)
                pass_on(link)
        except Exception as error:
            failures.append(error)
        ended.set()

    first = b""
    while not first.endswith(b"\n"):
        if not (byte := os.read(0, 1)):
            return
        first += byte
    link: HostedLink | None = None
    failures: list[Exception] = []
    try:
        link = open_link(**json.loads(first))
        about = {"name": link.name, "latency_s": link.latency_s}
        gc.freeze()
        gc.disable()  # nothing here makes cycles
        sys.setswitchinterval(_SWITCH_S)
        say(_OPENED, json.dumps(about).encode())
        threading.Thread(target=hear, args=(link,), daemon=True).start()
        raise_priority()
        while not ended.wait(_TURN_S):
            pass_on(link)
    except Exception as error:
        failures.append(error)
    if failures:
        about = {"kind": type(failures[0]).__name__, "text": str(failures[0])}
        say(_FAILED, json.dumps(about).encode())
    # In order, since JACK waits for a client that has just died; but PortAudio may hang here.
    latency_s = (link and link.latency_s) or 0.0
    timer = threading.Timer(_HANG_S + latency_s, os._exit, (1,))
    timer.daemon = True
    timer.start()
    if link is not None:
        link.close()
