"""``python -m haptix.service.worker.process [NICE]``: a process that works for one owner, and ends.

It decodes files, draws, checks and exports materials, does a job, or runs the virtual finger, so
that neither the front nor the engine waits for that. It answers one question after the other; the
front ends it when an answer takes too long. When the front is killed, the input closes: the thread
that reads it ends the process, whatever it computes then.
"""

from __future__ import annotations

import os
import queue
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from haptix.base.errors import InputError
from haptix.base.files import parse_json, write_folder
from haptix.base.task import Context, Task, all_tasks
from haptix.model.presets import FINGERS, SCREENS
from haptix.service.protocol.wire import (
    BEAT,
    JSON,
    Outbox,
    answer_of,
    frame,
    frame_output,
    read_frame,
)

if TYPE_CHECKING:
    from haptix.service.worker.document_work import DocumentWork
    from haptix.service.worker.felt_finger import FeltFingerThread

MOST_MEMORY_BYTES = 6 * 2**30
_LAST_S = 1.0  # to end in order once the service is gone

Frame = tuple[int, bytes]


def frames(outbox: Outbox, last_s: float = _LAST_S) -> Iterator[Frame]:
    """Yield the frames of the standard input; beats are returned at once.

    The process ends `last_s` after the end of the input, whatever it does then.
    """
    waiting: queue.SimpleQueue[Frame | None] = queue.SimpleQueue()
    threading.Thread(
        target=_reads, args=(outbox, waiting, last_s), name="haptix worker input", daemon=True
    ).start()
    while (next_frame := waiting.get()) is not None:
        yield next_frame


def _reads(outbox: Outbox, waiting: queue.SimpleQueue[Frame | None], last_s: float) -> None:
    while (next_frame := read_frame(sys.stdin.buffer)) is not None:
        if next_frame[0] == BEAT:
            outbox.tell(frame(BEAT, b""))
        else:
            waiting.put(next_frame)
    waiting.put(None)
    time.sleep(last_s)
    os._exit(1)


def limit_memory(most_bytes: int = MOST_MEMORY_BYTES) -> None:
    """End with MemoryError what takes more, where the system can."""
    with suppress(ImportError, ValueError, OSError):
        import resource

        resource.setrlimit(resource.RLIMIT_DATA, (most_bytes, most_bytes))


def yield_to_others(nice: int) -> None:
    """Lower the priority of this thread, and of those that it starts, where the system can."""
    if hasattr(os, "nice"):
        os.nice(nice)


class Worker:
    """Answers the questions of the front, by their names.

    Parameters
    ----------
    outbox : Outbox
        The way to the front.
    frames : iterator
        Frames of the front.
    """

    def __init__(self, outbox: Outbox, frames: Iterator[Frame]) -> None:
        self._outbox, self._frames = outbox, frames
        self._documents: DocumentWork | None = None
        self._opened: tuple[str, dict[str, Any]] | None = None
        self._felt_finger: FeltFingerThread | None = None

    def run(self) -> None:
        """Answer until the input ends."""
        for kind, data in self._frames:
            if kind == JSON:
                message = parse_json(data)
                self._outbox.say(n=message.pop("n"), **self._answer(message))
            elif self._felt_finger is not None:
                self._felt_finger.take(kind, data)
        if self._felt_finger is not None:
            self._felt_finger.close()

    def _answer(self, message: dict[str, Any]) -> dict[str, Any]:
        do = message.pop("do")
        is_of_worker = do in ("open", "job", "get_ready", "feel")

        def call() -> dict[str, Any]:
            method = getattr(self, f"_do_{do}") if is_of_worker else getattr(self._documents, do)
            answer: dict[str, Any] = method(**message)
            return answer

        return answer_of(message.get("kind", do), call, "document")

    def _do_open(self, assets: str, draws: bool = False, **opening: Any) -> dict[str, Any]:
        """Get ready for questions about files and materials; `draws` loads what pictures need."""
        from haptix.feel.materials import pictures  # noqa: F401
        from haptix.feel.materials.decoded import FOLDER, keep_in
        from haptix.service.worker.document_work import DocumentWork

        if draws:
            import scipy.ndimage  # noqa: F401, of most pictures

            from haptix.feel.materials import panels, picture  # noqa: F401
        keep_in(Path(assets).parent / FOLDER, makes=True)
        if self._opened != (assets, opening):  # a spare is asked again, by its owner
            self._documents = DocumentWork(Path(assets), opening)
            self._opened = assets, opening
        return {}

    def _do_job(self, kind: str, context: dict[str, Any], **fields: Any) -> dict[str, Any]:
        """Do a job; the frames that arrive meanwhile answer its questions."""
        # If the service ends meanwhile, the driver's watchdog ends the output at 0 V.
        answers = (parse_json(data)["text"] for _, data in self._frames)
        return {"result": getattr(JobWork(context, self._outbox.say, answers), kind)(**fields)}

    def _do_get_ready(self) -> dict[str, Any]:
        """Import the modules of the virtual finger."""
        from haptix.service.worker import felt_finger  # noqa: F401

        return {}

    def _do_feel(self, finger: str, screen: str, carrier_hz: float, nice: int) -> dict[str, Any]:
        """Compute the felt friction of the touches and amplitudes that arrive from now on.

        It yields once it is loaded: a busy machine would let it load for a minute.
        """
        from haptix.service.worker.felt_finger import FeltFinger, FeltFingerThread

        felt_finger = FeltFinger(finger, screen, carrier_hz)
        yield_to_others(nice)
        self._felt_finger = FeltFingerThread(felt_finger, self._outbox.tell)
        return {}


class JobWork:
    """One job, by the names of its kinds.

    Parameters
    ----------
    context : dict
        Folder of assets and of logs, address of the device, finger and screen in use, highest
        amplitude of the drive.
    say : callable
        Takes fields of a message to the service.
    answers : iterator of str
        Answers of a person.
    """

    def __init__(
        self, context: dict[str, Any], say: Callable[..., None], answers: Iterator[str]
    ) -> None:
        self._context, self._say, self._answers = context, say, answers

    def __getattr__(self, kind: str) -> Callable[..., dict[str, Any]]:
        """Jobs that are tasks of `haptix/base/task_list.py`, by their kinds."""
        task = next((task for task in all_tasks() if task.route and task.kind == kind), None)
        if task is None:
            raise AttributeError(kind)
        return partial(self._do, task)

    def _do(self, task: type[Task], **fields: Any) -> dict[str, Any]:
        from haptix.base.kinds import in_folder

        for name in ("finger", "screen"):
            if name in task.model_fields and (used := self._name(name, fields.get(name))):
                fields[name] = used
        if "highest_v" in task.model_fields:
            fields["highest_v"] = self._context.get("highest_v")
        if task.plays:
            fields["device"] = self._context["device"]
        context = _JobContext(self._say, self._answers, task)
        if task.keeps:
            context.folder = Path(self._context[task.keeps])
        with in_folder(Path(self._context.get("assets", "")), is_sealed=True):
            result = task(**fields).run(context)
        if result.files:
            write_folder(Path(self._context["results"]), result.files)
        document = result.document
        return document if isinstance(document, dict) else {"rows": document}

    def _name(self, kind: str, name: str | None) -> str | None:
        """Return a preset or the profile in use: a client names no files."""
        used: str | None = self._context.get(kind)
        presets = FINGERS if kind == "finger" else SCREENS
        if name is None or name == used:
            return used
        if name not in presets:
            raise InputError(f"{kind}: expected {used} or one of {', '.join(presets)}, got {name}")
        return name


class _JobContext(Context):
    """Sends the progress of a task to the service, and its questions to a person there."""

    def __init__(self, say: Callable[..., None], answers: Iterator[str], task: type[Task]) -> None:
        super().__init__()
        self._say, self._answers = say, answers
        self._stages, self._step = task.stages, ""

    def tell(self, **what: Any) -> None:
        self._step = what.get("step", self._step)
        self._say(**what)

    def progress(self, stage: str, share: float) -> None:
        super().progress(stage, share)
        if stage in self._stages:
            if stage != self._step:  # a page shows what is done, also after a fault of a stroke
                self.tell(step=stage)
            self.tell(share=(self._stages.index(stage) + share) / len(self._stages))

    def ask(self, prompt: str, choices: Sequence[str] = ()) -> str:
        self.tell(prompt=prompt, choices=tuple(choices))
        answer = next(self._answers, None)
        if answer is None:
            raise SystemExit(1)
        return answer


def main() -> None:
    """Work until the input ends."""
    outbox = Outbox(frame_output())
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    yield_to_others(int(sys.argv[1]) if len(sys.argv) > 1 else 0)
    limit_memory()
    Worker(outbox, frames(outbox)).run()
    outbox.close()
    os._exit(0)  # a thread still reads the input


if __name__ == "__main__":
    main()
