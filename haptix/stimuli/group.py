"""A hierarchical model over participants and conditions, and its contrasts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from haptix.checks import Array

_SIZES = np.concatenate([[0.0], np.geomspace(0.03, 8.0, 18)])
_INTERVAL = (0.025, 0.975)


@dataclass(frozen=True)
class Group:
    """Posterior of the means of conditions: a mixture of normal distributions.

    Parameters
    ----------
    weight : ndarray, shape (sizes,)
        Of each pair of standard deviations between participants that was tried.
    mean : ndarray, shape (sizes, conditions)
        Means of the conditions.
    covariance : ndarray, shape (sizes, conditions, conditions)
        Of the means.
    between : float
        Standard deviation between participants in a condition.
    """

    weight: Array
    mean: Array
    covariance: Array
    between: float

    def contrast(self, factors: Array) -> tuple[float, float, float, float]:
        """Return mean and 95 % interval of a sum of conditions, and p of its sign.

        p is twice the probability of the sign that is less likely.
        """
        from scipy.optimize import brentq
        from scipy.special import ndtr

        middle = self.mean @ factors
        error = np.sqrt(np.einsum("i,kij,j->k", factors, self.covariance, factors))
        mean, most = float(self.weight @ middle), 12 * float(error.max())

        def below(at: float) -> float:
            return float(self.weight @ ndtr((at - middle) / error))

        ends = middle.min() - most, middle.max() + most
        low, high = (brentq(lambda at: below(at) - share, *ends) for share in _INTERVAL)  # noqa: B023
        return mean, low, high, 2 * min(below(0.0), 1 - below(0.0))


def group(value: Array, spread: Array, person: Sequence[str], condition: Sequence[int]) -> Group:
    """Return means of conditions for the population of the participants.

    A value is the mean of its condition, plus what a participant has in all conditions, plus what
    they have in this one, plus its own error of a known `spread`; all normal. The standard
    deviations of the first two are tried on a grid, with half-Cauchy priors as wide as the values
    scatter (Gelman, Bayesian Anal. 1, 515 (2006)), and the means follow from each pair.

    Parameters
    ----------
    value, spread : ndarray, shape (values,)
        Of a participant in a condition; one value of each pair at most.
    person : sequence of str
        Whose each value is.
    condition : sequence of int
        Of which condition, from 0.
    """
    _, who = np.unique(person, return_inverse=True)
    table = np.zeros((who.max() + 1, max(condition) + 1))
    known, y, variance = table.copy(), table.copy(), table + 1.0
    known[who, condition], y[who, condition], variance[who, condition] = 1.0, value, spread**2
    count = known.sum(0)
    off = (y - (y * known).sum(0) / count) * known
    scale = float(np.sqrt((off**2).sum() / max(1.0, known.sum() - len(count)))) or 1e-9
    sizes = scale * _SIZES
    prior = np.gradient(_SIZES) / (1 + _SIZES**2)
    weights, means, covariances, totals = [], [], [], []
    for shared, of_shared in zip(sizes, prior, strict=True):
        for own, of_own in zip(sizes, prior, strict=True):
            # Covariance of a participant's values: own^2 + spread^2 on the diagonal, plus shared^2.
            precise = known / (variance + own**2)
            each = precise.sum(1)
            factor = shared**2 / (1 + shared**2 * each)
            of_person = (precise * y).sum(1)
            inverse = np.diag(precise.sum(0)) - precise.T @ (factor[:, None] * precise)
            covariance = np.linalg.inv(inverse)
            right = (precise * y).sum(0) - precise.T @ (factor * of_person)
            mean = covariance @ right
            rest = (precise * y**2).sum() - factor @ of_person**2 - right @ mean
            sizes_of = np.log(precise[known > 0]).sum() - np.log1p(shared**2 * each).sum()
            likelihood = 0.5 * (sizes_of - np.linalg.slogdet(inverse)[1] - rest)
            weights.append(likelihood + np.log(of_shared * of_own))
            means.append(mean)
            covariances.append(covariance)
            totals.append(np.hypot(shared, own))
    weight = np.exp(np.array(weights) - max(weights))
    weight /= weight.sum()
    return Group(weight, np.array(means), np.array(covariances), float(weight @ np.array(totals)))
