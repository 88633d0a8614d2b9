"""A recorded path of the finger."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from haptix.errors import InputError

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
        try:
            # Spreadsheets put a byte-order mark before the first name.
            with path.open(newline="", encoding="utf-8-sig") as file:
                rows = list(csv.reader(file, skipinitialspace=True))
        except OSError as error:
            raise InputError(f"cannot read the trajectory {path}: {error.strerror}") from None
        except (UnicodeDecodeError, csv.Error) as error:
            raise InputError(f"{path}: expected a CSV text file, got: {error}") from None
        names = [name.strip() for name in rows[0]] if rows else []
        missing = [name for name in _COLUMNS if names.count(name) != 1]
        if missing:
            raise InputError(
                f"{path}: expected a first line naming {', '.join(_COLUMNS)}, each once; "
                f"missing or repeated: {', '.join(missing)}"
            )
        table = [
            _read_row(path, number, names, row) for number, row in enumerate(rows[1:], 2) if row
        ]
        try:
            return cls(*np.array(table, dtype=float).reshape(-1, len(_COLUMNS)).T)
        except InputError as error:
            raise InputError(f"{path}: {error}") from None

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


def _read_row(path: Path, line: int, names: list[str], row: list[str]) -> list[float]:
    """Numbers of one line, in the order of the columns."""
    if len(row) != len(names):
        why = (
            f"{names[len(row)]} is missing"
            if len(row) < len(names)
            else "decimals need a point, not a comma"
        )
        raise InputError(
            f"{path}, line {line}: expected {len(names)} values, got {len(row)}; {why}"
        )
    values = []
    for name in _COLUMNS:
        text = row[names.index(name)]
        try:
            values.append(float(text))
        except ValueError:
            raise InputError(
                f"{path}, line {line}: {name}: expected a number, got {text!r}"
            ) from None
    return values
