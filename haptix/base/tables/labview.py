"""LabVIEW's LVM and National Instruments' TDMS: channels with times of their own."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from datetime import datetime
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from haptix.base.checks import Array
from haptix.base.errors import from_extra
from haptix.base.files import reading
from haptix.base.tables.table import TIMES_S, LabTable, distinct, known_unit

_START = re.compile(r"(\d+)/(\d+)/(\d+) (\d+):(\d+):(\d+)[.,]?(\d*)")

#: LabVIEW's time 0 is the day before, and stands in a waveform whose start was not set.
_UNSET = np.datetime64("1904-01-02", "us")


def _begun(channel: Any) -> np.datetime64 | None:
    start = channel.properties.get("wf_start_time")
    return start if isinstance(start, np.datetime64) and start > _UNSET else None


def of_tdms(path: str | Path, data: bytes) -> LabTable:
    """Read the channels of all groups, one behind the other where they are the same channels."""
    with from_extra("calibration"):
        from nptdms import TdmsFile
    with reading(path, "a TDMS file"):
        groups = TdmsFile.read(BytesIO(data)).groups()
        parts = [
            {channel.name: channel for channel in group.channels() if len(channel)}
            for group in groups
        ]
        filled = [(group.name, part) for group, part in zip(groups, parts, strict=True) if part]
        alike = len(filled) > 1 and _follow_each_other([part for _, part in filled])
        columns, units, times = dict[str, Array](), dict[str, str](), dict[str, Array]()
        no_times = dict[str, None]()
        first = _first(_begun(channel) for _, part in filled for channel in part.values())
        for number, (group, part) in enumerate(filled, 1):
            if alike:
                first = _first(map(_begun, part.values()))
            for channel in part.values():
                # Groups of the same channels follow one another, such as one for each stroke.
                name = channel.name if alike or len(filled) == 1 else f"{group}/{channel.name}"
                values = channel[:]
                if np.issubdtype(values.dtype, np.datetime64):
                    values = (values - values[0].astype("M8[D]")) / np.timedelta64(1, "s")
                    units[name] = "s"
                elif not np.issubdtype(values.dtype, np.number):
                    continue
                properties = channel.properties
                columns[name] = np.append(columns.get(name, []), np.asarray(values, dtype=float))
                if unit := _unit_of(channel):
                    units[name] = unit
                axis = [str(properties.get(key, "")) for key in ("wf_xname", "wf_xunit_string")]
                unit_s = _axis_unit_s(*axis)
                step = float(properties.get("wf_increment", 0.0))
                if step > 0 and unit_s is None:
                    no_times.setdefault(f"{name} stands over {axis[0]} [{axis[1]}], no time")
                elif step > 0 and unit_s is not None:
                    offset = float(properties.get("wf_start_offset", 0.0))
                    own = unit_s * (offset + step * np.arange(len(values)))
                    own += _late_s(_begun(channel), first)
                    times[name] = np.append(times.get(name, []), own)
            if alike:
                longest = max(len(channel) for channel in part.values())
                numbers = columns.get("group", np.empty(0))
                columns["group"] = np.append(numbers, np.full(longest, float(number)))
    what = f"TDMS: {', '.join(f'{group} ({len(part)} channels)' for group, part in filled)}"
    return LabTable(columns, units, times, None, (what, *no_times))


def _unit_of(channel: Any) -> str:
    # The driver DAQmx names it in words, such as Volts, and LabVIEW writes both.
    properties = channel.properties
    named = properties.get("unit_string") or properties.get("NI_UnitDescription", "")
    return known_unit(str(named))


def _follow_each_other(groups: Sequence[Mapping[str, Any]]) -> bool:
    """Whether groups of TDMS are the same channels at different times, such as strokes.

    Channels of one name in different units, or groups that began at once, are those of several
    instruments: a force's X and a position's.
    """
    units = {tuple((name, _unit_of(group[name])) for name in group) for group in groups}
    starts = [start for group in groups if (start := min(_starts(group), default=None)) is not None]
    return len(units) == 1 and len(set(starts)) == len(starts)


def _starts(group: Mapping[str, Any]) -> list[np.datetime64]:
    return [start for start in map(_begun, group.values()) if start is not None]


def _axis_unit_s(name: str, unit: str) -> float | None:
    """Seconds of the unit of an axis; None where it is none of time."""
    if unit.strip():
        return TIMES_S.get(known_unit(unit))
    return 1.0 if name.strip().lower() in ("", "time", "t", "zeit", "temps") else None


def _first(starts: Iterable[np.datetime64 | None]) -> np.datetime64:
    return min((start for start in starts if start is not None), default=_UNSET)


def _late_s(start: np.datetime64 | None, first: np.datetime64) -> float:
    """Seconds by which a channel began after the first one; 0 where its start is not stated."""
    return 0.0 if start is None else float((start - first) / np.timedelta64(1, "us")) / 1e6


def _started(date: str, time: str) -> np.datetime64 | None:
    """Return the start of a channel of LVM; None where it is not stated."""
    at = _START.fullmatch(f"{date.strip()} {time.strip()}")
    if at is None:
        return None
    year, month, day, hour, minute, second = map(int, at.groups()[:6])
    with suppress(ValueError):
        start = datetime(year, month, day, hour, minute, second)
        return np.datetime64(start, "us") + np.timedelta64(round(float(f"0.{at[7]}0") * 1e6), "us")
    return None


def of_lvm(path: str | Path, text: str) -> LabTable:
    """Read the channels of all segments, one behind the other."""
    with from_extra("calibration"):
        import lvm_read
    columns, units, times = dict[str, list[Any]](), dict[str, str](), dict[str, list[Any]]()
    no_times = dict[str, None]()
    with reading(path, "a LabVIEW measurement file"):
        # `read` would keep a pickle beside the file.
        table = lvm_read.read_str(text)
        x_columns, count = table.get("X_Columns", "One"), int(table["Segments"])
        for number in range(count):
            segment = table[number]
            rows = np.atleast_2d(segment["data"])
            names = segment["Channel names"]
            places = [k for k, name in enumerate(names) if name not in ("X_Value", "Comment")]
            if len(places) != segment["Channels"]:
                raise ValueError(f"{segment['Channels']} channels, got headings of {len(places)}")
            # A value above stands in its channel's column, whose first has the name of the row.
            above = places if x_columns == "No" else [at - 1 for at in places]
            dates, clocks = (segment.get(key, []) for key in ("Date", "Time"))
            starts = [_started(*each) for each in zip(dates, clocks, strict=False)]
            starts += [None] * len(names)
            first = _first(starts)
            names = distinct(names)
            for channel, at in zip(above, places, strict=True):
                values = rows[:, at]
                filled = np.flatnonzero(np.isfinite(values))
                if not filled.size:  # a channel that recorded nothing
                    continue
                values = values[: int(filled[-1]) + 1]
                columns.setdefault(names[at], []).append(values)
                labels = segment.get("Y_Unit_Label", [])
                unit = known_unit(labels[channel]) if channel < len(labels) else ""
                if units.setdefault(names[at], unit) != unit:
                    raise ValueError(f"{names[at]} in {units[names[at]]!r} and later in {unit!r}")
                axis = [*segment.get("X_Dimension", ["Time"]), *[""] * len(names)][channel]
                if _axis_unit_s(axis, "") is None:
                    no_times.setdefault(f"{names[at]} stands over {axis}, no time")
                    continue
                if x_columns == "No":
                    start, step = (float(segment[key][channel]) for key in ("X0", "Delta_X"))
                    own = start + step * np.arange(len(values))
                else:
                    own = rows[: len(values), at - 1 if x_columns == "Multi" else 0]
                if x_columns != "One":  # else all have the same times
                    own = own + _late_s(starts[channel], first)
                times.setdefault(names[at], []).append(own)
            if count > 1:
                columns.setdefault("segment", []).append(np.full(len(rows), float(number + 1)))
    what = f"LabVIEW measurement file of {count} segment{'s' * (count > 1)}, {x_columns} X column"
    joined, stamps = (
        {name: np.concatenate(parts) for name, parts in found.items()} for found in (columns, times)
    )
    units = {name: unit for name, unit in units.items() if unit}
    return LabTable(joined, units, stamps, None, (what, *no_times))
