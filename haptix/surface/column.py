"""Friction against voltage at one force, frequency and thickness."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from haptix.checks import Array
from haptix.status import Status

Codes = npt.NDArray[np.int8]
Floats = Any
"""One number, or an array of them where there are several forces."""

PULL_IN_SHARE = 0.9
"""Share of the pull-in voltage at which a surface ends: friction there is some five times that
without voltage, and doubles within the next 5 %."""

PULL_IN_DRIVE = PULL_IN_SHARE**2
"""``(V / V_pull-in)^2`` at which a surface ends."""

_SLACK = 1e-9  # relative; rounding does not put a column's own end out of its range
_LEAST_MU = 1e-150  # frictions of 0 and below have no inverse
_MEDIAN_NODES = 4097  # where the columns of several fingers cross anywhere
_BELOW, _OUT_OF_RANGE = np.int8(Status.BELOW), np.int8(Status.OUT_OF_RANGE)


@dataclass(frozen=True, eq=False)
class Column:
    """Friction against voltage at one force, or at each of several forces.

    Numbers are arrays of shape (forces,) where there are several forces.

    Parameters
    ----------
    drive : ndarray, shape (nodes,)
        Squared voltage ``s = (V / unit_v)^2``, increasing from 0.
    inverse : ndarray, shape (nodes,) or (forces, nodes)
        ``-1/mu`` at each drive, not falling; linear in between.
    unit_v : float
        Amplitude at s = 1 [V]: the pull-in voltage, for a column of a surface.
    end_drive, end_v : float
        Drive, and amplitude [V], at which the column ends.
    ends_by : int
        `Status` of friction above the end: ABOVE (the voltage limit), PULL_IN or BREAKDOWN.
    is_inside : bool
        Whether the force is on the surface's axis.
    """

    drive: Array
    inverse: Array
    unit_v: Floats
    end_drive: Floats
    end_v: Floats
    ends_by: Any
    is_inside: Any = True

    @classmethod
    def median(cls, columns: Sequence[Column]) -> Column:
        """Median friction of several fingers, each at one force, up to the lowest of their ends."""
        if len(columns) == 1:
            return columns[0]
        lowest = min(columns, key=lambda one: float(one.end_v))
        drive = np.linspace(0, 1, _MEDIAN_NODES)
        mu = np.median([one.mu(lowest.end_v * np.sqrt(drive)) for one in columns], axis=0)
        # A median of rising curves rises; this makes it true of the last bit as well.
        inverse = np.maximum.accumulate(-1 / mu)
        return cls(drive, inverse, lowest.end_v, 1.0, lowest.end_v, lowest.ends_by)

    def limited(self, limit_v: float) -> Column:
        """Return the same column, of one force, up to an amplitude [V] at most."""
        if self.end_v <= limit_v:
            return self
        end_drive = (limit_v / self.unit_v) ** 2
        return replace(self, end_drive=end_drive, end_v=limit_v, ends_by=Status.ABOVE)

    @cached_property
    def lowest_mu(self) -> Floats:
        """Friction without voltage."""
        if self.inverse.ndim == 1:
            return -1 / float(self.inverse[0])
        return -1 / self.inverse.T[0]

    @cached_property
    def highest_mu(self) -> Floats:
        """Friction at the end."""
        if self.inverse.ndim == 1:
            return -1 / float(np.interp(self.end_drive, self.drive, self.inverse))
        return -1 / self._inverse_at(self.end_drive)

    def mu(self, voltage_v: Array) -> Array:
        """Friction at amplitudes [V]; above the end, that of the end."""
        drive = np.square(np.minimum(voltage_v, self.end_v) / self.unit_v)
        return np.asarray(-1 / self._inverse_at(drive))

    def voltage(self, mu: Array) -> tuple[Array, Codes]:
        """Amplitudes [V] for frictions, and their status.

        Parameters
        ----------
        mu : ndarray, shape (points,)
            Friction asked for; one value per force where there are several forces.

        Returns
        -------
        voltage_v : ndarray, shape (points,)
            Amplitude of that friction, or of the nearest in the reachable range.
        status : ndarray of int8, shape (points,)
            OK, BELOW, OUT_OF_RANGE or what `ends_by` says.
        """
        goal = -1 / np.maximum(mu, _LEAST_MU)
        drive = np.minimum(self._drive_at(goal), self.end_drive)
        voltage = np.minimum(self.unit_v * np.sqrt(drive), self.end_v)
        # All of these are below 0: the slack widens the range.
        most, least = (_SLACK - 1) / self.highest_mu, -(1 + _SLACK) / self.lowest_mu
        is_one = self.inverse.ndim == 1 and goal.ndim == 1 and goal.size > 0
        if is_one and np.maximum.reduce(goal) <= most and np.minimum.reduce(goal) >= least:
            status: Codes = np.zeros(goal.shape, np.int8)
        else:
            status = (goal > most) * self.ends_by + (goal < least) * _BELOW
        if self.inverse.ndim > 1 or not self.is_inside:
            status = np.where(self.is_inside, status, _OUT_OF_RANGE)
        return voltage, status

    def _inverse_at(self, drive: Floats) -> Any:
        if self.inverse.ndim == 1:
            return np.interp(drive, self.drive, self.inverse)
        cell = np.searchsorted(self.drive[1:-1], drive, side="right")
        low, high = self._ends_of(cell)
        part = (drive - self.drive[cell]) / (self.drive[cell + 1] - self.drive[cell])
        return low + part * (high - low)

    def _drive_at(self, goal: Array) -> Array:
        if self.inverse.ndim == 1:
            return np.asarray(np.interp(goal, self.inverse, self.drive))
        cell = np.count_nonzero(self.inverse[:, 1:-1] <= goal[:, None], axis=1)
        low, high = self._ends_of(cell)
        part = (goal - low) / np.maximum(high - low, 1e-300)
        drive = self.drive[cell] + part * (self.drive[cell + 1] - self.drive[cell])
        return np.asarray(np.maximum(drive, 0.0))

    def _ends_of(self, cell: Any) -> tuple[Array, Array]:
        """Values of ``-1/mu`` at both ends of a cell of each force."""
        at = np.arange(0, self.inverse.size, self.inverse.shape[1]) + cell
        flat = self.inverse.ravel()
        return flat[at], flat[at + 1]
