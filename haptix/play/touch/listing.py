"""Touchscreens of this machine: their names, their properties and oddities."""

from __future__ import annotations

import re
import struct
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import NamedTuple

from haptix.base.errors import InputError
from haptix.play.touch.orientation import Matrix, system_matrix
from haptix.play.touch.touchscreen import (
    ABS_MT_SLOT,
    BTN_TOUCH,
    EV_ABS,
    NO_PERMISSION,
    Protocol,
    ScreenAxes,
    evdev_module,
    protocol_of,
    size_problem,
)

# linux/input-event-codes.h
_PROP_POINTER, _PROP_DIRECT = 0x00, 0x01
_BTN_MOUSE, _BTN_JOYSTICK, _BTN_GAMEPAD = 0x110, 0x120, 0x130
_BTN_TOOL_PEN, _BTN_TOOL_FINGER, _BTN_STYLUS = 0x140, 0x145, 0x14B
_LONG_BITS = 8 * struct.calcsize("l")


class TouchscreenInfo(NamedTuple):
    """A touchscreen of this machine.

    Parameters
    ----------
    path, name : str
        Device file, and the name that the driver gives.
    protocol : {"B", "A", "single"}
        Of its events: with slots, without, or of one finger.
    slots : int or None
        Number of fingers that it tells apart; None where it cannot be read or is not stated.
    size_mm : tuple of float, or None
        Width and height that the driver states, where one can rely on them.
    most_hz : float or None
        Most reports per second that its USB link carries; None where it is on another bus.
    odd : tuple of str
        What to know or to do before it is used.
    """

    path: str
    name: str
    protocol: Protocol
    slots: int | None
    size_mm: tuple[float, float] | None
    most_hz: float | None
    odd: tuple[str, ...]


def find_touchscreens(root: Path = Path("/")) -> Iterator[TouchscreenInfo]:
    """Yield the touchscreens of this machine, also those that one may not read.

    As udev does: devices whose places are those of a screen (INPUT_PROP_DIRECT), and those of older
    drivers that have BTN_TOUCH and nothing of a touchpad, tablet, mouse or game pad.

    Parameters
    ----------
    root : Path
        Where ``sys`` and ``dev`` lie.

    Raises
    ------
    DeviceError
        On another system than Linux, or if the package evdev is missing.
    """
    evdev_module()  # before anything else, to name a missing package
    folders = (root / "sys/class/input").glob("event*")
    for folder in sorted(folders, key=lambda path: (len(path.name), path.name)):
        device = folder / "device"
        codes, keys = _bits(device / "capabilities/abs"), _bits(device / "capabilities/key")
        protocol = protocol_of(codes)
        if protocol is None or not _is_screen(_bits(device / "properties"), keys):
            continue
        path = root / "dev/input" / folder.name
        name = (device / "name").read_text(errors="replace").strip()
        slots = size_mm = None
        odd = []
        if protocol == "A":
            odd.append("tells no fingers apart (protocol A): they are matched by their places")
        if protocol == "single":
            slots = 1
            odd.append("single touch: one finger")
        try:
            slots, size_mm, more = _opened(path, slots)
            odd += more
        except PermissionError:
            odd.append(NO_PERMISSION)
        except OSError as error:
            odd.append(f"cannot be opened: {error.strerror}")
        yield TouchscreenInfo(
            str(path), name, protocol, slots, size_mm, _most_hz(device), tuple(odd)
        )


def _opened(
    path: Path, slots: int | None
) -> tuple[int | None, tuple[float, float] | None, list[str]]:
    """Return slots, size and oddities of a touchscreen that is opened for it."""
    device = evdev_module().InputDevice(str(path))
    try:
        ranges = dict(device.capabilities().get(EV_ABS, []))
    finally:
        device.close()
    if ABS_MT_SLOT in ranges:
        slots = ranges[ABS_MT_SLOT].max + 1
    odd = []
    matrix: Matrix | str = "normal"
    try:
        matrix = system_matrix(path)
    except InputError as error:
        odd.append(str(error))
    if problem := size_problem(ranges):
        odd.append(f"{problem}: measure it, or haptix touchscreen calibrate {path}")
        return slots, None, odd
    return slots, ScreenAxes.of(ranges, matrix=matrix).size_mm, odd


def _most_hz(device: Path) -> float | None:
    """Return the polls per second of a USB device's interrupt endpoint."""
    for folder in device.resolve().parents:
        for interval in sorted(folder.glob("ep_8?/interval")):
            if (
                told := re.match(r"(\d+)(us|ms)", interval.read_text(encoding="utf-8"))
            ) is not None:
                return {"us": 1e6, "ms": 1e3}[told[2]] / int(told[1])
    return None


def _bits(path: Path) -> set[int]:
    """Return the codes of a bitmap of sysfs: words of a long, the highest first."""
    try:
        words = path.read_text(encoding="utf-8").split()
    except OSError:
        return set()
    number = 0
    for word in words:
        number = number << _LONG_BITS | int(word, 16)
    return {bit for bit in range(number.bit_length()) if number >> bit & 1}


def _is_screen(properties: Collection[int], keys: Collection[int]) -> bool:
    if _PROP_POINTER in properties or _BTN_TOOL_PEN in keys or _BTN_STYLUS in keys:
        return False
    if _PROP_DIRECT in properties:
        return True
    others = (_BTN_TOOL_FINGER, _BTN_MOUSE, _BTN_JOYSTICK, _BTN_GAMEPAD)
    return BTN_TOUCH in keys and not any(key in keys for key in others)
