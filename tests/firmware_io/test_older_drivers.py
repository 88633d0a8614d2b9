"""A driver of the wire's version 3, which knows no revisions."""

import struct
from binascii import crc32, crc_hqx

import numpy as np

from firmware_io import Device
from firmware_io.links.mock import MockLink
from firmware_io.protocol import FrameParser, encode

#: Payloads of version 3 that were shorter: CAPABILITIES by its last bytes, STATUS to this many.
CAPABILITIES, STATUS, GUARD_BYTES, STATUS_BYTES = 0x81, 0x82, 4, 36


def as_version_3(data):
    """Frames of a device as one of version 3 would have sent them."""
    old = b""
    for frame in FrameParser().feed(data):
        new = encode(frame)
        kind, payload = new[3], new[12:-4]
        if kind == CAPABILITIES:
            payload = bytes([3, 3]) + payload[2:-GUARD_BYTES]
        if kind == STATUS:
            payload = payload[:STATUS_BYTES]
        head = new[:2] + bytes([3]) + new[3:6] + struct.pack("<H", len(payload)) + new[8:10]
        body = head + struct.pack("<H", crc_hqx(head, 0xFFFF)) + payload
        old += body + struct.pack("<I", crc32(body))
    return old


class OldLink(MockLink):
    """A mock whose firmware speaks version 3 only."""

    def send(self, data):
        assert data[2] == 3
        super().send(b"".join(encode(frame) for frame in FrameParser().feed(data)))

    def receive(self, timeout_s=0.0):
        return as_version_3(super().receive(timeout_s))


def test_a_driver_of_the_version_before_plays_as_it_did():
    wave = 100 * np.sin(np.arange(4800) / 20)
    played = []
    for link in (OldLink(), MockLink()):
        with Device(link) as device:
            device.write(wave)
        played.append(link.driver.played_codes)
        assert (device.capabilities.guard_s == 0.0) == isinstance(link, OldLink)
    assert np.array_equal(*played)
