"""``python -m haptix.service.worker NICE``: a process that works for one owner, and ends.

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
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from haptix.files import parse_json
from haptix.service.wire import BEAT, JSON, Outbox, answer_of, frame, frame_output, read_frame

if TYPE_CHECKING:
    from haptix.service.document_work import DocumentWork
    from haptix.service.felt_finger import FeltFingerThread

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

    def _do_open(self, assets: str, **opening: Any) -> dict[str, Any]:
        """Get ready for questions about files and materials."""
        from haptix.service.document_work import DocumentWork
        from haptix.texture import pictures  # noqa: F401
        from haptix.texture.decoded import FOLDER, keep_in

        keep_in(Path(assets).parent / FOLDER, makes=True)
        self._documents = DocumentWork(Path(assets), opening)
        return {}

    def _do_job(self, kind: str, context: dict[str, Any], **fields: Any) -> dict[str, Any]:
        """Do a job; what it asks is answered by the frames that come meanwhile."""
        from haptix.service.job_work import JobWork

        # What it plays once the service is gone ends at 0 V by the driver's watchdog.
        answers = (parse_json(data)["text"] for _, data in self._frames)
        return {"result": getattr(JobWork(context, self._outbox.say, answers), kind)(**fields)}

    def _do_get_ready(self) -> dict[str, Any]:
        """Import what a virtual finger needs."""
        from haptix.service import felt_finger  # noqa: F401

        return {}

    def _do_feel(self, finger: str, screen: str, carrier_hz: float) -> dict[str, Any]:
        """Feel, from now on, what comes as touches and amplitudes."""
        from haptix.service.felt_finger import FeltFinger, FeltFingerThread

        self._felt_finger = FeltFingerThread(
            FeltFinger(finger, screen, carrier_hz), self._outbox.tell
        )
        return {}


def main() -> None:
    """Work until the input ends."""
    outbox = Outbox(frame_output())
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if hasattr(os, "nice"):
        os.nice(int(sys.argv[1]))
    limit_memory()
    Worker(outbox, frames(outbox)).run()
    outbox.close()
    os._exit(0)  # a thread still reads the input


if __name__ == "__main__":
    main()
