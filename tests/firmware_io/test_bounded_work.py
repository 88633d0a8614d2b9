"""Bytes made to be slow: bounds on the work of the device's parser and of the host."""

import struct
import time
from binascii import crc_hqx
from dataclasses import replace

import numpy as np
import pytest

from firmware_io import Device, DeviceError, MockDriver, MockLink
from firmware_io.firmware.core import Core, Output
from firmware_io.protocol import (
    VERSION,
    Frame,
    FrameParser,
    Hello,
    Rate,
    StreamMode,
    StreamSamples,
    TouchPhase,
    TouchReport,
    encode,
)
from tests.firmware_io import core_rig

BOARD = replace(
    core_rig.BOARD,
    full_scale_mv=250_000,
    ceiling_mv=200_000,
    max_slew_v_per_s=4_666_666,
    queue_samples=65_536,
    max_frame_samples=32_765,
    rates=(Rate(48_000, frozenset(StreamMode)),),
)
LONGEST = 4 + 2 * 32_765


def header(length, kind=4):
    head = struct.pack("<2sBBHHH", b"HX", VERSION, kind, 0, length, 0)
    return head + struct.pack("<H", crc_hqx(head, 0xFFFF))


def nest(size, ends_together):
    """Valid headers one in the other, of frames that all are damaged."""
    data = b""
    while len(data) < size:
        left = size - len(data) - 16 if ends_together else size // 2
        data += header(max(0, min(left, LONGEST)))
    return data


HOSTILE = {
    "headers that end together": nest(65_000, True),
    "headers that end one after the other": nest(130_000, False),
    "magic": b"HX" * 60_000,
    "halves of the magic": b"H" * 100_000,
    "headers of no frame": (b"HX\x04\x04" + bytes(8)) * 9000,
    "one long damaged frame": header(LONGEST) + bytes(LONGEST + 4),
    "empty frames of an unknown kind": encode(Frame(Hello(), 0)).replace(b"\x01", b"\x7f") * 6000,
}


def seconds_per_byte(data, piece):
    best = np.inf
    for _ in range(7):
        core = Core(BOARD)
        began = time.process_time()  # the parser's own, whatever else runs
        for start in range(0, len(data), piece):
            core.receive(data[start : start + piece])
        best = min(best, time.process_time() - began)
    return best / len(data)


@pytest.mark.parametrize("name", HOSTILE)
@pytest.mark.parametrize("piece", [4096, 1 << 20])
def test_the_slowest_bytes_cost_four_times_ordinary_ones(name, piece):
    ordinary = encode(Frame(StreamSamples(0, np.zeros(480, np.int16)), 0)) * 100
    assert seconds_per_byte(HOSTILE[name], piece) < 4 * seconds_per_byte(ordinary, piece)


@pytest.mark.parametrize("name", HOSTILE)
def test_the_device_hears_hello_behind_hostile_bytes(name):
    core = Core(BOARD)
    core.receive(HOSTILE[name])
    core.transmit()
    # Behind the longest frame that the bytes may have announced.
    for _ in range((LONGEST + 16) // 18 + 2):
        core.receive(encode(Frame(Hello(), 0)))
    found = FrameParser().feed(core.transmit())
    assert any(isinstance(item, Frame) and item.message == BOARD for item in found)


def test_playing_parses_nothing():
    """A frame that pauses ends the output in play; the bytes behind it wait for the next call."""
    core = Core(BOARD)
    core.receive(encode(Frame(Hello(), 0)))
    core.transmit()
    core.receive(header(60_000) + encode(Frame(Hello(), 1)))
    core.play(4800)
    assert core.status().next_sequence == 1
    core.transmit()
    assert core.status().next_sequence == 2


class Flood(MockLink):
    """A device that sends touches whenever it is read, and never an end."""

    floods = False
    reads = 0

    def receive(self, timeout_s=0.0):
        self.reads += 1
        data = super().receive(timeout_s)
        touch = TouchReport(0, 1, 1, 1, 0, TouchPhase.MOVE)
        return data + encode(Frame(touch, 0)) * 400 if self.floods else data


def test_a_flood_of_touches_does_not_hold_a_write():
    link = Flood(MockDriver())
    device = Device(link)
    with device:
        device.write(np.zeros(10))
        link.floods = True
        before = link.reads
        device.write(np.zeros(10))
        # 4 reads whenever it looks for answers, before the samples and behind them.
        assert link.reads - before <= 8
        assert len(device.touches()) <= 1024
        link.floods = False
    assert Output.STREAM in link.driver.output[1]


@pytest.mark.parametrize(
    "absurd",
    [
        {"output_rate_hz": 2**32 - 1, "rates": (Rate(2**32 - 1, frozenset(StreamMode)),)},
        {"queue_samples": 2**32 - 1},
        {"output_rate_hz": 0},
        {"rates": (Rate(0, frozenset(StreamMode)),)},
        {"full_scale_mv": 0},
        {"max_watchdog_ms": 0},
        {"max_slew_v_per_s": 0},
    ],
    ids=str,
)
def test_a_device_that_states_the_impossible_is_refused(absurd):
    class Boaster(MockLink):
        def receive(self, timeout_s=0.0):
            super().receive(timeout_s)
            return encode(Frame(replace(BOARD, **absurd), 0))

    with pytest.raises(DeviceError, match=r"possible|must be"):
        Device(Boaster(MockDriver()))
