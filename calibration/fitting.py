"""Fit a screen and a finger to reduced strokes, and find which numbers the strokes determine."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from math import exp, inf, log, sqrt
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq, least_squares
from scipy.stats import t as student

from calibration.fit import Fit, ParameterEstimate
from calibration.forms import FormFit, carried_over, compare_forms, in_form, other_forms
from calibration.parameters import EXPERIMENTS, PER_RIG, Array, Parameter, Parameters
from calibration.predict import StrokePredictor
from calibration.reduction import Point, Reduced
from calibration.residuals import SOFT_AT, Repeatability, Residuals
from haptix.errors import InputError

_PRIOR_SHARE = 0.8  # of the prior's spread: above it the strokes have measured nothing new
_BOOTSTRAPS = 1000
_REPEATABILITY_ROUNDS = 3
_GOOD_START = 4.0  # cost of a row: far below that of a fit past pull-in
_LEVEL = 0.90
_PROFILE_COST = 2.706  # chi-squared of one parameter at 90 %
_PROFILE_LIMIT = log(1e3)
_FEWEST_STROKES = 6
_LEAST_FREEDOM = 3.0
_CURVED = 0.4  # spread of a logarithm beyond which the likelihood is no parabola
_SAME_ANSWER = 0.5  # standard deviations within which two fits are one
_OTHER_FORM = 0.5  # odds before the strokes: the default is the form that boundary elements chose
_MOST_EVIDENCE = 300.0  # beyond it a form's likelihood is no number
_WIDEST = 60.0  # standard deviations within which a quantile is looked for
_CLOSE_ENOUGH = 1e-5  # relative, of cost and logarithms: below a hundredth of any spread


DECISIVE = 10.0
"""Evidence, minus twice the log-likelihood, for which the theory is changed: 150 to 1."""


@dataclass(frozen=True)
class Posterior:
    """Distribution of the free parameters' logarithms: what strokes leave possible.

    A mixture of normal distributions. The fit in its own form is one component; each other form,
    and the fit with the finger's response and the sensor's pole exchanged, is another, weighed by
    its likelihood. A normal distribution as wide as their distance would hold the truth too often.

    Parameters
    ----------
    middle : array, shape (free,)
        The fit.
    own : array, shape (free, free)
        Covariance about each component's middle.
    measured : array, shape (free,)
        Share of the variance that comes from the strokes, whose repeatability is itself estimated;
        the rest is the priors'.
    freedom : float
        Degrees of freedom of that repeatability.
    others : array, shape (components, free)
        Middles of the other components.
    odds : array, shape (components,)
        Their likelihoods over the fit's.
    """

    middle: Array
    own: Array
    measured: Array
    freedom: float
    others: Array
    odds: Array

    @property
    def covariance(self) -> Array:
        """Second moment about the fit, shape (free, free)."""
        away = self.others - self.middle
        shares = self.odds / (1 + self.odds.sum())
        return np.asarray(self.own + (shares[:, None] * away).T @ away)

    def interval(self, index: int, level: float) -> tuple[float, float]:
        """Equal-tailed interval of one logarithm; the fit itself always lies within."""
        at = np.concatenate([[self.middle[index]], self.others[:, index]])
        weights = np.concatenate([[1.0], self.odds])
        weights /= weights.sum()
        sd = sqrt(float(self.own[index, index]))
        # Welch and Satterthwaite: only the measured share of the variance has few degrees.
        freedom = self.freedom / max(float(self.measured[index]), 1e-3) ** 2

        def beyond(value: float, tail: float) -> float:
            return float(weights @ student.cdf((value - at) / sd, freedom)) - tail

        ends = at.min() - _WIDEST * sd, at.max() + _WIDEST * sd
        low, high = (
            float(brentq(partial(beyond, tail=tail), *ends))
            for tail in ((1 - level) / 2, (1 + level) / 2)
        )
        middle = float(self.middle[index])
        return min(low, middle), max(high, middle)


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
    own = np.asarray(np.linalg.inv(residuals.information(free)))
    measured = np.diag(own @ residuals.data_information(free) @ own) / np.diag(own)
    if bootstraps:
        own = _larger(own, _bootstrap(residuals, free, seed, bootstraps))
    exchanged = _exchanged(residuals, free)
    components = [] if exchanged is None else [exchanged]
    compared: list[FormFit] = []
    if forms:
        found = dict(zip(parameters.free, np.exp(free).tolist(), strict=True))
        others = {}
        for name, other in forms.items():
            known = in_form(parameters.restarted_at(found), other)
            others[name] = _fitted(other, known, points, carried_over(other, residuals, free))
        compared = compare_forms(residuals, free, others)
        components += [
            (at, _OTHER_FORM * exp(min(-one.evidence / 2, _MOST_EVIDENCE)))
            for one, (_, at) in zip(compared, others.values(), strict=True)
        ]
    posterior = Posterior(
        free,
        own,
        measured,
        max(residuals.data_rows - residuals.parameters_used(free), _LEAST_FREEDOM),
        np.array([at for at, _ in components]).reshape(len(components), len(free)),
        np.array([odds for _, odds in components]),
    )
    return Fit(
        estimates=tuple(_estimate(residuals, posterior, one) for one in parameters.all),
        names=parameters.names,
        free=parameters.free,
        log_values=residuals.all_logs(free),
        covariance=posterior.covariance,
        repeatability=residuals.repeatability,
        cost=residuals.cost(free),
        strokes=tuple(point.number for point in points),
        left_out=left_out,
        terms=tuple(sorted(predictor.model.terms)),
        theory=predictor.model.theory,
        forms=tuple(compared),
    )


def _exchanged(residuals: Residuals, free: Array) -> tuple[Array, float] | None:
    """Return the fit with the finger's response and the sensor's pole exchanged, and its odds.

    Both are of first order, so at one speed the ripple alone does not tell which is which. None
    where the exchanged fit leads back to the fit itself.
    """
    names = residuals.parameters.free
    pair = "response_hz_per_mm_per_s", "sensor_pole_hz"
    if not set(pair) <= set(names):
        return None
    response, pole = (names.index(name) for name in pair)
    speed = log(float(np.mean([point.speed_mm_per_s for point in residuals.points])))
    start = free.copy()
    start[response], start[pole] = free[pole] - speed, free[response] + speed
    other = solve(residuals, start, most_steps=15)
    spread = np.sqrt(np.diag(np.linalg.inv(residuals.information(free))))
    if float(np.abs((other - free) / spread).max()) < _SAME_ANSWER:
        return None
    rise = max(residuals.cost(other) - residuals.cost(free), 0.0)
    return other, exp(-rise / 2)


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
        ftol=_CLOSE_ENOUGH,
        xtol=_CLOSE_ENOUGH,
        max_nfev=most_steps,
    )
    return whole(found.x)


def _fitted(
    predictor: StrokePredictor,
    parameters: Parameters,
    points: tuple[Point, ...],
    start: Array | None = None,
) -> tuple[Residuals, Array]:
    """Fit with the repeatability that the residuals themselves show.

    From `start`, where a fit in another form has ended, or else from the parameters' own.
    """
    residuals = Residuals(predictor, parameters, points, Repeatability())
    free = residuals.start if start is None else solve(residuals, start, 25)
    if start is None or not _is_good(residuals, residuals.cost(free)):
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
        if _is_good(residuals, best[1]):
            break
    return best[0]


def _is_good(residuals: Residuals, cost: float) -> bool:
    return cost < _GOOD_START * residuals.data_rows


def _bootstrap(residuals: Residuals, free: Array, seed: int, count: int) -> Array:
    """Covariance from resampled strokes, each with priors drawn anew.

    A replicate takes one Gauss-Newton step from the fit, by the fit's Jacobian.
    """
    rng = np.random.default_rng(seed)
    strokes = len(residuals.points)
    jacobian = residuals.data_jacobian(free)
    # The misfits of a few strokes are smaller than their errors: the fit has absorbed some.
    spare = max(residuals.data_rows - residuals.parameters_used(free), 1.0)
    misfit = residuals.data(free) * sqrt(residuals.data_rows / spare)
    weights = residuals.weights(free)
    prior, row_of = residuals.prior_matrix, residuals.stroke_of_row
    found = []
    for _ in range(count):
        times = np.bincount(rng.integers(0, strokes, strokes), minlength=strokes)[row_of]
        target = residuals.prior_target + rng.normal(size=len(residuals.prior_target))
        weighted = (weights * times)[:, None] * jacobian
        slope = weighted.T @ misfit + prior.T @ (prior @ free - target)
        step = np.linalg.solve(residuals.with_prior(weighted.T @ jacobian), slope)
        found.append(free - step)
    return np.asarray(np.atleast_2d(np.cov(np.array(found).T)))


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


def _estimate(residuals: Residuals, posterior: Posterior, one: Parameter) -> ParameterEstimate:
    parameters = residuals.parameters
    estimate = partial(ParameterEstimate, name=one.name)
    if one.is_fixed:
        return estimate(value=one.value, low=one.value, high=one.value, spread=0.0, verdict="fixed")
    index, free = parameters.free.index(one.name), posterior.middle
    middle, spread = float(free[index]), sqrt(float(posterior.covariance[index, index]))
    low, high = (exp(min(end, 700.0)) for end in posterior.interval(index, _LEVEL))
    before = parameters.prior_spread(one.name)
    is_measured = before is None or spread < _PRIOR_SHARE * before
    if is_measured and spread <= reported_within(one.name):
        return estimate(value=exp(middle), low=low, high=high, spread=spread, verdict="determined")
    if is_measured and spread > _CURVED and one.name not in PER_RIG:
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


class ChosenFit(NamedTuple):
    """A fit, and what it was made with."""

    fit: Fit
    predictor: StrokePredictor
    parameters: Parameters


def fit_in_best_theory(
    reduced: Reduced,
    predictor: StrokePredictor,
    parameters: Parameters,
    forms: dict[str, StrokePredictor],
) -> ChosenFit:
    """Fit, and fit again in the other theory if the strokes decide for it.

    `forms` are those of `calibration.forms.other_forms`. A theory is kept where tau_f is fixed or
    has a prior, which belongs to that theory. Errors as `fit_strokes`.
    """
    fit = fit_strokes(reduced, predictor, parameters, forms=forms)
    first = ChosenFit(fit, predictor, parameters)
    shear = parameters["frictional_shear_stress_pa"]
    known = parameters.prior_spread(shear.name) is not None or shear.is_fixed
    against = {one.form: one.evidence for one in fit.forms}
    for name, other in forms.items():
        if other.model.theory == predictor.model.theory or known or against[name] > -DECISIVE:
            continue
        changed = in_form(parameters, other)
        others = other_forms(other.model, tables=predictor)
        again = fit_strokes(reduced, other, changed, forms=others)
        if again.cost < fit.cost:
            return ChosenFit(again, other, changed)
    return first
