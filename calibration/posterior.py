"""What strokes leave possible: a mixture of normal distributions, one for each form of the model.

The fit in its own form is one component. Each other form, and the fit with the finger's response
and the sensor's pole exchanged, is another, weighed by its likelihood. A normal distribution as
wide as their distance would hold the truth too often.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from math import sqrt

import numpy as np
from scipy.optimize import brentq
from scipy.stats import t as student

from calibration.parameters import Array

_WIDEST = 60.0  # standard deviations within which a quantile is looked for


@dataclass(frozen=True)
class Posterior:
    """Distribution of the free parameters' logarithms.

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
