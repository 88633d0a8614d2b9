"""Recorded touches: read from a CSV file, and played at their own pace."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

from haptix import checks
from haptix.errors import InputError
from haptix.files import read_csv
from haptix.motion import Trajectory
from haptix.touch.events import KINDS, TouchEvent

_REQUIRED = ("t_s", "x_mm", "y_mm")
_OPTIONAL = ("touch_id", "kind", "normal_force_n", "contact_area_m2")


def read_events(path: str | Path) -> list[TouchEvent]:
    """Read the touches of a CSV, in the order of its lines.

    Parameters
    ----------
    path : path
        With the columns t_s, x_mm and y_mm, and where there are several fingers touch_id. Without a
        column kind, the first line of an id is its "down" and its last is followed by an "up".
        normal_force_n and contact_area_m2 may be missing, as columns or cell by cell.

    Returns
    -------
    list of TouchEvent
        As recorded, even if out of order, not finite or twice at one time: `Touches` sorts them.

    Raises
    ------
    FileFormatError, InputError
        If the file is not such a table; the message names the line.
    """
    events: list[TouchEvent] = []
    seen: dict[int, int] = {}
    has_kinds = False
    for row in read_csv(path, _REQUIRED, _OPTIONAL):
        cells = row.cells
        t_s, x_mm, y_mm = (row.number(name) for name in _REQUIRED)
        touch_id = row.whole("touch_id") if "touch_id" in cells else 0
        has_kinds = "kind" in cells
        kind = cells["kind"].strip() if has_kinds else "move" if touch_id in seen else "down"
        known = next((k for k in KINDS if k == kind), None)
        if known is None:
            raise InputError(f"{row.place}: kind: expected {', '.join(KINDS)}, got {kind!r}")
        force, area = (
            row.number(name) if cells.get(name, "").strip() else None for name in _OPTIONAL[2:]
        )
        seen[touch_id] = len(events)
        events.append(TouchEvent(t_s, touch_id, x_mm, y_mm, known, force, area))
    if not events:
        raise InputError(f"{path}: expected at least one touch, got none; is the file empty?")
    if not has_kinds:
        # From the end, so that the places still to come stay where they are.
        for last in sorted(seen.values(), reverse=True):
            events.insert(last + 1, events[last]._replace(kind="up"))
    return events


def events_of(path: Trajectory, touch_id: int = 0) -> list[TouchEvent]:
    """Return a path as the events of one touch: down, moves, and up at the last place."""
    columns = (path.t_s, path.x_mm, path.y_mm, path.normal_force_n)
    rows = zip(*(column.tolist() for column in columns), strict=True)
    moves = [TouchEvent(t, touch_id, x, y, "move", force) for t, x, y, force in rows]
    return [moves[0]._replace(kind="down"), *moves[1:], moves[-1]._replace(kind="up")]


def paced(
    events: Iterable[TouchEvent],
    speed: float = 1.0,
    clock: Callable[[], float] = time.monotonic,
    sleep: Callable[[float], None] = time.sleep,
) -> Iterator[TouchEvent]:
    """Yield events at their times, with time stamps of the clock.

    Parameters
    ----------
    events : iterable of TouchEvent
        A recording. An event of an earlier time than the one before comes at once.
    speed : float
        2 plays twice as fast.
    clock, sleep : callable
        What to read, and how to wait [s].
    """
    checks.positive("speed", speed)
    offset_s: float | None = None
    for event in events:
        if offset_s is None:
            offset_s = clock() - event.t_s / speed
        due_s = event.t_s / speed + offset_s
        # Written so that a time that is not a number comes at once.
        if (wait_s := due_s - clock()) > 0:
            sleep(wait_s)
        yield event._replace(t_s=due_s)
