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
from haptix.surface.axes import AXIS_NAMES, between
from haptix.surface.column import PULL_IN_DRIVE
from haptix.surface.interpolant import Interpolant
from haptix.surface.placement import CellError, chord_error
from haptix.surface.request import Ranges

_NARROWEST = 1e-5  # relative width of an axis that single precision still divides into cells
_LINES = 6  # along an axis at random, besides those at all corners of the others
_LEVELS = 5  # of drive on each line
_INSULATORS = 512  # pairs of f and h0 held out; each has its own table of attraction
_DIRECT_BELOW_HZ = 1000.0  # skin feels up to here: slower drives are felt themselves
_INSTANTS_SHARE = 0.5  # a sine's squared voltage is above its mean for half of the period
_HELD_OUT = 8192  # points of an error estimate; 80 of them lie above the 99th percentile

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
        # A point that rounding puts past a column's end is compared with the end.
        mu, _ = table.evaluate(self.voltage_v, self.places)
        return (mu - self.mu).abs()

    def boundary_error(self, table: Interpolant) -> Tensor:
        """Absolute error of ln V_breakdown at every point; 0 if breakdown ends no column."""
        if self.log_breakdown is None:
            return torch.zeros(1, dtype=torch.float64)
        found = torch.log(table.breakdown(self.places))
        return (found - self.log_breakdown).abs()


@dataclass(frozen=True)
class Pilot:
    """Points along one axis or the drive, solved on a few lines."""

    at: Tensor
    """ln of the axis, or the drive, shape (points,)."""
    error: CellError
    """Largest error of mu between two points that become nodes, in units of the tolerance."""


@dataclass(frozen=True)
class Sampler:
    """Solves a model within ranges."""

    model: ContactModel
    ranges: Ranges

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

    @property
    def ends_at_breakdown(self) -> bool:
        """Whether breakdown ends a column."""
        return self.model.reports(Status.BREAKDOWN)

    def columns(self, places: Mapping[str, Tensor | None], drive: Tensor) -> Columns:
        """Solve at places that broadcast, for every drive, shape (drives,)."""
        each = {name: None if at is None else at[..., None] for name, at in places.items()}
        state = self.model.at_drive(drive=drive, **each)
        return Columns(
            -1 / state.mu.to("cpu", torch.float64),
            torch.log(state.pull_in_voltage_v[..., 0].to("cpu", torch.float64)),
            torch.log(state.breakdown_voltage_v[..., 0].to("cpu", torch.float64)),
        )

    def top(self, columns: Columns) -> Tensor:
        """Drive at which each column ends."""
        end = torch.full_like(columns.log_pull_in, log(self.limit_v))
        if self.ends_at_breakdown:
            end = torch.minimum(end, columns.log_breakdown)
        return torch.exp(2 * (end - columns.log_pull_in)).clamp(max=PULL_IN_DRIVE)

    def pull_past_breakdown(self) -> float:
        """Largest share of the attraction that no gap bears, see `ContactState`, at columns' ends.

        At all corners of the axes and a few random places; the thinnest insulator has the most.
        """
        places = self._lines()
        drive = self.top(self.columns(places, torch.zeros(1, dtype=torch.float64)))
        return float(self.model.at_drive(drive=drive, **places).pull_past_breakdown.max())

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
        """Values along an axis, evenly spaced in the logarithm."""
        low, high = self.span(name)
        even = torch.exp(torch.linspace(log(low), log(high), points, dtype=torch.float64))
        even[0], even[-1] = low, high
        return even

    def along(
        self, name: str, points: int, last_drive: float, unit: UnitInMu, boundary_error: float
    ) -> Pilot:
        """Solve lines along one axis; `boundary_error` is the error of ln V_breakdown per unit."""
        values = self.positions(name, points)
        places = self._lines(without=name)
        places[name] = values[:, None]
        drive = torch.linspace(0, last_drive, _LEVELS, dtype=torch.float64)
        columns = self.columns(places, drive)
        at, inverse = torch.log(values), columns.inverse
        slope = torch.gradient(inverse, spacing=(drive,), dim=-1)[0]
        level = torch.minimum(drive, self.top(columns)[..., None])
        weight = 1 / (inverse**2 * unit(-1 / inverse))
        # An error of the pull-in voltage is an error of the drive.
        tilt = 2 * level * slope * weight
        boundary = columns.log_breakdown / boundary_error

        def error(start: int, end: int) -> float:
            inner = slice(start + 1, end)
            wrong = chord_error(inverse, at, start, end) * weight[inner]
            shift = chord_error(columns.log_pull_in, at, start, end)[..., None]
            worst = float((wrong - shift * tilt[inner]).abs().max())
            if not self.ends_at_breakdown:
                return worst
            return max(worst, float(chord_error(boundary, at, start, end).abs().max()))

        return Pilot(at, error)

    def along_drive(self, points: int, last_drive: float, unit: UnitInMu) -> Pilot:
        """Solve columns finely along the drive.

        Beyond its end a column holds the instants of a direct drive: there an error counts by its
        share of friction, as it does in the mean of a period.
        """
        drive = torch.linspace(0, last_drive, points, dtype=torch.float64)
        columns = self.columns(self._lines(), drive)
        top, inverse = self.top(columns), columns.inverse.T
        last = self.peak_attraction * top
        in_mu = unit(-1 / inverse)
        at_top = inverse.gather(0, torch.searchsorted(drive, top).clamp(max=points - 1)[None])
        instants = in_mu * (at_top / inverse) / _INSTANTS_SHARE
        in_mu = torch.where(drive[:, None] <= top, in_mu, instants)
        weight = torch.where(drive[:, None] <= last, 1 / (inverse**2 * in_mu), 0.0)

        def error(start: int, end: int) -> float:
            wrong = chord_error(inverse, drive, start, end) * weight[start + 1 : end]
            return float(wrong.abs().max())

        return Pilot(drive, error)

    def held_out(self, seed: int) -> HeldOutPoints:
        """Draw points within the ranges, some at their ends, and solve them."""
        generator = torch.Generator().manual_seed(seed)

        def draw(*shape: int) -> Tensor:
            stretched = 1.16 * torch.rand(shape, generator=generator, dtype=torch.float64) - 0.08
            return stretched.clamp(0.0, 1.0)

        insulators = _INSULATORS if set(self.varying()) - {"normal_force_n"} else 1
        each = {"normal_force_n": _HELD_OUT // insulators}  # forces for each pair of f and h0
        places = {
            name: self._place(name, draw(insulators, each.get(name, 1))) for name in AXIS_NAMES
        }
        at_rest = self.columns(places, torch.zeros(1, dtype=torch.float64))
        top = self.top(at_rest)
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
        return between(*self.span(name), share.to(torch.float64))
