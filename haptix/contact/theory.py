"""Forms of the mean field: choices that belong together, under one name."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from haptix.contact.area import AreaLaw
from haptix.contact.meanfield import ContactSpots, GapDistribution

TheoryName = Literal["corrected", "open-gaps", "as-published"]


@dataclass(frozen=True)
class Theory:
    """One form of the mean field."""

    area: AreaLaw
    """Law of the real contact area."""
    gamma: float
    """Factor of the elastic energy in the separation."""
    gap_distribution: GapDistribution
    """Variance of the gaps."""
    contact_spots: ContactSpots
    """Whether the attraction inside the contact spots presses on the contact."""
    source: str
    """Where the choices come from."""


THEORIES: Mapping[str, Theory] = {
    "as-published": Theory(
        AreaLaw(),
        0.45,
        "plain",
        "included",
        "Ayyildiz et al., PNAS 115, 12668 (2018), Eq. 1-3",
    ),
    "open-gaps": Theory(
        AreaLaw(),
        0.45,
        "plain",
        "excluded",
        "the same, without the attraction inside the contact spots (physics page, section 1)",
    ),
    "corrected": Theory(
        AreaLaw(0.48),
        0.24,
        "combined",
        "excluded",
        "area after Xu (2024); gamma from boundary elements' mean gap (docs/mean-field.md)",
    ),
}
"""Forms of the mean field by name."""
