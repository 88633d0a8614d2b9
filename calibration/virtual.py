"""A virtual finger, sensor and person: a calibration with known truth and without hardware."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.integrate import cumulative_trapezoid

from calibration.parameters import Array
from calibration.protocol import Stroke
from calibration.sources import ForceSource, Live, StrokeDrive
from haptix.friction import ContactModel
from haptix.virtual_finger import SensorModel, VirtualFinger

_TOUCH_S = 0.08  # to press
_REST_S = 0.12  # between pressing and sliding, at each turn and before lifting
_START_S = 0.03  # to reach the speed
_PATH_RATE_HZ = 1000.0
_TREMOR_HZ = (3.0, 12.0)

GOOD_SENSOR = SensorModel(
    force_noise_n=2e-3, drift_n_per_s=2e-3, crosstalk=0.01, offset_n=5e-3, axis="x"
)
"""A good laboratory's sensor: 2 mN of noise per sample, 1 % of cross-talk."""


@dataclass(frozen=True)
class Person:
    """How precisely a person holds force and speed.

    Parameters
    ----------
    force_error, speed_error : float
        Standard deviation from stroke to stroke, relative.
    tremor : float
        Standard deviation of the force within a stroke, relative.
    repeatability : float
        Standard deviation of tau_f from stroke to stroke, relative: sweat and wear.
    """

    force_error: float = 0.05
    speed_error: float = 0.05
    tremor: float = 0.03
    repeatability: float = 0.01


class VirtualFingerSource(ForceSource):
    """Computes the friction of what is played by the contact model, with an imperfect sensor.

    The sensor's axis should be "x", so that the friction turns with the direction. The seed is that
    of person and sensor, `output_rate_hz` that of the recording.
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
        return {"force sensor": "virtual finger (no instrument)"}

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
