"""The inverse of a surface for the few points of a block."""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass
from math import exp, inf, log, sqrt

import numpy as np
import numpy.typing as npt

from haptix.errors import InputError
from haptix.status import Status
from haptix.surface import FrictionSurface
from haptix.surface.interpolant import PULL_IN_DRIVE
from haptix.texture import Target, as_mu

Array = npt.NDArray[np.float64]
Codes = npt.NDArray[np.int8]

_SLACK = 1e-9  # relative; a target equal to an end's own value is not out of reach by rounding
_ON_AXIS = 1e-6  # relative, as the surface's own
_AVERAGED_NODES = 65  # of a column over the drive: lines between them are within 1e-4
_STEEPEST = 0.05  # of 1/mu without voltage: friction never counts as more than 20 times that


@dataclass(frozen=True, slots=True)
class Wishes:
    """How the numbers of a texture are to be understood.

    Parameters
    ----------
    target : {"mu", "contrast", "share"}
        See `haptix.texture.as_mu`.
    span : (float, float), optional
        Lowest and highest number of the whole texture: if given, and not shares anyway, what is
        between them is squeezed into what can be given. Without it, friction out of reach becomes
        the nearest that can be given.
    """

    target: Target
    span: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        if self.span is not None and not -inf < self.span[0] < self.span[1] < inf:
            raise InputError(f"compress: expected finite low < high, got {self.span!r}")

    def as_mu(self, wish: Array, lowest: Array | float, highest: Array | float) -> Array:
        """Friction coefficients that are wanted where `lowest` to `highest` can be given."""
        wanted: Array = as_mu(self.target, wish, lowest, highest)
        if self.span is None or self.target == "share":
            return wanted
        bottom, top = (as_mu(self.target, edge, lowest, highest) for edge in self.span)
        low, high = np.maximum(bottom, lowest), np.minimum(top, highest)
        # A texture wholly out of reach is left to the nearest end.
        squeezed: Array = low + (wanted - bottom) / (top - bottom) * np.maximum(high - low, 0.0)
        return squeezed


@dataclass(frozen=True, slots=True)
class Amplitudes:
    """What the surface says of a batch of wishes; arrays of their shape."""

    voltage_v: Array
    """Amplitude that gives the wanted friction, or the nearest that can be given."""
    wanted_mu: Array
    """Friction coefficient that was wanted."""
    status: Codes
    """Numbers of `Status`: OK, BELOW, ABOVE, PULL_IN, BREAKDOWN or OUT_OF_RANGE."""


@dataclass(frozen=True, slots=True)
class ForceRow:
    """The surface at one force, frequency and thickness: one column of -1/mu over the drive.

    Parameters
    ----------
    column, drive : ndarray, shape (nodes,)
        -1/mu, not falling, at ``s = (V / V_pull-in)^2``.
    pull_in_v, end : float
        Pull-in voltage, and the s at which the surface ends.
    limited_by : int
        `Status` of friction above what is reached there.
    is_inside : bool
        Whether the force is on the surface's axis.
    """

    column: Array
    drive: Array
    pull_in_v: float
    end: float
    limited_by: int
    is_inside: bool

    @property
    def lowest_mu(self) -> float:
        """Friction without voltage."""
        return -1 / float(self.column[0])

    @property
    def highest_mu(self) -> float:
        """Friction at the end of the surface."""
        return -1 / float(np.interp(self.end, self.drive, self.column))

    def __call__(self, wish: Array, wishes: Wishes) -> Amplitudes:
        """Amplitudes for wishes, shape (points,)."""
        if wishes.target == "mu" and wishes.span is None:
            wanted = wish
        else:
            wanted = wishes.as_mu(wish, self.lowest_mu, self.highest_mu)
        goal = -1 / np.maximum(wanted, 1e-150)
        drive = np.minimum(np.interp(goal, self.column, self.drive), self.end)
        voltage = self.pull_in_v * np.sqrt(drive)
        status = np.zeros(len(goal), dtype=np.int8)
        if not self.is_inside:
            status[:] = Status.OUT_OF_RANGE
        else:
            top = -1 / self.highest_mu
            # Both are below 0: the slack widens the range.
            if goal[goal.argmax()] > top * (1 - _SLACK):
                status[goal > top * (1 - _SLACK)] = self.limited_by
            if goal[goal.argmin()] < self.column[0] * (1 + _SLACK):
                status[goal < self.column[0] * (1 + _SLACK)] = Status.BELOW
        return Amplitudes(voltage, wanted, status)


class SliceInverse:
    """Inverts a surface at one frequency and thickness.

    It gives what `FrictionSurface.voltage` does, by numpy: for the dozen points of a block the
    calls of torch cost several times the arithmetic. `row` is for many wishes at one force, as in
    a block of real time; a call is for a force of its own at each point.

    Parameters
    ----------
    surface : FrictionSurface
        Sliced: frequency and thickness do not vary.
    pulls : ndarray, shape (n,), optional
        Pull at even times of a drive's period over its mean, where friction is to be averaged over
        that period: it rises more than in proportion to the pull, and so is above what the mean
        pull gives. The contact follows within the period. Without it, the pull does not vary.
    peak_per_sine : float
        Peak of the wave over the amplitude of the sine that pulls as much.

    Raises
    ------
    InputError
        If frequency or thickness vary.
    """

    def __init__(
        self, surface: FrictionSurface, pulls: Array | None = None, peak_per_sine: float = 1.0
    ) -> None:
        if surface.frequency_hz.varies or surface.h0_m.varies:
            raise InputError("surface: expected one frequency and h0; slice it with surface.at()")
        table = surface.table
        columns = table.columns[:, 0, 0].double().cpu().numpy()
        force = table.axes[0].nodes.double().cpu().numpy()
        if len(force) == 1:  # a cell of any width between two equal columns
            columns, force = columns.repeat(2, axis=0), force * np.array([1.0, np.e])
        self._least_n = float(table.axes[0].low) * (1 - _ON_AXIS)
        self._most_n = float(table.axes[0].high) * (1 + _ON_AXIS)
        self._log_force = np.log(force)
        self._inner = self._log_force[1:-1]
        self._inner_list = self._inner.tolist()
        self._per_log = 1 / np.diff(self._log_force)
        self._drive = table.drive.double().cpu().numpy()
        self._pull_in_drive = PULL_IN_DRIVE
        if pulls is not None:
            self._pull_in_drive /= float(pulls.max())
            self._drive, columns = _averaged(self._drive, columns, pulls, self._pull_in_drive)
        self._first, self._step = columns[:-1], np.diff(columns, axis=0)
        self._width = np.diff(self._drive)
        self._unit_v = table.unit_v
        self._limit_v = table.voltage_limit_v / max(peak_per_sine, 1.0)
        self._ends_at_breakdown = table.ends_at_breakdown
        self._last = (-1.0, self._row(float(force[0])))

    def row(self, normal_force_n: float) -> ForceRow:
        """The surface at one force [N], finite and above 0; the last one is kept."""
        if self._last[0] != normal_force_n:
            self._last = (normal_force_n, self._row(normal_force_n))
        return self._last[1]

    def _row(self, normal_force_n: float) -> ForceRow:
        log_force = log(normal_force_n)
        cell = bisect_right(self._inner_list, log_force)
        part = (log_force - float(self._log_force[cell])) * float(self._per_log[cell])
        column = self._first[cell] + min(max(part, 0.0), 1.0) * self._step[cell]
        pull_in = self._unit_v * exp(column[-2])
        breakdown = self._unit_v * exp(column[-1]) if self._ends_at_breakdown else self._limit_v
        end = min((min(breakdown, self._limit_v) / pull_in) ** 2, float(self._drive[-1]))
        last_v = pull_in * sqrt(end) * (1 + 1e-6)
        if self._ends_at_breakdown and breakdown <= last_v < self._limit_v:
            limited_by = Status.BREAKDOWN
        elif end >= self._pull_in_drive * (1 - 1e-6):
            limited_by = Status.PULL_IN
        else:
            limited_by = Status.ABOVE
        inside = self._least_n <= normal_force_n <= self._most_n
        return ForceRow(column[:-2], self._drive, pull_in, end, int(limited_by), inside)

    def __call__(self, normal_force_n: Array, wish: Array, wishes: Wishes) -> Amplitudes:
        """Amplitudes for wishes at forces.

        Parameters
        ----------
        normal_force_n, wish : ndarray, shape (points,)
            Finite; forces above 0.
        wishes : Wishes
            What the wishes are.
        """
        rows, pull_in, breakdown, end = self._columns(normal_force_n)
        highest = self._at_drive(rows, end)
        wanted = wishes.as_mu(wish, -1 / rows[:, 0], highest)
        goal = -1 / np.maximum(wanted, 1e-150)
        low = np.count_nonzero(rows[:, 1:-1] <= goal[:, None], axis=1)
        at = np.arange(0, rows.size, rows.shape[1]) + low
        flat = rows.ravel()
        slope = np.maximum(flat[at + 1] - flat[at], 1e-300) / self._width[low]
        drive = (self._drive[low] + (goal - flat[at]) / slope).clip(0.0, end)
        status = np.zeros(len(goal), dtype=np.int8)
        above = goal > (1 - _SLACK) * -1 / highest
        if above.any():
            status[above] = self._limited_by(pull_in, breakdown, end)[above]
        status[goal < rows[:, 0] * (1 + _SLACK)] = Status.BELOW
        status[(normal_force_n < self._least_n) | (normal_force_n > self._most_n)] = (
            Status.OUT_OF_RANGE
        )
        return Amplitudes(np.minimum(pull_in * np.sqrt(drive), self._limit_v), wanted, status)

    def reachable(self, normal_force_n: Array) -> tuple[Array, Array]:
        """Lowest and highest friction at forces, shape (points,)."""
        rows, _, _, end = self._columns(normal_force_n)
        return -1 / rows[:, 0], self._at_drive(rows, end)

    def _columns(self, normal_force_n: Array) -> tuple[Array, Array, Array, Array]:
        """Column of -1/mu, pull-in and breakdown voltage, and last drive, at each force."""
        log_force = np.log(normal_force_n)
        cell = np.searchsorted(self._inner, log_force, side="right")
        part = ((log_force - self._log_force[cell]) * self._per_log[cell]).clip(0.0, 1.0)
        column = self._first[cell] + part[:, None] * self._step[cell]
        pull_in, breakdown = self._unit_v * np.exp(column[:, -2:]).T
        last_v = np.minimum(breakdown, self._limit_v) if self._ends_at_breakdown else self._limit_v
        end = np.minimum((last_v / pull_in) ** 2, self._drive[-1])
        return column[:, :-2], pull_in, breakdown, end

    def _at_drive(self, rows: Array, drive: Array) -> Array:
        """Friction at one drive of each row."""
        low = np.searchsorted(self._drive[1:-1], drive, side="right")
        at = np.arange(0, rows.size, rows.shape[1]) + low
        flat = rows.ravel()
        part = (drive - self._drive[low]) / self._width[low]
        friction: Array = -1 / (flat[at] + part * (flat[at + 1] - flat[at]))
        return friction

    def _limited_by(self, pull_in: Array, breakdown: Array, end: Array) -> Codes:
        """Status of friction above what each row reaches."""
        status = np.where(end >= self._pull_in_drive * (1 - 1e-6), Status.PULL_IN, Status.ABOVE)
        if self._ends_at_breakdown:
            last_v = pull_in * np.sqrt(end) * (1 + 1e-6)
            broken = (breakdown <= last_v) & (last_v < self._limit_v)
            status = np.where(broken, Status.BREAKDOWN, status)
        return status.astype(np.int8)


def _averaged(drive: Array, columns: Array, pulls: Array, end: float) -> tuple[Array, Array]:
    """Columns of -1/mu for friction that is averaged over a period, and their drives.

    Within the period the drive reaches beyond its mean, at the end of a column beyond the last
    node. There the column goes on as a straight line: the closed form ``1/mu ~ 1 - s`` is one.
    """
    last = min(end, float(drive[-1]))
    nodes = np.linspace(0.0, last, _AVERAGED_NODES)
    at = nodes[:, None] * pulls
    beyond = np.maximum(at - drive[-1], 0.0)
    rows = []
    for column in columns:
        slope = (column[-3] - column[-4]) / (drive[-1] - drive[-2])
        inverse = np.interp(at, drive, column[:-2]) + slope * beyond
        # Pull-in bounds the drive, so that friction stays finite; so it does where lines bend.
        friction = (-1 / np.minimum(inverse, _STEEPEST * column[0])).mean(axis=1)
        rows.append(np.concatenate([-1 / friction, column[-2:]]))
    return nodes, np.array(rows)
