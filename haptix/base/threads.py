"""Torch's threads and memory: one thread for small arrays, all for many, freed memory is kept.

The contact model works on arrays of some 10^4 values, where two threads gain nothing. Torch's
threads wait for each other by spinning: on a machine with busy cores, a solve on two threads took
25 times as long as on one.
"""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from contextvars import ContextVar

import torch
from torch import Tensor

_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD = -1, -3  # from glibc's malloc.h
_MMAP_ABOVE = 32 << 20  # the largest value that glibc takes
_TRIM_ABOVE = 256 << 20

_BLOCK = 65536  # points; larger blocks gain nothing, and with 8192 calls take half of the time
_LEAST_PER_THREAD = 2 * _BLOCK  # with fewer points a thread's start costs more than it saves

Answer = Callable[..., tuple[Tensor, ...]]

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


def in_blocks(answer: Answer, inputs: Sequence[Tensor | None]) -> tuple[Tensor, ...]:
    """Return ``answer(*inputs)``, block by block, on all of torch's threads.

    Inputs are flat tensors of one length, or None; the answer's tensors have that length. With
    autograd or on a GPU there is one block only.
    """
    tensors = [t for t in inputs if t is not None]
    count = len(tensors[0])
    if any(t.requires_grad or t.is_cuda for t in tensors):
        return answer(*inputs)
    if count <= _BLOCK:
        with one_thread():
            return answer(*inputs)

    def part(start: int, stop: int) -> list[Tensor | None]:
        return [None if t is None else t[start:stop] for t in inputs]

    with one_thread():
        first = answer(*part(0, _BLOCK))
    results = tuple(torch.empty(count, dtype=r.dtype, device=r.device) for r in first)
    for result, block in zip(results, first, strict=True):
        result[:_BLOCK] = block

    def work(start: int, stop: int) -> None:
        with one_thread():
            for low in range(start, stop, _BLOCK):
                high = min(low + _BLOCK, stop)
                for result, block in zip(results, answer(*part(low, high)), strict=True):
                    result[low:high] = block

    threads = min(torch.get_num_threads(), count // _LEAST_PER_THREAD)
    if threads < 2:
        work(_BLOCK, count)
        return results
    ends = [_BLOCK + (count - _BLOCK) * i // threads for i in range(threads + 1)]
    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(work, ends[:-1], ends[1:]))
    return results


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


def return_freed_memory() -> None:
    """Return the memory to the kernel that this thread has freed and `keep_freed_memory` keeps.

    For a process that has built its tables and then lives long.
    """
    if not sys.platform.startswith("linux"):
        return
    with suppress(AttributeError):
        libc = ctypes.CDLL(None)
        libc.malloc.argtypes, libc.malloc.restype = (ctypes.c_size_t,), ctypes.c_void_p
        libc.free.argtypes = (ctypes.c_void_p,)
        libc.mallopt(_M_TRIM_THRESHOLD, 0)
        libc.free(libc.malloc(1 << 20))  # malloc_trim leaves the end of a thread's own heap alone
        libc.malloc_trim(0)
        libc.mallopt(_M_TRIM_THRESHOLD, _TRIM_ABOVE)
