"""What all methods have in common: they say a level, and take an answer."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol


@dataclass(frozen=True)
class Estimate:
    """What a method has found."""

    threshold: float
    """In the units of its levels."""
    spread: float
    """Standard deviation of it; NaN where the method cannot tell."""
    others: dict[str, float]
    """Slope and whatever else was estimated."""


class Method(Protocol):
    """Chooses levels; one level at a time is asked for and answered."""

    @property
    def level(self) -> float:
        """The level to be presented next."""

    @property
    def is_done(self) -> bool:
        """Whether it has asked enough."""

    def update(self, is_right: bool, level: float | None = None) -> None:
        """Take an answer; `level` is what was presented, where it was not what was asked for."""

    def estimate(self) -> Estimate:
        """What is known so far."""

    def describe(self) -> dict[str, Any]:
        """Everything that determines what it does, as plain values."""
