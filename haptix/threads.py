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
