"""Recordings of touch panels, read as touches: libinput record, evemu, getevent, hid-recorder."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np

from haptix.base.errors import FileFormatError, InputError
from haptix.base.fields import LIFTED_BELOW_N
from haptix.base.files import read_csv, read_text
from haptix.feel.motion import Trajectory
from haptix.play.touch import touchscreen as codes
from haptix.play.touch.events import KINDS, TouchEvent
from haptix.play.touch.hid import HidReports
from haptix.play.touch.orientation import Matrix
from haptix.play.touch.touchscreen import ScreenAxes, SlotDecoder, protocol_of

_LABELS = {
    name: number
    for name, number in vars(codes).items()
    if name.startswith(("EV_", "SYN_", "ABS_", "BTN_", "MSC_")) and isinstance(number, int)
}
_VALUES = {"DOWN": 1, "UP": 0}
_LARGEST_BYTES = 200_000_000  # hours of a panel
_RAISED_S = 1e-3  # between a lifted finger and one that touches, as a path has it


class _Range(NamedTuple):
    min: int
    max: int
    resolution: float


@dataclass
class _Recorded:
    """One device of a recording."""

    name: str = ""
    ranges: dict[int, _Range] = field(default_factory=dict)
    keys: set[int] = field(default_factory=set)
    events: list[tuple[float, int, int, int]] = field(default_factory=list)
    size_mm: tuple[float, float] | None = None


_REQUIRED = ("t_s", "x_mm", "y_mm")
_OPTIONAL = ("touch_id", "kind", "normal_force_n", "contact_area_m2")


def read_events(
    path: str | Path,
    width_mm: float | None = None,
    height_mm: float | None = None,
    matrix: Matrix | str = "normal",
) -> list[TouchEvent]:
    """Read the touches of a panel's recording, or of a CSV in the order of its lines.

    Parameters
    ----------
    path : path
        A recording, see `read_recording`, or a CSV with the columns t_s, x_mm and y_mm, and where
        there are several fingers touch_id. Without a column kind, the first line of an id is its
        "down" and its last is followed by an "up"; a force below 1 mN is a finger off the screen.
        normal_force_n and contact_area_m2 may be missing, as columns or cell by cell.
    width_mm, height_mm, matrix
        Of a recording's panel, see `read_recording`.

    Returns
    -------
    list of TouchEvent
        As recorded, even if out of order, not finite or twice at one time: `Touches` sorts them.

    Raises
    ------
    FileFormatError, InputError
        If the file is not such a table; the message names the line.
    """
    if is_recording(path):
        return read_recording(path, width_mm, height_mm, matrix)
    events: list[TouchEvent] = []
    seen: dict[int, int] = {}
    has_kinds = False
    for row in read_csv(path, _REQUIRED, _OPTIONAL):
        cells = row.cells
        t_s, x_mm, y_mm = (row.number(name) for name in _REQUIRED)
        touch_id = row.whole("touch_id") if "touch_id" in cells else 0
        force, area = (
            row.number(name) if cells.get(name, "").strip() else None for name in _OPTIONAL[2:]
        )
        has_kinds = "kind" in cells
        if not has_kinds and force is not None and force < LIFTED_BELOW_N:
            if (last := seen.pop(touch_id, None)) is not None:
                events.append(events[last]._replace(t_s=t_s, kind="up"))
            continue
        kind = cells["kind"].strip() if has_kinds else "move" if touch_id in seen else "down"
        known = next((k for k in KINDS if k == kind), None)
        if known is None:
            raise InputError(f"{row.place}: kind: expected {', '.join(KINDS)}, got {kind!r}")
        seen[touch_id] = len(events)
        events.append(TouchEvent(t_s, touch_id, x_mm, y_mm, known, force, area))
    if not events:
        raise InputError(f"{path}: expected at least one touch, got none; is the file empty?")
    if not has_kinds:
        # Insert from the end, so that the indices before stay valid.
        for last in sorted(seen.values(), reverse=True):
            events.insert(last + 1, events[last]._replace(kind="up"))
    return events


def is_recording(path: str | Path) -> bool:
    """Return whether a file is one of the recordings that `read_recording` reads."""
    return _reader(read_text(path, _LARGEST_BYTES)) is not None


def _reader(text: str) -> Callable[[Sequence[str]], Iterator[_Recorded]] | None:
    return next((read for shape, read in _READERS if re.search(shape, text, re.MULTILINE)), None)


def read_recording(
    path: str | Path,
    width_mm: float | None = None,
    height_mm: float | None = None,
    matrix: Matrix | str = "normal",
) -> list[TouchEvent]:
    """Read the touches of all fingers of a panel's recording; times count from its first event.

    Parameters
    ----------
    path : path
        Of ``libinput record``, ``evemu-record``, ``getevent -t`` (with or without ``-l``, after the
        output of ``getevent -lp``, that states the axes) or ``hid-recorder``.
    width_mm, height_mm : float, optional
        Size of the touch-sensitive area, where the panel states none that one can rely on.
    matrix : tuple of 6 float, or str
        How the panel lies on the picture, see `ScreenAxes`.

    Raises
    ------
    FileFormatError
        If it is none of these, or holds no touch.
    InputError
        If the size is not known.
    """
    text = read_text(path, _LARGEST_BYTES)
    if (reader := _reader(text)) is None:
        raise FileFormatError(
            f"{path}: expected a recording of libinput record, evemu-record, getevent or "
            "hid-recorder"
        )
    try:
        devices = [each for each in reader(text.splitlines()) if each.events]
        panels = [each for each in devices if protocol_of(each.ranges) is not None]
        if not panels:
            raise FileFormatError("expected the events and the axes of a touch panel, got none")
        panel = max(panels, key=lambda each: len(each.events))
        sizes = panel.size_mm if width_mm is None is height_mm and panel.size_mm else None
        axes = ScreenAxes.of(panel.ranges, *(sizes or (width_mm, height_mm)), matrix=matrix)
        touches = _touches(panel, axes)
    except (FileFormatError, InputError) as error:
        raise type(error)(f"{path}: {error}") from None
    except (ValueError, IndexError, OverflowError) as error:
        raise FileFormatError(f"{path}: a line of the recording is cut off: {error}") from None
    if not touches:
        raise FileFormatError(f"{path}: expected at least one touch, got none")
    return touches


def _touches(panel: _Recorded, axes: ScreenAxes) -> list[TouchEvent]:
    protocol = protocol_of(panel.ranges)
    assert protocol is not None
    has_key = codes.BTN_TOUCH in panel.keys
    ask_key = (lambda: False) if has_key else None
    decoder = SlotDecoder(axes, None, protocol, ask_key, panel.ranges)
    begin_s = panel.events[0][0]
    touches = []
    for t_s, kind, code, value in panel.events:
        sec, part = divmod(t_s - begin_s, 1.0)
        touches += decoder.feed(int(sec), round(part * 1e6), kind, code, value)
    # A recording that ends with a finger down ends it.
    last = {touch.touch_id: touch for touch in touches}
    return touches + [each._replace(kind="up") for each in last.values() if each.kind != "up"]


def paths_of(events: Iterable[TouchEvent], normal_force_n: float = 0.5) -> list[Trajectory]:
    """Return the paths of the fingers, with force 0 while they are lifted.

    A finger that comes down while no other does goes on along the path of the first.

    Parameters
    ----------
    events : iterable of TouchEvent
        Such as those of `read_events`.
    normal_force_n : float
        Force [N] where the panel measures none.

    Returns
    -------
    list of Trajectory
        One for each finger that was down at the same time as others.

    Examples
    --------
    >>> from haptix.play.touch import events_of
    >>> path = Trajectory.of([0.0, 0.1, 0.2, 0.3], [5.0, 9.0, 20.0, 24.0], 20.0, [0.5, 0.5, 0, 0.5])
    >>> [again] = paths_of(events_of(path))
    >>> again.normal_force_n.tolist()
    [0.5, 0.5, 0.0, 0.0, 0.5, 0.0]
    """
    rows: list[list[tuple[float, float, float, float]]] = []
    path_of: dict[int, int] = {}
    for event in events:
        if event.kind == "up":
            number = path_of.pop(event.touch_id, None)
            if number is not None:
                _, x, y, _ = rows[number][-1]
                rows[number].append((event.t_s, x, y, 0.0))
            continue
        if event.touch_id not in path_of:
            taken = set(path_of.values())
            number = next(n for n in range(len(rows) + 1) if n not in taken)
            path_of[event.touch_id] = number
            if number == len(rows):
                rows.append([])
            else:
                rows[number].append((event.t_s - _RAISED_S, event.x_mm, event.y_mm, 0.0))
        force = normal_force_n if event.normal_force_n is None else event.normal_force_n
        rows[path_of[event.touch_id]].append((event.t_s, event.x_mm, event.y_mm, force))
    found = []
    for each in rows:
        times = np.array([row[0] for row in each])
        later = np.append(True, times[1:] > np.maximum.accumulate(times)[:-1])
        # At one time the last counts, but for an "up" at the time of the last report.
        for i in np.flatnonzero(~later):
            if each[i][3] == 0:
                each[i] = (each[i - 1][0] + 1e-4, *each[i][1:])
                later[i] = True
        kept = [row for row, is_later in zip(each, later, strict=True) if is_later]
        if len(kept) > 1:
            found.append(Trajectory(*np.array(kept).T))
    return found


def _evemu(lines: Sequence[str]) -> Iterator[_Recorded]:
    device, keys = _Recorded(), bytearray()
    for line in lines:
        kind, _, rest = line.partition(":")
        words = rest.split("#")[0].split()
        if kind == "N":
            device.name = rest.strip()
        elif kind == "A":
            code, low, high, _, _, *resolution = words
            device.ranges[int(code, 16)] = _Range(int(low), int(high), int([*resolution, "0"][0]))
        elif kind == "B" and int(words[0], 16) == codes.EV_KEY:
            keys += bytes(int(word, 16) for word in words[1:])
        elif kind == "E":
            t_s, event, code, value = words[:4]
            device.events.append((float(t_s), int(event, 16), int(code, 16), int(value)))
    device.keys = {key for key in range(8 * len(keys)) if keys[key // 8] >> key % 8 & 1}
    yield device


_ABSINFO = re.compile(r"^\s+(\d+): \[([-\d, ]+)\]")
_EVENT = re.compile(r"^\s*- \[([-\d, ]+)\]")


def _libinput(lines: Sequence[str]) -> Iterator[_Recorded]:
    device, is_absinfo = _Recorded(), False
    for line in lines:
        if line.startswith("- node:"):
            yield device
            device, is_absinfo = _Recorded(), False
        elif line.strip().startswith("absinfo:"):
            is_absinfo = True
        elif (event := _EVENT.match(line)) is not None:
            sec, usec, *numbers = (int(number) for number in event[1].split(","))
            if len(numbers) == 3:
                device.events.append((sec + usec * 1e-6, numbers[0], numbers[1], numbers[2]))
        elif (info := _ABSINFO.match(line)) is not None:
            numbers = [int(number) for number in info[2].split(",")]
            if is_absinfo and len(numbers) >= 5:
                device.ranges[int(info[1])] = _Range(numbers[0], numbers[1], numbers[4])
            elif int(info[1]) == codes.EV_KEY:
                device.keys |= set(numbers)
        elif line.strip().startswith("properties:"):
            is_absinfo = False
    yield device


_ADDED = re.compile(r"^add device \d+: (\S+)")
_AXIS = re.compile(
    r"(\w+)\s*: value -?\d+, min (-?\d+), max (-?\d+), fuzz -?\d+, flat -?\d+, resolution (-?\d+)"
)
_TOLD = re.compile(r"^\[\s*(\d+\.\d+)\]\s+(?:(/\S+):\s+)?(\w+)\s+(\w+)\s+(\w+)\s*$")


def _getevent(lines: Sequence[str]) -> Iterator[_Recorded]:
    devices: dict[str, _Recorded] = {}
    device = _Recorded()
    for line in lines:
        if (added := _ADDED.match(line)) is not None:
            device = devices.setdefault(added[1], _Recorded())
        elif (axis := _AXIS.search(line)) is not None:
            code = _number(axis[1], 16)
            if code is not None:
                device.ranges[code] = _Range(*(int(number) for number in axis.groups()[1:]))
        elif (told := _TOLD.match(line)) is not None:
            t_s, path, *words = told.groups()
            if path is None and len(devices) == 1:
                path = next(iter(devices))
            kind, code, value = (_number(word, 16) for word in words)
            if kind is not None and code is not None and value is not None:
                value = value - (1 << 32) if value >> 31 else value
                found = devices.setdefault(path or "", _Recorded())
                found.events.append((float(t_s), kind, code, value))
        elif re.search(r"\b(BTN_TOUCH|014a)\b", line):
            device.keys.add(codes.BTN_TOUCH)
    if any(each.events and not each.ranges for each in devices.values()):
        raise FileFormatError("expected the axes: put the output of `getevent -lp` before it")
    yield from devices.values()


def _number(word: str, base: int) -> int | None:
    """Return a label's number, or the number itself; None for a label of something else."""
    if word in _LABELS or word in _VALUES:
        return _LABELS.get(word, _VALUES.get(word))
    try:
        return int(word, base)
    except ValueError:
        return None


def _hid(lines: Sequence[str]) -> Iterator[_Recorded]:
    device, reports = _Recorded(), None
    for line in lines:
        kind, _, rest = line.partition(":")
        words = rest.split("#")[0].split()
        if kind == "D":
            yield device
            device, reports = _Recorded(), None
        elif kind == "N":
            device.name = rest.strip()
        elif kind == "R":
            reports = HidReports.of(_counted(words))
            if reports is not None:
                device.ranges = {code: _Range(*low_high, 0) for code, low_high in reports.axes}
                device.size_mm = reports.size_mm
        elif kind == "E" and reports is not None:
            data = _counted(words[1:])
            t_s = float(words[0])
            device.events += [(t_s, *event) for event in reports.events(t_s, data)]
    yield device


def _counted(words: Sequence[str]) -> bytes:
    """Return bytes of which the first word is the number."""
    data = bytes(int(word, 16) for word in words[1:])
    if len(data) != int(words[0]):
        raise ValueError(f"expected {words[0]} bytes, got {len(data)}")
    return data


_READERS = (
    (r"^E: \d+\.\d+ [0-9a-fA-F]{4} [0-9a-fA-F]{4} -?\d+", _evemu),
    (r"^R: \d+( [0-9a-fA-F]{2})+", _hid),
    (r"^libinput:|^devices:", _libinput),
    (r"^add device \d+: /|^\[\s*\d+\.\d+\]\s+\S", _getevent),
)
