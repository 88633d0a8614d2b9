"""The interpolant of a friction surface: columns of 1/mu, blended, evaluated and inverted."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cached_property
from math import log
from typing import Any

import torch
from torch import Tensor

from haptix.display import Displayed
from haptix.errors import InputError
from haptix.native import Struct, doubles, ffi, library
from haptix.states import broadcast_shape
from haptix.status import Status
from haptix.surface.axes import PULL_IN_DRIVE, SLACK, Axes, Cells
from haptix.threads import one_thread

_BLOCK = 65536  # points; larger blocks gain nothing, and with 8192 calls take half of the time
_LEAST_PER_THREAD = 2 * _BLOCK  # with fewer points a thread's start costs more than it saves

Answer = Callable[..., tuple[Tensor, ...]]
Query = Mapping[str, Any]
"""Values by name of the axis, which broadcast; None for an axis that is left out."""

_EXTRA = 2  # entries of a column after those of mu: ln of the pull-in and breakdown voltage
_OK, _ABOVE, _BELOW = int(Status.OK), int(Status.ABOVE), int(Status.BELOW)
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
        of the model (`haptix.status.LIMITS`) that ends most columns. OK if there is none.
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
        """The same for the library in C."""
        columns = self.columns.contiguous()
        axes = [axis.cells.compiled for axis in self.axes if axis.varies]
        return Struct(
            "hx_surface",
            axes=len(axes),
            axis=axes,
            lowest=[log(axis.low * (1 - SLACK)) for axis in self.axes if axis.varies],
            highest=[log(axis.high * (1 + SLACK)) for axis in self.axes if axis.varies],
            drive=self._drive_cells.compiled,
            width=columns.shape[-1],
            columns=columns.numpy(),
            ends=columns[..., -_EXTRA:].contiguous().numpy(),
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


def in_blocks(answer: Answer, inputs: Sequence[Tensor | None]) -> tuple[Tensor, ...]:
    """Return ``answer(*inputs)``, block by block, on all of torch's threads.

    Inputs are flat tensors of one length, or None; the answer's tensors have that length. With
    autograd or on a GPU there is one block only.
    """
    tensors = [t for t in inputs if t is not None]
    count = len(tensors[0])
    if any(t.requires_grad or t.is_cuda for t in tensors):
        return answer(*inputs)
    if count <= _BLOCK:
        with one_thread():
            return answer(*inputs)

    def part(start: int, stop: int) -> list[Tensor | None]:
        return [None if t is None else t[start:stop] for t in inputs]

    with one_thread():
        first = answer(*part(0, _BLOCK))
    results = tuple(torch.empty(count, dtype=r.dtype, device=r.device) for r in first)
    for result, block in zip(results, first, strict=True):
        result[:_BLOCK] = block

    def work(start: int, stop: int) -> None:
        with one_thread():
            for low in range(start, stop, _BLOCK):
                high = min(low + _BLOCK, stop)
                for result, block in zip(results, answer(*part(low, high)), strict=True):
                    result[low:high] = block

    threads = min(torch.get_num_threads(), count // _LEAST_PER_THREAD)
    if threads < 2:
        work(_BLOCK, count)
        return results
    ends = [_BLOCK + (count - _BLOCK) * i // threads for i in range(threads + 1)]
    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(work, ends[:-1], ends[1:]))
    return results
