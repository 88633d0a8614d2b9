"""Values on their way, of which those that have not been used can be replaced."""

from __future__ import annotations

from collections import deque

import numpy as np
import numpy.typing as npt

_Values = npt.NDArray[np.float64]


class Revisable:
    """A queue of numbers by index, whose replacements are in doubt until they are accepted.

    Attributes
    ----------
    first : int
        Index of the oldest value that it holds.
    """

    def __init__(self) -> None:
        self.first = 0
        self.values: _Values = np.empty(0)
        self._replaced: deque[tuple[int, _Values]] = deque()  # what stood there before

    @property
    def end(self) -> int:
        """Index behind the last value."""
        return self.first + self.values.size

    def __getitem__(self, index: int) -> float:
        """Return the value at an index from `first` on."""
        if not self.first <= index < self.end:
            raise IndexError(index)
        return float(self.values[index - self.first])

    def append(self, values: _Values) -> None:
        """Add values behind the last."""
        self.values = np.concatenate([self.values, values])

    def replace(self, first: int, values: _Values) -> None:
        """Replace values that it holds, from index `first` on."""
        start = first - self.first
        place = slice(start, start + values.size)
        self._replaced.append((first, self.values[place].copy()))
        self.values[place] = values

    def accept(self, count: int) -> None:
        """Take the oldest `count` replacements as final."""
        for _ in range(min(count, len(self._replaced))):
            self._replaced.popleft()

    def undo(self) -> int:
        """Take back all replacements that were not accepted; return how many there were."""
        count = len(self._replaced)
        while self._replaced:
            first, before = self._replaced.pop()
            gone = max(0, self.first - first)
            if gone < before.size:
                start = first + gone - self.first
                self.values[start : start + before.size - gone] = before[gone:]
        return count

    def undo_last(self) -> None:
        """Take back the newest replacement, before anything was dropped."""
        first, before = self._replaced.pop()
        self.values[first - self.first : first - self.first + before.size] = before

    def drop_before(self, index: int) -> _Values:
        """Remove the values before an index and return them."""
        count = min(max(0, index - self.first), self.values.size)
        gone, self.values = self.values[:count], self.values[count:]
        self.first += count
        return gone
