"""Build a friction surface: place the nodes, solve the columns, and check at held-out points."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise, product
from math import floor, inf, log, log2, prod, sqrt
from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

from haptix.base.errors import InputError, ToleranceError
from haptix.base.files import digest
from haptix.base.version import __version__
from haptix.model.friction import ContactModel
from haptix.model.pair import described
from haptix.model.states import ContactState
from haptix.model.status import LIMITS, Status, limits_passed
from haptix.model.surface.answers import record_of
from haptix.model.surface.axes import (
    AXIS_NAMES,
    PULL_IN_DRIVE,
    Axes,
    Axis,
    Ranges,
    between,
    read_ranges,
)
from haptix.model.surface.file import surface_key
from haptix.model.surface.interpolant import Interpolant
from haptix.model.surface.tolerance import Tolerance

Array = npt.NDArray[np.float64]
CellError = Callable[[int, int], float]
"""Largest error inside a cell between two points; it grows with the cell."""

_NARROWEST = 1e-5  # relative width of the narrowest axis with several cells, by float32
_LINES = 6  # lines along an axis at random places, besides those at all corners of the other axes
_STEEPEST = 4  # lines through the held-out points where columns end nearest to pull-in
_LEVELS = 5  # drives on each line
_INSULATORS = 512  # held-out pairs of f and h0; each needs a separate table of attraction
_DIRECT_BELOW_HZ = 1000.0  # skin feels up to this frequency: it feels a slower drive directly
_INSTANTS_SHARE = 0.5  # a sine's squared voltage is above its mean for half of the period
_HELD_OUT = 8192  # points of an error estimate; 80 of them lie above the 99th percentile
_NEAR_END = 0.1  # share of a column's drive, below its end, in which each cell is checked
UnitInMu = Callable[[Tensor], Tensor]
"""Size of the tolerance's unit in mu, at frictions of any shape."""

_PILOT_POINTS = 97  # along an axis at first; doubled where a cell would be a single step
_MOST_PILOT_POINTS = 3000
_FIRST_CHECK = 0.9  # share of the tolerance that the first held-out points may use
_MOST_SPLIT = 1.6  # factor on the columns up to which steep cells are split
_MOST_ROUNDS = 16
_COARSER = 8.0  # factor on the share after a table was too large
_HALVINGS = 16  # bisection steps to the drive at which a limit of the model is reached
_BOUNDARY = 0.01  # largest relative error of the breakdown voltage, where that ends the surface
_CLOSE = 1.2  # stop if the smallest share that fits and the largest that does not are this close
_LN2 = log(2)
# The errors of the axes peak at different places, so their sum may exceed the tolerance.
_FIRST_SHARE = 1.8
Progress = Callable[[float], None]


def fewest_nodes(points: int, error: CellError, tolerance: float) -> list[int]:
    """Choose nodes among points so that the error of no cell exceeds the tolerance.

    First each cell is made as long as possible, which may leave a short last cell. Then all cells
    are made shorter by equal shares of the tolerance, if that needs no more nodes. The first and
    the last point are always nodes. The error of a cell between neighbouring points is taken as 0.
    """
    nodes = _longest_cells(points, error, tolerance, points)
    for share in (0.5, 0.7, 0.85):
        shorter = _longest_cells(points, error, share * tolerance, len(nodes))
        if shorter[-1] == points - 1:
            return shorter
    return nodes


def _longest_cells(points: int, error: CellError, tolerance: float, most: int) -> list[int]:
    """Nodes from the first point on, up to the last point, but no more than `most`."""
    nodes, length = [0], 2
    while nodes[-1] < points - 1 and len(nodes) < most:
        start, good, bad = nodes[-1], nodes[-1] + 1, points
        # Neighbouring cells have similar lengths: from that of the last one by growing strides,
        # upwards or downwards, then by halves.
        end, stride = start + length, 1
        while good < bad - 1:
            end = min(max(end, good + 1), bad - 1)
            if error(start, end) <= tolerance:
                good, end = end, end + stride
            else:
                bad, end = end, end - stride
            stride *= 2
            if bad < points and good > start + 1:
                end = (good + bad) // 2
        nodes.append(good)
        length = good - start
    return nodes


def chord_error(values: Array, at: Array, start: int, end: int) -> Array:
    """Chord minus curve inside a cell, shape (inner points, curves).

    The curves have `values`, shape (points, curves), at positions `at`, shape (points,). Cells are
    short and many: numpy takes a third of torch's time for them.
    """
    share = (at[start + 1 : end] - at[start]) / (at[end] - at[start])
    chord = share[:, None] * (values[end] - values[start])
    error: Array = chord + (values[start] - values[start + 1 : end])
    return error


@dataclass(frozen=True)
class SolvedColumns:
    """Solved columns: shape (...,), and (..., drives) of `inverse`."""

    inverse: Tensor
    """-1/mu at each drive."""
    log_pull_in: Tensor
    """ln of the pull-in voltage [V]."""
    log_breakdown: Tensor
    """ln of the voltage [V] of breakdown, or of an earlier limit of the model."""

    def with_more(self, more: SolvedColumns, is_known: Tensor) -> SolvedColumns:
        """Return columns of the shape of `is_known`: these where it is true, `more` elsewhere."""

        def joined(known: Tensor, new: Tensor) -> Tensor:
            both = new.new_empty(*is_known.shape, *new.shape[1:])
            both[is_known], both[~is_known] = known.reshape(-1, *new.shape[1:]), new
            return both

        pairs = zip(vars(self).values(), vars(more).values(), strict=True)
        return SolvedColumns(*(joined(*pair) for pair in pairs))


@dataclass(frozen=True)
class HeldOutPoints:
    """Solved points of one shape that were not used to choose the nodes."""

    places: Mapping[str, Tensor | None]
    """Values of each axis."""
    voltage_v: Tensor
    mu: Tensor
    """Amplitude [V] and solved friction."""
    end_v: Tensor
    end_drive: Tensor
    """Amplitude [V] and drive at which the contact's column ends."""
    log_breakdown: Tensor | None
    """ln of the breakdown voltage [V] as in `SolvedColumns`; None where it ends no column."""

    def error(self, table: Interpolant) -> Tensor:
        """Absolute error of mu at every point."""
        # A point that rounding puts past a column's end is compared with the end.
        mu, _ = table.evaluate(self.voltage_v, self.places)
        return (mu - self.mu).abs()

    def boundary_error(self, table: Interpolant) -> Tensor:
        """Absolute error of ln V_breakdown at every point; 0 if breakdown ends no column."""
        if self.log_breakdown is None:
            return torch.zeros(1, dtype=torch.float64)
        log_breakdown = torch.log(table.breakdown(self.places))
        return (log_breakdown - self.log_breakdown).abs()

    def nearest_to_pull_in(self, count: int) -> dict[str, Tensor | None]:
        """Places whose columns end nearest to pull-in, each at an own pair of f and h0."""
        highest, force = self.end_drive.max(-1)
        pair = highest.argsort(descending=True)[:count]
        at = (pair, force[pair])
        shape = self.end_drive.shape
        return {
            name: None if place is None else place.broadcast_to(shape)[at]
            for name, place in self.places.items()
        }


@dataclass(frozen=True)
class Pilot:
    """Points along one axis or the drive, solved on a few lines."""

    at: Tensor
    """ln of the axis, or the drive, shape (points,)."""
    error: CellError
    """Largest error of mu between two points that become nodes, in units of the tolerance."""
    columns: SolvedColumns | None = None
    """The lines' columns at the points of an axis, shape (points, lines)."""


@dataclass(frozen=True)
class Sampler:
    """Solves a model within ranges."""

    model: ContactModel
    ranges: Ranges
    past_limits: bool = False
    """Whether columns go on past the limits of the model."""

    @property
    def limit_v(self) -> float:
        """Highest amplitude of the surface [V]."""
        return self.span("voltage_v")[1]

    @property
    def peak_attraction(self) -> float:
        """Largest attraction within a period over its mean: 2 for a direct sine, 1 for a carrier.

        Friction over a period of a direct drive is averaged from the friction of its instants.
        """
        frequency = self.ranges["frequency_hz"]
        return 2.0 if frequency is not None and frequency[0] < _DIRECT_BELOW_HZ else 1.0

    @cached_property
    def limited_by(self) -> Status:
        """The status that ends columns besides pull-in and the voltage limit; OK for none."""
        breaks = self.model.reports(Status.BREAKDOWN)
        return self._limit or (Status.BREAKDOWN if breaks else Status.OK)

    @cached_property
    def _limit(self) -> Status:
        """The limit of the model that ends most columns at corners and random places; OK for none.

        Every limited quantity rises with the voltage, so that it suffices to look at the ends.
        """
        if self.past_limits:
            return Status.OK
        places, no_drive = self._lines(), torch.zeros((), dtype=torch.float64)
        rest = self.model.at_drive(drive=no_drive, **places)
        if past := limits_passed(rest.status):
            raise InputError(
                f"finger {self.model.finger.name!r}: {'; '.join(past)}, without voltage already; "
                "take another finger or other ranges, or pass past_limits (--past-limits)"
            )
        expected = {Status.PULL_IN}  # limits that end columns in any case
        end = torch.full_like(rest.mu, self.limit_v, dtype=torch.float64)
        if self.model.reports(Status.BREAKDOWN):
            expected.add(Status.BREAKDOWN)
            end = torch.minimum(end, rest.breakdown_voltage_v)
        drive = (end / rest.pull_in_voltage_v).square().clamp(max=PULL_IN_DRIVE)
        counts = Counter(self.model.at_drive(drive=drive, **places).status.flatten().tolist())
        passed = [
            (counts[limit], limit) for limit in LIMITS if limit not in expected and counts[limit]
        ]
        return max(passed)[1] if passed else Status.OK

    def columns(self, places: Mapping[str, Tensor | None], drive: Tensor) -> SolvedColumns:
        """Solve at places that broadcast, for every drive, shape (drives,)."""
        by_drive = {name: None if at is None else at[..., None] for name, at in places.items()}
        state = self.model.at_drive(drive=drive, **by_drive)
        log_pull_in = torch.log(state.pull_in_voltage_v[..., 0].to("cpu", torch.float64))
        if self._limit:
            log_breakdown = log_pull_in + torch.log(self._last_ok(places, log_pull_in)) / 2
        else:
            log_breakdown = torch.log(state.breakdown_voltage_v[..., 0].to("cpu", torch.float64))
        return SolvedColumns(-1 / state.mu.to("cpu", torch.float64), log_pull_in, log_breakdown)

    def _last_ok(self, places: Mapping[str, Tensor | None], like: Tensor) -> Tensor:
        """Drive up to which each column's states are OK."""
        low, high = torch.zeros_like(like), torch.ones_like(like)
        for _ in range(_HALVINGS):
            middle = (low + high) / 2
            is_ok = self.model.at_drive(drive=middle, **places).status.cpu() == int(Status.OK)
            low, high = torch.where(is_ok, middle, low), torch.where(is_ok, high, middle)
        return (low + high) / 2

    def top(self, columns: SolvedColumns) -> Tensor:
        """Drive at which each column ends."""
        end = torch.full_like(columns.log_pull_in, log(self.limit_v))
        if self.limited_by:
            end = torch.minimum(end, columns.log_breakdown)
        return torch.exp(2 * (end - columns.log_pull_in)).clamp(max=PULL_IN_DRIVE)

    def at_ends(self) -> ContactState:
        """Return the states where columns end, at all corners of the axes and a few random places.

        The corners include the thinnest insulator. There the share of the attraction beyond
        breakdown is largest, and the interval of the accuracy widest.
        """
        return self.ends_of(self._lines())

    def ends_of(self, places: Mapping[str, Tensor | None]) -> ContactState:
        """Return the states where the columns of these places end."""
        drive = self.top(self.columns(places, torch.zeros(1, dtype=torch.float64)))
        return self.model.at_drive(drive=drive, **places)

    def span(self, name: str) -> tuple[float, float]:
        """``(low, high)`` of a range that is not absent."""
        ends = self.ranges[name]
        assert ends is not None
        return ends

    def varying(self) -> list[str]:
        """Names of the axes that have more than one value."""
        return [
            name
            for name in AXIS_NAMES
            if self.ranges[name] is not None
            and self.span(name)[1] > self.span(name)[0] * (1 + _NARROWEST)
        ]

    def positions(self, name: str, points: int) -> Tensor:
        """Values along an axis, evenly spaced in the logarithm."""
        low, high = self.span(name)
        even = torch.exp(torch.linspace(log(low), log(high), points, dtype=torch.float64))
        even[0], even[-1] = low, high
        return even

    def along(
        self,
        name: str,
        points: int,
        last_drive: float,
        unit: UnitInMu,
        boundary_error: float,
        also: Mapping[str, Tensor | None],
        before: SolvedColumns | None = None,
    ) -> Pilot:
        """Solve lines along one axis, some of them through the places of `also`.

        `boundary_error` is the error of ln V_breakdown per unit. The columns `before` are those at
        every second point.
        """
        values = self.positions(name, points)
        places = _joined(self._lines(without=name), also)
        places[name] = values[1::2, None] if before else values[:, None]
        drive = torch.linspace(0, last_drive, _LEVELS, dtype=torch.float64)
        columns = self.columns(places, drive)
        if before:
            is_known = (torch.arange(points) % 2 == 0)[:, None].expand(-1, columns.inverse.shape[1])
            flat = SolvedColumns(*(part.flatten(0, 1) for part in vars(columns).values()))
            columns = before.with_more(flat, is_known)
        at, inverse = torch.log(values), columns.inverse
        slope = torch.gradient(inverse, spacing=(drive,), dim=-1)[0]
        level = torch.minimum(drive, self.top(columns)[..., None])
        weight = 1 / (inverse**2 * unit(-1 / inverse))
        # An error of the pull-in voltage shifts the drive, and so tilts the friction.
        tilt = 2 * level * slope * weight
        boundary = torch.zeros_like(columns.log_pull_in)
        if self.limited_by:
            boundary = columns.log_breakdown / boundary_error
        # The curves of each line: -1/mu at each drive, and the logarithms of two voltages.
        curves = torch.cat([inverse, torch.stack([columns.log_pull_in, boundary], -1)], -1)
        lines, at_of, curves_of = inverse.shape[1], at.numpy(), curves.flatten(1).numpy()
        weights, tilts = weight.numpy(), tilt.numpy()

        def error(start: int, end: int) -> float:
            inner = slice(start + 1, end)
            wrong = chord_error(curves_of, at_of, start, end).reshape(-1, lines, _LEVELS + 2)
            shift, of_boundary = wrong[..., _LEVELS, None], wrong[..., _LEVELS + 1]
            in_units = wrong[..., :_LEVELS] * weights[inner] - shift * tilts[inner]
            return float(max(np.abs(in_units).max(), np.abs(of_boundary).max()))

        return Pilot(at, error, columns)

    def along_drive(
        self, points: int, last_drive: float, unit: UnitInMu, also: Mapping[str, Tensor | None]
    ) -> Pilot:
        """Solve columns finely along the drive, also at the places of `also`.

        Beyond its end a column serves the instants of a direct drive. There an error is weighted by
        its effect on the mean friction over the period.
        """
        drive = torch.linspace(0, last_drive, points, dtype=torch.float64)
        columns = self.columns(_joined(self._lines(), also), drive)
        top, inverse = self.top(columns), columns.inverse.T
        last = self.peak_attraction * top
        in_mu = unit(-1 / inverse)
        at_top = inverse.gather(0, torch.searchsorted(drive, top).clamp(max=points - 1)[None])
        instants = in_mu * (at_top / inverse) / _INSTANTS_SHARE
        in_mu = torch.where(drive[:, None] <= top, in_mu, instants)
        weight = torch.where(drive[:, None] <= last, 1 / (inverse**2 * in_mu), 0.0).numpy()
        curves, at = inverse.numpy(), drive.numpy()

        def error(start: int, end: int) -> float:
            wrong = chord_error(curves, at, start, end) * weight[start + 1 : end]
            return float(np.abs(wrong).max())

        return Pilot(drive, error)

    def held_out(self, seed: int) -> HeldOutPoints:
        """Draw points within the ranges, some at their ends, and solve them."""
        generator = torch.Generator().manual_seed(seed)

        def draw(*shape: int) -> Tensor:
            stretched = 1.16 * torch.rand(shape, generator=generator, dtype=torch.float64) - 0.08
            return stretched.clamp(0.0, 1.0)

        insulators = _INSULATORS if set(self.varying()) - {"normal_force_n"} else 1
        counts = {"normal_force_n": _HELD_OUT // insulators}  # forces for each pair of f and h0
        places = {
            name: self._place(name, draw(insulators, counts.get(name, 1))) for name in AXIS_NAMES
        }
        return self._solved(places, lambda top: draw(*top.shape))

    def in_cells(self, axes: Axes) -> HeldOutPoints:
        """Solve a point near the middle of every cell between the columns, at drives near its end.

        The error is largest in the few cells where a contact comes near to pull-in. Points drawn
        at random seldom fall there.
        """
        generator = torch.Generator().manual_seed(3)
        middles = []
        for axis in axes:
            nodes = torch.log(axis.nodes)
            middles.append(torch.exp((nodes[1:] + nodes[:-1]) / 2) if axis.varies else axis.nodes)
        grid = torch.meshgrid(*middles, indexing="ij")
        places = {
            axis.name: None if axis.is_absent else at[..., None]
            for axis, at in zip(axes, grid, strict=True)
        }

        def shares(top: Tensor) -> Tensor:
            near = torch.rand(top.shape, generator=generator, dtype=torch.float64)
            return torch.cat([torch.ones_like(near), 1 - _NEAR_END * near], -1)

        # The voltage of a limit may jump between two columns, whatever lies between them: its error
        # is that at random points.
        return replace(self._solved(places, shares), log_breakdown=None)

    def _solved(
        self, places: Mapping[str, Tensor | None], shares: Callable[[Tensor], Tensor]
    ) -> HeldOutPoints:
        """Solve at places and at shares of the drive at which each column ends."""
        at_rest = self.columns(places, torch.zeros(1, dtype=torch.float64))
        top = self.top(at_rest)
        drive = top * shares(top)
        mu = self.model.at_drive(drive=drive, **places).mu.to("cpu", torch.float64)
        pull_in = torch.exp(at_rest.log_pull_in)
        voltage = (pull_in * drive.sqrt()).clamp(max=self.limit_v)
        boundary = at_rest.log_breakdown if self.limited_by else None
        return HeldOutPoints(places, voltage, mu, pull_in * top.sqrt(), top, boundary)

    def _lines(self, without: str = "") -> dict[str, Tensor | None]:
        """Corners of the axes that vary, and random places: shape (lines,) each."""
        others = [name for name in self.varying() if name != without]
        corners = torch.tensor(list(product((0.0, 1.0), repeat=len(others))), dtype=torch.float64)
        generator = torch.Generator().manual_seed(len(others))
        random = torch.rand((_LINES if others else 0, len(others)), generator=generator)
        shares = torch.cat([corners, random.to(torch.float64)])
        places = {}
        for name in AXIS_NAMES:
            share = shares[:, others.index(name)] if name in others else torch.zeros(len(shares))
            places[name] = self._place(name, share)
        return places

    def _place(self, name: str, share: Tensor) -> Tensor | None:
        if self.ranges[name] is None:
            return None
        return between(*self.span(name), share.to(torch.float64))


def build_table(
    model: ContactModel,
    scene: Any,
    tolerance: Tolerance,
    on_progress: Progress | None,
    largest_bytes: int,
    notes: Mapping[str, Any] | None,
    past_limits: bool = False,
) -> tuple[Interpolant, dict[str, Any]]:
    """Solve a table and describe it; see `FrictionSurface.build`.

    If the tolerance cannot be met, the result is the best table, with ``"tolerance_met": False``.
    """
    ranges, notes = read_ranges(model, scene), dict(notes or {})
    try:
        json.dumps(notes, allow_nan=False)
    except (TypeError, ValueError) as error:
        raise InputError(f"notes: expected plain values that JSON can hold: {error}") from None
    build = _Build(Sampler(model, ranges, past_limits), tolerance, largest_bytes)
    attempt = build.run(on_progress or (lambda _: None))
    at_ends = build.sampler.at_ends()
    info = {
        "haptix": __version__,
        "key": surface_key(model, scene, tolerance, largest_bytes, past_limits),
        "model": model.describe(),
        "model_hash": digest(model.describe()),
        "profiles": described(model.finger, model.screen),
        "friction": "at the period's mean attraction",
        "ranges": ranges,
        "screen_h0_m": model.screen.h0_m,
        "response_hz_per_mm_per_s": model.finger.response_hz_per_mm_per_s,
        "notes": notes,
        "tolerance": {"value": tolerance.value, "unit": tolerance.unit},
        "tolerance_met": attempt.is_met,
        "mu_low": build.low,
        "mu_high": build.high,
        "pull_past_breakdown": float(at_ends.pull_past_breakdown.max()),
        "accuracy": at_ends.accuracy.record(),
        "intervals": build.intervals(attempt),
        "error_max": float(attempt.error.max()),
        "error_p99": float(attempt.error.quantile(0.99)),
        "error_max_in_units": attempt.worst,
        "held_out_points": attempt.error.numel(),
        "monotone_corrections": attempt.corrections,
    }
    return attempt.table, info


@dataclass(frozen=True)
class _Attempt:
    """A table, its errors in mu at held-out points, and the worst in units of the tolerance."""

    table: Interpolant
    columns: SolvedColumns
    corrections: int
    error: Tensor
    worst: float
    is_met: bool
    steep: Mapping[str, Tensor] = field(default_factory=dict)
    """Cells of each axis in which an error is above the tolerance, or nearly so."""

    def split(self, nodes: Mapping[str, Tensor]) -> dict[str, Tensor] | None:
        """Split the steep cells of the axes; None where that would make far more columns.

        Near pull-in the errors of all axes add up in a corner. A smaller share of the tolerance
        would put more nodes everywhere.
        """
        split, factor = dict(nodes), 1.0
        for name in sorted(self.steep, key=lambda name: len(self.steep[name]) / len(nodes[name])):
            low, at = nodes[name], self.steep[name]
            factor *= 1 + len(at) / len(low)
            if factor <= _MOST_SPLIT:
                split[name] = torch.cat([low, (low[at] + low[at + 1]) / 2]).sort().values
        return split if any(len(split[name]) > len(low) for name, low in nodes.items()) else None


class _Build:
    """One build: divide the tolerance among the axes until the held-out points agree."""

    def __init__(self, sampler: Sampler, tolerance: Tolerance, largest_bytes: int) -> None:
        self.sampler = sampler
        self.tolerance = tolerance
        self.largest_bytes = largest_bytes
        self.axes = self.sampler.varying()
        self.points = dict.fromkeys([*self.axes, "drive"], _PILOT_POINTS)
        self.pilots: dict[str, Pilot] = {}

    def run(self, report: Progress) -> _Attempt:
        held_out = self.sampler.held_out(seed=1)
        self._check_reach(held_out)
        self.low, self.high = float(held_out.mu.min()), float(held_out.mu.max())
        self.steepest = held_out.nearest_to_pull_in(_STEEPEST)
        # 5 % more, for states between the points.
        end_drive = 1.05 * float(held_out.end_drive.max())
        self.end_drive = min(end_drive, PULL_IN_DRIVE)
        self.last_drive = min(self.sampler.peak_attraction * end_drive, PULL_IN_DRIVE)
        report(0.3)
        share, best = _FIRST_SHARE, None
        split: dict[str, Tensor] | None = None
        before: _Attempt | None = None  # that was split
        fits, exceeds = inf, 0.0  # smallest share that fits into the size, largest that does not
        for round_ in range(_MOST_ROUNDS):
            nodes = split or self._place(share)
            if self._size(nodes) > self.largest_bytes:
                exceeds = max(exceeds, share)
            else:
                report(0.3 + 0.6 * (1 - 0.5 ** (round_ + 1)))
                attempt = self._attempt(nodes, held_out, before)
                if attempt.is_met:
                    report(1.0)
                    return attempt
                if best is None or attempt.worst < best.worst:
                    best = attempt
                split, before = attempt.split(nodes), attempt
                if split and self._size(split) <= self.largest_bytes:
                    continue
                fits = min(fits, share)
            split = before = None
            if not exceeds:
                wanted = 0.9 * _FIRST_CHECK * self.tolerance.value / attempt.worst
                share *= min(0.8, max(0.2, wanted))
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
        # Without a smaller error to be had, the reserve of the first check is not asked for.
        return self._confirmed(best) if best.worst <= self.tolerance.value else best

    @cached_property
    def unseen(self) -> HeldOutPoints:
        """Points that decide about an attempt, and about no node."""
        return self.sampler.held_out(seed=2)

    def intervals(self, attempt: _Attempt) -> dict[str, Any]:
        """Intervals of the theory in each cell, see `haptix.model.surface.answers`."""
        axes = attempt.table.axes
        top = self.sampler.top(attempt.columns)
        ends = self.sampler.model.at_drive(drive=top, **_places_of(axes))
        return record_of(axes, ends.accuracy)

    def _attempt(
        self, nodes: Mapping[str, Tensor], held_out: HeldOutPoints, before: _Attempt | None
    ) -> _Attempt:
        table, columns, corrections = self._tabulate(nodes, before)
        error = held_out.error(table)
        worst = self._worst(error, held_out, table)
        attempt = _Attempt(table, columns, corrections, error.reshape(-1), worst, is_met=False)
        enough = worst <= _FIRST_CHECK * self.tolerance.value
        return self._confirmed(attempt) if enough else attempt

    def _confirmed(self, attempt: _Attempt) -> _Attempt:
        """Whether the attempt meets the tolerance at fresh points and in every cell as well."""
        axes = attempt.table.axes
        for everywhere in (False, True):
            fresh = self.sampler.in_cells(axes) if everywhere else self.unseen
            other = fresh.error(attempt.table)
            worst = max(attempt.worst, self._worst(other, fresh, attempt.table))
            error = torch.cat([attempt.error, other.reshape(-1)])
            attempt = replace(attempt, error=error, worst=worst)
            if worst > self.tolerance.value:
                steep = self._steep(other, fresh, axes) if everywhere else {}
                return replace(attempt, steep=steep)
        return replace(attempt, is_met=True)

    def _steep(self, error: Tensor, points: HeldOutPoints, axes: Axes) -> dict[str, Tensor]:
        """Cells of each axis that have a large error, of points in every cell."""
        large = (error / self._unit(points.mu) > _FIRST_CHECK * self.tolerance.value).any(-1)
        hit = large.nonzero()
        return (
            {axis.name: hit[:, number].unique() for number, axis in enumerate(axes) if axis.varies}
            if len(hit)
            else {}
        )

    def _check_reach(self, held_out: HeldOutPoints) -> None:
        lowest = self.sampler.span("voltage_v")[0]
        highest = float(held_out.end_v.max())
        if lowest > highest:
            raise InputError(
                f"voltage_v: all of the range from {lowest:g} V lies past the end of the light "
                f"contact, {highest:g} V at most in these ranges; lower it, or raise force or h0_m"
            )

    def _place(self, share: float) -> dict[str, Tensor]:
        """Nodes of every axis, if the axes divide `share` of the tolerance equally."""
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
            nodes[name] = pilot.at[chosen]
        return nodes

    def _pilot(self, name: str) -> Pilot:
        pilot, points = self.pilots.get(name), self.points[name]
        if pilot is None or len(pilot.at) < points:
            self.pilots[name] = (
                self.sampler.along_drive(points, self.last_drive, self._unit, self.steepest)
                if name == "drive"
                else self.sampler.along(
                    name,
                    points,
                    self.end_drive,
                    self._unit,
                    _BOUNDARY / self.tolerance.value,
                    self.steepest,
                    None if pilot is None else pilot.columns,
                )
            )
        return self.pilots[name]

    def _tabulate(
        self, nodes: Mapping[str, Tensor], before: _Attempt | None
    ) -> tuple[Interpolant, SolvedColumns, int]:
        """Solve the columns, or after a split those that were not solved `before`."""
        axes = Axes(tuple(self._axis(name, nodes) for name in AXIS_NAMES))
        places = _places_of(axes)
        if before is None:
            columns = self.sampler.columns(places, nodes["drive"])
        else:
            is_known = torch.ones((), dtype=torch.bool)
            for axis, old in zip(axes, before.table.axes, strict=True):
                is_known = is_known[..., None] & (
                    axis.is_absent | torch.isin(axis.nodes, old.nodes)
                )
            new = {name: None if at is None else at[~is_known] for name, at in places.items()}
            columns = before.columns.with_more(self.sampler.columns(new, nodes["drive"]), is_known)
        # Friction rises with voltage; `cummax` makes this true of the last bit as well.
        inverse = columns.inverse.cummax(-1).values
        corrections = int((inverse != columns.inverse).sum())
        voltages = torch.stack([columns.log_pull_in, columns.log_breakdown], -1)
        # In a unit well below all voltages their logarithms are above 0; a power of two is exact.
        unit_v = 2.0 ** (floor(float(voltages.min()) / _LN2) - 2)
        table = Interpolant(
            axes,
            nodes["drive"],
            torch.cat([inverse, voltages - log2(unit_v) * _LN2], -1),
            unit_v,
            self.sampler.limit_v,
            self.sampler.limited_by,
        )
        return table, columns, corrections

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


def _joined(
    places: Mapping[str, Tensor | None], more: Mapping[str, Tensor | None]
) -> dict[str, Tensor | None]:
    """Places in a row, shape (places,), and after them more."""
    joined: dict[str, Tensor | None] = {}
    for name, at in places.items():
        after = more[name]
        joined[name] = None if at is None or after is None else torch.cat([at, after])
    return joined


def _places_of(axes: Axes) -> dict[str, Tensor | None]:
    """Place of each column, of the shape of the axes."""
    grid = torch.meshgrid(*(axis.nodes for axis in axes), indexing="ij")
    return {axis.name: None if axis.is_absent else at for axis, at in zip(axes, grid, strict=True)}
