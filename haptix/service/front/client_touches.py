"""Touches of a client, from its batches to the engine: whose clock, which place, how many.

    batch -> TouchInbox -> touch_events ---(front | engine)---> TouchGate -> renderer
             of a session  with ClientClock

In the front, touches that arrive together are passed on together. A busy machine may keep the front
from running for a while (`Stalls`). What waited in the sockets is then old, and newer touches wait
behind it: of the moves from before, the newest of each finger is passed on, and the others are
counted. No touch is refused for a delay of the service.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from contextlib import suppress
from typing import NamedTuple

from haptix.base.fields import LARGEST_MM
from haptix.play.touch.events import TouchEvent
from haptix.service.protocol.messages import Geometry, Problem, TouchMessage

FUTURE_S, PAST_S = 0.005, 0.5
"""How far ahead of now a touch may be, and how old."""
_EXCHANGES, _MOST_DRIFT = 64, 200e-6
_JUMP_S, _JUMPS = 0.02, 3
OLD_S = 0.1
"""A stall of the front for so long is noticed; of moves that are older, the newest is kept: the
engine takes none of that age."""
_LATE_S = 1.0  # after a stall: what had not been read yet is old, too

Batch = list[TouchMessage | Problem | None]


class ClientClock:
    """Maps the client's times to the service's.

    The server pings, the client answers with its time. The offset of one exchange is
    ``client - (sent + received) / 2``, off by half the round trip at most; the line through the
    quickest quarter of the last exchanges follows the drift (NTP's clock filter, RFC 5905,
    section 10).

    Attributes
    ----------
    error_s : float
        Largest error of the offset [s]: half the round trips that it was taken from.
    jumps : int
        Times that the client's clock was set anew; touches before are of another time.
    """

    def __init__(self) -> None:
        self._samples: deque[tuple[float, float, float]] = deque(maxlen=_EXCHANGES)
        self._line: tuple[float, float, float] | None = None  # at, offset, drift
        self._outliers = 0
        self.error_s = float("inf")
        self.jumps = 0

    @property
    def is_known(self) -> bool:
        """Whether an answer has come."""
        return self._line is not None

    def add(self, sent_s: float, received_s: float, client_s: float) -> bool:
        """Take an exchange; return whether the client's clock has jumped."""
        trip_s = received_s - sent_s
        middle_s = (sent_s + received_s) / 2
        offset_s = client_s - middle_s
        jumped = False
        if self._line is not None:
            at_s, line_s, drift = self._line
            error_s = abs(offset_s - line_s - drift * (middle_s - at_s))
            # The line may be off by as much as a busy machine took to answer at first.
            most_s = max(_JUMP_S, 3 * trip_s) + 2 * self.error_s
            self._outliers = self._outliers + 1 if error_s > most_s else 0
            if 0 < self._outliers < _JUMPS:
                return False
            if self._outliers:
                self._samples.clear()
                self._outliers, jumped = 0, True
                self.jumps += 1
        self._samples.append((middle_s, offset_s, trip_s))
        self._fit()
        return jumped

    def service_s(self, client_s: float) -> float:
        """Return a time of the client by the service's clock."""
        if self._line is None:
            raise Problem("clock", "the clocks are not compared yet: answer the pings first")
        at_s, offset_s, drift = self._line
        return at_s + (client_s - at_s - offset_s) / (1 + drift)

    def client_s(self, service_s: float) -> float:
        """Return a time of the service by the client's clock; nan while it is unknown."""
        if self._line is None:
            return float("nan")
        at_s, offset_s, drift = self._line
        return service_s + offset_s + drift * (service_s - at_s)

    def window(self, now_s: float) -> tuple[float, float]:
        """Return the oldest and newest stamp that `stamp` takes; nan while the clock is unknown."""
        return self.client_s(now_s - PAST_S), self.client_s(now_s + FUTURE_S + self.error_s)

    def stamp(self, client_s: float, now_s: float) -> float:
        """Return a touch's time by the service's clock.

        Raises `Problem` if it lies ahead of now by more than 5 ms and the clocks' uncertainty, or
        is older than half a second.
        """
        stamp_s = self.service_s(client_s)
        ahead_s = stamp_s - now_s
        if ahead_s > FUTURE_S + self.error_s:
            wrong = f"{ahead_s:.3g} s ahead"
        elif ahead_s < -PAST_S:
            wrong = f"{-ahead_s:.3g} s old"
        else:
            return stamp_s
        raise Problem(
            "clock",
            f"t_s: expected seconds of the clock in the pongs, got a stamp {wrong}; is "
            "it in seconds, and of the same clock?",
            "/t_s",
        )

    def _fit(self) -> None:
        best = sorted(self._samples, key=lambda sample: sample[2])
        best = best[: max(4, len(best) // 4)]
        self.error_s = sum(trip for _, _, trip in best) / len(best) / 2
        at_s = sum(time for time, _, _ in best) / len(best)
        offset_s = sum(offset for _, offset, _ in best) / len(best)
        spread = sum((time - at_s) ** 2 for time, _, _ in best)
        drift = 0.0
        if spread > 1.0:  # a shorter stretch shows jitter, not drift
            drift = sum((time - at_s) * (offset - offset_s) for time, offset, _ in best) / spread
            drift = min(max(drift, -_MOST_DRIFT), _MOST_DRIFT)
        self._line = (at_s, offset_s, drift)


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
        Whether a call that passes on those that wait is scheduled.
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

    def put(self, touches: Sequence[TouchMessage | Problem]) -> None:
        """Take the touches of a batch."""
        self._batches.append([*touches])

    def take(self, clock: ClientClock, now_s: float, late_s: float) -> list[Batch]:
        """Return the touches to pass on, batch by batch; None stands for one that is left out.

        Parameters
        ----------
        clock : ClientClock
            The client's.
        now_s : float
            By the service's clock.
        late_s : float
            As `Stalls.late_s` returns it.
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
    places: list[tuple[int, int]] = []
    newer: set[int] = set()  # fingers
    for number in reversed(range(len(batches))):
        for index in reversed(range(len(batches[number]))):
            touch = batches[number][index]
            if not isinstance(touch, TouchMessage):
                continue
            if touch.kind != "move":
                newer.discard(touch.touch_id)
            elif touch.t_s < old_s and touch.touch_id in newer:
                places.append((number, index))
            else:
                newer.add(touch.touch_id)
    return places


class UsableTouches(NamedTuple):
    """The touches of a message that can be used."""

    events: list[TouchEvent]
    left_out: int
    problem: Problem | None
    """The error of the first one that cannot."""


def touch_events(
    clock: ClientClock,
    geometry: Geometry | None,
    touches: Sequence[TouchMessage | Problem | None],
    now_s: float,
    late_s: float,
) -> UsableTouches:
    """Return a client's touches by the service's clock, and the errors of the others.

    Touches that are too old by at most `late_s` [s], the service's own delay, are taken as if they
    were just in time.
    """
    events: list[TouchEvent] = []
    left_out = 0
    first_problem: Problem | None = None
    oldest_s, newest_s = clock.window(now_s)
    service_s = clock.service_s
    for index, touch in enumerate(touches):
        if touch is None:
            continue
        try:
            if isinstance(touch, Problem):
                raise touch
            t_s = touch.t_s
            if touch.kind == "up":
                events.append(_lift(clock, geometry, touch, now_s))
                continue
            if oldest_s - late_s <= t_s < oldest_s:
                t_s = oldest_s
            elif not oldest_s <= t_s <= newest_s:
                if first_problem is not None:
                    left_out += 1
                    continue  # who is late is late with all, and is not to be held up by it
                clock.stamp(t_s, now_s)
            x_mm, y_mm = touch.x_mm, touch.y_mm
            if x_mm is None or y_mm is None or touch.x_px is not None:
                x_mm, y_mm = _place(geometry, touch)
            if not (abs(x_mm) <= LARGEST_MM and abs(y_mm) <= LARGEST_MM):
                why = f"expected places within {LARGEST_MM:g} mm, got {x_mm:g}, {y_mm:g} mm"
                raise Problem("message", f"x_mm: {why}; are these pixels?", "/x_mm")
        except Problem as problem:
            path = problem.path if problem is touch else f"/touches/{index}{problem.path}"
            left_out += 1
            first_problem = first_problem or Problem(problem.code, problem.sentence, path)
            continue
        force_n, area_m2 = touch.normal_force_n, touch.contact_area_m2
        events.append(
            TouchEvent(service_s(t_s), touch.touch_id, x_mm, y_mm, touch.kind, force_n, area_m2)
        )
    return UsableTouches(events, left_out, first_problem)


def _lift(
    clock: ClientClock, geometry: Geometry | None, touch: TouchMessage, now_s: float
) -> TouchEvent:
    """Return an up, which nothing keeps out: the finger would stay on the screen."""
    t_s, x_mm, y_mm = now_s, 0.0, 0.0
    if clock.is_known:
        t_s = min(max(clock.service_s(touch.t_s), now_s - PAST_S), now_s)
    with suppress(Problem):
        x_mm, y_mm = _place(geometry, touch)
    return TouchEvent(t_s, touch.touch_id, x_mm, y_mm, "up")


def _place(geometry: Geometry | None, touch: TouchMessage) -> tuple[float, float]:
    if touch.x_px is not None and touch.y_px is not None and touch.x_mm is None:
        if geometry is None:
            raise Problem("order", "x_px: send geometry first, or millimetres", "/x_px")
        return geometry.mm(touch.x_px, touch.y_px)
    if touch.x_mm is not None and touch.y_mm is not None and touch.x_px is None:
        return touch.x_mm, touch.y_mm
    raise Problem("message", "expected x_mm and y_mm, or x_px and y_px")
