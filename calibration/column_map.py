"""CSV files of other people's instruments: which column is what, and in which unit.

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
"""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Annotated, Self

import numpy as np
from pydantic import Field, model_validator

from calibration.parameters import Array
from calibration.protocol import Stroke
from calibration.recording import SIGNALS, Conditions, StrokeRecording
from haptix.documents import Document, Part
from haptix.errors import FileFormatError, InputError

_UNITS = {
    "t_s": {"s": 1.0, "ms": 1e-3, "us": 1e-6},
    "normal_force_n": {"N": 1.0, "mN": 1e-3, "gf": 9.80665e-3, "kgf": 9.80665, "lbf": 4.4482216},
    "x_mm": {"mm": 1.0, "m": 1e3, "cm": 10.0, "um": 1e-3},
    "drive_v": {"V": 1.0, "mV": 1e-3, "kV": 1e3},
}
_UNITS["tangential_force_n"] = _UNITS["normal_force_n"]


class Column(Part):
    """Where one signal comes from.

    Parameters
    ----------
    column : str or None
        Heading of the column, blanks at its ends not counted; None where the signal is made up.
    unit : str or None
        Unit of the column: s, ms or us; N, mN, gf, kgf or lbf; mm, m, cm or um; V, mV or kV. "raw"
        leaves a signal without a unit as it is.
    scale : float
        Factor on top: the gain of a divider, or -1 for a sign.
    speed_mm_per_s : float or None
        For x_mm alone: slides at this speed from the first sample, since no position was kept.
    value : float or None
        The same value throughout, such as 0 V.
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
    columns : mapping of str to Column
        Keys of `calibration.recording.SIGNALS`, and any others that shall be kept beside them.
    skip_rows : int
        Lines above the headings.
    delimiter : str
        One character.
    """

    skip_rows: Annotated[int, Field(ge=0)] = 0
    delimiter: Annotated[str, Field(min_length=1, max_length=1)] = ","
    columns: dict[str, Column]

    @model_validator(mode="after")
    def _units_are_known(self) -> Self:
        for name, one in self.columns.items():
            known = _UNITS.get(name, {})
            if one.column is not None and one.unit != "raw" and one.unit not in known:
                raise ValueError(
                    f"{name}: expected unit {', '.join([*known, 'raw'])}, got {one.unit!r}"
                )
            if one.speed_mm_per_s is not None and name != "x_mm":
                raise ValueError(f"{name}: speed_mm_per_s makes a position: x_mm alone may have it")
        if "t_s" not in self.columns:
            raise ValueError("expected t_s among the columns")
        return self

    def read(self, path: str | Path) -> dict[str, Array]:
        """Read every mapped signal of a CSV file, in SI units and mm.

        Raises
        ------
        FileFormatError
            If the file cannot be read, a column is missing or a cell is no number; the message
            names column and line.
        """
        path = Path(path)
        header, rows = self._rows(path)
        table = _numbers(path, header, rows, self._used(path, header), self.skip_rows + 2)
        found: dict[str, Array] = {}
        for name, one in self.columns.items():
            if one.column is not None:
                factor = 1.0 if one.unit == "raw" else _UNITS[name][one.unit or ""]
                found[name] = table[one.column.strip()] * factor * one.scale
        t = found["t_s"]
        for name, one in self.columns.items():
            if one.speed_mm_per_s is not None:
                found[name] = (t - t[0]) * one.speed_mm_per_s
            elif one.value is not None:
                found[name] = np.full(len(t), one.value * one.scale)
        return found

    def recording(
        self, path: str | Path, stroke: Stroke, conditions: Conditions | None = None
    ) -> StrokeRecording:
        """Read a CSV file as the recording of a planned stroke.

        Raises
        ------
        FileFormatError, InputError
            As `read`; or if the map leaves a signal out.
        """
        missing = [name for name in SIGNALS if name not in self.columns]
        if missing:
            raise InputError(
                f"column map: expected {', '.join(missing)} as well; where the instrument kept no "
                "position give speed_mm_per_s, where it kept no drive give value = 0"
            )
        found = self.read(path)
        return StrokeRecording.of(stroke, found, conditions)

    def _rows(self, path: Path) -> tuple[list[str], list[list[str]]]:
        try:
            with path.open(encoding="utf-8-sig", newline="") as file:
                lines = list(csv.reader(file, delimiter=self.delimiter))[self.skip_rows :]
        except OSError as error:
            raise FileFormatError(f"cannot read {path}: {error.strerror}") from None
        except (UnicodeDecodeError, csv.Error) as error:
            raise FileFormatError(f"{path}: expected a CSV file, got: {error}") from None
        lines = [line for line in lines if any(cell.strip() for cell in line)]
        if len(lines) < 9:
            raise FileFormatError(
                f"{path}: expected a line of headings and 8 samples or more, got {len(lines)} lines"
            )
        return [cell.strip() for cell in lines[0]], lines[1:]

    def _used(self, path: Path, header: list[str]) -> list[str]:
        used = [one.column.strip() for one in self.columns.values() if one.column is not None]
        missing = [name for name in used if name not in header]
        if missing:
            raise FileFormatError(
                f"{path}: missing columns {', '.join(map(repr, missing))}; the file has "
                f"{', '.join(map(repr, header))}"
            )
        return used


def _numbers(
    path: Path, header: list[str], rows: list[list[str]], used: list[str], first_line: int
) -> dict[str, Array]:
    """Return the used columns; the last line may be cut short, where a recording broke off."""
    if len(rows[-1]) < len(header):
        rows = rows[:-1]
    found = {}
    for name in used:
        at = header.index(name)
        values = np.empty(len(rows))
        for index, row in enumerate(rows):
            try:
                values[index] = float(row[at])
            except (IndexError, ValueError):
                got = repr(row[at]) if at < len(row) else "nothing"
                raise FileFormatError(
                    f"{path}, sample {index + 1} (about line {first_line + index}): expected a "
                    f"number in column {name!r}, got {got}"
                ) from None
        found[name] = values
    return found
