"""The rig's check: how far its forces and volts are from known ones, and its sensor's bandwidth.

A gain of the tangential force looks like friction, and an amplifier that is weak behind its monitor
like a thicker insulator: no stroke tells them apart. A known weight on each axis and a second
reading of the volts do.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import replace
from datetime import UTC, date, datetime
from itertools import pairwise
from math import hypot, inf, isfinite, log, log2, pi, sqrt
from typing import Annotated, NamedTuple, Self

import numpy as np
import torch
from pydantic import Field, PositiveFloat, model_validator
from scipy.optimize import least_squares

from calibration.measure.clocks import even_times, sine_amplitude
from calibration.measure.measuring import record_stroke
from calibration.measure.recording_checks import force_unit
from calibration.measure.reduction import Reduced
from calibration.measure.sources import ForceSource
from calibration.plan.parameters import PER_RIG, Array
from calibration.plan.predict import sensor_gain
from calibration.plan.protocol import CARRIER_HZ, FREQUENCY_HZ, Stroke
from firmware_io import Device
from haptix.base.checks import positive
from haptix.base.documents import Document, Part
from haptix.base.errors import InputError
from haptix.model.perception.thresholds import WEBER_FRACTION

_BEFORE_S, _AFTER_S = 0.005, 0.2  # of the highest force: a resonance has died away by then
# Of the sampling rate: above it a card without a filter shows frequencies beyond half its rate.
_LOWEST_HZ, _HIGHEST_SHARE = 40.0, 0.3
_LEAST_PEAK = 100.0  # of the noise before it: a pole of a weaker tap may be off by 40 %
_FLOOR_LEFT = 0.3  # of the noise's own spectrum, below which a difference to it means nothing
_AVERAGED, _LEAST_POWER = 21, 10.0  # of the noise's: a spectrum ends where its mean power is lower
# Pole, resonance and quality to start from.
_STARTS = ((700.0, 6000.0, 8.0), (3000.0, 700.0, 8.0), (3000.0, 1500.0, 8.0), (3000.0, 6000.0, 8.0))
_LOG_BOUNDS = np.log([[100.0, 150.0, 0.6], [1e5, 1e5, 200.0]])
_BLOW_S, _BLOW_BOUNDS_S = 8e-5, (2e-5, 2.5e-4)  # length of a hard tip's blow
_LEAST_BLOW = 0.03  # of its spectrum: real blows have no true zeros
RIG = "rig.toml"
"""Name of the check in a session's folder."""

# Of pole, resonance and quality: the blow's form is not known, and a pole above a resonance is seen
# little.
_TAP_SPREADS = (0.2, 0.05, 0.3)
_STRAIGHT = 0.05  # by which two gains of one axis may differ
_BEYOND_SCALE = (0.5, 2.0)  # a reading over the known value: outside it is in another unit
# Amplitude, V rms and V peak to peak are powers of sqrt(2) apart; both instruments and the
# amplifier are within this of such a power, where one is taken for another.
_NEAR_POWER = 0.05
_TESTED_SHARES = (0.25, 0.6, 1.0)  # of the highest amplitude: an amplifier may be weak there alone


class TapResponse(NamedTuple):
    """Bandwidth by a tap, see `calibration.plan.predict.sensor_gain`.

    A pole or resonance far above the recording's band is not seen in it.
    """

    pole_hz: float
    resonance_hz: float
    quality: float


def tap_response(t_s: Array, force_n: Array) -> TapResponse:
    """Fit the spectrum of a tap, shape (samples,) each; a hard tip's blow is shorter than 0.2 ms.

    The blow is taken as half a sine, whose length is fitted, too: a pole looks like a longer blow.
    Raises `InputError` if no tap stands out of the noise.
    """
    step = float(np.median(np.diff(t_s)))
    force = force_n - np.median(force_n)
    peak = int(np.abs(force).argmax())
    noise = float(np.median(np.abs(force))) / 0.6745
    if abs(force[peak]) < _LEAST_PEAK * max(noise, 1e-12) or not step > 0:
        raise InputError(
            f"tap: expected a blow of {_LEAST_PEAK:g} times the noise or more, got "
            f"{abs(force[peak]) / max(noise, 1e-12):.2g} times; tap harder, with a metal tip"
        )
    first = max(peak - round(_BEFORE_S / step), 0)
    part = force[first : peak + round(_AFTER_S / step)]
    hertz = np.fft.rfftfreq(len(part), step)
    size = np.abs(np.fft.rfft(part)) * step
    floor = noise * step * np.sqrt(len(part))
    size = np.sqrt(np.maximum(size**2 - floor**2, (_FLOOR_LEFT * floor) ** 2))
    used = (hertz > _LOWEST_HZ) & (hertz < _HIGHEST_SHARE / step)
    power = np.convolve(size**2, np.full(_AVERAGED, 1 / _AVERAGED), "same")
    shown = used & (power > _LEAST_POWER * floor**2)
    if shown.sum() < _AVERAGED:
        raise InputError("tap: its spectrum is below the noise; tap harder, with a metal tip")
    used &= hertz <= hertz[shown].max()
    column, wanted = torch.as_tensor(hertz[used]), np.log(np.maximum(size[used], 1e-30))
    # Of the logarithm, whose error is the noise's share; a floor for errors beside the sensor's.
    error = np.hypot(floor / np.maximum(size[used], 1e-30), 0.05)

    def residual(values: Array) -> Array:
        sensor = dict(zip(PER_RIG, torch.as_tensor(np.exp(values[1:4])), strict=True))
        gain = np.log(sensor_gain(sensor, column).numpy()) + _blow(
            column.numpy(), values[4] * _BLOW_S
        )
        return np.asarray((values[0] + gain - wanted) / error)

    level = float(wanted[: max(len(wanted) // 20, 3)].mean())
    length = np.divide(_BLOW_BOUNDS_S, _BLOW_S)
    bounds = np.vstack([[level - 3, level + 3], _LOG_BOUNDS.T, length]).T
    fits = [
        least_squares(residual, [level, *np.log(start), 1.0], bounds=bounds, loss="soft_l1")
        for start in _STARTS
    ]
    best = min(fits, key=lambda fit: float(fit.cost))
    return TapResponse(*np.exp(best.x[1:4]).tolist())


def _blow(hertz: Array, length_s: float) -> Array:
    """Logarithm of the spectrum of half a sine, 1 at 0 Hz: cos(pi x / 2) / (1 - x^2), x = 2 f T."""
    x = 2 * hertz * length_s
    # The same without its removable pole at x = 1; np.sinc(x) is sin(pi x) / (pi x).
    spectrum = np.pi / 4 * (np.sinc((x - 1) / 2) + np.sinc((x + 1) / 2))
    return np.log(np.hypot(spectrum, _LEAST_BLOW))


class VoltsRead(Part):
    """An amplitude by a second instrument."""

    frequency_hz: PositiveFloat
    monitor_v: PositiveFloat
    """Frequency [Hz], and the amplitude [V] that the recordings show."""
    gain: PositiveFloat
    """Amplitude on the screen over that of the recordings."""


class RigCheck(Document):
    """What known forces and volts read; each gain of a force is the reading over the known value.

    Known gains are taken off the readings of the strokes (`corrected`); their uncertainty stays.
    """

    normal_gain: float
    tangential_gain: float
    """Reading of each axis under a known weight over its force; 1 where sign, unit and scale are
    right."""
    second_tangential_gain: float | None = None
    """The same of the tangential axis under a second weight, or at another angle: it shows what is
    no gain, such as friction of the pulley. None where it was not tried."""
    force_gain_spread: PositiveFloat = 0.005
    """Relative standard uncertainty of either gain: that of the weight and of the reading."""
    voltage_gain: float | None = None
    """Amplitude on the screen over that in the recordings, where one number holds for all
    amplitudes and frequencies."""
    volts: tuple[VoltsRead, ...] = ()
    """The same at several amplitudes and frequencies."""
    voltage_gain_spread: PositiveFloat = 0.005
    """Its relative standard uncertainty."""
    pole_hz: PositiveFloat | None = None
    resonance_hz: PositiveFloat | None = None
    quality: Annotated[float | None, Field(gt=0)] = None
    """Bandwidth of the tangential axis by a tap: a pole of first order, a resonance and its
    quality; None where none is seen."""
    instruments: tuple[str, ...] = ()
    """The references: the weight, the voltmeter."""
    measured_on: date | None = None
    """Day of the check."""

    @model_validator(mode="after")
    def _is_finite(self) -> Self:
        gains = self.normal_gain, self.tangential_gain, self._volts, self._second
        if not all(isfinite(gain) and gain != 0 for gain in gains):
            raise ValueError("expected gains that are finite and not 0: is a channel dead?")
        return self

    @property
    def _volts(self) -> float:
        return 1.0 if self.voltage_gain is None else self.voltage_gain

    @property
    def _second(self) -> float:
        second = self.second_tangential_gain
        return self.tangential_gain if second is None else second

    def faults(self) -> list[str]:
        """Return the errors beyond the scale of a gain, with the remedy."""
        faults = []
        for name in ("normal", "tangential"):
            gain = getattr(self, f"{name}_gain")
            if gain < 0:
                faults.append(f"the {name} force has the wrong sign: give its channel scale x -1")
            elif not _BEYOND_SCALE[0] < gain < _BEYOND_SCALE[1]:
                unit = force_unit(gain)
                hint = f"is it in {unit}? Say so in the column map" if unit else "check its unit"
                faults.append(f"the {name} force reads {gain:.3g} times a known weight: {hint}")
        if abs(self._second / self.tangential_gain - 1) > _STRAIGHT:
            faults.append(
                f"the tangential force reads {self.tangential_gain:.3g} times one weight and "
                f"{self._second:.3g} times another, expected the same within {_STRAIGHT:.0%}: let "
                "the thread run free and level, and zero the sensor"
            )
        return [*faults, *self._faults_of_volts()]

    def _faults_of_volts(self) -> list[str]:
        gains = np.array([one.gain for one in self.volts] or [self._volts])
        if gains.min() < 0:
            return ["voltage_gain: expected a ratio of amplitudes, above 0"]
        power = 2 * log2(float(np.median(gains)))
        usual = sqrt(2) ** round(power)
        if round(power) and np.abs(gains / usual - 1).max() < _NEAR_POWER:
            return [
                f"the screen's volts are {usual:.3g} times those of the recordings at every "
                "reading, as where V rms, an amplitude or V peak to peak is taken for another: "
                "give the voltmeter's readings in V rms, and let the recordings (--monitor-v) "
                "show the amplitude"
            ]
        low, high = _BEYOND_SCALE
        return [
            f"the screen's volts are {gain:.3g} times those of the recordings, expected {low:g} to "
            f"{high:g}: check the scale of the drive's channel, the amplifier and the voltmeter"
            for gain in gains[(gains < low) | (gains > high)][:1]
        ]

    def days_from(self, day: date | None) -> int:
        """Days between the check and `day`; 0 where either is not known."""
        if self.measured_on is None or day is None:
            return 0
        return abs((self.measured_on - day).days)

    def sensor(self) -> dict[str, tuple[float, float]]:
        """Value and spread of each of `PER_RIG`; empty without a tap."""
        values = self.pole_hz, self.resonance_hz, self.quality
        return {
            name: (value, spread)
            for name, value, spread in zip(PER_RIG, values, _TAP_SPREADS, strict=True)
            if value is not None
        }

    @property
    def reads_volts(self) -> bool:
        """Whether a second instrument read the volts."""
        return self.voltage_gain is not None or bool(self.volts)

    @property
    def knows_volts(self) -> bool:
        """Whether they were read at three levels and two frequencies, or more."""
        levels = Counter(reading.frequency_hz for reading in self.volts)
        return sum(count >= len(_TESTED_SHARES) for count in levels.values()) >= 2

    @property
    def volts_spread(self) -> float:
        """Relative standard uncertainty of the volts: of a reading, and between two of them."""
        steps = [
            abs(b.gain / a.gain - 1)
            for a, b in pairwise(sorted(self.volts, key=lambda r: (r.frequency_hz, r.monitor_v)))
            if a.frequency_hz == b.frequency_hz
        ]
        return hypot(self.voltage_gain_spread, max(steps, default=0.0) / 6)

    @property
    def highest_read_v(self) -> float:
        """Highest amplitude [V] that was read; infinite where one gain holds for all."""
        if not self.volts:
            return inf if self.reads_volts else 0.0
        return max(reading.monitor_v * reading.gain for reading in self.volts)

    def gain_of_volts(self, voltage_v: float, frequency_hz: float) -> float:
        """Gain at an amplitude that the recordings show, by the readings at the next frequency."""
        if not self.volts:
            return self._volts
        next_hz = min(
            {reading.frequency_hz for reading in self.volts},
            key=lambda hz: abs(log(hz / frequency_hz)),
        )
        read = sorted((r.monitor_v, r.gain) for r in self.volts if r.frequency_hz == next_hz)
        return float(np.interp(voltage_v, *np.transpose(read)))

    def corrected(self, reduced: Reduced) -> Reduced:
        """Return reduced strokes without the gains; as they are where the rig has a fault.

        A wrong sign or unit is no gain: `verify` refuses it.
        """
        if self.faults():
            return reduced
        ratio = self.normal_gain / self.tangential_gain
        return Reduced(
            tuple(
                replace(
                    point,
                    normal_force_n=point.normal_force_n / self.normal_gain,
                    voltage_v=point.voltage_v
                    * self.gain_of_volts(point.voltage_v, point.frequency_hz),
                    mu=ratio * point.mu,
                    mu_sd=ratio * point.mu_sd,
                )
                for point in reduced.points
            )
        )

    def friction_spread(self, volts_power: Array, force_power: Array) -> Array:
        """Standard uncertainty of friction [JND] that the gains leave, shape (strokes,).

        `volts_power` and `force_power` are d ln mu / d ln V and d ln mu / d ln F at the strokes.
        """
        normal = (1 + force_power) * self.force_gain_spread
        bent = (self._second / self.tangential_gain - 1) / sqrt(3)
        tangential = hypot(self.force_gain_spread, bent)
        both = np.hypot(np.hypot(normal, tangential), volts_power * self.volts_spread)
        return np.asarray(both / WEBER_FRACTION)


def measure_rig(
    source: ForceSource,
    weight_n: float,
    ask: Callable[[str], str],
    device: Device | None = None,
    record: Callable[[Stroke], Mapping[str, Array]] | None = None,
    highest_v: float = 200.0,
    second_weight_n: float | None = None,
) -> RigCheck:
    """Check a rig by its own instruments, a weight and a voltmeter.

    Raises `InputError` if a weight or the tap does not show.

    Parameters
    ----------
    source : ForceSource
        The instruments of the strokes.
    weight_n : float
        Force of the known weight [N].
    ask : callable
        Shows a prompt, returns when the person is ready, with the typed text; where that has to be
        a number and is none, it is asked again.
    device : Device, optional
        Plays three amplitudes at 125 Hz and at 4 kHz for the voltmeter; without it the volts are
        not checked.
    record : callable, optional
        Records one step; by default the source and the device do.
    highest_v : float
        Highest amplitude [V] of the strokes; at most the driver's limit is played.
    second_weight_n : float, optional
        Force along the screen of a second weight, or of the same one at another angle [N].
    """
    weight = positive("weight_n", weight_n)
    still = Stroke(number=1, normal_force_n=weight, voltage_v=0.0, frequency_hz=FREQUENCY_HZ)
    take = record or (lambda stroke: record_stroke(stroke, source, device))

    def mean(prompt: str, name: str) -> float:
        ask(prompt)
        return float(np.median(take(still)[name]))

    forces = "normal_force_n", "tangential_force_n"
    ask("Leave the screen free, then press Enter ")
    free = take(still)
    zero = [float(np.median(free[name])) for name in forces]
    normal = mean(f"Put {weight:g} N on the screen's middle, then press Enter ", forces[0])

    def pulled(by_n: float) -> float:
        how = "towards growing x (a thread over a pulley), then Enter "
        return (mean(f"Let {by_n:g} N pull the screen {how}", forces[1]) - zero[1]) / by_n

    tangential = pulled(weight)
    second = None
    if second_weight_n is not None:
        second = pulled(positive("second_weight_n", second_weight_n))
    ask("Take the weight off, press Enter and tap the screen's edge once along x, with metal ")
    tap = take(still)
    response = tap_response(even_times(tap["t_s"]), tap[forces[1]])
    known, read = [f"weight: {weight:g} N"], []
    for played in () if device is None else _played(still, device, highest_v):
        at = f"{played.voltage_v:g} V at {played.frequency_hz:g} Hz"
        ask(f"Put a voltmeter on the screen: {at} play, then Enter ")
        monitor = _amplitude(take(played), played)
        rms_v = _number(ask, f"What did it read [V rms] of {at}? ")
        gain = amplitude_gain(rms_v, monitor)
        read.append(VoltsRead(frequency_hz=played.frequency_hz, monitor_v=monitor, gain=gain))
    known += ["voltmeter"] * bool(read)
    return RigCheck(
        normal_gain=(normal - zero[0]) / weight,
        tangential_gain=tangential,
        second_tangential_gain=second,
        volts=tuple(read),
        **response._asdict(),
        instruments=tuple(known),
        measured_on=today(),
    )


def amplitude_gain(voltmeter_rms_v: float, monitor_v: float) -> float:
    """Amplitude of a sine that a voltmeter reads in V rms, over that of the recordings."""
    return voltmeter_rms_v * sqrt(2) / monitor_v


def _number(ask: Callable[[str], str], prompt: str) -> float:
    """Ask until the answer is a number above 0: the readings before it stand."""
    said = ""
    while True:
        typed = ask(said + prompt)
        try:
            return positive("voltmeter", float(typed))
        except (ValueError, InputError):
            said = f"Expected a number above 0, such as 35.3, got {typed!r}. "


def _played(still: Stroke, device: Device, highest_v: float) -> list[Stroke]:
    """Strokes whose drive a voltmeter reads, as high as the driver plays each frequency."""
    limits = device.limits
    strokes = []
    for hertz in (FREQUENCY_HZ, CARRIER_HZ):
        most = min(highest_v, limits.ceiling_v, 0.98 * limits.max_slew_v_per_s / (2 * pi * hertz))
        for share in _TESTED_SHARES:
            change = {"voltage_v": round(share * most, 1), "frequency_hz": hertz}
            strokes.append(still.model_copy(update=change))
    return strokes


def today() -> date:
    """Day of a check that is made now."""
    return datetime.now(UTC).date()


def _amplitude(signals: Mapping[str, Array], stroke: Stroke) -> float:
    """Amplitude [V] in the middle of a recording; as played where nothing measures it."""
    if "drive_v" not in signals:
        return stroke.voltage_v
    count = len(signals["t_s"])
    t, drive = (signals[name][count // 4 : 3 * count // 4] for name in ("t_s", "drive_v"))
    return positive("drive_v", sine_amplitude(even_times(t), drive, stroke.frequency_hz))
