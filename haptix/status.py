"""Status of a sample: solved, or the reason why it is not."""

from __future__ import annotations

from enum import IntEnum


class Status(IntEnum):
    """Outcome of one sample; tensors of status hold these numbers.

    Examples
    --------
    >>> Status(0)
    <Status.OK: 0>
    """

    OK = 0
    """Solved, or in the reachable range."""
    PULL_IN = 1
    """The light contact snaps in below this voltage; values are those at that point."""
    BELOW = 2
    """The target is below the friction without voltage; 0 V is returned."""
    ABOVE = 3
    """The target is above the friction at the highest voltage; that voltage is returned."""
    OUT_OF_RANGE = 4
    """The query lies outside the axes of the surface; values are those at its edge."""
    BREAKDOWN = 5
    """The field is beyond the strength of gap or insulator; values assume no sparks."""
    FRICTION = 6
    """Friction is beyond what skin has, see `haptix.limits`."""
    PRESSURE = 7
    """The pressure in the contact spots is beyond what skin bears, see `haptix.limits`."""
