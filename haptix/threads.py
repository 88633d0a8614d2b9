"""Torch's threads and memory: one thread for small arrays, and freed memory that is kept.

The contact model works on arrays of some 10^4 values, where two threads gain nothing. Torch's
threads wait for each other by spinning: on a machine with busy cores, a solve on two threads took
25 times as long as on one.
"""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar

import torch
from torch import Tensor

_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD = -1, -3  # from glibc's malloc.h
_MMAP_ABOVE = 32 << 20  # the largest value that glibc takes
_TRIM_ABOVE = 256 << 20

_given: ContextVar[int | None] = ContextVar("threads given", default=None)


@contextmanager
def one_thread() -> Iterator[None]:
    """Limit torch to one thread in a ``with`` block or a decorated function."""
    before = torch.get_num_threads()
    token = _given.set(given_threads())
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)
        _given.reset(token)


def given_threads() -> int:
    """Return the number of threads outside of `one_thread`, for code that starts threads itself."""
    threads = _given.get()
    return torch.get_num_threads() if threads is None else threads


def backward_on_one_thread(tensor: Tensor) -> Tensor:
    """Limit torch to one thread while autograd goes back through a tensor, and return it.

    A backward pass runs after `one_thread` has ended, in the same small arrays. The limit lasts
    until the end of that pass; a GPU has threads of its own, and none is set.
    """
    if tensor.requires_grad and not tensor.is_cuda:
        tensor.register_hook(lambda _: _limit_backward())
    return tensor


def _limit_backward() -> None:
    before = torch.get_num_threads()
    if before > 1:
        torch.set_num_threads(1)
        # Autograd calls it at the end, and drops it there or where an error ends the pass.
        torch.autograd.Variable._execution_engine.queue_callback(_Restored(before))


class _Restored:
    """Gives torch its threads back when it is dropped."""

    def __init__(self, threads: int) -> None:
        self._threads = threads

    def __call__(self) -> None:
        """Do nothing: the backward pass keeps a reference to this until it ends."""

    def __del__(self) -> None:
        torch.set_num_threads(self._threads)


def keep_freed_memory() -> None:
    """Keep freed array memory in the process instead of giving it back to the kernel each time.

    Tables take thousands of operations on arrays of a few 100 kB. glibc returns each temporary to
    the kernel and faults the next one in again. On virtual machines those page faults cost 10 to 50
    times the arithmetic. Two raised thresholds of glibc's malloc keep the memory.
    """
    if sys.platform.startswith("linux"):
        with suppress(AttributeError):  # another C library
            mallopt = ctypes.CDLL(None).mallopt
            mallopt(_M_MMAP_THRESHOLD, _MMAP_ABOVE)
            mallopt(_M_TRIM_THRESHOLD, _TRIM_ABOVE)
