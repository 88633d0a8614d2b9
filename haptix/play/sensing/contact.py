"""Current and friction of an unknown finger's contact, and the record of one that was enrolled.

The model is that of a known finger:
All moduli times e and all heights times s scale pressures by ``e s`` and gaps by s: another finger
at ``(p0, V, h0)`` is the known one at ``(p0/(e s), V/(s^1.5 e^0.5), h0/s)``. So one contact model,
with three insulations of the skin, answers for all fingers of a population.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from datetime import date
from itertools import combinations_with_replacement
from types import MappingProxyType
from typing import Annotated, Any, NamedTuple, Self

import numpy as np
import numpy.typing as npt
import torch
from pydantic import Field

from haptix.base.checks import Array, Positive, checked, positive
from haptix.base.display import Displayed
from haptix.base.documents import Document
from haptix.base.errors import InputError
from haptix.model.finger import Finger
from haptix.model.friction import ContactModel
from haptix.model.presets import DEFAULT_CARRIER_HZ
from haptix.model.screen import Screen
from haptix.model.status import Status
from haptix.model.surface import FrictionSurface

LATENT = ("stiffness", "roughness", "area", "skin", "force", "form")
"""The unknowns of a finger, as logarithms of ratios: its moduli, its heights, its apparent
area at 1 N and its skin's insulating thickness over those of the known finger, its force over
`PopulationSpread.force_n`, and the true capacitance over the model's."""

STIFFNESS, ROUGHNESS, AREA, SKIN, FORCE, FORM = range(len(LATENT))

ComplexArray = npt.NDArray[np.complex128]

_INSULATIONS = (0.6, 1.0, 1.7)  # of the skin over its roughness: the middle and some 1.5 sigma
_SKIN_PLACE = 3  # of the places, counted from 1: it was solved at three values
_DRAWN = 120  # fingers for each of them
_DEGREE = 3
_MOST_RATIO = 3.0  # of friction: beyond it light contact ends
_LOWEST_V = 20.0  # attraction is compared from here on; below it is too small to be felt
_MOST_SCALED = 6.0  # of the screen's voltage: such draws are far from the population
_SEED = 40


@checked()
class PopulationSpread(Displayed):
    """How far fingers differ: the prior of a finger before any reading.

    Parameters
    ----------
    stiffness, roughness, area, skin : float
        Standard deviation of the logarithm of each ratio of `LATENT`.
    force_n : float
        Median normal force [N] of who strokes a screen.
    force : float
        Standard deviation of its logarithm.
    form : float
        Of the true capacitance over the model's: other forms of the gaps' distribution move it by
        16 % (physics page, section 12).
    """

    stiffness: Positive = 0.5
    roughness: Positive = 0.25
    area: Positive = 0.3
    skin: Positive = 0.3
    force_n: Positive = 0.4
    force: Positive = 0.5
    form: Positive = 0.12

    @property
    def sd(self) -> Array:
        """Standard deviation of each of `LATENT`."""
        return np.array([getattr(self, name) for name in LATENT])


@dataclass(frozen=True, eq=False)
class ContactCurrent(Displayed):
    """Capacitance and attraction of a sliding contact, for any finger of a population.

    Made by `of_model` or `of_surface`. Between contact model and numbers stand polynomials, whose
    errors `residual` has; they hold within the population and to the screen's voltage limit.

    Parameters
    ----------
    population : PopulationSpread
        Around the known finger.
    frequency_hz : float
        Of the carrier.
    area_at_1n_m2, area_exponent : float
        Of the known finger.
    body_f : float
        From the finger to earth, in series with the contact [F].
    fit : mapping of str to ndarray
        Coefficients, and centre and width of the places.
    capacitance_ratio : float
        True capacitance over the model's, where it was measured; see `calibrated`.
    residual : mapping of str to float
        Standard deviation of ln C and ln of the attraction about the fit.
    """

    population: PopulationSpread
    frequency_hz: float
    area_at_1n_m2: float
    area_exponent: float
    body_f: float
    fit: Mapping[str, Any] = field(repr=False)
    residual: Mapping[str, float] = field(repr=False)
    capacitance_ratio: float = 1.0

    def calibrated(self, capacitance_ratio: float) -> Self:
        """Return the same with the capacitance that the known finger was measured to have.

        Parameters
        ----------
        capacitance_ratio : float
            Measured over modelled, of the finger that the screen was calibrated with.
        """
        return replace(self, capacitance_ratio=positive("capacitance_ratio", capacitance_ratio))

    @classmethod
    def of_surface(
        cls,
        surface: FrictionSurface,
        frequency_hz: float,
        population: PopulationSpread | None = None,
    ) -> Self:
        """Return the model for the finger and screen that a surface was built for.

        Parameters
        ----------
        surface : FrictionSurface
            The surface.
        frequency_hz : float
            Carrier [Hz].
        population : PopulationSpread, optional
            Fingers around that one.

        Raises
        ------
        InputError
            If the surface does not name its finger and screen, or the frequency is no carrier.
        """
        model = surface.info.get("model", {})
        if "finger" not in model or "screen" not in model:
            raise InputError(
                "sense: expected a surface that names its finger and screen; build it anew"
            )
        on = [name for name, term in model["terms"].items() if term["on"]]
        finger = Finger(**model["finger"], theory=model["theory"])
        contact = ContactModel(finger, Screen(**model["screen"]), terms=on)
        return cls.of_model(contact, frequency_hz, population)

    @classmethod
    def of_model(
        cls, model: ContactModel, frequency_hz: float, population: PopulationSpread | None = None
    ) -> Self:
        """Solve fingers of a population by scaling those of a model, and fit them.

        Parameters
        ----------
        model : ContactModel
            Of the known finger on the screen.
        frequency_hz : float
            Carrier [Hz].
        population : PopulationSpread, optional
            Around the known finger.
        """
        people = PopulationSpread() if population is None else population
        frequency = positive("frequency_hz", frequency_hz)
        finger, screen = model.finger, model.screen
        # A scaled finger stands for another one at another voltage; no drive is made of it.
        scaled = screen.replace(max_voltage_v=_MOST_SCALED * screen.max_voltage_v)
        random = np.random.default_rng(_SEED)
        places, capacitances, attractions = [], [], []
        for insulation in _INSULATIONS:
            scale = finger.dielectric.scale * insulation
            skin = finger.dielectric.model_copy(update={"scale": scale})
            skin_model = ContactModel(finger.replace(dielectric=skin), scaled, terms=model.terms)
            # Wider than the population, so that a filter may err within the fit.
            latent = 1.5 * people.sd * random.normal(size=(_DRAWN, len(LATENT)))
            latent[:, SKIN] = latent[:, ROUGHNESS] + np.log(insulation)
            volts = random.uniform(_LOWEST_V, screen.max_voltage_v, _DRAWN)
            place = _places(latent, volts, people, finger)
            place[:, 3] = np.minimum(place[:, 3], scaled.max_voltage_v**2)
            drawn = _solve(skin_model, place, finger, frequency)
            kept = drawn.is_light
            places.append(place[kept])
            capacitances.append(drawn.per_area[kept])
            attractions.append(drawn.attraction[kept])
        place = np.concatenate(places)
        centre, width = place.mean(axis=0), place.std(axis=0)
        terms = _terms((place - centre) / width)
        logs = np.column_stack(
            [np.log(np.concatenate(capacitances)), np.log(np.concatenate(attractions))]
        )
        coefficients = np.linalg.lstsq(terms, logs, rcond=None)[0]
        spread = np.abs(logs - terms @ coefficients).std(axis=0)
        fit = {"coefficients": coefficients, "centre": centre, "width": width}
        return cls(
            people, frequency, finger.apparent_area_at_1n_m2, finger.apparent_area_exponent,
            screen.body_capacitance_f, MappingProxyType(fit),
            MappingProxyType({"capacitance": float(spread[0]), "attraction": float(spread[1])}),
        )  # fmt: skip

    def capacitance_f(self, latent: Array, voltage_v: Array | float) -> ComplexArray:
        """Complex capacitance [F] from the screen through finger and body to earth.

        Parameters
        ----------
        latent : ndarray, shape (n, 6)
            Fingers, see `LATENT`.
        voltage_v : float or ndarray, shape (n,)
            Amplitude [V].
        """
        log_c = self._logs(latent, voltage_v)[:, 0]
        force = self.population.force_n * np.exp(latent[:, FORCE])
        area = self.area_at_1n_m2 * np.exp(latent[:, AREA]) * force**self.area_exponent
        contact = (
            self.capacitance_ratio * area * np.exp(log_c - latent[:, ROUGHNESS] + latent[:, FORM])
        )
        return np.asarray(contact * self.body_f / (contact + self.body_f))

    def log_attraction(self, latent: Array, voltage_v: Array | float) -> Array:
        """Logarithm of b [1/V^2] in ``mu(0)/mu(V) = 1 - b V^2``.

        Parameters
        ----------
        latent, voltage_v : ndarray
            As for `capacitance_f`.
        """
        log_b = self._logs(latent, voltage_v)[:, 1].real
        return np.asarray(log_b - 3 * latent[:, ROUGHNESS] - latent[:, STIFFNESS])

    def _logs(self, latent: Array, voltage_v: Array | float) -> ComplexArray:
        latent = np.asarray(latent, dtype=np.float64)
        volts = np.broadcast_to(np.maximum(voltage_v, _LOWEST_V), len(latent))
        place = _place(latent, volts, self.population, self.area_at_1n_m2, self.area_exponent)
        # Beyond the solved range, as at its edge.
        at = np.clip((place - self.fit["centre"]) / self.fit["width"], -3.0, 3.0)
        return np.asarray(_terms(at) @ self.fit["coefficients"])


@dataclass(frozen=True)
class _Solved:
    per_area: ComplexArray
    attraction: Array
    is_light: npt.NDArray[np.bool_]


def _place(
    latent: Array, voltage_v: Array, people: PopulationSpread, area_m2: float, exponent: float
) -> Array:
    """Where fingers are on the known one's table: ln p0, ln s, ln(skin/s) and V^2."""
    force = people.force_n * np.exp(latent[:, FORCE])
    pressure = force ** (1 - exponent) / (area_m2 * np.exp(latent[:, AREA]))
    e, s = latent[:, STIFFNESS], latent[:, ROUGHNESS]
    return np.column_stack(
        [np.log(pressure) - e - s, s, latent[:, SKIN] - s, voltage_v**2 * np.exp(-3 * s - e)]
    )


def _places(latent: Array, voltage_v: Array, people: PopulationSpread, finger: Finger) -> Array:
    return _place(
        latent, voltage_v, people, finger.apparent_area_at_1n_m2, finger.apparent_area_exponent
    )


def _solve(model: ContactModel, place: Array, finger: Finger, frequency_hz: float) -> _Solved:
    """Capacitance per apparent area and attraction of the known finger at some places."""
    log_p, s, _, square = place.T
    force = (np.exp(log_p) * finger.apparent_area_at_1n_m2) ** (
        1 / (1 - finger.apparent_area_exponent)
    )
    force_n, h0 = torch.from_numpy(force), torch.from_numpy(model.screen.h0_m * np.exp(-s))
    state = model.solve(force_n, torch.from_numpy(np.sqrt(square)), frequency_hz, h0)
    rest = model.solve(force_n, 0.0, frequency_hz, h0)
    ratio = (state.mu / rest.mu).numpy()
    farads = state.capacitance_f.numpy() - 1j * state.conductance_s.numpy() / (
        2 * np.pi * frequency_hz
    )
    pulled = state.pull_in_voltage_v.numpy() ** 2 > square
    is_light = pulled & (ratio > 1) & (ratio < _MOST_RATIO)
    area = model.finger.apparent_area_m2(force_n).numpy()
    attraction = np.where(is_light, 1 - 1 / ratio, 1.0) / square
    return _Solved(farads / area, attraction, is_light & (state.status.numpy() != Status.PULL_IN))


def _factors() -> npt.NDArray[np.int64]:
    """Which places each term multiplies, shape (3, terms); 0 stands for none."""
    powers = [
        which
        for which in combinations_with_replacement(range(5), _DEGREE)
        if which.count(_SKIN_PLACE) < len(_INSULATIONS)
    ]
    return np.array(powers).T


def _terms(place: Array) -> Array:
    """All products of up to three of the four places, shape (n, terms)."""
    numbers = np.column_stack([np.ones(len(place)), place])
    first, two, three = (numbers[:, which] for which in _FACTORS)
    return np.asarray(first * two * three)


_FACTORS = _factors()


_LATENT = len(LATENT)
_Row = Annotated[tuple[float, ...], Field(min_length=_LATENT, max_length=_LATENT)]
_PART_S = 0.25  # of a slide: noise of parts so long is independent, a hand's tremor too

CHANGED = 0.06
"""Change of the contact's capacitance from which it is flagged: over half of the 10 % to be found,
since sweat and a scale differ by 2 to 3 % from day to day."""


class Averaged(NamedTuple):
    """An average of readings while a finger slid."""

    t_s: float
    normal_force_n: float
    """Force that was measured [N]; nan without."""
    voltage_v: float
    capacitance_f: complex
    """Of contact and body, without the panel [F]."""


class EnrolledFinger(Document):
    """The estimate of one person's finger on one screen, see `FingerObserver.enrolled`.

    Parameters
    ----------
    mean : tuple of float
        Of `LATENT`.
    covariance : tuple of tuple of float
        Of the same.
    screen : str
        Name of the screen.
    frequency_hz : float
        Of the carrier.
    slid : tuple of (float, float, float, float)
        Of each quarter of a second of sliding: normal force [N], amplitude [V], and capacitance
        [F], real and imaginary.
    day : date or None
        When.
    """

    mean: _Row
    covariance: Annotated[tuple[_Row, ...], Field(min_length=_LATENT, max_length=_LATENT)]
    screen: str = ""
    frequency_hz: Annotated[float, Field(gt=0)] = DEFAULT_CARRIER_HZ
    slid: tuple[tuple[float, float, float, float], ...] = ()
    day: date | None = None

    @property
    def moments(self) -> tuple[Array, Array]:
        """Mean, shape (6,), and covariance, shape (6, 6)."""
        return np.array(self.mean), np.array(self.covariance)


def parts(averages: list[Averaged]) -> tuple[tuple[float, float, float, float], ...]:
    """Average quarters of a second of sliding whose force was measured, for `EnrolledFinger`."""
    by_part: dict[int, list[Averaged]] = {}
    for average in averages:
        if np.isfinite(average.normal_force_n):
            by_part.setdefault(int(average.t_s / _PART_S), []).append(average)
    rows = []
    for part in by_part.values():
        force, volts, farads = (np.mean([average[i] for average in part]) for i in (1, 2, 3))
        rows.append((float(force), float(volts), float(farads.real), float(farads.imag)))
    return tuple(rows)


@dataclass(frozen=True)
class ContactChange(Displayed):
    """How much the contact of one person with one screen has changed.

    Parameters
    ----------
    log_ratio : float
        Mean logarithm of the capacitance, after over before, at equal force and voltage.
    sd : float
        Its standard deviation, by the slides' own spread.
    """

    log_ratio: float
    sd: float

    @property
    def is_changed(self) -> bool:
        """Whether the change is 6 % or more."""
        return abs(self.log_ratio) > CHANGED

    @property
    def is_sure(self) -> bool:
        """Whether the slides tell a change of 10 % from none, by two standard deviations."""
        return 2 * self.sd < CHANGED

    @property
    def verdict(self) -> str:
        """In words."""
        if not self.is_sure:
            return "cannot tell: slide longer, or press more evenly"
        return "changed" if self.is_changed else "as before"


def contact_change(
    before: EnrolledFinger, after: EnrolledFinger, contact: ContactCurrent
) -> ContactChange:
    """Compare the slides of one person, by the model of the finger that was enrolled before.

    The model takes only the difference of forces and voltages between both away. What remains is a
    change of the finger, the contact, or the screen: the current does not tell these apart.

    Parameters
    ----------
    before, after : EnrolledFinger
        Of the same person on the same screen.
    contact : ContactCurrent
        Of this screen.

    Raises
    ------
    InputError
        If they are of different screens or carriers, or have less than a second of sliding.
    """
    for name in ("screen", "frequency_hz"):
        first, second = getattr(before, name), getattr(after, name)
        if first != second:
            raise InputError(f"{name}: expected the same in both, got {first} and {second}")
    logs = []
    for which, person in (("before", before), ("after", after)):
        if len(person.slid) < 4:
            raise InputError(
                f"{which}: expected a second of sliding at a known force, got {len(person.slid)} "
                "quarters; enroll with a force"
            )
        force, volts, real, imaginary = np.array(person.slid).T
        latent = np.tile(before.moments[0], (len(force), 1))
        latent[:, FORCE] = np.log(force / contact.population.force_n)
        body = contact.body_f
        measured, expected = real + 1j * imaginary, contact.capacitance_f(latent, volts)
        # Of the contact alone: the body in series would hide a part of a change.
        ratio = (1 / expected - 1 / body) / (1 / measured - 1 / body)
        logs.append(np.log(np.abs(ratio)))
    variance = sum(log.var(ddof=1) / len(log) for log in logs)
    return ContactChange(float(logs[1].mean() - logs[0].mean()), float(np.sqrt(variance)))
