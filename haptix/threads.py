"""Keep torch to one thread where its arrays are small.

The contact model works on arrays of some 10^4 values. Two threads gain nothing there, and torch's
threads wait for each other by spinning: on a machine whose cores are busy with something else, a
solve took 25 times as long with two as with one.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import torch


@contextmanager
def one_thread() -> Iterator[None]:
    """Limit torch to one thread inside, and restore what was set; also a decorator."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)
