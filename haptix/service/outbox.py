"""The way out of a process of the service: its standard output, kept from what libraries print."""

from __future__ import annotations

import os
import queue
import threading
from contextlib import suppress
from typing import Any, BinaryIO

from haptix.service.wire import json_frame

_MOST_WAITING = 64  # frames of telemetry that the other side has not taken


class Outbox:
    """Writes frames in a thread of its own: who sends never waits for the one who reads.

    Parameters
    ----------
    output : binary file
        Where frames go.
    """

    def __init__(self, output: BinaryIO) -> None:
        self._output = output
        self._waiting: queue.SimpleQueue[bytes | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._writes, name="haptix outbox", daemon=True)
        self._thread.start()

    def say(self, **message: Any) -> None:
        """Send a message."""
        self._waiting.put(json_frame(message))

    def tell(self, data: bytes) -> None:
        """Send a frame of telemetry, or drop it if nobody reads."""
        if self._waiting.qsize() < _MOST_WAITING:
            self._waiting.put(data)

    def close(self) -> None:
        """Send what waits, for a second at most."""
        self._waiting.put(None)
        self._thread.join(1.0)

    def _writes(self) -> None:
        with suppress(OSError):  # the other side is gone: the end of our input says so too
            while (data := self._waiting.get()) is not None:
                self._output.write(data)
                self._output.flush()


def own_output() -> BinaryIO:
    """Return the standard output for frames; what a library prints goes to the standard error."""
    output = os.fdopen(os.dup(1), "wb", buffering=0)
    os.dup2(2, 1)
    return output
