"""Jobs: work that takes long or asks a person, each in a worker of its own that can be killed.

queued ---> running <---> asking        a person answers each prompt
   |           |             |
   +-----------+-------------+---> cancelled, failed;  from running: done
"""

from __future__ import annotations

import asyncio
import logging
import secrets
import shutil
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

from haptix.base.task import all_tasks
from haptix.service.front.control import Engine
from haptix.service.front.pool import NICE, Process
from haptix.service.protocol.limiter import service_folder
from haptix.service.protocol.messages import JobMessage, Problem, StrokeTrace

_LOG = logging.getLogger("haptix.service")

MOST_QUEUED = 8
_MOST_ENDED = 50  # jobs that have ended
_LONGEST_SILENCE_S = 3.0
_SHARE = 0.01  # of a job: smaller steps are not reported
_ENDED = ("done", "failed", "cancelled")


@cache
def plays(kind: str) -> bool:
    """Whether a kind of job plays: the engine gives it the device meanwhile."""
    return any(task.plays and task.kind == kind for task in all_tasks())


class Job(Process):
    """One job, and the worker that does it.

    Parameters
    ----------
    owner : str
        Who began it; nobody else hears of it.
    message : JobMessage
        Its state, for its owner.
    fields : dict
        Parameters of the task.
    tell : callable
        Takes each change.
    """

    def __init__(
        self,
        owner: str,
        message: JobMessage,
        fields: dict[str, Any],
        tell: Callable[[JobMessage], None],
    ) -> None:
        super().__init__(nice=NICE)
        self.owner, self.message, self._fields, self._tell = owner, message, fields, tell

    @property
    def is_over(self) -> bool:
        """Whether it is done, failed or cancelled."""
        return self.message.state in _ENDED

    async def run(self) -> None:
        """Do it until it ends, by whichever way."""
        if self.is_over:
            return
        await self.launch()
        try:
            if not self.is_over:  # it may be cancelled meanwhile
                self.change(state="running")
                answer = await self.ask("job", kind=self.message.kind, **self._fields)
                if not self.is_over:
                    self.change(state="done", share=1.0, result=answer["result"], sentence="")
        except Problem as problem:
            if not self.is_over:
                self.change(state="failed", sentence=problem.sentence)
        finally:
            await self.stop()

    def cancel(self) -> None:
        """End it."""
        if not self.is_over:
            self.change(state="cancelled", prompt="", choices=())
            self.kill()

    def answer(self, text: str) -> None:
        """Answer its question.

        Raises `Problem` if it asks nothing, or this is no answer to it.
        """
        if self.message.state != "asking":
            raise Problem("order", "expected a job that asks")
        if self.message.choices and text not in self.message.choices:
            raise Problem("document", f"expected one of {', '.join(self.message.choices)}", "/text")
        self.change(state="running", prompt="", choices=())
        self.tell("answer", text=text)

    def change(self, **fields: Any) -> None:
        """Apply a change and report it."""
        if fields.get("state", self.message.state) != self.message.state:  # and no prompt or answer
            _LOG.info("job %s: %s, %s", self.message.job, self.message.kind, fields["state"])
        self.message = self.message.model_copy(update=fields)
        self._tell(self.message)

    def on_silence(self, silent_s: float) -> None:
        """Report it to its owner at once, and wait a little: a participant may be answering."""
        if self.is_over or silent_s > _LONGEST_SILENCE_S:
            super().on_silence(silent_s)
        elif not self.message.sentence:
            self.change(sentence=f"silent for {silent_s:.1f} s; ended if it stays so")

    def on_message(self, message: dict[str, Any]) -> None:
        """Take progress or a prompt."""
        if self.is_over:
            return
        self.has_loaded()  # a worker that answers has loaded
        if self.message.sentence:  # that it was silent
            self.change(sentence="")
        if "share" in message:
            if message["share"] - self.message.share >= _SHARE:
                self.change(share=message["share"])
        elif "step" in message:
            self.change(step=message["step"])
        elif "trace" in message:
            trace = StrokeTrace.model_validate(message["trace"], strict=False)
            self._tell(self.message.model_copy(update={"trace": trace}))
        else:
            choices = tuple(message["choices"])
            self.change(state="asking", prompt=message["prompt"], choices=choices)


class JobBoard:
    """All jobs: one runs, up to eight wait, the last fifty are remembered.

    A job belongs to who began it: its prompts and its result may be a participant's data.

    Parameters
    ----------
    engine : Engine
        Lends its device to jobs that play.
    tell : callable
        Takes each change of a job.
    lend : callable
        Ends at 0 V before a kind of job plays; called with "" when the job has ended.
    """

    def __init__(
        self, engine: Engine, tell: Callable[[JobMessage], None], lend: Callable[[str], None]
    ) -> None:
        self._engine, self._tell, self._lend = engine, tell, lend
        self.context: dict[str, Any] = {}
        """What all jobs know: assets, device, finger, screen."""
        self.results = service_folder() / "results"
        """Of jobs, a folder each."""
        self.jobs: dict[str, Job] = {}
        self._queue: deque[Job] = deque()
        self._runner: asyncio.Task[None] | None = None

    def begin(self, kind: str, owner: str, **fields: Any) -> JobMessage:
        """Queue a job.

        Raises `Problem` if too many wait.
        """
        if len(self._queue) >= MOST_QUEUED:
            raise Problem("limit", f"expected at most {MOST_QUEUED} jobs that wait; cancel one")
        message = JobMessage(job=secrets.token_hex(8), kind=kind, state="queued")
        context = {**self.context, "results": str(self._folder_of(message.job))}
        job = Job(owner, message, {**fields, "context": context}, self._tell)
        for old in [job for job in self.jobs.values() if job.is_over][
            : len(self.jobs) - _MOST_ENDED
        ]:
            del self.jobs[old.message.job]
            shutil.rmtree(self._folder_of(old.message.job), ignore_errors=True)
        self.jobs[message.job] = job
        self._queue.append(job)
        if self._runner is None or self._runner.done():
            self._runner = asyncio.create_task(self._runs())
        return message

    def get(self, name: str, owner: str) -> Job:
        """Return an owner's job.

        Raises `Problem` if the owner has none of this name.
        """
        job = self.jobs.get(name)
        if job is None or job.owner != owner:
            raise Problem("unknown", f"no job of yours is called {name!r:.40}", "/job")
        return job

    def files(self, name: str, owner: str) -> dict[str, Path]:
        """Return the files that an owner's job has written, by their names in its folder."""
        folder = self._folder_of(self.get(name, owner).message.job)
        paths = sorted(path for path in folder.rglob("*") if path.is_file())
        return {path.relative_to(folder).as_posix(): path for path in paths}

    def _folder_of(self, job: str) -> Path:
        """Return where a job may write; what stands there goes when the job is forgotten."""
        return self.results / job

    def all(self, owner: str) -> tuple[JobMessage, ...]:
        """Return the state of an owner's jobs, the oldest first."""
        return tuple(job.message for job in self.jobs.values() if job.owner == owner)

    def cancel(self, job: Job) -> None:
        """End a job."""
        with suppress(ValueError):
            self._queue.remove(job)
        job.cancel()

    def end_playing(self) -> None:
        """End all jobs that play or wait to; the driver's watchdog ends at 0 V."""
        for job in list(self.jobs.values()):
            if plays(job.message.kind):
                self.cancel(job)

    async def stop(self) -> None:
        """End all jobs."""
        for job in list(self.jobs.values()):
            self.cancel(job)
        if self._runner is not None:
            await self._runner

    async def _runs(self) -> None:
        while self._queue:
            job = self._queue.popleft()
            on_device = plays(job.message.kind)
            try:
                if on_device:
                    self._lend(job.message.kind)
                    await self._engine.ask("lend")
                await job.run()
            except Problem as problem:
                job.change(state="failed", sentence=problem.sentence)
            finally:
                if on_device:
                    with suppress(Problem):  # an engine that has died opens it anew
                        await self._engine.ask("take_back")
                    self._lend("")
