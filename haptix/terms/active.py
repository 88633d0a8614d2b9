"""The terms that are on, applied stage by stage."""

from __future__ import annotations

from collections.abc import Iterable
from functools import reduce

import numpy as np
import torch
from torch import Tensor

from haptix.contact import ElasticSolid, HalfSpace, MeanField
from haptix.electro import FieldLimit
from haptix.errors import InputError
from haptix.status import Status
from haptix.terms.registry import TERMS
from haptix.terms.term import FieldInGap, Properties, Stage

_STEADY_HZ = 1e-9  # of a steady voltage: a period of 30 years, in which all that leaks conducts


class ActiveTerms:
    """Properties of finger and screen with the terms that are on."""

    def __init__(self, given: Properties, names: Iterable[str]) -> None:
        on = set(names)
        self.given = given
        self.all = tuple(term for name, term in TERMS.items() if name in on)
        self.stages = frozenset[Stage]().union(*(term.stages for term in self.all))

    def solid(self) -> ElasticSolid:
        """The elastic solid, from a half-space of the stratum corneum."""
        finger = self.given.finger
        base: ElasticSolid = HalfSpace(finger.youngs_modulus_pa, finger.poisson_ratio)
        return reduce(lambda solid, term: term.solid(solid, self.given), self.all, base)

    def hardness_pa(self) -> float | Tensor | None:
        """Stress [Pa] at which the skin yields; None for elastic skin."""
        none: float | Tensor | None = None
        return reduce(lambda hardness, term: term.hardness(hardness, self.given), self.all, none)

    def apparent_area_m2(self, normal_force_n: Tensor) -> Tensor:
        """A0 [m^2] at normal forces [N] of any shape, from that at 1 N."""
        at_1n = self.given.finger.apparent_area_m2(torch.ones_like(normal_force_n))
        return reduce(
            lambda area, term: term.size(area, normal_force_n, self.given), self.all, at_1n
        )

    def widest_gap_m(self, area_m2: Tensor, contact: MeanField) -> Tensor | None:
        """Largest mean gap [m] at apparent areas [m^2]; None for no limit."""
        none: Tensor | None = None
        return reduce(lambda widest, term: term.gaps(widest, area_m2, contact), self.all, none)

    def thickness(self, h0_m: Tensor, frequency_hz: Tensor | None) -> Tensor:
        """Complex effective thickness [m] of everything that insulates, from that of the film.

        Frequencies [Hz] broadcast with `h0_m`; 0 is a steady voltage. Without one the skin counts
        as a conductor, and `h0_m` is returned unchanged, unless a term needs a frequency: that is
        an `InputError`.
        """
        if frequency_hz is None:
            if needing := [term.name for term in self.all if term.needs_frequency]:
                raise InputError(
                    f'frequency_hz: expected one, since the term "{needing[0]}" depends on it; '
                    "give one or switch the term off"
                )
            return h0_m
        frequency = frequency_hz.clamp(min=_STEADY_HZ)
        thickness = torch.complex(h0_m, torch.zeros_like(h0_m))
        for term in self.all:
            thickness = term.insulators(thickness, frequency, self.given)
        return thickness.expand(np.broadcast_shapes(h0_m.shape, frequency.shape))

    def field_limit(self) -> FieldLimit | None:
        """Field [V/m] at which gaps are held; None for no limit."""
        none: FieldLimit | None = None
        return reduce(lambda limit, term: term.pull(limit, self.given), self.all, none)

    def gap_permittivity(self, frequency_hz: Tensor) -> Tensor | float:
        """Complex eps_g of what fills the gap, at frequencies [Hz]."""
        one: Tensor | float = 1.0
        return reduce(
            lambda eps, term: eps * term.gap_permittivity(frequency_hz, self.given), self.all, one
        )

    def voltage_share(self, capacitance_f: Tensor) -> Tensor:
        """Complex share of the drive's voltage that contacts of a capacitance [F] have."""
        whole = torch.ones_like(capacitance_f)
        return reduce(
            lambda share, term: term.supply(share, capacitance_f, self.given), self.all, whole
        )

    def status(self, is_stable: Tensor, field: FieldInGap) -> Tensor:
        """`haptix.Status` of states whose light contact holds or not, given their field."""
        light = torch.where(is_stable, int(Status.OK), int(Status.PULL_IN))
        return reduce(lambda status, term: term.status(status, field, self.given), self.all, light)

    def placeholders(self) -> list[str]:
        """Names of the unmeasured values that the terms rest on."""
        return [name for term in self.all for name in term.placeholders(self.given)]
