"""What strokes should give: mean friction and its ripple at 2f, with their Jacobian.

The mean over a drive period differs by some 10 % from the friction at the mean pull, so each stroke
is solved at instants of the period, as `ContactModel.over_period` does, and averaged as the
reduction averages. The finger's first-order response smooths the pull, as in
`haptix.virtual_finger`.

A fit asks for hundreds of fingers, and a contact table takes half a second. Two scalings, both
exact for an elastic skin, need one table for all of them: with all moduli times e and all heights
times s, pressures scale by ``e s`` and gaps by ``s``. The bulk's modulus therefore stays in
proportion to the stratum corneum's.
"""

from __future__ import annotations

from collections.abc import Iterable
from copy import copy
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import torch
from torch import Tensor

from calibration.parameters import NAMES, Array, Mask
from haptix.contact.finite_size import highest_asperity, touching_log_pressure
from haptix.electro import VACUUM_PERMITTIVITY, Attraction, AttractionTable
from haptix.equilibrium import LIGHT_CONTACT_LIMIT, lowest_branch
from haptix.errors import InputError
from haptix.friction import ContactModel
from haptix.interpolation import UniformCubic
from haptix.threads import one_thread

_INSTANTS = 24  # in half a drive period, after which the pull repeats: means within 1e-5
_RANGE = 20.0  # of e s, either way, that the table covers
_FORCES_N = (0.02, 3.0)  # that the table covers
_FLOOR = 1e-15  # of a gap of zero, so that ln I stays finite in complete contact


@dataclass(frozen=True)
class StrokeConditions:
    """Conditions of strokes: each an array of shape (strokes,), in the unit its name ends with."""

    normal_force_n: Array
    voltage_v: Array
    frequency_hz: Array
    speed_mm_per_s: Array

    def __len__(self) -> int:
        return len(self.normal_force_n)

    @classmethod
    def of(cls, strokes: Iterable[Any]) -> StrokeConditions:
        """Collect the conditions of planned or reduced strokes."""
        kept = list(strokes)
        names = [field.name for field in fields(cls)]
        return cls(*(np.array([getattr(one, name) for one in kept], dtype=float) for name in names))


@dataclass(frozen=True)
class Prediction:
    """What the model says of strokes.

    Parameters
    ----------
    log_mu : array, shape (strokes,)
        ln of the friction coefficient, averaged over the drive period.
    ripple : array, shape (strokes,)
        Amplitude of the friction at 2f over its mean.
    log_mu_jacobian, ripple_jacobian : array, shape (strokes, parameters)
        By the logarithms of the parameters.
    is_light : array of bool, shape (strokes,)
        False where the contact snaps in during the period.
    """

    log_mu: Array
    ripple: Array
    log_mu_jacobian: Array
    ripple_jacobian: Array
    is_light: Mask


class StrokePredictor:
    """Predicts strokes of one kind of finger on one kind of screen.

    Parameters
    ----------
    model : ContactModel
        Terms, theory and everything that is not fitted; fidelity "mean-field", elastic.

    Raises
    ------
    InputError
        If the scalings do not hold for the model.
    """

    def __init__(self, model: ContactModel) -> None:
        if model.fidelity != "mean-field":
            raise InputError(f'fidelity: expected "mean-field", got "{model.fidelity}"')
        if "plasticity" in model.terms:
            raise InputError(
                "finger: expected an elastic skin, got one with a hardness, whose friction hardly "
                "depends on the voltage; calibrate with a finger that is not dry, or switch the "
                'term "plasticity" off'
            )
        if model.contact_spots != "excluded":
            raise InputError(
                'theory: expected contact spots "excluded", got "included"; use the theory '
                '"open-gaps" or "corrected"'
            )
        self.model = model
        finger = model.finger
        self._modulus_pa = float(finger.youngs_modulus_pa)
        self._h_rms_m = float(model.contact.spectrum.h_rms_m)
        low, high = (
            force / float(finger.apparent_area_m2(torch.tensor(force, dtype=torch.float64)))
            for force in _FORCES_N
        )
        with torch.no_grad():
            self._table = AttractionTable.solve(
                model.contact, low / _RANGE, high * _RANGE * LIGHT_CONTACT_LIMIT
            )
        half = torch.arange(_INSTANTS, dtype=torch.float64)
        self._phase = torch.pi * half / _INSTANTS

    def with_model(self, model: ContactModel) -> StrokePredictor:
        """Return a predictor of a model with other terms; the table is shared where it can be."""
        if ("layered-skin" in model.terms) != ("layered-skin" in self.model.terms):
            return StrokePredictor(model)
        other = copy(self)
        other.model = model
        return other

    @one_thread()
    def __call__(
        self,
        strokes: StrokeConditions,
        names: tuple[str, ...],
        log_values: Array,
        jacobian: bool = True,
    ) -> Prediction:
        """Predict strokes for parameters given by name as logarithms.

        Parameters
        ----------
        strokes : StrokeConditions
            Conditions.
        names : tuple of str
            Of `calibration.parameters.NAMES`; among them all but ``gap_resistivity_ohm_m``.
        log_values : array, shape (names,)
            Their logarithms.
        jacobian : bool
            False leaves the Jacobians at zero, and is three times as fast.
        """
        missing = set(NAMES) - {"gap_resistivity_ohm_m"} - set(names)
        if missing:
            raise InputError(f"parameters: expected {', '.join(sorted(missing))} as well")
        count = len(strokes)
        # One row of parameters for each stroke, which depends on no other row: two backward passes
        # give the whole Jacobian.
        rows = torch.tensor(log_values, dtype=torch.float64).expand(count, -1).clone()
        rows.requires_grad_(jacobian)
        mu, z_real, z_imag, light = self._period(strokes, names, rows)
        size = torch.sqrt(z_real**2 + z_imag**2 + 1e-30)
        log_mu, ripple = torch.log(mu), size / mu
        blank = np.zeros((count, len(names)))
        by_mu = by_ripple = blank
        if jacobian:
            (one,) = torch.autograd.grad(log_mu.sum(), rows, retain_graph=True)
            (two,) = torch.autograd.grad(ripple.sum(), rows)
            by_mu, by_ripple = one.numpy(), two.numpy()
        return Prediction(
            log_mu.detach().numpy(), ripple.detach().numpy(), by_mu, by_ripple, light.numpy()
        )

    def _period(
        self, strokes: StrokeConditions, names: tuple[str, ...], rows: Tensor
    ) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Mean of mu, its cosine and sine parts at 2f, and whether the contact stays light."""
        count = len(strokes)
        force = _tensor(strokes.normal_force_n)
        stiffer = _column(rows, names, "youngs_modulus_pa") / self._modulus_pa
        higher = _column(rows, names, "h_rms_m") / self._h_rms_m
        exponent = _column(rows, names, "apparent_area_exponent")
        area = _column(rows, names, "apparent_area_at_1n_m2")
        if "apparent-area" in self.model.terms:
            area = area * force**exponent
        unit_pa = stiffer * higher
        applied = force / area / unit_pa
        strength = _tensor(strokes.voltage_v) ** 2 / (higher**2 * unit_pa)
        own, group = np.unique(strokes.frequency_hz, return_inverse=True)
        thickness = self._thickness(strokes, names, rows) / higher
        first = [int(np.flatnonzero(group == index)[0]) for index in range(len(own))]
        # All strokes of a frequency share their tables, and differ by their derivatives only.
        shared = thickness.detach()[first]
        frequency = torch.from_numpy(group)
        cutoff = _column(rows, names, "response_hz_per_mm_per_s") * _tensor(strokes.speed_mm_per_s)
        response = 1 / torch.complex(
            torch.ones_like(cutoff), -2 * _tensor(strokes.frequency_hz) / cutoff
        )
        swing = response[:, None] * torch.exp(-2j * self._phase)
        pulls = _Pulls(self._table, shared)
        floor = self._floor(area, strokes)
        column = torch.arange(count * _INSTANTS)
        applied, strength, apart, table, swing = (
            one.expand(count, _INSTANTS).reshape(-1)
            for one in (
                applied[:, None],
                strength[:, None],
                (thickness - shared[frequency])[:, None],
                frequency[:, None],
                swing,
            )
        )
        with torch.no_grad():
            held = None if floor is None else floor.detach()
            attraction = Attraction(pulls.log_pull(table, swing), column, floor=held)
            found = lowest_branch(applied.detach(), strength.detach(), attraction)
        light = found.is_stable.reshape(count, _INSTANTS).all(-1)
        # One Newton step, which autograd sees, carries the derivative of the balance.
        value = pulls(found.pressure_pa, table, swing, apart, floor)
        with torch.no_grad():
            _, slope = attraction(torch.log(found.pressure_pa))
        stiffness = (1 - strength * slope / found.pressure_pa).detach()
        # At the very end of the branch the step would be all rounding.
        usable = found.is_stable & (stiffness > 1e-4)
        step = (found.pressure_pa - applied - strength * value) / torch.where(
            usable, stiffness, torch.ones_like(stiffness)
        )
        pressure = torch.where(usable, found.pressure_pa - step, found.pressure_pa)
        fraction = self.model.contact.area_fraction(pressure).reshape(count, _INSTANTS)
        shear = _column(rows, names, "frictional_shear_stress_pa")
        mu = (shear * area / force)[:, None] * fraction
        turn = 2 * self._phase
        return (
            mu.mean(-1),
            2 * (mu * torch.cos(turn)).mean(-1),
            2 * (mu * torch.sin(turn)).mean(-1),
            light,
        )

    def _thickness(self, strokes: StrokeConditions, names: tuple[str, ...], rows: Tensor) -> Tensor:
        """Complex h0 [m] of each stroke."""
        h0 = _column(rows, names, "h0_m")
        frequency = _tensor(strokes.frequency_hz)
        thickness = torch.complex(h0, torch.zeros_like(h0))
        finger = self.model.finger
        if "skin-dielectric" in self.model.terms:
            with torch.no_grad():
                # The scale is a parameter here.
                table = finger.dielectric.model_copy(update={"scale": 1.0})
                skin = finger.layer_thickness_m / table.relative_permittivity(frequency)
            thickness = thickness + _column(rows, names, "skin_dielectric_scale") * skin
        if "gap_resistivity_ohm_m" in names:
            resistivity = _column(rows, names, "gap_resistivity_ohm_m")
            leak = 1 / (2 * torch.pi * frequency * VACUUM_PERMITTIVITY * resistivity)
            thickness = thickness * torch.complex(torch.ones_like(leak), leak)
        return thickness

    def _floor(self, area: Tensor, strokes: StrokeConditions) -> Tensor | None:
        if "finite-size" not in self.model.terms:
            return None
        spectrum = self.model.contact.spectrum
        height = highest_asperity(spectrum.h_rms_m, spectrum.q_rolloff, area)
        touching = touching_log_pressure(self._table.log_mean_gap, torch.log(height))
        return touching[:, None].expand(len(strokes), _INSTANTS).reshape(-1)


class _Pulls:
    """Pull per square volt against ln p at each frequency: its mean and its part at 2f.

    A sine's squared field in a gap u is ``(|g|^2 + Re g^2 exp(-2iwt)) / 2`` with
    ``g = 1/(u + h0)``; the finger's response scales the second part. Derivatives by h0 are tables
    of their own.
    """

    def __init__(self, table: AttractionTable, thickness: Tensor) -> None:
        edges = table.gaps.edges_m
        gap = (edges[:-1] * edges[1:]).sqrt()
        inverse = 1 / (gap + thickness[:, None])
        size, square = inverse.abs() ** 2, inverse**2
        cube = -2 * square * inverse
        parts = torch.stack(
            [
                size,
                square.real,
                square.imag,
                -2 * size * inverse.real,
                2 * size * inverse.imag,
                cube.real,
                cube.imag,
            ]
        )
        self._kinds, self._frequencies = len(parts), len(thickness)
        flat = parts.reshape(-1, parts.shape[-1])
        with torch.no_grad():
            pulled = VACUUM_PERMITTIVITY / 4 * (table.gaps.mass @ flat.T)
            # What a gap of zero would pull, in a share that keeps the logarithm finite.
            self._least = VACUUM_PERMITTIVITY / 4 * _FLOOR * size.amax(-1)
            self._start, self._step = table.log_pressure[0], table.log_mean_gap.step
            self._tables = UniformCubic.through(self._start, self._step, pulled)

    def log_pull(self, frequency: Tensor, swing: Tensor) -> UniformCubic:
        """Ln of the pull against ln p, one column for each state."""
        mean, real, imag = (
            self._tables.values[:, kind * self._frequencies + frequency] for kind in range(3)
        )
        pull = mean + real * swing.real - imag * swing.imag
        # Rounding leaves a little below zero where the field passes through it.
        return UniformCubic.through(
            self._start, self._step, torch.log(pull.clamp(min=0.0) + self._least[frequency])
        )

    def __call__(
        self,
        pressure: Tensor,
        frequency: Tensor,
        swing: Tensor,
        apart: Tensor,
        floor: Tensor | None,
    ) -> Tensor:
        """Pull of each state; `apart` is zero and carries the thickness's derivatives."""
        at = torch.log(pressure)
        moved = torch.zeros_like(at)  # the floor's derivative: what a material moves it by
        if floor is not None:
            at = torch.maximum(at, floor)
            moved = at - at.detach()
        with torch.no_grad():
            found = [
                self._tables.with_slope(at, kind * self._frequencies + frequency)
                for kind in range(self._kinds)
            ]
        mean, real, imag, by_real, by_imag, cube_real, cube_imag = (
            value + slope * moved for value, slope in found
        )
        turned = torch.complex(real, imag) + torch.complex(cube_real, cube_imag) * apart
        mean = mean + by_real * apart.real + by_imag * apart.imag
        return mean + (swing * turned).real + self._least[frequency]


def _tensor(values: Array) -> Tensor:
    return torch.as_tensor(np.asarray(values, dtype=np.float64))


def _column(rows: Tensor, names: tuple[str, ...], name: str) -> Tensor:
    return torch.exp(rows[:, names.index(name)])
