"""Touchscreens through Linux evdev (the extra `evdev`), and the events that they send."""

from __future__ import annotations

import os
import select
import struct
import sys
from collections import deque
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from math import inf, pi
from pathlib import Path
from statistics import fmean
from typing import Any, Literal, Self

from haptix.base.checks import Positive, checked, positive
from haptix.base.errors import DeviceError, InputError, from_extra
from haptix.play.touch.events import TouchEvent, free_id
from haptix.play.touch.orientation import (
    ORIENTATIONS,
    Matrix,
    checked_matrix,
    is_turned,
    system_matrix,
)

# linux/input-event-codes.h
EV_SYN, EV_KEY, EV_ABS, EV_MSC = 0x00, 0x01, 0x03, 0x04
SYN_REPORT, SYN_MT_REPORT, SYN_DROPPED = 0x00, 0x02, 0x03
BTN_TOUCH = 0x14A
MSC_TIMESTAMP = 0x05
ABS_X, ABS_Y, ABS_PRESSURE, ABS_DISTANCE = 0x00, 0x01, 0x18, 0x19
ABS_MT_SLOT = 0x2F
ABS_MT_TOUCH_MAJOR, ABS_MT_TOUCH_MINOR = 0x30, 0x31
ABS_MT_POSITION_X, ABS_MT_POSITION_Y = 0x35, 0x36
ABS_MT_TOOL_TYPE, ABS_MT_TRACKING_ID, ABS_MT_PRESSURE = 0x37, 0x39, 0x3A
ABS_MT_DISTANCE = 0x3B
MT_TOOL_PALM = 0x02

SLOT_CODES = (
    ABS_MT_TRACKING_ID, ABS_MT_POSITION_X, ABS_MT_POSITION_Y, ABS_MT_TOUCH_MAJOR,
    ABS_MT_TOUCH_MINOR, ABS_MT_PRESSURE, ABS_MT_TOOL_TYPE, ABS_MT_DISTANCE,
)  # fmt: skip
"""Codes whose values the decoder stores for each slot."""

SINGLE_CODES = {
    ABS_X: ABS_MT_POSITION_X,
    ABS_Y: ABS_MT_POSITION_Y,
    ABS_PRESSURE: ABS_MT_PRESSURE,
    ABS_DISTANCE: ABS_MT_DISTANCE,
}
"""Codes of a single-touch panel, and those of the same meaning in a slot."""

INPUT_EVENT = struct.Struct("llHHi")
"""struct input_event: seconds, microseconds, type, code, value."""

Protocol = Literal["B", "A", "single"]
"""Multi-touch protocols of Linux, B with slots and A without, and panels of one touch."""

SlotValues = Callable[[], tuple[int, Mapping[int, Mapping[int, int]]]]
"""Returns, from the kernel, the current slot and the values of each slot by code."""

LEAST_PER_MM = 20
"""The kernel states whole units per mm, so that below this a stated size is off by over 2.5 %."""
_SIDES_MM, _MOST_ASPECT = (20.0, 3000.0), 5.0
_ZERO_LIFTS = (ABS_MT_PRESSURE, ABS_MT_TOUCH_MAJOR)  # a finger where they become 0, see `_touches`
# Of a slot whose values were lost: no touch before the panel reports one again.
_LOST = {ABS_MT_DISTANCE: 1, ABS_MT_PRESSURE: 0, ABS_MT_TOOL_TYPE: MT_TOOL_PALM}
# Of the panel's clock: reports that decide whether it holds, and how far it may scatter and drift
# over them. It wraps around, and begins anew after a pause.
_CLOCK_REPORTS, _CLOCK_SPREAD_S, _CLOCK_DRIFT_S = 32, 0.015, 0.003
_WRAP_US, _CLOCK_PAUSE_S = 1 << 32, 0.5
_FARTHEST_MM = 40.0  # a finger moves less between two reports

_CLOCK_MONOTONIC = 1
_READ_BYTES = 24 * 256
# linux/input.h: _IOW('E', 0xa0, int) and _IOR('E', 0x0a, len)
_EVIOCSCLOCKID = 0x400445A0

NO_PERMISSION = "you may not read it: sudo usermod -aG input $USER, then log out and in again"


@dataclass(frozen=True)
class AxisRange:
    """An axis in units of the device: lowest and highest value, and units per millimetre.

    Parameters
    ----------
    low, high : int
        Lowest and highest value.
    per_mm : float
        Units per millimetre.

    Examples
    --------
    >>> AxisRange(low=0, high=4095, per_mm=20.0).mm(200)
    10.0
    """

    low: int
    high: int
    per_mm: float

    def __post_init__(self) -> None:
        if not (self.low < self.high and 0 < self.per_mm < inf):
            raise InputError(
                f"axis: expected low < high and units per mm above 0, got {self.low}, {self.high} "
                f"and {self.per_mm:g}"
            )

    def mm(self, value: float) -> float:
        """Return the place on the axis [mm] from its low end."""
        return (value - self.low) / self.per_mm

    @property
    def length_mm(self) -> float:
        """Length of the axis [mm]."""
        return self.mm(self.high)


@checked()
class ScreenAxes:
    """Units and orientation of a touchscreen's numbers.

    Parameters
    ----------
    x, y : AxisRange
        The panel's own axes.
    force_n_per_unit : float, optional
        Unit of ABS_MT_PRESSURE, which differs between screens; without it pressure is not used.
    area_units_per_mm : float, optional
        Unit of ABS_MT_TOUCH_MAJOR and MINOR; the default is that of `x`, as the kernel asks of
        drivers. They are the axes of an ellipse, or of a circle where there is no minor axis.
    matrix : tuple of 6 float, or str
        How the panel lies on the picture: the map of libinput's calibration matrix, from shares
        of the panel's axes to shares of the picture's, or one of `ORIENTATIONS`. Places count from
        the picture's upper left corner.

    Examples
    --------
    >>> panel = AxisRange(0, 2000, 20.0), AxisRange(0, 1000, 20.0)
    >>> ScreenAxes(*panel, matrix="turn-90").place_mm(500, 0)  # a panel of 100 x 50 mm, upright
    (50.0, 25.0)
    """

    x: AxisRange
    y: AxisRange
    force_n_per_unit: Positive | None = None
    area_units_per_mm: Positive | None = None
    matrix: Matrix | str = ORIENTATIONS["normal"]

    def __post_init__(self) -> None:
        object.__setattr__(self, "matrix", checked_matrix(self.matrix))

    @classmethod
    def of(
        cls,
        ranges: Mapping[int, Any],
        width_mm: float | None = None,
        height_mm: float | None = None,
        force_n_per_unit: float | None = None,
        area_units_per_mm: float | None = None,
        matrix: Matrix | str = "normal",
    ) -> Self:
        """Return the axes of a panel by the kernel's `absinfo`, with a size where it is given.

        Parameters
        ----------
        ranges : mapping
            Objects with `min`, `max` and `resolution`, by code.
        width_mm, height_mm : float, optional
            Size of the touch-sensitive area on the picture, after `matrix`.
        force_n_per_unit, area_units_per_mm, matrix
            See `ScreenAxes`; an area's unit that is not given is the resolution of its axis.

        Raises
        ------
        InputError
            If it is no touch panel, or its size is not given and not stated so that one can rely
            on it.
        """
        matrix = checked_matrix(matrix)
        codes = place_codes(ranges)
        sizes = {"width_mm": width_mm, "height_mm": height_mm}
        for name, size_mm in sizes.items():
            if size_mm is not None:
                positive(name, size_mm)
        missing = [name for name, size_mm in sizes.items() if size_mm is None]
        problem = size_problem(ranges)
        if missing and problem:
            raise InputError(f"{problem}; measure its touch-sensitive area and give {missing[0]}")
        along = (height_mm, width_mm) if is_turned(matrix) else (width_mm, height_mm)
        axes = []
        for code, size_mm in zip(codes, along, strict=True):
            info = ranges[code]
            per_mm = info.resolution if size_mm is None else (info.max - info.min) / size_mm
            axes.append(AxisRange(info.min, info.max, per_mm))
        if area_units_per_mm is None and (major := ranges.get(ABS_MT_TOUCH_MAJOR)) is not None:
            area_units_per_mm = major.resolution if major.resolution > 0 else None
        return cls(axes[0], axes[1], force_n_per_unit, area_units_per_mm, matrix)

    @property
    def size_mm(self) -> tuple[float, float]:
        """Width and height [mm] of the touch-sensitive area, as it lies on the picture."""
        x_mm, y_mm = self.x.length_mm, self.y.length_mm
        return (y_mm, x_mm) if is_turned(checked_matrix(self.matrix)) else (x_mm, y_mm)

    def place_mm(self, x: float, y: float) -> tuple[float, float]:
        """Return the place on the picture [mm].

        Parameters
        ----------
        x, y : float
            Values of the panel's axes.
        """
        x_mm, y_mm = self.x.mm(x), self.y.mm(y)
        if self.matrix == ORIENTATIONS["normal"]:
            return x_mm, y_mm
        a, b, c, d, e, f = self._to_mm
        return a * x_mm + b * y_mm + c, d * x_mm + e * y_mm + f

    @cached_property
    def _to_mm(self) -> Matrix:
        a, b, c, d, e, f = checked_matrix(self.matrix)
        width_mm, height_mm = self.size_mm
        x_mm, y_mm = self.x.length_mm, self.y.length_mm
        return (
            width_mm * a / x_mm, width_mm * b / y_mm, width_mm * c,
            height_mm * d / x_mm, height_mm * e / y_mm, height_mm * f,
        )  # fmt: skip


def protocol_of(codes: Collection[int]) -> Protocol | None:
    """Return the protocol of a panel with these EV_ABS codes; None if it reports no places."""
    if ABS_MT_POSITION_X in codes and ABS_MT_POSITION_Y in codes:
        return "B" if ABS_MT_SLOT in codes else "A"
    return "single" if ABS_X in codes and ABS_Y in codes else None


def place_codes(codes: Collection[int]) -> tuple[int, int]:
    """Return the codes of x and y of a panel."""
    protocol = protocol_of(codes)
    if protocol is None:
        raise InputError("expected a touchscreen, but it reports no places")
    return (ABS_X, ABS_Y) if protocol == "single" else (ABS_MT_POSITION_X, ABS_MT_POSITION_Y)


def size_problem(ranges: Mapping[int, Any]) -> str:
    """Return why the size that a driver states cannot be relied on; empty if it can be."""
    infos = [ranges[code] for code in place_codes(ranges)]
    resolutions = [info.resolution for info in infos]
    if min(resolutions) <= 0:
        return "the driver gives no size"
    if any(info.max <= info.min for info in infos):
        return "the driver gives no range of places"
    sides = [(info.max - info.min) / info.resolution for info in infos]
    text = f"the driver states {sides[0]:.4g} x {sides[1]:.4g} mm"
    if min(resolutions) < LEAST_PER_MM:
        return f"{text}, in whole units per mm ({resolutions[0]} and {resolutions[1]}): too coarse"
    if not _SIDES_MM[0] <= min(sides) <= max(sides) <= _SIDES_MM[1]:
        return f"{text}, which no screen has"
    return f"{text}, which no screen has" if max(sides) > _MOST_ASPECT * min(sides) else ""


@dataclass
class _Slot:
    """Last values of a slot. They stay after a touch, since the device sends only changes."""

    values: dict[int, int] = field(default_factory=dict)
    tracking_id: int | None = None
    """The kernel's id of the touch that was last reported as down; it rises with each touch."""
    touch_id: int = 0


class PanelClock:
    """Stamps reports by the panel's own clock (MSC_TIMESTAMP), where it agrees with the kernel's.

    The kernel stamps a report when it arrives: over USB, up to some 10 ms late, and unevenly. The
    panel's clock counts microseconds from any time on, and starts anew after a pause. It holds
    where the difference between both, over the last reports, neither scatters nor drifts; their
    mean then maps the one to the other, so that stamps are even and as late as before.
    """

    def __init__(self) -> None:
        self._panel_s = 0.0
        self._last: tuple[float, int] | None = None
        self._behind_s: deque[float] = deque(maxlen=_CLOCK_REPORTS)
        self._stamped_s = -inf

    def stamp(self, t_s: float, panel_us: int | None) -> float:
        """Return the time of a report [s] on the kernel's clock.

        Parameters
        ----------
        t_s : float
            The kernel's stamp.
        panel_us : int or None
            Value of MSC_TIMESTAMP, where the report has one.
        """
        found_s = t_s
        if panel_us is not None:
            panel_us &= _WRAP_US - 1
            if self._last is not None:
                gap_s = (panel_us - self._last[1]) % _WRAP_US * 1e-6
                if max(gap_s, t_s - self._last[0]) > _CLOCK_PAUSE_S:
                    self._behind_s.clear()
                self._panel_s += gap_s
            self._last = (t_s, panel_us)
            self._behind_s.append(t_s - self._panel_s)
            if self.holds:
                found_s = self._panel_s + fmean(self._behind_s)
        # Where it begins or ends to hold, no stamp is before an earlier one.
        self._stamped_s = max(found_s, min(self._stamped_s, t_s + _CLOCK_SPREAD_S))
        return self._stamped_s

    @property
    def holds(self) -> bool:
        """Whether stamps are those of the panel's clock."""
        behind_s = [*self._behind_s]
        half = _CLOCK_REPORTS // 2
        if len(behind_s) < _CLOCK_REPORTS or max(behind_s) - min(behind_s) > _CLOCK_SPREAD_S:
            return False
        return abs(fmean(behind_s[:half]) - fmean(behind_s[half:])) < _CLOCK_DRIFT_S


class SlotDecoder:
    """Turns the events of a device into touches, once per SYN_REPORT.

    Every finger that is down is reported each time, whether it moved or not. A finger that hovers
    (ABS_MT_DISTANCE is not 0, BTN_TOUCH is 0, or its pressure became 0) and a palm are no touches.
    When the kernel has dropped events (SYN_DROPPED), `ask` returns the slots. Without `ask` all
    touches go up, and a finger returns when it comes down the next time.

    Contacts of protocol A have no slots: they are matched from report to report by their places,
    where the panel gives them no ids.

    Parameters
    ----------
    axes : ScreenAxes
        Units of the screen.
    ask : callable, optional
        Returns the current slot and the values of all, for fingers that are down at the start or
        when events were lost.
    protocol : {"B", "A", "single"}
        See `protocol_of`.
    ask_key : callable, optional
        Returns whether BTN_TOUCH is 1, for a panel that has that key. Without it the key counts
        from its first event on, except with one touch, where it is the touch.
    codes : collection of int
        EV_ABS codes that the panel has, where they are known: after a loss without `ask`, what has
        such a code is no touch before the panel states it again.
    """

    def __init__(
        self,
        axes: ScreenAxes,
        ask: SlotValues | None = None,
        protocol: Protocol = "B",
        ask_key: Callable[[], bool] | None = None,
        codes: Collection[int] = (),
    ) -> None:
        self.axes = axes
        self.dropped = 0
        """Number of times that the kernel has dropped events."""
        self._ask, self._ask_key = ask, ask_key
        self._protocol = protocol
        self._codes = SINGLE_CODES if protocol == "single" else {code: code for code in SLOT_CODES}
        self._slots: dict[int, _Slot] = {}
        self._current = 0
        self._contacts: list[dict[int, int]] | None = None  # of protocol A, since the last report
        self._contact: dict[int, int] = {}
        self._ids = 0
        self._is_touched: bool | None = False if protocol == "single" else None  # BTN_TOUCH
        self._seen = set(codes)
        self._pressed: set[int] = set()  # codes that have been above 0
        self._unknown: dict[int, int] = {}  # of slots whose values were lost
        self._clock = PanelClock()
        self._panel_us: int | None = None
        self._is_broken = False
        self._rest = b""
        if ask is not None:
            self._refresh()
        elif ask_key is not None:
            self._is_touched = ask_key()

    def feed_bytes(self, data: bytes) -> list[TouchEvent]:
        """Take bytes of a device file; an incomplete event waits for its rest."""
        data = self._rest + data
        whole = len(data) - len(data) % INPUT_EVENT.size
        self._rest = data[whole:]
        return [
            touch for event in INPUT_EVENT.iter_unpack(data[:whole]) for touch in self.feed(*event)
        ]

    def feed(self, sec: int, usec: int, kind: int, code: int, value: int) -> list[TouchEvent]:
        """Take one event; at a SYN_REPORT, return the touches since the one before.

        Parameters
        ----------
        sec, usec : int
            Time of the event, seconds and microseconds.
        kind, code, value : int
            The event, as in Linux' ``input_event``.
        """
        if kind == EV_SYN:
            if code == SYN_DROPPED:
                self.dropped += 1
                self._is_broken = True
            elif code == SYN_REPORT:
                if self._is_broken:
                    self._is_broken = False
                    self._refresh()
                elif self._contacts is not None:
                    self._match(self._contacts)
                if self._protocol == "single":
                    values = self._slots.setdefault(0, _Slot()).values
                    values[ABS_MT_TRACKING_ID] = self._ids if self._is_touched else -1
                self._contacts, self._contact = None, {}
                t_s = self._clock.stamp(sec + usec * 1e-6, self._panel_us)
                self._panel_us = None
                return self._report(t_s)
            elif code == SYN_MT_REPORT and self._protocol == "A":
                self._contacts = self._contacts or []
                if self._contact:
                    self._contacts.append(self._contact)
                    self._contact = {}
        elif kind == EV_MSC and code == MSC_TIMESTAMP:
            self._panel_us = value
        elif self._is_broken:
            pass
        elif kind == EV_ABS:
            if code == ABS_MT_SLOT:
                self._current = value
            elif (known := self._codes.get(code)) is not None:
                self._seen.add(known)
                if self._protocol == "A":
                    self._contact[known] = value
                else:
                    self._slots.setdefault(self._current, _Slot()).values[known] = value
        elif kind == EV_KEY and code == BTN_TOUCH:
            self._ids += value != 0 and not self._is_touched
            self._is_touched = value != 0
        return []

    def _refresh(self) -> None:
        if self._ask is not None:
            self._current, slots = self._ask()
            for number, values in slots.items():
                self._slots.setdefault(number, _Slot()).values = dict(values)
        else:
            for slot in self._slots.values():
                slot.values = {ABS_MT_TRACKING_ID: -1}
            if self._protocol != "A":  # which states all in every report
                self._unknown = {code: value for code, value in _LOST.items() if code in self._seen}
        if self._ask_key is not None:
            self._is_touched = self._ask_key()
        elif self._is_touched is not None:
            self._is_touched = False  # until the key reports it: a finger may hover by now
        self._ids += 1

    def _match(self, contacts: list[dict[int, int]]) -> None:
        """Let the contacts of protocol A be the slots of the contacts before that they go on."""
        contacts = [each for each in contacts if {*each} >= {ABS_MT_POSITION_X, ABS_MT_POSITION_Y}]
        before = {
            number: slot.values
            for number, slot in self._slots.items()
            if slot.values[ABS_MT_TRACKING_ID] >= 0
        }
        for values in before.values():
            values[ABS_MT_TRACKING_ID] = -1
        if all(contact.get(ABS_MT_TRACKING_ID, -1) >= 0 for contact in contacts):
            numbers = [contact[ABS_MT_TRACKING_ID] for contact in contacts]
        else:
            numbers = self._numbers(contacts, before)
        for number, contact in zip(numbers, contacts, strict=True):
            slot = self._slots.setdefault(number, _Slot())
            slot.values = {**contact, ABS_MT_TRACKING_ID: number}

    def _numbers(
        self, contacts: list[dict[int, int]], before: Mapping[int, dict[int, int]]
    ) -> list[int]:
        import numpy as np
        from scipy.optimize import linear_sum_assignment  # here, since few panels need it

        numbers = [-1] * len(contacts)
        if before and contacts:
            old = np.array([self._place(values) for values in before.values()])
            new = np.array([self._place(contact) for contact in contacts])
            apart_mm = np.hypot(*(old[:, None] - new[None]).T).T
            # Beyond the farthest all are alike: the rest goes to the near ones.
            for i, j in zip(*linear_sum_assignment(apart_mm.clip(max=_FARTHEST_MM)), strict=True):
                if apart_mm[i, j] < _FARTHEST_MM:
                    numbers[j] = list(before)[i]
        for j, number in enumerate(numbers):
            if number < 0:
                self._ids += 1
                numbers[j] = self._ids
        return numbers

    def _report(self, t_s: float) -> list[TouchEvent]:
        ups: list[TouchEvent] = []
        others: list[TouchEvent] = []
        for slot in self._slots.values():
            values = slot.values
            now = values.get(ABS_MT_TRACKING_ID, -1)
            self._pressed.update(code for code in _ZERO_LIFTS if values.get(code, 0) > 0)
            is_down = now >= 0 and self._touches(slot)
            before = slot.tracking_id
            if before is not None and not (is_down and before == now):
                ups.append(self._event(t_s, slot.touch_id, values)._replace(kind="up"))
                slot.tracking_id = None
            if is_down and slot.tracking_id is None:
                down = (one.touch_id for one in self._slots.values() if one.tracking_id is not None)
                slot.touch_id = free_id([*down, *(one.touch_id for one in ups)])
            if is_down:
                event = self._event(t_s, slot.touch_id, values)
                others.append(event if before == now else event._replace(kind="down"))
                slot.tracking_id = now
        if self._protocol == "A":
            self._slots = {
                number: slot
                for number, slot in self._slots.items()
                if slot.values[ABS_MT_TRACKING_ID] >= 0
            }
        return ups + others

    def _touches(self, slot: _Slot) -> bool:
        """Return whether a contact is on the glass."""
        values = self._unknown | slot.values
        if ABS_MT_POSITION_X not in values or ABS_MT_POSITION_Y not in values:
            return False
        if self._is_touched is False or values.get(ABS_MT_DISTANCE, 0) != 0:
            return False
        # As in Android, a finger whose pressure becomes 0 is above the glass; drivers of protocol A
        # say the same by its width. Where neither has been above 0, the panel does not measure it.
        for code in _ZERO_LIFTS[: 1 + (self._protocol == "A")]:
            if code in self._pressed and values.get(code, 0) <= 0:
                return False
        return values.get(ABS_MT_TOOL_TYPE) != MT_TOOL_PALM

    def _place(self, values: Mapping[int, int]) -> tuple[float, float]:
        x, y = self.axes.x.low, self.axes.y.low  # of a slot that went up and was then lost
        return self.axes.place_mm(
            values.get(ABS_MT_POSITION_X, x), values.get(ABS_MT_POSITION_Y, y)
        )

    def _event(self, t_s: float, touch_id: int, values: Mapping[int, int]) -> TouchEvent:
        axes = self.axes
        force = area = None
        if axes.force_n_per_unit is not None and (pressure := values.get(ABS_MT_PRESSURE, 0)) > 0:
            force = pressure * axes.force_n_per_unit
        if (major := values.get(ABS_MT_TOUCH_MAJOR, 0)) > 0:
            minor = values.get(ABS_MT_TOUCH_MINOR, 0) or major
            per_m = 1e3 * (axes.area_units_per_mm or axes.x.per_mm)
            area = pi / 4 * major * minor / per_m**2
        return TouchEvent(t_s, touch_id, *self._place(values), "move", force, area)


class Touchscreen:
    """A touchscreen, read without waiting: multi-touch protocols B and A, or single touch.

    Time stamps are on the clock of `time.monotonic`: those of the kernel, or of the panel's own
    clock where it agrees, see `PanelClock`.

    Parameters
    ----------
    path : path
        Device file, such as "/dev/input/event5"; `find_touchscreens` lists them.
    width_mm, height_mm : float, optional
        Size of the touch-sensitive area; needed where the driver gives none, or none that one can
        rely on: the kernel rounds resolutions to whole units per mm.
    force_n_per_unit, area_units_per_mm : float, optional
        See `ScreenAxes`.
    matrix : tuple of 6 float, or str, optional
        How the panel lies on the picture, see `ScreenAxes`; by default as the system has it, in
        udev's LIBINPUT_CALIBRATION_MATRIX.

    Raises
    ------
    DeviceError
        If it cannot be opened, or the package evdev is missing.
    InputError
        If it is no touchscreen, or its size is unknown.
    """

    def __init__(
        self,
        path: str | Path,
        width_mm: float | None = None,
        height_mm: float | None = None,
        force_n_per_unit: float | None = None,
        area_units_per_mm: float | None = None,
        matrix: Matrix | str | None = None,
    ) -> None:
        evdev = evdev_module()
        try:
            self._device = evdev.InputDevice(str(path))
        except PermissionError:
            raise DeviceError(f"cannot open the touchscreen {path}: {NO_PERMISSION}") from None
        except OSError as error:
            raise DeviceError(
                f"cannot open the touchscreen {path}: {error.strerror}; is it there?"
            ) from None
        try:
            capabilities = self._device.capabilities()
            ranges = dict(capabilities.get(EV_ABS, []))
            matrix = system_matrix(path) if matrix is None else matrix
            units = force_n_per_unit, area_units_per_mm
            try:
                self.axes = ScreenAxes.of(ranges, width_mm, height_mm, *units, matrix)
            except InputError as error:
                raise InputError(f"{path}: {error}") from None
            protocol = protocol_of(ranges)
            assert protocol is not None
            self.protocol: Protocol = protocol
            """Of its events: "B", "A", or "single"."""
            self._slots = ranges[ABS_MT_SLOT].max + 1 if protocol == "B" else 1
            codes = SINGLE_CODES if protocol == "single" else SLOT_CODES
            self._codes = [code for code in codes if code in ranges]
            _fcntl().ioctl(self._device.fd, _EVIOCSCLOCKID, struct.pack("i", _CLOCK_MONOTONIC))
            ask = {"B": self._ask, "A": None, "single": self._ask_single}[protocol]
            has_key = BTN_TOUCH in capabilities.get(EV_KEY, [])
            self._decoder = SlotDecoder(
                self.axes, ask, protocol, self._is_touched if has_key else None
            )
        except OSError as error:
            self.close()
            raise DeviceError(f"{path}: {error.strerror}") from None
        except BaseException:
            self.close()
            raise

    @property
    def name(self) -> str:
        """Name that the driver gives."""
        return str(self._device.name)

    @property
    def dropped(self) -> int:
        """Number of times that the kernel has dropped events that were not read in time."""
        return self._decoder.dropped

    def read(self, timeout_s: float = 0.0) -> list[TouchEvent]:
        """Return the events so far; if there are none, wait for up to `timeout_s`.

        Raises
        ------
        DeviceError
            If the touchscreen is gone.
        """
        fd = self._device.fd
        if not select.select([fd], [], [], timeout_s)[0]:
            return []
        try:
            return self._decoder.feed_bytes(os.read(fd, _READ_BYTES))
        except OSError as error:
            raise DeviceError(f"the touchscreen {self._device.path}: {error.strerror}") from None

    def close(self) -> None:
        """Close the device."""
        self._device.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _ask(self) -> tuple[int, Mapping[int, Mapping[int, int]]]:
        """Current slot and the values of all, from the kernel (EVIOCGMTSLOTS)."""
        values: dict[int, dict[int, int]] = {slot: {} for slot in range(self._slots)}
        layout = struct.Struct(f"I{self._slots}i")
        for code in self._codes:
            buffer = bytearray(layout.pack(code, *[0] * self._slots))
            _fcntl().ioctl(self._device.fd, _eviocgmtslots(layout.size), buffer)
            for slot, value in enumerate(layout.unpack(buffer)[1:]):
                values[slot][code] = value
        return self._device.absinfo(ABS_MT_SLOT).value, values

    def _ask_single(self) -> tuple[int, Mapping[int, Mapping[int, int]]]:
        """Values of the only finger, by the codes of a slot (EVIOCGABS)."""
        values = {SINGLE_CODES[code]: self._device.absinfo(code).value for code in self._codes}
        return 0, {0: values}

    def _is_touched(self) -> bool:
        return BTN_TOUCH in self._device.active_keys()


def _eviocgmtslots(length: int) -> int:
    return 0x8000450A | length << 16


def _fcntl() -> Any:
    import fcntl  # here, because other systems, which lack it, import this module too

    return fcntl


def evdev_module() -> Any:
    """Return the package evdev; `MissingExtraError` without it."""
    if not sys.platform.startswith("linux"):
        raise DeviceError("touchscreens are read through evdev, which is for Linux only")
    with from_extra("evdev"):
        import evdev
    return evdev
