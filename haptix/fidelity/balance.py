"""What every fidelity is given, and what it gives back."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from torch import Tensor


@dataclass(frozen=True)
class Load:
    """A flat batch of states.

    Parameters
    ----------
    applied_pa, apparent_area_m2, strength : Tensor, shape (states,)
        ``p0 = F_N/A0`` [Pa], A0 [m^2] and ``eps0 V0^2/4`` [N].
    gap_pull : Tensor, shape (columns, bins)
        Pull per strength [1/m^2] of a gap in each bin of the contact's `gap_edges_m`, for each
        insulator or instant that occurs.
    spot_pull : Tensor, shape (columns,)
        The same of a contact spot.
    column : Tensor of int, shape (states,)
        Which column each state has.
    thickness_m : Tensor, shape (columns,), optional
        h0 [m], real or complex, of each column; None where the drive is not followed in its mean.
    """

    applied_pa: Tensor
    apparent_area_m2: Tensor
    strength: Tensor
    gap_pull: Tensor
    spot_pull: Tensor
    column: Tensor
    thickness_m: Tensor | None = None


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


class Fidelity(Protocol):
    """A way to solve the contact."""

    def prepare(self, applied_pa: Tensor, apparent_area_m2: Tensor) -> None:
        """Make what many loads share, once, for all that will be solved."""
        ...

    def solve(self, load: Load) -> Balance:
        """Return the equilibrium of every state on the lowest branch."""
        ...
