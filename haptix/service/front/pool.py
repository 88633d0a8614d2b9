"""The service's processes as its front sees them, and the worker pool.

The front spawns the engine and the workers, and exchanges frames with them; they end when their
input ends. A worker (``haptix.service.worker``) works for one owner in its life: a session whose
files it decodes, the holder of a token who asks for pictures, a job, or the virtual finger. So a
file that takes over a decoder finds no data of another owner, and a file that blocks it delays its
sender alone.

    nobody's --a question--> an owner's --an answer--> idle --IDLE_S, or its slot is needed--> ended
                                 +--no answer in time--> ended

At rest the pool has one worker without an owner, so that a first picture does not wait for its
start. The engine has the surface; a worker loads torch for the contact's currents alone.
"""

from __future__ import annotations

import asyncio
import json
import logging
import sys
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from haptix.service.protocol.messages import Problem
from haptix.service.protocol.wire import BEAT, HEADER, JSON, MOST_BYTES, frame, json_frame

_LOG = logging.getLogger("haptix.service")

LONGEST_S = 20.0
"""A worker whose answer takes longer is ended: a picture that is a bomb, or a fault of ours."""
START_S = 120.0
"""For a worker to start: torch loads in 20 s where other programs use both cores."""
IDLE_S = 60.0
"""A worker that is idle for so long is ended, which frees its memory."""
MOST_WORKERS, MOST_WAITING = 3, 16
_LOADS = ("currents",)  # torch
NICE = 10
"""A picture or a job may wait."""
BEAT_S, MOST_SILENT, LONGEST_SILENCE_S = 0.1, 7, 2.0
"""Between two beats, which a process returns at once; so many without an answer mean that it hangs.
Beats are counted, not seconds, so that a front that was stopped itself takes no process for silent.
Workers of the pool have a low priority: after the second number their owner gets a warning; only
after the third they are ended."""


class Process:
    """A process that runs a module of the service, and the questions that wait for its answers.

    Parameters
    ----------
    name : str
        Its name in messages, and the name of its module in ``haptix.service``.
    nice : int
        Its niceness from the start; a worker takes it as its argument.
    """

    def __init__(self, name: str = "worker", nice: int = 0) -> None:
        self.name, self._nice = name, nice
        self._process: asyncio.subprocess.Process | None = None
        self._pending: dict[int, asyncio.Future[dict[str, Any]]] = {}
        self._next = 1
        self._reader: asyncio.Task[None] | None = None
        self._silent = 0  # beats without an answer
        self._most_silent = 0
        self._is_ended = False
        self.has_hung = False

    @property
    def pid(self) -> int | None:
        """Process number; None while none runs."""
        return self._process.pid if self._process is not None else None

    @property
    def has_gone(self) -> bool:
        """Whether no process is there."""
        return self._process is None or self._process.returncode is not None

    @property
    def has_ended(self) -> bool:
        """Whether it has run and ended."""
        return self._reader is not None and self._reader.done()

    async def launch(self) -> None:
        """Start the process."""
        self._silent, self.has_hung, self._is_ended = 0, False, False
        self.loads()
        self._process = await self._spawn()
        _LOG.info("%s: process %d begins", self.name, self._process.pid)
        self._reader = asyncio.create_task(self._read(self._process))
        self._beating = asyncio.create_task(self._beats(self._process))

    async def _spawn(self) -> asyncio.subprocess.Process:
        return await asyncio.create_subprocess_exec(
            sys.executable,
            "-m",
            f"haptix.service.{self.name}.process",
            *([str(self._nice)] if self._nice else []),
            stdin=asyncio.subprocess.PIPE,
            stdout=asyncio.subprocess.PIPE,
            limit=MOST_BYTES,
        )

    def loads(self) -> None:
        """Note that it may be importing torch: on a busy machine it then misses many beats."""
        self._most_silent = round(START_S / BEAT_S)

    def has_loaded(self, most_silent: int = MOST_SILENT) -> None:
        """Note that it has loaded everything: from now on it returns beats at once."""
        self._most_silent, self._silent = most_silent, 0

    async def stop(self) -> None:
        """End it: by the end of its input, or by force after three seconds."""
        process = self._process
        if process is None:
            return
        assert process.stdin is not None
        self._is_ended = True
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

        Raises `Problem` if it is refused, or the process is not there.
        """
        number = self._next
        self._next += 1
        answer: asyncio.Future[dict[str, Any]] = asyncio.get_running_loop().create_future()
        self._pending[number] = answer
        try:
            if not self.write(json_frame({"do": do, "n": number, **fields})):
                raise Problem("device", f"{do}: the {self.name} is being started again; try anew")
            return await answer
        finally:
            self._pending.pop(number, None)

    def tell(self, do: str, **fields: Any) -> None:
        """Send a message that has no answer."""
        self.write(json_frame({"do": do, **fields}))

    def write(self, data: bytes) -> bool:
        """Send a frame; return whether there is a process to take it."""
        process = self._process
        if process is None or process.stdin is None or self.has_gone:
            return False
        process.stdin.write(data)
        return True

    def on_message(self, message: dict[str, Any]) -> None:
        """Take a message that answers no question."""

    def on_frame(self, kind: int, data: bytes) -> None:
        """Take a frame that is no message."""

    def on_exit(self, code: int | None) -> None:
        """Note that the process has ended."""

    def on_silence(self, silent_s: float) -> None:
        """End a process that hangs; called at each beat."""
        _LOG.info("%s: killed, for it was silent for %.1f s", self.name, silent_s)
        self.has_hung = True
        self.kill()

    async def _beats(self, process: asyncio.subprocess.Process) -> None:
        while process.returncode is None and not self._is_ended:
            silent_s = self._silent * BEAT_S
            # One that is stopped loads nothing, however long loading may take.
            if self._silent >= self._most_silent or (
                silent_s >= LONGEST_SILENCE_S and _is_stopped(process.pid)
            ):
                self.on_silence(silent_s)
            self._silent += 1
            self.write(frame(BEAT, b""))
            await asyncio.sleep(BEAT_S)

    async def _read(self, process: asyncio.subprocess.Process) -> None:
        assert process.stdout is not None
        try:
            while True:
                length, kind = HEADER.unpack(await process.stdout.readexactly(HEADER.size))
                if length > MOST_BYTES:
                    raise ConnectionError  # a file has taken the worker over
                data = await process.stdout.readexactly(length)
                if kind == BEAT:
                    self._silent = 0
                elif kind == JSON:
                    self._take(json.loads(data))
                else:
                    self.on_frame(kind, data)
        except asyncio.IncompleteReadError:
            pass
        except Exception as error:
            _LOG.info("%s: killed, for it sent an invalid frame: %s", self.name, error)
            self.kill()
        await process.wait()
        _LOG.info("%s: process %d ended with code %s", self.name, process.pid, process.returncode)
        self._process = None
        for answer in self._pending.values():
            if not answer.done():
                how = "hung" if self.has_hung else f"ended with code {process.returncode}"
                sentence = f"the {self.name} {how}; try anew"
                answer.set_exception(Problem("device", sentence))
        self.on_exit(process.returncode)

    def _take(self, message: dict[str, Any]) -> None:
        number = message.pop("n", None)
        if number is None:
            self.on_message(message)
            return
        answer = self._pending.get(number)
        if answer is None or answer.done():
            return
        if "problem" in message:
            wrong = message["problem"]
            answer.set_exception(Problem(wrong["code"], wrong["sentence"], wrong.get("path", "")))
        else:
            answer.set_result(message)


def _is_stopped(pid: int) -> bool:
    """Whether a process is stopped by a signal or a debugger, where the system shows it (Linux)."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] in ("T", "t")
    except (OSError, IndexError):
        return False


class _Worker(Process):
    """A worker of the pool; its owner gets a warning when it is silent."""

    def __init__(self) -> None:
        super().__init__(nice=NICE)
        self.tell_owner: Callable[[str], None] = lambda sentence: None
        self.when_ended: Callable[[], None] = lambda: None

    def on_exit(self, code: int | None) -> None:
        """Tell the pool."""
        self.when_ended()

    def on_silence(self, silent_s: float) -> None:
        """Warn its owner once, and give it a little more time."""
        if silent_s >= LONGEST_SILENCE_S:
            super().on_silence(silent_s)
        elif silent_s < (MOST_SILENT + 0.5) * BEAT_S:
            self.tell_owner(f"a worker was silent for {silent_s:.1f} s; another one may answer")


@dataclass
class _Owned:
    """The worker of one owner, which answers one question after the other."""

    turn: asyncio.Lock = field(default_factory=asyncio.Lock)
    process: _Worker | None = None
    is_busy: bool = False
    rests: asyncio.TimerHandle | None = None

    @property
    def is_there(self) -> bool:
        """Whether it has a process, or starts one."""
        return self.is_busy or (self.process is not None and self.process.pid is not None)

    def end(self) -> None:
        """End the process."""
        process, self.process = self.process, None
        if process is not None:
            process.kill()


class Pool:
    """Workers that decode, draw, check and export: up to three at once, each for one owner.

    Parameters
    ----------
    opening : dict
        Assets, and, before anybody asks, finger and screen as the engine has them.
    longest_s : float
        Longest time for one answer, from when its turn comes and the worker has started.
    tell : callable
        Takes an owner, and a sentence for it.
    """

    def __init__(
        self,
        opening: dict[str, Any],
        longest_s: float = LONGEST_S,
        tell: Callable[[str, str], None] = lambda owner, sentence: None,
    ) -> None:
        self.opening, self._longest_s, self.tell = opening, longest_s, tell
        self.owned: dict[str, _Owned] = {}  # the one used last stands last
        self._room = asyncio.Semaphore(MOST_WORKERS)
        self.spare: asyncio.Task[_Worker] | None = None
        self.processes: set[_Worker] = set()
        self._waiting = 0
        self._keeps_spare = self._ends = False

    async def ask(self, owner: str, do: str, **fields: Any) -> dict[str, Any]:
        """Return the answer to a question of an owner.

        Raises `Problem` if it is refused, takes too long, or too many wait.
        """
        if self._waiting >= MOST_WAITING:
            raise Problem("limit", f"expected at most {MOST_WAITING} questions that wait")
        self._waiting += 1
        owned = self.owned[owner] = self.owned.pop(owner, _Owned())
        if owned.rests is not None:
            owned.rests.cancel()
        try:
            async with owned.turn, self._room:
                if self._ends:
                    raise Problem("device", f"{do}: the service ends")
                owned.is_busy = True
                try:
                    return await self._ask_now(owner, owned, do, fields)
                except Problem:
                    if owned.process is None or not owned.process.has_hung:
                        raise
                    return await self._ask_now(owner, owned, do, fields)  # another one, once
                finally:
                    owned.is_busy = False
        finally:
            self._waiting -= 1
            loop = asyncio.get_running_loop()
            owned.rests = loop.call_later(IDLE_S, self._release, owner, owned)
            if self._keeps_spare and not self._waiting:  # it would take time from who answers
                self.warm()

    def warm(self) -> None:
        """Keep a worker without an owner."""
        self._keeps_spare = True
        if self.spare is None and not self._ends:
            self.spare = asyncio.create_task(self._start_spare())

    def end(self) -> None:
        """End all workers at once; all questions that wait are refused."""
        self._ends = True
        for process in self.processes:
            process.kill()

    async def stop(self) -> None:
        """End all workers, and wait until they have."""
        self.end()
        if self.spare is not None:
            with suppress(Problem, TimeoutError):
                await self.spare
        await asyncio.gather(*(process.stop() for process in self.processes))

    async def _ask_now(
        self, owner: str, owned: _Owned, do: str, fields: dict[str, Any]
    ) -> dict[str, Any]:
        limit_s = START_S
        try:
            async with asyncio.timeout(limit_s):
                if owned.process is None or owned.process.pid is None:
                    self._make_room(owned)
                    owned.process = await self._take()
                process = owned.process
                process.tell_owner = partial(self.tell, owner)
            limit_s = self._longest_s
            if do in _LOADS:
                process.loads()
                limit_s = START_S
            async with asyncio.timeout(limit_s):
                answer = await process.ask(do, **fields)
            process.has_loaded()
            return answer
        except TimeoutError:
            owned.end()
            raise Problem("limit", f"{do}: took more than {limit_s:g} s") from None

    def _make_room(self, owned: _Owned) -> None:
        """End the worker that has been idle for longest, if the pool is full."""
        others = [
            worker for worker in self.owned.values() if worker is not owned and worker.is_there
        ]
        if len(others) >= MOST_WORKERS:  # one is idle, since this question got its turn
            next(worker for worker in others if not worker.is_busy).end()

    async def _take(self) -> _Worker:
        """Return a worker that has had no owner."""
        spare, self.spare = self.spare, None
        if spare is not None:
            with suppress(Problem, TimeoutError):
                process = await spare
                process.when_ended = lambda: None
                try:
                    # One that hangs may not have been noticed yet.
                    async with asyncio.timeout(LONGEST_SILENCE_S):
                        await process.ask("open", **self.opening)
                    return process
                except TimeoutError:
                    process.kill()
        return await self._start()

    async def _start_spare(self) -> _Worker:
        process = await self._start()
        process.when_ended = self._replace_spare
        return process

    def _replace_spare(self) -> None:
        self.spare = None
        self.warm()

    async def _start(self) -> _Worker:
        process = _Worker()
        self.processes = {process for process in self.processes if not process.has_ended} | {
            process
        }
        async with asyncio.timeout(START_S):
            await process.launch()
            if self._ends:
                process.kill()
            await process.ask("open", **self.opening)
        process.has_loaded()
        return process

    def _release(self, owner: str, owned: _Owned) -> None:
        if not owned.turn.locked():
            owned.end()
            self.owned.pop(owner, None)
