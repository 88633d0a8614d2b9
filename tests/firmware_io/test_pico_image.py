"""The file for the Pico's USB drive, against its two formats and published check values."""

import hashlib
import json
import struct
import zlib

import pytest

from firmware_io import DeviceError
from firmware_io.pico_image import _boot_crc, as_uf2, pico_uf2
from tests.command_line import run_haptix


def blocks_of(image):
    """Address, payload and number of each block, by Microsoft's description of UF2."""
    assert len(image) % 512 == 0
    for at in range(0, len(image), 512):
        first, second, flags, address, size, number, count, family = struct.unpack_from(
            "<8I", image, at
        )
        assert (first, second) == (0x0A324655, 0x9E5D5157)
        assert struct.unpack_from("<I", image, at + 508) == (0x0AB16F30,)
        assert flags & 0x2000 and family == 0xE48BFF56 and count == len(image) // 512
        yield address, image[at + 32 : at + 32 + size], number


def flash_of(image):
    flash = bytearray(b"\xff" * len(image))
    for address, payload, _ in blocks_of(image):
        start = address - 0x10000000
        flash[start : start + len(payload)] = payload
    return bytes(flash[: 256 * (len(image) // 512)])


def test_the_check_sum_of_the_second_stage_is_that_of_the_boot_rom():
    assert _boot_crc(b"123456789") == 0x0376E6E7  # CRC-32/MPEG-2 in the catalogue of CRCs


def test_blocks_follow_each_other_and_bear_the_bytes():
    binary = bytes(range(256)) * 3 + b"last word?!\0\0\0\0"
    image = as_uf2(binary)
    assert [(address, number) for address, _, number in blocks_of(image)] == [
        (0x10000000 + 256 * n, n) for n in range(4)
    ]
    flash = flash_of(image)
    assert flash[:252] == binary[:252]
    assert struct.unpack_from("<I", flash, 252) == (_boot_crc(binary[:252]),)
    body = binary[256:-4]
    assert flash[256 : 256 + len(body)] == body
    assert struct.unpack_from("<I", flash, 256 + len(body)) == (zlib.crc32(body),)


def test_two_boards_differ_by_their_serial_and_its_check_sum_alone():
    first, second = flash_of(pico_uf2("rig-1")), flash_of(pico_uf2("rig-2"))
    apart = [at for at, (a, b) in enumerate(zip(first, second, strict=True)) if a != b]
    at = first.index(b"rig-1\0")
    assert apart[0] == at + 4
    assert len(apart) <= 5 and apart[-1] < len(first.rstrip(b"\0")) + 4


@pytest.mark.parametrize("serial", ["", "x" * 16, "ü", "a\nb"])
def test_a_serial_that_no_descriptor_holds_is_refused(serial):
    with pytest.raises(DeviceError, match="serial"):
        pico_uf2(serial)


def test_the_command_writes_it_and_its_hash(tmp_path):
    path = tmp_path / "board.uf2"
    done = run_haptix("firmware", "pico", "--serial", "rig-1", "--out", path, "--json")
    (row,) = json.loads(done.out)
    assert path.read_bytes() == pico_uf2("rig-1")
    assert row["bytes"] == path.stat().st_size
    assert row["sha256"] == hashlib.sha256(path.read_bytes()).hexdigest()
