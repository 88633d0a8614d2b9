"""The contact model: from force and voltage to friction."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import torch
from torch import Tensor

from haptix.contact import ContactSpots, GapDistribution, MeanField
from haptix.contact.meanfield import check_contact_spots
from haptix.electro import AttractionTable, drive_strength, drive_voltage, effective_thickness
from haptix.equilibrium import LIGHT_CONTACT_LIMIT, Equilibrium, lowest_branch
from haptix.errors import InputError, LimitError
from haptix.finger import Finger
from haptix.screen import Screen
from haptix.status import Status

_BLOCK = 4096  # states solved together: bounds the memory, and fits the cache


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
    """Time-averaged pull of the open gaps."""
    spot_attraction_pa: Tensor
    """Time-averaged pull inside the contact spots."""
    mean_gap_m: Tensor
    """Mean separation of the surfaces."""
    pull_in_voltage_v: Tensor
    """Amplitude at which the light contact ends."""
    status: Tensor
    """Integers of `Status`."""

    @property
    def attraction_pa(self) -> Tensor:
        """Total time-averaged pull, gaps and spots."""
        return self.gap_attraction_pa + self.spot_attraction_pa


class ContactModel:
    """Friction of a finger on a screen under voltage.

    ``p = F_N/A0 + p_a``, ``p_a = eps0 V0^2 I(p, h0)/4``, ``mu = tau_f A(p)/F_N`` (Ayyildiz et al.,
    PNAS 2018, Eq. 1-3), followed on the lowest branch from V0 = 0.

    Parameters
    ----------
    finger : Finger
        What touches.
    screen : Screen
        What is touched.
    fidelity : {"mean-field"}
        How the contact is solved.
    dtype : torch.dtype
        Of the results; the arithmetic is float64.
    device : str
        Where the tables live.
    contact_spots : {"excluded", "included"}
        Whether the pull inside the contact spots loads the contact. "included" is the paper as
        printed; boundary elements say "excluded".
    gap_distribution : {"plain", "combined"}
        See `haptix.contact.MeanField`.
    """

    def __init__(
        self,
        finger: Finger,
        screen: Screen,
        fidelity: str = "mean-field",
        dtype: torch.dtype = torch.float64,
        device: torch.device | str = "cpu",
        contact_spots: ContactSpots = "excluded",
        gap_distribution: GapDistribution = "plain",
    ) -> None:
        if fidelity != "mean-field":
            raise InputError(f'fidelity: expected "mean-field", got {fidelity!r}')
        if finger.hardness_pa is not None:
            raise InputError(
                f"finger {finger.name!r} has a hardness of {finger.hardness_pa:g} Pa, and this "
                "version solves elastic contact only; use finger.replace(hardness_pa=None), and "
                "expect too small an area, or another preset"
            )
        check_contact_spots(contact_spots)
        self.finger = finger
        self.screen = screen
        self.fidelity = fidelity
        self.dtype = dtype
        self.contact_spots = contact_spots
        self.contact = MeanField(
            finger.roughness.spectrum(),
            finger.solid(),
            gap_distribution=gap_distribution,
            device=device,
        )
        self._table: AttractionTable | None = None

    def describe(self) -> dict[str, Any]:
        """Everything that determines the model's numbers, as plain values for files and hashes."""
        return {
            "fidelity": self.fidelity,
            "contact_spots": self.contact_spots,
            "gap_distribution": self.contact.gap_distribution,
            "dtype": str(self.dtype).removeprefix("torch."),
            "finger": self.finger.model_dump(mode="json"),
            "screen": self.screen.model_dump(mode="json"),
        }

    def solve(
        self,
        normal_force_n: Any,
        voltage_v: Any,
        frequency_hz: Any = None,
        h0_m: Any = None,
    ) -> ContactState:
        """Solve for floats or tensors that broadcast together.

        Parameters
        ----------
        normal_force_n : float or Tensor
            Normal force F_N [N], above 0.
        voltage_v : float or Tensor
            Amplitude V0 [V], 0 to the screen's limit.
        frequency_hz : float, Tensor or None
            Drive frequency [Hz]; None leaves the skin's dielectric out.
        h0_m : float, Tensor or None
            Effective thickness of the screen's insulator [m]; None takes the screen's own.

        Raises
        ------
        InputError
            If a value is not finite or outside its range.
        LimitError
            If a voltage is above the screen's limit.
        """
        force = self._checked("normal_force_n", normal_force_n, "above 0 N")
        voltage = self._checked("voltage_v", voltage_v, "of 0 V or more", zero=True)
        h0 = self._checked("h0_m", self.screen.h0_m if h0_m is None else h0_m, "above 0 m")
        if frequency_hz is not None:
            frequency_hz = self._checked("frequency_hz", frequency_hz, "above 0 Hz")
        self._check_limit(voltage)
        thickness = effective_thickness(
            h0, frequency_hz, self.finger.layer_thickness_m, self.finger.dielectric
        )
        try:
            shape = torch.broadcast_shapes(force.shape, voltage.shape, thickness.shape)
        except RuntimeError:
            raise InputError(
                "expected inputs that broadcast together, got shapes "
                f"{tuple(force.shape)}, {tuple(voltage.shape)}, {tuple(thickness.shape)}"
            ) from None
        column = torch.arange(thickness.numel(), device=thickness.device).reshape(thickness.shape)
        flat = [t.expand(shape).reshape(-1) for t in (force, voltage, column)]
        blocks = [
            self._solve_block(force, voltage, column, thickness.reshape(-1))
            for force, voltage, column in zip(*(t.split(_BLOCK) for t in flat), strict=True)
        ]
        return ContactState(
            *(
                torch.cat([getattr(block, field.name) for block in blocks]).reshape(shape)
                for field in fields(ContactState)
            )
        )

    def _solve_block(
        self, force: Tensor, voltage: Tensor, column: Tensor, thickness: Tensor
    ) -> ContactState:
        # Only the insulators that this block meets: with many, a table of all would not fit.
        used, column = column.unique(return_inverse=True)
        thickness = thickness[used]
        apparent_area = self.finger.apparent_area_m2(force)
        applied = force / apparent_area
        table = self._table_for(applied)
        strength = drive_strength(voltage)
        log_attraction = table.log_inverse_square(thickness, self.contact_spots)
        found: Equilibrium = lowest_branch(applied, strength, log_attraction, column)
        pressure = found.pressure_pa
        area = self.contact.area_fraction(pressure)
        log_pressure = torch.log(pressure)
        counted = strength * torch.exp(log_attraction(log_pressure, column))
        spots = strength * area / thickness.abs()[column] ** 2
        gaps = counted - spots if self.contact_spots == "included" else counted
        friction = self.finger.frictional_shear_stress_pa * area * apparent_area
        return ContactState(
            mu=(friction / force).to(self.dtype),
            area_fraction=area.to(self.dtype),
            pressure_pa=pressure.to(self.dtype),
            gap_attraction_pa=gaps.to(self.dtype),
            spot_attraction_pa=spots.to(self.dtype),
            mean_gap_m=torch.exp(table.log_mean_gap(log_pressure)).to(self.dtype),
            pull_in_voltage_v=drive_voltage(found.strength_at_fold).to(self.dtype),
            status=torch.where(found.is_stable, int(Status.OK), int(Status.PULL_IN)),
        )

    def _table_for(self, applied: Tensor) -> AttractionTable:
        low, high = float(applied.min()), LIGHT_CONTACT_LIMIT * float(applied.max())
        if self._table is None or not self._table.covers(low, high):
            if self._table is not None:
                nodes = self._table.log_pressure.exp()
                low, high = min(low, float(nodes[0])), max(high, float(nodes[-1]))
            self._table = AttractionTable.solve(self.contact, low, high)
        return self._table

    def _checked(self, name: str, value: Any, expected: str, zero: bool = False) -> Tensor:
        try:
            tensor = torch.as_tensor(value, dtype=torch.float64, device=self.contact.device)
        except (TypeError, ValueError, RuntimeError):
            raise InputError(f"{name}: expected numbers {expected}, got {value!r}") from None
        good = tensor.isfinite() & ((tensor >= 0) if zero else (tensor > 0))
        if tensor.numel() == 0 or not bool(good.all()):
            bad = tensor[~good].reshape(-1)
            got = f"{float(bad[0]):g}" if len(bad) else "an empty tensor"
            raise InputError(f"{name}: expected finite values {expected}, got {got}")
        return tensor

    def _check_limit(self, voltage: Tensor) -> None:
        highest = float(voltage.max())
        if highest > self.screen.max_voltage_v:
            raise LimitError(
                f"voltage_v: {highest:g} V is above the limit of {self.screen.max_voltage_v:g} V "
                f"of screen {self.screen.name!r}; lower it (it is rejected, not clamped)"
            )
