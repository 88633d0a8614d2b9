"""Friction against voltage: one `Column`, and a `Slice` of columns over the normal force."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import exp, inf, log, sqrt
from typing import Self

import numpy as np
import numpy.typing as npt

from haptix.checks import Array
from haptix.display import Displayed
from haptix.errors import InputError
from haptix.native import Struct, doubles, library, room
from haptix.status import Status
from haptix.surface.axes import PULL_IN_DRIVE, SLACK
from haptix.surface.interpolant import Interpolant

Codes = npt.NDArray[np.int8]

_SLACK = 1e-9  # relative: with it rounding does not put the end of a column out of range
_LEAST_MU = 1e-150  # in place of frictions of 0 and below, which have no inverse
_MEDIAN_NODES = 4097  # of a median column: the columns of several fingers may cross anywhere

_AVERAGED_NODES = 65  # over the drive; linear interpolation between them is exact to 1e-4
_STEEPEST = 0.05  # least share of 1/mu: friction is at most 20 times that without voltage
_NEAR = 1e-6  # relative: with it rounding does not change which limit ends a column
_ABOVE, _PULL_IN = Status.ABOVE, Status.PULL_IN


@dataclass(frozen=True, eq=False)
class Column(Displayed):
    """Friction against voltage at one force.

    Parameters
    ----------
    drive : ndarray, shape (nodes,)
        Squared voltage ``s = (V / unit_v)^2``, increasing from 0.
    inverse : ndarray, shape (nodes,)
        ``-1/mu`` at each drive, not falling; linear in between.
    unit_v : float
        Amplitude at s = 1 [V]: the pull-in voltage, for a column of a surface.
    end_drive, end_v : float
        Drive, and amplitude [V], at which the column ends.
    ends_by : Status
        Status of a friction above the end: ABOVE (the voltage limit) or a limit of the model.
    is_inside : bool
        Whether the force is on the surface's axis.
    """

    drive: Array
    inverse: Array
    unit_v: float
    end_drive: float
    end_v: float
    ends_by: Status
    is_inside: bool = True

    @classmethod
    def median(cls, columns: Sequence[Column]) -> Column:
        """Median friction of several fingers, each at one force, up to the lowest of their ends."""
        if len(columns) == 1:
            return columns[0]
        lowest = min(columns, key=lambda column: float(column.end_v))
        drive = np.linspace(0, 1, _MEDIAN_NODES)
        mu = np.median([column.mu(lowest.end_v * np.sqrt(drive)) for column in columns], axis=0)
        # The median of rising curves rises; this makes it true of the last bit as well.
        inverse = np.maximum.accumulate(-1 / mu)
        return cls(drive, inverse, lowest.end_v, 1.0, lowest.end_v, lowest.ends_by)

    def limited(self, limit_v: float) -> Column:
        """Return the same column up to an amplitude [V] at most."""
        if self.end_v <= limit_v:
            return self
        end_drive = (limit_v / self.unit_v) ** 2
        return replace(self, end_drive=end_drive, end_v=limit_v, ends_by=Status.ABOVE)

    @cached_property
    def lowest_mu(self) -> float:
        """Friction without voltage."""
        return -1 / float(self.inverse[0])

    @cached_property
    def highest_mu(self) -> float:
        """Friction at the end."""
        return -1 / float(np.interp(self.end_drive, self.drive, self.inverse))

    def mu(self, voltage_v: Array) -> Array:
        """Friction at amplitudes [V]; above the end, that of the end."""
        drive = np.square(np.minimum(voltage_v, self.end_v) / self.unit_v)
        return np.asarray(-1 / np.interp(drive, self.drive, self.inverse))

    def voltage(self, mu: Array) -> tuple[Array, Codes]:
        """Amplitudes [V] for frictions, and their status.

        Parameters
        ----------
        mu : ndarray, shape (points,)
            Friction asked for.

        Returns
        -------
        voltage_v : ndarray, shape (points,)
            Amplitude of that friction, or of the nearest one in the reachable range.
        status : ndarray of int8, shape (points,)
            OK, BELOW, OUT_OF_RANGE or the value of `ends_by`.
        """
        goal = -1 / np.maximum(mu, _LEAST_MU)
        drive = np.minimum(np.interp(goal, self.inverse, self.drive), self.end_drive)
        voltage = np.minimum(self.unit_v * np.sqrt(drive), self.end_v)
        if not self.is_inside:
            return voltage, np.full(goal.shape, Status.OUT_OF_RANGE, np.int8)
        # These values are negative, so that the slack widens the range.
        most, least = (_SLACK - 1) / self.highest_mu, -(1 + _SLACK) / self.lowest_mu
        status = (goal > most) * np.int8(self.ends_by) + (goal < least) * np.int8(Status.BELOW)
        return voltage, status


@dataclass(frozen=True, eq=False)
class Slice:
    """Columns of a surface over the normal force.

    It gives the results of `FrictionSurface` without torch, whose calls would cost many times the
    arithmetic for the dozen points of a block.

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
    limited_by : Status
        As `Interpolant.limited_by`.
    pull_in_drive : float
        Drive at which pull-in ends a column.
    """

    force_n: Array
    drive: Array
    columns: Array
    unit_v: float
    limit_v: float
    limited_by: Status
    pull_in_drive: float = PULL_IN_DRIVE

    @classmethod
    def of(cls, table: Interpolant, limit_v: float | None = None) -> Self:
        """Take the columns of a table whose frequency and thickness do not vary.

        Parameters
        ----------
        table : Interpolant
        limit_v : float, optional
            Highest amplitude [V], instead of the table's.

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
            table.limited_by,
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
        # Within the period the drive exceeds a column's last node. There the column continues as a
        # straight line, as in the closed form ``1/mu ~ 1 - s``.
        beyond = np.maximum(at - self.drive[-1], 0.0)
        rows = []
        for column in self.columns:
            slope = (column[-3] - column[-4]) / (self.drive[-1] - self.drive[-2])
            inverse = np.interp(at, self.drive, column[:-2]) + slope * beyond
            # Pull-in bounds the drive, which keeps friction finite for a straight column; where a
            # column bends, this bound does.
            friction = (-1 / np.minimum(inverse, _STEEPEST * column[0])).mean(axis=1)
            rows.append(np.concatenate([-1 / friction, column[-2:]]))
        return replace(self, drive=drive, columns=np.array(rows), pull_in_drive=pull_in_drive)

    def attracted(self, log_gain: float) -> Self:
        """Return the slice of a finger whose attraction is larger by the factor ``exp(log_gain)``.

        Friction without voltage, the highest amplitude and that of breakdown do not change.
        """
        columns = self.columns.copy()
        columns[:, -1] += log_gain / 2
        return replace(self, columns=columns, unit_v=self.unit_v * exp(-log_gain / 2))

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
        breakdown_v = self.unit_v * exp(log_breakdown) if self.limited_by else inf
        most = float(self.drive[-1])
        end_drive = min((min(breakdown_v, self.limit_v) / pull_in_v) ** 2, most)
        end_v = min(pull_in_v * sqrt(end_drive), self.limit_v)
        ends_by = _PULL_IN if end_drive >= self.pull_in_drive * (1 - _NEAR) else _ABOVE
        if breakdown_v <= end_v * (1 + _NEAR) and breakdown_v < self.limit_v:
            ends_by = self.limited_by
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

        Parameters
        ----------
        normal_force_n : array, shape (points,)
        amplitude_v : array, shape (points,)
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
            limited_by=int(self.limited_by),
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
