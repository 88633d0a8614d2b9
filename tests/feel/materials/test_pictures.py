"""Pictures are felt as they are seen, whatever the file's form; what is not read is named."""

import numpy as np
import pytest
import tifffile
from PIL import Image, ImageCms

from haptix import InputError, Texture
from haptix.feel.materials.decoded import PICTURES
from haptix.feel.materials.pictures import read_grey, read_normals

GREY = np.random.default_rng(5).integers(0, 256, (12, 20)).astype(np.uint8)
COLOUR = np.random.default_rng(6).integers(0, 256, (12, 20, 3)).astype(np.uint8)
SMOOTH = np.add.outer(6 * np.arange(24), 3 * np.arange(32)).astype(np.uint8)


def luminance(colour):
    """Rec. 709, 0 to 1."""
    return colour / 255 @ [0.2125, 0.7154, 0.0721]


def seen(path):
    return read_grey(path)


# What a viewer does with the stored picture for each orientation (TIFF 6.0, page 36; EXIF alike).
UPRIGHT = {
    1: lambda a: a,
    2: np.fliplr,
    3: lambda a: np.rot90(a, 2),
    4: np.flipud,
    5: np.transpose,
    6: lambda a: np.rot90(a, -1),
    7: lambda a: np.rot90(np.transpose(a), 2),
    8: np.rot90,
}


@pytest.mark.parametrize("orientation", UPRIGHT)
@pytest.mark.parametrize("kind", ["jpg", "png", "tif", "lzw.tif"])
def test_a_picture_is_turned_as_the_camera_noted(tmp_path, orientation, kind):
    path = tmp_path / f"photo.{kind}"
    exif = Image.Exif()
    exif[0x0112] = orientation
    more = {"compression": "tiff_lzw"} if kind == "lzw.tif" else {"quality": 98}
    Image.fromarray(SMOOTH).save(path, exif=exif, **({} if kind in ("png", "tif") else more))
    expected = UPRIGHT[orientation](SMOOTH.astype(float))
    # JPEG is lossy, on a smooth picture by few greys; all else is exact.
    np.testing.assert_allclose(seen(path), expected, rtol=0, atol=4 if kind == "jpg" else 0)


@pytest.mark.parametrize("suffix", PICTURES)
def test_each_form_of_file_is_read(tmp_path, suffix):
    path = tmp_path / f"photo{suffix}"
    is_lossy = suffix in (".jpg", ".jpeg", ".webp", ".avif")
    Image.fromarray(SMOOTH).save(path, **({"quality": 98} if is_lossy else {}))
    # On a smooth picture a lossy form is off by few greys; a channel or a row would be by dozens.
    grey = seen(path)
    if grey.max() <= 1:  # of a form, or a version of Pillow, that keeps grey as colours
        grey = 255 * grey
    np.testing.assert_allclose(grey, SMOOTH, rtol=0, atol=8 if is_lossy else 0)


@pytest.mark.parametrize("kind", ["png", "webp", "tif"])
@pytest.mark.parametrize("mode", ["LA", "RGBA"])
def test_a_transparent_picture_lies_on_black(tmp_path, kind, mode):
    if (kind, mode) == ("webp", "LA"):
        mode = "RGBA"
    opacity = np.linspace(0, 255, GREY.size).reshape(GREY.shape).round().astype(np.uint8)
    path = tmp_path / f"photo.{kind}"
    Image.fromarray(np.dstack([GREY, opacity]), "LA").convert(mode).save(
        path, **({"lossless": True, "exact": True} if kind == "webp" else {})
    )
    expected = GREY * (opacity / 255.0)
    scale = 1 if mode == "LA" else 1 / 255
    # Weights of the three channels add to 1 with 4 digits.
    np.testing.assert_allclose(seen(path), expected * scale, rtol=2e-4, atol=1e-9)


def test_colours_stored_times_their_opacity(tmp_path):
    """Associated alpha of TIFF: half-transparent colours are stored half as bright."""
    opacity = np.full(GREY.shape, 128, np.uint8)
    opacity[0] = 255
    stored = (COLOUR * (opacity[..., None] / 255)).round().astype(np.uint8)
    path = tmp_path / "photo.tif"
    tifffile.imwrite(
        path, np.dstack([stored, opacity]), photometric="rgb", extrasamples=["assocalpha"]
    )
    expected = luminance(stored)
    np.testing.assert_allclose(seen(path), expected, rtol=2e-3)


@pytest.mark.parametrize(("polarity", "high"), [("bright-high", 255), ("dark-high", 0)])
@pytest.mark.parametrize("colour", [0, 255])
def test_friction_is_lowest_where_a_photograph_is_transparent(colour, polarity, high):
    pixels = np.full((40, 40, 2), [colour, 0], np.uint8)
    pixels[:, 20:] = [high, 255]
    level = Texture.from_image(pixels, 40.0, polarity).level
    np.testing.assert_array_equal(level, np.tile(np.repeat([0.0, 1.0], 20), (40, 1)))


@pytest.mark.parametrize("kind", ["png", "gif", "tif"])
def test_a_palette_is_looked_up(tmp_path, kind):
    colours = np.random.default_rng(1).integers(0, 256, (256, 3)).astype(np.uint8)
    picture = Image.fromarray(GREY, "P")
    picture.putpalette(colours.tobytes())
    picture.save(tmp_path / f"photo.{kind}")
    np.testing.assert_allclose(
        seen(tmp_path / f"photo.{kind}"), luminance(colours[GREY]), rtol=0, atol=1e-3
    )


def test_a_palette_with_a_transparent_colour(tmp_path):
    picture = Image.fromarray((GREY > 127).astype(np.uint8), "P")
    picture.putpalette([0, 0, 0, 90, 90, 90])
    picture.save(tmp_path / "photo.png", transparency=0)
    expected = np.where(GREY > 127, 90 / 255, 0.0)
    np.testing.assert_allclose(seen(tmp_path / "photo.png"), expected, rtol=0, atol=1e-3)


@pytest.mark.parametrize("kind", ["jpg", "tif", "lzw.tif"])
def test_inks_are_dark_where_there_is_much_of_them(tmp_path, kind):
    """Pillow writes a JPEG's inks inverted, as Adobe's programs do."""
    path = tmp_path / f"photo.{kind}"
    more: dict[str, object] = {"compression": "tiff_lzw"} if kind == "lzw.tif" else {}
    if kind == "jpg":
        more = {"quality": 100}
    inks = np.zeros((*SMOOTH.shape, 4), np.uint8)
    inks[..., 3] = 255 - SMOOTH  # black ink
    Image.fromarray(inks, "CMYK").save(path, **more)
    np.testing.assert_allclose(seen(path), SMOOTH / 255, rtol=0, atol=0.02)


def test_lab_is_converted(tmp_path):
    """L* = 53.585 is sRGB grey 128 (luminance 0.2159 of white, CIE 1976)."""
    lightness = np.full((8, 8), round(53.585 * 255 / 100), np.uint8)
    lightness[:, :4] = 255
    neutral = np.full_like(lightness, 128)
    lab = Image.merge("LAB", [Image.fromarray(one) for one in (lightness, neutral, neutral)])
    lab.save(tmp_path / "photo.tif")
    grey = seen(tmp_path / "photo.tif")
    # The white of L*a*b* is D50's; one step of 8-bit lightness is 0.4 %.
    np.testing.assert_allclose(grey[:, :4], 1.0, rtol=0, atol=0.01)
    np.testing.assert_allclose(grey[:, 4:], 128 / 255, rtol=0, atol=0.01)


def test_a_profile_of_srgb_or_a_damaged_one_changes_nothing(tmp_path):
    srgb = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB"))
    Image.fromarray(COLOUR).save(tmp_path / "plain.png")
    Image.fromarray(COLOUR).save(tmp_path / "tagged.png", icc_profile=srgb.tobytes())
    Image.fromarray(COLOUR).save(tmp_path / "damaged.png", icc_profile=b"no profile at all")
    plain = seen(tmp_path / "plain.png")
    np.testing.assert_array_equal(seen(tmp_path / "tagged.png"), plain)
    np.testing.assert_array_equal(seen(tmp_path / "damaged.png"), plain)


@pytest.mark.parametrize("compression", ["tiff_lzw", "tiff_adobe_deflate", "packbits", "group4"])
def test_compressed_tiff(tmp_path, compression):
    picture = Image.fromarray(GREY)
    if compression == "group4":
        picture = Image.fromarray(GREY > 127)
    picture.save(tmp_path / "photo.tif", compression=compression)
    np.testing.assert_array_equal(seen(tmp_path / "photo.tif"), np.asarray(picture, float))


def test_tiff_of_16_bits_keeps_them_and_white_may_be_zero(tmp_path):
    deep = np.arange(240, dtype=np.uint16).reshape(12, 20) * 37
    tifffile.imwrite(tmp_path / "deep.tif", deep)
    np.testing.assert_array_equal(seen(tmp_path / "deep.tif"), deep.astype(float))
    tifffile.imwrite(tmp_path / "white.tif", 65535 - deep, photometric="miniswhite")
    np.testing.assert_array_equal(seen(tmp_path / "white.tif"), deep.astype(float))
    planes = np.moveaxis(COLOUR, -1, 0).astype(np.uint16) * 257
    tifffile.imwrite(tmp_path / "planes.tif", planes, photometric="rgb", planarconfig="separate")
    np.testing.assert_allclose(seen(tmp_path / "planes.tif"), luminance(COLOUR), rtol=0, atol=1e-6)


@pytest.mark.parametrize("kind", ["gif", "png", "webp"])
def test_of_a_picture_that_moves_the_first_frame_is_taken(tmp_path, kind):
    first, second = (Image.fromarray(one).convert("RGB") for one in (GREY, 255 - GREY))
    path, more = tmp_path / f"photo.{kind}", {"lossless": True} if kind == "webp" else {}
    first.save(path, save_all=True, append_images=[second], **more)
    with Image.open(path) as opened:
        assert getattr(opened, "n_frames", 1) == 2
    # A GIF has a palette of 256 colours, which holds all greys.
    np.testing.assert_allclose(seen(path), GREY / 255, rtol=0, atol=1e-9)


NOT_READ = {
    "photo.heic": (b"\0\0\0\x18ftypheic\0\0\0\0mif1heic", "a HEIC"),
    "photo.svg": (b"\xef\xbb\xbf\n<svg xmlns='http://www.w3.org/2000/svg'/>", "an SVG"),
    "photo.psd": (b"8BPS\0\x01" + bytes(20), "Photoshop"),
    "photo.pdf": (b"%PDF-1.7\n", "a PDF"),
    "photo.png": (b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 9 9\n", "PostScript"),
    "photo.jxl": (b"\xff\x0a\0\0", "JPEG XL"),
    "photo.cr2": (b"II*\0\x10\0\0\0CR\x02\0" + bytes(40), "CR2"),
    "film.mp4": (b"\0\0\0\x20ftypisom" + bytes(20), "a video"),
    "photo.txt": (b"a photograph", "is not an image"),
}


@pytest.mark.parametrize("name", NOT_READ)
def test_what_is_not_read_is_refused_by_its_name(tmp_path, name):
    data, what = NOT_READ[name]
    (tmp_path / name).write_bytes(data)
    with pytest.raises(InputError, match=rf"{name} is .*{what}|{name} {what}") as caught:
        read_grey(tmp_path / name)
    assert "PNG" in str(caught.value)


@pytest.mark.parametrize(
    ("tag", "more", "what"),
    [("DNGVersion", {"extratags": [(50706, "B", 4, (1, 4, 0, 0), True)]}, "DNG"),
     ("CFA", {"photometric": "cfa", "extratags": [
         (33421, "H", 2, (2, 2), True), (33422, "B", 4, (0, 1, 1, 2), True)]}, "CFA")],
)  # fmt: skip
def test_raw_pictures_in_tiff_are_named(tmp_path, tag, more, what):
    tifffile.imwrite(tmp_path / "raw.tif", GREY, **more)
    with pytest.raises(InputError, match=what):
        read_grey(tmp_path / "raw.tif")


def test_a_normal_map_reads_its_channels(tmp_path):
    flat = np.full((4, 5, 3), (128, 128, 255), np.uint8)
    flat[:, 2] = (255, 128, 128)
    Image.fromarray(flat).convert("P", palette=Image.Palette.ADAPTIVE, colors=4).save(
        tmp_path / "normals.png"
    )
    right, down = read_normals(tmp_path / "normals.png")
    assert np.abs(right[:, :2]).max() < 0.01 and np.abs(down).max() < 0.1
    assert right[0, 2] < -10
