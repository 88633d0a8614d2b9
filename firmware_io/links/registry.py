"""Every kind of link, by the scheme of its addresses. A new link adds its line here."""

from __future__ import annotations

from collections.abc import Mapping

from firmware_io.links import audio, daq, hid, mock, serial, tcp, usb
from firmware_io.scheme import Scheme

SCHEMES: Mapping[str, Scheme] = {
    "mock": mock.SCHEME,
    "usb": usb.SCHEME,
    "hid": hid.SCHEME,
    "serial": serial.SCHEME,
    "audio": audio.SCHEME,
    "daq": daq.SCHEME,
    "tcp": tcp.SCHEME,
}
