"""The interface of adaptive methods: they choose a level and take an answer."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol


@dataclass(frozen=True)
class Estimate:
    """The threshold that a method estimates."""

    threshold: float
    """In the units of its levels."""
    spread: float
    """Standard deviation of the threshold; NaN if unknown."""
    others: dict[str, float]
    """Slope and other estimated parameters."""


class Method(Protocol):
    """Chooses levels one at a time by the answers so far."""

    @property
    def level(self) -> float:
        """The level to be presented next."""

    @property
    def is_done(self) -> bool:
        """Whether the method is finished."""

    def update(self, is_right: bool, level: float | None = None) -> None:
        """Take an answer; `level` is the presented level, if it differs from the method's."""

    def estimate(self) -> Estimate:
        """Estimate from the answers so far."""

    def describe(self) -> dict[str, Any]:
        """Everything that determines what it does, as plain values."""
