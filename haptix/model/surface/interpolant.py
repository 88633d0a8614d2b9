"""The interpolant of a friction surface: columns of 1/mu, blended, evaluated and inverted.

`Interpolant` answers for tensors of points. A `Slice` of it, and a `Column` at one force, give the
same numbers without torch, whose calls would cost many times the arithmetic for the dozen points of
a block.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import exp, inf, log, sqrt
from typing import Any, Self

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

from haptix.base.checks import Array
from haptix.base.display import Displayed
from haptix.base.errors import InputError
from haptix.base.native import Struct, doubles, ffi, library, room
from haptix.base.threads import Answer, in_blocks
from haptix.model.states import broadcast_shape, check_device
from haptix.model.status import Status
from haptix.model.surface.axes import PULL_IN_DRIVE, SLACK, Axes, Cells

Query = Mapping[str, Any]
"""Values by name of the axis, which broadcast; None for an axis that is left out."""

Codes = npt.NDArray[np.int8]

_SLACK = 1e-9  # relative: with it rounding does not put the end of a column out of range
_LEAST_MU = 1e-150  # in place of frictions of 0 and below, which have no inverse
_MEDIAN_NODES = 4097  # of a median column: the columns of several fingers may cross anywhere
_AVERAGED_NODES = 65  # over the drive; linear interpolation between them is exact to 1e-4
_STEEPEST = 0.05  # least share of 1/mu: friction is at most 20 times that without voltage
_NEAR = 1e-6  # relative: with it rounding does not change which limit ends a column

_EXTRA = 2  # entries of a column after those of mu: ln of the pull-in and breakdown voltage
_ABOVE, _BELOW = int(Status.ABOVE), int(Status.BELOW)
_PULL_IN, _OUT_OF_RANGE = int(Status.PULL_IN), int(Status.OUT_OF_RANGE)


@dataclass(frozen=True)
class Interpolant(Displayed):
    """mu(F_N, V0, f, h0) on a grid.

    Each column, at one force, frequency and thickness, holds 1/mu at nodes of the drive
    ``s = (V0 / V_pull-in)^2``, and its pull-in voltage. By the closed form ``mu = mu_0 / (1 - s)``,
    1/mu is nearly linear in s. Columns are blended linearly in the logarithms of the axes. Since
    1/mu falls along every column, it also falls along every blend of columns. The inverse is
    therefore unique, and exact on the interpolant.

    Parameters
    ----------
    axes : Axes
        Normal force, frequency and h0; an axis that does not vary has a single node.
    drive : Tensor, shape (drives,)
        Nodes of s, from 0 up to 0.81 or to the highest that occurs within the voltage limit.
    columns : Tensor, shape (*axes.shape, drives + 2)
        ``-1/mu`` at each drive, not falling. Then come ln of the pull-in voltage and ln of the
        voltage at which gap or insulator break down or `limited_by` ends the column, both in units
        of `unit_v` and above 0.
    unit_v : float
        Unit of these voltages [V], below all of them.
    voltage_limit_v : float
        Highest amplitude of the surface [V].
    limited_by : Status
        The limit to which the last entry of the columns belongs: breakdown, or the declared limit
        of the model (`haptix.model.status.LIMITS`) that ends most columns. OK if there is none.
    """

    axes: Axes
    drive: Tensor
    columns: Tensor
    unit_v: float
    voltage_limit_v: float
    limited_by: Status = Status.OK

    @property
    def mu(self) -> Tensor:
        """Friction coefficient at the nodes, shape (*axes.shape, drives)."""
        return -1 / self.columns[..., :-_EXTRA]

    @property
    def pull_in_voltage_v(self) -> Tensor:
        """Pull-in voltage of each column [V]."""
        return self.unit_v * torch.exp(self.columns[..., -2])

    @property
    def breakdown_voltage_v(self) -> Tensor:
        """Breakdown voltage of each column [V]."""
        return self.unit_v * torch.exp(self.columns[..., -1])

    @property
    def nbytes(self) -> int:
        """Bytes of the table."""
        axes = sum(axis.nodes.nbytes for axis in self.axes)
        return self.columns.nbytes + self.drive.nbytes + axes

    def evaluate(self, voltage_v: Tensor, places: Query) -> tuple[Tensor, Tensor]:
        """Friction and status at amplitudes [V] and places on the axes, which broadcast.

        Parameters
        ----------
        voltage_v : Tensor
        places : sequence of Tensor
            Places on each axis, in its unit; they broadcast with the amplitudes.
        """
        mu, status = self._ask(self._evaluate, voltage_v, places)
        return mu, status

    def invert(self, mu: Tensor, places: Query) -> tuple[Tensor, Tensor]:
        """Amplitude [V] and status for frictions and places on the axes.

        Parameters
        ----------
        mu : Tensor
        places : sequence of Tensor
            Places on each axis, in its unit; they broadcast with the frictions.
        """
        voltage, status = self._ask(self._invert, mu, places)
        return voltage, status

    def end(self, places: Query) -> Tensor:
        """Amplitude [V] at which the columns end: the voltage limit, pull-in or `limited_by`."""
        return self._ask(self._limits, torch.zeros_like(self.drive[0]), places)[0]

    def breakdown(self, places: Query) -> Tensor:
        """Amplitude [V] from which the gap or the insulator breaks down."""
        return self._ask(self._limits, torch.zeros_like(self.drive[0]), places)[1]

    def at(self, places: Query) -> Interpolant:
        """Reduce axes to one value each; None leaves an axis as it is."""
        axes, columns = self.axes.at(places, self.columns)
        return replace(self, axes=axes, columns=columns)

    def to(self, dtype: torch.dtype, device: torch.device | str) -> Interpolant:
        """Return a copy in another precision or on another device.

        Parameters
        ----------
        dtype : torch.dtype
            Precision of the numbers.
        device : torch.device or str
            Where they are.
        """
        if dtype not in (torch.float32, torch.float64):
            raise InputError(f"dtype: expected torch.float32 or torch.float64, got {dtype}")
        check_device(device)
        return replace(
            self,
            axes=self.axes.to(dtype, device),
            drive=self.drive.to(device, dtype),
            columns=self.columns.to(device, dtype),
        )

    def _ask(self, answer: Answer, first: Tensor, query: Query) -> tuple[Tensor, ...]:
        """Broadcast a quantity with the places on the axes, and answer block by block."""
        places = self.axes.read(query)
        shape = broadcast_shape(first, *(place for place in places if place is not None))
        flat = [None if t is None else t.expand(shape).reshape(-1) for t in (first, *places)]
        return tuple(result.reshape(shape) for result in in_blocks(answer, flat))

    def _evaluate(self, voltage: Tensor, *places: Tensor | None) -> tuple[Tensor, Tensor]:
        tensors = [self.columns, voltage, *(place for place in places if place is not None)]
        is_plain = self.columns.dtype == torch.float64 and self.columns.device.type == "cpu"
        if is_plain and not any(t.requires_grad for t in tensors):
            return self._evaluate_in_c(voltage, places)
        # Only two entries of each column are needed: blending whole columns took twice as long.
        corners, inside = self.axes.corners(places, voltage)
        width = self.columns.shape[-1]
        first = corners.row * width
        log_pull_in = corners.blend(self.columns, first, width - 2)
        log_breakdown = None
        if self.limited_by:
            log_breakdown = corners.blend(self.columns, first, width - 1)
        pull_in, breakdown, top = self._ends(log_pull_in, log_breakdown)
        drive = (voltage / pull_in).square()
        cell, part = self._drive_cells.find(torch.minimum(drive, top))
        first += cell
        low, high = (corners.blend(self.columns, first, entry) for entry in (0, 1))
        mu = torch.lerp(low, high, part).reciprocal().neg()
        slack = self._slack
        past = drive > PULL_IN_DRIVE * slack
        status = _small(past) * _PULL_IN
        if self.limited_by:
            beyond = (voltage > breakdown * slack).logical_and_(~past)
            status += _small(beyond) * int(self.limited_by)
        inside = inside.logical_and_(voltage <= self.voltage_limit_v * slack)
        return mu, _outside(status, inside)

    def _evaluate_in_c(
        self, voltage: Tensor, places: Sequence[Tensor | None]
    ) -> tuple[Tensor, Tensor]:
        each = list(zip(self.axes, places, strict=True))
        logs = [doubles(torch.log(x).numpy()) for axis, x in each if axis.varies and x is not None]
        mu, status = (
            torch.empty(len(voltage), dtype=torch.float64),
            torch.empty(len(voltage), dtype=torch.long),
        )
        library.hx_surface_evaluate(
            self._compiled.at,
            doubles(voltage.numpy()),
            ffi.new("const double *[]", logs),
            len(voltage),
            doubles(mu.numpy()),
            ffi.from_buffer("int64_t *", status.numpy()),
        )
        for axis, place in each:
            if place is not None and not axis.varies:
                status.masked_fill_(~axis.contains(place), _OUT_OF_RANGE)
        return mu, status

    def _invert(self, wanted: Tensor, *places: Tensor | None) -> tuple[Tensor, Tensor]:
        column, inside = self.axes.blend(places, self.columns, wanted)
        pull_in, breakdown, top = self._ends(*self._log_ends(column))
        tiny = torch.finfo(wanted.dtype).tiny
        target = wanted.clamp(min=tiny**0.5).reciprocal().neg()
        # -1/mu rises along a column and is below 0; the two entries after it are above 0. So a
        # whole row is sorted, and a search through it finds the cell.
        after = torch.searchsorted(column.detach(), target.detach()[:, None], right=True)[:, 0]
        cell = after.sub_(1).clamp_(0, len(self.drive) - 2)
        low, high = self._pair(column, cell)
        # Slope per unit of drive; the least one avoids a division by 0 where a column is flat.
        slope = (high - low).clamp(min=tiny) * self._drive_cells.scale.index_select(0, cell)
        at = self.drive.index_select(0, cell) + (target - low) / slope
        # With this slack rounding does not put the end of a column out of range.
        slack = max(1e-9, 8 * torch.finfo(wanted.dtype).eps) * target
        above = (top - at) * slope < slack
        below = target < column[:, 0] + slack
        status = _small(above) * self._limited_by(pull_in, breakdown, top) + _small(below) * _BELOW
        # At a drive of 0 the root has an infinite gradient: set voltage and gradient to 0.
        driven = at > 0
        root = torch.where(driven, torch.minimum(at, top), 1.0).sqrt()
        voltage = pull_in * torch.where(driven, root, 0.0)
        # Rounding must not take a voltage above the limit.
        return voltage.clamp(max=self.voltage_limit_v), _outside(status, inside)

    def _limited_by(self, pull_in: Tensor, breakdown: Tensor, top: Tensor) -> Tensor:
        """Status of a friction above the end of each column."""
        by_pull_in = _small(top >= PULL_IN_DRIVE * (1 - 1e-6))
        limited = by_pull_in * (_PULL_IN - _ABOVE) + _ABOVE
        if self.limited_by:
            by_breakdown = breakdown <= pull_in * top.sqrt() * (1 + 1e-6)
            by_breakdown.logical_and_(breakdown < self.voltage_limit_v)
            limited += _small(by_breakdown) * (int(self.limited_by) - limited)
        return limited

    def _limits(self, like: Tensor, *places: Tensor | None) -> tuple[Tensor, Tensor]:
        column, _ = self.axes.blend(places, self.columns, like)
        ends = self._log_ends(column)
        pull_in, _, top = self._ends(*ends)
        breakdown = self.unit_v * torch.exp(ends[1])
        return (pull_in * top.sqrt()).clamp(max=self.voltage_limit_v), breakdown

    @staticmethod
    def _log_ends(column: Tensor) -> tuple[Tensor, Tensor]:
        """The last two entries of the columns, contiguous, so that exp is vectorised."""
        return column[:, -2].contiguous(), column[:, -1].contiguous()

    def _ends(
        self, log_pull_in: Tensor, log_breakdown: Tensor | None
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Pull-in voltage [V], breakdown voltage [V], and the drive at which the surface ends."""
        pull_in = self.unit_v * torch.exp(log_pull_in)
        if log_breakdown is None or not self.limited_by:
            end = (self.voltage_limit_v / pull_in).square()
            return pull_in, pull_in, end.clamp(max=self._last_drive)
        breakdown = self.unit_v * torch.exp(log_breakdown)
        end = (breakdown.clamp(max=self.voltage_limit_v) / pull_in).square()
        return pull_in, breakdown, end.clamp(max=self._last_drive)

    def _pair(self, column: Tensor, cell: Tensor) -> tuple[Tensor, Tensor]:
        """Two neighbouring numbers of each column."""
        first = torch.arange(0, column.numel(), column.shape[1], device=cell.device) + cell
        flat = column.reshape(-1)
        return flat.index_select(0, first), flat.index_select(0, first + 1)

    @cached_property
    def _drive_cells(self) -> Cells:
        return Cells.between(self.drive)

    @cached_property
    def _last_drive(self) -> float:
        return float(self.drive[-1])

    @cached_property
    def _slack(self) -> float:
        """Factor by which a value may exceed an end through rounding."""
        return 1 + max(1e-9, 8 * torch.finfo(self.drive.dtype).eps)

    @cached_property
    def _compiled(self) -> Struct:
        """The same for the library in C, with arrays of its own as in `Cells.compiled`."""
        columns = np.array(self.columns.numpy(), order="C")
        axes = [axis.cells.compiled for axis in self.axes if axis.varies]
        return Struct(
            "hx_surface",
            axes=len(axes),
            axis=axes,
            lowest=[log(axis.low * (1 - SLACK)) for axis in self.axes if axis.varies],
            highest=[log(axis.high * (1 + SLACK)) for axis in self.axes if axis.varies],
            drive=self._drive_cells.compiled,
            width=columns.shape[-1],
            columns=columns,
            ends=np.ascontiguousarray(columns[..., -_EXTRA:]),
            unit_v=self.unit_v,
            limit_v=self.voltage_limit_v,
            last_drive=self._last_drive,
            pull_in_drive=PULL_IN_DRIVE,
            limited_by=int(self.limited_by),
        )


def _small(truth: Tensor) -> Tensor:
    """Truth values as bytes, so that statuses are combined at an eighth of their final width."""
    return truth.view(torch.int8)


def _outside(status: Tensor, inside: Tensor) -> Tensor:
    """Put OUT_OF_RANGE where a point is not inside."""
    within = _small(inside)
    return (within * status + (1 - within) * _OUT_OF_RANGE).long()


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
        columns = table.columns.reshape(len(force.nodes), -1)
        return cls(  # with arrays of its own, as in `Cells.compiled`
            np.array(force.nodes.double().cpu().numpy()),
            np.array(table.drive.double().cpu().numpy()),
            np.array(columns.double().cpu().numpy(), order="C"),
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
        ends_by = Status.PULL_IN if end_drive >= self.pull_in_drive * (1 - _NEAR) else Status.ABOVE
        if breakdown_v <= end_v * (1 + _NEAR) and breakdown_v < self.limit_v:
            ends_by = self.limited_by
        lowest_n, highest_n = self.ends_n
        inside = lowest_n <= normal_force_n <= highest_n
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
            lowest_n=self.ends_n[0],
            highest_n=self.ends_n[1],
            limited_by=int(self.limited_by),
        )

    @cached_property
    def _log_force(self) -> Array:
        return np.log(self.force_n)

    @property
    def ends_n(self) -> tuple[float, float]:
        """Lowest and highest force inside [N], with room for rounding."""
        return float(self.force_n[0]) * (1 - SLACK), float(self.force_n[-1]) * (1 + SLACK)
