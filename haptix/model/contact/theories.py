"""Forms of the mean field by name, and a cache of the contacts that they have solved."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import torch
from torch import Tensor

from haptix.model.contact.area import AreaLaw
from haptix.model.contact.elasticity import ElasticSolid, HalfSpace, Layered
from haptix.model.contact.finite_size import SizeLaw
from haptix.model.contact.persson import ContactSpots, GapDistribution, MeanField
from haptix.model.contact.roughness import RoughnessSpectrum

TheoryName = Literal["local", "corrected", "open-gaps", "as-published"]

_CACHED_CONTACTS = 16  # each takes some 2 MB


@dataclass(frozen=True)
class Theory:
    """One form of the mean field: choices that belong together, under one name."""

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
    """`MeanField`'s `reach`: how many times shorter the waves are whose area sets a wave's
    energy."""
    size: SizeLaw = "capped"
    """How a contact of finite size leaves that of infinite size."""
    usual_terms: frozenset[str] = frozenset()
    """Optional terms that this form switches on by default."""

    def mean_field(
        self,
        spectrum: RoughnessSpectrum,
        modulus: ElasticSolid,
        gamma: float | None = None,
        gap_distribution: GapDistribution | None = None,
        device: torch.device | str = "cpu",
    ) -> MeanField:
        """Contact of a rough solid in this form; `gamma` and `gap_distribution` replace the form's.

        Equal contacts that need no gradients are one cached object, with the tables that it has
        solved.

        Parameters
        ----------
        spectrum : RoughnessSpectrum
            Roughness of the solid.
        modulus : ElasticSolid
            Elasticity of the solid.
        gamma, gap_distribution : optional
            As in `MeanField`; the theory's own if not given.
        device : torch.device or str
            Where its tables are.
        """
        gamma = self.gamma if gamma is None else gamma
        gaps = gap_distribution or self.gap_distribution
        known = isinstance(modulus, HalfSpace | Layered)
        numbers = tuple(vars(modulus).values()) if known else ()
        inputs = (spectrum.wavenumber, spectrum.density, *numbers)
        if known and not any(isinstance(value, Tensor) and value.requires_grad for value in inputs):
            waves = tuple(spectrum.wavenumber.tolist()), tuple(spectrum.density.tolist())
            solid = type(modulus), tuple(map(float, numbers))
            return _cached_field(self, waves, solid, gamma, gaps, str(device))
        return self._field(spectrum, modulus, gamma, gaps, device)

    def _field(
        self,
        spectrum: RoughnessSpectrum,
        modulus: ElasticSolid,
        gamma: float,
        gap_distribution: GapDistribution,
        device: torch.device | str,
    ) -> MeanField:
        return MeanField(
            spectrum,
            modulus,
            gamma=gamma,
            gap_distribution=gap_distribution,
            device=device,
            area=self.area,
            power=self.power,
            reach=self.reach,
            size=self.size,
        )


@lru_cache(_CACHED_CONTACTS)
def _cached_field(
    theory: Theory,
    waves: tuple[tuple[float, ...], tuple[float, ...]],
    solid: tuple[type[HalfSpace | Layered], tuple[float, ...]],
    gamma: float,
    gap_distribution: GapDistribution,
    device: str,
) -> MeanField:
    """Contact of plain numbers; the next call with equal ones returns the same object."""
    q, density = (torch.tensor(values, dtype=torch.float64) for values in waves)
    kind, values = solid
    rough = RoughnessSpectrum(q, density)
    return theory._field(rough, kind(*values), gamma, gap_distribution, device)


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
    "local": Theory(
        AreaLaw(0.48, tips=0.022),
        0.315,
        "mean-conserving",
        "widened",
        "as corrected, and the attraction beside the spots widens them (electro/widening.py)",
        power=2.0,
        reach=1.3,
        size="mean-gap",
        usual_terms=frozenset({"finite-size"}),
    ),
}
"""Forms of the mean field by name."""
