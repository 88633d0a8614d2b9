"""The protocol: the strokes to make, as a file that a person can read and edit.

The strokes of a short protocol are chosen for their information about the parameters.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import chain, cycle, islice, product
from math import ceil, pi
from typing import Annotated, Self

import numpy as np
from pydantic import Field, PositiveFloat, model_validator

from calibration.plan.parameters import Array, Mask, Parameters
from calibration.plan.predict import StrokeConditions, StrokePredictor
from firmware_io import DriveLimits
from haptix.base.checks import positive
from haptix.base.documents import Document, Part
from haptix.base.errors import InputError
from haptix.model.presets import DEFAULT_CARRIER_HZ

FORCES_N = (0.1, 0.3, 0.5, 0.7, 0.9)
VOLTAGES_V = (0.0, 50.0, 100.0, 150.0, 200.0)
FREQUENCY_HZ = 125.0
"""The paper's strokes: every force with every voltage, at one frequency."""

SWEEP_HZ = (30.0, 60.0, 300.0, 1000.0, 4000.0)
"""Frequencies that separate the screen's insulator from the skin's: each at every force."""

CARRIER_HZ = DEFAULT_CARRIER_HZ
"""Frequency at which `haptix render` plays."""

USUAL_MM_PER_S, _SLOW, _FAST = 50.0, 25.0, 100.0
LONG_CONTACT_S = 12.0
"""Time that one held-out stroke slides to and fro: by then a covered skin is nearly as soft as it
gets (term "occlusion")."""

# Normal force [N], share of the highest voltage, frequency [Hz], speed [mm/s] and time of sliding
# [s]: where the screen is used, light and firm, slow and fast, at the carrier and at the highest
# voltage. A short protocol takes the first ones.
_HELD_OUT = (
    (0.2, 1.0, CARRIER_HZ, _SLOW),
    (0.8, 1.0, CARRIER_HZ, _FAST),
    (0.2, 0.75, FREQUENCY_HZ, _FAST),
    (0.8, 0.75, FREQUENCY_HZ, _SLOW, LONG_CONTACT_S),
    (0.4, 0.875, CARRIER_HZ, _SLOW),
    (0.6, 1.0, FREQUENCY_HZ, _FAST),
    (0.6, 0.875, 60.0, _SLOW),
    (0.4, 0.875, 500.0, _FAST),
)
_COLUMNS = "normal_force_n", "voltage_v", "frequency_hz", "speed_mm_per_s", "contact_s"
# Of a short protocol.
_FREQUENCIES_HZ = (30.0, 60.0, 125.0, 300.0, 1000.0, 4000.0)
_VOLTAGE_SHARES = (0.0, 0.5, 0.75, 1.0)
_FEWEST_FITTED = 6
MOST_ADDED = 24
"""Fitted strokes beyond which no more are added to determine d1/eps1."""
_PLAYABLE_V_PER_S = 0.98 * DriveLimits().max_slew_v_per_s  # a driver's limit may be a little lower

MU_ERROR = 0.01
"""Expected repeatability of mu from stroke to stroke, relative: that of a good laboratory."""
RIPPLE_ERROR = 0.02
"""The same of the ripple at 2f, relative to the ripple; an error of 0.001 in mu is added."""

_SHUFFLE_SEED = 20180  # any fixed one, so that a plan is the same twice


class Stroke(Part):
    """One stroke of the finger.

    Parameters
    ----------
    number : int
        Number from 1, also in the name of its file.
    normal_force_n, voltage_v, frequency_hz : float
        Force [N] to hold, amplitude [V] and frequency [Hz] of the sine that is played.
    speed_mm_per_s, length_mm : float
        Speed [mm/s] and length [mm] of the slide.
    contact_s : float
        Least time [s] that the finger slides to and fro without lifting; 0: once.
    there_and_back : bool
        Whether the finger slides back under the same drive, which cancels the sensor's cross-talk.
    held_out : bool
        Whether it is kept out of the fit, for verification.
    """

    number: Annotated[int, Field(ge=1)]
    normal_force_n: PositiveFloat
    voltage_v: Annotated[float, Field(ge=0)]
    frequency_hz: PositiveFloat
    speed_mm_per_s: PositiveFloat = USUAL_MM_PER_S
    contact_s: Annotated[float, Field(ge=0, le=60, exclude_if=lambda value: value == 0.0)] = 0.0
    length_mm: PositiveFloat = 40.0
    there_and_back: bool = True
    held_out: bool = False

    @property
    def label(self) -> str:
        """One line for the person at the screen."""
        return (
            f"stroke {self.number}: {self.normal_force_n:g} N, {self.length_mm:g} mm {self.ways} "
            f"at {self.speed_mm_per_s:g} mm/s, {self.voltage_v:g} V at {self.frequency_hz:g} Hz"
        )

    @property
    def ways(self) -> str:
        """In which directions it slides, and how often."""
        if self.contact_s:
            return f"to and fro for {self.sliding_s:.0f} s without lifting"
        return "there and back" if self.there_and_back else "one way"

    @property
    def slides(self) -> int:
        """Number of times that the finger slides the length."""
        to_and_fro = 2 * ceil(self.contact_s * self.speed_mm_per_s / (2 * self.length_mm))
        return max(1 + self.there_and_back, to_and_fro)

    @property
    def sliding_s(self) -> float:
        """Time that the finger slides [s]."""
        return self.slides * self.length_mm / self.speed_mm_per_s


class Protocol(Document):
    """Strokes in the order in which they are made.

    Parameters
    ----------
    name : str
        Name, such as "paper", "full" or "short".
    idle_s : float
        Untouched time [s] at the start and the end of each recording: the sensor's zero.
    tolerance : float
        A stroke whose force or speed has a larger relative error is repeated.
    seconds_per_stroke : float
        Time for one stroke with its prompt [s], for the estimate of the total time.
    strokes : tuple of Stroke
        Numbers are unique.
    looks : int
        How often the verdict is looked at: once, and again after strokes were added to decide it.
    """

    name: str = "custom"
    idle_s: PositiveFloat = 0.3
    tolerance: Annotated[float, Field(gt=0, lt=1)] = 0.15
    seconds_per_stroke: PositiveFloat = 9.0
    strokes: tuple[Stroke, ...]
    looks: Annotated[int, Field(ge=1, le=9, exclude_if=lambda value: value == 1)] = 1

    @model_validator(mode="after")
    def _has_strokes(self) -> Self:
        numbers = [stroke.number for stroke in self.strokes]
        if not numbers:
            raise ValueError("expected at least one stroke")
        if len(set(numbers)) < len(numbers):
            raise ValueError("expected every stroke to have a number of its own")
        return self

    @classmethod
    def shuffled(
        cls,
        name: str,
        fitted: Iterable[Sequence[float]],
        held_out: Iterable[Sequence[float]],
        there_and_back: bool = True,
    ) -> Self:
        """Number strokes in random order, so that a finger that dries does not look like a force.

        An amplitude whose current no driver may play is lowered to one that it may.

        Parameters
        ----------
        name : str
            Name of the protocol.
        fitted, held_out : iterable
            Normal force [N], amplitude [V] and frequency [Hz] of each stroke, and where they
            are not the usual ones speed [mm/s] and time of sliding [s].
        there_and_back : bool
            Whether each is made in both directions.
        """
        rows = [(row, False) for row in fitted] + [(row, True) for row in held_out]
        order = np.random.default_rng(_SHUFFLE_SEED).permutation(len(rows)).tolist()
        strokes = [
            _stroke(number, row, is_held_out, there_and_back)
            for number, index in enumerate(order, start=1)
            for row, is_held_out in [rows[index]]
        ]
        return cls(name=name, strokes=tuple(strokes))

    @property
    def held_out(self) -> tuple[Stroke, ...]:
        """Strokes that are kept out of the fit."""
        return tuple(stroke for stroke in self.strokes if stroke.held_out)

    def extended(self, count: int, fitted: Iterable[Sequence[float]] = ()) -> Self:
        """Return the protocol with more strokes at its end, for another look at the verdict.

        Parameters
        ----------
        count : int
            Held-out strokes in all.
        fitted : iterable of sequences of float
            Fitted strokes to add: force [N], amplitude [V] and frequency [Hz] of each.
        """
        last, before = max(stroke.number for stroke in self.strokes), len(self.held_out)
        highest = max(stroke.voltage_v for stroke in self.strokes)
        rows = [(row, False) for row in fitted]
        rows += [(row, True) for row in _held_out(count, highest)[before:]]
        more = [
            _stroke(last + number, row, is_held_out, self.strokes[0].there_and_back)
            for number, (row, is_held_out) in enumerate(rows, start=1)
        ]
        return self.replace(strokes=(*self.strokes, *more), looks=self.looks + 1)

    @property
    def duration_s(self) -> float:
        """Estimated time at the screen [s]."""
        long_s = sum(stroke.contact_s for stroke in self.strokes)
        return len(self.strokes) * self.seconds_per_stroke + long_s


def _stroke(number: int, row: Sequence[float], held_out: bool, there_and_back: bool) -> Stroke:
    known = dict(zip(_COLUMNS, row, strict=False))
    playable_v = _PLAYABLE_V_PER_S / (2 * pi * known["frequency_hz"])
    known["voltage_v"] = round(min(known["voltage_v"], playable_v), 3)
    ways = {"there_and_back": there_and_back, "held_out": held_out}
    return Stroke.model_validate({"number": number, **known, **ways})


def paper_protocol(max_voltage_v: float = 200.0) -> Protocol:
    """Return the paper's 25 strokes, one way each, and 6 more that are held out.

    Examples
    --------
    >>> len(paper_protocol().strokes) > 10
    True
    """
    grid = product(FORCES_N, VOLTAGES_V, [FREQUENCY_HZ])
    rows = _scaled(grid, max_voltage_v), _held_out(6, max_voltage_v)
    return Protocol.shuffled("paper", *rows, there_and_back=False)


def full_protocol(max_voltage_v: float = 200.0) -> Protocol:
    """Return the paper's strokes and a frequency sweep at the highest voltage, there and back.

    Examples
    --------
    >>> len(full_protocol().strokes) > 10
    True
    """
    grid = product(FORCES_N, VOLTAGES_V, [FREQUENCY_HZ])
    sweep = product(FORCES_N, VOLTAGES_V[-1:], SWEEP_HZ)
    rows = _scaled(chain(grid, sweep), max_voltage_v), _held_out(8, max_voltage_v)
    return Protocol.shuffled("full", *rows)


def _scaled(rows: Iterable[Sequence[float]], max_voltage_v: float) -> list[Sequence[float]]:
    """Lower the paper's voltages in proportion for a screen that withstands less."""
    share = min(positive("max_voltage_v", max_voltage_v) / VOLTAGES_V[-1], 1.0)
    return [(force, share * volts, hertz) for force, volts, hertz in rows]


def _held_out(count: int, max_voltage_v: float) -> list[Sequence[float]]:
    highest = min(max_voltage_v, VOLTAGES_V[-1])
    # One long contact: what changes within it is seen by itself.
    again = [place[:4] for place in _HELD_OUT]
    places = islice(chain(_HELD_OUT, cycle(again)), count)
    return [(force, share * highest, *others) for force, share, *others in places]


def with_held_out(
    protocol: Protocol,
    count: int,
    max_voltage_v: float,
    more_fitted: Iterable[Sequence[float]] = (),
) -> Protocol:
    """Return the protocol with `count` held-out strokes in place of its own, and more fitted."""
    fitted: list[Sequence[float]] = [
        (stroke.normal_force_n, stroke.voltage_v, stroke.frequency_hz)
        for stroke in protocol.strokes
        if not stroke.held_out
    ]
    fitted += more_fitted
    held_out = _held_out(count, max_voltage_v)
    return Protocol.shuffled(protocol.name, fitted, held_out, protocol.strokes[0].there_and_back)


def expected_rows(
    predictor: StrokePredictor, parameters: Parameters, strokes: StrokeConditions
) -> tuple[Array, Mask]:
    """Jacobian of ln mu and of the ripple by the free parameters, in units of their errors.

    Shape (strokes, 2, free), and for each stroke whether the light contact lasts.
    """
    predicted = predictor(strokes, parameters.names, parameters.log_values)
    ripple_sd = np.hypot(RIPPLE_ERROR * predicted.ripple, 1e-3)
    of_mu, of_ripple = predicted.log_mu_jacobian, predicted.ripple_jacobian
    rows = np.stack([of_mu / MU_ERROR, of_ripple / ripple_sd[:, None]], axis=1)
    free = [parameters.names.index(name) for name in parameters.free]
    return rows[:, :, free], predicted.is_light


def expected_spread(
    predictor: StrokePredictor, parameters: Parameters, strokes: StrokeConditions
) -> dict[str, float]:
    """Standard deviation of each parameter's logarithm that is expected after the strokes."""
    rows, is_light = expected_rows(predictor, parameters, strokes)
    light = rows[is_light]
    information = parameters.prior_information() + (light.mT @ light).sum(0)
    spread = np.sqrt(np.diag(np.linalg.inv(information)))
    return dict(zip(parameters.free, spread.tolist(), strict=True))


def _candidates(max_voltage_v: float) -> tuple[Array, StrokeConditions]:
    """Strokes to choose from: force [N], amplitude [V], frequency [Hz], and their conditions."""
    volts = [max_voltage_v * share for share in _VOLTAGE_SHARES]
    places = np.array(list(product(FORCES_N, volts, _FREQUENCIES_HZ)))
    # Without voltage the frequency changes nothing: one of them is enough.
    places = places[(places[:, 1] > 0) | (places[:, 2] == FREQUENCY_HZ)]
    speeds = np.full(len(places), USUAL_MM_PER_S)
    return places, StrokeConditions(places[:, 0], places[:, 1], places[:, 2], speeds)


def determining_strokes(
    predictor: StrokePredictor,
    truths: Sequence[Parameters],
    information: Array,
    repeatability: float,
    max_voltage_v: float,
    largest_spread: float,
    share: float = 1.0,
) -> list[Sequence[float]] | None:
    """Choose fitted strokes, each the one that most lowers the spread of d1/eps1.

    Parameters
    ----------
    predictor : StrokePredictor
    truths : sequence of Parameters
        Fingers and screens on which they are to determine it.
    information : array, shape (truths, free, free)
        Prior, in the logarithms of the free parameters.
    repeatability : float
        Standard deviation of ln mu from stroke to stroke.
    max_voltage_v : float
        Highest amplitude [V].
    largest_spread : float
        Standard deviation of ln(d1/eps1) that is small enough.
    share : float
        Share of the truths in which it is to be as small.

    Returns
    -------
    list or None
        Rows as for `Protocol.shuffled`; None where `MOST_ADDED` strokes are not enough.
    """
    places, strokes = _candidates(max_voltage_v)
    at = truths[0].free.index("h0_m")
    expected = [expected_rows(predictor, truth, strokes) for truth in truths]
    rows, is_light = (np.array(part) for part in zip(*expected, strict=True))
    rows = rows * np.array([[MU_ERROR / repeatability], [1.0]]) * is_light[..., None, None]
    known, chosen = information.copy(), list[Sequence[float]]()
    while True:
        covariance = np.linalg.inv(known)
        if np.mean(covariance[:, at, at] <= largest_spread**2) >= share:
            return chosen
        if len(chosen) == MOST_ADDED:
            return None
        # Of two rows r (friction and ripple): C - C r' (1 + r C r')^-1 r C.
        seen = np.einsum("tsap,tpq->tsaq", rows, covariance)
        inner = np.einsum("tsaq,tsbq->tsab", seen, rows) + np.eye(2)
        of_h0 = seen[..., at]
        lowered = np.einsum("tsa,tsab,tsb->ts", of_h0, np.linalg.inv(inner), of_h0)
        left = np.maximum(1 - lowered / covariance[:, None, at, at], 1e-9)
        best = int(np.log(left).sum(0).argmin())
        chosen.append(places[best].tolist())
        known += rows[:, best].mT @ rows[:, best]


def short_protocol(
    predictor: StrokePredictor,
    parameters: Parameters,
    minutes: float = 3.0,
    max_voltage_v: float = 200.0,
    held_out: int = 4,
) -> Protocol:
    """Choose strokes one by one, each time the most informative one (D-optimal, greedy).

    Candidates are the paper's forces with four voltages and six frequencies. Their information is
    taken at the parameters' start, from which the true values may differ as their priors say; the
    screen's insulator is therefore tried at half and at twice its value as well.

    Parameters
    ----------
    predictor : StrokePredictor
    parameters : Parameters
        Parameters to fit.
    minutes : float
        Time at the screen [min], the long contact of one stroke included.
    max_voltage_v : float
        Highest amplitude [V].
    held_out : int
        How many strokes are kept for verification.

    Raises
    ------
    InputError
        If the time is too short, or the contact snaps in at all voltages.
    """
    places, strokes = _candidates(max_voltage_v)
    h0 = parameters["h0_m"].value
    cases = [
        expected_rows(predictor, parameters.started_at(h0_m=factor * h0), strokes)
        for factor in (0.5, 1.0, 2.0)
    ]
    usable = cases[1][1]
    if not usable[strokes.voltage_v > 0].any():
        raise InputError(
            f"max_voltage_v: expected one at which contact stays light, got {max_voltage_v:g} V; "
            "lower it"
        )
    each_s = float(Protocol.model_fields["seconds_per_stroke"].default)
    count = int((60 * minutes - LONG_CONTACT_S) / each_s + 1e-9)
    least = _FEWEST_FITTED + held_out
    if count < least:
        raise InputError(
            f"minutes: expected time for {least} strokes of {each_s:g} s or more "
            f"({(least * each_s + LONG_CONTACT_S) / 60:.2g} minutes), got {minutes:g} minutes"
        )
    prior = parameters.prior_information() + 1e-6 * np.eye(len(parameters.free))
    information = np.stack([prior] * len(cases))
    # Information of each candidate in each case, shape (cases, candidates, free, free).
    added = np.stack([light[:, None, None] * (rows.mT @ rows) for rows, light in cases])
    # Two without voltage come first: all others are compared with them.
    at_rest = (places[:, 1] == 0) & np.isin(places[:, 0], (FORCES_N[0], FORCES_N[-1]))
    chosen = np.flatnonzero(at_rest).tolist()
    information += added[:, chosen].sum(1)
    while len(chosen) < count - held_out:
        gain = np.zeros(len(places))
        for known, (rows, light) in zip(information, cases, strict=True):
            inner = np.einsum("sap,pq,sbq->sab", rows, np.linalg.inv(known), rows) + np.eye(2)
            gain += np.where(light, np.log(np.linalg.det(inner)), 0.0)
        gain[~usable] = -np.inf
        chosen.append(int(gain.argmax()))
        information += added[:, chosen[-1]]
    return Protocol.shuffled("short", places[chosen].tolist(), _held_out(held_out, max_voltage_v))
