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
from math import hypot, isfinite
from typing import Annotated, Any, Literal, Self

import numpy as np
from scipy.stats import t as student

from calibration.fit.result import Fit
from calibration.measure.reduction import Point, Reduced
from calibration.measure.rig import RigCheck
from calibration.plan.parameters import PER_RIG, Array, Mask, Parameters
from calibration.plan.predict import StrokeConditions, StrokePredictor
from calibration.plan.protocol import CARRIER_HZ, FREQUENCY_HZ, USUAL_MM_PER_S
from calibration.verify.budget import Budget
from calibration.verify.steadiness import LEVEL, TOLERANCE_JND, Steadiness, steadiness
from haptix.base.report import Heading, HeadingsOf
from haptix.model.perception.thresholds import WEBER_FRACTION
from haptix.model.screen import VerifiedRange

Verdict = Literal["passed", "provisional", "failed"]

RIG_HOLDS_DAYS = 31
"""A rig checked longer before or after its strokes is not known: cables and gains are changed."""

FEWEST_HELD_OUT = 4
FEWEST_OF_GROUP = 2
_OTHER_SPEED = 1.3  # times the usual one, up or down, from which a stroke counts as fast or slow
_LONG_S = 10.0  # from which a contact counts as long
_LIGHT_BELOW_N = 0.45  # the middle of the protocols' forces
_AT_CARRIER = 0.5  # of the carrier's frequency, from which a stroke counts as one at the carrier
_SLACK = 1.1  # above the volts that were read, up to which an amplifier counts as known
_AT_HIGHEST = 0.9  # of the highest voltage that was held out: the carrier's is limited by current
# Where friction is to be known: the range of the held-out strokes.
_USED_N = (0.2, 0.5, 0.8)
_USED_SHARES = (0.0, 0.5, 0.9)  # of the highest voltage
_STEP = 0.01  # relative, of a numerical derivative
_SHOWN = HeadingsOf(("number", "normal_force_n", "voltage_v", "frequency_hz", "mu"))
_WITHIN = "{0.mean_jnd:+.2f} ± {0.uncertainty_jnd:.2f}"


@dataclass(frozen=True)
class HeldOutStroke:
    """A stroke kept out of the fit, and its prediction by the fit.

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
        return tuple(cls(*row) for row in zip(points, *numbers, strict=True))


@dataclass(frozen=True)
class Equivalence:
    """Mean error of friction in one group of held-out strokes."""

    group: Annotated[str, Heading("held-out strokes", "{0.group} ({0.count})")]
    """Which strokes."""
    strokes: tuple[int, ...]
    """Their numbers."""
    mean_jnd: Annotated[float, Heading("error [JND]", _WITHIN)]
    """Mean of measured minus predicted friction [JND]."""
    uncertainty_jnd: float
    """The true mean is within it, either side, at 90 % [JND]: scatter, and the rig's gains."""
    rig_jnd: Annotated[float, Heading("by the rig alone [JND]", ".2f")] = 0.0
    """What of it the uncertainty of the rig's gains alone would be [JND]; no stroke shows it."""

    @property
    def count(self) -> int:
        """How many strokes."""
        return len(self.strokes)

    @property
    def bound_jnd(self) -> Annotated[float, Heading("at most [JND]", ".2f")]:
        """Largest error of friction that the strokes leave possible [JND]."""
        return abs(self.mean_jnd) + self.uncertainty_jnd


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
        Tests that were made.
    untested : tuple of str
        Tests that were not, so that the verdict is provisional.
    fit_bound_jnd : float
        Largest error [JND], at 95 %, that the fit's own uncertainty leaves where the screen is
        used.
    steadiness : Steadiness
        Repeatability, drift over the session, and creep in contact.
    budget : tuple of Budget
        Uncertainty of friction, its range and the insulator.
    contrast : Equivalence or None
        Error of mu(V)/mu(0): of held-out strokes with a voltage, less that of strokes without.
    volts_read : bool
        Whether a second instrument read the volts.
    is_open : bool
        Whether it failed only by what more strokes may decide: the scatter leaves a group open, or
        the fit does not determine friction or the insulator.
    """

    strokes: tuple[HeldOutStroke, ...]
    tolerance_jnd: float
    failures: tuple[str, ...]
    groups: tuple[Equivalence, ...] = ()
    untested: tuple[str, ...] = ()
    fit_bound_jnd: float = float("nan")
    steadiness: Steadiness = field(default_factory=Steadiness)
    budget: tuple[Budget, ...] = ()
    contrast: Equivalence | None = None
    volts_read: bool = False
    is_open: bool = False

    @property
    def contrast_verdict(self) -> Annotated[Verdict, Heading("verdict of the contrast")]:
        """Verdict on mu(V)/mu(0) alone: no gain of a force changes it, so no weight is needed."""
        if self.contrast is None or not self.volts_read:
            return "provisional"
        return "passed" if self.contrast.bound_jnd <= self.tolerance_jnd else "failed"

    @property
    def contrast_text(self) -> str:
        """One line for people."""
        if self.contrast is None:
            return "provisional: fewer than two strokes without voltage, or with one"
        unread = "" if self.volts_read else "; no second instrument read the volts"
        return (
            f"{self.contrast_verdict}: {self.contrast.mean_jnd:+.2f} ± "
            f"{self.contrast.uncertainty_jnd:.2f} JND from the prediction{unread}"
        )

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
    def verified(self) -> VerifiedRange | None:
        """Range of force, volts, frequency, speed and contact of the strokes; None without any."""
        points = [row.point for row in self.strokes if row.is_light]
        if not points:
            return None
        names = "normal_force_n", "frequency_hz", "speed_mm_per_s"
        columns = {name: [getattr(point, name) for point in points] for name in names}
        highest: dict[float, float] = {}
        for point in points:
            highest[point.frequency_hz] = max(point.voltage_v, highest.get(point.frequency_hz, 0.0))
        contact_s = [point.contact_s for point in points if isfinite(point.contact_s)]
        return VerifiedRange(
            **{name: (min(column), max(column)) for name, column in columns.items()},
            contact_s=max(contact_s, default=None),
            voltage_v=tuple(sorted(highest.items())),
        )

    @property
    def parts(self) -> list[tuple[str, Sequence[Any]]]:
        """What people read of it, by title: rows of a table, or lines; without empty ones."""
        parts: list[tuple[str, Sequence[Any]]] = [
            ("Why it failed", self.failures),
            ("Not tested", self.untested),
            ("Errors of friction, by the strokes kept out of the fit", self.groups),
            ("Contrast mu(V)/mu(0), a verdict of its own", [self.contrast_text]),
            ("Strokes kept out of the fit", self.strokes),
            ("Uncertainty", self.budget),
            ("Uncertainty budget", [row for budget in self.budget for row in budget.main]),
            ("Steadiness", [self.steadiness.text]),
        ]
        return [(title, rows) for title, rows in parts if rows]

    @property
    def worst_jnd(self) -> Annotated[float, Heading("worst stroke [JND]", ".2f")]:
        """Largest residual of mu [JND]; NaN without strokes."""
        return max((abs(row.residual_jnd) for row in self.strokes), default=float("nan"))

    @property
    def bound_jnd(self) -> Annotated[float, Heading("at most [JND]", ".2f")]:
        """Largest error of friction that is left possible [JND]; NaN without strokes."""
        return max((group.bound_jnd for group in self.groups), default=float("nan"))


def verify(
    fit: Fit,
    reduced: Reduced,
    predictor: StrokePredictor,
    tolerance_jnd: float = TOLERANCE_JND,
    rig: RigCheck | None = None,
    measured_on: date | None = None,
    looks: int = 1,
) -> Verification:
    """Predict the held-out strokes, compare, and test for equivalence.

    It fails where a group's mean error, its uncertainty included, may be above the tolerance, where
    the fit's own uncertainty of friction is, where fewer than four strokes were kept out, or where
    the strokes do not determine the screen's insulator. It is provisional without a `rig` check of
    forces and volts, with one that lies more than `RIG_HOLDS_DAYS` from the strokes of
    `measured_on`, where the rig's check has fewer than three levels of volts at two frequencies or
    one weight alone along the screen, where no two held-out strokes are at the carrier or at
    another speed than the usual one, and where none is of a long contact. A verdict that is looked
    at again, after strokes were added, has a level of 5 % over the number of `looks`.

    Parameters
    ----------
    fit : Fit
        The fit.
    reduced : Reduced
        All strokes, those held out included.
    predictor : StrokePredictor
        The model of the fit.
    tolerance_jnd : float
        Largest error that passes, in just-noticeable differences.
    rig : RigCheck, optional
        Check of the rig's forces and volts.
    measured_on : date, optional
        Day of the strokes.
    looks : int
        How often the verdict is looked at.
    """
    sensor = {name: fit.best(name) for name in PER_RIG if name in fit.names}
    predicted = HeldOutStroke.predicted(reduced.held_out, predictor, sensor)
    rows = tuple(stroke for stroke in predicted if stroke.is_light)
    failures = []
    if len(rows) < FEWEST_HELD_OUT:
        failures.append(
            f"expected {FEWEST_HELD_OUT} good strokes kept out of the fit or more, got {len(rows)}"
            + " in light contact" * (len(rows) < len(predicted))
        )
    groups = groups_of(rows, fit, predictor, rig, looks)
    undecided = 0
    for group in groups:
        if group.bound_jnd > tolerance_jnd:
            undecided += abs(group.mean_jnd) <= tolerance_jnd
            failures.append(
                f"{group.group} (strokes {', '.join(map(str, group.strokes))}): friction is "
                f"{group.mean_jnd:+.2g} ± {group.uncertainty_jnd:.2g} JND from the "
                f"prediction, which may be more than {tolerance_jnd:g}"
                + _undecided(fit)
                * (abs(group.mean_jnd) <= tolerance_jnd)
            )
    bound = fit_bound(fit, reduced, rows, predictor)
    if bound > tolerance_jnd:
        undecided += 1
        failures.append(
            f"the fit knows friction within {bound:.2g} JND only, somewhere in the range of use; "
            f"expected {tolerance_jnd:g}: measure more strokes"
        )
    if fit["h0_m"].value is None:
        undecided += 1
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
    bounds = [group.bound_jnd for group in groups]
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
    highest = max((row.point.voltage_v for row in rows), default=0.0)
    if rig is None or not rig.reads_volts:
        untested.append(_gains_not_checked(rows, predictor, rig))
    elif not rig.knows_volts:
        untested.append(
            "the volts at three levels and two frequencies: an amplifier may be weak at the "
            "highest alone; repeat `haptix calibrate rig`"
        )
    elif rig.highest_read_v < highest / _SLACK:
        untested.append(
            f"the volts above {rig.highest_read_v:.3g} V: a second instrument read no higher, and "
            f"strokes had {highest:.3g} V; repeat `haptix calibrate rig`"
        )
    if rig is not None:
        failures += rig.faults()
        if rig.second_tangential_gain is None:
            untested.append(
                "the tangential force by a second weight, or at another angle: repeat "
                "`haptix calibrate rig` with --second-weight-n"
            )
        if (days := rig.days_from(measured_on)) > RIG_HOLDS_DAYS:
            untested.append(
                f"the rig on the day of the strokes: it was checked on {rig.measured_on}, "
                f"{days} days away; repeat `haptix calibrate rig`"
            )
    if rows and not any(group.group == "at the carrier" for group in groups):
        untested.append(f"the carrier: no two held-out strokes near {CARRIER_HZ:g} Hz")
    if rows and not any(group.group in ("slow strokes", "fast strokes") for group in groups):
        untested.append(f"other speeds: no two held-out strokes off {USUAL_MM_PER_S:g} mm/s")
    if rows and not any(group.group == "late in a long contact" for group in groups):
        untested.append(f"long contacts: no held-out stroke slides for {_LONG_S:g} s or more")
    good = [point for point in reduced.points if not point.outlier and not point.voltage_v]
    at_rest = HeldOutStroke.predicted(good, predictor)
    return Verification(
        rows,
        tolerance_jnd,
        tuple(failures),
        groups,
        tuple(untested),
        bound,
        steady,
        contrast=contrast_of(rows, at_rest, fit, predictor, rig),
        volts_read=rig is not None and rig.knows_volts and rig.highest_read_v >= highest / _SLACK,
        is_open=bool(undecided) and undecided == len(failures),
    )


def _gains_not_checked(
    rows: tuple[HeldOutStroke, ...], predictor: StrokePredictor, rig: RigCheck | None
) -> str:
    """State the effect of the gains that no stroke separates from friction."""
    power = _power([row.point for row in rows], predictor, "voltage_v") if rows else np.zeros(1)
    force, volts = (0.01 * power_of / WEBER_FRACTION for power_of in (1.0, float(power.max())))
    of_volts = f"1 % of the volts up to {volts:.2f} JND"
    if rig is not None:
        return f"the volts, by no second reading of them: {of_volts}"
    return (
        f"the rig's gains, by no known weight and no second reading of the volts: 1 % of a force "
        f"is {force:.2f} JND, {of_volts}"
    )


def _undecided(fit: Fit) -> str:
    """Name the session that would decide a question that the scatter leaves open."""
    return (
        "; its scatter leaves that open: a session planned with --repeatability-percent "
        f"{100 * fit.repeatability.log_mu:.2g} holds out strokes enough to decide"
    )


def groups_of(
    rows: tuple[HeldOutStroke, ...],
    fit: Fit,
    predictor: StrokePredictor,
    rig: RigCheck | None,
    looks: int = 1,
) -> tuple[Equivalence, ...]:
    """Mean errors of the groups that have two strokes or more, and that late in a contact."""
    if len(rows) < FEWEST_OF_GROUP:
        return ()
    points = [row.point for row in rows]
    residual = np.array([row.residual_jnd for row in rows])
    ripple = np.array([row.ripple_residual_jnd for row in rows])
    sd = _spreads(rows, fit) / WEBER_FRACTION
    # The fit's own strokes and these tell the scatter together; a misfit here makes it larger,
    # never smaller.
    freedom = max(
        len(fit.strokes) - sum(estimate.value is not None for estimate in fit.estimates), 3
    )
    freedom_here = len(rows) - 1
    spread = float(((residual - residual.mean()) ** 2 / sd**2).sum())
    sd *= np.sqrt(max((freedom + spread) / (freedom + freedom_here), 1.0))
    quantile = float(student.ppf(1 - (1 - LEVEL) / looks, freedom + freedom_here))
    gain_sd = np.zeros(len(rows))
    if rig is not None:
        powers = (_power(points, predictor, name) for name in ("voltage_v", "normal_force_n"))
        gain_sd = rig.friction_spread(*powers)
    force, volts, hertz, speed = np.array(
        [(p.normal_force_n, p.voltage_v, p.frequency_hz, p.speed_mm_per_s) for p in points]
    ).T
    chosen = {
        "all": np.ones(len(rows), dtype=bool),
        "light strokes": force < _LIGHT_BELOW_N,
        "firm strokes": force >= _LIGHT_BELOW_N,
        "at the carrier": hertz >= _AT_CARRIER * CARRIER_HZ,
        "at the highest voltage": volts >= _AT_HIGHEST * volts.max(),
        "slow strokes": speed < USUAL_MM_PER_S / _OTHER_SPEED,
        "fast strokes": speed > USUAL_MM_PER_S * _OTHER_SPEED,
    }
    groups = []
    for name, inside in chosen.items():
        if (count := int(inside.sum())) >= FEWEST_OF_GROUP:
            by_rig = float(gain_sd[inside].max())
            error = hypot(float(np.linalg.norm(sd[inside])) / count, by_rig)
            numbers = tuple(p.number for p, is_in in zip(points, inside, strict=True) if is_in)
            mean = float(residual[inside].mean())
            groups.append(Equivalence(name, numbers, mean, quantile * error, quantile * by_rig))
    # What a contact changes is seen within the stroke, beside the error of all at its beginning.
    if late := [p for p in points if p.contact_s >= _LONG_S and isfinite(p.rise)]:
        rise = float(np.mean([p.rise for p in late])) / WEBER_FRACTION
        rise_sd = float(np.linalg.norm([p.rise_sd for p in late])) / len(late) / WEBER_FRACTION
        error = hypot(groups[0].uncertainty_jnd, quantile * rise_sd)
        numbers = tuple(p.number for p in late)
        mean = groups[0].mean_jnd + rise
        groups.append(
            Equivalence("late in a long contact", numbers, mean, error, groups[0].rig_jnd)
        )
    seen = np.isfinite(ripple)
    if (count := int(seen.sum())) >= FEWEST_OF_GROUP:
        mean = float(ripple[seen].mean())
        error = max(float(ripple[seen].std(ddof=1)), float(sd[seen].mean())) / np.sqrt(count)
        numbers = tuple(p.number for p, is_seen in zip(points, seen, strict=True) if is_seen)
        groups.append(Equivalence("the ripple at 2f", numbers, mean, quantile * error))
    return tuple(groups)


def contrast_of(
    rows: tuple[HeldOutStroke, ...],
    at_rest: tuple[HeldOutStroke, ...],
    fit: Fit,
    predictor: StrokePredictor,
    rig: RigCheck | None,
) -> Equivalence | None:
    """Mean error of mu(V)/mu(0), in which the gains of both forces cancel; None for few strokes."""
    driven = tuple(row for row in rows if row.point.voltage_v)
    if min(len(driven), len(at_rest)) < FEWEST_OF_GROUP:
        return None
    errors, variance = [], 0.0
    for group in (driven, at_rest):
        errors.append(float(np.mean([stroke.residual_jnd for stroke in group])))
        sd = _spreads(group, fit) / WEBER_FRACTION / len(group)
        variance += float((sd**2).sum())
    by_volts = 0.0
    if rig is not None:
        power = _power([stroke.point for stroke in driven], predictor, "voltage_v")
        by_volts = float(power.max()) * rig.volts_spread / WEBER_FRACTION
    quantile = float(student.ppf(LEVEL, max(len(fit.strokes) - len(fit.free), 3)))
    return Equivalence(
        "mu(V)/mu(0)",
        tuple(stroke.point.number for stroke in driven),
        errors[0] - errors[1],
        quantile * hypot(variance**0.5, by_volts),
        quantile * by_volts,
    )


def _power(points: Sequence[Point], predictor: StrokePredictor, name: str) -> Array:
    """Power of a condition with which mu rises at strokes, d ln mu / d ln of it."""
    more = [replace(point, **{name: (1 + _STEP) * getattr(point, name)}) for point in points]
    low, high = (
        predictor.by_profiles(StrokeConditions.of(strokes)).log_mu for strokes in (points, more)
    )
    return np.asarray((high - low) / np.log1p(_STEP))


def fit_bound(
    fit: Fit, reduced: Reduced, rows: tuple[HeldOutStroke, ...], predictor: StrokePredictor
) -> float:
    """Largest error of friction [JND] that the fit's covariance leaves, at 95 %, in use.

    Over the range of the held-out strokes, at the carrier and at 125 Hz, where the contact is
    light. What the held-out strokes have shown is known there as well: the covariance is that after
    them.
    """
    highest = max((point.voltage_v for point in reduced.points if not point.outlier), default=0.0)
    axes = np.meshgrid(
        _USED_N, highest * np.array(_USED_SHARES), (FREQUENCY_HZ, CARRIER_HZ), USUAL_MM_PER_S
    )
    parameters = Parameters.of(predictor.model.finger, predictor.model.screen)
    names = parameters.names
    fitted = [(at, names.index(name)) for at, name in enumerate(fit.free) if name in names]
    free, columns = (list(values) for values in zip(*fitted, strict=True))

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
    quantile = float(student.ppf(LEVEL, max(len(fit.strokes) + len(rows) - len(free), 3)))
    return quantile * float(np.sqrt(variance.max(initial=0.0))) / WEBER_FRACTION


def _spreads(rows: tuple[HeldOutStroke, ...], fit: Fit) -> Array:
    """Standard deviation of ln mu of each stroke: its own error and the repeatability."""
    points = [row.point for row in rows]
    own_sd = np.array([p.mu_sd / p.mu for p in points])
    return np.asarray(np.maximum(np.hypot(own_sd, fit.repeatability.log_mu), 1e-9))
