"""The observer: from the current through a contact to the properties of the finger.

It takes readings only while one finger slides under enough voltage, and names in
`FingerEstimate.state` why it takes none. Two filters read them: one believes the converter, the
other lets its gain drift and follow the voltage. Each counts by how likely it makes the readings.
"""

from __future__ import annotations

import logging
from collections import deque
from dataclasses import dataclass
from enum import StrEnum
from math import inf, nan, pi

import numpy as np

from haptix.base.checks import Array, Positive, checked, number, positive
from haptix.base.display import Displayed
from haptix.play.devices import CurrentReading
from haptix.play.sensing.contact import (
    FORCE,
    ROUGHNESS,
    SKIN,
    STIFFNESS,
    Averaged,
    ContactCurrent,
    EnrolledFinger,
    parts,
)
from haptix.play.sensing.finger_filter import FingerFilter
from haptix.play.sensing.panel import PanelBaseline

_LOG = logging.getLogger("haptix.play.sensing")

_PF = 1e-12
_KEPT_AVERAGES = 1000  # 20 s
# So many times its distance from the population's median, in the population's sigmas, an estimate
# is less sure than the filter states: a finger beyond the population is taken for one at its edge.
_WIDER = 2.0
# Standard deviation of ln of the attraction at a known current, between contact laws: by the three
# of docs/sensing.md.
_THEORY = 0.2


class Knowledge(StrEnum):
    """What stands behind an estimate."""

    NO_SENSOR = "no reading of the current has come"
    NOTHING = "nothing yet"
    LEARNS = "learns"
    RESTS = "the finger rests"
    LIFTED = "no finger"
    TWO = "several fingers"
    LOW = "voltage too low"
    NO_BASELINE = "the panel was not measured untouched"
    SENSOR = "sensor not trusted"


@checked()
class SensingSettings(Displayed):
    """Numbers of the observer.

    Parameters
    ----------
    least_v : float
        Amplitude from which readings count [V].
    least_mm_per_s : float
        Speed from which a finger slides [mm/s]: at rest the contact differs.
    probe_v : float
        Amplitude while nobody touches [V]: it measures the panel's baseline. A finger that comes
        down feels it until its touch is reported: 20 V are 0.03 JND.
    settled_s : float
        Slid for so long before readings count, and untouched for so long before and after those of
        the baseline, since touches are reported late [s].
    update_s : float
        Readings are averaged over this [s].
    lost_s : float
        Without a reading for so long, or with one older than this, the sensor is not trusted [s].
    regained_s : float
        Good readings for so long make it trusted again [s].
    kept_s : float
        A touch within this time after the last one is by the same finger [s].
    force_per_rt_s, skin_per_rt_s, panel_f_per_rt_s : float
        Wander of the logarithms of force and skin, and of the panel, over a second.
    drift_per_s, gain_per_v : float
        Standard deviations of how a poor converter's gain changes in a second, and with the
        amplitude in a volt.
    baseline_s : float
        Time over which the untouched panel is averaged [s].
    force_sd : float
        Standard deviation of the logarithm of a force that is measured.
    """

    least_v: Positive = 20.0
    least_mm_per_s: Positive = 5.0
    probe_v: Positive = 20.0
    settled_s: Positive = 0.05
    update_s: Positive = 0.02
    lost_s: Positive = 0.008
    regained_s: Positive = 0.5
    kept_s: Positive = 1.0
    force_per_rt_s: Positive = 0.6
    skin_per_rt_s: Positive = 0.02
    panel_f_per_rt_s: Positive = 0.05e-12
    drift_per_s: Positive = 0.02
    gain_per_v: Positive = 3e-4
    baseline_s: Positive = 0.5
    force_sd: Positive = 0.1


@dataclass(frozen=True)
class FingerEstimate(Displayed):
    """Estimate of a finger; nan where nothing is known."""

    state: Knowledge
    log_gain: float
    """Logarithm of its attraction over the known finger's, at the force the renderer takes: 0
    while the difference is within the error of the readings and the theory."""
    log_gain_sd: float
    force_n: float
    """Normal force [N], and the standard deviation of its logarithm."""
    force_sd: float
    stiffness_and_roughness: float
    """``e s^3``, what divides the attraction, over the known finger's; as above."""
    stiffness_and_roughness_sd: float
    skin: float
    """Insulating thickness of the skin over the known finger's: moisture lowers it."""
    skin_sd: float
    readings: int
    """That it rests on."""

    def __str__(self) -> str:
        return (
            f"{self.state.value}: attraction {np.exp(self.log_gain):.2f} of the known finger's "
            f"(+-{self.log_gain_sd:.0%}), force {self.force_n:.2f} N (+-{self.force_sd:.0%}), "
            f"stiffness and roughness {self.stiffness_and_roughness:.2f} "
            f"(+-{self.stiffness_and_roughness_sd:.0%}), skin {self.skin:.2f} "
            f"(+-{self.skin_sd:.0%}), {self.readings} readings"
        )


class FingerObserver:
    """Learns one finger from readings of the current.

    Parameters
    ----------
    contact : ContactCurrent
        The model of all fingers on this screen.
    settings : SensingSettings, optional
        Its numbers.
    person : EnrolledFinger, optional
        Enrolment of the person who touches. Without it each finger begins from the population.
    """

    def __init__(
        self,
        contact: ContactCurrent,
        settings: SensingSettings | None = None,
        person: EnrolledFinger | None = None,
    ) -> None:
        self.contact = contact
        self.settings = SensingSettings() if settings is None else settings
        self.person = person
        self.watch = SensorWatch(self.settings, contact.frequency_hz)
        self._panel = PanelBaseline(self.settings.baseline_s, self.settings.probe_v)
        self._filters = [
            FingerFilter(
                contact,
                self._panel,
                drift_per_s,
                gain_per_v,
                self.settings.force_per_rt_s,
                self.settings.skin_per_rt_s,
                self.settings.panel_f_per_rt_s,
            )
            for drift_per_s, gain_per_v in (
                (0.0, 0.0),
                (self.settings.drift_per_s, self.settings.gain_per_v),
            )
        ]
        self._untouched: deque[tuple[float, complex, float]] = deque()
        self._fingers, self._slides_since, self._lifted_s = 0, inf, -inf
        self._force_n: float | None = None
        self._assumed_n = contact.population.force_n
        self._variance_f2 = 0.0
        self._last: tuple[float, complex] | None = None
        self._bin: list[CurrentReading] = []
        self.averages: deque[Averaged] = deque(maxlen=_KEPT_AVERAGES)
        """What counted since the finger was last forgotten."""
        self._readings = 0
        self._voltage_v = 0.0
        self._state = Knowledge.NO_SENSOR
        self.forget()

    def forget(self) -> None:
        """Begin anew, from the population or the person that was enrolled."""
        for each in self._filters:
            each.begin(None if self.person is None else self.person.moments)
        self._readings, self._variance_f2 = 0, 0.0
        self.averages.clear()
        self._last = None
        self._bin = []

    @property
    def baseline_f(self) -> complex:
        """Capacitance of the untouched panel [F]; nan before it was measured."""
        return self._panel.farads

    @baseline_f.setter
    def baseline_f(self, farads: complex) -> None:
        self._panel.farads = farads

    def enrolled(self, screen: str = "") -> EnrolledFinger:
        """Return the estimate, to give to the observer of the same person another time.

        Parameters
        ----------
        screen : str
            Name of the screen.
        """
        mean, covariance = max(self._filters, key=lambda each: each.log_likelihood).latent
        return EnrolledFinger(
            mean=tuple(mean.tolist()),
            covariance=tuple(map(tuple, covariance.tolist())),
            screen=screen,
            frequency_hz=self.contact.frequency_hz,
            slid=parts([*self.averages]),
        )

    def touched(
        self,
        t_s: float,
        fingers: int,
        speed_mm_per_s: float = 0.0,
        normal_force_n: float | None = None,
        assumed_n: float | None = None,
    ) -> None:
        """Take what touches say, by the clock of the readings.

        Parameters
        ----------
        t_s : float
            When it was so [s].
        fingers : int
            On the screen.
        speed_mm_per_s : float
            Of the only one.
        normal_force_n : float, optional
            Its force, where it is measured [N].
        assumed_n : float, optional
            The force that the renderer takes instead [N].
        """
        settings = self.settings
        if fingers and not self._fingers:
            self._untouched.clear()
            if t_s - self._lifted_s > settings.kept_s:
                self.forget()
            else:
                for each in self._filters:
                    each.touched()
        elif self._fingers and not fingers:
            self._lifted_s = t_s
        if fingers != 1 or speed_mm_per_s < settings.least_mm_per_s:
            self._slides_since = inf
        elif self._slides_since == inf:
            self._slides_since = t_s
        self._fingers = fingers
        self._force_n = normal_force_n
        if assumed_n is not None:
            self._assumed_n = positive("assumed_n", assumed_n)

    def read(self, reading: CurrentReading, now_s: float) -> bool:
        """Take a reading; return whether the estimate has changed.

        Parameters
        ----------
        reading : CurrentReading
            The reading.
        now_s : float
            When it arrives [s].
        """
        before = (self._state, self._readings)
        was_trusted = self.watch.is_trusted
        is_good = self.watch.read(reading, now_s, self.baseline_f)
        if was_trusted and not self.watch.is_trusted:
            _LOG.warning("the sensor of current is not trusted: %s", self.watch.problem)
            self.forget()
        self._state = self._why_not(reading)
        is_good = is_good and self.watch.is_trusted
        if is_good and not self._fingers and not reading.is_saturated:
            self._measure_panel(reading)
        # A single one that cannot be right ends no trust, and does not count.
        if is_good and self._state is Knowledge.LEARNS:
            self._take(reading)
        else:
            self._last, self._bin = None, []
        return before != (self._state, self._readings)

    def _why_not(self, reading: CurrentReading) -> Knowledge:
        settings = self.settings
        if not self.watch.is_trusted:
            return Knowledge.SENSOR
        if not self._panel.is_measured:
            return Knowledge.NO_BASELINE
        if not self._fingers:
            return Knowledge.LIFTED
        if self._fingers > 1:
            return Knowledge.TWO
        if reading.t_s < self._slides_since + settings.settled_s:
            return Knowledge.RESTS
        return Knowledge.LOW if reading.driven_v < settings.least_v else Knowledge.LEARNS

    def _farads(self, reading: CurrentReading) -> complex:
        current = complex(reading.in_phase_a, reading.quadrature_a)
        return current / (2j * pi * self.contact.frequency_hz * reading.driven_v)

    def _measure_panel(self, reading: CurrentReading) -> None:
        """Average the untouched panel, without readings that a touch reported later had changed."""
        settings = self.settings
        if reading.driven_v < settings.least_v / 2 or (
            reading.t_s < self._lifted_s + settings.settled_s
        ):
            return
        self._untouched.append((reading.t_s, self._farads(reading), reading.driven_v))
        while self._untouched and self._untouched[0][0] < reading.t_s - settings.settled_s:
            self._panel.read(*self._untouched.popleft())

    def _take(self, reading: CurrentReading) -> None:
        """Average some readings, and let them count."""
        self._bin.append(reading)
        span = reading.t_s - self._bin[0].t_s
        if span < self.settings.update_s * 0.9 and len(self._bin) < 100:
            return
        farads = [self._farads(each) for each in self._bin if not each.is_saturated]
        volts = float(np.mean([each.driven_v for each in self._bin]))
        self._bin = []
        if not farads:
            return
        # The panel has no losses of its own: its phase is that of amplifier and converter.
        turn = abs(self.baseline_f) / self.baseline_f
        measured = (complex(np.mean(farads)) - self.baseline_f) * turn
        if self._last is None:
            self._last = (reading.t_s, measured)
            return
        change = abs(measured - self._last[1]) ** 2 / 4  # of each part
        share = max(1 / (self._readings + 1), 0.05)
        self._variance_f2 += share * (change - self._variance_f2)
        self._last = (reading.t_s, measured)
        self._readings += 1
        self._voltage_v = volts
        force_n = nan if self._force_n is None else self._force_n
        self.averages.append(Averaged(reading.t_s, force_n, volts, measured))
        # Of few readings the spread is not known: it counts as more than it seems.
        noise_f2 = self._variance_f2 * (1 + 4 / self._readings) + (0.02 * _PF) ** 2
        for each in self._filters:
            each.go_on(reading.t_s, self.settings.update_s)
            if self._force_n is not None:
                log_force = float(np.log(self._force_n / self.contact.population.force_n))
                each.measure_force(log_force, self.settings.force_sd)
            if not each.update(measured, volts, noise_f2):
                self.forget()
                return

    def _weights(self) -> Array:
        """How likely each filter is, by the readings."""
        logs = np.array([each.log_likelihood for each in self._filters])
        likely = np.exp(logs - logs.max())
        return np.asarray(likely / likely.sum())

    def estimate(self, now_s: float) -> FingerEstimate:
        """Return the estimate now; nothing moves the drive while the sensor is not trusted."""
        self.watch.check(now_s)
        if not self.watch.is_trusted and self._state is not Knowledge.SENSOR:
            # The estimate is as right after a silence as before it: only the drive is as
            # without sensing, since nothing shows whether the finger still is the same.
            _LOG.warning("the sensor of current is not trusted: %s", self.watch.problem)
            self._state = Knowledge.SENSOR
            self._last, self._bin = None, []
        state = self._state
        if state is Knowledge.LEARNS and not self._readings:
            state = Knowledge.NOTHING
        each_points = [each.points() for each in self._filters]
        latent = np.concatenate([points for points, _ in each_points])
        shares = self._weights()
        weight = np.concatenate(
            [share * one for share, (_, one) in zip(shares, each_points, strict=True)]
        )
        volts = max(self._voltage_v, self.settings.least_v)
        known = np.zeros((1, latent.shape[1]))
        force_n = self._force_n or self._assumed_n
        known[0, FORCE] = np.log(force_n / self.contact.population.force_n)
        attraction = self.contact.log_attraction(np.concatenate([latent, known]), volts)
        figures = np.column_stack([
            attraction[:-1] - attraction[-1],
            latent[:, FORCE],
            latent[:, STIFFNESS] + 3 * latent[:, ROUGHNESS],
            latent[:, SKIN],
        ])  # fmt: skip
        mean = weight @ figures
        sd = np.sqrt(weight @ (figures - mean) ** 2)
        # Empirical Bayes of one finger (the positive part of James and Stein): it differs by what
        # the estimate exceeds its own and the theory's error.
        error2 = sd[0] ** 2 + _THEORY**2
        log_gain = mean[0] * max(0.0, 1 - error2 / max(mean[0] ** 2, error2))
        sd[0] = np.hypot(sd[0], mean[0] - log_gain)
        at = weight @ latent
        far = np.linalg.norm(np.delete(at / self.contact.population.sd, FORCE))
        sd[[0, 2, 3]] *= max(1.0, _WIDER * float(far))
        if self._force_n is None:
            sd[1] *= max(1.0, _WIDER * float(far))
        is_known = self._readings > 0 or self.person is not None
        return FingerEstimate(
            state,
            float(log_gain) if is_known and self.watch.is_trusted else 0.0,
            float(sd[0]),
            float(self.contact.population.force_n * np.exp(mean[1])),
            float(sd[1]),
            float(np.exp(mean[2])),
            float(sd[2]),
            float(np.exp(mean[3])),
            float(sd[3]),
            self._readings,
        )


class SensorWatch:
    """Whether the readings can be those of a panel: one that cannot ends trust.

    Parameters
    ----------
    settings : SensingSettings
        Times.
    frequency_hz : float
        Of the carrier.
    """

    def __init__(self, settings: SensingSettings, frequency_hz: float) -> None:
        self._settings = settings
        self._angular = 2 * pi * number("frequency_hz", frequency_hz)
        self.is_trusted = True
        self.problem = ""
        self._bad = 0
        self._last: CurrentReading | None = None
        self._heard_s = nan
        self._equal = 0
        self._good_since = inf
        self._looked_s = nan
        self._away_s = 0.0

    def look(self, now_s: float) -> None:
        """Begin to take all readings that wait: those of a time without a look are late by us."""
        away_s = now_s - self._looked_s
        self._looked_s = now_s
        self._away_s = away_s if away_s > self._settings.lost_s else 0.0
        # Half of the forgiven time at most, so that a silent sensor is found whatever holds us up.
        self._heard_s += max(self._away_s - self._settings.lost_s / 2, 0.0)

    def read(self, reading: CurrentReading, now_s: float, baseline_f: complex) -> bool:
        """Judge a reading; return whether it may be right."""
        problem = self._problem(reading, now_s, baseline_f)
        self._heard_s = now_s
        self._last = reading
        if not problem:
            self._bad = 0
            self._good_since = min(self._good_since, now_s)
            if not self.is_trusted and now_s - self._good_since >= self._settings.regained_s:
                self.is_trusted, self.problem = True, ""
                _LOG.info("the sensor of current is trusted again")
            return True
        self._bad += 1
        self._good_since = inf
        if self._bad >= _MOST_BAD or problem in _AT_ONCE:
            self.is_trusted, self.problem = False, problem
        return False

    def check(self, now_s: float, problem: str | None = None) -> bool:
        """Judge that none has come, or a problem that is known; return whether it is trusted."""
        if problem or now_s - self._heard_s > self._settings.lost_s:
            self.is_trusted, self.problem = False, problem or "no reading"
            self._good_since = inf
        return self.is_trusted

    def _problem(self, reading: CurrentReading, now_s: float, baseline_f: complex) -> str:
        last, (t_s, in_phase, ahead, volts, _) = self._last, reading
        current = complex(in_phase, ahead)
        if not (np.isfinite(t_s) and np.isfinite(current) and np.isfinite(volts)):
            return "no numbers"
        if last is not None and t_s <= last.t_s:
            return "time stands"
        most_s = self._settings.lost_s + _LATE_S + self._away_s
        if not -self._settings.lost_s < now_s - t_s < most_s:
            return "late"
        same = last is not None and (in_phase, ahead) == (last.in_phase_a, last.quadrature_a)
        self._equal = self._equal + 1 if same and volts > self._settings.least_v / 2 else 0
        # Noise repeats both parts in a thousandth of cases, at another voltage never.
        if self._equal and last is not None and abs(volts - last.driven_v) > 0.01 * volts:
            return "stuck"
        if self._equal >= _STUCK:
            return "stuck"
        if volts < self._settings.least_v / 2 or np.isnan(baseline_f):
            return ""
        farads = current / (1j * self._angular * volts)
        size = abs(baseline_f)
        # 30 % below the panel it is broken; no body adds more than 300 pF.
        off = farads - baseline_f
        noise = 0.05 * size
        if off.real < -0.3 * size or abs(off.imag) > 0.3 * size + noise:
            return "far from the panel"
        return "more than a body" if off.real > 300 * _PF + noise else ""


# At 250 readings a second both are within 10 ms.
_MOST_BAD = 2  # in turn
_STUCK = 2  # repeats of both parts of a reading
_AT_ONCE = ("stuck", "no reading")
_LATE_S = 0.004  # of transport
