"""Addresses, buses, and what importing the package costs."""

import io
import json
import subprocess
import sys
import threading
import time
from contextlib import redirect_stdout
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

import firmware_io
from firmware_io import (
    Device,
    DeviceError,
    DeviceNotFoundError,
    DeviceWatch,
    LimitError,
    MockLink,
    ProtocolError,
    list_devices,
    open_device,
    survey_buses,
)
from tests.waiting import PATIENCE_S


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


KEYS = {
    "mock": "pace, reports, full_scale_v, ceiling_v, serial, mode, carrier_hz, sample_rate_hz, "
    "lead_s, watchdog_s",
    "usb": "serial, bus, address, vendor_id, product_id, mode, carrier_hz",
    "hid": "path, serial, backend, vendor_id, product_id, mode, carrier_hz",
    "audio": "device, profile, full_scale_v, dac_full_scale_v, amplifier_gain, ceiling_v, trigger",
    "tcp": "mode, carrier_hz, sample_rate_hz, lead_s, watchdog_s",
}


@pytest.mark.parametrize("scheme", KEYS)
@pytest.mark.parametrize(
    "selector",
    ["colour=red", "carrier_hz=high", "mode", "mode=loud", "lead_s=1,lead_s=2", ",", "=3"],
)
def test_bad_selectors_list_the_keys(scheme, selector):
    place = "localhost:1," if scheme == "tcp" else ""
    with pytest.raises(DeviceError, match=KEYS[scheme]) as caught:
        open_device(f"{scheme}:{place}{selector}")
    assert scheme in str(caught.value)


@pytest.mark.parametrize("address", ["tcp:", "tcp:localhost", "tcp::7420", "tcp:localhost:99999"])
def test_tcp_takes_a_host_and_a_port(address):
    with pytest.raises(DeviceError, match="tcp:localhost:7420"):
        open_device(address)


@pytest.mark.parametrize(
    "selector",
    [
        "sample_rate_hz=nan",
        "full_scale_v=0",
        "full_scale_v=inf",
        "lead_s=-1",
        "lead_s=1",
        "watchdog_s=inf",
        "watchdog_s=0",
        "carrier_hz=4000",
        "mode=envelope,carrier_hz=0",
        "mode=envelope,carrier_hz=1e9",
        "sample_rate_hz=1e12",
    ],
)
def test_impossible_values(selector):
    with pytest.raises(DeviceError, match=selector.rpartition(",")[2].partition("=")[0]):
        open_device(f"mock:{selector}")


def test_the_mocks_watchdog_can_be_chosen():
    device = open_device("mock:lead_s=0,watchdog_s=0.02")
    device.arm()
    device.write([1.0])
    # PROTOCOL.md: the ramp takes 5 ms, and begins so early that it ends in time.
    device.mock.advance(0.014)
    assert device.mock.is_armed
    device.mock.advance(0.006)
    assert not device.mock.is_armed
    assert device.mock.output[0][-1] == 0
    assert "starved" in device.mock.fault


def test_modes_and_rates_by_address():
    device = open_device("mock:mode=envelope,carrier_hz=2500")
    assert (device.mode, device.carrier_hz) == ("envelope", 2500.0)
    device = open_device("mock:reports=yes")
    assert (device.mode, device.capabilities.sample_rate_hz) == ("envelope", 16_000.0)
    device = open_device("mock:")
    assert (device.mode, device.carrier_hz) == ("waveform", None)
    with pytest.raises(ProtocolError, match="waveform and envelope"):
        Device(MockLink(), sample_rate_hz=44_100)


@pytest.mark.parametrize("address", [5, None, b"mock:"])
def test_an_address_that_is_no_string(address):
    with pytest.raises(DeviceError, match=r'string.*"mock:"'):
        open_device(address)


def test_the_address_cannot_raise_the_ceiling():
    with pytest.raises(LimitError, match="200 V"):
        open_device("mock:ceiling_v=201")


@pytest.mark.parametrize("address", ["", "mock", "usb", "parallel:", "Mock:"])
def test_unknown_schemes_list_the_known(address):
    with pytest.raises(DeviceNotFoundError, match="audio:, daq:, hid:, mock:, serial:, tcp:, usb:"):
        open_device(address)


def here(module, function):
    """Ask a module for the outputs in this process, whose libraries are stood in for."""
    said = io.StringIO()
    with redirect_stdout(said):
        getattr(sys.modules[module], function)()
    return json.loads(said.getvalue())


@pytest.mark.parametrize(
    ("kind", "module", "package"),
    [
        ("usb", "usb.core", "libusb-1.0-0"),
        ("hid", "hid", "hidapi"),
        ("audio", "sounddevice", "libportaudio2"),
    ],
)
def test_a_missing_library_is_a_reason(monkeypatch, kind, module, package):
    monkeypatch.setattr("firmware_io.links.audio.ask_in_own_process", here)
    for name in {module, "hidraw"}:
        monkeypatch.setitem(sys.modules, name, None)
    found = report(kind)
    assert not found.available
    assert package in found.detail
    assert found.devices == ()
    assert list_devices()[0].address == "mock:"


def test_a_missing_extra_names_its_command_once(monkeypatch):
    for name in ("serial", "serial.tools", "serial.tools.list_ports"):
        monkeypatch.setitem(sys.modules, name, None)
    assert report("serial").detail.count("pip install") == 1


def test_a_library_that_fails_is_a_reason(monkeypatch):
    core: Any = ModuleType("usb.core")

    def find(find_all, backend):
        raise ValueError("No backend available")

    core.find, core.USBError = find, OSError
    monkeypatch.setitem(sys.modules, "usb.core", core)
    assert not report("usb").available
    assert "No backend available" in report("usb").detail


@pytest.fixture
def buses(monkeypatch):
    """A computer with a driver and something else on each bus."""
    usb: Any = ModuleType("usb")
    core: Any = ModuleType("usb.core")
    usb.__version__ = "9.9"
    usb.devices = [
        SimpleNamespace(bus=1, address=4, idVendor=0x1D6B, idProduct=2),
        SimpleNamespace(bus=1, address=7, idVendor=0x1209, idProduct=1, serial_number="SN1"),
    ]
    core.find = lambda find_all, backend: iter(usb.devices)
    hid: Any = ModuleType("hid")
    hid.version_str = lambda: "8.8"
    hid.enumerate = lambda: [
        {"vendor_id": 1, "product_id": 0xABCD, "path": b"1-2", "product_string": ""},
        {
            "vendor_id": 0x1209,
            "product_id": 1,
            "path": b"/dev/hidraw0",
            "product_string": "Touch Driver",
            "serial_number": "SN1",
        },
    ]
    audio: Any = ModuleType("sounddevice")
    audio.__version__ = "7.7"
    audio.get_portaudio_version = lambda: (1, "PortAudio V19")
    audio.query_devices = lambda: [
        {"name": "microphone", "max_output_channels": 0, "hostapi": 0},
        {"name": "amplifier", "max_output_channels": 2, "hostapi": 0},
    ]
    audio.query_hostapis = lambda index: {"name": "ALSA"}
    monkeypatch.setattr("firmware_io.links.audio.ask_in_own_process", here)
    serial: Any = ModuleType("serial")
    ports: Any = ModuleType("serial.tools.list_ports")
    serial.__version__ = "6.6"
    ports.comports = lambda: [
        SimpleNamespace(device="/dev/ttyS0", description="n/a", vid=None, pid=None),
        SimpleNamespace(device="/dev/ttyUSB0", description="adapter", vid=0x0403, pid=0x6001),
        SimpleNamespace(device="/dev/ttyACM0", description="board", vid=0x1209, pid=1),
    ]
    daq: Any = ModuleType("nidaqmx")
    daq.__version__ = "5.5"
    version = SimpleNamespace(major_version=24, minor_version=5)
    local = SimpleNamespace(driver_version=version, devices=[])
    daq.system = SimpleNamespace(System=SimpleNamespace(local=lambda: local))
    monkeypatch.setattr("firmware_io.links.daq.nidaqmx_module", lambda: daq)
    modules = {"usb": usb, "usb.core": core, "hidraw": hid, "sounddevice": audio}
    modules |= {"serial": serial, "serial.tools.list_ports": ports}
    for name, module in modules.items():
        monkeypatch.setitem(sys.modules, name, module)
    monkeypatch.setattr("firmware_io.links.usb.backend", lambda: None)
    return usb


def test_a_watch_spares_a_bus_whose_search_starts_a_process(buses, monkeypatch):
    searches = []

    def asked_here(*asked):
        searches.append(asked)
        return here(*asked)

    monkeypatch.setattr("firmware_io.links.audio.ask_in_own_process", asked_here)
    list_devices()
    list_devices()
    assert len(searches) == 2
    watch = DeviceWatch(lambda device, is_there: None)
    assert [watch.poll() != [], watch.poll(), watch.poll()] == [True, [], []]
    assert len(searches) == 2


def test_connected_devices_are_listed(buses):
    mock, *others = list_devices()
    assert mock.usable
    assert [(d.address, d.name, d.usable) for d in others] == [
        ("audio:device=amplifier,host_api=ALSA", "amplifier (ALSA)", True),
        ("hid:path=1-2", "0001:abcd", False),
        ("hid:path=/dev/hidraw0", "Touch Driver", True),
        ("serial:port=/dev/ttyUSB0", "adapter", False),
        ("serial:port=/dev/ttyACM0", "board", True),
        ("usb:bus=1,address=4", "1d6b:0002", False),
        ("usb:bus=1,address=7", "haptix driver 1209:0001", True),
    ]
    assert "Serial SN1" in others[6].note
    assert "full_scale_v=" in others[0].note
    assert [r.detail for r in survey_buses()] == [
        "sounddevice 7.7, PortAudio V19",
        "nidaqmx 5.5, NI-DAQmx 24.5",
        "hidapi 8.8",
        "pyserial 6.6",
        "pyusb 9.9",
    ]


def test_plugging_and_unplugging_is_told(buses):
    told = []
    watch = DeviceWatch(lambda device, is_there: told.append((device.address, is_there)))
    watch.start()
    first, second = "usb:bus=1,address=7", "usb:bus=1,address=8"
    assert watch.poll() == []
    driver = buses.devices.pop()
    watch.poll()
    buses.devices.append(SimpleNamespace(**{**vars(driver), "address": 8}))
    watch.poll()
    watch.poll()
    watch.stop()
    watch.stop()
    assert told == [(first, False), (second, True)]
    assert watch.error is None


def test_an_error_in_what_is_told_does_not_end_the_watch(buses, no_thread_is_left):
    seen = threading.Event()

    def on_change(device, is_there):
        if not is_there:
            raise KeyError("mine")
        seen.set()

    with DeviceWatch(on_change, interval_s=0.001) as watch:
        driver = buses.devices.pop()
        while watch.error is None:
            time.sleep(0.001)
        buses.devices.append(driver)
        assert seen.wait(PATIENCE_S)
    assert isinstance(watch.error, KeyError)


def test_this_computer_can_be_surveyed():
    assert [found.kind for found in survey_buses()] == ["audio", "daq", "hid", "serial", "usb"]
    assert all(found.detail for found in survey_buses())


def test_public_names_exist():
    missing = [name for name in vars(firmware_io)["__all__"] if not hasattr(firmware_io, name)]
    assert missing == []


def test_importing_loads_nothing_heavy():
    code = "import sys, firmware_io; print(*sys.modules)"
    loaded = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    ).stdout.split()
    heavy = {"torch", "scipy", "usb", "hid", "sounddevice", "haptix", "calibration"}
    assert "firmware_io" in loaded
    assert heavy.isdisjoint(loaded)
