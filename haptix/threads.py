"""Keep torch to one thread where its arrays are small.

The contact model works on arrays of some 10^4 values. Two threads gain nothing there, and torch's
threads wait for each other by spinning: on a machine whose cores are busy with something else, a
solve took 25 times as long with two as with one.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

import torch

_given: ContextVar[int | None] = ContextVar("threads given", default=None)


@contextmanager
def one_thread() -> Iterator[None]:
    """Limit torch to one thread inside, and restore what was set; also a decorator."""
    before = torch.get_num_threads()
    token = _given.set(given_threads())
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)
        _given.reset(token)


def given_threads() -> int:
    """Threads that torch was given, within `one_thread` as well: for work of its own threads."""
    given = _given.get()
    return torch.get_num_threads() if given is None else given
