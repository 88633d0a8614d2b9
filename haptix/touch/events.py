"""The reports of a touchscreen: one touch at one time."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

TouchKind = Literal["down", "move", "up"]
KINDS: tuple[TouchKind, ...] = ("down", "move", "up")

LARGEST_MM = 1e4
"""Ten metres; larger numbers are not in millimetres."""
LARGEST_S = 1e10
"""Some 300 years, so clocks that count from 1970 pass; larger numbers are in ms or ns."""


class TouchEvent(NamedTuple):
    """One report of one touch; nothing is checked before a tracker takes it.

    Parameters
    ----------
    t_s : float
        Time stamp [s] on the renderer's clock.
    touch_id : int
        Which finger; the same from "down" to "up".
    x_mm, y_mm : float
        Place on the screen. That of an "up" is not used: it often repeats an old place.
    kind : {"down", "move", "up"}
        What happened.
    normal_force_n : float, optional
        Normal force [N], above 0, where the screen measures it.
    contact_area_m2 : float, optional
        Area of contact [m^2], above 0, where the screen measures it.
    """

    t_s: float
    touch_id: int
    x_mm: float
    y_mm: float
    kind: TouchKind = "move"
    normal_force_n: float | None = None
    contact_area_m2: float | None = None


def problem_of(event: Any, checks_force: bool = True) -> str | None:
    """Return what is wrong with an event: field, expected and given value; None if nothing.

    Without `checks_force` any force and area pass.
    """
    try:
        t_s, touch_id, x_mm, y_mm, kind, force, area = event
    except (TypeError, ValueError):
        return f"touch: expected a TouchEvent, got {event!r}"
    if type(touch_id) is not int:
        return f"touch: touch_id: expected an integer, got {touch_id!r}"
    if kind not in KINDS:
        return f'touch {touch_id}: kind: expected "down", "move" or "up", got {kind!r}'
    if kind == "up":
        return None
    for name, value, largest, unit in (
        ("t_s", t_s, LARGEST_S, "seconds"),
        ("x_mm", x_mm, LARGEST_MM, "millimetres"),
        ("y_mm", y_mm, LARGEST_MM, "millimetres"),
    ):
        if not _within(value, -largest, largest):
            return (
                f"touch {touch_id}: {name}: expected a finite number of {unit}, "
                f"{largest:g} at most, got {value!r}"
            )
    measured = (("normal_force_n", force, "N"), ("contact_area_m2", area, "m^2"))
    for name, value, unit in measured if checks_force else ():
        if value is not None and not _within(value, 5e-324, sys.float_info.max):
            return (
                f"touch {touch_id}: {name}: expected a finite number above 0 {unit}, or None "
                f"where the screen measures none, got {value!r}"
            )
    return None


def _within(value: Any, low: float, high: float) -> bool:
    try:
        return bool(low <= value <= high)
    except (TypeError, ValueError):
        return False


@dataclass(slots=True)
class TouchCounts:
    """Numbers of events by what became of them, over all touches."""

    taken: int = 0
    """Events that went into a filter, including the next two kinds."""
    reordered: int = 0
    """Arrived after a later one and were sorted in."""
    coalesced: int = 0
    """Replaced the report before, of the same or nearly the same time."""
    late: int = 0
    """Dropped: too old to be sorted in, or of a touch that has ended."""
    clock_jumps: int = 0
    """Times that a touch was restarted because its clock ran backwards."""
    invalid: int = 0
    """Dropped: not finite, too large, or not an event."""
    bad_force: int = 0
    """Unusable forces and areas; the place of the event was used."""
    without_down: int = 0
    """Touches that began with a "move"."""
    without_up: int = 0
    """Touches that ended because their id came down again, or to make room."""
    unknown_up: int = 0
    """Dropped: "up" of an unknown touch."""
    crowded: int = 0
    """Dropped: more touches at once than allowed."""
