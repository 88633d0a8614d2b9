"""The finger's true path: place, force and slid distance at any time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
import numpy.typing as npt

from haptix.errors import InputError
from haptix.friction import HIGHEST_FORCE_N

Array = npt.NDArray[np.float64]

STANDING_BELOW_MM_PER_S = 0.1
"""Slower than this the finger stands: its response would take longer than a tenth of a second."""

LIFTED_BELOW_N = 1e-3
"""Below this normal force the finger does not touch."""


FARTHEST_MM = 1e5
"""Beyond any screen; farther places are a mistake."""


@dataclass(frozen=True)
class FingerPath:
    """Where the finger is, linear between samples; arrays of shape (samples,).

    Parameters
    ----------
    t_s : ndarray
        Times [s], increasing.
    x_mm, y_mm : ndarray
        Place on the screen [mm].
    normal_force_n : ndarray
        Normal force [N], 0 where the finger is lifted.
    """

    t_s: Array
    x_mm: Array
    y_mm: Array
    normal_force_n: Array

    @classmethod
    def checked(
        cls,
        t_s: npt.ArrayLike,
        x_mm: npt.ArrayLike,
        y_mm: npt.ArrayLike,
        normal_force_n: npt.ArrayLike,
    ) -> Self:
        """Take what a caller gives; x, y and force may be single numbers.

        Raises
        ------
        InputError
            If there are fewer than two samples, lengths differ, times do not increase, a value is
            not finite, or a force is negative or above `HIGHEST_FORCE_N`.
        """
        time = numbers("t_s", t_s)
        if len(time) < 2:
            raise InputError(f"t_s: expected 2 or more times of the finger's path, got {len(time)}")
        columns = {"x_mm": x_mm, "y_mm": y_mm, "normal_force_n": normal_force_n}
        given = {name: numbers(name, column) for name, column in columns.items()}
        for name, column in given.items():
            if len(column) not in (1, len(time)):
                raise InputError(
                    f"{name}: expected one value for each of the {len(time)} times, or one for "
                    f"all, got {len(column)}"
                )
        for name in ("x_mm", "y_mm"):
            farthest = float(np.abs(given[name]).max())
            if farthest > FARTHEST_MM:
                raise InputError(
                    f"{name}: expected places on a screen, within {FARTHEST_MM:g} mm, got "
                    f"{farthest:g} mm"
                )
        late = np.diff(time) <= 0
        if late.any():
            at = int(late.argmax())
            raise InputError(
                f"t_s: expected times that increase, but {time[at + 1]:g} s follows {time[at]:g} s;"
                " sort the path by time"
            )
        force = given["normal_force_n"]
        if force.min() < 0 or force.max() > HIGHEST_FORCE_N:
            bad = force[(force < 0) | (force > HIGHEST_FORCE_N)][0]
            raise InputError(
                f"normal_force_n: expected 0 (lifted) to {HIGHEST_FORCE_N:g} N, got {bad:g} N"
            )
        return cls(time, *(np.broadcast_to(column, time.shape) for column in given.values()))

    @property
    def duration_s(self) -> float:
        """Time from the first to the last sample."""
        return float(self.t_s[-1] - self.t_s[0])

    def at(self, t_s: Array) -> tuple[Array, Array, Array]:
        """Place x, y [mm] and force [N] at times [s]."""
        columns = (self.x_mm, self.y_mm, self.normal_force_n)
        x, y, force = (np.interp(t_s, self.t_s, column) for column in columns)
        return x, y, force

    def distance_mm(self, t_s: Array) -> Array:
        """Distance slid since the path began [mm], at times [s]."""
        slid = np.concatenate([[0.0], np.cumsum(self._steps_mm)])
        return np.asarray(np.interp(t_s, self.t_s, slid))

    def speed_mm_per_s(self, t_s: Array) -> Array:
        """Sliding speed [mm/s] at times [s]: constant between the path's samples."""
        speed = self._steps_mm / np.diff(self.t_s)
        segment = np.searchsorted(self.t_s[1:-1], t_s, side="right")
        return np.asarray(speed[segment])

    @property
    def _steps_mm(self) -> Array:
        return np.hypot(np.diff(self.x_mm), np.diff(self.y_mm))


def numbers(name: str, value: npt.ArrayLike) -> Array:
    """Return finite numbers of shape (samples,), or raise `InputError` that names them."""
    try:
        array = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f"{name}: expected numbers, got {value!r:.80}") from None
    if array.ndim == 0:
        array = array[None]
    if array.ndim != 1:
        raise InputError(f"{name}: expected an array of one axis, got shape {array.shape}")
    bad = ~np.isfinite(array)
    if bad.any():
        at = int(bad.argmax())
        raise InputError(f"{name}: expected finite numbers, got {array[at]:g} at index {at}")
    return array
