"""Practice: a calibration of a virtual finger on a virtual screen with known truth."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import exp
from pathlib import Path
from secrets import randbelow
from typing import Annotated

import numpy as np
from scipy.integrate import cumulative_trapezoid

from calibration.keep.profile import finger_at
from calibration.measure.rig import RIG, RigCheck, VoltsRead
from calibration.measure.session import Session
from calibration.measure.sources import ForceSource, Live, StrokeDrive
from calibration.plan.parameters import Array, Parameters
from calibration.plan.predict import StrokeConditions, StrokePredictor
from calibration.plan.protocol import CARRIER_HZ, FORCES_N, FREQUENCY_HZ, Protocol, Stroke
from haptix.base.documents import Document
from haptix.base.errors import InputError
from haptix.base.report import Heading
from haptix.model.finger import Finger
from haptix.model.friction import ContactModel
from haptix.model.pair import FINGER, SCREEN
from haptix.model.perception.thresholds import WEBER_FRACTION
from haptix.model.screen import NO_INSTRUMENT, Screen
from haptix.play.virtual_finger import SensorModel, VirtualFinger

_TOUCH_S = 0.08  # to press
_REST_S = 0.12  # between pressing and sliding, at each turn and before lifting
_START_S = 0.03  # to reach the speed
_PATH_RATE_HZ = 1000.0
_TREMOR_HZ = (3.0, 12.0)

GOOD_SENSOR = SensorModel(
    force_noise_n=2e-3, drift_n_per_s=2e-3, crosstalk=0.01, offset_n=5e-3, axis="x"
)
"""A good laboratory's sensor: 2 mN of noise per sample, 1 % of cross-talk."""
TRUTH = "practice.json"
VIRTUAL_RIG = RigCheck(
    normal_gain=1.0,
    tangential_gain=1.0,
    second_tangential_gain=1.0,
    volts=tuple(
        VoltsRead(frequency_hz=hertz, monitor_v=volts, gain=1.0)
        for hertz in (FREQUENCY_HZ, CARRIER_HZ)
        for volts in (50.0, 120.0, 200.0)
    ),
    pole_hz=1e5,
    resonance_hz=1e5,
    quality=1.0,
    instruments=(f"virtual sensor {NO_INSTRUMENT}",),
)
"""Result of a check of the virtual finger's sensor: no gain is wrong, no pole in reach."""
_SCREENS_M = (70e-9, 300e-9)
_SHEAR_SPREAD = 0.3
_TRIES = 200


@dataclass(frozen=True)
class Person:
    """How precisely a person holds force and speed."""

    force_error: float = 0.05
    speed_error: float = 0.05
    """Standard deviation from stroke to stroke, relative."""
    tremor: float = 0.03
    """Standard deviation of the force within a stroke, relative."""
    repeatability: float = 0.01
    """Standard deviation of tau_f from stroke to stroke, relative: sweat and wear."""


class VirtualFingerSource(ForceSource):
    """Friction of the played voltage by the contact model, read by an imperfect sensor.

    Parameters
    ----------
    model : ContactModel
        The true finger and screen.
    sensor : SensorModel
        Errors of the sensor; axis "x", so that the friction turns with the direction.
    person : Person, optional
        How the finger is moved and pressed.
    seed : int
        Seed of person and sensor.
    output_rate_hz : float
        Rate of the recording [Hz].
    """

    is_live = False

    def __init__(
        self,
        model: ContactModel,
        sensor: SensorModel = GOOD_SENSOR,
        person: Person | None = None,
        seed: int = 0,
        output_rate_hz: float = 10_000.0,
    ) -> None:
        self._finger = VirtualFinger(model, seed=seed)
        self._sensor, self._rate_hz = sensor, output_rate_hz
        self._person = Person() if person is None else person
        self._rng = np.random.default_rng(seed)
        self._signals: dict[str, Array] = {}

    @property
    def instruments(self) -> Mapping[str, str]:
        return {"force sensor": f"virtual finger {NO_INSTRUMENT}"}

    def start(self, stroke: Stroke, played: StrokeDrive) -> None:
        t, x, force = self._path(stroke, played.duration_s)
        felt = self._finger.feel(
            played.volts, played.sample_rate_hz, t, x, 0.0, force, output_rate_hz=self._rate_hz
        )
        dry = 1 + self._person.repeatability * self._rng.normal()
        felt = replace(felt, friction_force_n=felt.friction_force_n * dry)
        sensed = self._sensor.read(felt, int(self._rng.integers(2**31)))
        self._signals = {
            "t_s": sensed.t_s,
            "normal_force_n": sensed.normal_force_n,
            "tangential_force_n": sensed.tangential_force_n,
            "x_mm": felt.x_mm,
            "drive_v": played.at(felt.t_s),
        }

    def live(self, t_s: float) -> Live | None:
        return Live.at(self.finish(), t_s)

    def finish(self) -> dict[str, Array]:
        return self._signals

    def _path(self, stroke: Stroke, duration_s: float) -> tuple[Array, Array, Array]:
        person, rng = self._person, self._rng
        speed = stroke.speed_mm_per_s * (1 + person.speed_error * rng.normal())
        force = stroke.normal_force_n * (1 + person.force_error * rng.normal())
        t = np.arange(int(duration_s * _PATH_RATE_HZ)) / _PATH_RATE_HZ
        slide_s = stroke.length_mm / speed
        turn_s = slide_s + _START_S + _REST_S
        pressed = (duration_s - stroke.slides * turn_s - _REST_S) / 2
        lifted = duration_s - pressed
        knots = [pressed - _TOUCH_S, pressed, lifted, lifted + _TOUCH_S]
        envelope = np.interp(t, knots, [0.0, 1.0, 1.0, 0.0])
        hertz = rng.uniform(*_TREMOR_HZ, 4)
        waves = np.sin(2 * np.pi * hertz[:, None] * t + rng.uniform(0, 2 * np.pi, (4, 1)))
        tremor = person.tremor * waves.sum(0) / np.sqrt(2)
        velocity = np.zeros_like(t)
        for way in range(stroke.slides):
            begin = pressed + _REST_S + way * turn_s
            knots = [begin, begin + _START_S, begin + slide_s, begin + slide_s + _START_S]
            velocity += (-1) ** way * np.interp(t, knots, [0.0, speed, speed, 0.0])
        x = cumulative_trapezoid(velocity, t, initial=0.0)
        return t, x, np.maximum(force * envelope * (1 + tremor), 0.0)


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
        parameter.name: parameter.value * exp(rng.normal(0, parameter.prior))
        for parameter in start.all
        if parameter.prior is not None
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
        predicted = predictor(hardest, drawn.names, drawn.log_values, jacobian=False)
        if predicted.is_light.all():
            thickness = drawn["h0_m"].value * screen.insulator_permittivity
            return Truth(
                screen=screen.replace(insulator_thickness_m=thickness),
                finger=finger_at(
                    finger, {parameter.name: parameter.value for parameter in drawn.all}
                ),
                seed=seed,
            )
    raise InputError("--practice: no screen stays in light contact; plan with a lower voltage")


def draw_practice(
    folder: Path, finger: Finger, screen: Screen, protocol: Protocol, seed: int | None = None
) -> None:
    """Write a truth, and a rig without a fault, to the folder of a session that is to begin."""
    truth = draw_truth(finger, screen, protocol, randbelow(2**31) if seed is None else seed)
    truth.save(folder / TRUTH)
    VIRTUAL_RIG.save(folder / RIG)


def virtual_source(session: Session, seed: int = 0) -> VirtualFingerSource:
    """Return a virtual finger on the true screen of a practice, or else on the assumed one."""
    # A resumed session goes on with other noise, not with the same again.
    done = len(session.protocol.strokes) - len(session.open_strokes)
    if (session.folder / TRUTH).exists():
        truth = Truth.load(session.folder / TRUTH)
        return VirtualFingerSource(truth.model, seed=truth.seed + done)
    assumed = ContactModel(session.info.finger, session.info.screen)
    return VirtualFingerSource(assumed, seed=seed + done)


@dataclass(frozen=True)
class PracticeResult:
    """How far a practice was off: d1/eps1, and friction over forces, voltages, frequencies."""

    true_h0_m: Annotated[float, Heading("true d1/eps1 [m]", ".3g")]
    found_h0_m: Annotated[float, Heading("found", ".3g")]
    h0_error: Annotated[float, Heading("its error", "+.1%")]
    friction_error_median_jnd: Annotated[float, Heading("friction, median [JND]", ".2f")]
    friction_error_worst_jnd: Annotated[float, Heading("friction, worst [JND]", ".2f")]


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
    models = ContactModel(finger, screen), truth.model
    measured, true = (StrokePredictor(model).by_profiles(strokes) for model in models)
    light = measured.is_light & true.is_light
    off = np.abs(np.expm1(measured.log_mu - true.log_mu))[light] / WEBER_FRACTION
    return PracticeResult(
        truth.screen.h0_m,
        screen.h0_m,
        screen.h0_m / truth.screen.h0_m - 1,
        float(np.median(off)),
        float(off.max()),
    )
