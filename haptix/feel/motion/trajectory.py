"""The finger's path: place and normal force against time."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from numbers import Real
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np
import numpy.typing as npt

from haptix.base.checks import Array, increasing, row
from haptix.base.display import Table, axes_or_new
from haptix.base.errors import InputError
from haptix.base.fields import HARDEST_N
from haptix.base.files import read_csv

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FARTHEST_MM = 1e6
"""Places farther from the origin than this are not on a screen."""

STANDING_BELOW_MM_PER_S = 0.1
"""A slower finger counts as standing: its friction takes more than 0.1 s to follow the voltage."""

VELOCITY_OVER_S = 0.01
"""The velocity of a recorded path is the mean over this time. This averages the noise of touches,
and a hand's velocity changes little in 10 ms."""

_COLUMNS = ("t_s", "x_mm", "y_mm", "normal_force_n")


@dataclass(frozen=True)
class Trajectory(Table):
    """Place and normal force of a finger against time; linear between samples.

    Parameters
    ----------
    t_s : ndarray, shape (samples,)
        Times [s], increasing; two or more.
    x_mm, y_mm : ndarray, shape (samples,)
        Place on the screen [mm].
    normal_force_n : ndarray, shape (samples,)
        Normal force [N]; 0 where the finger is lifted.

    Raises
    ------
    InputError
        If lengths differ, a value is not finite, times do not increase, a force is negative or a
        place lies beyond `FARTHEST_MM`.

    Examples
    --------
    >>> path = Trajectory([0.0, 1.0], [0.0, 50.0], [5.0, 5.0], [0.5, 0.5])
    >>> x_mm, y_mm, normal_force_n = path.at(0.2)
    >>> float(x_mm)
    10.0
    """

    t_s: Array
    x_mm: Array
    y_mm: Array
    normal_force_n: Array

    def __post_init__(self) -> None:
        try:
            object.__setattr__(self, "t_s", increasing("t_s", self.t_s, 2))
        except InputError as error:
            raise InputError(f"{error}; sort the path by time") from None
        count = len(self.t_s)
        for name in _COLUMNS[1:]:
            column = row(name, getattr(self, name))
            if len(column) != count:
                raise InputError(
                    f"{name}: expected one value for each of the {count} times, got {len(column)}"
                )
            object.__setattr__(self, name, column)
        for name in ("x_mm", "y_mm"):
            farthest = float(np.abs(getattr(self, name)).max())
            if farthest > FARTHEST_MM:
                raise InputError(
                    f"{name}: expected places on a screen, within {FARTHEST_MM:g} mm, got "
                    f"{farthest:g} mm"
                )
        high = self.normal_force_n > HARDEST_N
        if high.any():
            expected = f"a finger's force, {HARDEST_N:g} N at most"
            raise _bad_force(expected, self.normal_force_n, high)
        if self.normal_force_n.min() < 0:
            raise _bad_force("0 N (lifted) or more", self.normal_force_n, self.normal_force_n < 0)

    @classmethod
    def of(
        cls,
        t_s: npt.ArrayLike,
        x_mm: npt.ArrayLike,
        y_mm: npt.ArrayLike,
        normal_force_n: npt.ArrayLike,
    ) -> Self:
        """Make a path of sequences; x, y and force may be one number for all times.

        Parameters
        ----------
        t_s : array-like, shape (n,)
            Times [s], increasing.
        x_mm, y_mm : array-like
            Places [mm], of the times' shape or one number for all.
        normal_force_n : array-like
            Normal forces [N], likewise.

        Examples
        --------
        >>> path = Trajectory.of([0.0, 1.0], [0.0, 50.0], 20.0, 0.5)
        >>> path.y_mm.tolist()
        [20.0, 20.0]
        """
        time = row("t_s", t_s)
        columns: tuple[Any, ...] = (x_mm, y_mm, normal_force_n)
        return cls(time, *(np.full(len(time), c) if isinstance(c, Real) else c for c in columns))

    @classmethod
    def from_csv(cls, path: str | Path) -> Self:
        """Read a CSV with the columns t_s, x_mm, y_mm and normal_force_n, in any order.

        The finger is lifted where the force is 0.

        Raises
        ------
        FileFormatError
            If the file is not such a table.
        InputError
            If its numbers are not a path, or the finger never touches.

        Examples
        --------
        >>> from haptix.play import FINGER_PATH
        >>> bool(Trajectory.from_csv(FINGER_PATH).duration_s > 1.0)
        True
        """
        table = [[line.number(name) for name in _COLUMNS] for line in read_csv(path, _COLUMNS)]
        try:
            read = cls(*np.array(table, dtype=float).reshape(-1, len(_COLUMNS)).T)
            force = read.normal_force_n
            if force.max() <= 0:
                raise _bad_force("a force above 0 N somewhere", force, force == force.max())
        except InputError as error:
            raise InputError(f"{path}: {error}") from None
        return read

    @property
    def duration_s(self) -> float:
        """Time from the first to the last sample [s].

        Examples
        --------
        >>> Trajectory.of([1.0, 4.0], [0.0, 30.0], 20.0, 0.5).duration_s
        3.0
        """
        return float(self.t_s[-1] - self.t_s[0])

    def at(self, t_s: npt.ArrayLike) -> tuple[Array, Array, Array]:
        """Place x, y [mm] and normal force [N] at times of any shape.

        Examples
        --------
        >>> x, y, force = Trajectory.of([0.0, 1.0], [0.0, 50.0], 20.0, 0.5).at(0.5)
        >>> float(x), float(force)
        (25.0, 0.5)
        """
        time = np.asarray(t_s, dtype=float)
        columns = (self.x_mm, self.y_mm, self.normal_force_n)
        x, y, force = (np.interp(time, self.t_s, column) for column in columns)
        return x, y, force

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the path over the screen, y down, into axes of matplotlib or new ones; return them.

        The colour is the normal force.
        """
        ax = axes_or_new(ax)
        points = ax.scatter(self.x_mm, self.y_mm, c=self.normal_force_n, s=6)
        assert ax.figure is not None
        ax.figure.colorbar(points, ax=ax, label="normal force (N)")
        ax.set(xlabel="x on the screen (mm)", ylabel="y (mm)")
        ax.yaxis.set_inverted(True)
        return ax

    def distance_mm(self, t_s: npt.ArrayLike) -> Array:
        """Distance slid since the first sample [mm], at times of any shape.

        Examples
        --------
        >>> path = Trajectory.of([0.0, 1.0, 2.0], [0.0, 30.0, 0.0], 20.0, 0.5)  # there and back
        >>> float(path.distance_mm(2.0))
        60.0
        """
        slid = np.concatenate([[0.0], np.cumsum(self._steps_mm)])
        return np.asarray(np.interp(np.asarray(t_s, dtype=float), self.t_s, slid))

    def speed_mm_per_s(self, t_s: npt.ArrayLike) -> Array:
        """Sliding speed [mm/s] at times of any shape: constant between two samples.

        Examples
        --------
        >>> path = Trajectory.of([0.0, 1.0], [0.0, 30.0], [0.0, 40.0], 0.5)
        >>> round(float(path.speed_mm_per_s(0.5)), 6)
        50.0
        """
        speed = self._steps_mm / np.diff(self.t_s)
        segment = np.searchsorted(self.t_s[1:-1], np.asarray(t_s, dtype=float), side="right")
        return np.asarray(speed[segment])

    def velocity_mm_per_s(self, t_s: npt.ArrayLike) -> tuple[Array, Array]:
        """Velocity along x and y [mm/s] at times of any shape: the mean over 10 ms around each.

        Examples
        --------
        >>> path = Trajectory.of([0.0, 1.0], [0.0, 30.0], [0.0, 40.0], 0.5)
        >>> x, y = path.velocity_mm_per_s(0.5)
        >>> round(float(x), 6), round(float(y), 6)
        (30.0, 40.0)
        """
        time = np.asarray(t_s, dtype=float)
        before, after = (
            self.at(time + half) for half in (-VELOCITY_OVER_S / 2, VELOCITY_OVER_S / 2)
        )
        vx, vy = ((b - a) / VELOCITY_OVER_S for a, b in zip(before[:2], after[:2], strict=True))
        return vx, vy

    @cached_property
    def _steps_mm(self) -> Array:
        return np.hypot(np.diff(self.x_mm), np.diff(self.y_mm))


def _bad_force(expected: str, force_n: Array, bad: npt.NDArray[np.bool_]) -> InputError:
    i = int(bad.argmax())
    return InputError(f"normal_force_n: expected {expected}, got {force_n[i]:g} in sample {i + 1}")
