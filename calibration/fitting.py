"""Fit a screen and a finger to reduced strokes, and find which numbers the strokes determine."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from math import exp, inf, log, sqrt

import numpy as np
from scipy.optimize import least_squares
from scipy.stats import t as student

from calibration.fit import Fit, ParameterEstimate
from calibration.forms import FormFit, compare_forms, in_form
from calibration.parameters import EXPERIMENTS, PER_RIG, Array, Parameter, Parameters
from calibration.predict import StrokePredictor
from calibration.reduction import Point, Reduced
from calibration.residuals import SOFT_AT, Repeatability, Residuals
from haptix.errors import InputError

_PRIOR_SHARE = 0.8  # of the prior's spread: above it the strokes have measured nothing new
_BOOTSTRAPS = 100
_REPEATABILITY_ROUNDS = 3
_GOOD_START = 4.0  # cost of a row: far below that of a fit past pull-in
_LEVEL = 0.90
_PROFILE_COST = 2.706  # chi-squared of one parameter at 90 %
_PROFILE_LIMIT = log(1e3)
_FEWEST_STROKES = 6


def reported_within(name: str) -> float:
    """Largest standard deviation of a parameter's logarithm that is still reported as a number.

    d1/eps1 trades with the skin's d2/eps2: friction depends on their sum, and is known far better
    than either. The profile states the spread.
    """
    return 0.35 if name == "h0_m" else 0.1


def fit_strokes(
    reduced: Reduced,
    predictor: StrokePredictor,
    parameters: Parameters,
    seed: int = 0,
    bootstraps: int = _BOOTSTRAPS,
    forms: Mapping[str, StrokePredictor] | None = None,
) -> Fit:
    """Fit the strokes that are neither outliers nor held out.

    The bootstrap resamples the strokes; without one the errors come from the curvature of the fit
    alone. `forms` are other forms of the model (`calibration.forms`): the strokes are fitted in
    each as well, and the uncertainty is widened by what they do not tell apart.

    Raises
    ------
    InputError
        If there are too few strokes or nothing to fit.
    """
    points = reduced.used
    left_out = {point.number: point.outlier for point in reduced.outliers}
    if len(points) < _FEWEST_STROKES:
        reasons = "; ".join(f"stroke {n}: {why}" for n, why in list(left_out.items())[:3])
        raise InputError(
            f"expected {_FEWEST_STROKES} good strokes or more, got {len(points)}"
            + (f" ({reasons})" if reasons else "")
            + "; measure more"
        )
    if not parameters.free:
        raise InputError("expected a parameter to fit, but all are fixed")
    residuals, free = _fitted(predictor, parameters, points)
    light = residuals.predict(free).is_light
    if not light.all() and light.sum() >= _FEWEST_STROKES:
        for point in (p for p, is_light in zip(points, light, strict=True) if not is_light):
            left_out[point.number] = (
                f"past the light contact: at {point.voltage_v:.4g} V and "
                f"{point.normal_force_n:.3g} N it snaps in; use a lower voltage"
            )
        points = tuple(point for point in points if point.number not in left_out)
        found = dict(zip(parameters.free, np.exp(free).tolist(), strict=True))
        residuals, free = _fitted(predictor, parameters.restarted_at(found), points)
    covariance = np.asarray(np.linalg.inv(residuals.information(free)))
    if bootstraps:
        covariance = _larger(covariance, _bootstrap(residuals, free, seed, bootstraps))
    covariance = covariance + _exchanged(residuals, free)
    compared: list[FormFit] = []
    if forms:
        found = dict(zip(parameters.free, np.exp(free).tolist(), strict=True))
        others = {
            name: _fitted(other, in_form(parameters.restarted_at(found), other), points)
            for name, other in forms.items()
        }
        compared, added = compare_forms(residuals, free, others)
        covariance = covariance + added
    return Fit(
        estimates=tuple(_estimate(residuals, free, covariance, one) for one in parameters.all),
        names=parameters.names,
        free=parameters.free,
        log_values=residuals.all_logs(free),
        covariance=covariance,
        repeatability=residuals.repeatability,
        cost=residuals.cost(free),
        strokes=tuple(point.number for point in points),
        left_out=left_out,
        terms=tuple(sorted(predictor.model.terms)),
        forms=tuple(compared),
    )


def _exchanged(residuals: Residuals, free: Array) -> Array:
    """Covariance that is added since a finger's response and a sensor's pole look alike.

    Both are of first order, so at one speed the ripple alone does not tell which is which. The fit
    with the two exchanged is weighed by its likelihood.
    """
    names = residuals.parameters.free
    pair = "response_hz_per_mm_per_s", "sensor_pole_hz"
    if not set(pair) <= set(names):
        return np.zeros((len(free), len(free)))
    response, pole = (names.index(name) for name in pair)
    speed = log(float(np.mean([point.speed_mm_per_s for point in residuals.points])))
    start = free.copy()
    start[response], start[pole] = free[pole] - speed, free[response] + speed
    other = solve(residuals, start, most_steps=15)
    rise = max(residuals.cost(other) - residuals.cost(free), 0.0)
    away = other - free
    return np.asarray(exp(-rise / 2) * np.outer(away, away))


def solve(
    residuals: Residuals, start: Array, most_steps: int = 50, held: int | None = None
) -> Array:
    """Return the free parameters that fit best; number `held` stays at its start."""
    fitted = np.ones(len(start), dtype=bool)
    if held is not None:
        fitted[held] = False
    if not fitted.any():
        return start
    low, high = (bound[fitted] for bound in residuals.parameters.bounds())

    def whole(part: Array) -> Array:
        values = start.copy()
        values[fitted] = part
        return values

    found = least_squares(
        lambda part: residuals(whole(part)),
        np.clip(start[fitted], low + 1e-6, high - 1e-6),
        jac=lambda part: residuals.jacobian(whole(part))[:, fitted],
        bounds=(low, high),
        loss=residuals.loss,
        f_scale=SOFT_AT,
        x_scale=0.1,
        max_nfev=most_steps,
    )
    return whole(found.x)


def _fitted(
    predictor: StrokePredictor, parameters: Parameters, points: tuple[Point, ...]
) -> tuple[Residuals, Array]:
    """Fit with the repeatability that the residuals themselves show."""
    residuals = Residuals(predictor, parameters, points, Repeatability())
    free = residuals.with_best_sensor(_best_start(residuals))
    for _ in range(_REPEATABILITY_ROUNDS):
        repeatability = residuals.estimated_repeatability(free)
        residuals = Residuals(predictor, parameters, points, repeatability)
        free = solve(residuals, free)
    return residuals, free


def _best_start(residuals: Residuals) -> Array:
    """Fit from several insulators: past pull-in, no slope leads back to light contact."""
    free = residuals.parameters.free
    best = residuals.start, inf
    for factor in (1.0, 0.4, 2.5) if "h0_m" in free else (1.0,):
        start = residuals.start.copy()
        if "h0_m" in free:
            start[free.index("h0_m")] += log(factor)
        solution = solve(residuals, start, 25)
        best = min(best, (solution, residuals.cost(solution)), key=lambda pair: pair[1])
        if best[1] < _GOOD_START * residuals.data_rows:
            break
    return best[0]


def _bootstrap(residuals: Residuals, free: Array, seed: int, count: int) -> Array:
    """Covariance from resampled strokes, each with priors drawn anew.

    A replicate takes two Gauss-Newton steps from the fit, by the fit's Jacobian.
    """
    rng = np.random.default_rng(seed)
    strokes = len(residuals.points)
    jacobian = residuals.data_jacobian(free)
    weights, own = residuals.weights(free), residuals.data(free)
    prior, row_of = residuals.prior_matrix, residuals.stroke_of_row
    found = []
    for _ in range(count):
        times = np.bincount(rng.integers(0, strokes, strokes), minlength=strokes)[row_of]
        target = residuals.prior_target + rng.normal(size=len(residuals.prior_target))
        weighted = (weights * times)[:, None] * jacobian
        information = residuals.with_prior(weighted.T @ jacobian)
        at, misfit = free, own
        for last in (False, True):
            slope = weighted.T @ misfit + prior.T @ (prior @ at - target)
            step = np.linalg.solve(information, slope)
            at = at - step * min(1.0, 0.7 / max(float(np.abs(step).max()), 1e-9))
            misfit = misfit if last else residuals.data(at, jacobian=False)
        found.append(at)
    # Means of a few strokes vary less than those of all possible strokes would.
    spare = max(residuals.data_rows - residuals.parameters_used(free), 1.0)
    return np.asarray(np.atleast_2d(np.cov(np.array(found).T)) * residuals.data_rows / spare)


def _larger(covariance: Array, other: Array) -> Array:
    """The larger of two covariances in every direction.

    Larger spreads of single parameters with the correlations kept would be larger errors of what
    the parameters predict together, which is known far better than each.
    """
    root = np.linalg.cholesky(covariance)
    inverse = np.linalg.inv(root)
    values, vectors = np.linalg.eigh(inverse @ other @ inverse.T)
    spread = root @ vectors * np.sqrt(np.maximum(values, 1.0))
    return np.asarray(spread @ spread.T)


def _estimate(
    residuals: Residuals, free: Array, covariance: Array, one: Parameter
) -> ParameterEstimate:
    parameters = residuals.parameters
    estimate = partial(ParameterEstimate, name=one.name)
    if one.is_fixed:
        return estimate(value=one.value, low=one.value, high=one.value, spread=0.0, verdict="fixed")
    # The repeatability was itself estimated: Student's t.
    spare = max(len(residuals.points) - len(parameters.free), 3)
    quantile = float(student.ppf(0.5 + _LEVEL / 2, spare))
    index = parameters.free.index(one.name)
    middle, spread = float(free[index]), sqrt(float(covariance[index, index]))
    low, high = exp(middle - quantile * spread), exp(min(middle + quantile * spread, 700.0))
    before = parameters.prior_spread(one.name)
    is_measured = before is None or spread < _PRIOR_SHARE * before
    if is_measured and spread <= reported_within(one.name):
        return estimate(value=exp(middle), low=low, high=high, spread=spread, verdict="determined")
    if is_measured and one.name not in PER_RIG:
        # What other forms and an exchanged pole add, the likelihood of this form does not show.
        wider = profile(residuals, free, one.name, spread)
        low, high = min(low, wider[0]), max(high, wider[1])
    verdict = "undetermined" if is_measured else "prior"
    return estimate(
        low=low, high=high, spread=spread, verdict=verdict, advice=EXPERIMENTS[one.name]
    )


def profile(
    residuals: Residuals, free: Array, name: str, spread: float = 0.1
) -> tuple[float, float]:
    """90 % interval by profile likelihood: all others fitted anew at each value tried.

    `spread` is the standard deviation of the logarithm that the curvature suggests: the first step.
    A bound is 0 or infinite where the cost stays low within a factor of 1000.
    """
    index = residuals.parameters.free.index(name)
    best = residuals.cost(free)
    covariance = np.linalg.inv(residuals.information(free))
    # The others move as they are correlated: a start near each conditional fit.
    along = covariance[:, index] / covariance[index, index]
    bounds = []
    for side in (-1.0, 1.0):
        at, last, rise_last, bound = free.copy(), 0.0, 0.0, side * inf
        step = min(1.7 * spread, 1.0)
        while last < _PROFILE_LIMIT:
            distance = last + step
            at = at + along * (free[index] + side * distance - at[index])
            at = solve(residuals, at, most_steps=8, held=index)
            rise = residuals.cost(at) - best
            if rise >= _PROFILE_COST:
                # The root of the rise is nearly straight.
                roots = np.sqrt([max(rise_last, 0.0), rise])
                reached = np.interp(sqrt(_PROFILE_COST), roots, [last, distance])
                bound = float(free[index] + side * reached)
                break
            last, rise_last, step = distance, rise, min(1.6 * step, 1.5)
        bounds.append(exp(bound))
    return bounds[0], bounds[1]
