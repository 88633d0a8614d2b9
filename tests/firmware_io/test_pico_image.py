"""The file for the Pico's USB drive, against its two formats and published check values."""

import hashlib
import json
import struct
import zlib

import pytest

from firmware_io import DeviceError
from firmware_io.pico_image import _boot_crc, as_uf2, pico_uf2
from tests.command_line import run_haptix

FAMILIES = {"pico": 0xE48BFF56, "pico2": 0xE48BFF59}  # of microsoft/uf2's uf2families.json


def blocks_of(image, board="pico"):
    """Address, payload and number of each block, by Microsoft's description of UF2."""
    assert len(image) % 512 == 0
    for at in range(0, len(image), 512):
        first, second, flags, address, size, number, count, family = struct.unpack_from(
            "<8I", image, at
        )
        assert (first, second) == (0x0A324655, 0x9E5D5157)
        assert struct.unpack_from("<I", image, at + 508) == (0x0AB16F30,)
        assert flags & 0x2000 and family == FAMILIES[board] and count == len(image) // 512
        yield address, image[at + 32 : at + 32 + size], number


def flash_of(image, board="pico"):
    flash = bytearray(b"\xff" * len(image))
    for address, payload, _ in blocks_of(image, board):
        start = address - 0x10000000
        flash[start : start + len(payload)] = payload
    return bytes(flash[: 256 * (len(image) // 512)])


def test_the_check_sum_of_the_second_stage_is_that_of_the_boot_rom():
    assert _boot_crc(b"123456789") == 0x0376E6E7  # CRC-32/MPEG-2 in the catalogue of CRCs


def test_blocks_follow_each_other_and_bear_the_bytes():
    binary = bytes(range(256)) * 3 + b"last word?!\0\0\0\0"
    image = as_uf2("pico", binary)
    assert [(address, number) for address, _, number in blocks_of(image)] == [
        (0x10000000 + 256 * n, n) for n in range(4)
    ]
    flash = flash_of(image)
    assert flash[:252] == binary[:252]
    assert struct.unpack_from("<I", flash, 252) == (_boot_crc(binary[:252]),)
    body = binary[256:-4]
    assert flash[256 : 256 + len(body)] == body
    assert struct.unpack_from("<I", flash, 256 + len(body)) == (zlib.crc32(body),)


def test_the_pico_2_has_the_image_definition_that_its_boot_rom_looks_for():
    """RP2350 datasheet, 5.9.5.1: the smallest one of a secure ARM program; vectors in front."""
    flash = flash_of(pico_uf2("pico2", "rig-1"), "pico2")
    words = struct.unpack_from("<64I", flash)
    at = words.index(0xFFFFDED3)
    assert words[at : at + 5] == (0xFFFFDED3, 0x10210142, 0x000001FF, 0, 0xAB123579)
    assert 0x20000000 < words[0] <= 0x20082000 and words[1] == 0x10000000 + 4 * (at + 5) + 1
    assert words[63] == 0


@pytest.mark.parametrize("board", FAMILIES)
def test_two_boards_differ_by_their_serial_and_its_check_sum_alone(board):
    first, second = (flash_of(pico_uf2(board, f"rig-{n}"), board) for n in (1, 2))
    apart = [at for at, (a, b) in enumerate(zip(first, second, strict=True)) if a != b]
    at = first.index(b"rig-1\0")
    assert apart[0] == at + 4
    assert len(apart) <= 5 and apart[-1] < len(first.rstrip(b"\0")) + 4


@pytest.mark.parametrize("board", FAMILIES)
def test_the_full_scale_of_an_amplifier_is_replaced_and_nothing_else(board):
    usual, own = (flash_of(pico_uf2(board, "r", volts), board) for volts in (200.0, 150.5))
    apart = [at for at, (a, b) in enumerate(zip(usual, own, strict=True)) if a != b]
    at = usual.index(struct.pack("<4I", 48_000, 200_000, 200_000, 4_666_666)) + 4
    assert struct.unpack_from("<I", own, at) == (150_500,)
    end = len(usual.rstrip(b"\0")) - 4
    assert all(at <= one < at + 4 or one >= end for one in apart)


@pytest.mark.parametrize("full_scale_v", [0.0, 9.9, 1000.1, float("nan"), float("inf")])
def test_a_full_scale_of_no_amplifier_is_refused(full_scale_v):
    with pytest.raises(DeviceError, match="full_scale_v"):
        pico_uf2("pico", "rig-1", full_scale_v)


def test_the_command_makes_no_folder_for_a_drive_that_is_not_there(tmp_path):
    done = run_haptix("firmware", "pico", "--out", tmp_path / "RPI-RP2" / "board.uf2")
    assert done.code == 2 and "a folder that exists" in done.err
    assert not (tmp_path / "RPI-RP2").exists()


@pytest.mark.parametrize("serial", ["", "x" * 16, "ü", "a\nb"])
def test_a_serial_that_no_descriptor_holds_is_refused(serial):
    with pytest.raises(DeviceError, match="serial"):
        pico_uf2("pico", serial)


@pytest.mark.parametrize("board", FAMILIES)
def test_the_command_writes_it_and_its_hash(tmp_path, board):
    path = tmp_path / "board.uf2"
    done = run_haptix("firmware", board, "--serial", "rig-1", "--out", path, "--json")
    (row,) = json.loads(done.out)
    assert path.read_bytes() == pico_uf2(board, "rig-1")
    assert row["bytes"] == path.stat().st_size
    assert row["sha256"] == hashlib.sha256(path.read_bytes()).hexdigest()
