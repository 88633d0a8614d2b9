"""Verify a fit by strokes that were kept out of it: equivalence within half a JND.

Each group of held-out strokes (all, light and firm ones, those at the carrier, those at the highest
voltage) has a mean error and, from the scatter of all strokes, its uncertainty. Equivalence is
shown where the whole interval lies within the tolerance: two one-sided t tests at 5 % (Schuirmann
1987). All groups must show it, so that the level holds for the whole verdict (intersection-union,
Berger 1982). No single stroke decides.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import date
from math import hypot, inf, isfinite, log, nan
from typing import Annotated, Any, Literal, Self

import numpy as np
from scipy.stats import linregress, sem
from scipy.stats import t as student

from calibration.fit import Fit
from calibration.parameters import PER_RIG, Array, Mask, Parameters
from calibration.predict import StrokeConditions, StrokePredictor
from calibration.protocol import CARRIER_HZ, FREQUENCY_HZ
from calibration.reduction import Point, Reduced
from calibration.rig import RigCheck
from haptix.errors import InputError
from haptix.perception import WEBER_FRACTION
from haptix.report import Heading, HeadingsOf

Verdict = Literal["passed", "provisional", "failed"]

TOLERANCE_JND = 0.5
"""Largest error of friction that passes, its uncertainty included [JND]."""

RIG_HOLDS_DAYS = 31
"""A rig checked longer before or after its strokes is not known: cables and gains are changed."""

FEWEST_HELD_OUT = 4
FEWEST_OF_GROUP = 2
_FEWEST_OF_TREND = 4
_LEVEL = 0.95  # one side: both sides of an equivalence at 5 %
_LIGHT_BELOW_N = 0.45  # the middle of the protocols' forces
_AT_CARRIER = 0.5  # of the carrier's frequency, from which a stroke counts as one at the carrier
_AT_HIGHEST = 0.9  # of the highest voltage that was held out: the carrier's is limited by current
# Where friction is to be known: the range of the held-out strokes.
_USED_N = (0.2, 0.5, 0.8)
_USED_SHARES = (0.0, 0.5, 0.9)  # of the highest voltage
_SPEED_MM_PER_S = 50.0  # that of the protocols
_VOLTS_STEP = 0.01  # relative, of a numerical derivative
_SHOWN = HeadingsOf(("number", "normal_force_n", "voltage_v", "frequency_hz", "mu"))
_WITHIN = "{0.mean_jnd:+.2f} ± {0.uncertainty_jnd:.2f}"


@dataclass(frozen=True)
class HeldOutStroke:
    """A stroke kept out of the fit, and what the fit predicts for it.

    The ripple is the amplitude of the friction at 2f over its mean; `is_light` is False where the
    contact snaps in by the prediction.
    """

    point: Annotated[Point, _SHOWN]
    predicted_mu: Annotated[float, Heading("predicted", ".3g")]
    predicted_ripple: float
    is_light: bool = True

    @property
    def residual_jnd(self) -> Annotated[float, Heading("residual [JND]", "+.2f")]:
        """Measured minus predicted friction, in just-noticeable differences (11 % of mu)."""
        return (self.point.mu / self.predicted_mu - 1) / WEBER_FRACTION

    @property
    def ripple_residual_jnd(self) -> Annotated[float, Heading("ripple [JND]", "+.2f")]:
        """The same of the ripple's amplitude in mu; NaN where no ripple is seen."""
        measured = self.point.ripple * self.point.mu
        return (measured / self.predicted_mu - self.predicted_ripple) / WEBER_FRACTION

    @classmethod
    def predicted(
        cls,
        points: Sequence[Point],
        predictor: StrokePredictor,
        sensor: Mapping[str, float] | None = None,
    ) -> tuple[Self, ...]:
        """Predict strokes with the finger and the screen of a predictor.

        For `sensor` see `StrokePredictor.by_profiles`.
        """
        if not points:
            return ()
        seen = predictor.by_profiles(StrokeConditions.of(points), sensor)
        numbers = np.exp(seen.log_mu).tolist(), seen.ripple.tolist(), seen.is_light.tolist()
        return tuple(cls(*one) for one in zip(points, *numbers, strict=True))


@dataclass(frozen=True)
class Equivalence:
    """Mean error of friction in one group of held-out strokes.

    Parameters
    ----------
    group : str
        Which strokes.
    strokes : tuple of int
        Their numbers.
    mean_jnd : float
        Mean of measured minus predicted friction [JND].
    uncertainty_jnd : float
        The true mean is within it, either side, at 90 % [JND]: scatter, and the rig's gains.
    rig_jnd : float
        Size of the error that the rig's gains have [JND], which no stroke shows.
    """

    group: Annotated[str, Heading("held-out strokes", "{0.group} ({0.count})")]
    strokes: tuple[int, ...]
    mean_jnd: Annotated[float, Heading("error [JND]", _WITHIN)]
    uncertainty_jnd: float
    rig_jnd: Annotated[float, Heading("of the rig [JND]", ".2f")] = 0.0

    @property
    def count(self) -> int:
        """How many strokes."""
        return len(self.strokes)

    @property
    def bound_jnd(self) -> Annotated[float, Heading("at most [JND]", ".2f")]:
        """Largest error of friction that the strokes leave possible [JND]."""
        return abs(self.mean_jnd) + self.uncertainty_jnd + self.rig_jnd


@dataclass(frozen=True)
class Steadiness:
    """Sizes, each with the uncertainty that it has at 90 %, either side; NaN where not seen.

    Parameters
    ----------
    repeatability_jnd : float
        Standard deviation of repeated strokes, beyond their own errors [JND].
    session_drift_jnd, session_drift_uncertainty_jnd : float
        Change of friction from the first stroke to the last [JND], by a straight line through the
        differences to the prediction over the strokes' order.
    creep_jnd, creep_uncertainty_jnd : float
        Change of friction for ten times the time in contact [JND], within strokes.
    """

    repeatability_jnd: float = nan
    session_drift_jnd: float = nan
    session_drift_uncertainty_jnd: float = nan
    creep_jnd: float = nan
    creep_uncertainty_jnd: float = nan

    @property
    def text(self) -> str:
        """One line for people."""
        parts = [f"strokes repeat within {self.repeatability_jnd:.2f} JND"]
        if isfinite(self.session_drift_jnd):
            parts.append(
                f"over the session friction drifts by {self.session_drift_jnd:+.2f} ± "
                f"{self.session_drift_uncertainty_jnd:.2f} JND"
            )
        if isfinite(self.creep_jnd):
            parts.append(
                f"it creeps by {self.creep_jnd:+.2f} ± "
                f"{self.creep_uncertainty_jnd:.2f} JND in ten times the contact time"
            )
        return "; ".join(parts)


@dataclass(frozen=True)
class Verification:
    """Verdict on a calibration.

    Parameters
    ----------
    strokes : tuple of HeldOutStroke
        Strokes kept out of the fit.
    tolerance_jnd : float
        Largest error that passes, its uncertainty included [JND].
    failures : tuple of str
        Why it fails; empty where it does not.
    groups : tuple of Equivalence
        What was tested.
    untested : tuple of str
        What was not, so that the verdict is provisional.
    fit_bound_jnd : float
        Largest error [JND], at 95 %, that the fit's own uncertainty leaves where the screen is
        used.
    steadiness : Steadiness
        Repeatability, drift over the session, and creep in contact.
    """

    strokes: tuple[HeldOutStroke, ...]
    tolerance_jnd: float
    failures: tuple[str, ...]
    groups: tuple[Equivalence, ...] = ()
    untested: tuple[str, ...] = ()
    fit_bound_jnd: float = float("nan")
    steadiness: Steadiness = field(default_factory=Steadiness)

    @property
    def passed(self) -> bool:
        """Whether the calibration may be used without a warning."""
        return self.verdict == "passed"

    @property
    def verdict(self) -> Annotated[Verdict, Heading("verdict")]:
        """Return "failed"; "provisional" where nothing failed but something was not tested."""
        if self.failures:
            return "failed"
        return "provisional" if self.untested else "passed"

    @property
    def parts(self) -> list[tuple[str, Sequence[Any]]]:
        """What people read of it, by title: rows of a table, or lines."""
        return [
            ("Why it failed", self.failures),
            ("Not tested", self.untested),
            ("Errors of friction, by the strokes kept out of the fit", self.groups),
            ("Strokes kept out of the fit", self.strokes),
            ("Steadiness", [self.steadiness.text]),
        ]

    @property
    def worst_jnd(self) -> Annotated[float, Heading("worst stroke [JND]", ".2f")]:
        """Largest residual of mu [JND]; NaN without strokes."""
        return max((abs(row.residual_jnd) for row in self.strokes), default=float("nan"))

    @property
    def bound_jnd(self) -> Annotated[float, Heading("at most [JND]", ".2f")]:
        """Largest error of friction that is left possible [JND]; NaN without strokes."""
        return max((one.bound_jnd for one in self.groups), default=float("nan"))


def verify(
    fit: Fit,
    reduced: Reduced,
    predictor: StrokePredictor,
    tolerance_jnd: float = TOLERANCE_JND,
    rig: RigCheck | None = None,
    measured_on: date | None = None,
) -> Verification:
    """Predict the held-out strokes, compare, and test for equivalence.

    It fails where a group's mean error, its uncertainty included, may be above the tolerance, where
    the fit's own uncertainty of friction is, where fewer than four strokes were kept out, or where
    the strokes do not determine the screen's insulator. It is provisional without a `rig` check of
    forces and volts, with one that lies more than `RIG_HOLDS_DAYS` from the strokes of
    `measured_on`, and where no two held-out strokes are at the carrier.
    """
    sensor = {name: fit.best(name) for name in PER_RIG if name in fit.names}
    predicted = HeldOutStroke.predicted(reduced.held_out, predictor, sensor)
    rows = tuple(one for one in predicted if one.is_light)
    failures = []
    if len(rows) < FEWEST_HELD_OUT:
        failures.append(
            f"expected {FEWEST_HELD_OUT} good strokes kept out of the fit or more, got {len(rows)}"
            + " in light contact" * (len(rows) < len(predicted))
        )
    groups = groups_of(rows, fit, predictor, rig)
    for one in groups:
        if one.bound_jnd > tolerance_jnd:
            failures.append(
                f"{one.group} (strokes {', '.join(map(str, one.strokes))}): friction is "
                f"{one.mean_jnd:+.2g} ± {one.uncertainty_jnd:.2g} JND from the "
                f"prediction{_of_rig(one)}, which may be more than {tolerance_jnd:g}"
                + _undecided(fit)
                * (abs(one.mean_jnd) + one.rig_jnd <= tolerance_jnd)
            )
    bound = fit_bound(fit, reduced, rows, predictor)
    if bound > tolerance_jnd:
        failures.append(
            f"the fit knows friction within {bound:.2g} JND only, somewhere in the range of use; "
            f"expected {tolerance_jnd:g}: measure more strokes"
        )
    if fit["h0_m"].value is None:
        failures.append(fit["h0_m"].refusal())
    steady = steadiness(fit, reduced, predictor)
    creeps = abs(steady.creep_jnd) - steady.creep_uncertainty_jnd
    if creeps > tolerance_jnd:
        failures.append(
            f"friction creeps by {steady.creep_jnd:+.2g} JND in ten times the contact time: "
            "no profile holds for all of them; let the finger rest on the screen as long before "
            "each stroke, or dry it"
        )
    untested = []
    bounds = [one.bound_jnd for one in groups]
    if creeps <= tolerance_jnd < max(bounds, default=0.0) + max(creeps, 0.0):
        untested.append(
            f"other times in contact: friction creeps by {steady.creep_jnd:+.2g} ± "
            f"{steady.creep_uncertainty_jnd:.2g} JND in ten times the contact time, and the "
            "profile holds for that of the strokes"
        )
    if tolerance_jnd > TOLERANCE_JND:
        untested.append(
            f"half a JND: the tolerance was {tolerance_jnd:g} JND, of which no verdict may "
            "pass more than provisionally"
        )
    if rig is None or rig.voltage_gain is None:
        untested.append(_gains_not_checked(rows, predictor, rig))
    if rig is not None:
        failures += rig.faults()
        if (days := rig.days_from(measured_on)) > RIG_HOLDS_DAYS:
            untested.append(
                f"the rig on the day of the strokes: it was checked on {rig.measured_on}, "
                f"{days} days away; repeat `haptix calibrate rig`"
            )
    if rows and not any(one.group == "at the carrier" for one in groups):
        untested.append(f"the carrier: no two held-out strokes near {CARRIER_HZ:g} Hz")
    return Verification(
        rows, tolerance_jnd, tuple(failures), groups, tuple(untested), bound, steady
    )


def _gains_not_checked(
    rows: tuple[HeldOutStroke, ...], predictor: StrokePredictor, rig: RigCheck | None
) -> str:
    """Say what the gains that no stroke tells from friction would do."""
    power = _volts_power([row.point for row in rows], predictor) if rows else np.zeros(1)
    force, volts = (0.01 * one / WEBER_FRACTION for one in (1.0, float(power.max())))
    of_volts = f"1 % of the volts up to {volts:.2f} JND"
    if rig is not None:
        return f"the volts, by no second reading of them: {of_volts}"
    return (
        f"the rig's gains, by no known weight and no second reading of the volts: 1 % of a force "
        f"is {force:.2f} JND, {of_volts}"
    )


def _undecided(fit: Fit) -> str:
    """Say which session would decide what the scatter leaves open."""
    return (
        "; its scatter leaves that open: a session planned with --repeatability-percent "
        f"{100 * fit.repeatability.log_mu:.2g} holds out strokes enough to decide"
    )


def _of_rig(one: Equivalence) -> str:
    return f", and {one.rig_jnd:.2g} JND by the rig's gains" if one.rig_jnd else ""


def groups_of(
    rows: tuple[HeldOutStroke, ...], fit: Fit, predictor: StrokePredictor, rig: RigCheck | None
) -> tuple[Equivalence, ...]:
    """Mean errors of the groups that have two strokes or more."""
    if len(rows) < FEWEST_OF_GROUP:
        return ()
    points = [row.point for row in rows]
    residual = np.array([row.residual_jnd for row in rows])
    ripple = np.array([row.ripple_residual_jnd for row in rows])
    sd = _spreads(rows, fit) / WEBER_FRACTION
    # The fit's own strokes and these tell the scatter together; a misfit here makes it larger,
    # never smaller.
    freedom = max(len(fit.strokes) - sum(one.value is not None for one in fit.estimates), 3)
    freedom_here = len(rows) - 1
    spread = float(((residual - residual.mean()) ** 2 / sd**2).sum())
    sd *= np.sqrt(max((freedom + spread) / (freedom + freedom_here), 1.0))
    quantile = float(student.ppf(_LEVEL, freedom + freedom_here))
    size, gain_sd = np.zeros(len(rows)), np.zeros(len(rows))
    if rig is not None:
        size, gain_sd = rig.friction_error(_volts_power(points, predictor))
    force, volts, hertz = np.array(
        [(p.normal_force_n, p.voltage_v, p.frequency_hz) for p in points]
    ).T
    chosen = {
        "all": np.ones(len(rows), dtype=bool),
        "light strokes": force < _LIGHT_BELOW_N,
        "firm strokes": force >= _LIGHT_BELOW_N,
        "at the carrier": hertz >= _AT_CARRIER * CARRIER_HZ,
        "at the highest voltage": volts >= _AT_HIGHEST * volts.max(),
    }
    groups = []
    for name, inside in chosen.items():
        if (count := int(inside.sum())) >= FEWEST_OF_GROUP:
            error = hypot(float(np.linalg.norm(sd[inside])) / count, float(gain_sd[inside].max()))
            numbers = tuple(p.number for p, one in zip(points, inside, strict=True) if one)
            mean, largest = float(residual[inside].mean()), float(size[inside].max())
            groups.append(Equivalence(name, numbers, mean, quantile * error, largest))
    seen = np.isfinite(ripple)
    if (count := int(seen.sum())) >= FEWEST_OF_GROUP:
        mean = float(ripple[seen].mean())
        error = max(float(ripple[seen].std(ddof=1)), float(sd[seen].mean())) / np.sqrt(count)
        numbers = tuple(p.number for p, one in zip(points, seen, strict=True) if one)
        groups.append(Equivalence("the ripple at 2f", numbers, mean, quantile * error))
    return tuple(groups)


def _volts_power(points: Sequence[Point], predictor: StrokePredictor) -> Array:
    """Power of the voltage with which mu rises at strokes, d ln mu / d ln V, shape (strokes,)."""
    more = [replace(one, voltage_v=(1 + _VOLTS_STEP) * one.voltage_v) for one in points]
    low, high = (
        predictor.by_profiles(StrokeConditions.of(strokes)).log_mu for strokes in (points, more)
    )
    return np.asarray((high - low) / np.log1p(_VOLTS_STEP))


def fit_bound(
    fit: Fit, reduced: Reduced, rows: tuple[HeldOutStroke, ...], predictor: StrokePredictor
) -> float:
    """Largest error of friction [JND] that the fit's covariance leaves, at 95 %, in use.

    Over the range of the held-out strokes, at the carrier and at 125 Hz, where the contact is
    light. What the held-out strokes have shown is known there as well: the covariance is that after
    them.
    """
    highest = max((one.voltage_v for one in reduced.points if not one.outlier), default=0.0)
    axes = np.meshgrid(
        _USED_N, highest * np.array(_USED_SHARES), (FREQUENCY_HZ, CARRIER_HZ), _SPEED_MM_PER_S
    )
    parameters = Parameters.of(predictor.model.finger, predictor.model.screen)
    names = parameters.names
    fitted = [(at, names.index(name)) for at, name in enumerate(fit.free) if name in names]
    free, columns = (list(one) for one in zip(*fitted, strict=True))

    def by_log(strokes: StrokeConditions) -> tuple[Array, Mask]:
        predicted = predictor(strokes, names, parameters.log_values)
        return predicted.log_mu_jacobian[:, columns], predicted.is_light

    used, is_light = by_log(StrokeConditions(*(axis.ravel() for axis in axes)))
    covariance = fit.covariance[np.ix_(free, free)]
    if rows:
        seen, _ = by_log(StrokeConditions.of(row.point for row in rows))
        noise = np.diag(_spreads(rows, fit) ** 2)
        gain = covariance @ seen.T @ np.linalg.inv(seen @ covariance @ seen.T + noise)
        covariance = covariance - gain @ seen @ covariance
    variance = np.einsum("sp,pq,sq->s", used, covariance, used)[is_light]
    quantile = float(student.ppf(_LEVEL, max(len(fit.strokes) + len(rows) - len(free), 3)))
    return quantile * float(np.sqrt(variance.max(initial=0.0))) / WEBER_FRACTION


def _spreads(rows: tuple[HeldOutStroke, ...], fit: Fit) -> Array:
    """Standard deviation of ln mu of each stroke: its own error and the repeatability."""
    points = [row.point for row in rows]
    own_sd = np.array([p.mu_sd / p.mu for p in points])
    return np.asarray(np.maximum(np.hypot(own_sd, fit.repeatability.log_mu), 1e-9))


def steadiness(fit: Fit, reduced: Reduced, predictor: StrokePredictor) -> Steadiness:
    """Find the trends of all good strokes against their prediction, by the profiles' predictor."""
    points = [one for one in reduced.points if not one.outlier]
    repeats = fit.repeatability.log_mu / WEBER_FRACTION
    if len(points) < _FEWEST_OF_TREND:
        return Steadiness(repeats)
    predicted = predictor.by_profiles(StrokeConditions.of(points))
    good = predicted.is_light
    misfit = (np.log([one.mu for one in points]) - predicted.log_mu)[good] / WEBER_FRACTION
    order = np.array([one.number for one in points], dtype=float)[good]
    creep = np.array([one.creep for one in points])
    creep = creep[np.isfinite(creep)] * log(10) / WEBER_FRACTION
    return Steadiness(repeats, *_slope(order, misfit), *_mean(creep))


def _slope(order: Array, misfit: Array) -> tuple[float, float]:
    """Change from the first to the last, and its uncertainty."""
    if len(order) < _FEWEST_OF_TREND or not np.ptp(order):
        return nan, nan
    line, lasts = linregress(order, misfit), float(np.ptp(order))
    quantile = float(student.ppf(_LEVEL, len(order) - 2))
    return line.slope * lasts, quantile * line.stderr * lasts


def _mean(values: Array, fewest: int = _FEWEST_OF_TREND) -> tuple[float, float]:
    """Mean, and its uncertainty from the scatter."""
    if len(values) < fewest:
        return nan, nan
    quantile = float(student.ppf(_LEVEL, len(values) - 1))
    return float(values.mean()), quantile * float(sem(values))


@dataclass(frozen=True)
class Drift:
    """Mean change of friction since a profile was made.

    Parameters
    ----------
    mean_jnd : float
        Mean of measured minus predicted friction [JND].
    uncertainty_jnd : float
        The true mean is within it, either side, at 90 %: the scatter of the strokes, by Student's
        t.
    strokes : int
        Number of strokes.
    """

    mean_jnd: Annotated[float, Heading("mean [JND]", "+.2f")]
    uncertainty_jnd: Annotated[float, Heading("± [JND]", ".2f")]
    strokes: Annotated[int, Heading("strokes")]

    @classmethod
    def of(cls, residuals: Array) -> Drift:
        """Mean of residuals [JND] with its uncertainty, which two or more are needed for."""
        if len(residuals) < 2:
            return cls(float(residuals.sum()), inf, len(residuals))
        return cls(*_mean(residuals, 2), len(residuals))

    @property
    def is_within(self) -> bool:
        """Whether the whole interval is within half a JND."""
        return abs(self.mean_jnd) + self.uncertainty_jnd <= TOLERANCE_JND


@dataclass(frozen=True)
class ProfileCheck:
    """Strokes against a profile.

    Parameters
    ----------
    strokes : tuple of HeldOutStroke
        Every good stroke and its prediction.
    drifts : mapping of str to Drift
        Of "all" strokes, and of those "without_voltage" and "with_voltage": another finger or
        cleaning shifts both, a changed insulator or drive the driven ones alone.
    """

    strokes: tuple[HeldOutStroke, ...]
    drifts: dict[str, Drift]

    @property
    def passed(self) -> bool:
        """Whether friction of all, and of the driven strokes, is within half a JND."""
        return all(self.drifts[name].is_within for name in ("all", "with_voltage"))

    @property
    def verdict(self) -> Literal["passed", "failed"]:
        """The same in a word."""
        return "passed" if self.passed else "failed"


def check_profile(reduced: Reduced, predictor: StrokePredictor) -> ProfileCheck:
    """Compare all good strokes with a predictor of the profiles, none of which it was fitted to.

    Raises
    ------
    InputError
        If there are fewer than two good strokes with a voltage.
    """
    points = [point for point in reduced.points if not point.outlier]
    driven = np.array([point.voltage_v > 0 for point in points], dtype=bool)
    if driven.sum() < FEWEST_OF_GROUP:
        raise InputError(
            f"expected {FEWEST_OF_GROUP} good strokes with a voltage or more, got {driven.sum()}"
        )
    rows = HeldOutStroke.predicted(points, predictor)
    residuals = np.array([one.residual_jnd for one in rows])
    groups = {"all": residuals, "with_voltage": residuals[driven]}
    groups["without_voltage"] = residuals[~driven]
    return ProfileCheck(rows, {name: Drift.of(values) for name, values in groups.items()})
