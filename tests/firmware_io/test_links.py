"""Links: what their libraries do, and what becomes of it. Real stacks: tests/devices."""

import binascii
import errno
import signal
import socket
import subprocess
import sys
import time
import zlib
from contextlib import suppress
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest
import usb.core as usb_core

from firmware_io import (
    DeviceBusyError,
    DeviceDisconnectedError,
    DeviceError,
    DeviceNotFoundError,
    DevicePermissionError,
    MockDriver,
    Playback,
    ProtocolError,
    WaveSource,
    open_device,
)
from firmware_io.clock import HostClock
from firmware_io.links import usb as usb_link
from firmware_io.links.hid import Claim
from firmware_io.links.tcp import TcpLink
from firmware_io.protocol import FrameKind
from firmware_io.serve import DriverServer
from tests.links import stream_of
from tests.steady_clock import SteadyClock
from tests.waiting import PATIENCE_S


class UsbDevice:
    """What pyusb gives for a composite device, with a mock driver behind its bulk endpoints."""

    def __init__(self, serial="SN1", address=4, interface_class=0xFF):
        self.bus, self.address = 1, address
        self.idVendor, self.idProduct = 0x1209, 1
        self.serial_number = serial
        self.driver = MockDriver()
        self.fails = {}
        self.halted = []
        hid = [SimpleNamespace(bEndpointAddress=e, bmAttributes=3) for e in (0x81, 0x01)]
        bulk = [SimpleNamespace(bEndpointAddress=e, bmAttributes=2) for e in (0x82, 0x02)]
        self.interfaces = []
        for number, (kind, endpoints) in enumerate([(3, hid), (interface_class, bulk)]):
            interface = type("Interface", (list,), {})(endpoints)
            interface.bInterfaceClass, interface.bInterfaceNumber = kind, number
            self.interfaces.append(interface)

    def _fail(self, what):
        if what in self.fails:
            number = self.fails[what]
            raise usb_core.USBError("failed", None, number)

    def get_active_configuration(self):
        self._fail("configuration")
        return self.interfaces

    def is_kernel_driver_active(self, interface):
        return False

    def claim(self):
        self._fail("claim")

    def write(self, endpoint, data, timeout_ms):
        self._fail("write")
        assert endpoint == 0x02
        self.driver.receive(bytes(data))
        return len(data) - self.fails.get("short", 0)

    def read(self, endpoint, size, timeout_ms):
        self._fail("read")
        assert endpoint == 0x82
        assert timeout_ms > 0  # libusb waits for ever for 0
        answer = self.driver.transmit()
        if not answer:
            raise usb_core.USBTimeoutError("timed out", None, errno.ETIMEDOUT)
        return np.frombuffer(answer, np.uint8)

    def clear_halt(self, endpoint):
        self.halted.append(endpoint)
        self.fails.clear()


@pytest.fixture
def usb(monkeypatch):
    """A USB bus with one driver on it; a list, so that tests plug and unplug."""
    devices = [UsbDevice()]
    util = __import__("usb.util").util
    monkeypatch.setattr(usb_link.UsbLink, "wakes_s", 0.0)
    monkeypatch.setattr(usb_link, "find_drivers", lambda vendor, product: list(devices))
    monkeypatch.setattr(util, "claim_interface", lambda device, number: device.claim())
    monkeypatch.setattr(util, "dispose_resources", lambda device: None)
    return devices


def test_usb_plays(usb):
    volts = 100.0 * np.sin(np.arange(5000) / 5)
    device = open_device("usb:")
    with device:
        device.write(volts)
    np.testing.assert_allclose(usb[0].driver.played_v[:5000], volts, atol=250 / 32767 / 2 + 1e-9)
    assert device.name == "usb:bus=1,address=4"
    assert device.mock is None
    device.close()


def test_usb_writes_are_large(usb):
    writes = []
    write = usb[0].write

    def counted(endpoint, data, timeout_ms):
        writes.append(len(data))
        return write(endpoint, data, timeout_ms)

    usb[0].write = counted
    with open_device("usb:") as device:
        device.write(np.zeros(5000))
    assert max(writes) > 5000  # bytes: many frames in one transfer


def test_usb_devices_are_told_apart(usb):
    usb.append(UsbDevice("SN2", 5))
    with pytest.raises(DeviceError, match="bus=1,address=4, bus=1,address=5"):
        open_device("usb:")
    assert open_device("usb:serial=SN2").name == "usb:bus=1,address=5"
    assert open_device("usb:bus=1,address=4").name == "usb:bus=1,address=4"
    with pytest.raises(DeviceNotFoundError, match="SN3"):
        open_device("usb:serial=SN3")
    usb.clear()
    with pytest.raises(DeviceNotFoundError, match="haptix devices"):
        open_device("usb:")


@pytest.mark.parametrize("where", ["configuration", "claim"])
@pytest.mark.parametrize(
    ("number", "error", "says"),
    [
        (errno.EACCES, DevicePermissionError, "haptix doctor --install-udev"),
        (errno.EPERM, DevicePermissionError, "70-haptix.rules"),
        (errno.EBUSY, DeviceBusyError, "another program"),
        (errno.ENODEV, DeviceDisconnectedError, "plug it in"),
    ],
)
def test_usb_that_cannot_be_opened(usb, where, number, error, says):
    usb[0].fails[where] = number
    with pytest.raises(error, match=says):
        open_device("usb:")


def test_a_device_that_this_program_has_open_is_said_to_be(usb):
    with open_device("usb:") as device:
        device.write(np.zeros(10))
    usb[0].fails["claim"] = errno.EBUSY  # as libusb refuses a second claim
    with pytest.raises(DeviceBusyError, match=r"This program.*close\(\)"):
        open_device("usb:")
    device.close()
    with pytest.raises(DeviceBusyError) as refused:
        open_device("usb:")
    assert "This program" not in str(refused.value)


def test_usb_serial_that_may_not_be_read(usb):
    class Locked(UsbDevice):
        @property
        def serial_number(self):
            raise ValueError("The device has no langid")

        @serial_number.setter
        def serial_number(self, value):
            pass

    usb[:] = [Locked()]
    with pytest.raises(DevicePermissionError, match="serial number"):
        open_device("usb:serial=SN1")


def test_another_device_with_the_same_numbers(usb):
    usb[:] = [UsbDevice(interface_class=8)]
    with pytest.raises(ProtocolError, match="no vendor interface"):
        open_device("usb:")
    # Or one that has such an interface, but echoes.
    usb[:] = [UsbDevice()]
    echo: list[bytes] = []

    def write(endpoint, data, ms):
        echo.append(bytes(data))
        return len(data)

    usb[0].write = write
    usb[0].driver.transmit = lambda: echo.pop(0) if echo else b""
    with pytest.raises(ProtocolError, match="only hosts send"):
        open_device("usb:")
    # Or one that talks of something else, or says nothing.
    usb[0].driver.transmit = iter([b""] + [b"\r\nlogin: "] + 10_000 * [b""]).__next__
    with pytest.raises(ProtocolError, match="haptix driver"):
        open_device("usb:")


def test_a_device_that_never_stops_talking(usb, monkeypatch):
    monkeypatch.setattr("firmware_io.protocol_client.ANSWER_S", 0.2)
    usb[0].read = lambda endpoint, size, ms: np.zeros(64, np.uint8)
    with pytest.raises(ProtocolError, match="haptix driver"):
        open_device("usb:")


def test_a_version_from_the_future(usb):
    header = b"HX" + bytes([5, FrameKind.CAPABILITIES]) + bytes([0, 0, 4, 0, 0, 0])
    header += binascii.crc_hqx(header, 0xFFFF).to_bytes(2, "little")
    frame = header + b"news"
    frame += zlib.crc32(frame).to_bytes(4, "little")
    usb[0].driver.transmit = iter([b"", frame] + 10_000 * [b""]).__next__
    with pytest.raises(ProtocolError, match=r"version 4, .*version 5"):
        open_device("usb:")


@pytest.mark.parametrize(
    ("what", "value", "error", "says"),
    [
        ("write", errno.ENODEV, DeviceDisconnectedError, "is gone"),
        ("write", errno.ETIMEDOUT, DeviceDisconnectedError, "failed"),
        ("write", errno.EPIPE, ProtocolError, "stalled its endpoint 0x02"),
        ("read", errno.ENODEV, DeviceDisconnectedError, "is gone"),
        ("read", errno.EPIPE, ProtocolError, "stalled its endpoint 0x82"),
        ("short", 3, DeviceDisconnectedError, "of .* bytes"),
    ],
)
def test_usb_that_fails_in_mid_stream(usb, what, value, error, says):
    device = open_device("usb:")
    device.arm()
    device.write([50.0])
    usb[0].fails[what] = value
    with pytest.raises(error, match=says):
        device.write([60.0])
    assert not device.is_armed
    # Stalls are cleared, so that STOP gets through; unplugged, the watchdog does it.
    assert device.stop_is_owed == (value != errno.EPIPE)
    usb[0].fails.clear()
    device.close()
    assert usb[0].driver.played_codes[-1] == 0
    device = open_device("usb:")
    with device:
        device.write([50.0])


def test_no_libusb(monkeypatch):
    backends = __import__("usb.backend.libusb1").backend.libusb1
    monkeypatch.setattr(backends, "get_backend", lambda find_library=None: None)
    with pytest.raises(DeviceError, match=r"libusb-1\.0-0.*libusb-package"):
        open_device("usb:")


class HidDevice:
    """hidapi's device object, with a mock driver behind it."""

    def __init__(self, bus):
        self.bus = bus
        self.blocks = True

    def open_path(self, path):
        if path != self.bus.path or self.bus.refuses:
            raise OSError("open failed")

    def set_nonblocking(self, flag):
        self.blocks = not flag

    def write(self, report):
        assert len(report) == 64
        if self.bus.written != 64:
            return self.bus.written
        self.bus.driver.receive_report(bytes(report))
        return len(report)

    def read(self, size, timeout_ms=0):
        assert not self.blocks or timeout_ms, "this would wait for ever"
        if self.bus.is_gone:
            raise OSError("read error")
        return list(self.bus.driver.transmit_report())

    def close(self):
        self.bus.closed += 1


@pytest.fixture
def hid(monkeypatch, tmp_path):
    node = tmp_path / "hidraw7"
    node.touch()
    bus = SimpleNamespace(
        driver=MockDriver(),
        path=str(node).encode(),
        refuses=False,
        written=64,
        is_gone=False,
        closed=0,
        is_connected=True,
    )
    for name in ("hidraw", "hid"):
        module: Any = ModuleType(name)
        entry = {"path": bus.path, "serial_number": "SN1", "vendor_id": 0x1209, "product_id": 1}
        module.enumerate = lambda *numbers, entry=entry: [entry] if bus.is_connected else []
        module.device = lambda: HidDevice(bus)
        monkeypatch.setitem(sys.modules, name, module)
    return bus


@pytest.mark.parametrize("selector", ["", "serial=SN1", "backend=hid", "path="])
def test_hid_plays_envelopes(hid, selector):
    if selector == "path=":
        selector += hid.path.decode() + ",backend=hidraw"
    device = open_device(f"hid:{selector}")
    assert (device.mode, device.carrier_hz) == ("envelope", 4000.0)
    assert device.capabilities.sample_rate_hz == 16_000
    with device:
        device.write(np.full(5000, 20.0) + np.minimum(np.arange(5000), 100))
    assert hid.driver.played_v.max() == pytest.approx(120.0, abs=0.1)
    assert hid.driver.faults == 0
    device.close()
    device.close()
    assert hid.closed == 1


def test_hid_that_is_lost_in_mid_stream(hid):
    device = open_device("hid:")
    device.arm()
    device.write([1.0])
    hid.written = -1  # all that hidraw has to say of it
    with pytest.raises(DeviceDisconnectedError, match="-1 of 64"):
        device.write([2.0])
    hid.written = 64
    device.arm()
    hid.is_gone = True
    with pytest.raises(DeviceDisconnectedError, match="read error"):
        device.write([2.0])
    with pytest.raises(DeviceDisconnectedError):
        device.close()
    assert hid.closed == 1


def test_hid_that_cannot_be_opened(hid, monkeypatch):
    path = hid.path.decode()
    first = open_device("hid:")
    with pytest.raises(DeviceBusyError, match="another program"):
        open_device(f"hid:path={path},backend=hidraw")
    first.close()
    hid.refuses = True
    monkeypatch.setattr("os.access", lambda *arguments: False)
    with pytest.raises(DevicePermissionError, match="install-udev"):
        open_device("hid:")
    monkeypatch.setattr("os.access", lambda *arguments: True)
    with pytest.raises(DeviceBusyError, match="open failed"):
        open_device("hid:")
    with pytest.raises(DeviceNotFoundError, match="haptix devices"):
        open_device("hid:path=/dev/hidraw99")
    hid.is_connected = False
    with pytest.raises(DeviceNotFoundError, match="1209:0001"):
        open_device("hid:")


def test_a_claim_holds_across_processes():
    claim = Claim("some device")
    program = "from firmware_io.links.hid import Claim; Claim('some device')"
    command = [sys.executable, "-c", program]
    assert "DeviceBusyError" in subprocess.run(command, capture_output=True, text=True).stderr
    claim.release()
    claim.release()
    assert subprocess.run(command, capture_output=True, text=True).returncode == 0


SPEED = 0.1  # of both clocks: a watchdog of 0.16 s outlasts stalls of a busy machine of 1.6 s


def slow_driver():
    return MockDriver(pace="real", clock=SteadyClock(speed=SPEED))


@pytest.fixture
def slow_host(monkeypatch):
    """A host whose clock goes as slowly as that of its driver."""
    monkeypatch.setattr(HostClock, "__call__", lambda self: SPEED * time.monotonic())
    monkeypatch.setattr(HostClock, "sleep", lambda self, seconds: time.sleep(seconds / SPEED))


@pytest.fixture
def server(no_thread_is_left, slow_host):
    with DriverServer(slow_driver()) as server:
        yield server


def test_tcp_plays(server):
    device = open_device(server.address)
    wave = WaveSource(lambda first, count: 100.0 * np.sin(np.arange(first, first + count) / 5))
    with Playback(device, wave) as playback:
        while playback.stats.samples_played < 4_800:
            time.sleep(0.01)
            assert playback.is_running
    time.sleep(2 * 0.005 / SPEED)  # of the driver's ramp
    played = server.driver.played_v
    assert np.abs(played).max() == pytest.approx(100.0, abs=0.1)
    assert played[-1] == 0.0
    assert server.driver.faults == 0
    device.close()


def test_tcp_serves_one_host_at_a_time_and_the_next_one_after(server):
    first = open_device(server.address)
    with pytest.raises(DeviceBusyError, match="another host"):
        open_device(server.address)
    first.arm()
    first.write(np.linspace(0.0, 100.0, 100))
    stream_of(first).link.close()  # gone without a word
    second = None
    while second is None:
        with suppress(DeviceBusyError):  # until the server has seen it
            second = open_device(server.address)
    with second:
        second.write(np.linspace(0.0, 10.0, 100))
    assert server.driver.played_codes[-1] == 0
    second.close()


def test_tcp_that_hangs_up_in_mid_stream(slow_host):
    server = DriverServer(slow_driver())
    with server:
        device = open_device(server.address)
        device.arm()
        device.write([1.0])
    with pytest.raises(DeviceDisconnectedError, match=r"the connection|The connection"):
        for _ in range(100):
            device.write([1.0])
    assert server.driver.output[0][-1] == 0
    with pytest.raises(DeviceDisconnectedError):
        device.close()


SERVE = """
import functools, sys
from firmware_io import serve
from tests.steady_clock import SteadyClock

serve.MockDriver = functools.partial(serve.MockDriver, clock=SteadyClock(speed=0.1))
sys.exit(serve.main())
"""


def test_serving_from_the_command_line(tmp_path, slow_host):
    record = tmp_path / "volts.npy"
    options = ["--port", "0", "--record", str(record)]
    command = [sys.executable, "-c", SERVE, *options]
    server = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        device = open_device(server.stdout.readline().strip())
        with device:
            device.write(np.linspace(0.0, 90.0, 2000))
        device.close()
    finally:
        server.send_signal(signal.SIGINT)
        server.wait(PATIENCE_S)
    assert server.returncode == 0
    volts = np.load(record)
    assert volts.max() == pytest.approx(90.0, abs=0.01)
    assert volts[-1] == 0.0
    command = [sys.executable, "-m", "firmware_io.serve", *options, "--ceiling-v", "201"]
    refused = subprocess.run(command, capture_output=True, text=True)
    assert refused.returncode == 1
    assert "200 V" in refused.stderr


def test_nobody_serves():
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = listener.getsockname()[1]
    with pytest.raises(DeviceNotFoundError, match=rf"firmware_io\.serve --port {port}"):
        TcpLink("127.0.0.1", port)


def test_somebody_else_listens(monkeypatch):
    monkeypatch.setattr("firmware_io.protocol_client.ANSWER_S", 0.2)
    listener = socket.create_server(("127.0.0.1", 0))
    with listener, pytest.raises(DeviceError, match="another program"):
        open_device(f"tcp:127.0.0.1:{listener.getsockname()[1]}")
