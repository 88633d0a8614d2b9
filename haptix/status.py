"""What became of a sample: solved, or why not."""

from __future__ import annotations

from enum import IntEnum


class Status(IntEnum):
    """Outcome of one sample; tensors of status hold these numbers."""

    OK = 0
    """Solved, or reachable."""
    PULL_IN = 1
    """The voltage is past the light contact: it snaps in. Values are those at the branch's end."""
    BELOW = 2
    """The wanted friction is below what the contact has without voltage; 0 V is returned."""
    ABOVE = 3
    """The wanted friction is above what the highest voltage gives; that voltage is returned."""
    OUT_OF_RANGE = 4
    """The query lies outside the axes of the surface; values are those at its edge."""
    BREAKDOWN = 5
    """The field is beyond what the gap or the insulator bears; the values hold without sparks."""
