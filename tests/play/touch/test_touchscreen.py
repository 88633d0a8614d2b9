"""What touchscreens state and how they lie; real ones, through the kernel: tests/devices."""

import os
import sys
from collections import namedtuple
from typing import Any

import numpy as np
import pytest

from haptix.base.errors import DeviceError, InputError, MissingExtraError
from haptix.play.touch import (
    ORIENTATIONS,
    AxisRange,
    ScreenAxes,
    SlotDecoder,
    Touchscreen,
    find_touchscreens,
    fitted_matrix,
    system_matrix,
)
from haptix.play.touch import touchscreen as codes
from haptix.play.touch.orientation import checked_matrix

Info = namedtuple("Info", "min max resolution")
X, Y, MAJOR = codes.ABS_MT_POSITION_X, codes.ABS_MT_POSITION_Y, codes.ABS_MT_TOUCH_MAJOR


def bitmap(*bits):
    """Codes as sysfs writes them, in words of 64 bits."""
    number = sum(1 << bit for bit in bits)
    words = [number >> 64 * i & (1 << 64) - 1 for i in range(13)]
    while len(words) > 1 and not words[-1]:
        words.pop()
    return " ".join(f"{word:x}" for word in reversed(words)) + "\n"


MULTI = (X, Y, codes.ABS_MT_SLOT, codes.ABS_MT_TRACKING_ID)
INPUTS = {  # name: EV_ABS, EV_KEY, properties, and how it is listed
    "touchscreen": (MULTI, [codes.BTN_TOUCH], [1], "B"),
    "protocol A": ((X, Y), [codes.BTN_TOUCH], [1], "A"),
    # usbtouchscreen of Linux 6.1 sets no property.
    "resistive": ((codes.ABS_X, codes.ABS_Y), [codes.BTN_TOUCH], [], "single"),
    "touchpad": (MULTI, [codes.BTN_TOUCH, 0x145, 0x110], [0, 2], None),
    "game pad": (MULTI, [codes.BTN_TOUCH, 0x130], [], None),
    "pen tablet": ((codes.ABS_X, codes.ABS_Y), [codes.BTN_TOUCH, 0x140, 0x14B], [1], None),
    "joystick": ((codes.ABS_X, codes.ABS_Y), [0x120], [], None),
    "keyboard": ((), [30, 48], [], None),
    "mouse": ((), [0x110], [], None),
}


def test_touchscreens_are_listed_and_what_is_none_is_not(tmp_path):
    pytest.importorskip("evdev", reason="the extra evdev is not installed")
    for number, (name, (absolute, keys, properties, _)) in enumerate(INPUTS.items()):
        device = tmp_path / f"sys/class/input/event{number}/device"
        (device / "capabilities").mkdir(parents=True)
        (device / "name").write_text(name + "\n")
        (device / "properties").write_text(bitmap(*properties))
        (device / "capabilities/abs").write_text(bitmap(*absolute))
        (device / "capabilities/key").write_text(bitmap(*keys))
    found = {info.name: info for info in find_touchscreens(tmp_path)}
    listed = {name: kind for name, (*_, kind) in INPUTS.items() if kind is not None}
    assert {name: info.protocol for name, info in found.items()} == listed
    assert found["touchscreen"].path == str(tmp_path / "dev/input/event0")
    # None of these can be opened, which is said of each.
    assert all("cannot be opened" in info.odd[-1] for info in found.values())
    assert any("protocol A" in text for text in found["protocol A"].odd)


@pytest.mark.parametrize(
    ("x", "y", "word"),
    [
        (Info(0, 4095, 20), Info(0, 2303, 20), ""),
        # 345 x 194 mm: the kernel states 12 per mm, and so 341 x 192 mm.
        (Info(0, 4095, 12), Info(0, 2303, 12), "too coarse"),
        (Info(0, 4095, 0), Info(0, 4095, 0), "gives no size"),
        (Info(0, 32767, 20), Info(0, 200, 20), "no screen has"),
        (Info(0, 200, 20), Info(0, 200, 20), "no screen has"),
        (Info(0, 32767, 4000), Info(0, 32767, 4000), "no screen has"),
    ],
)
def test_a_size_is_asked_for_and_never_guessed(x, y, word):
    if not word:
        assert ScreenAxes.of({X: x, Y: y}).size_mm == (204.75, 115.15)
        return
    with pytest.raises(InputError, match=f"{word}.*width_mm"):
        ScreenAxes.of({X: x, Y: y})
    with pytest.raises(InputError, match="height_mm"):
        ScreenAxes.of({X: x, Y: y}, width_mm=345.0)
    assert ScreenAxes.of({X: x, Y: y}, 345.0, 194.0).size_mm == pytest.approx((345.0, 194.0))


def test_a_contact_width_has_the_unit_of_its_axis():
    # FlatFrog 25b5:0002: 16 places and 1 width per mm. A finger of 10 x 8 mm.
    ranges = {X: Info(0, 11174, 16), Y: Info(0, 6287, 16), MAJOR: Info(0, 127, 1)}
    decoder = SlotDecoder(ScreenAxes.of(ranges, 698.4, 393.0))
    events = [(3, codes.ABS_MT_TRACKING_ID, 5), (3, X, 1600), (3, Y, 800)]
    events += [(3, MAJOR, 10), (3, codes.ABS_MT_TOUCH_MINOR, 8), (0, 0, 0)]
    [touch] = [touch for event in events for touch in decoder.feed(0, 0, *event)]
    assert touch.contact_area_m2 * 1e6 == pytest.approx(np.pi / 4 * 80)
    # Without a unit of its own it is that of x, as the kernel asks of drivers.
    ranges[MAJOR] = Info(0, 127, 0)
    assert ScreenAxes.of(ranges, 698.4, 393.0).area_units_per_mm is None


@pytest.mark.parametrize(
    ("name", "upper_left", "upper_right", "size"),
    [
        ("normal", (0, 0), (100, 0), (100, 50)),
        ("turn-90", (50, 0), (50, 100), (50, 100)),
        ("turn-180", (100, 50), (0, 50), (100, 50)),
        ("turn-270", (0, 100), (0, 0), (50, 100)),
        ("mirror-x", (100, 0), (0, 0), (100, 50)),
        ("mirror-y", (0, 50), (100, 50), (100, 50)),
        ("swap", (0, 0), (0, 100), (50, 100)),
    ],
)
def test_orientations(name, upper_left, upper_right, size):
    # A panel of 100 x 50 mm; where its own corners are on the picture.
    axes = ScreenAxes(AxisRange(0, 2000, 20.0), AxisRange(100, 1100, 20.0), matrix=name)
    assert axes.place_mm(0, 100) == pytest.approx(upper_left)
    assert axes.place_mm(2000, 100) == pytest.approx(upper_right)
    assert axes.size_mm == size
    # A size that is given is that on the picture.
    ranges: Any = {X: Info(0, 2000, 0), Y: Info(100, 1100, 0)}
    given = ScreenAxes.of(ranges, width_mm=size[0], height_mm=size[1], matrix=name)
    assert given.place_mm(2000, 100) == pytest.approx(upper_right)


def test_an_affine_map_keeps_what_it_says():
    matrix = (0.9, 0.1, 0.05, -0.05, 1.1, -0.02)
    axes = ScreenAxes(AxisRange(0, 2000, 20.0), AxisRange(0, 1000, 20.0), matrix=matrix)
    assert axes.place_mm(1000, 500) == pytest.approx((0.55 * 100, 0.505 * 50))
    text = "0.9 0.1 0.05 -0.05 1.1 -0.02"
    assert checked_matrix(text) == matrix
    assert checked_matrix(text.replace(" ", ", ")) == matrix


@pytest.mark.parametrize("matrix", ["left", "1 0 0", (1, 0, 0, 1, 0, 0), (1, 0, 0, 0, np.nan, 0)])
def test_a_matrix_that_is_none_is_refused(matrix):
    with pytest.raises(InputError, match="six numbers"):
        checked_matrix(matrix)


@pytest.mark.parametrize("name", ORIENTATIONS)
def test_four_touches_find_the_matrix(name):
    a, b, c, d, e, f = ORIENTATIONS[name]
    marks = np.array([(0.1, 0.1), (0.9, 0.1), (0.9, 0.9), (0.1, 0.9)])
    touched = np.linalg.solve([[a, b], [d, e]], (marks - [c, f]).T).T
    noise = np.random.default_rng(3).normal(0, 1e-3, (4, 2))
    matrix, off = fitted_matrix(touched + noise, marks)
    assert matrix == pytest.approx(ORIENTATIONS[name], abs=5e-3)
    assert np.abs(off).max() < 3e-3
    with pytest.raises(InputError, match="no line"):
        fitted_matrix([(0.1, 0.1), (0.5, 0.5), (0.9, 0.9)], marks[:3])


def test_the_matrix_of_the_system_is_udevs(tmp_path):
    device = tmp_path / "event0"
    device.write_bytes(b"")
    assert system_matrix(device, tmp_path) == ORIENTATIONS["normal"]
    number = device.stat().st_rdev
    data = tmp_path / "run/udev/data" / f"c{os.major(number)}:{os.minor(number)}"
    data.parent.mkdir(parents=True)
    data.write_text("E:ID_INPUT=1\nE:LIBINPUT_CALIBRATION_MATRIX=0 -1 1 1 0 0\n")
    assert system_matrix(device, tmp_path) == ORIENTATIONS["turn-90"]
    data.write_text("E:LIBINPUT_CALIBRATION_MATRIX=upright\n")
    with pytest.raises(InputError, match="LIBINPUT_CALIBRATION_MATRIX"):
        system_matrix(device, tmp_path)


def test_without_the_package_it_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "evdev", None)
    with pytest.raises(MissingExtraError, match=r"\[evdev\]"):
        Touchscreen("/dev/input/event0")


def test_a_path_that_is_no_touchscreen(tmp_path):
    pytest.importorskip("evdev", reason="the extra evdev is not installed")
    with pytest.raises(DeviceError, match=r"event99.*is it there"):
        Touchscreen(tmp_path / "event99")
    file = tmp_path / "file"
    file.write_bytes(b"")
    with pytest.raises(DeviceError, match="file"):
        Touchscreen(file)
