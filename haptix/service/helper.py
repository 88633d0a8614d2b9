"""A process of the service as its front sees it, spoken to by frames."""

from __future__ import annotations

import asyncio
import json
import logging
import sys
from typing import Any

from haptix.service.messages import Problem
from haptix.service.wire import HEADER, JSON, MOST_BYTES, json_frame

_LOG = logging.getLogger("haptix.service")

_FULL_BYTES = 256 * 1024  # waiting for a process that does not read


class HelperProcess:
    """Starts a module of the service, asks it, and hears it.

    Parameters
    ----------
    module : str
        Name of the module in ``haptix.service``.
    name : str
        What people call it.
    full_s : float
        A process that does not read for so long, with much waiting, is killed.
    """

    def __init__(self, module: str, name: str, full_s: float) -> None:
        self.module, self.name, self._full_s = module, name, full_s
        self._process: asyncio.subprocess.Process | None = None
        self._asked: dict[int, asyncio.Future[dict[str, Any]]] = {}
        self._next = 1
        self._full_since: float | None = None
        self._reader: asyncio.Task[None] | None = None

    @property
    def pid(self) -> int | None:
        """Process number; None while none runs."""
        return self._process.pid if self._process is not None else None

    async def launch(self) -> None:
        """Start the process."""
        self._full_since = None
        self._process = await asyncio.create_subprocess_exec(
            sys.executable,
            "-m",
            f"haptix.service.{self.module}",
            stdin=asyncio.subprocess.PIPE,
            stdout=asyncio.subprocess.PIPE,
            limit=MOST_BYTES,
        )
        _LOG.info("%s: process %d begins", self.name, self._process.pid)
        self._reader = asyncio.create_task(self._read(self._process))

    async def stop(self) -> None:
        """End it: by the end of its input, or by force after three seconds."""
        process = self._process
        if process is None:
            return
        assert process.stdin is not None
        process.stdin.close()
        try:
            await asyncio.wait_for(process.wait(), 3.0)
        except TimeoutError:
            _LOG.info("%s: killed, for it does not end", self.name)
            process.kill()
            await process.wait()
        if self._reader is not None:
            await self._reader

    def kill(self) -> None:
        """End it at once."""
        if self._process is not None and self._process.returncode is None:
            self._process.kill()

    async def ask(self, do: str, **fields: Any) -> dict[str, Any]:
        """Return the answer to a question.

        Raises
        ------
        Problem
            If it is refused, or the process is not there.
        """
        number = self._next
        self._next += 1
        answer: asyncio.Future[dict[str, Any]] = asyncio.get_running_loop().create_future()
        self._asked[number] = answer
        try:
            if not self.write(json_frame({"do": do, "n": number, **fields})):
                raise Problem("device", f"{do}: the {self.name} is being started again; try anew")
            return await answer
        finally:
            self._asked.pop(number, None)

    def tell(self, do: str, **fields: Any) -> None:
        """Say something that has no answer."""
        self.write(json_frame({"do": do, **fields}))

    def write(self, data: bytes) -> bool:
        """Send a frame; return whether there is a process to take it."""
        process = self._process
        if process is None or process.stdin is None or process.returncode is not None:
            return False
        process.stdin.write(data)
        now_s = asyncio.get_running_loop().time()
        if process.stdin.transport.get_write_buffer_size() < _FULL_BYTES:
            self._full_since = None
        elif self._full_since is None:
            self._full_since = now_s
        elif now_s - self._full_since > self._full_s:
            _LOG.info("%s: killed, for it reads nothing", self.name)
            process.kill()
        return True

    def heard(self, message: dict[str, Any]) -> None:
        """Take what the process says unasked."""

    def heard_frame(self, kind: int, data: bytes) -> None:
        """Take a frame that is no message."""

    def ended(self, code: int | None) -> None:
        """Take note that the process has ended."""

    async def _read(self, process: asyncio.subprocess.Process) -> None:
        assert process.stdout is not None
        try:
            while True:
                length, kind = HEADER.unpack(await process.stdout.readexactly(HEADER.size))
                data = await process.stdout.readexactly(length)
                if kind == JSON:
                    self._take(json.loads(data))
                else:
                    self.heard_frame(kind, data)
        except (asyncio.IncompleteReadError, ConnectionError):
            pass
        await process.wait()
        _LOG.info("%s: process %d ended with code %s", self.name, process.pid, process.returncode)
        self._process = None
        for answer in self._asked.values():
            if not answer.done():
                sentence = f"the {self.name} ended; it is started again, try anew"
                answer.set_exception(Problem("device", sentence))
        self.ended(process.returncode)

    def _take(self, message: dict[str, Any]) -> None:
        number = message.pop("n", None)
        if number is None:
            self.heard(message)
            return
        answer = self._asked.get(number)
        if answer is None or answer.done():
            return
        if "problem" in message:
            wrong = message["problem"]
            answer.set_exception(Problem(wrong["code"], wrong["sentence"], wrong.get("path", "")))
        else:
            answer.set_result(message)
