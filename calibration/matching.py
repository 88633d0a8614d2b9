"""Two screens that are to feel alike: what friction both can give, and at which voltages."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import exp, hypot
from typing import Annotated

import numpy as np

from calibration.parameters import Array
from haptix.checks import positive
from haptix.errors import InputError
from haptix.finger import Finger
from haptix.friction import ContactModel
from haptix.perception import WEBER_FRACTION
from haptix.report import Heading
from haptix.screen import Screen
from haptix.status import Status

_VOLTAGES = 81  # of each curve: mu between them within 1e-4


@dataclass(frozen=True)
class MatchedFriction:
    """One friction that both screens can give.

    Parameters
    ----------
    normal_force_n, frequency_hz : float
        Where.
    mu : float
        The friction.
    voltage_a_v, voltage_b_v : float
        Amplitude that gives it on each screen [V].
    difference_thresholds : float
        Friction of B minus that of A where both have A's voltage, in just-noticeable differences;
        NaN past B's light contact.
    uncertainty_thresholds : float
        90 % uncertainty of either difference, from the spread of both profiles' insulators; NaN
        where a profile states none.
    """

    normal_force_n: float
    frequency_hz: float
    mu: Annotated[float, Heading("mu", ".3g")]
    voltage_a_v: Annotated[float, Heading("A [V]", ".1f")]
    voltage_b_v: Annotated[float, Heading("B [V]", ".1f")]
    difference_thresholds: Annotated[float, Heading("difference [JND]", "+.2f")]
    uncertainty_thresholds: Annotated[float, Heading("uncertainty [JND]", ".2f")]


@dataclass(frozen=True)
class Match:
    """Range of friction that both screens give at one force, and voltages in it.

    Where the ranges do not overlap `mu_high` is below `mu_low` and there are no levels.
    """

    normal_force_n: float
    mu_low: float
    mu_high: float
    levels: tuple[MatchedFriction, ...]

    @property
    def text(self) -> str:
        """One line for people."""
        if not self.levels:
            return f"no friction that both give: {self.mu_low:.3g} is above {self.mu_high:.3g}"
        return f"both give mu {self.mu_low:.3g} to {self.mu_high:.3g}"


def match_profiles(
    a: tuple[Screen, Finger],
    b: tuple[Screen, Finger],
    normal_force_n: Sequence[float] = (0.2, 0.5, 0.8),
    frequency_hz: float = 4000.0,
    levels: int = 5,
) -> list[Match]:
    """Compare two profiles, at each force [N].

    Friction is that of the steady attraction at an amplitude and a frequency, as surfaces hold it:
    by default the carrier of `haptix render`.
    """
    positive("frequency_hz", frequency_hz)
    if levels < 2:
        raise InputError(f"levels: expected 2 or more, got {levels}")
    curves_a, curves_b = _Curves(*a, frequency_hz), _Curves(*b, frequency_hz)
    found = []
    for force in normal_force_n:
        positive("normal_force_n", force)
        of_a, of_b = curves_a.at(force), curves_b.at(force)
        low, high = max(of_a[1][0], of_b[1][0]), min(of_a[1][-1], of_b[1][-1])
        rows = []
        for mu in np.linspace(low, high, levels) if high > low else ():
            volts_a, volts_b = (float(np.interp(mu, curve, level)) for level, curve in (of_a, of_b))
            there = float(np.interp(volts_a, *of_b, right=np.nan))
            own = hypot(curves_a.spread(force, volts_a), curves_b.spread(force, volts_b))
            rows.append(
                MatchedFriction(
                    force,
                    frequency_hz,
                    float(mu),
                    volts_a,
                    volts_b,
                    (there / float(mu) - 1) / WEBER_FRACTION,
                    1.645 * own / WEBER_FRACTION,
                )
            )
        found.append(Match(force, float(low), float(high), tuple(rows)))
    return found


class _Curves:
    """Friction of one screen over its voltages, as far as the contact stays light."""

    def __init__(self, screen: Screen, finger: Finger, frequency_hz: float) -> None:
        self._model = ContactModel(finger, screen)
        self._frequency_hz = frequency_hz
        made = screen.calibration
        self._log_sd = float("nan") if made is None else made.spread.get("h0_m", float("nan"))

    def at(self, force: float, h0_factor: float = 1.0) -> tuple[Array, Array]:
        """Voltages [V] and friction at them."""
        screen = self._model.screen
        volts = np.linspace(0.0, screen.max_voltage_v, _VOLTAGES)
        found = self._model.solve(force, volts, self._frequency_hz, screen.h0_m * h0_factor)
        light = np.cumprod(np.asarray(found.status) == int(Status.OK)).astype(bool)
        if not light.any():
            raise InputError(f"screen {screen.name!r}: no light contact at {force:g} N")
        return volts[light], np.asarray(found.mu, dtype=float)[light]

    def spread(self, force: float, voltage_v: float) -> float:
        """Standard deviation of ln mu at a voltage, from that of the insulator."""
        if not self._log_sd > 0:
            return self._log_sd
        log_mu = [
            float(np.log(np.interp(voltage_v, *self.at(force, exp(side * self._log_sd)))))
            for side in (-1, 1)
        ]
        return abs(log_mu[1] - log_mu[0]) / 2
