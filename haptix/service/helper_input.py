"""The way into a process of the service: frames of its standard input, and its end with the front.

A front that is killed closes the input. A helper may compute for long just then, so a thread reads,
and ends the process.
"""

from __future__ import annotations

import os
import queue
import sys
import threading
import time
from collections.abc import Iterator

from haptix.service.wire import read_frame

_LAST_S = 1.0  # to end in order once the service is gone

Frame = tuple[int, bytes]


def frames(last_s: float = _LAST_S) -> Iterator[Frame]:
    """Yield the frames of the standard input.

    The process ends `last_s` after the end of the input, whatever it does then.
    """
    waiting: queue.SimpleQueue[Frame | None] = queue.SimpleQueue()
    threading.Thread(
        target=_reads, args=(waiting, last_s), name="haptix helper input", daemon=True
    ).start()
    while (found := waiting.get()) is not None:
        yield found


def _reads(waiting: queue.SimpleQueue[Frame | None], last_s: float) -> None:
    while (found := read_frame(sys.stdin.buffer)) is not None:
        waiting.put(found)
    waiting.put(None)
    time.sleep(last_s)
    os._exit(1)
