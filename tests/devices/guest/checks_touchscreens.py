"""Checks of touchscreens: evdev, against ones made with uinput."""

import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path
from typing import Any

from haptix.base.errors import DeviceError, InputError
from haptix.play.touch import Touches, Touchscreen, find_touchscreens
from haptix.play.touch import touchscreen as codes
from tests.devices.guest.ways import Elsewhere, check, error_of, require

_NAME = "haptix test touchscreen"
_DIRECT = 1  # INPUT_PROP_DIRECT
_TID = codes.ABS_MT_TRACKING_ID


def _axis(low: int, high: int, res: int = 0) -> Any:
    from evdev import AbsInfo

    return AbsInfo(low if low > 0 else 0, low, high, 0, 0, res)


@contextmanager
def _device(
    absolute: Mapping[int, Any], keys: tuple[int, ...] = (codes.BTN_TOUCH,), direct: bool = True
) -> Iterator[tuple[Any, str]]:
    """Make an input device; give the side that writes its events, and its path."""
    from evdev import UInput

    capabilities: Any = {codes.EV_ABS: [*absolute.items()], codes.EV_KEY: [*keys]}
    properties = [_DIRECT] if direct else []
    with UInput(capabilities, name=_NAME, input_props=properties) as side:
        yield side, str(side.device.path)


@contextmanager
def _touchscreen(resolution: int = 20, slots: int = 3) -> Iterator[tuple[Any, str]]:
    """Make a touchscreen of protocol B, or of protocol A without slots."""
    absolute = {
        codes.ABS_MT_POSITION_X: _axis(100, 3300, resolution),
        codes.ABS_MT_POSITION_Y: _axis(0, 2250, resolution),
        codes.ABS_MT_TOUCH_MAJOR: _axis(0, 1000, resolution),
        codes.ABS_MT_PRESSURE: _axis(0, 255),
        codes.ABS_MT_DISTANCE: _axis(0, 20),
    }
    if slots:
        absolute[codes.ABS_MT_TRACKING_ID] = _axis(0, 65535)
        absolute[codes.ABS_MT_SLOT] = _axis(0, slots - 1)
    with _device(absolute) as made:
        yield made


def _write(side: Any, *values: tuple[int, int], touched: bool = True) -> None:
    for code, value in values:
        side.write(codes.EV_ABS, code, value)
    side.write(codes.EV_KEY, codes.BTN_TOUCH, int(touched))
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
        (found,) = [info for info in find_touchscreens() if info.path == path]
        _equal(found, (path, _NAME, "B", 3, (160.0, 112.5), None, ()))
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
            _equal(first[1:6], (1, 40.0, 25.0, "down", 0.5))  # the kernel's 5 and 6 are 1 and 2
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
                (codes.ABS_MT_PRESSURE, 30),
            )
            _equal(
                [event[1:5] for event in screen.read(1.0)],
                [(1, 40.0, 25.0, "move"), (2, 160.0, 112.5, "down")],
            )
            _write(side, (codes.ABS_MT_SLOT, 0), (codes.ABS_MT_TRACKING_ID, -1))
            _equal([event[1::3] for event in screen.read(1.0)], [(1, "up"), (2, "move")])
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
            _equal([event[1:5] for event in screen.read(1.0)], [(1, 50.0, 25.0, "down")])
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
        _equal(touch_id, 1)  # free again since the first went up
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


def _told(screen: Any) -> list[Any]:
    return [(touch.kind, round(touch.x_mm, 2), round(touch.y_mm, 2)) for touch in screen.read(0.3)]


@check()
def protocol_a() -> dict[str, float]:
    """Contacts without slots are matched from report to report, and lift with an empty one."""
    x, y = codes.ABS_MT_POSITION_X, codes.ABS_MT_POSITION_Y

    def report(*places: tuple[int, int], distance: int = 0) -> None:
        for place in places or [()]:
            for code, value in zip((x, y), place, strict=False):
                side.write(codes.EV_ABS, code, value)
            if place:
                side.write(codes.EV_ABS, codes.ABS_MT_DISTANCE, distance)
            side.write(codes.EV_SYN, codes.SYN_MT_REPORT, 0)
        side.write(codes.EV_KEY, codes.BTN_TOUCH, int(bool(places)))
        side.syn()

    with _touchscreen(slots=0) as (side, path):
        (found,) = [info for info in find_touchscreens() if info.path == path]
        _equal(found.protocol, "A")
        with Touchscreen(path) as screen:
            report((300, 200), distance=4)
            _equal(_told(screen), [])
            report((300, 200), (2000, 1000))
            _equal(_told(screen), [("down", 10.0, 10.0), ("down", 95.0, 50.0)])
            report((2020, 1000), (320, 200))
            moved = sorted(screen.read(0.3), key=lambda touch: touch.touch_id)
            _equal([touch.x_mm for touch in moved], [11.0, 96.0])
            report()
            _equal([kind for kind, *_ in _told(screen)], ["up", "up"])
    return {}


@check()
def single_touch() -> dict[str, float]:
    """One finger by BTN_TOUCH, also one that touched before the screen was opened."""
    absolute = {codes.ABS_X: _axis(0, 4000, 20), codes.ABS_Y: _axis(0, 2000, 20)}
    with _device(absolute, direct=False) as (side, path):
        (found,) = [info for info in find_touchscreens() if info.path == path]
        _equal((found.protocol, found.slots, found.size_mm), ("single", 1, (200.0, 100.0)))
        _write(side, (codes.ABS_X, 400), (codes.ABS_Y, 200))
        with Touchscreen(path) as screen:
            _write(side, (codes.ABS_X, 420))
            _equal(_told(screen), [("down", 21.0, 10.0)])
            _write(side, touched=False)
            _equal([kind for kind, *_ in _told(screen)], ["up"])
            _write(side, (codes.ABS_X, 800), touched=False)
            _equal(_told(screen), [])
    return {}


@check()
def a_touchpad_and_a_game_pad_are_no_touchscreens() -> dict[str, float]:
    """Neither is listed."""
    places = {
        codes.ABS_MT_POSITION_X: _axis(0, 2000, 20),
        codes.ABS_MT_POSITION_Y: _axis(0, 1000, 20),
        codes.ABS_MT_SLOT: _axis(0, 4),
        codes.ABS_MT_TRACKING_ID: _axis(0, 65535),
    }
    btn_tool_finger, btn_gamepad = 0x145, 0x130
    for key in (btn_tool_finger, btn_gamepad):
        with _device(places, (codes.BTN_TOUCH, key), direct=False) as (_, path):
            require(path not in [info.path for info in find_touchscreens()], hex(key))
    return {}


@check()
def a_touchscreen_that_one_may_not_read() -> dict[str, float]:
    """It is listed with the command that helps, and opening it says the same."""
    with _touchscreen() as (_, path):
        Path(path).chmod(0o600)

        def told() -> tuple[str, str]:
            (found,) = [info for info in find_touchscreens() if info.path == path]
            return " ".join(found.odd), str(error_of(lambda: Touchscreen(path)))

        with Elsewhere(told, user_id=65534) as nobody:
            for text in nobody.run():
                require("usermod -aG input" in text, text)
    return {}


@check()
def hovering_through_hid_multitouch() -> dict[str, float]:
    """A HID panel with In Range and Tip Switch: the finger touches while its tip does."""
    from tests.devices.guest.hid_panel import HidPanel

    with HidPanel() as panel:
        (found,) = [info for info in find_touchscreens() if info.name == panel.name]
        with Touchscreen(found.path) as screen:
            for tip, in_range, x, kinds in (
                *((0, 1, 1000, []), (0, 1, 1100, []), (1, 1, 1200, ["down"])),
                *((1, 1, 1300, ["move"]), (0, 1, 1400, ["up"]), (0, 1, 1000, [])),
                (0, 0, 1000, []),
            ):
                panel.report(tip, in_range, x, 2000)
                told = screen.read(0.3)
                _equal([touch.kind for touch in told], kinds)
                if told and kinds != ["up"]:
                    _equal(told[0].x_mm, x / 20)  # 4095 places on 200 mm are 20 per mm
    return {}


@check()
def a_size_that_the_kernel_rounds() -> dict[str, float]:
    """A panel of 345 x 194 mm with 4096 x 2304 places states 12 per mm: 341 x 192 mm."""
    from tests.devices.guest.hid_panel import HidPanel

    with HidPanel(width_mm=345, height_mm=194) as panel:
        (found,) = [info for info in find_touchscreens() if info.name == panel.name]
        require(found.size_mm is None and "too coarse" in " ".join(found.odd), found)
        _refuses(InputError, "width_mm", found.path)
        with Touchscreen(found.path, width_mm=345.0, height_mm=194.0) as screen:
            _equal([round(side) for side in screen.axes.size_mm], [345, 194])
        x = screen.axes.x
        return {"stated_width_mm": (x.high - x.low) / round(x.per_mm)}


@check()
def calibrating_with_a_finger() -> dict[str, float]:
    """Four marks and a stroke on a panel that lies turned by a quarter: the profile keeps it."""
    from haptix.base.task import Context
    from haptix.model.screen import Screen
    from haptix.tasks.touchscreens import CalibrateTouchscreen

    marks = {  # of 20 mm from the edges of 115.2 x 204.8 mm, where the panel's x runs down
        "upper left": (400, 1903),
        "upper right": (400, 400),
        "lower right": (3695, 400),
        "lower left": (3695, 1903),
    }
    absolute = {
        codes.ABS_MT_POSITION_X: _axis(0, 4095),
        codes.ABS_MT_POSITION_Y: _axis(0, 2303),
        codes.ABS_MT_SLOT: _axis(0, 4),
        codes.ABS_MT_TRACKING_ID: _axis(0, 65535),
    }
    file = Path("/run/screen.toml")
    Screen(name="turned").save(file)

    class Person(Context):
        """Does what it is told."""

        def tell(self, **what: Any) -> None:
            step = what["step"]
            place = next((at for mark, at in marks.items() if mark in step), None)
            threading.Thread(
                target=self.stroke if place is None else self.tap, args=[place]
            ).start()

        def tap(self, place: tuple[int, int]) -> None:
            for x, y in (place, (place[0] + 2, place[1]), (place[0], place[1] + 2)):
                _write(side, (_TID, 7), (codes.ABS_MT_POSITION_X, x), (codes.ABS_MT_POSITION_Y, y))
                time.sleep(0.01)
            _write(side, (_TID, -1), touched=False)

        def stroke(self, _: None) -> None:
            _write(side, (_TID, 8), (codes.ABS_MT_POSITION_X, 100))
            for i in range(60):
                time.sleep(0.01)
                _write(side, (codes.ABS_MT_POSITION_X, 120 + 20 * i))
            _write(side, (_TID, -1), touched=False)

    with _device(absolute) as (side, path):
        task = CalibrateTouchscreen(touchscreen=path, screen=file, width_mm=115.2, height_mm=204.8)
        result = task.run(Person())
        touch = Screen.load(file).touch
        require(touch is not None)
        with Touchscreen(path, touch.width_mm, touch.height_mm, matrix=touch.matrix) as screen:
            _write(side, (_TID, 9), (codes.ABS_MT_POSITION_X, 400), (codes.ABS_MT_POSITION_Y, 400))
            (told,) = screen.read(1.0)
            require(abs(told.x_mm - 95.2) < 0.2 and abs(told.y_mm - 20.0) < 0.2, told)
    return {"off_mm": result.document["off_mm"], "rate_hz": result.document["rate_hz"]}


@check()
def the_scan_time_of_a_panel() -> dict[str, float]:
    """The kernel passes it on in microseconds; when it stamps itself is the guest's own pace."""
    from evdev import InputDevice

    from tests.devices.guest.hid_panel import HidPanel

    with HidPanel() as panel:
        (found,) = [info for info in find_touchscreens() if info.name == panel.name]
        device = InputDevice(found.path)
        for i in range(10):
            panel.report(1, 1, 1000 + 20 * i, 2000, ms=9)
        time.sleep(0.3)
        scans_us = [
            event.value
            for event in device.read()
            if (event.type, event.code) == (codes.EV_MSC, codes.MSC_TIMESTAMP)
        ]
        device.close()
    _equal([after - before for before, after in pairwise(scans_us)], [9000] * 9)
    return {}
