"""Processes of this machine, one task each: as many as cores and memory allow."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Callable
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from multiprocessing import get_context
from multiprocessing.connection import Connection
from typing import Any, TypeVar

Result = TypeVar("Result")

PROCESS_BYTES = 400_000_000
"""Memory of a process that has loaded torch and done nothing yet."""
_LIBRARIES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


def processes_that_fit(needed_bytes: int, most: int | None = None) -> int:
    """Return how many processes cores and half of the free memory allow, at least 1."""
    import torch

    from haptix.model.contact.boundary_elements.ensemble import free_bytes

    if hasattr(os, "sched_getaffinity"):
        cores = len(os.sched_getaffinity(0))
    else:
        cores = os.cpu_count() or 1
    free = free_bytes(torch.device("cpu"))
    fit = cores if free is None else free // 2 // (PROCESS_BYTES + needed_bytes)
    return max(1, min(most or cores, fit))


class Processes(Executor):
    """Executor of some processes, each in a separate pool: one that dies ends only its own calls.

    A call that loses its process ends with `BrokenProcessPool`; the next call has a new process.
    All end when this process ends, however it ends.

    Parameters
    ----------
    count : int
        Calls at a time.
    memory_bytes : int, optional
        Memory that each may have above that of a process at its start; a task that needs more
        fails. On Linux only.
    """

    def __init__(self, count: int, memory_bytes: int | None = None) -> None:
        self._places = [_Place(memory_bytes) for _ in range(count)]
        self.at_once = self.workers = count

    def submit(self, work: Callable[..., Result], /, *args: Any, **named: Any) -> Future[Result]:
        """Do a call on the process with the fewest calls."""
        return min(self._places, key=lambda place: place.calls).submit(work, *args, **named)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the processes: with `wait` when their calls have ended, else at once."""
        for place in self._places:
            if not wait:
                place.end.close()
            place.pool.shutdown(wait, cancel_futures=cancel_futures)
            place.close()


class _Place:
    """One process at a time, and how many calls wait for it."""

    def __init__(self, memory_bytes: int | None) -> None:
        self.calls, self._memory, self._lock = 0, memory_bytes, threading.Lock()
        self._open()

    def _open(self) -> None:
        context = get_context("spawn")
        listen, self.end = context.Pipe(duplex=False)
        self.pool = ProcessPoolExecutor(1, context, _start, (listen, self._memory))

    def close(self) -> None:
        self.end.close()
        self.pool.shutdown(wait=False, cancel_futures=True)

    def submit(self, work: Callable[..., Any], /, *args: Any, **named: Any) -> Future[Any]:
        try:
            future = self.pool.submit(work, *args, **named)
        except BrokenProcessPool:
            self.close()
            self._open()
            future = self.pool.submit(work, *args, **named)
        self._count(1)
        future.add_done_callback(lambda _: self._count(-1))
        return future

    def _count(self, more: int) -> None:
        with self._lock:
            self.calls += more


def _start(end: Connection, memory_bytes: int | None) -> None:
    """Prepare a process: each library has one thread, and the process ends with its parent."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent gets Ctrl-C too, and decides
    threading.Thread(target=_end_with, args=(end,), daemon=True).start()
    for name in _LIBRARIES:  # before numpy loads
        os.environ[name] = "1"
    import torch

    torch.set_num_threads(1)
    if memory_bytes is not None and sys.platform == "linux":
        import resource

        with open("/proc/self/statm", encoding="ascii") as file:  # noqa: PTH123
            data = int(file.read().split()[5]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_DATA, (data + memory_bytes, resource.RLIM_INFINITY))


def _end_with(end: Connection) -> None:
    """Wait until the parent closes the other end, or dies, and end."""
    with suppress(EOFError, OSError):
        end.recv()
    from haptix.tasks.campaign.task_worker import release

    release()
    os._exit(0)
