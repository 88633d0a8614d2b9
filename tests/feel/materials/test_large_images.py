"""Pictures larger than memory are refused by their header, before a pixel is read."""

import struct
import tracemalloc
import zlib

import numpy as np
import pytest
from PIL import Image

from haptix import InputError, Texture
from haptix.feel.materials import pictures
from haptix.feel.materials.pictures import read_pixels


def png(path, width, height):
    """Header of a PNG, 16-bit grey, and no more pixels than a few bytes hold."""

    def chunk(kind, data):
        return (
            struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        )

    head = struct.pack(">IIBBBBB", width, height, 16, 0, 0, 0, 0)
    path.write_bytes(
        b"\x89PNG\r\n\x1a\n"
        + chunk(b"IHDR", head)
        + chunk(b"IDAT", zlib.compress(b"\0" * 9))
        + chunk(b"IEND", b"")
    )
    return path


def tiff(path, width, height, *, sample_format=1, bits=8):
    """One directory of a TIFF with a strip that is not there."""
    entries = [
        (256, 4, width), (257, 4, height), (258, 3, bits), (259, 3, 1), (262, 3, 1),
        (273, 4, 8), (277, 3, 1), (278, 4, height), (279, 4, min(width * height, 2**32 - 1)),
        (339, 3, sample_format),
    ]  # fmt: skip
    body = struct.pack("<H", len(entries))
    for tag, kind, value in entries:
        body += struct.pack("<HHII", tag, kind, 1, value)
    path.write_bytes(b"II*\0" + struct.pack("<I", 8) + body + struct.pack("<I", 0))
    return path


@pytest.mark.parametrize("size", [(40_000, 40_000), (15_000, 13_500), (201_000_000, 1)])
@pytest.mark.parametrize("kind", ["png", "tiff", "tiff of 64-bit floats"])
def test_refused_with_an_estimate(tmp_path, kind, size):
    if kind == "png":
        path = png(tmp_path / "huge.png", *size)
    elif kind == "tiff":
        path = tiff(tmp_path / "huge.tif", *size)
    else:
        path = tiff(tmp_path / "huge.tif", *size, sample_format=3, bits=64)
    tracemalloc.start()
    try:
        with pytest.raises(InputError, match=r"huge\.(png|tif).*scale it down") as caught:
            Texture.from_image(path, width_mm=60)
        assert tracemalloc.get_traced_memory()[1] < 5_000_000
    finally:
        tracemalloc.stop()
    assert "\n" not in str(caught.value)


def ramp(width, height, *channels):
    """Steps of 100 columns, whose averages over 2 x 2 and 4 x 4 pixels are their own levels."""
    levels = (np.arange(width) // 100 % 250).astype(np.uint8)
    return np.broadcast_to(levels.reshape(1, -1, *[1] * len(channels)), (height, width, *channels))


@pytest.mark.parametrize("kind", ["png", "jpg", "tif"])
def test_a_photograph_of_54_megapixels_is_read_at_less(tmp_path, kind):
    path = tmp_path / f"photo.{kind}"
    Image.fromarray(np.ascontiguousarray(ramp(9_000, 6_000))).save(path)
    pixels, _ = read_pixels("image", path)
    assert pixels.shape == (3_000, 4_500)
    # A step of JPEG rings over a block of 8 pixels, by a level or two.
    middles = pixels[1_500, 25::50].astype(int)
    assert np.abs(middles - ramp(9_000, 1)[0, 50::100]).max() <= (2 if kind == "jpg" else 0)
    assert Texture.from_image(path, width_mm=90.0).level.shape == (3_000, 4_500)


def test_averages_of_what_is_transparent_lie_on_black(monkeypatch, tmp_path):
    monkeypatch.setattr(pictures, "MOST_KEPT", 1)
    pixels = np.array([[[255, 255], [255, 255]], [[200, 0], [200, 0]]], np.uint8)  # white, nothing
    Image.fromarray(pixels, "LA").save(tmp_path / "a.png")
    assert pictures.read_grey(tmp_path / "a.png") == pytest.approx(255 / 2, abs=0.5)  # of rounding
    Image.fromarray(np.zeros((1, 3), np.uint8)).save(tmp_path / "b.png")
    assert pictures.read_grey(tmp_path / "b.png").shape == (1, 1)


def test_the_limit_can_be_moved(tmp_path):
    path = tmp_path / "photo.png"
    pixels = np.random.default_rng(0).integers(0, 256, (100, 120)).astype(np.uint8)
    Image.fromarray(pixels).save(path)
    with pytest.raises(InputError, match=r"120 x 100.*at most 5e-05 GB.*largest_bytes"):
        Texture.from_image(path, 60, largest_bytes=50_000)
    with pytest.raises(InputError, match="largest_bytes"):
        Texture.from_image(pixels, 60, largest_bytes=50_000)
    with pytest.raises(InputError, match="largest_bytes"):
        Texture.from_heights(pixels, 60, "height", largest_bytes=50_000)
    assert Texture.from_image(path, 60, largest_bytes=1_000_000).level.shape == (100, 120)


def test_the_estimate_is_near_what_it_takes(tmp_path):
    # 1000 x 1000 pixels of 8 bits: the message says how much; measured, it must not be more.
    path = tmp_path / "photo.png"
    Image.fromarray(np.random.default_rng(0).integers(0, 256, (1000, 1000)).astype(np.uint8)).save(
        path
    )
    with pytest.raises(InputError, match=r"some 0\.042 GB"):
        Texture.from_image(path, 60, largest_bytes=1)
    tracemalloc.start()
    try:
        _ = Texture.from_image(path, 60).evaluator
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert 0.026e9 < peak < 0.044e9  # two thirds to a tenth more, for what numpy holds besides
