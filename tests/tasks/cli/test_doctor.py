"""What ``haptix doctor`` says of drivers, outputs, permissions and the clock."""

import os
from itertools import count

import pytest

from firmware_io.link import DeviceInfo
from haptix.tasks.cli import hardware


def device(address, name="", usable=True):
    return DeviceInfo(address, address.partition(":")[0], name, usable, "")


BOARD = device("usb:bus=1,address=7")
ADAPTER = device("serial:port=/dev/ttyUSB0", usable=False)


@pytest.mark.parametrize(
    ("found", "ok", "says"),
    [
        ([], "no", "plug it in"),
        ([BOARD, ADAPTER], "yes", "usb:bus=1,address=7"),
        ([ADAPTER], "no", "serial:port=/dev/ttyUSB0"),
        ([device("audio:device=x"), device("daq:channel=Dev1/ao0")], "no", "none is connected"),
    ],
)
def test_which_devices_are_drivers(found, ok, says):
    row = hardware._check_drivers(found)
    assert row["ok"] == ok and says in row["detail"]


@pytest.mark.parametrize(
    ("names", "ok", "says"),
    [
        ([], "no", "none"),
        (["pulse (ALSA)", "default (ALSA)"], "no", "resample"),
        (["pulse (ALSA)", "Scarlett 2i2: USB (hw:1,0) (ALSA)"], "yes", "Scarlett"),
        (["system (JACK Audio Connection Kit)"], "yes", "system"),
    ],
)
def test_an_output_that_only_mixes_is_odd(names, ok, says):
    row = hardware._check_outputs([device("audio:device=x", name) for name in names])
    assert row["ok"] == ok and says in row["detail"]


@pytest.mark.parametrize(
    ("found", "file", "remedy"),
    [
        (BOARD, "/dev/bus/usb/001/007", "--install-udev"),
        (device("hid:path=/dev/hidraw3"), "/dev/hidraw3", "--install-udev"),
        (ADAPTER, "/dev/ttyUSB0", "adduser $USER dialout"),
    ],
)
def test_a_file_that_this_user_may_not_open_is_named_with_the_command(
    monkeypatch, found, file, remedy
):
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.setattr("pathlib.Path.exists", lambda path: True)
    monkeypatch.setattr(os, "access", lambda path, mode: str(path) != file)
    row = hardware._check_permissions([found, device("tcp:localhost:1")])
    assert row["ok"] == "no"
    assert file in row["detail"] and remedy in row["detail"]
    monkeypatch.setattr(os, "access", lambda path, mode: True)
    assert hardware._check_permissions([found])["ok"] == "yes"


def test_a_coarse_clock_is_odd(monkeypatch):
    assert hardware._check_clock()["ok"] == "yes"
    reads = count()
    monkeypatch.setattr(
        "haptix.tasks.cli.hardware.time.monotonic", lambda: next(reads) // 1000 * 15.6e-3
    )
    row = hardware._check_clock()
    assert row["ok"] == "no" and "15600" in row["detail"].replace("1.6e+04", "15600")
