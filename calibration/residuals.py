"""What separates strokes from the model, in units of its error, for least squares."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from calibration.parameters import Array, Parameters
from calibration.predict import Prediction, StrokeConditions, StrokePredictor
from calibration.reduction import Point

_SOFT_AT = 2.0  # standard errors from which on a residual counts less than its square
_CLIPPED_AT = 3.0  # where the scatter is estimated


@dataclass(frozen=True)
class Repeatability:
    """How well strokes repeat beyond their own errors, relative: the finger dries, tires, turns.

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
    """Residuals of ln mu and of the ripple, and those of the priors, by the free parameters.

    Parameters
    ----------
    predictor : StrokePredictor
        The model.
    parameters : Parameters
        What is free, fixed and known.
    points : sequence of Point
        Strokes that are used.
    repeatability : Repeatability
        Repeatability.
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
        self._log_mu = np.log([point.mu for point in points])
        self._ripple = np.array([point.ripple for point in points])
        self.has_ripple = np.isfinite(self._ripple)
        self._log_mu_sd = np.hypot(
            [point.mu_sd / point.mu for point in points], repeatability.log_mu
        )
        sd = np.array([point.ripple_sd for point in points])
        self._ripple_sd = np.hypot(sd, repeatability.ripple * self._ripple)[self.has_ripple]
        self._at = [parameters.names.index(name) for name in parameters.free]
        self.prior_matrix, self.prior_target = parameters.prior_rows()
        self._last: tuple[bytes, Prediction] | None = None

    @property
    def start(self) -> Array:
        """Logarithms of the free parameters at the start."""
        return self.parameters.log_values[self._at]

    @property
    def data_rows(self) -> int:
        """Rows that are data; the priors follow."""
        return len(self._log_mu) + int(self.has_ripple.sum())

    @property
    def stroke_of_row(self) -> npt.NDArray[np.int64]:
        """Index of the stroke of each data row."""
        every = np.arange(len(self._log_mu))
        return np.concatenate([every, every[self.has_ripple]])

    def all_logs(self, free: Array) -> Array:
        """Logarithms of all parameters, the fixed ones included."""
        values = self.parameters.log_values.copy()
        values[self._at] = free
        return values

    def predict(self, free: Array) -> Prediction:
        """Predict the strokes, with Jacobian; the last answer is kept."""
        key = free.tobytes()
        if self._last is None or self._last[0] != key:
            found = self.predictor(self._strokes, self.parameters.names, self.all_logs(free))
            self._last = key, found
        return self._last[1]

    def data(self, free: Array) -> Array:
        """Residuals of the data."""
        return self._misfit(self.predict(free))

    def data_alone(self, free: Array) -> Array:
        """Return the same without the price of a Jacobian."""
        values = self.all_logs(free)
        return self._misfit(self.predictor(self._strokes, self.parameters.names, values, False))

    def _misfit(self, found: Prediction) -> Array:
        of_mu = (found.log_mu - self._log_mu) / self._log_mu_sd
        ripple = (found.ripple - self._ripple)[self.has_ripple] / self._ripple_sd
        return np.concatenate([of_mu, ripple])

    def data_jacobian(self, free: Array) -> Array:
        """Their derivatives, shape (data rows, free)."""
        found = self.predict(free)
        of_mu = found.log_mu_jacobian[:, self._at] / self._log_mu_sd[:, None]
        ripple = found.ripple_jacobian[self.has_ripple][:, self._at] / self._ripple_sd[:, None]
        return np.concatenate([of_mu, ripple])

    def __call__(self, free: Array) -> Array:
        """All residuals, priors last."""
        return np.concatenate([self.data(free), self.prior_matrix @ free - self.prior_target])

    def jacobian(self, free: Array) -> Array:
        """All derivatives."""
        return np.concatenate([self.data_jacobian(free), self.prior_matrix])

    def loss(self, square: Array) -> Array:
        """Soft L1 for the data, plain squares for the priors, as scipy wants it."""
        count = self.data_rows
        root = np.sqrt(1 + square)
        rho = np.stack([2 * (root - 1), 1 / root, -0.5 / root**3])
        rho[:, count:] = np.stack(
            [square[count:], np.ones(len(square) - count), np.zeros(len(square) - count)]
        )
        return rho

    @property
    def soft_at(self) -> float:
        """Residual from which on data count less."""
        return _SOFT_AT

    def weights(self, free: Array) -> Array:
        """Weights of the data rows that the loss amounts to at its minimum."""
        return np.asarray(1 / np.sqrt(1 + (self.data(free) / _SOFT_AT) ** 2))

    def information(self, free: Array) -> Array:
        """Inverse covariance of the free parameters, priors included."""
        jacobian = self.data_jacobian(free)
        data = jacobian.T @ (self.weights(free)[:, None] * jacobian)
        return np.asarray(data + self.prior_matrix.T @ self.prior_matrix)

    def cost(self, free: Array) -> float:
        """Minus twice the log-likelihood that the loss stands for, up to a constant."""
        every = self(free)
        return float(_SOFT_AT**2 * self.loss((every / _SOFT_AT) ** 2)[0].sum())

    def rescattered(self, free: Array) -> Repeatability:
        """Scatter at which the residuals are as large as they should be."""
        data = self.data(free)
        jacobian = self.data_jacobian(free)
        hat = jacobian @ np.linalg.solve(self.information(free), jacobian.T)
        leverage = np.diag(hat)
        count = len(self._log_mu)
        own = np.array([point.mu_sd / point.mu for point in self.points])
        log_mu = _scatter(data[:count] * self._log_mu_sd, own, float(leverage[:count].sum()))
        relative = self._ripple[self.has_ripple]
        sd = np.array([point.ripple_sd for point in self.points])[self.has_ripple] / relative
        misfit = data[count:] * self._ripple_sd / relative
        ripple = _scatter(misfit, sd, float(leverage[count:].sum()))
        return Repeatability(log_mu, ripple)


def _scatter(misfit: Array, own_sd: Array, used_up: float) -> float:
    """Extra standard deviation for which the clipped squares add up to their degrees of freedom."""
    good = np.isfinite(misfit) & np.isfinite(own_sd)
    misfit, own_sd = misfit[good], own_sd[good]
    wanted = len(misfit) - used_up
    if wanted < 1:
        return Repeatability().log_mu

    def excess(extra: float) -> float:
        reduced = misfit**2 / (own_sd**2 + extra**2)
        return float(np.minimum(reduced, _CLIPPED_AT**2).sum()) - wanted

    if excess(0.0) <= 0:
        return 0.0
    low, high = 0.0, 1.0
    for _ in range(40):
        middle = (low + high) / 2
        low, high = (middle, high) if excess(middle) > 0 else (low, middle)
    return high
