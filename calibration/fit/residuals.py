"""Least squares of strokes: residuals in units of their error, and the best fit."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from math import exp, inf, log, sqrt

import numpy as np
import numpy.typing as npt
import torch
from scipy.optimize import brentq, least_squares

from calibration.fit.result import Input, Repeatability
from calibration.measure.reduction import Point
from calibration.plan.parameters import PER_RIG, Array, Parameters
from calibration.plan.predict import Prediction, StrokeConditions, StrokePredictor, sensor_gain

NORMAL_GAIN, TANGENTIAL_GAIN = "gain of the normal force", "gain of the tangential force"
VOLTAGE_GAIN = "gain of the volts"
_STEP = 0.01  # relative, of a numerical derivative
SOFT_AT = 2.0
"""Residual, in standard errors, above which a stroke counts less than its square."""
# Sensors to start from.
_POLES_HZ = (350.0, 700.0, 1400.0, 3000.0, 10_000.0)
_RESONANCES_HZ = (450.0, 700.0, 1000.0, 1400.0, 1900.0, 2600.0, 6000.0)
_QUALITIES = (3.0, 10.0)
_CLIPPED_AT = 3.0  # where the repeatability is estimated
_REPEATABILITY_ROUNDS = 3
_GOOD_START = 4.0  # cost of a row: far below that of a fit past pull-in
_PROFILE_COST = 2.706  # chi-squared of one parameter at 90 %
_PROFILE_LIMIT = log(1e3)
_CLOSE_ENOUGH = 1e-5  # relative, of cost and logarithms: below a hundredth of any spread


class Residuals:
    """Residuals of ln mu, of the ripple and of the priors, by the free parameters.

    Rows are those of ln mu, one for each of the `points`, then of the ripple where there is one,
    then of the priors. The repeatability is added to the strokes' own errors.
    """

    def __init__(
        self,
        predictor: StrokePredictor,
        parameters: Parameters,
        points: tuple[Point, ...],
        repeatability: Repeatability,
    ) -> None:
        self.predictor = predictor
        self.parameters = parameters
        self.points = points
        self.repeatability = repeatability
        self._strokes = StrokeConditions.of(points)
        mu, mu_sd, ripple, ripple_sd = np.array(
            [(point.mu, point.mu_sd, point.ripple, point.ripple_sd) for point in points]
        ).T
        self._has_ripple = np.isfinite(ripple)
        ripple, ripple_sd = ripple[self._has_ripple], ripple_sd[self._has_ripple]
        self._measured = np.concatenate([np.log(mu), ripple])
        self._stroke_sd = np.concatenate([mu_sd / mu, ripple_sd])
        # A relative error of mu is an absolute one of ln mu.
        self._unit = np.concatenate([np.ones(len(mu)), ripple])
        extra = np.repeat([repeatability.log_mu, repeatability.ripple], [len(mu), len(ripple)])
        self._sd = np.hypot(self._stroke_sd, extra * self._unit)
        self._at = [parameters.names.index(name) for name in parameters.free]
        self.prior_matrix, self.prior_target = parameters.prior_rows()
        self._last: tuple[bytes, Prediction] | None = None

    @property
    def start(self) -> Array:
        """Logarithms of the free parameters at the start."""
        return self.parameters.log_values[self._at]

    @property
    def data_rows(self) -> int:
        """Number of rows that are data."""
        return len(self._measured)

    @property
    def stroke_of_row(self) -> npt.NDArray[np.int64]:
        """Index of the stroke of each data row."""
        return np.concatenate([np.arange(len(self.points)), np.flatnonzero(self._has_ripple)])

    def all_logs(self, free: Array) -> Array:
        """Logarithms of all parameters, the fixed ones included."""
        values = self.parameters.log_values.copy()
        values[self._at] = free
        return values

    def predict(self, free: Array) -> Prediction:
        """Predict the strokes, with the Jacobian; the last answer is kept."""
        key = free.tobytes()
        if self._last is None or self._last[0] != key:
            names, values = self.parameters.names, self.all_logs(free)
            self._last = key, self.predictor(self._strokes, names, values)
        return self._last[1]

    def data(self, free: Array) -> Array:
        """Residuals of the data."""
        prediction = self.predict(free)
        return self._rows(prediction.log_mu, prediction.ripple)

    def _rows(self, log_mu: Array, ripple: Array) -> Array:
        predicted = np.concatenate([log_mu, ripple[self._has_ripple]])
        return np.asarray((predicted - self._measured) / self._sd)

    def data_jacobian(self, free: Array) -> Array:
        """Derivatives of the data's residuals, shape (data rows, free)."""
        prediction = self.predict(free)
        of_ripple = prediction.ripple_jacobian[self._has_ripple]
        rows = np.concatenate([prediction.log_mu_jacobian, of_ripple])
        return np.asarray(rows[:, self._at] / self._sd[:, None])

    def __call__(self, free: Array) -> Array:
        """Return the residuals of data and priors."""
        return np.concatenate([self.data(free), self.prior_matrix @ free - self.prior_target])

    def jacobian(self, free: Array) -> Array:
        """Return the derivatives of the residuals of data and priors."""
        return np.concatenate([self.data_jacobian(free), self.prior_matrix])

    def loss(self, square: Array) -> Array:
        """Soft L1 for the data and squares for the priors, as `scipy.optimize.least_squares`."""
        count = self.data_rows
        root = np.sqrt(1 + square)
        rho = np.stack([2 * (root - 1), 1 / root, -0.5 / root**3])
        rho[0, count:], rho[1, count:], rho[2, count:] = square[count:], 1.0, 0.0
        return rho

    def with_best_sensor(self, free: Array) -> Array:
        """Return the start with the force sensor, of many tried, that fits the ripples best.

        Several resonances may fit, and a least-squares fit does not get from one to another.
        """
        at = [self.parameters.free.index(name) for name in PER_RIG if name in self.parameters.free]
        if len(at) < len(PER_RIG) or not self._has_ripple.any():
            return free
        hertz = torch.as_tensor(2 * self._strokes.frequency_hz)
        clean = self.predict(free).ripple / self._sensor(free[at], hertz)
        start = free, self.cost(free)
        for sensor in product(_POLES_HZ, _RESONANCES_HZ, _QUALITIES):
            tried = free.copy()
            tried[at] = np.log(sensor)
            rows = clean * self._sensor(tried[at], hertz)
            data = self._rows(self.predict(free).log_mu, rows)
            both = np.concatenate([data, self.prior_matrix @ tried - self.prior_target])
            cost = float(SOFT_AT**2 * self.loss((both / SOFT_AT) ** 2)[0].sum())
            start = min(start, (tried, cost), key=lambda pair: pair[1])
        return start[0]

    @staticmethod
    def _sensor(logs: Array, hertz: torch.Tensor) -> Array:
        values = dict(zip(PER_RIG, torch.as_tensor(np.exp(logs)), strict=True))
        return np.asarray(sensor_gain(values, hertz).numpy())

    def weights(self, free: Array) -> Array:
        """Weights that the loss gives the data rows at its minimum."""
        return np.asarray(1 / np.sqrt(1 + (self.data(free) / SOFT_AT) ** 2))

    def data_information(self, free: Array) -> Array:
        """Inverse covariance of the free parameters by the data alone."""
        jacobian = self.data_jacobian(free)
        return np.asarray(jacobian.T @ (self.weights(free)[:, None] * jacobian))

    def information(self, free: Array) -> Array:
        """Inverse covariance of the free parameters, priors included."""
        return self.with_prior(self.data_information(free))

    def with_prior(self, information: Array) -> Array:
        """Add the priors; undetermined directions get a spread of 1e4."""
        prior = self.prior_matrix.T @ self.prior_matrix
        return np.asarray(information + prior + 1e-8 * np.eye(len(prior)))

    def inputs(self, free: Array, covariance: Array) -> tuple[Input, ...]:
        """Sources of uncertainty besides the strokes: the priors, and gains of the rig.

        A gain is that of the reading over the true value; 1 % of it moves the fit by 0.01 times the
        response.
        """
        rows, targets = self.prior_matrix, len(self.prior_matrix)
        prior, known = self.parameters.finger_prior, self.parameters
        alone = targets - (0 if prior is None else sum(n in known.free for n in prior.names))
        inputs = []
        for number, row in enumerate(rows):
            source = "an earlier fit of the finger"
            if number < alone:
                source = f"what was known of {known.free[int(np.abs(row).argmax())]}"
            spread = 1 / float(np.linalg.norm(row))
            inputs.append(Input(source, spread, covariance @ row / spread))
        by_data = covariance @ (self.weights(free)[:, None] * self.data_jacobian(free)).T
        moved = (self._moved(free, name) for name in ("normal_force_n", "voltage_v"))
        of_mu = np.repeat([1.0, 0.0], [len(self.points), self.data_rows - len(self.points)])
        by_force, by_volts = moved
        shifts = {
            NORMAL_GAIN: -(of_mu / self._sd + by_force),
            TANGENTIAL_GAIN: of_mu / self._sd,
            VOLTAGE_GAIN: -by_volts,
        }
        return (*inputs, *(Input(name, 0.0, by_data @ shift) for name, shift in shifts.items()))

    def _moved(self, free: Array, name: str) -> Array:
        """Change of the data's residuals for each unit of the logarithm of a stroke's condition."""
        more = replace(self._strokes, **{name: (1 + _STEP) * getattr(self._strokes, name)})
        names, values = self.parameters.names, self.all_logs(free)
        moved = self.predictor(more, names, values, jacobian=False)
        change = self._rows(moved.log_mu, moved.ripple) - self.data(free)
        return np.asarray(change / np.log1p(_STEP))

    def parameters_used(self, free: Array) -> float:
        """Effective number of parameters that the data determine beyond the priors."""
        return float(np.trace(np.linalg.solve(self.information(free), self.data_information(free))))

    def cost(self, free: Array) -> float:
        """Minus twice the log-likelihood that the loss stands for, up to a constant."""
        return float(SOFT_AT**2 * self.loss((self(free) / SOFT_AT) ** 2)[0].sum())

    def estimated_repeatability(self, free: Array) -> Repeatability:
        """Repeatability for which the residuals are as large as their errors."""
        jacobian = self.data_jacobian(free)
        # Diagonal of the hat matrix: the share of each row's misfit that the fit has absorbed.
        leverage = np.diag(jacobian @ np.linalg.solve(self.information(free), jacobian.T))
        misfit = self.data(free) * self._sd / self._unit
        stroke_sd = self._stroke_sd / self._unit
        count = len(self.points)
        return Repeatability(
            *(
                _extra_spread(misfit[rows], stroke_sd[rows], float(leverage[rows].sum()))
                for rows in (slice(count), slice(count, None))
            )
        )


def solve(
    residuals: Residuals, start: Array, most_steps: int = 50, fixed: int | None = None
) -> Array:
    """Return the free parameters that fit best; number `fixed` stays at its start."""
    fitted = np.ones(len(start), dtype=bool)
    if fixed is not None:
        fitted[fixed] = False
    if not fitted.any():
        return start
    low, high = (bound[fitted] for bound in residuals.parameters.bounds())

    def whole(part: Array) -> Array:
        values = start.copy()
        values[fitted] = part
        return values

    solution = least_squares(
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
    return whole(solution.x)


def fit_residuals(
    predictor: StrokePredictor,
    parameters: Parameters,
    points: tuple[Point, ...],
    start: Array | None = None,
) -> tuple[Residuals, Array]:
    """Fit with the repeatability that the residuals themselves show.

    It begins at `start`, where a fit in another form has ended, or else at the parameters' start.
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
    """Fit from several insulators, since a start past pull-in does not lead to light contact."""
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


def profile(
    residuals: Residuals, free: Array, name: str, spread: float = 0.1
) -> tuple[float, float]:
    """90 % interval by profile likelihood: the others are fitted again at each value tried.

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
            at = solve(residuals, at, most_steps=8, fixed=index)
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


def _extra_spread(misfit: Array, stroke_sd: Array, used_up: float) -> float:
    """Extra standard deviation for which the clipped squares add up to their degrees of freedom."""
    good = np.isfinite(misfit) & np.isfinite(stroke_sd)
    misfit, stroke_sd = misfit[good], stroke_sd[good]
    freedom = len(misfit) - used_up
    if freedom < 1:
        return Repeatability().log_mu

    def excess(extra: float) -> float:
        squares = misfit**2 / (stroke_sd**2 + extra**2)
        return float(np.minimum(squares, _CLIPPED_AT**2).sum()) - freedom

    if excess(0.0) <= 0:
        return 0.0
    return 1.0 if excess(1.0) > 0 else float(brentq(excess, 0.0, 1.0))
