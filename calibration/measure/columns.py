"""Column maps: which column of an instrument's file is which signal, in which unit."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Self

import numpy as np
from pydantic import Field, PositiveFloat, model_validator
from scipy.interpolate import CubicSpline

from calibration.measure.clocks import even_times
from calibration.measure.recording import SIGNALS
from calibration.measure.segmentation import position_at_speed
from calibration.plan.parameters import Array
from haptix.base.documents import Document, Part
from haptix.base.errors import FileFormatError, InputError
from haptix.base.tables import FEWEST_SAMPLES, TIMES_S, LabTable, read_table, split_unit

SUFFIXES = (".csv", ".txt", ".tsv", ".dat", ".lvm", ".tdms")
"""Ends of the names of files that are looked for."""

_FORCE = {"N": 1.0, "mN": 1e-3, "gf": 9.80665e-3, "kgf": 9.80665, "lbf": 4.4482216}
_UNITS = {
    "t_s": TIMES_S,
    "normal_force_n": _FORCE,
    "tangential_force_n": _FORCE,
    "x_mm": {"mm": 1.0, "m": 1e3, "cm": 10.0, "inch": 25.4, "um": 1e-3},
    "drive_v": {"V": 1.0, "mV": 1e-3, "kV": 1e3},
}
_LEAST_SHARE = 0.9  # of the samples: a channel with fewer has a rate of its own
_GROUPS = ("group", "segment")  # columns of a file of several parts, see `haptix.base.tables`


class CsvColumn(Part):
    """Where one signal comes from."""

    column: str | None = None
    """Heading of the column, without blanks at its ends; None where there is no column."""
    unit: str | None = None
    """Unit of the column: s, ms, us, ns, min, h, or samples of a known rate; N, mN, gf, kgf or lbf;
    mm, m, cm, inch or um; V, mV or kV. "raw" keeps the numbers of a signal without a unit. By
    default that of the file."""
    scale: float = 1.0
    """Further factor: the gain of a divider, or -1 for a sign."""
    speed_mm_per_s: float | None = None
    """For x_mm alone, where no position was kept: constant speed. In a stroke the finger slides
    while the tangential force shows friction; without forces, from the first sample on."""
    value: float | None = None
    """Constant value. A constant drive_v is none: the planned voltage takes its place."""
    file: str | None = None
    """Rest of the name of another file, such as "-position.csv" beside ``stroke-001.csv``."""
    time: str | None = None
    """Its column of times; times of day are compared with those of the first file."""
    time_unit: str | None = None
    """Unit of its times, as of ``t_s``. By default that of the file."""
    rate_hz: PositiveFloat | None = None
    """Its samples per second, where it has no times: both files begin together."""

    @model_validator(mode="after")
    def _comes_from_somewhere(self) -> Self:
        if sum(x is not None for x in (self.column, self.speed_mm_per_s, self.value)) != 1:
            raise ValueError("expected one of column, speed_mm_per_s and value")
        if self.time_unit is not None and self.time_unit not in TIMES_S:
            expected = ", ".join(TIMES_S)
            raise ValueError(f"time_unit: expected {expected}, got {self.time_unit!r}")
        if self.file is not None and ("/" in self.file or "\\" in self.file):
            raise ValueError(f"file: expected the rest of a name, got {self.file!r}")
        return self


class Gauges(Part):
    """Forces and torques of a transducer by the voltages of its strain gauges."""

    columns: Annotated[tuple[str, ...], Field(min_length=2)]
    """Columns of the voltages [V]."""
    matrix: Annotated[tuple[tuple[float, ...], ...], Field(min_length=2)]
    """Working matrix of the transducer's certificate: a row for each of `axes`, in `unit` per
    volt."""
    axes: tuple[str, ...] = ("Fx", "Fy", "Fz", "Tx", "Ty", "Tz")
    """Names by which the map's columns call them."""
    unit: str = "N"
    """Of the forces."""

    @model_validator(mode="after")
    def _fits(self) -> Self:
        shape = {len(row) for row in self.matrix}
        if shape != {len(self.columns)} or len(self.matrix) != len(self.axes):
            raise ValueError(
                f"matrix: expected {len(self.axes)} rows of {len(self.columns)} numbers: one for "
                f"each of {', '.join(self.axes)}"
            )
        return self

    def added(self, table: LabTable) -> LabTable:
        """Return a table with the axes as further columns."""
        names = [table.named(name) or name for name in self.columns]
        volts = np.stack([table.columns[name] for name in names])
        axes = dict(zip(self.axes, np.array(self.matrix) @ volts, strict=True))
        units = {**table.units, **dict.fromkeys(self.axes, self.unit)}
        times = dict(table.times_s)
        if names[0] in times:
            times |= dict.fromkeys(self.axes, times[names[0]])
        return replace(table, columns={**table.columns, **axes}, units=units, times_s=times)


class ColumnMap(Document):
    """How to read a file of another instrument: which column is which signal, in which unit.

    A column map is a TOML file; ``haptix calibrate columns FILE`` proposes one::

        schema_version = 1
        [columns]
        t_s = { column = "Time", unit = "ms" }
        normal_force_n = { column = "Fz (mN)", unit = "mN", scale = -1 }   # scale turns a sign
        tangential_force_n = { column = "Fx (mN)", unit = "mN" }
        x_mm = { speed_mm_per_s = 50 }                          # where no position was kept
        drive_v = { column = "Monitor", unit = "V", scale = 50 }           # 1:50 divider

    Where the instrument kept no drive, leave ``drive_v`` out: the planned voltage takes its place.
    A quantity that was not measured is noted in the recording and in the profile. A second file of
    another rate, and a transducer whose gauges were recorded::

        rate_hz = 10000                                         # where there are no times
        [columns]
        normal_force_n = { column = "Fz" }                      # an axis of the gauges
        x_mm = { column = "pos", unit = "mm", file = "-stage.csv", rate_hz = 100 }
        [gauges]
        columns = ["SG0", "SG1", "SG2", "SG3", "SG4", "SG5"]
        matrix = [[...], ...]                                   # N per V, from the certificate

    Parameters
    ----------
    columns : mapping of str to CsvColumn
        Keys of `calibration.measure.recording.SIGNALS`, and any others to keep beside them.
        ``stroke`` is the number of the stroke, in one file of all.
    skip_rows : int
        Lines to leave out above the headings; those above the table are found.
    delimiter : str, optional
        One character; found where it is not given.
    rate_hz : float, optional
        Samples per second, where the file has no times.
    gauges : Gauges, optional
        Makes forces of voltages.
    """

    skip_rows: Annotated[int, Field(ge=0)] = 0
    delimiter: Annotated[str | None, Field(min_length=1, max_length=1)] = None
    rate_hz: PositiveFloat | None = None
    columns: dict[str, CsvColumn]
    gauges: Gauges | None = None

    @model_validator(mode="after")
    def _units_are_known(self) -> Self:
        for name, column in self.columns.items():
            known = [*_UNITS.get(name, ()), *(["samples"] if name == "t_s" else ()), "raw"]
            if column.unit is not None and column.unit not in known:
                raise ValueError(f"{name}: expected unit {', '.join(known)}, got {column.unit!r}")
            if column.speed_mm_per_s is not None and name != "x_mm":
                raise ValueError(f"{name}: speed_mm_per_s makes a position: x_mm alone may have it")
            if name == "t_s" and column.file is not None:
                raise ValueError("t_s: expected the times of the first file")
        return self

    @property
    def assumed(self) -> tuple[str, ...]:
        """Signals of a recording that no column of the file gives."""
        columns = {name for name, column in self.columns.items() if column.column is not None}
        return tuple(name for name in ("x_mm", "drive_v") if name not in columns)

    def signals(self, path: str | Path) -> dict[str, Array]:
        """Read a file as the signals of a recording; without drive_v where it was not kept.

        Raises
        ------
        FileFormatError, InputError
            As `read`; or if the map lacks a signal.
        """
        return self.completed(self.read(path))

    def completed(self, signals: Mapping[str, Array]) -> dict[str, Array]:
        """Return the columns of one stroke as the signals of its recording.

        Raises
        ------
        InputError
            If the map lacks a signal.
        """
        missing = [name for name in SIGNALS if name not in (*signals, "drive_v")]
        if missing:
            raise InputError(
                f"column map: expected {', '.join(missing)} as well; where the instrument kept no "
                "position give x_mm = { speed_mm_per_s = 50 }"
            )
        signals = dict(signals)
        if "drive_v" in self.assumed:
            signals.pop("drive_v", None)
        speed = self.columns["x_mm"].speed_mm_per_s
        if speed is not None:
            forces = signals["normal_force_n"], signals["tangential_force_n"]
            signals["x_mm"] = position_at_speed(even_times(signals["t_s"]), *forces, speed)
        return signals

    def read(self, path: str | Path) -> dict[str, Array]:
        """Read every mapped signal of a file, in SI units and mm, at the times of the first one.

        The last line may be cut short, where a recording broke off. Signals of another rate are
        linear between their samples, a drive a cubic spline.

        Raises
        ------
        FileFormatError
            If the file cannot be read, a column is missing, has no unit or a cell is not a number,
            or nothing gives the times; the message names column and line.
        """
        path = Path(path)
        table = self._table(path, None)
        mapped = [name for name, column in self.columns.items() if column.column is not None]
        here = [name for name in mapped if self.columns[name].file is None]
        t = self._times(path, table, here)
        signals, moved = {"t_s": t}, set[str]()
        for name in mapped:
            column = self.columns[name]
            if name == "t_s":
                continue
            source, of = (table, path) if column.file is None else self._other(path, column.file)
            values = self._values(of, source, name)
            own = source.times_s.get(source.named(column.column or "") or "")
            if column.file is not None:
                own = _own_times(of, source, column, own, len(values))
            if column.file is not None or len(values) != len(t) or own is not None:
                if own is None:
                    own = self._shared_times(path, column, t, len(values))
                values = _onto(of, name, t, own, values)
                moved.add(name)
            signals[name] = values
        for name in _GROUPS:  # the numbers of the strokes, where nothing else states them
            if name in table.columns and len(table.columns[name]) == len(t):
                signals.setdefault("stroke", table.columns[name])
        known = np.isfinite(np.sum([signals[name] for name in moved], axis=0))
        if moved and not known.all():
            inside = np.flatnonzero(known)
            if len(inside) < FEWEST_SAMPLES:
                files = ", ".join({c.file for c in self.columns.values() if c.file})
                files = files or "its other columns"
                raise FileFormatError(
                    f"{path}: has no times in common with {files}; expected both by one clock, or "
                    "both from the start of the recording on"
                )
            whole = slice(inside[0], inside[-1] + 1)
            signals = {name: values[whole] for name, values in signals.items()}
        t = signals["t_s"]
        for name, column in self.columns.items():
            if column.speed_mm_per_s is not None:
                signals[name] = (t - t[0]) * column.speed_mm_per_s
            elif column.value is not None:
                signals[name] = np.full(len(t), column.value * column.scale)
        return signals

    def _table(self, path: Path, file: str | None) -> LabTable:
        columns = [c for c in self.columns.values() if c.file == file]
        names = [name for c in columns for name in (c.column, c.time) if name is not None]
        gauges = self.gauges if file is None else None
        if gauges is not None:
            names = [*(name for name in names if name not in gauges.axes), *gauges.columns]
        table = read_table(path, [*dict.fromkeys(names)], self.skip_rows, self.delimiter)
        return table if gauges is None else gauges.added(table)

    def _other(self, path: Path, file: str) -> tuple[LabTable, Path]:
        other = path.with_name(f"{path.stem}{file}")
        return self._table(other, file), other

    def _times(self, path: Path, table: LabTable, names: list[str]) -> Array:
        rate = self.rate_hz or table.rate_hz
        if "t_s" in self.columns and self.columns["t_s"].column is not None:
            return self._values(path, table, "t_s", rate)
        column = self.columns[names[0]].column if names else None
        first = table.named(column) if column is not None else None
        if first is not None and self.rate_hz is None and first in table.times_s:
            return table.times_s[first]
        if rate is None or first is None:
            raise FileFormatError(
                f"{path}: expected t_s among the columns of the map, or rate_hz, the samples per "
                "second"
            )
        return np.arange(len(table.columns[first])) / rate

    def _shared_times(self, path: Path, column: CsvColumn, t_s: Array, count: int) -> Array:
        """Times of a column that ends a little earlier, where a recording broke off."""
        if not _LEAST_SHARE * len(t_s) <= count <= len(t_s):
            raise FileFormatError(
                f'{path}: column "{column.column}" has {count} samples, and the times {len(t_s)}; '
                "expected its own times (the increment of a waveform), or a file of its own with "
                "rate_hz"
            )
        return t_s[:count]

    def _values(self, path: Path, table: LabTable, name: str, rate: float | None = None) -> Array:
        column = self.columns[name]
        heading = table.named(column.column or "")
        if heading is None:
            raise FileFormatError(f"{path}: missing columns {column.column!r}")
        unit = column.unit or table.units.get(heading, "raw" if name not in _UNITS else "")
        factor = 1.0 if unit == "raw" else _UNITS.get(name, {}).get(unit)
        if unit == "samples" and name == "t_s":
            factor = None if rate is None else 1 / rate
        if factor is None and name in _UNITS:
            rather = ("rate_hz with samples",) if unit == "samples" else _UNITS[name]
            raise _no_unit(path, f'"{column.column}" for {name}', unit, rather, "it")
        return np.asarray(table.columns[heading] * (factor or 1.0) * column.scale)


def _no_unit(path: Path, what: str, unit: str, known: Iterable[str], key: str) -> FileFormatError:
    stated = f"got {unit!r}" if unit else "and the file states none"
    return FileFormatError(
        f"{path}: expected the unit of column {what}: one of {', '.join(known)}, {stated}; give "
        f"{key} in the column map"
    )


def _own_times(
    path: Path, table: LabTable, column: CsvColumn, own: Array | None, count: int
) -> Array:
    """Times of a column in a file of its own."""
    if column.time is not None:
        heading = table.named(column.time) or column.time
        unit = column.time_unit or table.units.get(heading, "")
        if unit not in TIMES_S:
            raise _no_unit(path, f'"{column.time}"', unit, TIMES_S, "time_unit")
        return np.asarray(table.columns[heading] * TIMES_S[unit])
    rate = column.rate_hz or table.rate_hz
    if own is None and rate is None:
        raise FileFormatError(
            f"{path}: expected time = its column of times, or rate_hz, in the column map"
        )
    return np.arange(count) / rate if own is None and rate is not None else np.asarray(own)


def _onto(path: Path, name: str, t_s: Array, own_s: Array, values: Array) -> Array:
    """Values at other times; NaN before the first and after the last of their own."""
    if len(own_s) == len(t_s) and np.array_equal(own_s, t_s):
        return values
    at, own = even_times(t_s), even_times(own_s)
    if not (np.diff(own) > 0).all():
        raise FileFormatError(f"{path}: expected times that increase for {name}")
    slack = float(np.median(np.diff(own))) / 2
    inside = (at >= own[0] - slack) & (at <= own[-1] + slack)
    if name == "drive_v":
        if np.median(np.diff(own)) > 1.01 * np.median(np.diff(at)):
            raise FileFormatError(
                f"{path}: the drive has fewer samples per second than the forces, between which "
                "its amplitude is lost; record it as fast, or leave drive_v out"
            )
        return np.where(inside, CubicSpline(own, values)(at.clip(own[0], own[-1])), np.nan)
    return np.where(inside, np.interp(at, own, values), np.nan)


_MEANT = {
    "t_s": r"t|%time|(abs )?time\b.*|zeit|temps|timestamp|elapsed.*|x_value|seconds",
    "normal_force_n": (
        r"f_?z|fn|f_?n|.*normal.*|.*load.*|.*press.*|.*force[ ._]?z|kraft ?z|.*vertical.*"
    ),
    "tangential_force_n": (
        r"f_?x|ft|f_?t|.*tangential.*|.*friction.*|.*shear.*|.*lateral.*|.*force[ ._]?x|kraft ?x|"
        r".*reib.*"
    ),
    "x_mm": r"x|pos.*|.*position.*|.*displacement.*|.*stage.*|.*encoder.*|weg|.*distance.*",
    "drive_v": r".*drive.*|.*monitor.*|.*volt.*|hv.*|u|v|v_?out|spannung.*|amplifier.*",
    "stroke": r"stroke|trial|run|.*stroke.*(no|number|nr).*|versuch",
}


_COUNTER = r"rdt sequence|sequence|sample|samples|sample (no|number|index)|scan"


def proposed(table: LabTable) -> tuple[ColumnMap, tuple[str, ...], tuple[str, ...]]:
    """Propose a column map by the headings of a table; name the open points and the assumptions.

    Nothing is guessed where no heading states it: a unit that the file does not state is left out,
    and then the map is refused until it is given.
    """
    columns: dict[str, CsvColumn] = {}
    missing, assumed = [], []
    for name, pattern in _MEANT.items():
        plain = {heading: split_unit(heading)[0] for heading in table.columns}
        fits = [h for h, text in plain.items() if re.fullmatch(pattern, text.split("/")[-1], re.I)]
        if not fits:  # "Force/Z" of two groups
            fits = [h for h, t in plain.items() if re.fullmatch(pattern, t.replace("/", " "), re.I)]
        if len(fits) > 1:
            known = {*_UNITS.get(name, ()), None}
            fits = [heading for heading in fits if table.units.get(heading) in known] or fits
        if not fits:
            continue
        if len(fits) > 1:
            assumed.append(f"{name}: {' or '.join(fits)}; the first is taken")
        unit = table.units.get(fits[0])
        if name != "stroke" and unit not in _UNITS[name]:
            stated = f"; the file states {unit!r}" if unit else ""
            missing.append(f"{name}: add unit = one of {', '.join(_UNITS[name])}{stated}")
        # Each file states its own: an instrument changes it with its range.
        columns[name] = CsvColumn(column=fits[0], unit="raw" if name == "stroke" else None)
    counters = [name for name in table.columns if re.fullmatch(_COUNTER, name, re.I)]
    if table.rate_hz and counters:  # of the instrument, and not of the computer
        columns["t_s"] = CsvColumn(column=counters[0], unit="samples")
    elif "t_s" not in columns and not table.times_s and not table.rate_hz:
        missing.append("t_s: no times were found; add rate_hz = samples per second")
    for name in ("normal_force_n", "tangential_force_n"):
        if name not in columns:
            missing.append(f"{name}: not found; add its column, or [gauges] where there are volts")
    if "x_mm" not in columns:
        columns["x_mm"] = CsvColumn(speed_mm_per_s=50.0)
        assumed.append("x_mm: no position was found; a speed of 50 mm/s is assumed")
    if "drive_v" not in columns:
        assumed.append("drive_v: no drive was found; the planned one is assumed")
    return ColumnMap(columns=columns), (*missing,), (*assumed,)
