"""Power of a verification: the chance that a good screen passes with a protocol, before a stroke.

Sessions are drawn as the model expects them: a fit that is wrong by its own covariance, and
held-out strokes that scatter by the rig's repeatability. `calibration.verification` tests each.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import numpy as np

from calibration.fit import Fit, Repeatability
from calibration.fitting import reported_within
from calibration.parameters import Array, Parameters
from calibration.predict import Prediction, StrokeConditions, StrokePredictor
from calibration.protocol import RIPPLE_ERROR, Protocol, with_held_out
from calibration.reduction import Point, Reduced
from calibration.steadiness import TOLERANCE_JND
from calibration.verification import HeldOutStroke, fit_bound, groups_of

ENOUGH = 0.95
"""Chance of a good screen from which a plan needs no more strokes.

It is that of a screen that is as the model says; with other contact laws among them 88 % passed
(docs/calibration.md).
"""

MOST_HELD_OUT = 60
"""Held-out strokes beyond which no more are planned."""

_DRAWS = 200  # of a chance of 0.9: known within 0.02
_RIPPLE_SD = 1e-3  # in mu, beside RIPPLE_ERROR
_RIPPLE_SEEN_BELOW_HZ = 900.0


def chance_of_passing(
    predictor: StrokePredictor, parameters: Parameters, protocol: Protocol, repeatability: float
) -> float:
    """Share of sessions in which a screen that is as the model says passes.

    `repeatability` is the standard deviation of ln mu from stroke to stroke.
    """
    fitted, held_out = (
        StrokeConditions.of(one for one in protocol.strokes if one.held_out is wanted)
        for wanted in (False, True)
    )
    known, seen = (
        predictor(strokes, parameters.names, parameters.log_values)
        for strokes in (fitted, held_out)
    )
    light = known.is_light
    of_mu, of_ripple = (_by_free(parameters, one)[light] for one in _jacobians(known))
    of_ripple = of_ripple / _ripple_sd(known)[light, None]
    information = parameters.prior_information() + of_mu.T @ of_mu / repeatability**2
    covariance = np.linalg.inv(information + of_ripple.T @ of_ripple)
    spread = np.sqrt(np.diag(covariance))
    values = [None if sd > reported_within(name) else 1.0
             for name, sd in zip(parameters.free, spread, strict=True)]  # fmt: skip
    fit = SimpleNamespace(
        strokes=[*np.flatnonzero(light)],
        estimates=[SimpleNamespace(value=one) for one in values],
        free=parameters.free,
        covariance=covariance,
        repeatability=Repeatability(repeatability),
    )
    freedom = max(len(fit.strokes) - sum(one is not None for one in values), 3)
    mu_jacobian, ripple_jacobian = (_by_free(parameters, one) for one in _jacobians(seen))
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
        passed += all(one.bound_jnd <= TOLERANCE_JND for one in groups)
    return passed / _DRAWS


def with_enough_held_out(
    predictor: StrokePredictor,
    parameters: Parameters,
    protocol: Protocol,
    repeatability: float,
    max_voltage_v: float,
) -> tuple[Protocol, float]:
    """Add held-out strokes until a good screen passes in `ENOUGH` of sessions; with the chance.

    Where 60 held-out strokes are not enough, the protocol has as many.
    """

    def tried(count: int) -> tuple[Protocol, float]:
        plan = with_held_out(protocol, count, max_voltage_v)
        return plan, chance_of_passing(predictor, parameters, plan, repeatability)

    fewest = sum(one.held_out for one in protocol.strokes)
    chance = chance_of_passing(predictor, parameters, protocol, repeatability)
    enough = protocol, chance
    if chance < ENOUGH and fewest < MOST_HELD_OUT:
        enough = tried(MOST_HELD_OUT)
        too_few, count = fewest, MOST_HELD_OUT
        while enough[1] >= ENOUGH and (middle := too_few + (count - too_few) // 4 * 2) > too_few:
            plan = tried(middle)
            if plan[1] >= ENOUGH:
                enough, count = plan, middle
            else:
                too_few = middle
    return enough


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
    made = (HeldOutStroke(*one) for one in zip(points, *numbers, strict=True))
    return tuple(one for one, light in zip(made, predicted.is_light, strict=True) if light)
