"""The engine as the service's front sees it: a process, spoken to by frames."""

from __future__ import annotations

import asyncio
import json
import sys
from collections.abc import Callable
from typing import Any

from haptix.service.batches import STREAMS
from haptix.service.messages import Problem, Stream
from haptix.service.wire import (
    HEADER,
    JSON,
    MOST_BYTES,
    TELEMETRY,
    TouchRecord,
    json_frame,
    touch_frame,
)

_FULL_BYTES = 256 * 1024  # waiting for an engine that does not read
_FULL_S = 0.05


class EngineProcess:
    """Starts the engine, and again when it has died; disarmed each time.

    Parameters
    ----------
    opening : dict
        First message to the engine: device, surface, finger, screen.
    hear : callable
        Takes the engine's events.
    hear_frame : callable
        Takes its telemetry: name of the stream, and the frame.
    """

    def __init__(
        self,
        opening: dict[str, Any],
        hear: Callable[[dict[str, Any]], None],
        hear_frame: Callable[[Stream, bytes], None],
    ) -> None:
        self._opening, self._hear, self._hear_frame = opening, hear, hear_frame
        self._process: asyncio.subprocess.Process | None = None
        self._asked: dict[int, asyncio.Future[dict[str, Any]]] = {}
        self._next = 1
        self._full_since: float | None = None
        self._ends = False
        self._reader: asyncio.Task[None] | None = None

    @property
    def pid(self) -> int | None:
        """Process number of the engine; None while none runs."""
        return self._process.pid if self._process is not None else None

    async def start(self) -> dict[str, Any]:
        """Start the engine; return what it has opened."""
        self._process = await asyncio.create_subprocess_exec(
            sys.executable,
            "-m",
            "haptix.service.engine",
            stdin=asyncio.subprocess.PIPE,
            stdout=asyncio.subprocess.PIPE,
            limit=MOST_BYTES,
        )
        self._reader = asyncio.create_task(self._read(self._process))
        return await self.ask("open", **self._opening)

    async def stop(self) -> None:
        """End at 0 V."""
        self._ends = True
        process = self._process
        if process is None:
            return
        assert process.stdin is not None
        process.stdin.close()  # the end of its input: it stops the device and exits
        try:
            await asyncio.wait_for(process.wait(), 3.0)
        except TimeoutError:
            process.kill()
            await process.wait()
        if self._reader is not None:
            await self._reader

    async def ask(self, do: str, **fields: Any) -> dict[str, Any]:
        """Return the engine's answer.

        Raises
        ------
        Problem
            If it refuses, or is not there.
        """
        number = self._next
        self._next += 1
        answer: asyncio.Future[dict[str, Any]] = asyncio.get_running_loop().create_future()
        self._asked[number] = answer
        try:
            if not self._write(json_frame({"do": do, "n": number, **fields})):
                raise Problem("device", f"{do}: the engine is being started again; try anew")
            return await answer
        finally:
            self._asked.pop(number, None)

    def tell(self, do: str, **fields: Any) -> None:
        """Say something that has no answer."""
        self._write(json_frame({"do": do, **fields}))

    def touch(self, reports: list[TouchRecord]) -> None:
        """Pass touches on."""
        self._write(touch_frame(reports))

    def _write(self, data: bytes) -> bool:
        process = self._process
        if process is None or process.stdin is None or process.returncode is not None:
            return False
        process.stdin.write(data)
        now_s = asyncio.get_running_loop().time()
        if process.stdin.transport.get_write_buffer_size() < _FULL_BYTES:
            self._full_since = None
        elif self._full_since is None:
            self._full_since = now_s
        elif now_s - self._full_since > _FULL_S:
            process.kill()  # it hangs; the driver's watchdog ends at 0 V
        return True

    async def _read(self, process: asyncio.subprocess.Process) -> None:
        assert process.stdout is not None
        try:
            while True:
                length, kind = HEADER.unpack(await process.stdout.readexactly(HEADER.size))
                data = await process.stdout.readexactly(length)
                if kind == JSON:
                    self._take(json.loads(data))
                elif kind == TELEMETRY:
                    self._hear_frame(STREAMS[data[1] - 1], data)
        except (asyncio.IncompleteReadError, ConnectionError):
            pass
        await process.wait()
        self._process = None
        for answer in self._asked.values():
            if not answer.done():
                answer.set_exception(Problem("device", "the engine ended; it is started again"))
        if not self._ends:
            reason = f"the engine ended with code {process.returncode}; it is started again"
            self._hear({"event": "output", "state": "failed", "reason": reason})
            await asyncio.sleep(1.0)
            self._restart = asyncio.create_task(self._start_again())

    async def _start_again(self) -> None:
        try:
            await self.start()
        except Problem as problem:
            self._hear({"event": "output", "state": "failed", "reason": problem.sentence})
        else:
            self._hear({"event": "output", "state": "off", "reason": "the engine is there again"})

    def _take(self, message: dict[str, Any]) -> None:
        number = message.pop("n", None)
        if number is None:
            self._hear(message)
            return
        answer = self._asked.get(number)
        if answer is None or answer.done():
            return
        if "problem" in message:
            wrong = message["problem"]
            answer.set_exception(Problem(wrong["code"], wrong["sentence"], wrong.get("path", "")))
        else:
            answer.set_result(message)
