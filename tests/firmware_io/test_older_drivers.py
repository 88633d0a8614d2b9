"""A driver of the wire's version 3, which knows no revisions."""

import struct
from binascii import crc32, crc_hqx

import pytest

from firmware_io import Device, ProtocolError
from firmware_io.link import Link
from firmware_io.protocol import FaultCode, FrameKind


def frame_of_version_3(kind, payload):
    head = b"HX" + struct.pack("<BBHHH", 3, kind, 0, len(payload), 0)
    body = head + struct.pack("<H", crc_hqx(head, 0xFFFF)) + payload
    return body + struct.pack("<I", crc32(body))


class OldDriver(Link):
    """Refuses a host that does not speak version 3, as firmware of that version does."""

    name = "old driver"

    def __init__(self):
        self.kinds, self._answers, self.is_closed = [], [], False

    def send(self, data):
        version, kind, (oldest, newest) = data[2], data[3], data[12:14]
        assert version == 3  # it would not read another one
        self.kinds.append(kind)
        assert not oldest <= 3 <= newest
        fault = struct.pack("<BBHIIQ", FaultCode.VERSION, 0, 0, 3, oldest, 0)
        self._answers.append(frame_of_version_3(FrameKind.FAULT, fault))

    def receive(self, timeout_s=0.0):
        return self._answers.pop(0) if self._answers else b""

    def close(self):
        self.is_closed = True


def test_a_driver_of_the_version_before_is_refused_and_never_armed():
    link = OldDriver()
    with pytest.raises(ProtocolError, match="version 3"):
        Device(link)
    assert link.kinds == [FrameKind.HELLO]
    assert link.is_closed
