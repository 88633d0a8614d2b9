"""Forms of the mean field: choices that belong together, under one name."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import torch

from haptix.contact.area import AreaLaw
from haptix.contact.elasticity import ElasticSolid
from haptix.contact.finite_size import SizeLaw
from haptix.contact.meanfield import ContactSpots, GapDistribution, MeanField
from haptix.contact.roughness import RoughnessSpectrum

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
    power: float = 3.0
    """Power of the area in the rest of the elastic energy."""
    reach: float = 1.0
    """How many times shorter the waves are that a wave's own energy follows."""
    size: SizeLaw = "capped"
    """How a contact of finite size leaves that of infinite size."""
    usual_terms: frozenset[str] = frozenset()
    """Terms on request that this form has on by default."""

    def mean_field(
        self,
        spectrum: RoughnessSpectrum,
        modulus: ElasticSolid,
        gamma: float | None = None,
        gap_distribution: GapDistribution | None = None,
        device: torch.device | str = "cpu",
    ) -> MeanField:
        """Contact of a rough solid in this form, unless gamma or the gaps are given."""
        return MeanField(
            spectrum,
            modulus,
            gamma=self.gamma if gamma is None else gamma,
            gap_distribution=gap_distribution or self.gap_distribution,
            device=device,
            area=self.area,
            power=self.power,
            reach=self.reach,
            size=self.size,
        )


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
        AreaLaw(0.48, tips=0.022),
        0.315,
        "combined",
        "excluded",
        "area after Xu (2024); gamma, reach, power, tips by boundary elements (docs/mean-field.md)",
        power=2.0,
        reach=1.3,
        size="smooth",
        usual_terms=frozenset({"finite-size"}),
    ),
}
"""Forms of the mean field by name."""

VALIDATED_X = 5e-5
"""Lowest ``x = p0/(E* slope)`` of boundary elements that the corrected theory was tested on without
having been fitted to them (docs/mean-field.md)."""

VALIDATED_WAVES = 4.0
"""Fewest waves of the roll-off, ``A0 (q_r/2 pi)^2``, under a contact of that comparison."""

SHOWN_ERRORS = ((5e-4, 3, 9, 8), (VALIDATED_X, 5, 28, 5))
"""Lowest x, and what was shown from there to the x before: median and largest error of the area,
largest error of the mean gap, in per cent of boundary elements, without voltage."""


def beyond_validation(x: float, rolloff_waves: float) -> list[str]:
    """Say what of a contact lies below what was validated; lowest values are given."""
    found = []
    if x < VALIDATED_X:
        found.append(f"x = p0/(E* slope) from {x:.2g}: validated from {VALIDATED_X:g}")
    if rolloff_waves < VALIDATED_WAVES:
        found.append(
            f"{rolloff_waves:.3g} waves of the roll-off: validated from {VALIDATED_WAVES:g}"
        )
    return found


def shown_accuracy(theory: TheoryName, x: float) -> str:
    """Say which errors a theory was shown to have at a lowest x; empty where nothing was shown."""
    if theory != "corrected":
        return ""
    for least, median, worst, gap in SHOWN_ERRORS:
        if x >= least:
            return f"area within {worst} % ({median} % in the median), mean gap within {gap} %"
    return ""
