"""Line spectral frequencies: a polynomial within the unit circle as angles on it."""

from __future__ import annotations

from math import pi

import numpy as np
import numpy.typing as npt

from haptix.errors import InputError
from haptix.texture.field import Array


def polynomial_of_lsf(lsf: npt.ArrayLike) -> Array:
    """Polynomial whose line spectral frequencies [rad] these are, first coefficient 1.

    The frequencies are, in turn, roots on the unit circle of ``P(z) = A(z) + z^-(m+1) A(1/z)`` and
    ``Q(z) = A(z) - z^-(m+1) A(1/z)``; A is half their sum.
    """
    lsf = np.asarray(lsf, dtype=np.float64)
    order = len(lsf)
    sums, differences = _circle(lsf[0::2]), _circle(lsf[1::2])
    # The roots at 1 and -1 that every such pair has besides.
    if order % 2 == 0:
        sums, differences = np.convolve(sums, [1, 1]), np.convolve(differences, [1, -1])
    else:
        differences = np.convolve(differences, [1, 0, -1])
    return np.asarray((sums + differences)[: order + 1] / 2)


def lsf_of_polynomial(polynomial: npt.ArrayLike) -> Array:
    """Line spectral frequencies [rad], increasing, of a polynomial.

    Raises
    ------
    InputError
        If a root is not within the unit circle.
    """
    a = np.asarray(polynomial, dtype=np.float64)
    a = a / a[0]
    if len(a) == 1:
        return np.empty(0)
    if np.abs(np.roots(a)).max() >= 1:
        raise InputError("expected a stable process, got one with a root on or beyond the circle")
    longer, turned = np.append(a, 0.0), np.append(0.0, a[::-1])
    roots = np.concatenate([np.roots(longer + turned), np.roots(longer - turned)])
    angles = np.sort(np.angle(roots))
    # Roots come in pairs; those at 1 and -1 belong to every pair of such polynomials.
    inner = angles[(angles > 1e-9) & (angles < pi - 1e-9)]
    return np.asarray(inner)


def _circle(angles: Array) -> Array:
    polynomial = np.ones(1)
    for angle in angles:
        polynomial = np.convolve(polynomial, [1.0, -2 * np.cos(angle), 1.0])
    return polynomial
