"""The firmware of the Pico boards, as the file that their USB drive takes.

The boards' own Makefile calls this file too: ``python pico_image.py pico program.bin program.uf2``.

The RP2040's boot ROM starts a second stage of 252 bytes whose CRC-32, which is not reflected,
stands behind it (its datasheet, 2.8.1.3.1); the RP2350's looks for an image definition, which
stands in those bytes, and for no sum. The program finds the CRC-32 of its image, as in zlib, in its
last word. The blocks are those of Microsoft's UF2 format, with the number of the chip.
"""

from __future__ import annotations

import struct
import sys
import zlib
from pathlib import Path

_FLASH, _STAGE, _PAYLOAD = 0x10000000, 252, 256
_HAS_FAMILY = 0x2000
#: The chip of each board, as UF2 numbers it: the RP2040, the secure ARM cores of the RP2350.
_FAMILIES = {"pico": 0xE48BFF56, "pico2": 0xE48BFF59}
#: The serial number in `main.c`, which is replaced.
_NO_SERIAL = b"serial-not-set".ljust(16, b"\0")
#: The first numbers of the set-up in `main.c`: output rate, full scale, ceiling, slew. The full
#: scale is replaced; the others stay.
_SETUP = struct.Struct("<4I")
_NUMBERS = 48_000, 200_000, 200_000, 4_666_666
LOWEST_FULL_SCALE_V, HIGHEST_FULL_SCALE_V = 10.0, 1000.0


def pico_uf2(board: str, serial: str = "0", full_scale_v: float = 200.0) -> bytes:
    """Return the firmware of a Pico board, to be copied to its USB drive.

    Parameters
    ----------
    board : str
        ``pico`` (RP2040) or ``pico2`` (RP2350).
    serial : str
        Serial number by which a host tells boards apart: 1 to 15 characters of ASCII.
    full_scale_v : float
        Voltage [V] that the amplifier makes of the largest code, 32767: 10 to 1000. Samples above
        200 V are refused whatever it is.

    Returns
    -------
    bytes
        Blocks of 512 bytes.

    Raises
    ------
    DeviceError
        If `serial` is no such text or `full_scale_v` no such voltage, or the program is missing and
        cannot be built.

    Examples
    --------
    >>> image = pico_uf2("pico", "rig-3")
    >>> image[:3], len(image) % 512
    (b'UF2', 0)
    """
    from firmware_io.c_library import pico_program
    from firmware_io.device_errors import DeviceError

    if not (serial.isascii() and serial.isprintable() and 1 <= len(serial) <= 15):
        raise DeviceError(
            f"serial must be 1 to 15 printable characters of ASCII, but is {serial!r}; shorten it."
        )
    if not LOWEST_FULL_SCALE_V <= full_scale_v <= HIGHEST_FULL_SCALE_V:
        raise DeviceError(
            f"full_scale_v must lie in {LOWEST_FULL_SCALE_V:g} to {HIGHEST_FULL_SCALE_V:g} V, but "
            f"is {full_scale_v:g}; measure the amplifier's voltage at code 32767."
        )
    rate_hz, _, *others = _NUMBERS
    numbers = _SETUP.pack(rate_hz, round(full_scale_v * 1e3), *others)
    binary = pico_program(board).read_bytes()
    assert (binary.count(_NO_SERIAL), binary.count(_SETUP.pack(*_NUMBERS))) == (1, 1)
    binary = binary.replace(_NO_SERIAL, serial.encode().ljust(len(_NO_SERIAL), b"\0"))
    return as_uf2(board, binary.replace(_SETUP.pack(*_NUMBERS), numbers))


def as_uf2(board: str, binary: bytes) -> bytes:
    """Return the blocks of a program that begins at the flash's first byte, with its check sums."""
    flash = _with_check_sums(board, binary)
    pieces = [
        flash[at : at + _PAYLOAD].ljust(_PAYLOAD, b"\0") for at in range(0, len(flash), _PAYLOAD)
    ]
    blocks = []
    for number, piece in enumerate(pieces):
        address = _FLASH + _PAYLOAD * number
        head = (_HAS_FAMILY, address, _PAYLOAD, number, len(pieces), _FAMILIES[board])
        block = struct.pack("<8I", 0x0A324655, 0x9E5D5157, *head) + piece.ljust(476, b"\0")
        blocks.append(block + struct.pack("<I", 0x0AB16F30))
    return b"".join(blocks)


def _with_check_sums(board: str, binary: bytes) -> bytes:
    stage, image = binary[:_STAGE].ljust(_STAGE, b"\0"), binary[_PAYLOAD:-4]
    boot_crc = _boot_crc(stage) if board == "pico" else 0
    return b"".join(
        (stage, struct.pack("<I", boot_crc), image, struct.pack("<I", zlib.crc32(image)))
    )


def _boot_crc(stage: bytes) -> int:
    """Return the boot ROM's CRC-32: polynomial 0x04c11db7, from all ones, not reflected."""
    crc = 0xFFFFFFFF
    for byte in stage:
        crc ^= byte << 24
        for _ in range(8):
            crc = (crc << 1 ^ (0x04C11DB7 if crc & 0x80000000 else 0)) & 0xFFFFFFFF
    return crc


if __name__ == "__main__":
    name, source, to = sys.argv[1:]
    Path(to).write_bytes(as_uf2(name, Path(source).read_bytes()))
