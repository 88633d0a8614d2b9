"""CSV files of other instruments: which column is which signal, and in which unit.

A column map is a TOML file::

    schema_version = 1
    skip_rows = 0                 # lines above the header
    delimiter = ","
    [columns]
    t_s = { column = "Time", unit = "ms" }
    normal_force_n = { column = "Fz (mN)", unit = "mN", scale = -1 }   # scale turns a sign
    tangential_force_n = { column = "Fx (mN)", unit = "mN" }
    x_mm = { speed_mm_per_s = 50 }                                     # where no position was kept
    drive_v = { column = "Monitor", unit = "V", scale = 50 }           # 1:50 divider

Where the instrument kept no drive, leave ``drive_v`` out: the planned voltage takes its place. What
was not measured is kept with the recording, and the profile says so.
"""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Annotated, Self

import numpy as np
from pydantic import Field, model_validator

from calibration.parameters import Array
from calibration.recording import SIGNALS
from calibration.segmentation import position_at_speed
from haptix.documents import Document, Part
from haptix.errors import FileFormatError, InputError
from haptix.files import read_text

_FORCE = {"N": 1.0, "mN": 1e-3, "gf": 9.80665e-3, "kgf": 9.80665, "lbf": 4.4482216}
_UNITS = {
    "t_s": {"s": 1.0, "ms": 1e-3, "us": 1e-6},
    "normal_force_n": _FORCE,
    "tangential_force_n": _FORCE,
    "x_mm": {"mm": 1.0, "m": 1e3, "cm": 10.0, "inch": 25.4, "um": 1e-3},
    "drive_v": {"V": 1.0, "mV": 1e-3, "kV": 1e3},
}
_FEWEST_SAMPLES = 8


class CsvColumn(Part):
    """Where one signal comes from.

    Parameters
    ----------
    column : str or None
        Heading of the column, without blanks at its ends; None where there is no column.
    unit : str or None
        Unit of the column: s, ms or us; N, mN, gf, kgf or lbf; mm, m, cm, inch or um; V, mV or kV.
        "raw" keeps the numbers of a signal without a unit.
    scale : float
        Further factor: the gain of a divider, or -1 for a sign.
    speed_mm_per_s : float or None
        For x_mm alone, where no position was kept: constant speed. In a stroke the finger slides
        while the tangential force shows friction; without forces, from the first sample on.
    value : float or None
        Constant value. A constant drive_v is none: the planned voltage takes its place.
    """

    column: str | None = None
    unit: str | None = None
    scale: float = 1.0
    speed_mm_per_s: float | None = None
    value: float | None = None

    @model_validator(mode="after")
    def _comes_from_somewhere(self) -> Self:
        if sum(x is not None for x in (self.column, self.speed_mm_per_s, self.value)) != 1:
            raise ValueError("expected one of column, speed_mm_per_s and value")
        if self.column is not None and self.unit is None:
            raise ValueError(f'expected the unit of column "{self.column}"')
        return self


class ColumnMap(Document):
    """How to read a CSV file: see the module.

    Parameters
    ----------
    columns : mapping of str to CsvColumn
        Keys of `calibration.recording.SIGNALS`, and any others to keep beside them.
    skip_rows : int
        Lines above the headings.
    delimiter : str
        One character.
    """

    skip_rows: Annotated[int, Field(ge=0)] = 0
    delimiter: Annotated[str, Field(min_length=1, max_length=1)] = ","
    columns: dict[str, CsvColumn]

    @model_validator(mode="after")
    def _units_are_known(self) -> Self:
        for name, one in self.columns.items():
            known = [*_UNITS.get(name, ()), "raw"]
            if one.column is not None and one.unit not in known:
                raise ValueError(f"{name}: expected unit {', '.join(known)}, got {one.unit!r}")
            if one.speed_mm_per_s is not None and name != "x_mm":
                raise ValueError(f"{name}: speed_mm_per_s makes a position: x_mm alone may have it")
        if "t_s" not in self.columns:
            raise ValueError("expected t_s among the columns")
        return self

    @property
    def assumed(self) -> tuple[str, ...]:
        """Signals of a recording that no column of the file gives."""
        columns = {name for name, one in self.columns.items() if one.column is not None}
        return tuple(name for name in ("x_mm", "drive_v") if name not in columns)

    def signals(self, path: str | Path) -> dict[str, Array]:
        """Read a CSV file as the signals of a recording; without drive_v where it was not kept.

        Raises
        ------
        FileFormatError, InputError
            As `read`; or if the map lacks a signal.
        """
        missing = [name for name in SIGNALS if name not in (*self.columns, "drive_v")]
        if missing:
            raise InputError(
                f"column map: expected {', '.join(missing)} as well; where the instrument kept no "
                "position give x_mm = { speed_mm_per_s = 50 }"
            )
        found = self.read(path)
        if "drive_v" in self.assumed:
            found.pop("drive_v", None)
        speed = self.columns["x_mm"].speed_mm_per_s
        if speed is not None:
            forces = found["normal_force_n"], found["tangential_force_n"]
            found["x_mm"] = position_at_speed(found["t_s"], *forces, speed)
        return found

    def read(self, path: str | Path) -> dict[str, Array]:
        """Read every mapped signal of a CSV file, in SI units and mm.

        The last line may be cut short, where a recording broke off.

        Raises
        ------
        FileFormatError
            If the file cannot be read, a column is missing or a cell is not a number; the message
            names column and line.
        """
        header, rows = self._rows(path)
        used = [one.column.strip() for one in self.columns.values() if one.column is not None]
        missing = [name for name in used if name not in header]
        if missing:
            raise FileFormatError(
                f"{path}: missing columns {', '.join(map(repr, missing))}; the file has "
                f"{', '.join(map(repr, header))}"
            )
        found: dict[str, Array] = {}
        for name, one in self.columns.items():
            if one.column is not None:
                at = header.index(one.column.strip())
                cells = (row[at] if at < len(row) else "" for row in rows)
                values = [self._number(path, header[at], i, cell) for i, cell in enumerate(cells)]
                unit = _UNITS.get(name, {}).get(one.unit or "raw", 1.0)
                found[name] = np.array(values) * unit * one.scale
        t = found["t_s"]
        for name, one in self.columns.items():
            if one.speed_mm_per_s is not None:
                found[name] = (t - t[0]) * one.speed_mm_per_s
            elif one.value is not None:
                found[name] = np.full(len(t), one.value * one.scale)
        return found

    def _rows(self, path: str | Path) -> tuple[list[str], list[list[str]]]:
        lines = read_text(path).splitlines()[self.skip_rows :]
        try:
            rows = [row for row in csv.reader(lines, delimiter=self.delimiter) if any(row)]
        except csv.Error as error:
            raise FileFormatError(f"{path}: expected a CSV file, got: {error}") from None
        if len(rows) <= _FEWEST_SAMPLES:
            raise FileFormatError(
                f"{path}: expected a line of headings and {_FEWEST_SAMPLES} samples or more, got "
                f"{len(rows)} lines"
            )
        header = [cell.strip() for cell in rows[0]]
        if len(rows[-1]) < len(header):
            rows.pop()
        return header, rows[1:]

    def _number(self, path: str | Path, column: str, index: int, cell: str) -> float:
        try:
            return float(cell)
        except ValueError:
            raise FileFormatError(
                f"{path}, sample {index + 1} (about line {self.skip_rows + 2 + index}): expected a "
                f"number in column {column!r}, got {cell!r}"
            ) from None
