"""Differences between strokes and the model, in units of their error, for least squares."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
import numpy.typing as npt
import torch
from scipy.optimize import brentq

from calibration.parameters import PER_RIG, Array, Parameters
from calibration.predict import Prediction, StrokeConditions, StrokePredictor, sensor_gain
from calibration.reduction import Point

SOFT_AT = 2.0
"""Residual, in standard errors, above which a stroke counts less than its square."""
# Sensors to start from.
_POLES_HZ = (350.0, 700.0, 1400.0, 3000.0, 10_000.0)
_RESONANCES_HZ = (450.0, 700.0, 1000.0, 1400.0, 1900.0, 2600.0, 6000.0)
_QUALITIES = (3.0, 10.0)
_CLIPPED_AT = 3.0  # where the repeatability is estimated


@dataclass(frozen=True)
class Repeatability:
    """Spread of repeated strokes beyond their own errors, relative: the finger dries and turns.

    Parameters
    ----------
    log_mu : float
        Standard deviation of ln mu.
    ripple : float
        Standard deviation of the ripple, over the ripple.
    """

    log_mu: float = 0.01
    ripple: float = 0.01


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
        self._own_sd = np.concatenate([mu_sd / mu, ripple_sd])
        # A relative error of mu is an absolute one of ln mu.
        self._unit = np.concatenate([np.ones(len(mu)), ripple])
        extra = np.repeat([repeatability.log_mu, repeatability.ripple], [len(mu), len(ripple)])
        self._sd = np.hypot(self._own_sd, extra * self._unit)
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

    def predict(self, free: Array, jacobian: bool = True) -> Prediction:
        """Predict the strokes; the last answer with a Jacobian is kept."""
        key = free.tobytes()
        if self._last is not None and self._last[0] == key:
            return self._last[1]
        names, values = self.parameters.names, self.all_logs(free)
        found = self.predictor(self._strokes, names, values, jacobian)
        if jacobian:
            self._last = key, found
        return found

    def data(self, free: Array, jacobian: bool = True) -> Array:
        """Residuals of the data; without the Jacobian they are three times as fast."""
        found = self.predict(free, jacobian)
        return self._rows(found.log_mu, found.ripple)

    def _rows(self, log_mu: Array, ripple: Array) -> Array:
        predicted = np.concatenate([log_mu, ripple[self._has_ripple]])
        return np.asarray((predicted - self._measured) / self._sd)

    def data_jacobian(self, free: Array) -> Array:
        """Derivatives of the data's residuals, shape (data rows, free)."""
        found = self.predict(free)
        rows = np.concatenate([found.log_mu_jacobian, found.ripple_jacobian[self._has_ripple]])
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
        """Return a start whose force sensor, of many, fits the ripples best; the rest is kept.

        Between two resonances that fit no slope leads from one to the other.
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
        """Weights of the data rows that the loss amounts to at its minimum."""
        return np.asarray(1 / np.sqrt(1 + (self.data(free) / SOFT_AT) ** 2))

    def data_information(self, free: Array) -> Array:
        """Inverse covariance of the free parameters by the data alone."""
        jacobian = self.data_jacobian(free)
        return np.asarray(jacobian.T @ (self.weights(free)[:, None] * jacobian))

    def information(self, free: Array) -> Array:
        """Inverse covariance of the free parameters, priors included."""
        return self.with_prior(self.data_information(free))

    def with_prior(self, information: Array) -> Array:
        """Add the priors; what nothing determines gets a spread of 1e4 instead of none."""
        prior = self.prior_matrix.T @ self.prior_matrix
        return np.asarray(information + prior + 1e-8 * np.eye(len(prior)))

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
        own_sd = self._own_sd / self._unit
        count = len(self.points)
        return Repeatability(
            *(
                _extra_spread(misfit[rows], own_sd[rows], float(leverage[rows].sum()))
                for rows in (slice(count), slice(count, None))
            )
        )


def _extra_spread(misfit: Array, own_sd: Array, used_up: float) -> float:
    """Extra standard deviation for which the clipped squares add up to their degrees of freedom."""
    good = np.isfinite(misfit) & np.isfinite(own_sd)
    misfit, own_sd = misfit[good], own_sd[good]
    freedom = len(misfit) - used_up
    if freedom < 1:
        return Repeatability().log_mu

    def excess(extra: float) -> float:
        squares = misfit**2 / (own_sd**2 + extra**2)
        return float(np.minimum(squares, _CLIPPED_AT**2).sum()) - freedom

    if excess(0.0) <= 0:
        return 0.0
    return 1.0 if excess(1.0) > 0 else float(brentq(excess, 0.0, 1.0))
