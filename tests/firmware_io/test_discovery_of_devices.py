"""Addresses, buses, and what importing the package costs."""

import subprocess
import sys
import time
from types import ModuleType, SimpleNamespace

import pytest

import firmware_io
from firmware_io import (
    DeviceError,
    DeviceNotFoundError,
    LimitError,
    list_devices,
    open_device,
    survey_buses,
)


def report(kind):
    return next(found for found in survey_buses() if found.kind == kind)


def test_the_default_mock():
    device = open_device("mock:")
    assert device.capabilities.full_scale_v == 250.0
    assert device.capabilities.ceiling_v == 200.0
    assert not device.is_armed


def test_selectors():
    device = open_device("mock:sample_rate_hz=250e3, full_scale_v=220,ceiling_v=150,lead_s=0.05")
    assert device.capabilities.sample_rate_hz == 250_000.0
    assert device.capabilities.full_scale_v == 220.0
    assert device.limits.ceiling_v == 150.0


@pytest.mark.parametrize(
    "selector", ["colour=red", "ceiling_v=high", "ceiling_v", "ceiling_v=1,ceiling_v=2", ",", "=3"]
)
def test_bad_selectors_list_the_keys(selector):
    keys = "sample_rate_hz, full_scale_v, ceiling_v, lead_s, watchdog_s"
    with pytest.raises(DeviceError, match=keys):
        open_device(f"mock:{selector}")


@pytest.mark.parametrize(
    "selector", ["sample_rate_hz=nan", "full_scale_v=0", "lead_s=-1", "watchdog_s=inf"]
)
def test_impossible_values(selector):
    with pytest.raises(DeviceError, match=selector.partition("=")[0]):
        open_device(f"mock:{selector}")


def test_the_mocks_watchdog_can_be_chosen():
    device = open_device("mock:lead_s=0,watchdog_s=0")
    device.arm()
    device.write([1.0])
    time.sleep(0.001)  # longer than the one sample lasts
    assert not device.mock.is_armed
    assert "starved" in device.mock.fault


@pytest.mark.parametrize("address", [5, None, b"mock:"])
def test_an_address_that_is_no_string(address):
    with pytest.raises(DeviceError, match=r'address is a string.*use for example "mock:"'):
        open_device(address)


def test_the_address_cannot_raise_the_ceiling():
    with pytest.raises(LimitError, match="200 V"):
        open_device("mock:ceiling_v=201")


@pytest.mark.parametrize("address", ["usb:", "hid:path=/dev/hidraw0", "audio:index=1"])
def test_hardware_is_not_in_this_version(address):
    with pytest.raises(DeviceNotFoundError, match=r'only the mock.*use "mock:"'):
        open_device(address)


@pytest.mark.parametrize("address", ["", "mock", "usb", "serial:", "Mock:"])
def test_unknown_schemes_list_the_known(address):
    with pytest.raises(DeviceNotFoundError, match="mock:, usb:, hid: or audio:"):
        open_device(address)


@pytest.mark.parametrize(
    ("kind", "module", "package"),
    [
        ("usb", "usb.core", "libusb-1.0-0"),
        ("hid", "hid", "hidapi"),
        ("audio", "sounddevice", "libportaudio2"),
    ],
)
def test_a_missing_library_is_a_reason(monkeypatch, kind, module, package):
    monkeypatch.setitem(sys.modules, module, None)
    found = report(kind)
    assert not found.available
    assert package in found.detail
    assert found.devices == ()
    assert list_devices()[0].address == "mock:"


def test_a_library_that_fails_is_a_reason(monkeypatch):
    core = ModuleType("usb.core")

    def find(find_all):
        raise ValueError("No backend available")

    core.find = find
    monkeypatch.setitem(sys.modules, "usb.core", core)
    assert not report("usb").available
    assert "No backend available" in report("usb").detail


def test_connected_devices_are_listed_unusable(monkeypatch):
    usb, core = ModuleType("usb"), ModuleType("usb.core")
    usb.__version__ = "9.9"
    core.find = lambda find_all: iter(
        [SimpleNamespace(bus=1, address=4, idVendor=0x1D6B, idProduct=2)]
    )
    hid = ModuleType("hid")
    hid.version_str = lambda: "8.8"
    hid.enumerate = lambda: [
        {"vendor_id": 1, "product_id": 0xABCD, "path": b"1-2", "product_string": ""}
    ]
    audio = ModuleType("sounddevice")
    audio.__version__ = "7.7"
    audio.get_portaudio_version = lambda: (1, "PortAudio V19")
    audio.query_devices = lambda: [
        {"name": "microphone", "max_output_channels": 0},
        {"name": "amplifier", "max_output_channels": 2},
    ]
    for name, module in {"usb": usb, "usb.core": core, "hid": hid, "sounddevice": audio}.items():
        monkeypatch.setitem(sys.modules, name, module)
    mock, *others = list_devices()
    assert mock.usable
    assert [(d.address, d.name) for d in others] == [
        ("usb:bus=1,address=4", "1d6b:0002"),
        ("hid:path=1-2", "0001:abcd"),
        ("audio:index=1", "amplifier"),
    ]
    assert not any(d.usable for d in others)
    assert all("no link to real hardware" in d.note for d in others)
    assert [r.detail for r in survey_buses()] == [
        "pyusb 9.9",
        "hidapi 8.8",
        "sounddevice 7.7, PortAudio V19",
    ]


def test_this_computer_can_be_surveyed():
    assert [found.kind for found in survey_buses()] == ["usb", "hid", "audio"]
    assert all(found.detail for found in survey_buses())


def test_public_names_exist():
    missing = [name for name in firmware_io.__all__ if not hasattr(firmware_io, name)]
    assert missing == []


def test_importing_loads_nothing_heavy():
    code = "import sys, firmware_io; print(*sys.modules)"
    loaded = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    ).stdout.split()
    heavy = {"torch", "scipy", "usb", "hid", "sounddevice", "haptix", "calibration"}
    assert "firmware_io" in loaded
    assert heavy.isdisjoint(loaded)
