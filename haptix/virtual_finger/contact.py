"""Friction of the contact under a squared field: the model's own equilibrium at each instant."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

from haptix.contact.gaps import bin_inverse_square
from haptix.electro import VACUUM_PERMITTIVITY
from haptix.electro.breakdown import PASCHEN_MINIMUM_GAP_M, PASCHEN_MINIMUM_V, bearable_field
from haptix.errors import InputError
from haptix.fidelity import Load
from haptix.friction import ContactModel
from haptix.status import Status
from haptix.threads import one_thread
from haptix.virtual_finger.gap_field import GapField
from haptix.virtual_finger.played import Excerpt

Array = npt.NDArray[np.float64]
ComplexArray = npt.NDArray[np.complex128]
IntArray = npt.NDArray[np.int64]

_BLOCK = 4096  # instants solved together: their stresses fit the cache
_SHORTED_M = 1e6  # what leaks, or conducts, shorts a steady voltage: no field is left in the gap
_LEAST_STRESS_PA = 1e-9  # below a billionth of any contact's pressure; keeps ln I finite


class GivenContact:
    """The contact of a model, without its drive.

    Parameters
    ----------
    model : ContactModel
        Mean field or closed form.
    h0_m : float
        Effective thickness of the screen's insulator [m].

    Raises
    ------
    InputError
        If the model is solved by boundary elements, whose states take seconds each.
    """

    def __init__(self, model: ContactModel, h0_m: float) -> None:
        if model.fidelity == "boundary-element":
            raise InputError(
                'model: expected fidelity "mean-field" or "closed-form", got "boundary-element", '
                "which takes seconds for each of the 10,000 instants in a second"
            )
        self.model = model
        self._h0 = torch.tensor(h0_m, dtype=torch.float64, device=model.contact.device)

    def thickness_m(self, frequency_hz: Array) -> ComplexArray:
        """h0 [m] at frequencies [Hz]; to a steady voltage skin and leaky gap are conductors."""
        steady = frequency_hz == 0
        frequency = torch.from_numpy(np.where(steady, 1.0, frequency_hz)).to(self._h0.device)
        found = self.model.effective_thickness(self._h0, frequency).detach().cpu().numpy()
        at_rest = _SHORTED_M if "leaky-gap" in self.model.terms else float(self._h0)
        return np.where(steady, at_rest, found)

    @property
    def widest_gap_m(self) -> float:
        """Upper edge of the widest gaps [m]."""
        return float(self.model.contact.gap_edges_m[-1])

    @one_thread()
    def friction(
        self, normal_force_n: Array, squares: Array, field: GapField
    ) -> tuple[Array, IntArray]:
        """Friction coefficient and `haptix.Status` in equilibrium at each instant.

        Parameters
        ----------
        normal_force_n : ndarray, shape (instants,)
            Above 0 N.
        squares : ndarray, shape (points, instants)
            ``(E (u + h))^2`` [V^2] at the points of `field`.
        """
        device = self.model.contact.device
        pull_of_gap, pull_of_spot = self._pulls(field)
        force = torch.from_numpy(normal_force_n).to(device)
        area = self._apparent_area_m2(force)
        self.model.solver.prepare(force / area, area)
        voltage2 = torch.from_numpy(squares.T.copy()).to(device)
        done = [
            self._solve(force[at], area[at], voltage2[at], pull_of_gap, pull_of_spot)
            for at in (slice(first, first + _BLOCK) for first in range(0, len(force), _BLOCK))
        ]
        mu, stable = (
            torch.cat(column).detach().cpu().numpy() for column in zip(*done, strict=True)
        )
        return mu, np.where(stable, int(Status.OK), int(Status.PULL_IN))

    def _solve(
        self,
        force: Tensor,
        area: Tensor,
        voltage2: Tensor,
        pull_of_gap: Tensor,
        pull_of_spot: Tensor,
    ) -> tuple[Tensor, Tensor]:
        load = Load(
            applied_pa=force / area,
            apparent_area_m2=area,
            strength=torch.ones_like(force),
            gap_pull=(voltage2 @ pull_of_gap).clamp(min=_LEAST_STRESS_PA),
            spot_pull=(voltage2 @ pull_of_spot).clamp(min=_LEAST_STRESS_PA),
            column=torch.arange(len(force), device=force.device),
        )
        found = self.model.solver.solve(load)
        shear = self.model.finger.frictional_shear_stress_pa
        return shear * found.area_fraction * area / force, found.is_stable

    def _pulls(self, field: GapField) -> tuple[Tensor, Tensor]:
        """Stress [Pa/V^2] on gaps in each bin, and on a spot, per point: ``eps0 E^2 / 2``."""
        edges = self.model.contact.gap_edges_m
        middle = (edges[:-1] * edges[1:]).sqrt().cpu().numpy()
        basis = torch.from_numpy(field.basis_of_gaps(np.append(middle, 0.0))).to(edges.device)
        reference = edges.new_tensor(field.reference_m)
        pull = VACUUM_PERMITTIVITY / 2 * bin_inverse_square(edges, reference)
        spot = VACUUM_PERMITTIVITY / 2 / reference**2
        return basis[:, :-1] * pull, basis[:, -1] * spot

    def _apparent_area_m2(self, force: Tensor) -> Tensor:
        finger = self.model.finger
        grows = "apparent-area" in self.model.terms
        return finger.apparent_area_m2(force if grows else torch.ones_like(force))

    def breaks_down(self, excerpt: Excerpt, t_s: Array) -> npt.NDArray[np.bool_]:
        """Whether gap or insulator break down at some instant between times, one fewer of them.

        Never where the model's term "breakdown" is off.
        """
        if "breakdown" not in self.model.terms:
            return np.zeros(len(t_s) - 1, dtype=bool)
        screen = self.model.screen
        bearable = bearable_field(screen.insulator_permittivity, screen.insulator_strength_v_per_m)
        in_gap = excerpt.highest_field(PASCHEN_MINIMUM_GAP_M, t_s) * PASCHEN_MINIMUM_GAP_M
        at_spot = excerpt.highest_field(0.0, t_s)
        return np.asarray((at_spot > bearable) | (in_gap > PASCHEN_MINIMUM_V))
