"""Large batches in blocks that bound the memory, on all of torch's threads."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor

import torch
from torch import Tensor

from haptix.threads import one_thread

_BLOCK = 65536  # larger gains nothing; at an eighth of it, calls take half of the time
_LEAST_PER_THREAD = 2 * _BLOCK  # below, starting a thread costs more than it saves

Answer = Callable[..., tuple[Tensor, ...]]


def in_blocks(answer: Answer, inputs: Sequence[Tensor | None]) -> tuple[Tensor, ...]:
    """Return ``answer(*inputs)``, block by block.

    Parameters
    ----------
    answer : callable
        Takes tensors of one length, or None where `inputs` has None, and returns tensors of it.
    inputs : sequence of Tensor or None
        Flat tensors of one length. Where autograd records, or on a GPU, they go in one piece.
    """
    given = [t for t in inputs if t is not None]
    count = len(given[0])
    if any(t.requires_grad or t.is_cuda for t in given):
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
