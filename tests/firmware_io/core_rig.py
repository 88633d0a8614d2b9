"""A core on the bench, and a host that numbers its frames."""

import struct
import zlib
from binascii import crc_hqx
from dataclasses import replace

import numpy as np

from firmware_io.firmware.core import Core
from firmware_io.protocol import (
    Arm,
    CapabilitiesReport,
    DeviceState,
    FaultCode,
    Frame,
    FrameParser,
    Hello,
    Rate,
    Setup,
    StreamMode,
    StreamSamples,
    encode,
)

BOTH = frozenset(StreamMode)
WAVEFORM, ENVELOPE = StreamMode.WAVEFORM, StreamMode.ENVELOPE
STATE, CODE = DeviceState, FaultCode

#: 48 kHz out; 25 V full scale, of which 20 V are allowed: code 26213. So low that the slew admits
#: any step of them.
BOARD = CapabilitiesReport(
    oldest_version=4,
    newest_version=4,
    report_bytes=64,
    output_rate_hz=48_000,
    full_scale_mv=25_000,
    ceiling_mv=20_000,
    max_slew_v_per_s=2_638_937,
    queue_samples=2000,
    max_frame_samples=1000,
    max_watchdog_ms=160,
    name="board",
    serial="B1",
    calibration_id="none yet",
    reports_touch=True,
    rates=(Rate(48_000, BOTH), Rate(16_000, BOTH), Rate(6_000, frozenset({WAVEFORM}))),
)
PLAIN = Setup(WAVEFORM, 160, 48_000, 25_000, 20_000, 2_638_937, lead_us=0)
CARRIED = replace(PLAIN, mode=ENVELOPE, sample_rate_hz=16_000, carrier_mhz=4_000_000)
TOP = 26213
RAMP = 240  # 5 ms


class Rig:
    """A core on the bench, and a host that numbers its frames."""

    def __init__(self, config=BOARD):
        self.core = Core(config)
        self.parser = FrameParser()
        self.sequence = 0
        self.index = 0

    def frame(self, message):
        data = encode(Frame(message, self.sequence % 2**16))
        self.sequence += 1
        return data

    def say(self, *messages):
        """Send messages; return what the device says."""
        for message in messages:
            self.core.receive(self.frame(message))
        return self.poll()

    def poll(self):
        return [frame.message for frame in self.parser.feed(self.core.transmit())]

    def ready(self, setup=PLAIN):
        """Set up and armed."""
        self.say(Hello(), setup, Arm())
        self.index = 0
        assert self.core.status().state is STATE.ARMED
        return self

    def stream(self, codes, mode=WAVEFORM):
        codes = np.array(codes, np.int16)
        answers = self.say(StreamSamples(self.index, codes, mode))
        self.index += codes.size
        return answers

    def play(self, ticks):
        return self.core.play(ticks)[0].tolist()


def resealed(data: bytes, **changes: int) -> bytes:
    """A frame with header bytes changed (`at_3=9`) and both check sums made right again."""
    body = bytearray(data[:-4])
    for where, value in changes.items():
        body[int(where.removeprefix("at_"))] = value
    body[10:12] = struct.pack("<H", crc_hqx(bytes(body[:10]), 0xFFFF))
    return bytes(body) + struct.pack("<I", zlib.crc32(body))
