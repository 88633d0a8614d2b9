"""The firmware of the Pico board, as the file that its USB drive takes.

The board's own Makefile calls this file too: ``python pico_image.py program.bin program.uf2``.

The boot ROM starts a second stage of 252 bytes whose CRC-32, which is not reflected, stands behind
it (RP2040 datasheet, 2.8.1.3.1). The program finds the CRC-32 of its image, as in zlib, in its last
word. The blocks are those of Microsoft's UF2 format, with the RP2040's number.
"""

from __future__ import annotations

import struct
import sys
import zlib
from pathlib import Path

_FLASH, _STAGE, _PAYLOAD = 0x10000000, 252, 256
_RP2040, _HAS_FAMILY = 0xE48BFF56, 0x2000
#: The serial number in `main.c`, which is replaced.
_NO_SERIAL = b"serial-not-set".ljust(16, b"\0")


def pico_uf2(serial: str = "0") -> bytes:
    """Return the firmware of the Pico board, to be copied to its USB drive.

    Parameters
    ----------
    serial : str
        Serial number by which a host tells boards apart: 1 to 15 characters of ASCII.

    Returns
    -------
    bytes
        Blocks of 512 bytes.

    Raises
    ------
    DeviceError
        If `serial` is no such text, or the program is missing and cannot be built.

    Examples
    --------
    >>> image = pico_uf2("rig-3")
    >>> image[:3], len(image) % 512
    (b'UF2', 0)
    """
    from firmware_io.c_library import pico_program
    from firmware_io.device_errors import DeviceError

    if not (serial.isascii() and serial.isprintable() and 1 <= len(serial) <= 15):
        raise DeviceError(
            f"serial must be 1 to 15 printable characters of ASCII, but is {serial!r}; shorten it."
        )
    binary = pico_program().read_bytes()
    assert binary.count(_NO_SERIAL) == 1
    return as_uf2(binary.replace(_NO_SERIAL, serial.encode().ljust(len(_NO_SERIAL), b"\0")))


def as_uf2(binary: bytes) -> bytes:
    """Return the blocks of a program that begins at the flash's first byte, with its check sums."""
    flash = _with_check_sums(binary)
    pieces = [
        flash[at : at + _PAYLOAD].ljust(_PAYLOAD, b"\0") for at in range(0, len(flash), _PAYLOAD)
    ]
    blocks = []
    for number, piece in enumerate(pieces):
        address = _FLASH + _PAYLOAD * number
        head = (_HAS_FAMILY, address, _PAYLOAD, number, len(pieces), _RP2040)
        block = struct.pack("<8I", 0x0A324655, 0x9E5D5157, *head) + piece.ljust(476, b"\0")
        blocks.append(block + struct.pack("<I", 0x0AB16F30))
    return b"".join(blocks)


def _with_check_sums(binary: bytes) -> bytes:
    stage, image = binary[:_STAGE].ljust(_STAGE, b"\0"), binary[_PAYLOAD:-4]
    return b"".join(
        (stage, struct.pack("<I", _boot_crc(stage)), image, struct.pack("<I", zlib.crc32(image)))
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
    source, to = map(Path, sys.argv[1:])
    to.write_bytes(as_uf2(source.read_bytes()))
