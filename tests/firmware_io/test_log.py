"""What the driver's side logs: bytes both ways, verdicts of limits, changes of state, losses."""

import logging

import numpy as np
import pytest

from firmware_io import Device, DeviceFaultError, LimitError, MockDriver, Playback, open_device
from firmware_io.links.mock import MockLink
from firmware_io.playback import WaveSource
from firmware_io.protocol import Frame, FrameParser


class RecordingLink(MockLink):
    """A mock's link that keeps what it carried."""

    def __init__(self, driver):
        super().__init__(driver)
        self.sent, self.received = b"", b""

    def send(self, data):
        self.sent += data
        super().send(data)

    def receive(self, timeout_s=0.0):
        data = super().receive(timeout_s)
        self.received += data
        return data


@pytest.fixture
def said(caplog):
    """The records of a room so far, as text."""
    caplog.set_level(logging.DEBUG, "firmware_io")
    return lambda room: [
        record.getMessage() for record in caplog.records if record.name == f"firmware_io.{room}"
    ]


def test_every_byte_both_ways_is_there_in_hex(said):
    link = RecordingLink(MockDriver())
    with Device(link) as device:
        device.write(np.full(100, 5.0))
    lines = said("protocol")
    sent = [line.split() for line in lines if " > " in line]
    received = [line.split()[-1] for line in lines if " < " in line]
    assert bytes.fromhex("".join(received)) == link.received
    assert bytes.fromhex("".join(line[-1] for line in sent)) == link.sent
    frames = FrameParser().feed(link.sent)
    assert all(isinstance(frame, Frame) for frame in frames)
    assert [line[2] for line in sent] == [type(frame.message).__name__ for frame in frames]


def test_verdicts_and_states_are_told(said):
    with open_device("mock:") as device:
        device.write([0.0, 12.5])
        with pytest.raises(LimitError):
            device.write([199.0])
    device.close()
    states = said("stream")
    assert "mock: limits accept 2, to 12.5 V" in states
    assert [line.partition(",")[0] for line in states if "armed" in line] == [
        "mock: armed",
        "mock: at 0 V and disarmed after 2 samples",
    ]
    opened, refused, closed = said("device")
    assert opened == "mock: opened, waveform at 48000 Hz"
    assert refused.startswith("mock: stops, refused by a limit: Sample 0 steps from")
    assert closed == "mock: closes"


def test_a_drivers_fault_is_told(said):
    with pytest.raises(DeviceFaultError), open_device("mock:") as device:
        device.write(np.full(100, 5.0))
        device.mock.advance(1.0)  # in silence: its watchdog ends the stream
        device.write([5.0])
    assert any("mock: the driver's fault: " in line for line in said("protocol"))


def test_damaged_bytes_are_told(said, monkeypatch):
    link = RecordingLink(MockDriver())
    device = Device(link)
    whole = MockLink.receive
    monkeypatch.setattr(MockLink, "receive", lambda *arguments: b"\x00\x01" + whole(*arguments))
    device.arm()
    assert any("mock: dropped bytes: " in line for line in said("protocol"))


def test_a_stall_beyond_the_horizon_is_told(said):
    with open_device("mock:pace=stepped") as device:
        device.stop()
        source = WaveSource(lambda first, count: np.zeros(count))
        with Playback(device, source, horizon_s=0.02) as playback:
            playback.run_until(device.clock() + 0.2)
            device.clock.sleep(0.11)  # nobody plays; the watchdog waits longer
            playback.run_until(device.clock() + 0.1)
            assert playback.stats.underruns == 1
    lines = said("playback")
    assert lines[0] == "begins: reaction 0.003 s, horizon 0.02 s"
    assert "underrun, 1 in all" in lines
    assert lines[-1].startswith("ends: PlaybackStats(")


def test_off_it_costs_no_text(monkeypatch):
    """No frame is written in hex, and nothing formatted, where nobody logs."""
    monkeypatch.setattr(logging.Logger, "_log", lambda *_, **__: pytest.fail("a record was made"))
    assert not logging.getLogger("firmware_io").isEnabledFor(logging.INFO)
    with open_device("mock:") as device:
        device.write([0.0, 1.0])
    device.close()
