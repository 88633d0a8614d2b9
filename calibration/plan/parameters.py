"""The parameters of a calibration, all positive, and their priors.

All are fitted as logarithms: a prior of 0.2 means "within some 20 %".
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from math import exp, isfinite, log, sqrt

import numpy as np
import numpy.typing as npt

from haptix.base.checks import positive
from haptix.base.errors import InputError
from haptix.model.finger import Finger
from haptix.model.screen import Screen
from haptix.model.terms import TERMS

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

PER_SCREEN = ("h0_m", "gap_resistivity_ohm_m")
PER_FINGER = (
    "frictional_shear_stress_pa",
    "youngs_modulus_pa",
    "h_rms_m",
    "apparent_area_at_1n_m2",
    "apparent_area_exponent",
    "skin_dielectric_scale",
    "response_hz_per_mm_per_s",
)
PER_RIG = ("sensor_pole_hz", "sensor_resonance_hz", "sensor_quality")
"""Nuisances: the force sensor's bandwidth, which lowers or raises the ripple at 2f."""
NAMES = PER_SCREEN + PER_FINGER + PER_RIG

OPTIONAL: Mapping[str, tuple[float, float]] = {"gap_resistivity_ohm_m": (1e7, 6.0)}
"""Parameters that a fit may do without, with start and prior where the profile has no value: around
the values of the paper's Fig. 4, decades either way, hardly any knowledge."""

REQUIRED = tuple(name for name in NAMES if name not in OPTIONAL and name not in PER_RIG)

# A strain gauge under a screen has its pole at 0.5 to 3 kHz or above, and its resonance where its
# stiffness and the screen's mass put it; start and spread of the logarithm.
_RIG: Mapping[str, tuple[float, float]] = {
    "sensor_pole_hz": (3000.0, 1.2),
    "sensor_resonance_hz": (6000.0, 0.8),
    "sensor_quality": (8.0, 0.7),
}

# Priors of a fingertip before any measurement, as standard deviations of logarithms.
# The apparent area is that of an ink print; the rest is the spread between people. A screen's
# insulator and tau_f are found from the strokes alone.
_SPREAD = {
    "youngs_modulus_pa": 0.3,
    "h_rms_m": 0.2,
    "apparent_area_at_1n_m2": 0.1,
    "apparent_area_exponent": 0.2,
    # A factor of two either way: the built-in table is a placeholder, and skin takes up water.
    "skin_dielectric_scale": 0.7,
    # Fingers of 5 to 30 Hz per mm/s; the published mean is 13.8.
    "response_hz_per_mm_per_s": 0.7,
}

_FURTHEST = {"youngs_modulus_pa": 1.6, "h_rms_m": 1.2, "gap_resistivity_ohm_m": 12.0}
_USUALLY_FURTHEST = 4.6
"""Largest change of a logarithm in a fit: a factor of 100, or the range of the contact's tables.
"""

EXPERIMENTS: Mapping[str, str] = {
    "h0_m": (
        "add strokes at other frequencies (`plan --protocol full` or short), or calibrate the same "
        "finger on a screen of known insulator first and pass that fit as --finger"
    ),
    "gap_resistivity_ohm_m": "add strokes at low frequencies, 20 to 60 Hz, where the gap leaks",
    "frictional_shear_stress_pa": (
        "it goes as modulus x roughness: measure the roughness of this finger (replica) and its "
        "modulus (indentation), and give them as priors"
    ),
    "youngs_modulus_pa": "indent this finger, or measure its roughness; give either as a prior",
    "h_rms_m": "measure the roughness of this finger (replica and profilometer)",
    "apparent_area_at_1n_m2": "print the inked fingertip at 1 N and measure the area",
    "apparent_area_exponent": "print the inked fingertip at 0.1 N and at 1 N",
    "skin_dielectric_scale": (
        "measure the skin's impedance, or calibrate this finger on a screen of known insulator at "
        "several frequencies"
    ),
    "response_hz_per_mm_per_s": (
        "it looks like the force sensor's pole: tap the screen in `haptix calibrate rig`, or add "
        "strokes at 250 to 500 Hz at two speeds"
    ),
    "sensor_pole_hz": "tap the screen in `haptix calibrate rig`",
    "sensor_resonance_hz": "tap the screen in `haptix calibrate rig`",
    "sensor_quality": "tap the screen in `haptix calibrate rig`",
}
"""The experiment that would determine each parameter."""


def optional_parameters(term: str) -> list[str]:
    """Names of the `OPTIONAL` parameters that a term of the model uses."""
    fields = [field.partition(".")[2] for field in TERMS[term].uses]
    return [name for name in OPTIONAL if name in fields]


def fitted_terms(on: Collection[str], names: Collection[str]) -> frozenset[str]:
    """Names of the terms that a fit has, of those that its model has.

    A term with an optional parameter is on where that is fitted, even if the model's profile has it
    off.
    """
    terms_on = set()
    for term in TERMS:
        optional = optional_parameters(term)
        if all(name in names for name in optional) if optional else term in on:
            terms_on.add(term)
    return frozenset(terms_on)


@dataclass(frozen=True)
class Parameter:
    """One parameter."""

    name: str
    """One of `NAMES`; the end of the name is the unit."""
    value: float
    """Where the fit starts, and the middle of the prior."""
    prior: float | None = None
    """Prior standard deviation of the logarithm; None without a prior."""
    is_fixed: bool = False
    """Whether the value is held."""

    def __post_init__(self) -> None:
        if self.name not in NAMES:
            raise InputError(f"parameter {self.name!r}: expected one of {', '.join(NAMES)}")
        positive(self.name, self.value)
        if self.prior is not None and not (isfinite(self.prior) and self.prior > 0):
            raise InputError(
                f"{self.name}: expected a prior above 0 (0.1 for within 10 %), got {self.prior:g}"
            )


@dataclass(frozen=True)
class FingerPrior:
    """Prior of the finger from an earlier fit: a Gaussian in the logarithms."""

    names: tuple[str, ...]
    """Names of parameters, from `PER_FINGER`."""
    log_value: Array
    """Mean of the logarithms; shape (names,)."""
    covariance: Array
    """Covariance of the logarithms; shape (names, names)."""


@dataclass(frozen=True)
class Parameters:
    """All parameters of a fit, with their starts and priors.

    Parameters
    ----------
    all : tuple of Parameter
    finger_prior : FingerPrior, optional
        Priors of fingers as a whole.
    """

    all: tuple[Parameter, ...]
    finger_prior: FingerPrior | None = None

    @classmethod
    def of(cls, finger: Finger, screen: Screen, leaky_gap: bool = False) -> Parameters:
        """Take the profiles' values as the start, with the usual spread of fingers as priors.

        Parameters
        ----------
        finger, screen
            The profiles.
        leaky_gap : bool
            Whether the gap conducts, and how well is fitted.

        Examples
        --------
        >>> import haptix
        >>> start = Parameters.of(haptix.Finger.preset("wet"), haptix.Screen())
        >>> len(start.all) > 1
        True
        """
        values = {
            "h0_m": screen.h0_m,
            "frictional_shear_stress_pa": float(finger.frictional_shear_stress_pa),
            "youngs_modulus_pa": float(finger.youngs_modulus_pa),
            "h_rms_m": float(finger.roughness.spectrum().h_rms_m),
            "apparent_area_at_1n_m2": finger.apparent_area_at_1n_m2,
            "apparent_area_exponent": max(finger.apparent_area_exponent, 1e-3),
            "skin_dielectric_scale": finger.dielectric.scale,
            "response_hz_per_mm_per_s": finger.response_hz_per_mm_per_s,
        }
        parameters = [Parameter(name, value, _SPREAD.get(name)) for name, value in values.items()]
        if leaky_gap or screen.gap_resistivity_ohm_m is not None:
            start, prior = OPTIONAL["gap_resistivity_ohm_m"]
            value = screen.gap_resistivity_ohm_m or start
            parameters.append(Parameter("gap_resistivity_ohm_m", value, prior))
        return cls(tuple(parameters))

    def with_rig(self) -> Parameters:
        """Return a copy with the force sensor's bandwidth, with a wide prior."""
        return self._changed({name: Parameter(name, *values) for name, values in _RIG.items()})

    @property
    def names(self) -> tuple[str, ...]:
        """Names, in order."""
        return tuple(parameter.name for parameter in self.all)

    @property
    def free(self) -> tuple[str, ...]:
        """Names of those that are fitted."""
        return tuple(parameter.name for parameter in self.all if not parameter.is_fixed)

    @property
    def log_values(self) -> Array:
        """Logarithms of the start, in the order of `names`."""
        return np.array([log(parameter.value) for parameter in self.all])

    def __getitem__(self, name: str) -> Parameter:
        for parameter in self.all:
            if parameter.name == name:
                return parameter
        raise InputError(f"parameter {name!r}: expected one of {', '.join(self.names)}")

    def fixed(self, **values: float) -> Parameters:
        """Return a copy with parameters held at values.

        Raises `InputError` if one is a factor of 100 off the start: it was meant in another unit.
        """
        self._check_units(values)
        return self._changed(
            {name: Parameter(name, value, None, True) for name, value in values.items()}
        )

    def known(self, **priors: tuple[float | None, float]) -> Parameters:
        """Return a copy with priors ``name=(value, spread)``; None keeps the value.

        Raises `InputError` as `fixed`.
        """
        self._check_units({name: value for name, (value, _) in priors.items() if value is not None})
        changed = {}
        for name, (value, spread) in priors.items():
            changed[name] = Parameter(name, self[name].value if value is None else value, spread)
        return self._changed(changed)

    def started_at(self, **values: float) -> Parameters:
        """Return a copy with other starts, and middles of the priors."""
        return self._changed(
            {name: replace(self[name], value=value) for name, value in values.items()}
        )

    def restarted_at(self, values: Mapping[str, float]) -> Parameters:
        """Return a copy with other starts; parameters with a prior keep theirs."""
        return self.started_at(**{n: v for n, v in values.items() if self[n].prior is None})

    def with_finger(self, prior: FingerPrior) -> Parameters:
        """Return a copy with the prior of the finger that an earlier fit gives."""
        changed = {
            name: Parameter(name, float(np.exp(value)))
            for name, value in zip(prior.names, prior.log_value, strict=True)
            if name in self.names and not self[name].is_fixed
        }
        return replace(self._changed(changed), finger_prior=prior)

    def without(self, names: Collection[str]) -> Parameters:
        """Return a copy that lacks some parameters."""
        return replace(
            self, all=tuple(parameter for parameter in self.all if parameter.name not in names)
        )

    def _check_units(self, values: Mapping[str, float]) -> None:
        for name in set(values) & set(self.names):
            value, start = values[name], self[name].value
            furthest = max(_FURTHEST.get(name, 0.0), _USUALLY_FURTHEST)
            if value > 0 and abs(log(value / start)) > furthest:
                low, high = start * exp(-furthest), start * exp(furthest)
                raise InputError(
                    f"{name}: expected {low:.2g} to {high:.2g}, got {value:g}; give it in the unit "
                    "at the end of its name"
                )

    def _changed(self, changed: Mapping[str, Parameter]) -> Parameters:
        kept = [changed.get(parameter.name, parameter) for parameter in self.all]
        added = [parameter for name, parameter in changed.items() if name not in self.names]
        return replace(self, all=(*kept, *added))

    def bounds(self) -> tuple[Array, Array]:
        """Lowest and highest logarithms of the free parameters that a fit may try."""
        middle = np.array([log(self[name].value) for name in self.free])
        furthest = np.array([_FURTHEST.get(name, _USUALLY_FURTHEST) for name in self.free])
        return middle - furthest, middle + furthest

    def prior_spread(self, name: str) -> float | None:
        """Prior standard deviation of a logarithm; None without a prior."""
        prior = self.finger_prior
        if prior is None or name not in prior.names:
            return self[name].prior
        at = prior.names.index(name)
        return sqrt(float(prior.covariance[at, at]))

    def prior_information(self) -> Array:
        """Inverse prior covariance of the free parameters."""
        rows, _ = self.prior_rows()
        return rows.T @ rows

    def prior_rows(self) -> tuple[Array, Array]:
        """Return (matrix, target) with which ``matrix @ log_values - target`` is unit normal.

        The matrix has a column for each of `free`.
        """
        free, prior = self.free, self.finger_prior
        joint = [] if prior is None else [name for name in prior.names if name in free]
        alone = [
            (name, spread)
            for name in free
            if (spread := self[name].prior) is not None and name not in joint
        ]
        matrix = np.zeros((len(alone) + len(joint), len(free)))
        target = np.zeros(len(matrix))
        for row, (name, spread) in enumerate(alone):
            matrix[row, free.index(name)] = 1 / spread
            target[row] = log(self[name].value) / spread
        if prior is not None and joint:
            at = [prior.names.index(name) for name in joint]
            whitening = np.linalg.inv(np.linalg.cholesky(prior.covariance[np.ix_(at, at)]))
            matrix[len(alone) :, [free.index(name) for name in joint]] = whitening
            target[len(alone) :] = whitening @ prior.log_value[at]
        return matrix, target
