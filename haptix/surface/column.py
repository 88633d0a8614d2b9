"""Friction against voltage at one force, frequency and thickness."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from haptix.checks import Array
from haptix.status import Status

Codes = npt.NDArray[np.int8]

PULL_IN_SHARE = 0.9
"""Share of the pull-in voltage at which a surface ends: friction there is some five times that
without voltage, and doubles within the next 5 %."""

PULL_IN_DRIVE = PULL_IN_SHARE**2
"""``(V / V_pull-in)^2`` at which a surface ends."""

_SLACK = 1e-9  # relative; rounding does not put a column's own end out of its range
_LEAST_MU = 1e-150  # frictions of 0 and below have no inverse
_MEDIAN_NODES = 4097  # where the columns of several fingers cross anywhere


@dataclass(frozen=True, eq=False)
class Column:
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
        That of friction above the end: ABOVE (the voltage limit), PULL_IN or BREAKDOWN.
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
        lowest = min(columns, key=lambda one: float(one.end_v))
        drive = np.linspace(0, 1, _MEDIAN_NODES)
        mu = np.median([one.mu(lowest.end_v * np.sqrt(drive)) for one in columns], axis=0)
        # A median of rising curves rises; this makes it true of the last bit as well.
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
            Amplitude of that friction, or of the nearest in the reachable range.
        status : ndarray of int8, shape (points,)
            OK, BELOW, OUT_OF_RANGE or what `ends_by` says.
        """
        goal = -1 / np.maximum(mu, _LEAST_MU)
        drive = np.minimum(np.interp(goal, self.inverse, self.drive), self.end_drive)
        voltage = np.minimum(self.unit_v * np.sqrt(drive), self.end_v)
        if not self.is_inside:
            return voltage, np.full(goal.shape, Status.OUT_OF_RANGE, np.int8)
        # All of these are below 0: the slack widens the range.
        most, least = (_SLACK - 1) / self.highest_mu, -(1 + _SLACK) / self.lowest_mu
        status = (goal > most) * np.int8(self.ends_by) + (goal < least) * np.int8(Status.BELOW)
        return voltage, status
