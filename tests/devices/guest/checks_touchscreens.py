"""Checks of touchscreens: evdev, against ones made with uinput."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from haptix.base.errors import DeviceError, InputError
from haptix.play.touch import Touches, Touchscreen, find_touchscreens
from haptix.play.touch import touchscreen as codes
from tests.devices.guest.ways import check, error_of, require

_NAME = "haptix test touchscreen"


@contextmanager
def _touchscreen(resolution: int = 20, slots: int = 3) -> Iterator[tuple[Any, str]]:
    """Make a touchscreen; give the side that writes its events, and its path."""
    from evdev import AbsInfo, UInput
    from evdev import ecodes as e

    def axis(low: int, high: int, res: int = 0) -> AbsInfo:
        return AbsInfo(low if low > 0 else 0, low, high, 0, 0, res)

    absolute: list[Any] = [
        (e.ABS_MT_POSITION_X, axis(100, 3300, resolution)),
        (e.ABS_MT_POSITION_Y, axis(0, 2250, resolution)),
        (e.ABS_MT_TRACKING_ID, axis(0, 65535)),
        (e.ABS_MT_TOUCH_MAJOR, axis(0, 1000, resolution)),
        (e.ABS_MT_PRESSURE, axis(0, 255)),
    ]
    if slots:
        absolute.append((e.ABS_MT_SLOT, axis(0, slots - 1)))
    with UInput({e.EV_ABS: absolute, e.EV_KEY: [e.BTN_TOUCH]}, name=_NAME) as side:
        yield side, str(side.device.path)


def _write(side: Any, *values: tuple[int, int]) -> None:
    for code, value in values:
        side.write(codes.EV_ABS, code, value)
    side.syn()


def _equal(got: object, expected: object) -> None:
    require(got == expected, f"{got!r} instead of {expected!r}")


def _refuses(kind: type[Exception], text: str, path: str, **sizes: float) -> None:
    error = error_of(lambda: Touchscreen(path, **sizes))
    require(type(error) is kind and text in str(error), repr(error))


@check()
def two_fingers() -> dict[str, float]:
    """Places, force, area and times of two fingers that come and go."""
    with _touchscreen() as (side, path):
        require((path, _NAME) in list(find_touchscreens()), list(find_touchscreens()))
        with Touchscreen(path, force_n_per_unit=0.01) as screen:
            _equal(screen.name, _NAME)
            _equal(screen.read(), [])
            before_s = time.monotonic()
            _write(
                side,
                (codes.ABS_MT_SLOT, 0),
                (codes.ABS_MT_TRACKING_ID, 5),
                (codes.ABS_MT_POSITION_X, 900),
                (codes.ABS_MT_POSITION_Y, 500),
                (codes.ABS_MT_TOUCH_MAJOR, 160),
                (codes.ABS_MT_PRESSURE, 50),
            )
            (first,) = screen.read(1.0)
            after_s = time.monotonic()
            _equal(first[1:6], (5, 40.0, 25.0, "down", 0.5))
            # Stamped by the kernel on the clock of time.monotonic.
            require(before_s <= first.t_s <= after_s, before_s, first.t_s, after_s)
            wrong = first.contact_area_m2 / (3.14159265 / 4 * 8e-3**2) - 1
            require(abs(wrong) < 1e-6, first.contact_area_m2)
            _write(
                side,
                (codes.ABS_MT_SLOT, 2),
                (codes.ABS_MT_TRACKING_ID, 6),
                (codes.ABS_MT_POSITION_X, 3300),
                (codes.ABS_MT_POSITION_Y, 2250),
            )
            _equal(
                [event[1:5] for event in screen.read(1.0)],
                [(5, 40.0, 25.0, "move"), (6, 160.0, 112.5, "down")],
            )
            _write(side, (codes.ABS_MT_SLOT, 0), (codes.ABS_MT_TRACKING_ID, -1))
            _equal([event[1::3] for event in screen.read(1.0)], [(5, "up"), (6, "move")])
    return {"seen_after_s": after_s - before_s}


@check()
def a_finger_that_was_down_before() -> dict[str, float]:
    """A finger that touched before the screen was opened is down at its first event."""
    with _touchscreen() as (side, path):
        _write(
            side,
            (codes.ABS_MT_SLOT, 1),
            (codes.ABS_MT_TRACKING_ID, 9),
            (codes.ABS_MT_POSITION_X, 900),
            (codes.ABS_MT_POSITION_Y, 500),
        )
        with Touchscreen(path) as screen:
            _write(side, (codes.ABS_MT_POSITION_X, 1100))
            _equal([event[1:5] for event in screen.read(1.0)], [(9, 50.0, 25.0, "down")])
    return {}


@check()
def events_that_the_kernel_drops() -> dict[str, float]:
    """Nobody reads: the finger moves often, goes up, and another comes down."""
    with _touchscreen() as (side, path), Touchscreen(path) as screen:
        _write(
            side,
            (codes.ABS_MT_SLOT, 0),
            (codes.ABS_MT_TRACKING_ID, 1),
            (codes.ABS_MT_POSITION_X, 900),
            (codes.ABS_MT_POSITION_Y, 500),
        )
        touches = Touches(strict=True)
        for event in screen.read(1.0):
            touches.push(event)
        for i in range(1000):
            _write(side, (codes.ABS_MT_POSITION_X, 901 + i))
        _write(side, (codes.ABS_MT_TRACKING_ID, -1))
        _write(side, (codes.ABS_MT_TRACKING_ID, 2), (codes.ABS_MT_POSITION_X, 2100))
        while events := screen.read(0.1):
            for event in events:
                touches.push(event)
        require(screen.dropped >= 1, screen.dropped)
        ((touch_id, tracker),) = touches.active
        _equal(touch_id, 2)
        # 100 mm from the upper left, at rest since it came down.
        _equal(tracker.at(tracker.last_t_s)[1:3], (100.0, 25.0))
        return {"dropped": screen.dropped}


@check()
def a_touchscreen_that_goes_away() -> dict[str, float]:
    """The error says so."""
    with _touchscreen() as (side, path), Touchscreen(path) as screen:
        side.close()
        error = error_of(lambda: screen.read(1.0))
        require(type(error) is DeviceError and "No such device" in str(error), repr(error))
    return {}


@check()
def a_driver_that_does_not_say_its_size() -> dict[str, float]:
    """The size has to be given, and is taken as given."""
    with _touchscreen(resolution=0) as (_, path):
        _refuses(InputError, "width_mm", path)
        with Touchscreen(path, width_mm=160.0, height_mm=90.0) as screen:
            _equal((screen.axes.x.per_mm, screen.axes.y.per_mm), (20.0, 25.0))
        _refuses(InputError, "height_mm", path, width_mm=160.0, height_mm=-1.0)
    return {}


@check()
def a_touchscreen_without_slots() -> dict[str, float]:
    """It does not tell its fingers apart."""
    with _touchscreen(slots=0) as (_, path):
        _refuses(InputError, "protocol B", path)
    return {}
