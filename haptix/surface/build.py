"""Build a friction surface: place the nodes, solve the columns, and check at held-out points."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import pairwise
from math import floor, inf, log, log2, prod, sqrt
from typing import Any

import torch
from torch import Tensor

from haptix.errors import InputError, ToleranceError
from haptix.friction import ContactModel
from haptix.surface.axes import AXIS_NAMES, Axes, Axis
from haptix.surface.column import PULL_IN_DRIVE
from haptix.surface.interpolant import Interpolant
from haptix.surface.placement import fewest_nodes
from haptix.surface.request import Ranges, digest, read_ranges, surface_key
from haptix.surface.sampling import HeldOutPoints, Pilot, Sampler
from haptix.surface.tolerance import Tolerance
from haptix.version import __version__

_PILOT_POINTS = 97  # along an axis at first; doubled where cells come down to single steps
_MOST_PILOT_POINTS = 3000
_KEPT_BACK = 0.9  # share of the tolerance that the first held-out points may use
_MOST_ROUNDS = 16
_COARSER = 8.0  # factor on a share whose table is too large
_BOUNDARY = 0.01  # largest relative error of the breakdown voltage, where that ends the surface
_CLOSE = 1.2  # stop when the largest share that fits is this near the smallest that does not
_LN2 = log(2)
# The errors of the axes peak at different places, so their sum may exceed the tolerance.
_FIRST_SHARE = 1.8

Progress = Callable[[float], None]


def build_table(
    model: ContactModel,
    scene: Any,
    tolerance: Tolerance,
    on_progress: Progress | None,
    largest_bytes: int,
    notes: Mapping[str, Any] | None,
) -> tuple[Interpolant, dict[str, Any]]:
    """Solve a table and describe it; see `FrictionSurface.build`.

    Where the tolerance cannot be met, this is the best table, and its description says so.
    """
    ranges, notes = read_ranges(model, scene), dict(notes or {})
    try:
        json.dumps(notes, allow_nan=False)
    except (TypeError, ValueError) as error:
        raise InputError(f"notes: expected plain values that JSON can hold: {error}") from None
    build = _Build(model, ranges, tolerance, largest_bytes)
    found = build.run(on_progress or (lambda _: None))
    info = {
        "haptix": __version__,
        "key": surface_key(model, scene, tolerance, largest_bytes),
        "model": model.describe(),
        "model_hash": digest(model.describe()),
        "friction": "at the period's mean attraction",
        "ranges": ranges,
        "screen_h0_m": model.screen.h0_m,
        "response_hz_per_mm_per_s": model.finger.response_hz_per_mm_per_s,
        "notes": notes,
        "tolerance": {"value": tolerance.value, "unit": tolerance.unit},
        "tolerance_met": found.is_met,
        "mu_low": build.low,
        "mu_high": build.high,
        "pull_past_breakdown": build.sampler.pull_past_breakdown(),
        "error_max": float(found.error.max()),
        "error_p99": float(found.error.quantile(0.99)),
        "error_max_in_units": found.worst,
        "held_out_points": found.error.numel(),
        "monotone_corrections": found.corrections,
    }
    return found.table, info


@dataclass(frozen=True)
class _Attempt:
    """A table and its errors at held-out points, in mu and at worst in units of the tolerance."""

    table: Interpolant
    corrections: int
    error: Tensor
    worst: float
    is_met: bool


class _Build:
    """One build: share the tolerance between the axes until the held-out points agree."""

    def __init__(
        self, model: ContactModel, ranges: Ranges, tolerance: Tolerance, largest_bytes: int
    ) -> None:
        self.sampler = Sampler(model, ranges)
        self.tolerance = tolerance
        self.largest_bytes = largest_bytes
        self.axes = self.sampler.varying()
        self.points = dict.fromkeys([*self.axes, "drive"], _PILOT_POINTS)
        self.pilots: dict[str, Pilot] = {}

    def run(self, report: Progress) -> _Attempt:
        held_out = self.sampler.held_out(seed=1)
        self._check_reach(held_out)
        self.low, self.high = float(held_out.mu.min()), float(held_out.mu.max())
        # With a margin for states between the points.
        end_drive = 1.05 * float(held_out.end_drive.max())
        self.end_drive = min(end_drive, PULL_IN_DRIVE)
        self.last_drive = min(self.sampler.peak_attraction * end_drive, PULL_IN_DRIVE)
        report(0.3)
        share, best = _FIRST_SHARE, None
        fits, exceeds = inf, 0.0  # smallest share that fits into the size, largest that does not
        for round_ in range(_MOST_ROUNDS):
            nodes = self._place(share)
            if self._size(nodes) > self.largest_bytes:
                exceeds = max(exceeds, share)
            else:
                report(0.3 + 0.6 * (1 - 0.5 ** (round_ + 1)))
                attempt = self._attempt(nodes, held_out)
                if attempt.is_met:
                    report(1.0)
                    return attempt
                if best is None or attempt.worst < best.worst:
                    best = attempt
                fits = min(fits, share)
            if not exceeds:
                share *= min(0.8, max(0.2, 0.9 * _KEPT_BACK * self.tolerance.value / attempt.worst))
            elif fits == inf:
                share = _COARSER * exceeds
            elif fits > _CLOSE * exceeds:
                share = sqrt(fits * exceeds)
            else:
                break
        if best is None:
            raise ToleranceError(
                f"tolerance {self.tolerance}: not even a coarse surface fits into "
                f"{self.largest_bytes:,} bytes; allow more, or narrow the ranges"
            )
        return best

    def _attempt(self, nodes: Mapping[str, Tensor], held_out: HeldOutPoints) -> _Attempt:
        table, corrections = self._tabulate(nodes)
        error = held_out.error(table)
        worst = self._worst(error, held_out, table)
        is_met = worst <= _KEPT_BACK * self.tolerance.value
        if is_met:  # confirm at fresh points
            fresh = self.sampler.held_out(seed=2)
            other = fresh.error(table)
            worst = max(worst, self._worst(other, fresh, table))
            is_met = worst <= self.tolerance.value
            error = torch.cat([error.reshape(-1), other.reshape(-1)])
        return _Attempt(table, corrections, error.reshape(-1), worst, is_met)

    def _check_reach(self, held_out: HeldOutPoints) -> None:
        lowest = self.sampler.span("voltage_v")[0]
        highest = float(held_out.end_v.max())
        if lowest > highest:
            raise InputError(
                f"voltage_v: all of the range from {lowest:g} V lies past the end of the light "
                f"contact, {highest:g} V at most in these ranges; lower it, or raise force or h0_m"
            )

    def _place(self, share: float) -> dict[str, Tensor]:
        """Nodes of every axis, for a share of the tolerance that the axes divide."""
        tolerance = share * self.tolerance.value / len(self.points)
        nodes = {}
        for name in self.points:
            while True:
                pilot = self._pilot(name)
                chosen = fewest_nodes(len(pilot.at), pilot.error, tolerance)
                # A cell of one pilot step has no inner point, so its error is unknown.
                shortest = min(b - a for a, b in pairwise(chosen))
                if shortest > 1 or self.points[name] >= _MOST_PILOT_POINTS:
                    break
                self.points[name] = 2 * self.points[name] - 1
                del self.pilots[name]
            nodes[name] = pilot.at[chosen]
        return nodes

    def _pilot(self, name: str) -> Pilot:
        if name not in self.pilots:
            points = self.points[name]
            self.pilots[name] = (
                self.sampler.along_drive(points, self.last_drive, self._unit)
                if name == "drive"
                else self.sampler.along(
                    name, points, self.end_drive, self._unit, _BOUNDARY / self.tolerance.value
                )
            )
        return self.pilots[name]

    def _tabulate(self, nodes: Mapping[str, Tensor]) -> tuple[Interpolant, int]:
        axes = Axes(tuple(self._axis(name, nodes) for name in AXIS_NAMES))
        grid = torch.meshgrid(*(axis.nodes for axis in axes), indexing="ij")
        places = {
            axis.name: None if axis.is_absent else at for axis, at in zip(axes, grid, strict=True)
        }
        columns = self.sampler.columns(places, nodes["drive"])
        # Solved friction rises with voltage; this holds for the last bit as well.
        inverse = columns.inverse.cummax(-1).values
        corrections = int((inverse != columns.inverse).sum())
        voltages = torch.stack([columns.log_pull_in, columns.log_breakdown], -1)
        # A power of two well below all of them keeps the logarithms above 0.
        unit_v = 2.0 ** (floor(float(voltages.min()) / _LN2) - 2)
        table = Interpolant(
            axes,
            nodes["drive"],
            torch.cat([inverse, voltages - log2(unit_v) * _LN2], -1),
            unit_v,
            self.sampler.limit_v,
            self.sampler.ends_at_breakdown,
        )
        return table, corrections

    def _axis(self, name: str, nodes: Mapping[str, Tensor]) -> Axis:
        if self.sampler.ranges[name] is None:
            return Axis.absent(name)
        low, high = self.sampler.span(name)
        if name not in nodes:
            return Axis(name, torch.tensor([low], dtype=torch.float64))
        values = torch.exp(nodes[name])
        values[0], values[-1] = low, high
        return Axis(name, values)

    def _size(self, nodes: Mapping[str, Tensor]) -> int:
        shape = [len(nodes[name]) if name in nodes else 1 for name in AXIS_NAMES]
        drives = len(nodes["drive"])
        return 8 * (prod(shape) * (drives + 2) + sum(shape) + drives)

    def _unit(self, mu: Tensor) -> Tensor:
        unit = self.tolerance.unit_in_mu(mu, self.low, self.high)
        return torch.as_tensor(unit, dtype=mu.dtype).expand_as(mu)

    def _worst(self, error: Tensor, held_out: HeldOutPoints, table: Interpolant) -> float:
        """Largest error in units of the tolerance, the breakdown voltage included."""
        boundary = held_out.boundary_error(table) * (self.tolerance.value / _BOUNDARY)
        return max(float((error / self._unit(held_out.mu)).max()), float(boundary.max()))
