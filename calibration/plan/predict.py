"""Predicted mean friction of strokes and its ripple at 2f, with their Jacobian.

The mean over a drive period differs by some 10 % from the friction at the mean attraction. So each
stroke is solved at instants of the period, as `ContactModel.over_period` does, and averaged as the
reduction averages. The finger's first-order response smooths the attraction, as in
`haptix.play.virtual_finger`.

A fit asks for hundreds of fingers, and a contact table takes half a second. Two scalings, both
exact for an elastic skin, need one table for all of them: with all moduli times e and all heights
times s, pressures scale by ``e s`` and gaps by ``s``. The bulk's modulus therefore stays in
proportion to the stratum corneum's.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields, replace
from typing import Any, TypeVar

import numpy as np
import torch
from torch import Tensor

from calibration.plan.parameters import REQUIRED, Array, Mask, Parameters, fitted_terms
from haptix.base.display import Displayed
from haptix.base.errors import InputError
from haptix.base.threads import one_thread
from haptix.model.electro import Circuit, Pull
from haptix.model.fidelity import Ability
from haptix.model.finger import Finger
from haptix.model.friction import ContactModel, FrictionSolver
from haptix.model.screen import Screen
from haptix.model.terms import ActiveTerms, Properties

_Profile = TypeVar("_Profile", Finger, Screen)
_INSTANTS = 12  # in half a drive period, after which the attraction repeats: means within 5e-5
_RANGE = 20.0  # of e s, either way, that the table covers
_FORCES_N = (0.02, 3.0)  # that the table covers


@dataclass(frozen=True)
class StrokeConditions(Displayed):
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
        return cls(
            *(np.array([getattr(stroke, name) for stroke in kept], dtype=float) for name in names)
        )


@dataclass(frozen=True)
class Prediction(Displayed):
    """Prediction of the model for strokes."""

    log_mu: Array
    """ln of the friction coefficient, averaged over the drive period; shape (strokes,)."""
    ripple: Array
    """Amplitude of the friction at 2f over its mean, as the force sensor shows it; shape
    (strokes,)."""
    log_mu_jacobian: Array
    ripple_jacobian: Array
    """By the logarithms of the parameters; shape (strokes, parameters)."""
    is_light: Mask
    """False where the contact snaps in during the period; shape (strokes,)."""


class StrokePredictor:
    """Predicts strokes of one kind of finger on one kind of screen.

    Parameters
    ----------
    model : ContactModel
        Terms, theory and everything that is not fitted; elastic, with a table that scales.
    tables : StrokePredictor, optional
        Another one, whose table is shared where the contact is the same.

    Raises
    ------
    InputError
        If the scalings do not hold for the model.
    """

    def __init__(self, model: ContactModel, tables: StrokePredictor | None = None) -> None:
        model.require(Ability.RESCALE, "model")
        if model.solver.fidelity.contact.hardness_pa is not None:
            raise InputError(
                "finger: expected an elastic skin, got one with a hardness, whose friction hardly "
                "depends on the voltage; calibrate with a finger that is not dry, or switch the "
                'term "plasticity" off'
            )
        if model.contact_spots == "included":
            raise InputError(
                f'theory: expected contact spots "excluded", got "{model.contact_spots}"; use the '
                'theory "local", "corrected" or "open-gaps"'
            )
        self.model = model
        self._modulus_pa = float(model.finger.youngs_modulus_pa)
        self._h_rms_m = float(model.contact.spectrum.h_rms_m)
        self._phase = torch.pi * torch.arange(_INSTANTS, dtype=torch.float64) / _INSTANTS
        if tables is not None:
            model.solver.fidelity.borrow(tables.model.solver.fidelity)
        # High forces on soft skin and low ones on stiff skin, once for all fits.
        unit = torch.tensor([_RANGE, 1 / _RANGE], dtype=torch.float64)
        properties = Properties(model.finger, model.screen, unit)
        solver = FrictionSolver(ActiveTerms(properties, model.terms), model.solver.fidelity)
        with torch.no_grad():
            solver.prepare(torch.tensor(_FORCES_N, dtype=torch.float64))

    @one_thread()
    def __call__(
        self,
        strokes: StrokeConditions,
        names: tuple[str, ...],
        log_values: Array,
        jacobian: bool = True,
    ) -> Prediction:
        """Predict strokes for parameters of which `log_values` are the logarithms, shape (names,).

        The names are of `calibration.plan.parameters.NAMES`, with all that are `REQUIRED`. Without
        `jacobian` the Jacobians are zero, and it is three times as fast.
        """
        missing = set(REQUIRED) - set(names)
        if missing:
            raise InputError(f"parameters: expected {', '.join(sorted(missing))} as well")
        count = len(strokes)
        # One row of parameters for each stroke, which depends on no other row: two backward passes
        # give the whole Jacobian.
        rows = torch.tensor(log_values, dtype=torch.float64).expand(count, -1).clone()
        rows.requires_grad_(jacobian)
        columns = dict(zip(names, rows.exp().unbind(-1), strict=True))
        with torch.set_grad_enabled(jacobian):
            mu, z_real, z_imag, light = self._period(strokes, columns)
            size = torch.sqrt(z_real**2 + z_imag**2 + 1e-30)
            sensed = sensor_gain(columns, 2 * torch.as_tensor(strokes.frequency_hz))
            log_mu, ripple = torch.log(mu), size / mu * sensed
        by_log = np.zeros((2, count, len(names)))
        if jacobian:
            (by_log[0],) = torch.autograd.grad(log_mu.sum(), rows, retain_graph=True)
            (by_log[1],) = torch.autograd.grad(ripple.sum(), rows)
        means = log_mu.detach().numpy(), ripple.detach().numpy()
        return Prediction(*means, by_log[0], by_log[1], light.numpy())

    def by_profiles(
        self, strokes: StrokeConditions, sensor: Mapping[str, float] | None = None
    ) -> Prediction:
        """Predict strokes with the model's own finger and screen, without a Jacobian.

        Parameters
        ----------
        strokes : StrokeConditions
            Forces, amplitudes and frequencies.
        sensor : mapping, optional
            Bandwidth of the force sensor (`calibration.plan.parameters.PER_RIG`), which is in no
            profile; without it the ripples are those of a perfect sensor.
        """
        parameters = Parameters.of(self.model.finger, self.model.screen).fixed(**sensor or {})
        return self(strokes, parameters.names, parameters.log_values, jacobian=False)

    def thickness_m(self, names: tuple[str, ...], log_values: Array, frequency_hz: float) -> float:
        """Size of h0 [m] at a frequency: d1/eps1 and the skin's d2/eps2.

        Parameters
        ----------
        names : tuple of str
            Names of the parameters.
        log_values : array
            ln of their values.
        frequency_hz : float
        """
        logs = torch.tensor(log_values, dtype=torch.float64)
        values = dict(zip(names, logs.exp(), strict=True))
        hertz = torch.tensor(frequency_hz, dtype=torch.float64)
        return float(self._terms(values).thickness(values["h0_m"], hertz).abs())

    def _period(
        self, strokes: StrokeConditions, values: Mapping[str, Tensor]
    ) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Mean of mu, its cosine and sine parts at 2f, and whether the contact stays light."""
        count = len(strokes)

        def each(of_stroke: Tensor) -> Tensor:
            """Repeat the value of each stroke at its instants."""
            return of_stroke[:, None].expand(count, _INSTANTS).reshape(-1)

        force, voltage, frequency, speed = (
            torch.as_tensor(np.asarray(column, dtype=np.float64))
            for column in vars(strokes).values()
        )
        higher = values["h_rms_m"] / self._h_rms_m
        terms = self._terms(values)
        thickness = terms.thickness(values["h0_m"], frequency)
        cutoff = values["response_hz_per_mm_per_s"] * speed
        response = 1 / torch.complex(torch.ones_like(cutoff), -2 * frequency / cutoff)
        limit = terms.field_limit()
        pull = Pull.of_ripple(
            self.model.contact.gap_edges_m,
            voltage / higher,
            thickness / higher,
            response[:, None] * torch.exp(-2j * self._phase),
            None if limit is None else lambda gap_m: limit(gap_m * higher[..., None]),
        )
        medium = torch.ones_like(thickness) * terms.gap_permittivity(frequency)
        # Lengths are counted in units of `higher`.
        stroke = torch.arange(count).repeat_interleave(_INSTANTS)
        circuit = Circuit(thickness / higher, medium / higher, stroke)
        of_instant = {name: each(value) for name, value in values.items()}
        solver = FrictionSolver(self._terms(of_instant), self.model.solver.fidelity)
        mu_at, balance = solver.solve(each(force), replace(pull, circuit=circuit))
        mu = mu_at.reshape(count, _INSTANTS)
        turn = 2 * self._phase
        return (
            mu.mean(-1),
            2 * (mu * torch.cos(turn)).mean(-1),
            2 * (mu * torch.sin(turn)).mean(-1),
            balance.is_stable.reshape(count, _INSTANTS).all(-1),
        )

    def _terms(self, values: Mapping[str, Tensor]) -> ActiveTerms:
        """The terms that are on, with fitted values in place of the profiles' own."""
        finger, screen = self.model.finger, self.model.screen
        scale = {"scale": values["skin_dielectric_scale"]}
        changed = {**values, "dielectric": finger.dielectric.model_copy(update=scale)}
        unit = values["youngs_modulus_pa"] / self._modulus_pa * values["h_rms_m"] / self._h_rms_m
        properties = Properties(_updated(finger, changed), _updated(screen, changed), unit)
        return ActiveTerms(properties, fitted_terms(self.model.terms, values))


def sensor_gain(values: Mapping[str, Tensor], frequency_hz: Tensor) -> Tensor:
    """Gain of the force sensor at a frequency: a pole of first order, and a resonance.

    1 where `values` has none of `calibration.plan.parameters.PER_RIG`; the columns broadcast.
    """
    gain = torch.ones_like(frequency_hz)
    if "sensor_pole_hz" in values:
        gain = gain / torch.sqrt(1 + (frequency_hz / values["sensor_pole_hz"]) ** 2)
    if "sensor_resonance_hz" in values:
        ratio = frequency_hz / values["sensor_resonance_hz"]
        damping = ratio / values["sensor_quality"]
        gain = gain / torch.sqrt((1 - ratio**2) ** 2 + damping**2)
    return gain


def _updated(profile: _Profile, values: Mapping[str, Any]) -> _Profile:
    """Copy a profile with those of the values that are its fields."""
    fields_of = type(profile).model_fields
    return profile.model_copy(
        update={key: value for key, value in values.items() if key in fields_of}
    )
