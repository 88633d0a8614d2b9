"""Friction over the screen: places, sizes and levels."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays
from scipy.ndimage import map_coordinates

from haptix import InputError, Texture

# Weights of pixels carry some rounding errors of 1e-16 times the number of columns.
ROUNDING = 1e-13

maps = arrays(
    np.float64, array_shapes(min_dims=2, max_dims=2, max_side=7), elements=st.floats(0, 1)
)
widths = st.floats(0.1, 300)


def centres(texture):
    rows, columns = texture.level.shape
    x = (np.arange(columns) + 0.5) * texture.width_mm / columns
    y = (np.arange(rows) + 0.5) * texture.width_mm / columns
    return np.meshgrid(x, y)


@settings(deadline=None)
@given(maps, widths)
def test_a_pixel_centre_has_the_pixels_level(level, width_mm):
    texture = Texture(level, width_mm)
    np.testing.assert_allclose(texture.friction(*centres(texture)), level, rtol=0, atol=ROUNDING)


def test_midway_between_centres_by_hand():
    # Pixels of 2 mm: centres at 1 and 3 mm.
    texture = Texture(np.array([[0.0, 0.4], [0.2, 1.0]]), width_mm=4.0)
    x = [2.0, 2.0, 1.0, 3.0, 2.0, 1.5]
    y = [1.0, 3.0, 2.0, 2.0, 2.0, 1.0]
    expected = [0.2, 0.6, 0.1, 0.7, 0.4, 0.1]
    np.testing.assert_allclose(texture.friction(x, y), expected, rtol=0, atol=ROUNDING)


@settings(deadline=None)
@given(maps, widths, st.integers(0, 2**32 - 1))
def test_agrees_with_scipy_inside(level, width_mm, seed):
    texture = Texture(level, width_mm)
    rows, columns = level.shape
    pixel_mm = width_mm / columns
    # Away from the edges by more than rounding; the half pixel along them is held level.
    share = np.random.default_rng(seed).uniform(1e-9, 1 - 1e-9, (2, 50))
    x, y = share[0] * width_mm, share[1] * rows * pixel_mm
    expected = map_coordinates(
        level, [y / pixel_mm - 0.5, x / pixel_mm - 0.5], order=1, mode="nearest"
    )
    np.testing.assert_allclose(texture.friction(x, y), expected, rtol=0, atol=ROUNDING)


@settings(deadline=None)
@given(maps, widths, st.floats(-1e3, 1e3), st.floats(-1e3, 1e3))
def test_beyond_the_edges_there_is_no_effect(level, width_mm, x, y):
    texture = Texture(level, width_mm)
    height_mm = width_mm / level.shape[1] * level.shape[0]
    margin = 1e-9 * max(width_mm, height_mm)  # more than rounding can move an edge
    outside = not (-margin <= x <= width_mm + margin and -margin <= y <= height_mm + margin)
    if outside:
        assert texture.friction(x, y) == 0


@pytest.mark.parametrize(
    ("x", "y"), [(-1e-6, 1), (4 + 1e-6, 1), (1, -1e-6), (1, 2 + 1e-6), (np.inf, 1), (1, -np.inf)]
)
def test_just_beyond_each_edge(x, y):
    texture = Texture(np.ones((2, 4)), width_mm=4.0)
    assert texture.friction(x, y) == 0
    assert texture.friction(np.clip(x, 1e-9, 4 - 1e-9), np.clip(y, 1e-9, 2 - 1e-9)) == 1


@settings(deadline=None)
@given(widths, st.integers(1, 9), st.integers(1, 9))
def test_the_edges_themselves_belong_to_the_picture(width_mm, rows, columns):
    texture = Texture(np.ones((rows, columns)), width_mm)
    x, y = np.array([0, 0, 1, 1]) * texture.width_mm, np.array([0, 1, 0, 1]) * texture.height_mm
    np.testing.assert_allclose(texture.friction(x, y), 1.0, rtol=0, atol=ROUNDING)


@settings(deadline=None)
@given(maps, widths, st.floats(0, 1), st.floats(0.01, 3))
def test_mu_of_the_ends_scales_the_levels(level, width_mm, low, span):
    places = centres(Texture(level, width_mm))
    absolute = Texture(level, width_mm, target="mu", low=low, high=low + span).friction(*places)
    np.testing.assert_allclose(absolute, low + span * level, rtol=0, atol=4 * ROUNDING)


def test_a_step_lies_at_its_millimetre():
    # 40 columns on 20 mm: pixels of 0.5 mm, and the step after the tenth is at 5 mm.
    picture = np.zeros((8, 40))
    picture[:, 10:] = 1
    texture = Texture.from_image(picture, width_mm=20.0)
    assert texture.pixel_mm == 0.5
    assert texture.height_mm == 4.0
    x = np.array([0.1, 4.75, 5.0, 5.25, 19.9])
    expected = [0, 0, 0.5, 1, 1]
    np.testing.assert_allclose(texture.friction(x, 2.0), expected, rtol=0, atol=ROUNDING)


def test_y_points_down():
    picture = np.zeros((10, 10))
    picture[5:] = 1  # the lower half of the photograph
    texture = Texture.from_image(picture, width_mm=10.0)
    assert texture.friction(5.0, 1.0) == 0
    assert texture.friction(5.0, 9.0) == 1


def test_places_broadcast():
    texture = Texture(np.eye(3), width_mm=3.0)
    assert texture.friction(0.5, 0.5).shape == ()
    assert texture.friction(np.zeros((4, 1)), np.zeros(5)).shape == (4, 5)


@pytest.mark.parametrize("polarity", ["bright-high", "dark-high"])
@pytest.mark.parametrize("footprint", [0.0, 0.1, 0.3, 0.5, 1.1, 2.3, 4.0])
def test_an_asymmetric_picture_stays_where_it_is(polarity, footprint):
    # A block of 14 x 10 pixels of half a millimetre, left and above the middle.
    picture = np.zeros((64, 96))
    picture[10:20, 20:34] = 1
    picture = picture if polarity == "bright-high" else 1 - picture
    texture = Texture.from_image(picture, width_mm=48.0, polarity=polarity)
    step = 0.0625
    x = (np.arange(-200, 968) + 0.5) * step
    y = (np.arange(-200, 712) + 0.5) * step
    value = texture.friction(x[None, :], y[:, None], footprint)
    # Smoothing with symmetric kernels moves neither the sum nor the centre; the kernel at a pixel
    # of 2 mm reaches 16 mm, past the picture's edge but not past these places. Bilinear sums are
    # exact on a grid that divides the pixels.
    assert value.sum() * step**2 == pytest.approx(140 * 0.25, rel=1e-9)
    assert (value * x[None, :]).sum() / value.sum() == pytest.approx(13.5, abs=1e-6)
    assert (value * y[:, None]).sum() / value.sum() == pytest.approx(7.5, abs=1e-6)


@pytest.mark.parametrize(
    "options",
    [
        {"target": "mu", "low": 0.1},
        {"target": "contrast", "low": -1.1, "high": 0.0},
        {"high": 1.1},
        {"low": 0.5, "high": 0.5},
        {"beyond": "repeat"},
    ],
)
def test_bad_ranges_of_other_targets(options):
    with pytest.raises(InputError):
        Texture(np.eye(3), 3.0, **options)
