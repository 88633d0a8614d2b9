"""Force and speed of a stroke: measured by the panel, checked against ranges, and shown."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import dist
from typing import Self

from pydantic import NonNegativeFloat, model_validator

from haptix.documents import Part
from haptix.render.intervals import TouchSample

_GAP_S = 0.1  # between two reports of one touch
_CELLS = 24  # of a bar, whose range is its middle half
_UNITS = {"normal_force_n": ("force", "N"), "speed_mm_per_s": ("speed", "mm/s")}


@dataclass(frozen=True)
class Touch:
    """Mean force and speed of the finger; None where the panel does not measure it."""

    normal_force_n: float | None
    speed_mm_per_s: float | None

    @classmethod
    def of(cls, samples: Sequence[TouchSample]) -> Self | None:
        """Return that of a panel's reports; None where there are none."""
        if not samples:
            return None
        down = [at for at in samples if at.phase != "up"]
        steps = [
            (dist((one.x_mm, one.y_mm), (other.x_mm, other.y_mm)), other.t_s - one.t_s)
            for one, other in pairwise(sorted(down, key=lambda at: (at.contact, at.t_s)))
            if one.contact == other.contact and 0 < other.t_s - one.t_s < _GAP_S
        ]
        path_mm, time_s = (sum(parts) for parts in zip(*steps, strict=True)) if steps else (0, 0)
        return cls(_mean([at.normal_force_n for at in down]), path_mm / time_s if time_s else None)

    @classmethod
    def mean(cls, strokes: Sequence[Touch | None]) -> Self | None:
        """Return the mean of the strokes of a trial; None where none was touched."""
        felt = [stroke for stroke in strokes if stroke is not None]
        if not felt:
            return None
        return cls(
            _mean([at.normal_force_n for at in felt]), _mean([at.speed_mm_per_s for at in felt])
        )


def _mean(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return sum(known) / len(known) if known else None


class StrokeRanges(Part):
    """Ranges of force and speed of a valid stroke; those that are given are checked."""

    normal_force_n: tuple[NonNegativeFloat, NonNegativeFloat] | None = None
    speed_mm_per_s: tuple[NonNegativeFloat, NonNegativeFloat] | None = None

    @model_validator(mode="after")
    def _rises(self) -> Self:
        for name, (low, high) in self.given().items():
            if not low < high:
                raise ValueError(f"{name}: expected [least, most], got [{low:g}, {high:g}]")
        return self

    def given(self) -> dict[str, tuple[float, float]]:
        """Return the ranges that are given, by name."""
        return {name: getattr(self, name) for name in _UNITS if getattr(self, name) is not None}

    def objection(self, felt: Touch | None) -> str:
        """Return the reason why a stroke is not valid; empty if it is."""
        if felt is None:
            return "no touch"
        for name, (low, high) in self.given().items():
            was = getattr(felt, name)
            if was is None:
                return f"{name} was not measured"
            if not low <= was <= high:
                return f"{name} was {was:g}, not {low:g} to {high:g}"
        return ""

    def bars(self, felt: Touch | None) -> str:
        """Draw force and speed of a stroke in their ranges, for a terminal."""
        lines = []
        for name, (low, high) in self.given().items():
            (word, unit), was = _UNITS[name], None if felt is None else getattr(felt, name)
            cells = [*"-" * _CELLS]
            cells[_CELLS // 4] = cells[3 * _CELLS // 4] = "|"
            if was is not None:
                place = _CELLS // 4 + (was - low) / (high - low) * (_CELLS // 2)
                cells[round(min(max(place, 0), _CELLS - 1))] = "#"
            value = "not measured" if was is None else f"{was:.3g} {unit}"
            lines.append(f"{word} [{''.join(cells)}] {value}, of {low:g} to {high:g} {unit}\n")
        return "".join(lines)
