"""A surface at one frequency and thickness, for the few points of a rendered block."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from math import exp, inf, log, sqrt
from typing import Self

import numpy as np

from haptix.checks import Array
from haptix.errors import InputError
from haptix.native import Struct, doubles, library, room
from haptix.status import Status
from haptix.surface.axes import SLACK
from haptix.surface.column import PULL_IN_DRIVE, Column
from haptix.surface.interpolant import Interpolant

_AVERAGED_NODES = 65  # over the drive; lines between them are within 1e-4
_STEEPEST = 0.05  # share of 1/mu without voltage: friction never counts as more than 20 times that
_NEAR = 1e-6  # relative, of an end: rounding does not change what ends a column
_ABOVE, _PULL_IN, _BREAKDOWN = Status.ABOVE, Status.PULL_IN, Status.BREAKDOWN


@dataclass(frozen=True, eq=False)
class Slice:
    """Columns of a surface over the normal force.

    It answers as `FrictionSurface` does. For the dozen points of a block, torch's calls would cost
    many times the arithmetic.

    Parameters
    ----------
    force_n : ndarray, shape (forces,)
        Nodes of the normal force [N].
    drive : ndarray, shape (drives,)
        Nodes of ``s = (V / V_pull-in)^2``.
    columns : ndarray, shape (forces, drives + 2)
        As `Interpolant.columns`.
    unit_v, limit_v : float
        Unit of the voltages in `columns`, and the highest amplitude [V].
    ends_at_breakdown : bool
        Whether columns end at breakdown.
    pull_in_drive : float
        Drive at which pull-in ends a column.
    """

    force_n: Array
    drive: Array
    columns: Array
    unit_v: float
    limit_v: float
    ends_at_breakdown: bool
    pull_in_drive: float = PULL_IN_DRIVE

    @classmethod
    def of(cls, table: Interpolant, limit_v: float | None = None) -> Self:
        """Take the columns of a table whose frequency and thickness do not vary.

        `limit_v` replaces the table's highest amplitude [V].

        Raises
        ------
        InputError
            If frequency or thickness vary.
        """
        force, *others = table.axes
        if any(axis.varies for axis in others):
            raise InputError("surface: expected one frequency and h0; slice it with surface.at()")
        return cls(
            force.nodes.double().cpu().numpy(),
            table.drive.double().cpu().numpy(),
            table.columns.reshape(len(force.nodes), -1).double().cpu().contiguous().numpy(),
            table.unit_v,
            table.voltage_limit_v if limit_v is None else limit_v,
            table.ends_at_breakdown,
        )

    def averaged(self, attraction: Array) -> Self:
        """Return the slice of friction averaged over a period of the drive.

        Friction rises more than in proportion to the attraction, so that its mean is above the
        friction at the mean attraction. The contact follows within the period.

        Parameters
        ----------
        attraction : ndarray, shape (n,)
            Attraction at even times of the period over its mean.
        """
        pull_in_drive = self.pull_in_drive / float(attraction.max())
        drive = np.linspace(0.0, min(pull_in_drive, float(self.drive[-1])), _AVERAGED_NODES)
        at = drive[:, None] * attraction
        # Within the period the drive goes beyond a column's last node. There the column goes on as
        # a straight line, as the closed form ``1/mu ~ 1 - s`` does.
        beyond = np.maximum(at - self.drive[-1], 0.0)
        rows = []
        for column in self.columns:
            slope = (column[-3] - column[-4]) / (self.drive[-1] - self.drive[-2])
            inverse = np.interp(at, self.drive, column[:-2]) + slope * beyond
            # Pull-in bounds the drive and keeps friction finite; this does so where lines bend.
            friction = (-1 / np.minimum(inverse, _STEEPEST * column[0])).mean(axis=1)
            rows.append(np.concatenate([-1 / friction, column[-2:]]))
        return replace(self, drive=drive, columns=np.array(rows), pull_in_drive=pull_in_drive)

    def column(self, normal_force_n: float) -> Column:
        """Column at one force [N], finite and above 0."""
        log_force, nodes = log(normal_force_n), self._log_force
        cell, part = 0, 0.0
        if len(nodes) > 1:
            cell = int(nodes[1:-1].searchsorted(log_force, side="right"))
            part = (log_force - float(nodes[cell])) / float(nodes[cell + 1] - nodes[cell])
        low, high = self.columns[cell], self.columns[min(cell + 1, len(nodes) - 1)]
        column = low + min(max(part, 0.0), 1.0) * (high - low)
        log_pull_in, log_breakdown = column[-2:].tolist()
        pull_in_v = self.unit_v * exp(log_pull_in)
        breakdown_v = self.unit_v * exp(log_breakdown) if self.ends_at_breakdown else inf
        most = float(self.drive[-1])
        end_drive = min((min(breakdown_v, self.limit_v) / pull_in_v) ** 2, most)
        end_v = min(pull_in_v * sqrt(end_drive), self.limit_v)
        ends_by = _PULL_IN if end_drive >= self.pull_in_drive * (1 - _NEAR) else _ABOVE
        if breakdown_v <= end_v * (1 + _NEAR) and breakdown_v < self.limit_v:
            ends_by = _BREAKDOWN
        inside = self._lowest_n <= normal_force_n <= self._highest_n
        return Column(self.drive, column[:-2], pull_in_v, end_drive, end_v, ends_by, inside)

    def reach(self, normal_force_n: Array) -> tuple[Array, Array]:
        """Lowest and highest friction at forces [N], shape (points,), finite and above 0."""
        count = normal_force_n.size
        mu, at = room(2 * count)
        library.hx_slice_reach(self.compiled.at, doubles(normal_force_n), count, at, at + count)
        return mu[:count], mu[count:]

    def mu(self, normal_force_n: Array, amplitude_v: Array) -> Array:
        """Friction at forces [N] and amplitudes [V], both of shape (points,).

        Above the end of a force's column it is that of the end.
        """
        force_n, volts = np.broadcast_arrays(normal_force_n, amplitude_v)
        mu, at = room(force_n.size)
        library.hx_slice_friction(
            self.compiled.at, doubles(force_n), doubles(volts), force_n.size, at
        )
        return mu

    @cached_property
    def compiled(self) -> Struct:
        """The same for the library in C."""
        return Struct(
            "hx_slice",
            forces=len(self.force_n),
            drives=len(self.drive),
            log_force=self._log_force,
            drive=self.drive,
            columns=self.columns,
            unit_v=self.unit_v,
            limit_v=self.limit_v,
            pull_in_drive=self.pull_in_drive,
            lowest_n=self._lowest_n,
            highest_n=self._highest_n,
            ends_at_breakdown=self.ends_at_breakdown,
        )

    @cached_property
    def _log_force(self) -> Array:
        return np.log(self.force_n)

    @property
    def _lowest_n(self) -> float:
        return float(self.force_n[0]) * (1 - SLACK)

    @property
    def _highest_n(self) -> float:
        return float(self.force_n[-1]) * (1 + SLACK)
