"""From a photograph to levels, and pictures that are none."""

import numpy as np
import pytest
from PIL import Image
from skimage.io import imsave

from haptix import InputError, Texture

GREY = np.random.default_rng(5).integers(0, 256, (24, 32)).astype(np.uint8)
RGB = np.stack([GREY] * 3, axis=-1)

PIXELS = {
    "grey, 8 bits": GREY,
    "grey, 16 bits": GREY.astype(np.uint16) * 257,
    "RGB": RGB,
    "RGBA": np.dstack([RGB, np.full_like(GREY, 255)]),
}


def level_of(pixels):
    """Levels from their definition, on the grey values themselves."""
    dark, bright = np.percentile(pixels, [1, 99])
    return np.clip((pixels - dark) / (bright - dark), 0, 1)


@pytest.mark.parametrize("kind", PIXELS)
def test_every_kind_of_png_has_the_same_levels(tmp_path, kind):
    imsave(tmp_path / "photo.png", PIXELS[kind], check_contrast=False)
    texture = Texture.from_image(tmp_path / "photo.png", width_mm=10)
    # Levels do not depend on the scale of grey; 1e-12 covers the rounding of scale and weights.
    np.testing.assert_allclose(texture.level, level_of(GREY.astype(float)), rtol=0, atol=1e-12)
    np.testing.assert_array_equal(
        Texture.from_image(str(tmp_path / "photo.png"), 10).level, texture.level
    )


def test_grey_with_alpha(tmp_path):
    Image.fromarray(np.dstack([GREY, np.full_like(GREY, 255)]), "LA").save(tmp_path / "photo.png")
    level = Texture.from_image(tmp_path / "photo.png", width_mm=10).level
    np.testing.assert_allclose(level, level_of(GREY.astype(float)), rtol=0, atol=1e-12)


def test_jpeg_and_tiff(tmp_path):
    smooth = np.add.outer(np.arange(64), 2 * np.arange(64)).astype(np.uint8)
    for name in ("photo.jpg", "photo.tif"):
        imsave(tmp_path / name, smooth, check_contrast=False)
        level = Texture.from_image(tmp_path / name, width_mm=10).level
        # JPEG is lossy: on a smooth picture by some greys out of some 190.
        np.testing.assert_allclose(level, level_of(smooth.astype(float)), rtol=0, atol=0.05)


def test_colour_is_luminance():
    # Rec. 709 luminance of red, green and blue: 0.2126, 0.7152, 0.0722; black and white besides.
    colours = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 1)]
    picture = np.repeat(np.array(colours, dtype=float)[None, :, :], 40, axis=0)
    level = Texture.from_image(picture, width_mm=5).level
    # A fifth of the pixels each, so the percentiles are black and white; 0.001 for the different
    # last digits under which the weights are printed.
    np.testing.assert_allclose(level[0], [0, 0.2126, 0.7152, 0.0722, 1], rtol=0, atol=1e-3)


def test_the_percentiles_by_hand():
    # 0 to 9999 once each: the 1st percentile is 99.99, the 99th 9899.01, with linear interpolation.
    values = np.random.default_rng(1).permutation(10_000).reshape(100, 100)
    level = Texture.from_image(values, width_mm=10).level
    expected = np.clip((values - 99.99) / 9799.02, 0, 1)
    np.testing.assert_allclose(level, expected, rtol=0, atol=1e-12)


def test_single_pixels_do_not_decide():
    values = np.tile([10.0, 20.0], (50, 50))
    values[7, 8], values[9, 9] = 1e6, -1e6
    level = Texture.from_image(values, width_mm=10).level
    assert level[7, 8] == 1
    assert level[9, 9] == 0
    assert set(np.unique(level)) == {0.0, 1.0}


def test_polarity_mirrors_the_levels():
    bright = Texture.from_image(GREY, width_mm=10)
    dark = Texture.from_image(GREY, width_mm=10, polarity="dark-high")
    # One subtraction's rounding.
    np.testing.assert_allclose(bright.level + dark.level, 1.0, rtol=0, atol=1e-15)
    assert bright.level[GREY == 255].min() == 1 == dark.level[GREY == 0].min()


def test_a_mask_is_a_picture():
    level = Texture.from_image(GREY > 127, width_mm=10).level
    np.testing.assert_array_equal(level, GREY > 127)


def one_sentence(caught):
    message = str(caught.value)
    assert message
    assert "\n" not in message
    return message


def files(folder):
    """Paths of files that are no image, under names that promise one."""
    imsave(folder / "whole.png", GREY, check_contrast=False)
    whole = (folder / "whole.png").read_bytes()
    (folder / "text.png").write_text("t_s,x_mm\n0,1\n")
    (folder / "truncated.png").write_bytes(whole[: len(whole) // 2])
    (folder / "empty.png").write_bytes(b"")
    (folder / "folder.png").mkdir()
    return folder


@pytest.mark.parametrize("name", ["missing", "text", "truncated", "empty", "folder"])
def test_a_bad_file_is_named(tmp_path, name):
    path = files(tmp_path) / f"{name}.png"
    with pytest.raises(InputError) as caught:
        Texture.from_image(path, width_mm=10)
    assert str(path) in one_sentence(caught)


BAD_PIXELS = {
    "empty": np.empty((0, 0)),
    "no columns": np.empty((3, 0)),
    "1-D": np.arange(9.0),
    "4-D": np.zeros((2, 3, 4, 3)),
    "five channels": np.zeros((4, 4, 5)),
    "scalar": 3.0,
    "NaN": np.full((3, 3), np.nan),
    "one NaN": np.where(np.eye(3) > 0, np.nan, np.eye(3)),
    "infinite": np.where(np.eye(3) > 0, np.inf, 0.0),
    "NaN in colour": np.full((3, 3, 3), np.nan),
    "flat": np.full((8, 8), 7),
    "flat but for a pixel": np.pad([[9.0]], 20),
    "one pixel": np.ones((1, 1)),
}
UNFORESEEN = {
    "empty colour": np.zeros((0, 5, 3)),
    "colour without columns": np.zeros((5, 0, 3)),
    "words": [["bright", "dark"]],
    "ragged": [[1, 2], [3]],
}


def refused(pixels):
    with pytest.raises(InputError, match="image") as caught:
        Texture.from_image(pixels, width_mm=10)
    one_sentence(caught)


@pytest.mark.parametrize("name", BAD_PIXELS)
def test_bad_pixels(name):
    refused(BAD_PIXELS[name])


@pytest.mark.parametrize("name", UNFORESEEN)
def test_pixels_that_are_no_picture_at_all(name):
    refused(UNFORESEEN[name])


@pytest.mark.parametrize("width_mm", [0, -1, np.nan, np.inf])
def test_bad_widths(width_mm):
    with pytest.raises(InputError, match="width_mm") as caught:
        Texture.from_image(GREY, width_mm)
    one_sentence(caught)


@pytest.mark.parametrize("polarity", ["up", "", "Bright-High", None])
def test_unknown_polarity(polarity):
    with pytest.raises(InputError, match=r"polarity: .*dark-high"):
        Texture.from_image(GREY, 10, polarity=polarity)


@pytest.mark.parametrize(
    ("low", "high"), [(0.5, 0.2), (0.3, 0.3), (-0.1, 0.5), (np.nan, 1), (0, np.nan), (0.1, np.inf)]
)
def test_bad_ends(low, high):
    with pytest.raises(InputError, match=r"low|high") as caught:
        Texture.from_image(GREY, 10, target="mu", low=low, high=high)
    one_sentence(caught)


@pytest.mark.parametrize(
    "level", [np.full((2, 2), 1.5), np.full((2, 2), -0.1), np.full((2, 2), np.nan), np.ones(4)]
)
def test_bad_level_maps(level):
    with pytest.raises(InputError, match="level"):
        Texture(level, 10)
