"""Fit a screen and a finger to reduced strokes, and say which numbers the strokes determine."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from math import exp, inf, log, sqrt
from pathlib import Path
from typing import Literal

import numpy as np
from scipy.optimize import least_squares
from scipy.stats import t as student

from calibration.parameters import (
    EXPERIMENTS,
    PER_FINGER,
    Array,
    FingerPrior,
    Parameters,
)
from calibration.predict import StrokePredictor
from calibration.reduction import Point, Reduced
from calibration.residuals import Repeatability, Residuals
from haptix.errors import FileFormatError, InputError
from haptix.files import json_text, read_json, write_whole

Verdict = Literal["determined", "prior", "undetermined", "fixed"]

REPORTED_WITHIN = 0.1
"""Largest standard deviation of a logarithm that is still reported as a number."""

_PRIOR_SHARE = 0.8  # of the prior's spread: what is left of it has not been measured
_BOOTSTRAPS = 200
_SCATTER_ROUNDS = 3
_GOOD_START = 4.0  # cost of a row: far below what a fit past pull-in has
_LEVEL = 0.90
_PROFILE_COST = 2.706  # chi-squared of one parameter at 90 %
_PROFILE_REACH = log(1e3)
_FEWEST_STROKES = 6


@dataclass(frozen=True)
class ParameterEstimate:
    """What a fit says of one parameter.

    Parameters
    ----------
    name : str
        Of `calibration.parameters.NAMES`.
    value : float or None
        In the unit that the name ends with; None where the strokes do not determine it.
    low, high : float
        90 % interval; 0 or infinite where the strokes set no bound.
    spread : float
        Standard deviation of the logarithm.
    verdict : {"determined", "prior", "undetermined", "fixed"}
        "prior" where the strokes have told nothing beyond what was known before.
    advice : str
        Which experiment would determine it; empty where none is needed.
    """

    name: str
    value: float | None
    low: float
    high: float
    spread: float
    verdict: Verdict
    advice: str = ""


@dataclass(frozen=True)
class Fit:
    """A fitted screen and finger.

    Parameters
    ----------
    estimates : tuple of ParameterEstimate
        One for each parameter.
    names : tuple of str
        All parameters; `free` are those that were fitted.
    free : tuple of str
        Names of those.
    log_values : array, shape (names,)
        Best values, the undetermined ones among them: together they predict, alone they mean
        nothing.
    covariance : array, shape (free, free)
        Of the logarithms.
    repeatability : Repeatability
        How well the strokes repeat.
    cost : float
        Minus twice the log-likelihood, priors included.
    strokes : tuple of int
        Numbers of the strokes that were used.
    left_out : mapping of int to str
        Strokes that were not, with reasons.
    terms : tuple of str
        Terms of the model that were on.
    """

    estimates: tuple[ParameterEstimate, ...]
    names: tuple[str, ...]
    free: tuple[str, ...]
    log_values: Array
    covariance: Array
    repeatability: Repeatability
    cost: float
    strokes: tuple[int, ...]
    left_out: Mapping[int, str]
    terms: tuple[str, ...]

    def __getitem__(self, name: str) -> ParameterEstimate:
        for one in self.estimates:
            if one.name == name:
                return one
        raise InputError(f"parameter {name!r}: expected one of {', '.join(self.names)}")

    def value(self, name: str) -> float:
        """Value of a parameter.

        Raises
        ------
        InputError
            If the strokes do not determine it; the message says which experiment would.
        """
        one = self[name]
        if one.value is None:
            raise InputError(refusal(one))
        return one.value

    def best(self, name: str) -> float:
        """Value with which the model predicts, determined or not."""
        return exp(float(self.log_values[self.names.index(name)]))

    def finger_prior(self) -> FingerPrior:
        """What this fit knows of the finger, for the next screen that it touches."""
        names = tuple(name for name in self.free if name in PER_FINGER)
        at = [self.free.index(name) for name in names]
        values = [self.log_values[self.names.index(name)] for name in names]
        return FingerPrior(names, np.array(values), self.covariance[np.ix_(at, at)])

    def save(self, path: str | Path) -> None:
        """Write JSON that `load` reads."""
        fields = asdict(self)
        fields["log_values"] = self.log_values.tolist()
        fields["covariance"] = self.covariance.tolist()
        fields["scatter"] = fields.pop("repeatability")
        fields["left_out"] = {str(number): why for number, why in self.left_out.items()}
        for one in fields["estimates"]:
            one["high"] = None if one["high"] == inf else one["high"]
        document = {"format": "haptix fit", "schema_version": 1, **fields}
        write_whole(path, json_text(document))

    @classmethod
    def load(cls, path: str | Path) -> Fit:
        """Read what `save` wrote.

        Raises
        ------
        FileFormatError
            If the file is missing, foreign or damaged.
        """
        fields = read_json(path)
        if fields.get("format") != "haptix fit":
            raise FileFormatError(f"{path}: expected a fit, made by `haptix calibrate fit`")
        if fields.get("schema_version") != 1:
            raise FileFormatError(
                f"{path}: expected schema_version 1, got {fields.get('schema_version')!r}"
            )
        try:
            estimates = [
                ParameterEstimate(**(one | {"high": inf if one["high"] is None else one["high"]}))
                for one in fields["estimates"]
            ]
            return cls(
                estimates=tuple(estimates),
                names=tuple(fields["names"]),
                free=tuple(fields["free"]),
                log_values=np.array(fields["log_values"], dtype=float),
                covariance=np.array(fields["covariance"], dtype=float),
                repeatability=Repeatability(**fields["scatter"]),
                cost=float(fields["cost"]),
                strokes=tuple(fields["strokes"]),
                left_out={int(number): why for number, why in fields["left_out"].items()},
                terms=tuple(fields["terms"]),
            )
        except (KeyError, TypeError, ValueError) as error:
            raise FileFormatError(f"{path}: expected a whole fit, got {error!r}") from None


def refusal(one: ParameterEstimate) -> str:
    """Return one sentence: why there is no number, and what would give one."""
    if one.low > 0 and one.high < inf:
        bounds = f"anything from {one.low:.3g} to {one.high:.3g} fits"
    elif one.low > 0:
        bounds = f"anything above {one.low:.3g} fits"
    elif one.high < inf:
        bounds = f"anything below {one.high:.3g} fits"
    else:
        bounds = "any value fits"
    what = "only its prior is known" if one.verdict == "prior" else bounds
    return f"{one.name} is not determined by these strokes: {what}; {one.advice}"


def fit_strokes(
    reduced: Reduced,
    predictor: StrokePredictor,
    parameters: Parameters,
    seed: int = 0,
    bootstraps: int = _BOOTSTRAPS,
) -> Fit:
    """Fit the strokes that are neither outliers nor held out.

    Parameters
    ----------
    reduced : Reduced
        The strokes.
    predictor : StrokePredictor
        The model.
    parameters : Parameters
        Start, priors and fixed values.
    seed : int
        Of the bootstrap.
    bootstraps : int
        Resamplings of the strokes; 0 leaves the errors to the curvature of the fit alone.

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
    residuals, free = _settled(predictor, parameters, points)
    light = residuals.predict(free).is_light
    if not light.all() and light.sum() >= _FEWEST_STROKES:
        for point in np.array(points, dtype=object)[~light]:
            left_out[point.number] = (
                f"past the light contact: at {point.voltage_v:.4g} V and "
                f"{point.normal_force_n:.3g} N it snaps in; use a lower voltage"
            )
        points = tuple(p for p, keep in zip(points, light, strict=True) if keep)
        residuals, free = _settled(
            predictor, parameters.started_at(**_named(residuals, free)), points
        )
    covariance = np.asarray(np.linalg.inv(_regular(residuals.information(free))))
    if bootstraps:
        covariance = _widened(covariance, _bootstrap(residuals, free, seed, bootstraps))
    return Fit(
        estimates=_estimates(residuals, free, covariance),
        names=parameters.names,
        free=parameters.free,
        log_values=residuals.all_logs(free),
        covariance=covariance,
        repeatability=residuals.repeatability,
        cost=residuals.cost(free),
        strokes=tuple(point.number for point in points),
        left_out=left_out,
        terms=tuple(sorted(predictor.model.terms)),
    )


def solve(residuals: Residuals, start: Array, most_steps: int = 50) -> Array:
    """Return the free parameters that fit best."""
    low, high = residuals.parameters.bounds()
    found = least_squares(
        residuals,
        np.clip(start, low + 1e-6, high - 1e-6),
        jac=residuals.jacobian,
        method="trf",
        loss=residuals.loss,
        f_scale=residuals.soft_at,
        bounds=(low, high),
        x_scale=0.1,
        xtol=1e-8,
        ftol=1e-8,
        gtol=1e-8,
        max_nfev=most_steps,
    )
    return np.asarray(found.x)


def _named(residuals: Residuals, free: Array) -> dict[str, float]:
    named = zip(residuals.parameters.free, free, strict=True)
    # Those with priors start where the priors are.
    return {n: exp(float(v)) for n, v in named if residuals.parameters[n].prior is None}


def _settled(
    predictor: StrokePredictor, parameters: Parameters, points: tuple[Point, ...]
) -> tuple[Residuals, Array]:
    """Fit with the scatter that the residuals themselves show."""
    residuals = Residuals(predictor, parameters, points, Repeatability())
    free = _best_start(residuals)
    for _ in range(_SCATTER_ROUNDS):
        residuals = Residuals(predictor, parameters, points, residuals.rescattered(free))
        free = solve(residuals, free)
    return residuals, free


def _best_start(residuals: Residuals) -> Array:
    """Fit from several insulators: a start past pull-in has no slope that leads out of it."""
    found = []
    free = residuals.parameters.free
    for factor in (1.0, 0.4, 2.5) if "h0_m" in free else (1.0,):
        start = residuals.start.copy()
        if "h0_m" in free:
            start[free.index("h0_m")] += log(factor)
        solution = solve(residuals, start, 25)
        found.append((residuals.cost(solution), solution))
        if found[-1][0] < _GOOD_START * residuals.data_rows:
            break
    return min(found, key=lambda pair: pair[0])[1]


def _regular(information: Array) -> Array:
    """Let what nothing determines have a spread of e^10 instead of none."""
    return information + 1e-8 * np.eye(len(information))


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
        information = _regular(weighted.T @ jacobian + prior.T @ prior)
        at, misfit = free, own
        for last in (False, True):
            slope = weighted.T @ misfit + prior.T @ (prior @ at - target)
            step = np.linalg.solve(information, slope)
            at = at - step * min(1.0, 0.7 / max(float(np.abs(step).max()), 1e-9))
            misfit = misfit if last else residuals.data_alone(at)
        found.append(at)
    # Means of a few strokes scatter less than the strokes that were not resampled would.
    effective = float(
        np.trace(
            np.linalg.solve(
                _regular(residuals.information(free)), jacobian.T @ (weights[:, None] * jacobian)
            )
        )
    )
    small = residuals.data_rows / max(residuals.data_rows - effective, 1.0)
    return np.asarray(np.atleast_2d(np.cov(np.array(found).T)) * small)


def _widened(covariance: Array, other: Array) -> Array:
    """Covariance whose spreads are the larger of both, with the first one's correlations."""
    ratio = np.sqrt(np.maximum(np.diag(other) / np.diag(covariance), 1.0))
    return np.asarray(covariance * np.outer(ratio, ratio))


def _estimates(
    residuals: Residuals, free: Array, covariance: Array
) -> tuple[ParameterEstimate, ...]:
    parameters = residuals.parameters
    # Errors of a scatter that was itself estimated: Student's t.
    spare = max(len(residuals.points) - len(parameters.free), 3)
    quantile = float(student.ppf(0.5 + _LEVEL / 2, spare))
    joint = parameters.finger_prior
    found = []
    for one in parameters.all:
        if one.is_fixed:
            found.append(ParameterEstimate(one.name, one.value, one.value, one.value, 0.0, "fixed"))
            continue
        index = parameters.free.index(one.name)
        middle, spread = float(free[index]), sqrt(float(covariance[index, index]))
        low, high = exp(middle - quantile * spread), exp(min(middle + quantile * spread, 700.0))
        before = one.prior
        if joint is not None and one.name in joint.names:
            at = joint.names.index(one.name)
            before = sqrt(float(joint.covariance[at, at]))
        is_news = before is None or spread < _PRIOR_SHARE * before
        if is_news and spread <= REPORTED_WITHIN:
            found.append(ParameterEstimate(one.name, exp(middle), low, high, spread, "determined"))
            continue
        advice = EXPERIMENTS[one.name]
        if is_news:
            low, high = profile(residuals, free, one.name, spread)
            found.append(
                ParameterEstimate(one.name, None, low, high, spread, "undetermined", advice)
            )
        else:
            found.append(ParameterEstimate(one.name, None, low, high, spread, "prior", advice))
    return tuple(found)


def profile(
    residuals: Residuals, free: Array, name: str, spread: float = 0.1
) -> tuple[float, float]:
    """90 % interval by profile likelihood: all others fitted anew at each value tried.

    `spread` is the standard deviation of the logarithm that the curvature suggests: the first step.

    Returns
    -------
    (low, high)
        0 or infinite where the cost stays low within a factor of 1000.
    """
    index = residuals.parameters.free.index(name)
    best = residuals.cost(free)
    covariance = np.asarray(np.linalg.inv(_regular(residuals.information(free))))
    # The others go along as they are correlated: a start near each conditional fit.
    along = covariance[:, index] / covariance[index, index]
    others = [i for i in range(len(free)) if i != index]
    bounds = []
    for side in (-1.0, 1.0):
        at, last, rise_last = free.copy(), 0.0, 0.0
        step = min(1.7 * spread, 1.0)
        bound = side * inf
        while True:
            distance = last + step
            at = at + along * (free[index] + side * distance - at[index])
            at[others] = _conditional(residuals, at, index)
            rise = residuals.cost(at) - best
            if rise >= _PROFILE_COST:
                # The root of the rise is nearly straight.
                low, high = sqrt(max(rise_last, 0.0)), sqrt(rise)
                share = (sqrt(_PROFILE_COST) - low) / max(high - low, 1e-12)
                bound = float(free[index]) + side * (last + share * step)
                break
            if distance >= _PROFILE_REACH:
                break
            last, rise_last, step = distance, rise, min(1.6 * step, 1.5)
        bounds.append(bound)
    return (exp(bounds[0]) if bounds[0] > -inf else 0.0), (
        exp(bounds[1]) if bounds[1] < inf else inf
    )


def _conditional(residuals: Residuals, at: Array, index: int) -> Array:
    """Fit all but one parameter."""
    others = [i for i in range(len(at)) if i != index]
    if not others:
        return np.empty(0)

    def whole(part: Array) -> Array:
        full = at.copy()
        full[others] = part
        return full

    low, high = residuals.parameters.bounds()
    found = least_squares(
        lambda part: residuals(whole(part)),
        np.clip(at[others], low[others] + 1e-6, high[others] - 1e-6),
        jac=lambda part: residuals.jacobian(whole(part))[:, others],
        bounds=(low[others], high[others]),
        loss=residuals.loss,
        f_scale=residuals.soft_at,
        x_scale=0.1,
        max_nfev=8,
    )
    return np.asarray(found.x)
