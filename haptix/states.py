"""Results of the contact model: states, and one period of a drive."""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor


@dataclass(frozen=True)
class ContactState:
    """Solved states; every tensor has the broadcast shape of the inputs.

    Where `status` is `Status.PULL_IN` there is no light contact: the values are those at its end.
    """

    mu: Tensor
    """Friction coefficient, ``tau_f A / F_N``."""
    area_fraction: Tensor
    """Real over apparent contact area, A/A0."""
    pressure_pa: Tensor
    """Effective pressure p that the contact carries."""
    gap_attraction_pa: Tensor
    """Time-averaged attraction of the open gaps."""
    spot_attraction_pa: Tensor
    """Time-averaged attraction inside the contact spots."""
    mean_gap_m: Tensor
    """Mean separation of the surfaces."""
    pull_in_voltage_v: Tensor
    """Amplitude at which the light contact ends."""
    peak_field_v_per_m: Tensor
    """Field at the edge of a contact spot, the highest in any gap."""
    breakdown_voltage_v: Tensor
    """Amplitude from which gap or insulator break down; a status where that term is on."""
    status: Tensor
    """Integers of `Status`."""

    @property
    def attraction_pa(self) -> Tensor:
        """Total time-averaged attraction, gaps and spots."""
        return self.gap_attraction_pa + self.spot_attraction_pa


@dataclass(frozen=True)
class PeriodState:
    """One period of the drive; every tensor has shape (samples,)."""

    t_s: Tensor
    """Time from the start of the period."""
    drive_v: Tensor
    """Voltage of the drive."""
    attraction_pa: Tensor
    """Attraction of gaps and contact spots."""
    pressure_pa: Tensor
    """Effective pressure p that the contact carries."""
    mu: Tensor
    """Friction coefficient."""
    status: Tensor
    """Integers of `Status`."""
