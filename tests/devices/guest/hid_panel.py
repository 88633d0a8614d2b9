"""A HID touch panel of the class of Windows 8, made with uhid: the kernel's own driver reads it."""

import os
import struct
import threading
import time

_CREATE2, _DESTROY, _GET_REPORT, _GET_REPORT_REPLY, _INPUT2, _SET_REPORT, _SET_REPORT_REPLY = (
    *(11, 1, 9, 10, 12),
    *(13, 14),
)


class HidPanel:
    """One finger with Tip Switch and In Range, a contact count and a scan time of 100 us.

    Parameters
    ----------
    width_mm, height_mm : float
        Physical size, that the descriptor states in hundredths of a centimetre.
    """

    def __init__(self, width_mm=200, height_mm=113, name="haptix test panel"):
        self.name = name
        self._scan = 0
        self._fd = os.open("/dev/uhid", os.O_RDWR)
        report = descriptor(round(width_mm * 10), round(height_mm * 10))
        about = (name.encode(), b"", b"", len(report), 3, 0x1209, 0x7777, 1, 0, report)
        os.write(self._fd, struct.pack("<I128s64s64sHHIIII4096s", _CREATE2, *about))
        threading.Thread(target=self._answer, daemon=True).start()
        time.sleep(1.5)  # the kernel's probe asks for reports

    def report(self, tip, in_range, x, y, ms=10, count=1):
        """Send a report of the finger, `ms` by the panel's clock after the one before."""
        self._scan = (self._scan + round(ms * 10)) % 65536
        body = struct.pack("<BBBHHBH", 1, tip | in_range << 1, 5, x, y, count, self._scan)
        os.write(self._fd, struct.pack("<IH4096s", _INPUT2, len(body), body))

    def _answer(self):
        while True:
            try:
                data = os.read(self._fd, 4400)
            except OSError:
                return
            (kind,) = struct.unpack_from("<I", data)
            if kind == _GET_REPORT:
                number, report = struct.unpack_from("<IB", data, 4)
                body = bytes([report, 10]) if report == 2 else bytes([report]) + bytes(256)
                answer = struct.pack("<IIHH4096s", _GET_REPORT_REPLY, number, 0, len(body), body)
                os.write(self._fd, answer)
            elif kind == _SET_REPORT:
                (number,) = struct.unpack_from("<I", data, 4)
                os.write(self._fd, struct.pack("<IIH", _SET_REPORT_REPLY, number, 0))

    def __enter__(self):
        return self

    def __exit__(self, *_):
        os.write(self._fd, struct.pack("<I", _DESTROY))
        os.close(self._fd)


def descriptor(width, height):
    """Report descriptor; lengths in units of 10^-2 cm."""
    parts = [
        "050d 0904 a101 8501",  # digitizers, touch screen, application, report 1
        "0922 a102",  # finger, logical
        "0942 1500 2501 7501 9501 8102",  # tip switch
        "0932 8102",  # in range
        "9506 8103",  # padding
        "0951 257f 7508 9501 8102",  # contact identifier
        "0501 26ff0f 7510 550e 6511 0930 3500",  # x, 0 to 4095, in 10^-2 cm
        "46" + struct.pack("<H", width).hex() + "8102",
        "46" + struct.pack("<H", height).hex() + "0931 8102",
        "c0",
        "050d 0954 250a 7508 9501 8102",  # contact count
        "0956 550c 660110 47ffff0000 27ffff0000 7510 9501 8102",  # scan time, in 100 us
        "8502 0955 250a 7508 9501 b102",  # contact count maximum
        "8503 0600ff 09c5 1500 26ff00 7508 960001 b102",  # blob of certification
        "c0",
    ]
    return bytes.fromhex("".join(parts))
