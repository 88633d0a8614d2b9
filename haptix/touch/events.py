"""What a touchscreen reports: one touch at one time."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

TouchKind = Literal["down", "move", "up"]
KINDS: tuple[TouchKind, ...] = ("down", "move", "up")

LARGEST_MM = 1e4
"""Ten metres: whoever reports more has not converted to millimetres."""
LARGEST_S = 1e10
"""Some 300 years, so clocks that count from 1970 pass; whoever reports more counts in ms or ns."""


class TouchEvent(NamedTuple):
    """One report of one touch; nothing is checked before a tracker takes it.

    Parameters
    ----------
    t_s : float
        Time stamp [s], of any clock as long as it is the renderer's.
    touch_id : int
        Which finger; the same from "down" to "up".
    x_mm, y_mm : float
        Place on the screen. Not used of an "up", which often repeats an old place.
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


def problem_of(event: Any) -> str | None:
    """Say what is wrong with an event: field, what was expected and what came; None if nothing."""
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
    for name, value, unit in (("normal_force_n", force, "N"), ("contact_area_m2", area, "m^2")):
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
    """How many events met which fate, of all touches together."""

    taken: int = 0
    """Events that went into a filter, those of the next two among them."""
    reordered: int = 0
    """Came after a later one, and were put in their place."""
    coalesced: int = 0
    """Replaced the report before, which came at the same time or hardly earlier."""
    late: int = 0
    """Dropped: older than what can still be put in its place, or of a touch that is over."""
    clock_jumps: int = 0
    """Times that a touch was taken up anew because its clock ran backwards."""
    invalid: int = 0
    """Dropped: not finite, huge, or no event at all."""
    bad_force: int = 0
    """Forces and areas that could not be used; the place was."""
    without_down: int = 0
    """Touches that began with a "move"."""
    without_up: int = 0
    """Touches that ended because their id went down once more, or to make room."""
    unknown_up: int = 0
    """Dropped: "up" of a touch that was not there."""
    crowded: int = 0
    """Dropped: more touches at once than allowed."""
