"""Status of a sample: solved, or why not; and the declared limits of the model, with reasons.

A state past a limit names it in its status. docs/limits.md has the sources of the limits.
"""

from __future__ import annotations

from enum import IntEnum
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from torch import Tensor


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
    """Friction is beyond what skin has, see `LIMITS`."""
    PRESSURE = 7
    """The pressure in the contact spots is beyond what skin bears, see `LIMITS`."""


class Limit(NamedTuple):
    """Largest value with which a state is OK."""

    most: float
    words: str
    """What lies past it, and why no finger is like that."""


LIMITS = {
    # p/p0: beyond, the contact is held by its own attraction, and grows a hundredfold in a few
    # volts (`haptix.model.fidelity.mean_field`).
    Status.PULL_IN: Limit(31.0, "light contact has ended"),
    # mu: published friction of skin is typically 0.5 where dry and above 1 where moist or wet.
    Status.FRICTION: Limit(5.0, "friction above 5, several times what skin is known for"),
    # Spots [Pa]: tau_f is fitted at up to 50 MPa, the hardness at which the spots of dry skin
    # yield. Twice that leaves room for the attraction in the spots; no skin is known beyond.
    Status.PRESSURE: Limit(100e6, "more than 100 MPa in the contact spots, twice what skin bears"),
    # Share of the whole attraction: the paper's theory, which knows no breakdown, agrees with its
    # measurements up to 200 V, where the share is two thirds. Nothing supports it far beyond.
    Status.BREAKDOWN: Limit(
        0.75, "more than three quarters of the attraction from gaps past what they bear"
    ),
}


def past_limits(status: Tensor, mu: Tensor, spot_pressure_pa: Tensor) -> Tensor:
    """Add the limits of friction and pressure to a `Status` that leaves them out."""
    for reason, value in ((Status.FRICTION, mu), (Status.PRESSURE, spot_pressure_pa)):
        past = (status == int(Status.OK)) & ~(value.detach() <= LIMITS[reason].most)
        status = status.masked_fill(past, int(reason))
    return status


def limits_passed(status: Tensor) -> list[str]:
    """Name the limits that some of the states are past, and how many of them.

    Examples
    --------
    >>> import torch
    >>> limits_passed(torch.tensor([int(Status.OK)]))
    []
    """
    counts = ((limit.words, int((status == int(past)).sum())) for past, limit in LIMITS.items())
    return [f"{words} ({count} of {status.numel()})" for words, count in counts if count]
