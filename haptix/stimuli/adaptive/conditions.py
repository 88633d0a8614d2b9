"""Several conditions in one experiment: a method for each, interleaved or in blocks."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import nan
from typing import Any

import numpy as np

from haptix.errors import InputError
from haptix.stimuli.adaptive.method import Estimate, Method


@dataclass(eq=False)
class MethodsByCondition(Method):
    """A method for each condition.

    Parameters
    ----------
    methods : mapping of str to Method
        By the names of the conditions, in the order of their blocks.
    interleaved : bool
        Each trial's condition is drawn from those that are not done; otherwise one follows another.
    seed : int
        Seed of what is drawn.
    """

    methods: Mapping[str, Method]
    interleaved: bool = True
    seed: int = 0

    kind = "conditions"

    def __post_init__(self) -> None:
        if not self.methods:
            raise InputError("conditions: expected one or more")
        self._taken = 0
        self._drawn: str | None = None

    @property
    def condition(self) -> str:
        """Name of the condition of the next trial."""
        if self._drawn is None:
            left = [name for name, one in self.methods.items() if not one.is_done]
            left = left or list(self.methods)[-1:]
            draw = np.random.default_rng([self.seed, self._taken])
            self._drawn = left[int(draw.integers(len(left)))] if self.interleaved else left[0]
        return self._drawn

    @property
    def level(self) -> float:
        return self.methods[self.condition].level

    @property
    def other_level(self) -> float | None:
        return self.methods[self.condition].other_level

    @property
    def is_done(self) -> bool:
        return all(one.is_done for one in self.methods.values())

    def update(self, is_right: float, level: float | None = None) -> None:
        """Take an answer to the condition of the next trial."""
        self.methods[self.condition].update(is_right, level)
        self._taken, self._drawn = self._taken + 1, None

    def estimate(self) -> Estimate:
        """Return the estimate of a single condition; several have one each, in `methods`."""
        if len(self.methods) == 1:
            return next(iter(self.methods.values())).estimate()
        return Estimate(nan, nan, {})

    def describe(self) -> dict[str, Any]:
        found = {name: one.describe() for name, one in self.methods.items()}
        return super().describe() | {"methods": found, "order": list(self.methods)}
