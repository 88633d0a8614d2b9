"""A signal between two others, whose mean and spread go evenly from one to the other."""

from __future__ import annotations

from functools import lru_cache
from math import inf, sqrt
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from haptix.errors import InputError
from haptix.signals.signal import AnySignal, Array, Number, Signal

_BLOCK = 1 << 16  # samples


class Morph(Signal):
    """A mixture of two finite signals of one length.

    ``m + s x``: x is ``(1 - share) (a - a_mean) + share (b - b_mean)`` over its own deviation. Mean
    m and deviation s lie between those of the two in proportion to `share`. So two unlike noises do
    not become weaker half way, by a factor of sqrt(2), as they do where they are only faded.

    Parameters
    ----------
    start, end : Signal
        At shares of 0 and 1.
    share : float
        0 to 1.
    """

    start: AnySignal
    end: AnySignal
    share: Annotated[Number, Field(ge=0, le=1)]
    kind: Literal["morph"] = "morph"

    @model_validator(mode="after")
    def _is_of_one_length(self) -> Self:
        start_s, end_s = self.start.length_s, self.end.length_s
        if not start_s == end_s < inf:
            raise InputError(
                f"start and end: expected one length for both, got {start_s:g} s and {end_s:g} s; "
                "give it with .lasting(seconds), or as an excerpt"
            )
        return self

    @property
    def length_s(self) -> float:
        """Length of both."""
        return self.start.length_s

    def samples(self, sample_rate_hz: float) -> int | None:
        """Length in samples."""
        return self.start.samples(sample_rate_hz)

    def _inside(self, first: int, count: int, sample_rate_hz: float) -> Array:
        a_mean, b_mean, mean, scale = _even(self, sample_rate_hz)
        a = self.start.values(first, count, sample_rate_hz) - a_mean
        b = self.end.values(first, count, sample_rate_hz) - b_mean
        return np.asarray(mean + scale * ((1 - self.share) * a + self.share * b))


@lru_cache(maxsize=64)
def _even(morph: Morph, sample_rate_hz: float) -> tuple[float, float, float, float]:
    """Means of both, mean of the mixture, and the factor of its changes."""
    total = morph.samples(sample_rate_hz) or 0
    sums, products = np.zeros(2), np.zeros((2, 2))
    first_values: Array | None = None
    for first in range(0, total, _BLOCK):
        count = min(_BLOCK, total - first)
        both = [one.values(first, count, sample_rate_hz) for one in (morph.start, morph.end)]
        if first_values is None:
            first_values = np.array([one[0] for one in both])
        changes = [one - at for one, at in zip(both, first_values, strict=True)]
        sums += [float(one.sum()) for one in changes]
        # Not np.dot: its last bit depends on the threads of the algebra library.
        products += [[float(np.sum(a * b)) for b in changes] for a in changes]
    assert first_values is not None  # a signal has a sample
    mean = sums / total
    covariance = products / total - np.outer(mean, mean)
    weights = np.array([1 - morph.share, morph.share])
    deviations = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    mixed = sqrt(max(float(weights @ covariance @ weights), 0.0))
    wanted = float(weights @ deviations)
    if mixed <= 1e-9 * wanted:
        raise InputError("start and end: they cancel each other at this share; choose another")
    means = mean + first_values
    scale = wanted / mixed if mixed > 0 else 1.0
    return float(means[0]), float(means[1]), float(weights @ means), scale
