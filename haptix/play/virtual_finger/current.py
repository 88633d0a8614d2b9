"""The current that a virtual finger draws: a converter's readings of it, and it in time."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from math import inf, pi
from typing import Annotated, NamedTuple, Self

import numpy as np
import torch
from pydantic import Field

from haptix.base.checks import Array, NotNegative, Number, Positive, checked, number, positive, row
from haptix.base.display import Displayed
from haptix.base.errors import InputError
from haptix.base.fields import LIFTED_BELOW_N
from haptix.base.threads import one_thread
from haptix.feel.motion import STANDING_BELOW_MM_PER_S, Trajectory
from haptix.model.friction import ContactModel
from haptix.play.devices import CurrentReading, Device

_FORCES_N = np.geomspace(0.02, 2.0, 9)
_VOLTAGES = 7
_DRIER = 1.25  # skin at which the second table is made: sweat lies on the line between both


@checked()
class Converter(Displayed):
    """What stands between the current and its readings.

    Parameters
    ----------
    rate_hz : float
        Readings a second; each is over a whole number of the carrier's periods.
    noise : float
        Standard deviation of each part of a reading of 10 ms, over the total current.
    bits : int
        Of the converter, whose samples the lock-in averages.
    range_a : float
        Current that it holds, either way [A]: beyond it a reading is saturated.
    delay_s : float
        From the end of a reading to its arrival [s].
    pole_hz : float
        Of the amplifier of the current: the phase turns by its share of the carrier.
    hum_a, hum_hz : float
        Amplitude and frequency of the current that the mains induce in finger and panel [A, Hz].
    """

    rate_hz: Positive = 250.0
    noise: NotNegative = 1e-3
    bits: Annotated[int, Field(ge=4, le=24)] = 12
    range_a: Positive = 0.02
    delay_s: NotNegative = 0.002
    pole_hz: Positive = 200e3
    hum_a: NotNegative = 5e-6
    hum_hz: Positive = 50.0


@checked()
class PanelCircuit(Displayed):
    """What else draws current.

    Parameters
    ----------
    panel_f : float
        Of the untouched panel to earth [F].
    body_f : float
        From the finger to earth [F].
    rest_share : float
        Capacitance of a contact that rests over that of one that slides: a half to a tenth less
        (physics page, section 12).
    panel_per_s : float
        Relative drift of the panel, of its temperature [1/s].
    sweat_per_min : float
        Share by which the skin insulates less in a minute.
    """

    panel_f: Positive = 2e-9
    body_f: Positive = 150e-12
    rest_share: Positive = 0.3
    panel_per_s: Number = 0.0
    sweat_per_min: Number = 0.0


def _volts(model: ContactModel) -> Array:
    return np.linspace(0.0, model.screen.max_voltage_v, _VOLTAGES)


@lru_cache(16)
def _table(model: ContactModel, frequency_hz: float, scale: float) -> Array:
    """Complex capacitance by force and voltage."""
    finger = model.finger
    skin = finger.dielectric.model_copy(update={"scale": finger.dielectric.scale * scale})
    skin_model = ContactModel(finger.replace(dielectric=skin), model.screen, terms=model.terms)
    state = skin_model.solve(
        torch.from_numpy(_FORCES_N)[:, None], torch.from_numpy(_volts(model)), frequency_hz
    )
    loss = state.conductance_s.numpy() / (2 * pi * frequency_hz)
    table = np.asarray(state.capacitance_f.numpy() - 1j * loss)
    table.setflags(write=False)
    return table


class VirtualCurrent(Displayed):
    """Readings of the current that a finger on a screen draws, in time.

    At each instant the contact is in equilibrium with force and amplitude. Its mechanics lag
    behind; a carrier's current lags by less than a reading. Contact and body are in series, and
    the panel is parallel to them.

    Parameters
    ----------
    model : ContactModel
        Finger and screen.
    frequency_hz : float
        Of the carrier.
    converter : Converter, optional
        What reads.
    circuit : PanelCircuit, optional
        What else draws current.
    seed : int
        Of the noise.
    """

    @one_thread()
    def __init__(
        self,
        model: ContactModel,
        frequency_hz: float,
        converter: Converter | None = None,
        circuit: PanelCircuit | None = None,
        seed: int = 0,
    ) -> None:
        self.frequency_hz = positive("frequency_hz", frequency_hz)
        self.converter = Converter() if converter is None else converter
        self.circuit = PanelCircuit() if circuit is None else circuit
        self._random = np.random.default_rng(seed)
        self._volts = _volts(model)
        self._tables = [_table(model, self.frequency_hz, scale) for scale in (1.0, _DRIER)]

    def farads(
        self, normal_force_n: float, voltage_v: float, is_sliding: bool = True, t_s: float = 0.0
    ) -> complex:
        """Complex capacitance [F] of contact and body at a force, amplitude and time.

        Parameters
        ----------
        normal_force_n : float
        voltage_v : float
        is_sliding : bool
            Whether the finger slides.
        t_s : float
            Time [s], for a body that changes.
        """
        if normal_force_n < LIFTED_BELOW_N:
            return 0j
        log_f = np.interp(np.log(normal_force_n), np.log(_FORCES_N), np.arange(len(_FORCES_N)))
        cell = min(int(log_f), len(_FORCES_N) - 2)
        part, by_dryness = log_f - cell, []
        for table in self._tables:
            by_voltage = (1 - part) * table[cell] + part * table[cell + 1]
            by_dryness.append(complex(np.interp(voltage_v, self._volts, by_voltage)))
        drier = np.log1p(-min(self.circuit.sweat_per_min / 60 * t_s, 0.9)) / np.log(_DRIER)
        contact = by_dryness[0] * (by_dryness[1] / by_dryness[0]) ** drier
        contact *= 1.0 if is_sliding else self.circuit.rest_share
        body = self.circuit.body_f
        return complex(contact * body / (contact + body))

    def panel_f(self, t_s: float) -> complex:
        """Capacitance of the untouched panel at a time [F]."""
        return complex(self.circuit.panel_f * (1 + self.circuit.panel_per_s * t_s))

    def read(
        self,
        drive_v: Array,
        sample_rate_hz: float,
        path: Trajectory | None = None,
        start_s: float = 0.0,
    ) -> list[CurrentReading]:
        """Read the current that a drive draws, over whole periods of the carrier.

        Parameters
        ----------
        drive_v : array, shape (samples,)
            Drive signal with the carrier [V].
        sample_rate_hz, start_s : float
            Its rate [Hz], and the time of its first sample [s].
        path : Trajectory, optional
            Of the finger; none touches without it, nor outside of its times.

        Returns
        -------
        list of CurrentReading
            The last part that fills no reading is left out.
        """
        drive = row("drive_v", drive_v)
        rate, start = positive("sample_rate_hz", sample_rate_hz), number("start_s", start_s)
        periods = max(1, round(self.frequency_hz / self.converter.rate_hz))
        size = round(periods * rate / self.frequency_hz)
        if size < 4:
            raise InputError("sample_rate_hz: expected 4 samples or more in a reading")
        readings = []
        for first in range(0, len(drive) - size + 1, size):
            at = np.arange(first, first + size)
            turn = np.exp(-2j * pi * self.frequency_hz * at / rate)
            phasor = complex(2 / size * (drive[first : first + size] @ turn))
            hum = np.cos(2 * pi * self.converter.hum_hz * (start + at / rate))
            hum_a = self.converter.hum_a * complex(2 / size * (hum @ turn))
            readings.append(self._reading(phasor, hum_a, start + (first + size) / rate, size, path))
        return readings

    def _reading(
        self, phasor: complex, hum_a: complex, t_s: float, size: int, path: Trajectory | None
    ) -> CurrentReading:
        converter = self.converter
        volts, angular = abs(phasor), 2 * pi * self.frequency_hz
        farads = self.panel_f(t_s)
        if path is not None and path.t_s[0] <= t_s <= path.t_s[-1]:
            at = np.array([t_s])
            force, speed = float(path.at(at)[2][0]), float(path.speed_mm_per_s(at)[0])
            farads += self.farads(force, volts, speed >= STANDING_BELOW_MM_PER_S, t_s)
        current = 1j * angular * farads * volts / (1 + 1j * self.frequency_hz / converter.pole_hz)
        share = converter.noise * np.sqrt(0.01 * converter.rate_hz)
        step = 2 * converter.range_a / 2**converter.bits
        spread = np.hypot(share * abs(current), step / np.sqrt(6 * size))
        noise = self._random.normal(size=2) * spread
        read_a = current + complex(*noise) + hum_a
        is_saturated = abs(current) + converter.hum_a > converter.range_a
        return CurrentReading(t_s, read_a.real, read_a.imag, volts, bool(is_saturated))


class LiveCurrent:
    """Capacitance of a mock driver's load while a virtual finger strokes it, as its touches say.

    It is the ``farads`` of a `firmware_io.MockConverter`.

    Parameters
    ----------
    current : VirtualCurrent
        Of finger and circuit.
    clock : callable
        Of the touches [s].
    """

    def __init__(self, current: VirtualCurrent, clock: Callable[[], float]) -> None:
        self.current = current
        self._clock = clock
        self._touches: dict[int, _Place] = {}
        self._kept = (-inf, 0j)

    @classmethod
    def on(cls, device: Device, current: VirtualCurrent) -> Self:
        """Load the converter of a mock driver.

        Parameters
        ----------
        device : Device
            A mock with a converter.
        current : VirtualCurrent
            Of finger and circuit.

        Raises
        ------
        InputError
            If the device is no mock with a converter.
        """
        converter = None if device.mock is None else device.mock.converter
        if converter is None:
            raise InputError(
                f"device: expected a mock with a converter, got {device.name}; open "
                "mock:pace=real,mode=envelope,sense_rate_hz=250"
            )
        live = cls(current, device.clock)
        converter.farads, converter.carrier_hz = live, current.frequency_hz
        return live

    def touch(
        self, t_s: float, x_mm: float, y_mm: float, normal_force_n: float, touch_id: int = 0
    ) -> None:
        """Take the place of a finger.

        Parameters
        ----------
        t_s, x_mm, y_mm : float
            By the clock.
        normal_force_n : float
            With which it truly presses [N].
        touch_id : int
            Which finger.
        """
        last, speed = self._touches.get(touch_id), 0.0
        if last is not None and t_s > last.t_s:
            speed = float(np.hypot(x_mm - last.x_mm, y_mm - last.y_mm)) / (t_s - last.t_s)
        self._touches[touch_id] = _Place(t_s, x_mm, y_mm, normal_force_n, speed)

    def lift(self, touch_id: int = 0) -> None:
        """Take a finger off."""
        self._touches.pop(touch_id, None)

    def __call__(self, voltage_v: float, t_s: float) -> complex:
        """Return the complex capacitance [F] of panel and fingers at an amplitude and time.

        Several fingers add up, each with a body of its own.
        """
        made_s, farads = self._kept
        if 0 <= t_s - made_s < _KEPT_S:
            return farads
        current, now_s = self.current, self._clock()
        farads = current.panel_f(t_s)
        for place in [*self._touches.values()]:  # another thread may pass touches
            is_fresh = now_s - place.t_s < _RESTS_AFTER_S
            slides = is_fresh and place.speed_mm_per_s >= STANDING_BELOW_MM_PER_S
            farads += current.farads(place.normal_force_n, voltage_v, slides, t_s)
        farads /= 1 + 1j * current.frequency_hz / current.converter.pole_hz
        self._kept = t_s, farads
        return farads


class _Place(NamedTuple):
    t_s: float
    x_mm: float
    y_mm: float
    normal_force_n: float
    speed_mm_per_s: float


_RESTS_AFTER_S = 0.06  # without a report for so long
_KEPT_S = 0.001  # a capacitance, of some 4,000 that a converter asks for in a second
