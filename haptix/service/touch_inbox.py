"""Touches that have come and are passed on together, and what is left out when the service is late.

A busy machine may keep the front from running for a while. What waited in the sockets is then old,
and newer touches wait behind it. Of the moves from before, the newest of each finger is passed on;
the others are counted. No touch is refused for a delay of ours (`touch_reports`).
"""

from __future__ import annotations

from collections.abc import Sequence

from haptix.service.batches import ClientTouch
from haptix.service.clocks import ClientClock
from haptix.service.messages import Problem

OLD_S = 0.1
"""A stall of the front for so long is noticed; of moves that are older, the newest is kept: the
engine takes none of that age."""
_LATE_S = 1.0  # after a stall: what had not been read yet is old, too


Batch = list[ClientTouch | Problem | None]


class Stalls:
    """When the front did not run, by looks at the clock that come often while it does."""

    def __init__(self, now_s: float) -> None:
        self._looked_s = now_s
        self._stalled_s, self._until_s = 0.0, float("-inf")

    def look(self, now_s: float) -> None:
        """Take note that it runs."""
        stalled_s = now_s - self._looked_s
        self._looked_s = now_s
        if stalled_s > OLD_S:
            before_s = self._stalled_s if now_s < self._until_s else 0.0
            self._stalled_s, self._until_s = before_s + stalled_s, now_s + _LATE_S

    def late_s(self, now_s: float) -> float:
        """Return by how much touches may be late by our own fault; 0 while all is well."""
        self.look(now_s)
        return self._stalled_s if now_s < self._until_s else 0.0


class TouchInbox:
    """Touches of one client that wait to be passed on together.

    Attributes
    ----------
    passed_s : float
        When touches were passed on last.
    is_due : bool
        Whether those that wait will be passed on without more ado.
    dropped : int
        Touches that were left out since the last time it was set to 0.
    """

    def __init__(self) -> None:
        self._batches: list[Batch] = []
        self.passed_s = float("-inf")
        self.is_due = False
        self.dropped = 0

    def __len__(self) -> int:
        return len(self._batches)

    def put(self, touches: Sequence[ClientTouch | Problem]) -> None:
        """Take the touches of a batch."""
        self._batches.append([*touches])

    def take(self, clock: ClientClock, now_s: float, late_s: float) -> list[Batch]:
        """Return what is to be passed on, batch by batch; None stands for what is left out.

        Parameters
        ----------
        clock : ClientClock
            The client's.
        now_s : float
            By the service's clock.
        late_s : float
            What `Stalls.late_s` says.
        """
        batches, self._batches = self._batches, []
        self.passed_s, self.is_due = now_s, False
        if not late_s or not clock.is_known:
            return batches
        dropped = _replaced(batches, clock.client_s(now_s - OLD_S))
        self.dropped += len(dropped)
        for number, index in dropped:
            batches[number][index] = None
        return batches


def _replaced(batches: list[Batch], old_s: float) -> list[tuple[int, int]]:
    """Return where moves are that a later move of the same stroke replaces, older than a time."""
    found: list[tuple[int, int]] = []
    newer: set[int] = set()  # fingers
    for number in reversed(range(len(batches))):
        for index in reversed(range(len(batches[number]))):
            touch = batches[number][index]
            if not isinstance(touch, ClientTouch):
                continue
            if touch.kind != "move":
                newer.discard(touch.touch_id)
            elif touch.t_s < old_s and touch.touch_id in newer:
                found.append((number, index))
            else:
                newer.add(touch.touch_id)
    return found
