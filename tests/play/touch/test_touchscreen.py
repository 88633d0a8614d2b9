"""A touchscreen that cannot be opened; real ones, through the kernel: tests/devices."""

import sys

import pytest

from haptix.base.errors import DeviceError, MissingExtraError
from haptix.play.touch import Touchscreen


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
