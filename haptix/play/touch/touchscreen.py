"""Touchscreens of this machine, through Linux evdev (the extra `evdev`)."""

from __future__ import annotations

import os
import select
import struct
import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from math import inf, pi
from pathlib import Path
from typing import Any, Self

from haptix.base import checks
from haptix.base.checks import Positive, checked
from haptix.base.errors import DeviceError, InputError, from_extra
from haptix.play.touch.events import TouchEvent

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
"""Codes whose values the decoder stores for each slot."""

INPUT_EVENT = struct.Struct("llHHi")
"""struct input_event: seconds, microseconds, type, code, value."""

SlotValues = Callable[[], tuple[int, Mapping[int, Mapping[int, int]]]]
"""Returns, from the kernel, the current slot and the values of each slot by code."""

_CLOCK_MONOTONIC = 1
_READ_BYTES = 24 * 256
# linux/input.h: _IOW('E', 0xa0, int) and _IOR('E', 0x0a, len)
_EVIOCSCLOCKID = 0x400445A0


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

    def mm(self, value: int) -> float:
        """Return the place on the axis [mm] from its low end."""
        return (value - self.low) / self.per_mm


@checked()
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


@dataclass
class _Slot:
    """Last values of a slot. They stay after a touch, since the device sends only changes."""

    values: dict[int, int] = field(default_factory=dict)
    touch_id: int | None = None
    """Id of the touch that was last reported as down."""


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
        """Number of times that the kernel has dropped events."""
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
        self._current, slots = self._ask()
        for number, values in slots.items():
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


class Touchscreen:
    """A touchscreen of multi-touch protocol B, read without waiting.

    Time stamps are those of the kernel, on the clock of `time.monotonic`.

    Parameters
    ----------
    path : path
        Device file, such as "/dev/input/event5"; `find_touchscreens` lists them.
    width_mm, height_mm : float, optional
        Size of the touch-sensitive area; needed if the driver gives no resolution, which it
        overrides.
    force_n_per_unit, area_units_per_mm : float, optional
        See `ScreenAxes`.

    Raises
    ------
    DeviceError
        If it cannot be opened, or the package evdev is missing.
    InputError
        If it is not a multi-touch screen of protocol B, or its size is unknown.
    """

    def __init__(
        self,
        path: str | Path,
        width_mm: float | None = None,
        height_mm: float | None = None,
        force_n_per_unit: float | None = None,
        area_units_per_mm: float | None = None,
    ) -> None:
        evdev = _evdev()
        try:
            self._device = evdev.InputDevice(str(path))
        except OSError as error:
            raise DeviceError(
                f"cannot open the touchscreen {path}: {error.strerror}; is it there, and may you "
                'read it (group "input")?'
            ) from None
        try:
            ranges = dict(self._device.capabilities().get(EV_ABS, []))
            self.axes = ScreenAxes(
                _axis(path, "width_mm", ranges, ABS_MT_POSITION_X, width_mm),
                _axis(path, "height_mm", ranges, ABS_MT_POSITION_Y, height_mm),
                force_n_per_unit,
                area_units_per_mm,
            )
            if ABS_MT_SLOT not in ranges:
                raise InputError(
                    f"{path}: expected multi-touch slots (protocol B), but it has none"
                )
            self._slots = ranges[ABS_MT_SLOT].max + 1
            self._codes = [code for code in SLOT_CODES if code in ranges]
            _fcntl().ioctl(self._device.fd, _EVIOCSCLOCKID, struct.pack("i", _CLOCK_MONOTONIC))
            self._decoder = SlotDecoder(self.axes, self._ask)
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


def find_touchscreens() -> Iterator[tuple[str, str]]:
    """Yield path and name of each multi-touch device that can be read."""
    evdev = _evdev()
    for path in evdev.list_devices():
        try:
            device = evdev.InputDevice(path)
        except OSError:
            continue
        try:
            if ABS_MT_SLOT in dict(device.capabilities().get(EV_ABS, [])):
                yield path, device.name
        finally:
            device.close()


def _eviocgmtslots(length: int) -> int:
    return 0x8000450A | length << 16


def _fcntl() -> Any:
    import fcntl  # here, because other systems, which lack it, import this module too

    return fcntl


def _evdev() -> Any:
    if not sys.platform.startswith("linux"):
        raise DeviceError("touchscreens are read through evdev, which is for Linux only")
    with from_extra("evdev"):
        import evdev
    return evdev


def _axis(
    path: str | Path, name: str, ranges: Mapping[int, Any], code: int, size_mm: float | None
) -> AxisRange:
    if code not in ranges:
        raise InputError(f"{path}: expected a multi-touch screen, but it reports no places")
    info = ranges[code]
    if size_mm is not None:
        checks.positive(name, size_mm)
        return AxisRange(info.min, info.max, (info.max - info.min) / size_mm)
    if info.resolution <= 0:
        raise InputError(f"{path}: the driver gives no size; give {name}")
    return AxisRange(info.min, info.max, info.resolution)
