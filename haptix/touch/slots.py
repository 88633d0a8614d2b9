"""Linux multi-touch events to touches: protocol B, in which each finger has a slot.

As in the kernel's Documentation/input/multi-touch-protocol.rst and event-codes.rst. This module
needs no device: it takes the events that one writes.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from math import inf, pi

from haptix.checks import Positive, check_fields
from haptix.errors import InputError
from haptix.touch.events import TouchEvent

# linux/input-event-codes.h
EV_SYN, EV_ABS = 0x00, 0x03
SYN_REPORT, SYN_DROPPED = 0x00, 0x03
ABS_MT_SLOT = 0x2F
ABS_MT_TOUCH_MAJOR, ABS_MT_TOUCH_MINOR = 0x30, 0x31
ABS_MT_POSITION_X, ABS_MT_POSITION_Y = 0x35, 0x36
ABS_MT_TOOL_TYPE, ABS_MT_TRACKING_ID, ABS_MT_PRESSURE = 0x37, 0x39, 0x3A
MT_TOOL_PALM = 0x02

SLOT_CODES = (
    ABS_MT_TRACKING_ID, ABS_MT_POSITION_X, ABS_MT_POSITION_Y, ABS_MT_TOUCH_MAJOR,
    ABS_MT_TOUCH_MINOR, ABS_MT_PRESSURE, ABS_MT_TOOL_TYPE,
)  # fmt: skip
"""Codes whose values are kept for each slot."""

INPUT_EVENT = struct.Struct("llHHi")
"""struct input_event: seconds, microseconds, type, code, value."""


@dataclass(frozen=True)
class AxisRange:
    """An axis in its own units: lowest and highest value, and units per millimetre."""

    low: int
    high: int
    per_mm: float

    def __post_init__(self) -> None:
        if not (self.low < self.high and 0 < self.per_mm < inf):
            raise InputError(
                f"axis: expected low < high and units per mm above 0, got {self.low}, {self.high} "
                f"and {self.per_mm:g}"
            )

    def mm(self, value: int) -> float:
        """Return the place on the axis [mm] from its low end."""
        return (value - self.low) / self.per_mm


@dataclass(frozen=True)
class ScreenAxes:
    """Units of a touchscreen's numbers.

    Parameters
    ----------
    x, y : AxisRange
        Places from the upper left corner, as screens count.
    force_n_per_unit : float, optional
        Unit of ABS_MT_PRESSURE, which differs between screens; without it pressure is not used.
    area_units_per_mm : float, optional
        Unit of ABS_MT_TOUCH_MAJOR and MINOR; the default is that of `x`, as the kernel asks of
        drivers. They are the axes of an ellipse, or of a circle where there is no minor axis.
    """

    x: AxisRange
    y: AxisRange
    force_n_per_unit: Positive | None = None
    area_units_per_mm: Positive | None = None

    def __post_init__(self) -> None:
        check_fields(self)


@dataclass
class _Slot:
    """Last values of a slot. They outlive a touch, since unchanged values are not sent again."""

    values: dict[int, int] = field(default_factory=dict)
    touch_id: int | None = None
    """Id of the touch that was last reported as down."""


SlotValues = Callable[[], tuple[int, Mapping[int, Mapping[int, int]]]]
"""Returns, from the kernel, the current slot and the values of each slot by code."""


class SlotDecoder:
    """Turns the events of a device into touches, once per SYN_REPORT.

    Every finger that is down is reported each time, whether it moved or not. A palm is not a touch.
    When the kernel has dropped events (SYN_DROPPED), `ask` returns the slots. Without `ask` all
    touches go up, and a finger returns when it comes down the next time.

    Parameters
    ----------
    axes : ScreenAxes
        Units of the screen.
    ask : callable, optional
        Returns the current slot and the values of all, for fingers that are down at the start or
        when events were lost.
    """

    def __init__(self, axes: ScreenAxes, ask: SlotValues | None = None) -> None:
        self.axes = axes
        self.dropped = 0
        """How often the kernel has dropped events."""
        self._ask = ask
        self._slots: dict[int, _Slot] = {}
        self._current = 0
        self._is_broken = False
        self._rest = b""
        if ask is not None:
            self._refresh()

    def feed_bytes(self, data: bytes) -> list[TouchEvent]:
        """Take bytes of a device file; an incomplete event waits for its rest."""
        data = self._rest + data
        whole = len(data) - len(data) % INPUT_EVENT.size
        self._rest = data[whole:]
        return [
            touch for event in INPUT_EVENT.iter_unpack(data[:whole]) for touch in self.feed(*event)
        ]

    def feed(self, sec: int, usec: int, kind: int, code: int, value: int) -> list[TouchEvent]:
        """Take one event; at a SYN_REPORT, return the touches since the one before."""
        if kind == EV_SYN:
            if code == SYN_DROPPED:
                self.dropped += 1
                self._is_broken = True
            elif code == SYN_REPORT:
                if self._is_broken:
                    self._is_broken = False
                    self._refresh()
                return self._report(sec + usec * 1e-6)
        elif kind == EV_ABS and not self._is_broken:
            if code == ABS_MT_SLOT:
                self._current = value
            elif code in SLOT_CODES:
                slot = self._slots.setdefault(self._current, _Slot())
                slot.values[code] = value
        return []

    def _refresh(self) -> None:
        if self._ask is None:
            for slot in self._slots.values():
                slot.values[ABS_MT_TRACKING_ID] = -1
            return
        self._current, found = self._ask()
        for number, values in found.items():
            self._slots.setdefault(number, _Slot()).values = dict(values)

    def _report(self, t_s: float) -> list[TouchEvent]:
        ups: list[TouchEvent] = []
        others: list[TouchEvent] = []
        for slot in self._slots.values():
            values = slot.values
            now = values.get(ABS_MT_TRACKING_ID, -1)
            has_place = ABS_MT_POSITION_X in values and ABS_MT_POSITION_Y in values
            is_down = now >= 0 and has_place and values.get(ABS_MT_TOOL_TYPE) != MT_TOOL_PALM
            before = slot.touch_id
            if before is not None and not (is_down and before == now):
                ups.append(self._event(t_s, before, values)._replace(kind="up"))
                slot.touch_id = None
            if is_down:
                event = self._event(t_s, now, values)
                others.append(event if before == now else event._replace(kind="down"))
                slot.touch_id = now
        return ups + others

    def _event(self, t_s: float, touch_id: int, values: Mapping[int, int]) -> TouchEvent:
        axes = self.axes
        force = area = None
        if axes.force_n_per_unit is not None and (pressure := values.get(ABS_MT_PRESSURE, 0)) > 0:
            force = pressure * axes.force_n_per_unit
        if (major := values.get(ABS_MT_TOUCH_MAJOR, 0)) > 0:
            minor = values.get(ABS_MT_TOUCH_MINOR, 0) or major
            per_m = 1e3 * (axes.area_units_per_mm or axes.x.per_mm)
            area = pi / 4 * major * minor / per_m**2
        return TouchEvent(
            t_s, touch_id, axes.x.mm(values[ABS_MT_POSITION_X]),
            axes.y.mm(values[ABS_MT_POSITION_Y]), "move", force, area,
        )  # fmt: skip
