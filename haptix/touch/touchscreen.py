"""Touchscreens of this machine, through Linux evdev (the extra `evdev`)."""

from __future__ import annotations

import os
import select
import struct
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Self

from haptix import checks
from haptix.errors import DeviceError, InputError, from_extra
from haptix.touch.events import TouchEvent
from haptix.touch.slots import (
    ABS_MT_POSITION_X,
    ABS_MT_POSITION_Y,
    ABS_MT_SLOT,
    EV_ABS,
    SLOT_CODES,
    AxisRange,
    ScreenAxes,
    SlotDecoder,
)

_CLOCK_MONOTONIC = 1
_READ_BYTES = 24 * 256


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
        """How often the kernel has dropped events because they were not read in time."""
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
        found: dict[int, dict[int, int]] = {slot: {} for slot in range(self._slots)}
        layout = struct.Struct(f"I{self._slots}i")
        for code in self._codes:
            buffer = bytearray(layout.pack(code, *[0] * self._slots))
            _fcntl().ioctl(self._device.fd, _eviocgmtslots(layout.size), buffer)
            for slot, value in enumerate(layout.unpack(buffer)[1:]):
                found[slot][code] = value
        return self._device.absinfo(ABS_MT_SLOT).value, found


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


# linux/input.h: _IOW('E', 0xa0, int) and _IOR('E', 0x0a, len)
_EVIOCSCLOCKID = 0x400445A0


def _eviocgmtslots(length: int) -> int:
    return 0x8000450A | length << 16


def _fcntl() -> Any:
    import fcntl  # Linux only, as all of this; the module is imported on other systems too

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
