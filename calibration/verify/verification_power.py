"""Power of a verification: the chance that a good screen passes with a protocol, before a stroke.

Sessions are drawn as the model expects them: a fit that is wrong by its own covariance, and
held-out strokes that scatter by the rig's repeatability. `calibration.verify.verification` tests
each. Fingers and screens are drawn too, from the priors: on each the fitted strokes determine
d1/eps1 or do not.
"""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace
from typing import cast

import numpy as np

from calibration.fit.fitting import reported_within
from calibration.fit.result import Fit, Repeatability
from calibration.measure.reduction import Point, Reduced
from calibration.plan.parameters import Array, Parameters
from calibration.plan.predict import Prediction, StrokeConditions, StrokePredictor
from calibration.plan.protocol import (
    MU_ERROR,
    RIPPLE_ERROR,
    Protocol,
    determining_strokes,
    expected_rows,
    with_held_out,
)
from calibration.verify.steadiness import TOLERANCE_JND
from calibration.verify.verification import (
    Equivalence,
    HeldOutStroke,
    Verification,
    fit_bound,
    groups_of,
)
from haptix.model.perception.thresholds import WEBER_FRACTION

ENOUGH = 0.95
"""Chance of a good screen from which a plan needs no more strokes.

It is that of a screen that follows the model; with other contact laws among them 88 % passed
(docs/calibration.md).
"""

MOST_HELD_OUT = 60
"""Held-out strokes beyond which no more are planned."""

_AIMED = 0.8  # of the spread that is reported: other contact laws and the form leave a larger one
_TRUTHS, _MOST_TRUTHS = 40, 400  # fingers and screens drawn; most of them snap in at a high voltage
_UNKNOWN_SPREAD = 0.4  # of what has no prior: within a factor of two in most cases
_LEAST_REPEATABILITY = 1e-3
_DRAWS = 200  # of a chance of 0.9: known within 0.02
_RIPPLE_SD = 1e-3  # in mu, beside RIPPLE_ERROR
_RIPPLE_SEEN_BELOW_HZ = 900.0


def chance_of_passing(
    predictor: StrokePredictor,
    parameters: Parameters,
    protocol: Protocol,
    repeatability: float,
    determined: float | None = None,
) -> float:
    """Share of sessions in which a screen that follows the model passes.

    `repeatability` is the standard deviation of ln mu from stroke to stroke, and `determined` the
    share of `drawn_truths` on which the fitted strokes determine d1/eps1, if it is known.
    """
    repeatability = max(repeatability, _LEAST_REPEATABILITY)
    fitted, held_out = (
        StrokeConditions.of(stroke for stroke in protocol.strokes if stroke.held_out is wanted)
        for wanted in (False, True)
    )
    if determined is None:
        _, known_h0 = drawn_truths(predictor, parameters, fitted, repeatability)
        determined = _share_determined(parameters, known_h0)
    known, seen = (
        predictor(strokes, parameters.names, parameters.log_values)
        for strokes in (fitted, held_out)
    )
    light = known.is_light
    of_mu, of_ripple = (_by_free(parameters, jacobian)[light] for jacobian in _jacobians(known))
    of_ripple = of_ripple / _ripple_sd(known)[light, None]
    information = parameters.prior_information() + of_mu.T @ of_mu / repeatability**2
    covariance = np.linalg.inv(information + of_ripple.T @ of_ripple)
    spread = np.sqrt(np.diag(covariance))
    values = [None if sd > reported_within(name) else 1.0
             for name, sd in zip(parameters.free, spread, strict=True)]  # fmt: skip
    fit = SimpleNamespace(
        strokes=[*np.flatnonzero(light)],
        estimates=[SimpleNamespace(value=value) for value in values],
        free=parameters.free,
        covariance=covariance,
        repeatability=Repeatability(repeatability),
    )
    freedom = max(len(fit.strokes) - sum(value is not None for value in values), 3)
    mu_jacobian, ripple_jacobian = (_by_free(parameters, jacobian) for jacobian in _jacobians(seen))
    ripple_sd, rng = _ripple_sd(seen), np.random.default_rng(0)
    rows = _rows(held_out, seen, seen.log_mu, seen.ripple)
    points = Reduced(tuple(row.point for row in rows))
    if fit_bound(cast(Fit, fit), points, rows, predictor) > TOLERANCE_JND:
        return 0.0
    passed = 0
    for _ in range(_DRAWS):
        off = rng.multivariate_normal(np.zeros(len(spread)), covariance)
        log_mu = seen.log_mu + mu_jacobian @ off + rng.normal(0, repeatability, len(rows))
        ripple = seen.ripple + ripple_jacobian @ off + rng.normal(0, ripple_sd)
        scatter = repeatability * np.sqrt(rng.chisquare(freedom) / freedom)
        fit.repeatability = Repeatability(float(scatter))
        drawn = _rows(held_out, seen, log_mu, ripple)
        groups = groups_of(drawn, cast(Fit, fit), predictor, None)
        passed += all(group.bound_jnd <= TOLERANCE_JND for group in groups)
    return determined * passed / _DRAWS


def _share_determined(parameters: Parameters, information: Array) -> float:
    """Share of truths whose d1/eps1 is determined, what the theory's own error adds included."""
    at = parameters.free.index("h0_m")
    variances = np.linalg.inv(information)[:, at, at]
    return float(np.mean(variances <= (_AIMED * reported_within("h0_m")) ** 2))


def drawn_truths(
    predictor: StrokePredictor,
    parameters: Parameters,
    strokes: StrokeConditions,
    repeatability: float,
) -> tuple[list[Parameters], Array]:
    """Draw fingers and screens on which the strokes stay in light contact.

    Also returns what the strokes tell of each, shape (truths, free, free).
    """
    repeatability = max(repeatability, _LEAST_REPEATABILITY)
    rng, truths, information = np.random.default_rng(1), [], []
    for _ in range(_MOST_TRUTHS):
        log_values = {
            name: np.log(parameters[name].value)
            + rng.normal(0, parameters.prior_spread(name) or _UNKNOWN_SPREAD)
            for name in parameters.free
        }
        truth = parameters.started_at(**{n: float(np.exp(v)) for n, v in log_values.items()})
        rows, is_light = expected_rows(predictor, truth, strokes)
        if is_light.all():
            rows = rows * np.array([[MU_ERROR / repeatability], [1.0]])
            truths.append(truth)
            information.append(parameters.prior_information() + (rows.mT @ rows).sum(0))
        if len(truths) == _TRUTHS:
            break
    if not truths:  # the voltage is too high for most fingers: that of the start alone is planned
        rows, is_light = expected_rows(predictor, parameters, strokes)
        rows = rows[is_light] * np.array([[MU_ERROR / repeatability], [1.0]])
        return [parameters], (parameters.prior_information() + (rows.mT @ rows).sum(0))[None]
    return truths, np.array(information)


def with_enough_strokes(
    predictor: StrokePredictor,
    parameters: Parameters,
    protocol: Protocol,
    repeatability: float,
    max_voltage_v: float,
) -> tuple[Protocol, float]:
    """Add strokes until a good screen passes in `ENOUGH` of sessions; with the chance.

    Fitted strokes are added first, until they determine d1/eps1 in as many, and held-out strokes
    then. Where 60 held-out strokes are not enough, the protocol has as many.
    """
    repeatability = max(repeatability, _LEAST_REPEATABILITY)
    fitted = StrokeConditions.of(stroke for stroke in protocol.strokes if not stroke.held_out)
    truths, information = drawn_truths(predictor, parameters, fitted, repeatability)
    most = _AIMED * reported_within("h0_m")
    more = determining_strokes(
        predictor, truths, information, repeatability, max_voltage_v, most, (1 + ENOUGH) / 2
    )

    fewest = len(protocol.held_out)
    if more:
        protocol = with_held_out(protocol, fewest, max_voltage_v, more)
        fitted = StrokeConditions.of(stroke for stroke in protocol.strokes if not stroke.held_out)
        _, information = drawn_truths(predictor, parameters, fitted, repeatability)
    determined = _share_determined(parameters, information)
    enough = protocol, chance_of_passing(predictor, parameters, protocol, repeatability, determined)

    def tried(count: int) -> tuple[Protocol, float]:
        plan = with_held_out(protocol, count, max_voltage_v)
        return plan, chance_of_passing(predictor, parameters, plan, repeatability, determined)

    if enough[1] < ENOUGH and fewest < MOST_HELD_OUT:
        enough = tried(MOST_HELD_OUT)
        too_few, count = fewest, MOST_HELD_OUT
        while enough[1] >= ENOUGH and (middle := too_few + (count - too_few) // 4 * 2) > too_few:
            plan = tried(middle)
            if plan[1] >= ENOUGH:
                enough, count = plan, middle
            else:
                too_few = middle
    return enough


def extended_plan(
    predictor: StrokePredictor,
    parameters: Parameters,
    protocol: Protocol,
    fit: Fit,
    verification: Verification,
) -> Protocol | None:
    """Return the plan with the strokes added that would decide an open verdict.

    None where no number of strokes that `determining_strokes` allows determines d1/eps1 beside
    what the forms of the model leave open, or where a group would stay open with all of them.
    """
    repeatability = max(fit.repeatability.log_mu, _LEAST_REPEATABILITY)
    max_voltage_v = max(stroke.voltage_v for stroke in protocol.strokes)
    count, fitted = len(protocol.held_out), list[Sequence[float]]()
    if fit["h0_m"].value is None:
        fitted_parameters = parameters.started_at(**{name: fit.best(name) for name in fit.free})
        # More strokes do not tell the forms apart better than these have.
        own = fit.posterior.own
        at = fit.free.index("h0_m")
        left = reported_within("h0_m") ** 2 - (fit.covariance - own)[at, at]
        if left <= 0:
            return None
        known = np.asarray(np.linalg.inv(own)[None])
        determining = determining_strokes(
            predictor, [fitted_parameters], known, repeatability, max_voltage_v,
            _AIMED * float(np.sqrt(left)),
        )  # fmt: skip
        if determining is None:
            return None
        fitted = determining
    if any(group.bound_jnd > verification.tolerance_jnd for group in verification.groups):
        repeats = WEBER_FRACTION * verification.steadiness.repeatability_jnd
        enough, _ = with_enough_strokes(predictor, parameters, protocol, repeats, max_voltage_v)
        before = count
        count = min(max(len(enough.held_out), count + max(count // 2, 2)), MOST_HELD_OUT)
        if not all(
            _would_decide(group, count / before, verification.tolerance_jnd)
            for group in verification.groups
        ):
            return None
    return protocol.extended(count, fitted)


def _would_decide(group: Equivalence, times: float, tolerance_jnd: float) -> bool:
    """Whether so many times the strokes decide a group whose mean stays as it is."""
    scatter = group.uncertainty_jnd**2 - group.rig_jnd**2
    left = float(np.sqrt(max(scatter, 0.0) / times + group.rig_jnd**2))
    return not abs(group.mean_jnd) - left <= tolerance_jnd < abs(group.mean_jnd) + left


def _jacobians(predicted: Prediction) -> tuple[Array, Array]:
    return predicted.log_mu_jacobian, predicted.ripple_jacobian


def _by_free(parameters: Parameters, jacobian: Array) -> Array:
    return jacobian[:, [parameters.names.index(name) for name in parameters.free]]


def _ripple_sd(predicted: Prediction) -> Array:
    return np.hypot(RIPPLE_ERROR * predicted.ripple, _RIPPLE_SD)


def _rows(
    strokes: StrokeConditions, predicted: Prediction, log_mu: Array, ripple: Array
) -> tuple[HeldOutStroke, ...]:
    """Held-out strokes of these frictions, and their prediction."""
    ripple = np.where(
        (strokes.voltage_v > 0) & (strokes.frequency_hz < _RIPPLE_SEEN_BELOW_HZ), ripple, np.nan
    )
    columns = (*vars(strokes).values(), np.exp(log_mu), ripple)
    points = [
        Point(number, force, volts, hertz, speed, mu, 0.0, wave, _RIPPLE_SD)
        for number, (force, volts, hertz, speed, mu, wave) in enumerate(
            np.transpose(columns).tolist(), start=1
        )
    ]
    numbers = np.exp(predicted.log_mu).tolist(), predicted.ripple.tolist()
    made = (HeldOutStroke(*row) for row in zip(points, *numbers, strict=True))
    return tuple(stroke for stroke, light in zip(made, predicted.is_light, strict=True) if light)
