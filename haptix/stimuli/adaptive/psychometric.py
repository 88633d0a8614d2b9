"""Psychometric functions: the probability of a right answer against the level."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from haptix.checks import choice

Array = npt.NDArray[np.float64]
Psychometric = Callable[..., Array]
"""Share right for (level, threshold, slope, guess, lapse), which broadcast."""


def weibull(level: Array, threshold: Array, slope: Array, guess: Array, lapse: Array) -> Array:
    """Weibull function of a level in dB: ``1 - d - (1 - g - d) exp(-10^(b (x - t) / 20))``.

    At the threshold ``1 - 1/e`` of the way from guess to ``1 - lapse`` is reached (Watson, J.
    Vision 17(3):10 (2017), Eq. 6).
    """
    # Beyond that all are right.
    steps = np.minimum(slope * (level - threshold) / 20, 300.0)
    return np.asarray(1 - lapse - (1 - guess - lapse) * np.exp(-(10**steps)))


def normal(level: Array, threshold: Array, slope: Array, guess: Array, lapse: Array) -> Array:
    """Cumulative normal of a linear level; `slope` is its standard deviation."""
    from scipy.special import ndtr

    return np.asarray(guess + (1 - guess - lapse) * ndtr((level - threshold) / slope))


def symmetric_normal(
    level: Array, threshold: Array, slope: Array, guess: Array, lapse: Array
) -> Array:
    """Cumulative normal between `lapse` and ``1 - lapse``, for two equal answers. No `guess`."""
    return normal(level, threshold, slope, lapse, lapse)


FUNCTIONS: dict[str, Psychometric] = {
    "weibull": weibull,
    "normal": normal,
    "symmetric-normal": symmetric_normal,
}
"""Psychometric functions by the names that recipes use."""


def function_named(name: str) -> Psychometric:
    """Look a function up by its name."""
    return FUNCTIONS[choice("function", name, FUNCTIONS)]
