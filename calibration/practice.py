"""Practice: a virtual finger on a virtual screen, both drawn at random and told at the end."""

from __future__ import annotations

from dataclasses import dataclass
from math import exp
from pathlib import Path
from typing import Annotated

import numpy as np

from calibration.parameters import Parameters
from calibration.predict import StrokeConditions, StrokePredictor
from calibration.profile import FINGER, SCREEN, finger_at
from calibration.protocol import FORCES_N, Protocol
from calibration.rig import RigCheck
from haptix.documents import Document
from haptix.errors import InputError
from haptix.finger import Finger
from haptix.friction import ContactModel
from haptix.perception import WEBER_FRACTION
from haptix.report import Heading
from haptix.screen import Screen

TRUTH = "practice.json"
VIRTUAL_RIG = RigCheck(
    normal_gain=1.0,
    tangential_gain=1.0,
    voltage_gain=1.0,
    pole_hz=1e5,
    resonance_hz=1e5,
    quality=1.0,
    instruments=("virtual sensor (no instrument)",),
)
"""What a check of the virtual finger's sensor gives: no gain is wrong, no pole in reach."""
_SCREENS_M = (70e-9, 300e-9)
_SHEAR_SPREAD = 0.3
_TRIES = 200


class Truth(Document):
    """The true screen and finger of a practice session, in a file that its user does not open."""

    screen: Screen
    finger: Finger
    seed: int

    @property
    def model(self) -> ContactModel:
        """The contact that the virtual finger feels: a model of its own, not the fit's table."""
        return ContactModel(self.finger, self.screen)


def draw_parameters(start: Parameters, rng: np.random.Generator) -> Parameters:
    """Draw a truth: the finger from the priors, the insulator from 70 to 300 nm."""
    values = {
        one.name: one.value * exp(rng.normal(0, one.prior))
        for one in start.all
        if one.prior is not None
    }
    values["h0_m"] = exp(rng.uniform(*np.log(_SCREENS_M)))
    shear = start["frictional_shear_stress_pa"].value
    values["frictional_shear_stress_pa"] = shear * exp(rng.normal(0, _SHEAR_SPREAD))
    return start.started_at(**values)


def draw_truth(finger: Finger, screen: Screen, protocol: Protocol, seed: int) -> Truth:
    """Draw a screen and a finger whose contact stays light in all strokes of a protocol."""
    start, rng = Parameters.of(finger, screen), np.random.default_rng(seed)
    predictor = StrokePredictor(ContactModel(finger, screen))
    planned = StrokeConditions.of(protocol.strokes)
    # A person presses less, and a monitor reads more, than planned.
    hardest = StrokeConditions(
        0.85 * planned.normal_force_n,
        1.02 * planned.voltage_v,
        planned.frequency_hz,
        planned.speed_mm_per_s,
    )
    for _ in range(_TRIES):
        drawn = draw_parameters(start, rng)
        found = predictor(hardest, drawn.names, drawn.log_values, jacobian=False)
        if found.is_light.all():
            thickness = drawn["h0_m"].value * screen.insulator_permittivity
            return Truth(
                screen=screen.replace(insulator_thickness_m=thickness),
                finger=finger_at(finger, {one.name: one.value for one in drawn.all}),
                seed=seed,
            )
    raise InputError("--practice: no screen stays in light contact; plan with a lower voltage")


@dataclass(frozen=True)
class PracticeResult:
    """How far a practice was off: d1/eps1, and friction over forces, voltages, frequencies."""

    true_h0_m: Annotated[float, Heading("true d1/eps1 [m]", ".3g")]
    found_h0_m: Annotated[float, Heading("found", ".3g")]
    h0_error: Annotated[float, Heading("its error", "+.1%")]
    friction_error_median_thresholds: Annotated[float, Heading("friction, median [JND]", ".2f")]
    friction_error_worst_thresholds: Annotated[float, Heading("friction, worst [JND]", ".2f")]


def compare_with_truth(folder: Path, highest_voltage_v: float) -> PracticeResult:
    """Compare the profiles of a session with its truth.

    Friction is compared at the protocol's forces, five voltages up to the highest and 30, 125, 1000
    and 4000 Hz, where the contact is light in both.
    """
    truth = Truth.load(folder / TRUTH)
    screen, finger = Screen.load(folder / SCREEN), Finger.load(folder / FINGER)
    axes = FORCES_N, highest_voltage_v * np.linspace(0, 1, 5), (30.0, 125.0, 1000.0, 4000.0)
    places = [axis.ravel() for axis in np.meshgrid(*axes)]
    strokes = StrokeConditions(*[*places, np.full(len(places[0]), 50.0)])
    found = []
    for one in (ContactModel(finger, screen), truth.model):
        own = Parameters.of(one.finger, one.screen)
        found.append(StrokePredictor(one)(strokes, own.names, own.log_values, jacobian=False))
    light = found[0].is_light & found[1].is_light
    off = np.abs(np.expm1(found[0].log_mu - found[1].log_mu))[light] / WEBER_FRACTION
    return PracticeResult(
        truth.screen.h0_m,
        screen.h0_m,
        screen.h0_m / truth.screen.h0_m - 1,
        float(np.median(off)),
        float(off.max()),
    )
