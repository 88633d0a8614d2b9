"""Interface of a term: a change to one or more stages between a load and its friction."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from math import inf
from operator import attrgetter
from typing import ClassVar

import torch
from torch import Tensor

from haptix.contact import ElasticSolid, MeanField
from haptix.electro import FieldLimit
from haptix.finger import Finger
from haptix.screen import Screen
from haptix.states import ContactState
from haptix.status import Status

PNAS_2018 = "Ayyildiz, Scaraggi, Sirin, Basdogan, Persson, PNAS 115, 12668 (2018)"

FieldInGap = Callable[[float], Tensor]
"""Magnitude of the field [V/m] in a gap of given width [m]; 0 is the edge of a contact spot."""


class Stage(StrEnum):
    """A stage between a load and its friction, named as the method by which a term changes it."""

    SOLID = "solid"
    SIZE = "size"
    INSULATORS = "insulators"
    PULL = "pull"
    GAPS = "gaps"
    HARDNESS = "hardness"
    SUPPLY = "supply"
    STATUS = "status"


@dataclass(frozen=True)
class Properties:
    """Finger and screen, as terms read them."""

    finger: Finger
    screen: Screen
    """Their fields are numbers, or tensors with one value per state."""
    unit_pa: float | Tensor = 1.0
    """Pressure that counts as 1 Pa in the fidelity's tables: a fit scales one to many moduli."""


class Term:
    """An effect that the contact model can leave out.

    A term overrides the methods of the stages that it changes. Each method gets the value of its
    stage so far and returns the changed one; terms act in the order of `haptix.terms.TERMS`.
    """

    name: ClassVar[str]
    summary: ClassVar[str]  # part of a surface's model hash: another wording is another model
    source: ClassVar[str]
    uses: ClassVar[tuple[str, ...]]
    """Fields that it reads, such as "finger.hardness_pa"; it is possible where all have a value."""
    needs_frequency: ClassVar[bool] = False
    """Whether a drive of unknown frequency is an error, or just leaves the term out."""
    on_request: ClassVar[bool] = False
    """Whether it is off unless requested. Others are on wherever they are possible."""
    left_to_scene: ClassVar[bool] = False
    """Whether planning measures what it does, and has it on only where the scene asks for it."""
    work: ClassVar[float] = 0.1
    """Share of a surface's build time that leaving it out saves, at most; planning weighs effects
    with it. Most save next to nothing, and get some credit for a simpler model."""
    reports: ClassVar[Status | None] = None
    """The status that it gives, if it gives one."""

    @property
    def stages(self) -> frozenset[Stage]:
        """Stages that it changes."""
        return frozenset(s for s in Stage if getattr(type(self), s) is not getattr(Term, s))

    @property
    def changes_friction(self) -> bool:
        """False where it gives a status and nothing else."""
        return self.stages != {Stage.STATUS}

    def parameters(self, finger: Finger, screen: Screen) -> dict[str, object]:
        """Values of the fields that it uses, by name."""
        given = Properties(finger, screen)
        return {name: attrgetter(name)(given) for name in self.uses}

    def missing(self, finger: Finger, screen: Screen) -> list[str]:
        """Fields that it uses and that the profiles do not have."""
        return [name for name, value in self.parameters(finger, screen).items() if value is None]

    def solid(self, solid: ElasticSolid, given: Properties) -> ElasticSolid:
        """Elasticity of the finger; from a half-space of the stratum corneum."""
        return solid

    def size(self, area_m2: Tensor, normal_force_n: Tensor, given: Properties) -> Tensor:
        """Apparent contact area [m^2] at normal forces [N]; from that at 1 N."""
        return area_m2

    def insulators(self, h0_m: Tensor, frequency_hz: Tensor, given: Properties) -> Tensor:
        """Complex effective thickness [m] at frequencies [Hz]; from that of the screen's film."""
        return h0_m

    def pull(self, limit: FieldLimit | None, given: Properties) -> FieldLimit | None:
        """Field [V/m] at which gaps are held; from None, for no limit."""
        return limit

    def gap_permittivity(self, frequency_hz: Tensor, given: Properties) -> Tensor | float:
        """Complex eps_g of what fills the gap, at frequencies [Hz]; 1 for dry air.

        It is for the current, and belongs to `insulators`, where it acts on the field.
        """
        return 1.0

    def gaps(self, widest_m: Tensor | None, area_m2: Tensor, contact: MeanField) -> Tensor | None:
        """Largest mean gap [m] of an apparent area [m^2]; from None, for no limit."""
        return widest_m

    def hardness(
        self, hardness_pa: float | Tensor | None, given: Properties
    ) -> float | Tensor | None:
        """Stress [Pa] at which the skin yields; from None, for elastic skin."""
        return hardness_pa

    def supply(self, share: Tensor, capacitance_f: Tensor, given: Properties) -> Tensor:
        """Complex share of the drive's voltage that a contact has; from all of it.

        The contact's own complex capacitance is given [F], see `haptix.electro.circuit`.
        """
        return share

    def status(self, status: Tensor, field: FieldInGap, given: Properties) -> Tensor:
        """`haptix.Status` of states; from OK, or PULL_IN where the light contact has ended."""
        return status

    def voltage_limit(self, state: ContactState) -> Tensor:
        """Amplitude [V] from which it reports its status; infinite without a status."""
        return torch.full_like(state.mu, inf)

    def placeholders(self, given: Properties) -> list[str]:
        """Names of the unmeasured values that it rests on."""
        return []
