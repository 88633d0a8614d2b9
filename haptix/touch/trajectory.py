"""A recorded path of the finger."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from haptix.errors import InputError
from haptix.touch.events import TouchEvent
from haptix.touch.table import number_in, read_table

_COLUMNS = ("t_s", "x_mm", "y_mm", "normal_force_n")
Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Trajectory:
    """Touch samples in the order of their times; all arrays have shape (samples,).

    Raises
    ------
    InputError
        If there are fewer than two samples, times do not increase, or a value is not finite or a
        force not above 0.
    """

    t_s: Array
    x_mm: Array
    y_mm: Array
    normal_force_n: Array

    def __post_init__(self) -> None:
        columns = [getattr(self, name) for name in _COLUMNS]
        if len({c.shape for c in columns}) != 1 or columns[0].ndim != 1:
            raise InputError("trajectory: expected four columns of one length")
        if len(self.t_s) < 2:
            raise InputError(
                f"trajectory: expected at least 2 samples, got {len(self.t_s)}; is the file empty?"
            )
        for name, column in zip(_COLUMNS, columns, strict=True):
            bad = ~np.isfinite(column)
            if name == "normal_force_n":
                bad |= column <= 0
            if bad.any():
                row = int(bad.argmax())
                expected = "a force above 0 N" if name == "normal_force_n" else "a finite number"
                raise InputError(
                    f"trajectory: {name} of sample {row + 1}: expected {expected}, "
                    f"got {column[row]:g}"
                )
        late = np.diff(self.t_s) <= 0
        if late.any():
            row = int(late.argmax())
            raise InputError(
                f"trajectory: t_s must increase, but sample {row + 2} at {self.t_s[row + 1]:g} s "
                f"follows {self.t_s[row]:g} s; sort the rows by time"
            )

    @classmethod
    def from_csv(cls, path: str | Path) -> Trajectory:
        """Read a CSV with the columns t_s, x_mm, y_mm and normal_force_n, in any order."""
        path = Path(path)
        table = [
            [number_in(path, line, name, row[name]) for name in _COLUMNS]
            for line, row in read_table(path, "the trajectory", _COLUMNS)
        ]
        try:
            return cls(*np.array(table, dtype=float).reshape(-1, len(_COLUMNS)).T)
        except InputError as error:
            raise InputError(f"{path}: {error}") from None

    def events(self, touch_id: int = 0) -> list[TouchEvent]:
        """Return it as the events of one touch: down, moves, and up at the last place."""
        columns = (self.t_s, self.x_mm, self.y_mm, self.normal_force_n)
        rows = zip(*(column.tolist() for column in columns), strict=True)
        moves = [TouchEvent(t, touch_id, x, y, "move", force) for t, x, y, force in rows]
        return [moves[0]._replace(kind="down"), *moves[1:], moves[-1]._replace(kind="up")]

    @property
    def duration_s(self) -> float:
        """Time from the first to the last sample."""
        return float(self.t_s[-1] - self.t_s[0])

    def at(self, t_s: npt.ArrayLike) -> tuple[Array, Array, Array]:
        """Place x, y [mm] and force [N] at times of any shape, linear between samples."""
        t = np.asarray(t_s, dtype=float)
        x, y, force = (
            np.interp(t, self.t_s, column) for column in (self.x_mm, self.y_mm, self.normal_force_n)
        )
        return x, y, force
