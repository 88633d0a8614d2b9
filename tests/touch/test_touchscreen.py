"""A touchscreen through the kernel: evdev, against one made with uinput where there is that."""

import importlib.util
import os
import sys
import time

import pytest

from haptix.errors import DeviceError, InputError
from haptix.touch import Touches, Touchscreen, find_touchscreens
from haptix.touch import slots as codes

WITHOUT_EVDEV = importlib.util.find_spec("evdev") is None

needs_uinput = pytest.mark.skipif(
    WITHOUT_EVDEV or not os.access("/dev/uinput", os.W_OK),
    reason="needs the package evdev and /dev/uinput",
)
NAME = "haptix test touchscreen"


def test_without_the_package_it_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "evdev", None)
    with pytest.raises(DeviceError, match='extra "evdev"'):
        Touchscreen("/dev/input/event0")


@pytest.mark.skipif(WITHOUT_EVDEV, reason="needs the package evdev")
def test_a_path_that_is_no_touchscreen(tmp_path):
    with pytest.raises(DeviceError, match=r"event99.*is it there"):
        Touchscreen(tmp_path / "event99")
    file = tmp_path / "file"
    file.write_bytes(b"")
    with pytest.raises(DeviceError, match="file"):
        Touchscreen(file)


@pytest.fixture
def made():
    """Makes touchscreens with uinput; gives the writing side and its path."""
    from evdev import AbsInfo, UInput
    from evdev import ecodes as e

    sides = []

    def make(resolution=20, slots=3, **more):
        def axis(low, high, res=0):
            return AbsInfo(low if low > 0 else 0, low, high, 0, 0, res)

        absolute = [
            (e.ABS_MT_POSITION_X, axis(100, 3300, resolution)),
            (e.ABS_MT_POSITION_Y, axis(0, 2250, resolution)),
            (e.ABS_MT_TRACKING_ID, axis(0, 65535)),
            (e.ABS_MT_TOUCH_MAJOR, axis(0, 1000, resolution)),
            (e.ABS_MT_PRESSURE, axis(0, 255)),
        ]
        if slots:
            absolute.append((e.ABS_MT_SLOT, axis(0, slots - 1)))
        side = UInput({e.EV_ABS: absolute, e.EV_KEY: [e.BTN_TOUCH]}, name=NAME, **more)
        sides.append(side)
        return side, side.device.path

    yield make
    for side in sides:
        side.close()


def write(side, *values):
    for code, value in values:
        side.write(codes.EV_ABS, code, value)
    side.syn()


@needs_uinput
def test_two_fingers(made):
    side, path = made()
    assert (path, NAME) in list(find_touchscreens())
    with Touchscreen(path, force_n_per_unit=0.01) as screen:
        assert screen.name == NAME
        assert screen.read() == []
        before = time.monotonic()
        write(
            side,
            (codes.ABS_MT_SLOT, 0),
            (codes.ABS_MT_TRACKING_ID, 5),
            (codes.ABS_MT_POSITION_X, 900),
            (codes.ABS_MT_POSITION_Y, 500),
            (codes.ABS_MT_TOUCH_MAJOR, 160),
            (codes.ABS_MT_PRESSURE, 50),
        )
        (first,) = screen.read(1.0)
        after = time.monotonic()
        assert first[1:6] == (5, 40.0, 25.0, "down", 0.5)
        # Stamped by the kernel on the clock of time.monotonic.
        assert before <= first.t_s <= after
        assert first.contact_area_m2 == pytest.approx(3.14159265 / 4 * 8e-3**2)
        write(
            side,
            (codes.ABS_MT_SLOT, 2),
            (codes.ABS_MT_TRACKING_ID, 6),
            (codes.ABS_MT_POSITION_X, 3300),
            (codes.ABS_MT_POSITION_Y, 2250),
        )
        assert [event[1:5] for event in screen.read(1.0)] == [
            (5, 40.0, 25.0, "move"),
            (6, 160.0, 112.5, "down"),
        ]
        write(side, (codes.ABS_MT_SLOT, 0), (codes.ABS_MT_TRACKING_ID, -1))
        assert [event[1::3] for event in screen.read(1.0)] == [(5, "up"), (6, "move")]


@needs_uinput
def test_a_finger_that_was_down_before(made):
    side, path = made()
    write(
        side,
        (codes.ABS_MT_SLOT, 1),
        (codes.ABS_MT_TRACKING_ID, 9),
        (codes.ABS_MT_POSITION_X, 900),
        (codes.ABS_MT_POSITION_Y, 500),
    )
    with Touchscreen(path) as screen:
        write(side, (codes.ABS_MT_POSITION_X, 1100))
        assert [event[1:5] for event in screen.read(1.0)] == [(9, 50.0, 25.0, "down")]


@needs_uinput
def test_events_that_the_kernel_drops(made):
    side, path = made()
    with Touchscreen(path) as screen:
        write(
            side,
            (codes.ABS_MT_SLOT, 0),
            (codes.ABS_MT_TRACKING_ID, 1),
            (codes.ABS_MT_POSITION_X, 900),
            (codes.ABS_MT_POSITION_Y, 500),
        )
        touches = Touches(strict=True)
        for event in screen.read(1.0):
            touches.push(event)
        # Nobody reads meanwhile: the finger moves often, goes up, and another comes down.
        for i in range(1000):
            write(side, (codes.ABS_MT_POSITION_X, 901 + i))
        write(side, (codes.ABS_MT_TRACKING_ID, -1))
        write(side, (codes.ABS_MT_TRACKING_ID, 2), (codes.ABS_MT_POSITION_X, 2100))
        while events := screen.read(0.1):
            for event in events:
                touches.push(event)
        assert screen.dropped >= 1
        ((touch_id, tracker),) = touches.active
        assert touch_id == 2
        # 100 mm from the upper left, at rest since it came down.
        assert tracker.at(tracker.last_t_s)[1:3] == (100.0, 25.0)


@needs_uinput
def test_a_screen_that_goes_away(made):
    side, path = made()
    with Touchscreen(path) as screen:
        side.close()
        with pytest.raises(DeviceError, match="No such device"):
            screen.read(1.0)


@needs_uinput
def test_a_driver_that_does_not_say_its_size(made):
    _, path = made(resolution=0)
    with pytest.raises(InputError, match="width_mm"):
        Touchscreen(path)
    with Touchscreen(path, width_mm=160.0, height_mm=90.0) as screen:
        assert screen.axes.x.per_mm == 20.0
        assert screen.axes.y.per_mm == 25.0
    with pytest.raises(InputError, match="height_mm"):
        Touchscreen(path, width_mm=160.0, height_mm=-1.0)


@needs_uinput
def test_a_device_without_slots(made):
    _, path = made(slots=0)
    with pytest.raises(InputError, match="protocol B"):
        Touchscreen(path)
