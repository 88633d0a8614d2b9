"""Solved states for a build: columns, lines along an axis, and held-out points."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import product
from math import log

import torch
from torch import Tensor

from haptix.friction import ContactModel
from haptix.status import Status
from haptix.surface.axes import AXES, AXIS_NAMES
from haptix.surface.column import PULL_IN_DRIVE
from haptix.surface.interpolant import Interpolant
from haptix.surface.placement import chord_error
from haptix.surface.ranges import Ranges

_NARROWEST = 1e-5  # relative width of an axis, which single precision still divides into cells
_LINES = 6  # along an axis at random, besides those at all corners of the others
_LEVELS = 5  # of drive on each line
_INSULATORS = 512  # pairs of f and h0 held out; each has its own table of attraction
_HELD_OUT = 8192  # points of an error estimate: the 99th percentile rests on 80 of them

UnitInMu = Callable[[Tensor], Tensor]
"""Size of the tolerance's unit in mu, at frictions of any shape."""


@dataclass(frozen=True)
class Columns:
    """Solved columns: shape (...,), and (..., drives) of `inverse`."""

    inverse: Tensor
    """-1/mu at each drive."""
    log_pull_in: Tensor
    """ln of the pull-in voltage [V]."""
    log_breakdown: Tensor
    """ln of the breakdown voltage [V]."""

    def top(self, limit_v: float, ends_at_breakdown: bool) -> Tensor:
        """Drive at which each column ends."""
        end = torch.full_like(self.log_pull_in, log(limit_v))
        if ends_at_breakdown:
            end = torch.minimum(end, self.log_breakdown)
        return torch.exp(2 * (end - self.log_pull_in)).clamp(max=PULL_IN_DRIVE)


@dataclass(frozen=True)
class HeldOutPoints:
    """Solved points of one shape that took no part in placing the nodes.

    Parameters
    ----------
    places : dict of Tensor or None
        Values of each axis.
    voltage_v, mu : Tensor
        Amplitude [V] and solved friction.
    end_v, end_drive : Tensor
        Amplitude [V] and drive at which the contact's column ends.
    log_breakdown : Tensor or None
        ln of the breakdown voltage [V], where that ends columns.
    """

    places: Mapping[str, Tensor | None]
    voltage_v: Tensor
    mu: Tensor
    end_v: Tensor
    end_drive: Tensor
    log_breakdown: Tensor | None

    def error(self, table: Interpolant) -> Tensor:
        """Absolute error of mu at every point."""
        # Within rounding of a column's end, the value of the end is compared.
        mu, _ = table.evaluate(self.voltage_v, self.places)
        return (mu - self.mu).abs()

    def boundary_error(self, table: Interpolant) -> Tensor:
        """Absolute error of ln V_breakdown at every point; 0 where breakdown ends nothing."""
        if self.log_breakdown is None:
            return torch.zeros(1, dtype=torch.float64)
        found = torch.log(table.breakdown(self.places))
        return (found - self.log_breakdown).abs()


def solve_columns(
    model: ContactModel, places: Mapping[str, Tensor | None], drive: Tensor
) -> Columns:
    """Solve at places that broadcast, for every drive, shape (drives,)."""
    each = {name: None if at is None else at[..., None] for name, at in places.items()}
    state = model.at_drive(drive=drive, **each)
    return Columns(
        -1 / state.mu.to("cpu", torch.float64),
        torch.log(state.pull_in_voltage_v[..., 0].to("cpu", torch.float64)),
        torch.log(state.breakdown_voltage_v[..., 0].to("cpu", torch.float64)),
    )


@dataclass(frozen=True)
class AxisPilot:
    """Columns on a few lines along one axis.

    Parameters
    ----------
    at : Tensor, shape (points,)
        ln of the axis.
    inverse, slope : Tensor, shape (points, lines, levels)
        -1/mu, and its derivative with respect to the drive.
    log_pull_in : Tensor, shape (points, lines)
        ln of the pull-in voltage [V].
    drive : Tensor, shape (points, lines, levels)
        Drive of the level, at most that of the column's end.
    unit : Tensor, shape of `inverse`
        The tolerance's unit in mu.
    boundary : Tensor or None, shape (points, lines)
        ln of the breakdown voltage over its allowed error, in units of the tolerance, where
        breakdown ends columns.
    """

    at: Tensor
    inverse: Tensor
    slope: Tensor
    log_pull_in: Tensor
    drive: Tensor
    unit: Tensor
    boundary: Tensor | None

    def error(self, start: int, end: int) -> float:
        """Largest error of mu between two nodes, in units of the tolerance."""
        if end - start < 2:
            return 0.0
        inner = slice(start + 1, end)
        wrong = chord_error(self.inverse, self.at, start, end)
        # An error of the pull-in voltage is an error of the drive.
        shift = chord_error(self.log_pull_in, self.at, start, end)[..., None]
        wrong = wrong - 2 * shift * self.drive[inner] * self.slope[inner]
        worst = float((wrong.abs() / self.inverse[inner] ** 2 / self.unit[inner]).max())
        if self.boundary is None:
            return worst
        return max(worst, float(chord_error(self.boundary, self.at, start, end).abs().max()))


@dataclass(frozen=True)
class DrivePilot:
    """A few columns, solved finely along the drive.

    Parameters
    ----------
    at : Tensor, shape (points,)
        Drive.
    inverse, unit : Tensor, shape (points, columns)
        -1/mu, and the tolerance's unit in mu.
    top : Tensor, shape (columns,)
        Drive at which each column ends; errors beyond it do not count.
    """

    at: Tensor
    inverse: Tensor
    unit: Tensor
    top: Tensor

    def error(self, start: int, end: int) -> float:
        """Largest error of mu between two nodes, in units of the tolerance."""
        if end - start < 2:
            return 0.0
        inner = slice(start + 1, end)
        wrong = chord_error(self.inverse, self.at, start, end).abs()
        wrong = wrong / self.inverse[inner] ** 2 / self.unit[inner]
        return float(torch.where(self.at[inner, None] <= self.top, wrong, 0.0).max())


@dataclass(frozen=True)
class Sampler:
    """Solves a model within ranges.

    Parameters
    ----------
    model : ContactModel
        The model.
    ranges : mapping
        See `haptix.surface.ranges`.
    """

    model: ContactModel
    ranges: Ranges

    @property
    def limit_v(self) -> float:
        """Highest amplitude asked for [V]."""
        return self.span("voltage_v")[1]

    @property
    def ends_at_breakdown(self) -> bool:
        """Whether breakdown ends a column."""
        return self.model.reports(Status.BREAKDOWN)

    def span(self, name: str) -> tuple[float, float]:
        """``(low, high)`` of a range that is not absent."""
        found = self.ranges[name]
        assert found is not None
        return found

    def varying(self) -> list[str]:
        """Names of the axes that have more than one value."""
        return [
            name
            for name in AXIS_NAMES
            if self.ranges[name] is not None
            and self.span(name)[1] > self.span(name)[0] * (1 + _NARROWEST)
        ]

    def positions(self, name: str, points: int) -> Tensor:
        """Values along an axis: even in the logarithm, and at the corners of the model."""
        low, high = self.span(name)
        even = torch.exp(torch.linspace(log(low), log(high), points, dtype=torch.float64))
        even[0], even[-1] = low, high
        bends = [bend for bend in self.model.bends().get(name, ()) if low < bend < high]
        both: Tensor = torch.cat([even, even.new_tensor(bends)]).unique()
        return both

    def along(
        self, name: str, points: int, last_drive: float, unit: UnitInMu, boundary_error: float
    ) -> AxisPilot:
        """Solve lines along one axis; `boundary_error` is the error of ln V_breakdown per unit."""
        values = self.positions(name, points)
        places = self._lines(without=name)
        places[name] = values[:, None]
        drive = torch.linspace(0, last_drive, _LEVELS, dtype=torch.float64)
        columns = solve_columns(self.model, places, drive)
        top = columns.top(self.limit_v, self.ends_at_breakdown)
        return AxisPilot(
            torch.log(values),
            columns.inverse,
            torch.gradient(columns.inverse, spacing=(drive,), dim=-1)[0],
            columns.log_pull_in,
            torch.minimum(drive, top[..., None]),
            unit(-1 / columns.inverse),
            columns.log_breakdown / boundary_error if self.ends_at_breakdown else None,
        )

    def along_drive(self, points: int, last_drive: float, unit: UnitInMu) -> DrivePilot:
        """Solve columns finely along the drive."""
        drive = torch.linspace(0, last_drive, points, dtype=torch.float64)
        columns = solve_columns(self.model, self._lines(), drive)
        top = columns.top(self.limit_v, self.ends_at_breakdown)
        inverse = columns.inverse.T
        return DrivePilot(drive, inverse, unit(-1 / inverse), top)

    def held_out(self, seed: int) -> HeldOutPoints:
        """Draw points within the ranges, some at their ends, and solve them."""
        generator = torch.Generator().manual_seed(seed)

        def draw(*shape: int) -> Tensor:
            stretched = 1.16 * torch.rand(shape, generator=generator, dtype=torch.float64) - 0.08
            return stretched.clamp(0.0, 1.0)

        insulators = _INSULATORS if set(self.varying()) - {"normal_force_n"} else 1
        each = {"normal_force_n": _HELD_OUT // insulators}  # forces for each pair of f and h0
        places = {
            axis.name: self._place(axis.name, draw(insulators, each.get(axis.name, 1)))
            for axis in AXES
        }
        at_rest = solve_columns(self.model, places, torch.zeros(1, dtype=torch.float64))
        top = at_rest.top(self.limit_v, self.ends_at_breakdown)
        drive = top * draw(*top.shape)
        mu = self.model.at_drive(drive=drive, **places).mu.to("cpu", torch.float64)
        pull_in = torch.exp(at_rest.log_pull_in)
        voltage = (pull_in * drive.sqrt()).clamp(max=self.limit_v)
        boundary = at_rest.log_breakdown if self.ends_at_breakdown else None
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
        low, high = self.span(name)
        place = torch.exp(log(low) + share.to(torch.float64) * (log(high) - log(low)))
        return place.clamp(low, high)
