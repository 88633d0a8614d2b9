"""Memory that the maps of materials take: counted before they are made, given back with them.

A short document may ask for much: a noise names its pixels, a recording its step. So each `Pyramid`
is counted, of whatever kind its material is, in the `MapMemory` in whose context it is made.
"""

from __future__ import annotations

import gc
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any
from weakref import WeakKeyDictionary

from haptix.base.errors import InputError


class MapMemory:
    """A budget of memory, and the maps that take it.

    Parameters
    ----------
    most_bytes : int
        The budget.
    whose : str
        Names it in messages.
    within : MapMemory, optional
        A larger one, in which its maps count too.

    Examples
    --------
    >>> from haptix.feel import Noise
    >>> memory = MapMemory(1_000_000, "this example")
    >>> with memory.counts():
    ...     noise = Noise(pixels=128).evaluator
    >>> memory.used_bytes
    319528
    """

    def __init__(self, most_bytes: int, whose: str, within: MapMemory | None = None) -> None:
        self.most_bytes, self._whose, self._within = most_bytes, whose, within
        self._maps: WeakKeyDictionary[Any, int] = WeakKeyDictionary()
        self._lock = threading.Lock()

    @property
    def used_bytes(self) -> int:
        """Memory of the maps that are there."""
        return sum(list(self._maps.values()))

    @contextmanager
    def counts(self) -> Iterator[None]:
        """Count the maps that are made in a context, in this thread."""
        token = _COUNTED.set(self)
        try:
            yield
        finally:
            _COUNTED.reset(token)

    def check(self, more_bytes: int) -> None:
        """Raise `InputError` if the budget has no room for a map."""
        if self.used_bytes + more_bytes > self.most_bytes:
            gc.collect()  # a layout that was felt is in a cycle with its renderer
        if (bytes_ := self.used_bytes + more_bytes) > self.most_bytes:
            raise InputError(
                f"memory: the maps of {self._whose} would take {bytes_ / 2**20:.0f} MiB, expected "
                f"at most {self.most_bytes / 2**20:.0f}; use fewer materials, fewer pixels or a "
                "larger step"
            )
        if self._within is not None:
            self._within.check(more_bytes)

    def take(self, new: Any, new_bytes: int) -> None:
        """Count a map from now on; raise `InputError` if there is no room."""
        with self._lock:
            self.check(new_bytes)
            self._maps[new] = new_bytes
            if self._within is not None:
                self._within.take(new, new_bytes)


_COUNTED: ContextVar[MapMemory | None] = ContextVar("counted memory", default=None)


def check_room(more_bytes: int) -> None:
    """Raise `InputError` if the maps that are counted here leave no room for another."""
    if (memory := _COUNTED.get()) is not None:
        memory.check(more_bytes)


def take_room(new: Any, new_bytes: int) -> None:
    """Count a new map where maps are counted; raise `InputError` if there is no room."""
    if (memory := _COUNTED.get()) is not None:
        memory.take(new, new_bytes)
