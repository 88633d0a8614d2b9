"""What the emulated board tells of itself: high speed, an interface for HID and one for bulk."""

import struct

VENDOR_ID, PRODUCT_ID = 0x1209, 0x0001
HID_ENDPOINT, BULK_ENDPOINT = 1, 2
HID_INTERFACE = 0
_INTERRUPT, _BULK = 3, 2

#: Vendor's page; reports of 64 bytes both ways, id 1 included (PROTOCOL.md).
HID_REPORT = bytes.fromhex(
    "0600ff 0901 a101 8501 1500 26ff00 7508 953f 0902 8102 0903 9102 c0".replace(" ", "")
)


def _endpoint(address, kind, size, interval):
    return struct.pack("<BBBBHB", 7, 5, address, kind, size, interval)


def _interface(number, of_class, name):
    return struct.pack("<9B", 9, 4, number, 0, 2, of_class, 0, 0, name)


_DEVICE = struct.pack(
    "<BBHBBBBHHHBBBB", 18, 1, 0x0200, 0, 0, 0, 64, VENDOR_ID, PRODUCT_ID, 0x0100, 1, 2, 3, 1
)
_QUALIFIER = struct.pack("<BBHBBBBBB", 10, 6, 0x0200, 0, 0, 0, 64, 1, 0)
_HID = struct.pack("<BBHBBBH", 9, 0x21, 0x0111, 0, 1, 0x22, len(HID_REPORT))
_INTERFACES = (
    _interface(HID_INTERFACE, 3, 4)
    + _HID
    + _endpoint(0x80 | HID_ENDPOINT, _INTERRUPT, 64, 1)
    + _endpoint(HID_ENDPOINT, _INTERRUPT, 64, 1)
    + _interface(1, 0xFF, 5)
    + _endpoint(0x80 | BULK_ENDPOINT, _BULK, 512, 0)
    + _endpoint(BULK_ENDPOINT, _BULK, 512, 0)
)
_CONFIGURATION = (
    struct.pack("<BBHBBBBB", 9, 2, 9 + len(_INTERFACES), 2, 1, 0, 0x80, 50) + _INTERFACES
)


def descriptor(kind, index, serial):
    """Return one descriptor; None if there is none, which the host is told by a stall."""
    names = ("haptix", "haptix test board", serial, "reports", "bulk")
    if kind == 3:
        text = "\u0409" if index == 0 else names[index - 1] if index <= len(names) else None
        coded = None if text is None else text.encode("utf-16-le")
        return None if coded is None else bytes((len(coded) + 2, 3)) + coded
    return {1: _DEVICE, 2: _CONFIGURATION, 6: _QUALIFIER, 0x21: _HID, 0x22: HID_REPORT}.get(kind)
