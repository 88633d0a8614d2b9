"""Keep torch to one thread where its arrays are small.

The contact model works on arrays of some 10^4 values, where two threads gain nothing. Torch's
threads wait for each other by spinning: on a machine with busy cores, a solve on two threads took
25 times as long as on one.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

import torch
from torch import Tensor

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
    """Return the number of threads outside of `one_thread`, for code that starts its own."""
    given = _given.get()
    return torch.get_num_threads() if given is None else given


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
        """Do nothing: what counts is that the pass keeps this until it ends."""

    def __del__(self) -> None:
        torch.set_num_threads(self._threads)
