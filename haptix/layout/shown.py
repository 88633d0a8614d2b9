"""The regions of a layout at one state: those near a finger are found without asking each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from haptix.checks import Array
from haptix.layout.region import RegionState
from haptix.texture import Evaluator

_LOOPED = 12  # regions up to which asking each is faster than asking numpy for all


@dataclass(frozen=True, slots=True)
class Shown:
    """Regions at one state of a layout; it never changes, a change replaces it.

    Parameters
    ----------
    regions : tuple of RegionState
        The highest first.
    ways : ndarray, shape (4, regions), optional
        Of many regions: left, right, top and bottom of the way of each.
    evaluators : tuple of Evaluator
        Of all regions, each once.
    multiplies : bool
        Whether any region multiplies what is below it.
    has_priorities : bool
        Whether any region has a priority.
    controls : tuple of RegionState
        Those whose material has a value.
    """

    regions: tuple[RegionState, ...] = ()
    ways: Array | None = None
    evaluators: tuple[Evaluator, ...] = ()
    multiplies: bool = False
    has_priorities: bool = False
    controls: tuple[RegionState, ...] = ()

    @classmethod
    def of(cls, regions: Sequence[RegionState]) -> Self:
        """Take regions, the highest first."""
        return cls(
            tuple(regions),
            np.array([one.way for one in regions]).T if len(regions) > _LOOPED else None,
            tuple({id(one.evaluator): one.evaluator for one in regions}.values()),
            any(one.blend == "multiply" for one in regions),
            any(one.priority for one in regions),
            tuple(one for one in regions if one.control is not None),
        )

    def moved(self, at: int, region: RegionState) -> Shown:
        """Return the same with one region in another place."""
        regions, ways = self.regions, self.ways
        if ways is not None:
            ways = ways.copy()
            ways[:, at] = region.way
        return Shown(
            (*regions[:at], region, *regions[at + 1 :]),
            ways, self.evaluators, self.multiplies, self.has_priorities,
            tuple(region if one is self.regions[at] else one for one in self.controls),
        )  # fmt: skip

    def near(self, left: float, right: float, top: float, bottom: float) -> Sequence[RegionState]:
        """Return at least those whose way meets a box [mm], the highest first; of few, all."""
        ways = self.ways
        if ways is None:
            return self.regions
        apart = (ways[0] > right) | (ways[1] < left) | (ways[2] > bottom) | (ways[3] < top)
        return [self.regions[at] for at in np.flatnonzero(~apart).tolist()]

    @property
    def drives_at_rest(self) -> bool:
        """Whether any region is felt at rest."""
        return any(one.drives_at_rest for one in self.evaluators)
