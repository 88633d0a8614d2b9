"""Friction asked for, and the voltages that give it."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from haptix.checks import Array
from haptix.errors import InputError
from haptix.surface import Column
from haptix.texture import TargetKind, as_mu


@dataclass(frozen=True, slots=True)
class Target:
    """How the numbers of a texture ask for friction.

    Parameters
    ----------
    kind : {"mu", "contrast", "share"}
        See `haptix.texture.as_mu`.
    span : (float, float), optional
        Lowest and highest number of the whole texture. With it, all numbers between them are
        compressed into the reachable range; shares are in that range anyway. Without it, friction
        outside the range becomes the nearest friction inside.
    """

    kind: TargetKind
    span: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        if self.span is not None and not -inf < self.span[0] < self.span[1] < inf:
            raise InputError(f"compress: expected finite low < high, got {self.span!r}")

    def as_mu(self, value: Array, lowest: Array | float, highest: Array | float) -> Array:
        """Friction coefficients asked for where the reachable range is `lowest` to `highest`."""
        asked: Array = as_mu(self.kind, value, lowest, highest)
        if self.span is None or self.kind == "share":
            return asked
        bottom, top = (as_mu(self.kind, edge, lowest, highest) for edge in self.span)
        low, high = np.maximum(bottom, lowest), np.minimum(top, highest)
        # A texture that lies wholly outside the range goes to the nearest end.
        compressed: Array = low + (asked - bottom) / (top - bottom) * np.maximum(high - low, 0.0)
        return compressed


class Amplitudes(NamedTuple):
    """Answers of a surface to a batch of targets; arrays of their shape."""

    voltage_v: Array
    """Amplitude that gives the friction, or the nearest in the reachable range."""
    target_mu: Array
    """Friction coefficient asked for."""
    status: npt.NDArray[np.int8]
    """Numbers of `Status`: OK, BELOW, ABOVE, PULL_IN, BREAKDOWN or OUT_OF_RANGE."""

    @classmethod
    def of(
        cls,
        column: Column,
        target: Target,
        value: Array,
        intensity: float | Array = 1.0,
        added: Array | None = None,
    ) -> Amplitudes:
        """Amplitudes for the numbers of a texture, shape (points,).

        Shares of the reachable range are `added`, up to its end; then the intensity scales what is
        above the lowest friction.
        """
        lowest, highest = column.lowest_mu, column.highest_mu
        mu = target.as_mu(value, lowest, highest)
        if added is not None:
            mu = np.minimum(mu + added * (highest - lowest), np.maximum(mu, highest))
        if not isinstance(intensity, float) or intensity != 1.0:
            mu = lowest + intensity * (mu - lowest)
        voltage_v, status = column.voltage(mu)
        return cls(voltage_v, mu, status)
