"""The declared limits of the model and their reasons. A state past one names it in its status.

docs/limits.md has their sources.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from haptix.status import Status

if TYPE_CHECKING:
    from torch import Tensor


class Limit(NamedTuple):
    """Largest value with which a state is OK."""

    most: float
    words: str
    """What lies past it, and why no finger is like that."""


LIMITS = {
    # p/p0: beyond, the contact is held by its own attraction, and grows a hundredfold in a few
    # volts (`haptix.fidelity.mean_field`).
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
    """Add the limits of friction and pressure to a `haptix.Status` that leaves them out."""
    for reason, value in ((Status.FRICTION, mu), (Status.PRESSURE, spot_pressure_pa)):
        past = (status == int(Status.OK)) & ~(value.detach() <= LIMITS[reason].most)
        status = status.masked_fill(past, int(reason))
    return status


def limits_passed(status: Tensor) -> list[str]:
    """Say which limits some of the states are past, and how many of them.

    Examples
    --------
    >>> import torch
    >>> limits_passed(torch.tensor([int(Status.OK)]))
    []
    """
    counts = ((limit.words, int((status == int(past)).sum())) for past, limit in LIMITS.items())
    return [f"{words} ({count} of {status.numel()})" for words, count in counts if count]
