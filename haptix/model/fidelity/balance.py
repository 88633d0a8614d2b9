"""The interface of every fidelity: its contact, its load and its result."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from enum import StrEnum
from typing import ClassVar, Self

import torch
from torch import Tensor

from haptix.model.contact import ContactSpots, MeanField
from haptix.model.contact.area import PlasticSplit, elastoplastic_area
from haptix.model.electro import Pull, VoltageShare
from haptix.model.fidelity.box import BoxedFinger
from haptix.model.status import LIMITS, Status
from haptix.model.terms import Stage

LIGHT_CONTACT_LIMIT = LIMITS[Status.PULL_IN].most
"""Largest p/p0 that counts as light contact: the bound of the reference solver (section 5)."""

_ALL_YIELDS = 1.01  # A hardness/p: 1 where the hardness bears all of the load


class Ability(StrEnum):
    """Ability that some fidelities lack; the value completes "a fidelity that ..."."""

    TABULATE = "gives the pull-in of every state"
    INSTANTS = "solves thousands of instants of any drive"
    RESCALE = "has one table for all moduli and heights"
    SCATTER = "solves random surfaces one by one"


@dataclass(frozen=True)
class Contact:
    """The contact that a fidelity solves."""

    field: MeanField
    contact_spots: ContactSpots
    """Whether the attraction inside the contact spots loads the contact."""
    hardness_pa: float | Tensor | None
    """Stress [Pa] at which the skin yields; None for elastic skin."""
    reference_pa: float
    """A usual applied pressure [Pa]: where an approximation is exact."""
    boxed: BoxedFinger | None = None
    """Random surfaces, for a fidelity that solves them."""
    on_progress: Callable[[float], None] | None = None
    """Called with the share of a solve that is done, where it takes long."""

    def area_fraction(self, pressure_pa: Tensor) -> Tensor:
        """A/A0 at pressures [Pa]: elastic, or elastoplastic where there is a hardness."""
        if self.hardness_pa is None:
            return self.field.area_fraction(pressure_pa)
        return self.plastic_split(pressure_pa, self.hardness_pa).total

    def plastic_split(self, pressure_pa: Tensor, hardness_pa: float | Tensor) -> PlasticSplit:
        """A/A0 of spots that yield and of the others.

        Parameters
        ----------
        pressure_pa : Tensor
            Pressures [Pa].
        hardness_pa : float or Tensor
            The hardness at which spots yield [Pa].
        """
        spread = pressure_pa / self.field.area_argument(pressure_pa)
        return elastoplastic_area(pressure_pa, spread, hardness_pa)

    def yielded_area(self, pressure_pa: Tensor) -> Tensor:
        """A/A0 at pressures [Pa] where all contact spots yield, to 1 % of it; 0 elsewhere."""
        if self.hardness_pa is None:
            return torch.zeros_like(pressure_pa)
        area = self.area_fraction(pressure_pa)
        yields = area * self.hardness_pa <= _ALL_YIELDS * pressure_pa
        return torch.where(yields, area, torch.zeros_like(area))


@dataclass(frozen=True)
class Load:
    """A flat batch of states."""

    applied_pa: Tensor
    """``p0 = F_N/A0`` [Pa], shape (states,)."""
    pull: Pull
    widest_gap_m: Tensor | None = None
    """Largest mean gap [m], shape (states,); None for no limit."""
    area_m2: Tensor | None = None
    """Apparent area A0 [m^2], shape (states,); needed with `voltage_share`."""
    voltage_share: VoltageShare | None = None
    """Share of the drive's voltage that lies on the contact; None for all of it."""
    of_end: bool = False
    """Whether the pull's strength is a share of the one at which light contact ends."""


Join = Callable[[list[Tensor]], Tensor]


@dataclass(frozen=True)
class Balance:
    """Equilibrium of each state, all of shape (states,)."""

    pressure_pa: Tensor
    area_fraction: Tensor
    gap_attraction_pa: Tensor
    spot_attraction_pa: Tensor
    mean_gap_m: Tensor
    strength_at_end: Tensor
    """``eps0 V0^2/4`` [N] at which the light contact ends."""
    is_stable: Tensor
    voltage_share: Tensor
    """Magnitude of the share of the drive's voltage that lies on the contact."""

    @classmethod
    def joined(cls, parts: Sequence[Self], join: Join = torch.cat) -> Self:
        """Join batches (by `torch.cat`), or single states (by `torch.stack`).

        Parameters
        ----------
        parts : sequence of Balance
        join : callable
            Makes one tensor of a list of them.
        """
        columns = ([getattr(part, field.name) for part in parts] for field in fields(cls))
        return cls(*(join(column) for column in columns))


class Fidelity(ABC):
    """A way to solve a contact."""

    name: ClassVar[str]
    assumes: ClassVar[str]
    """Why it leaves some stages out; completes "a fidelity, which ..."."""
    honours: ClassVar[frozenset[Stage]]
    """Stages of `haptix.model.terms` that it takes into account."""
    can: ClassVar[frozenset[Ability]]

    def __init__(self, contact: Contact) -> None:
        self.contact = contact

    @abstractmethod
    def solve(self, load: Load) -> Balance:
        """Return the equilibrium of every state on the lowest branch."""

    def gap_mass(
        self, applied_pa: Tensor, widest_gap_m: Tensor | None, pressure_pa: Tensor
    ) -> Tensor:
        """Share of the area in each bin of the field's `gap_edges_m`, shape (states, bins).

        The states are solved ones, with their applied pressure [Pa], widest gap [m] and effective
        pressure [Pa]. By default the shares are those of the mean field.

        Parameters
        ----------
        applied_pa : Tensor, shape (states,)
            Applied pressure p0 of the solved states [Pa].
        widest_gap_m : Tensor or None
            Largest mean gap of each [m]; None for no limit.
        pressure_pa : Tensor, shape (states,)
            Pressure that each carries [Pa].
        """
        pressure, state = pressure_pa.unique(return_inverse=True)
        return self.contact.field.gap_histogram(pressure).mass[state]

    def prepare(self, applied_pa: Tensor, widest_gap_m: Tensor | None) -> None:  # noqa: B027
        """Make the tables that all of these loads share; by default there are none.

        Parameters
        ----------
        applied_pa : Tensor, shape (states,)
            Applied pressures p0 [Pa] of all loads.
        widest_gap_m : Tensor or None
            Largest mean gap of each [m]; None for no limit.
        """

    def release(self) -> None:  # noqa: B027
        """Drop the tables of `prepare` that must not outlive its loads; by default none exist."""

    def borrow(self, other: Fidelity) -> bool:
        """Use the tables of another fidelity of the same contact; return whether it has any."""
        return False
