"""Still regions of a layout against closed forms: places, order, masks, blends."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from haptix import InputError, Layout
from haptix.feel.materials import Grating, RecordedProfile, Texture
from haptix.feel.motion import Motion

LEVEL = np.random.default_rng(0).random((10, 16))
PICTURE = Texture(LEVEL, 8.0)
X, Y = np.random.default_rng(1).uniform(-2, 22, (2, 500))


def flat(value):
    """A field of one share everywhere: a single pixel that holds."""
    return Texture(np.array([[value]]), 1.0, beyond="hold")


def plate(value, **options):
    """A region of one share, as `Layout.add` takes it."""
    return flat(value), {"x_mm": 2.0, "y_mm": 3.0, "width_mm": 10.0, "height_mm": 6.0, **options}


def region(material, x_mm=0.0, y_mm=0.0, width_mm=None, height_mm=None, **options):
    size = {"x_mm": x_mm, "y_mm": y_mm, "width_mm": width_mm, "height_mm": height_mm}
    return material, {**size, **options}


def laid(regions, background=0.0, target="share"):
    layout = Layout(background, target)
    for material, options in regions:
        layout.add(material, **options)
    return layout


def friction(layout, x, y, footprint_mm=0.0):
    return layout.wanted(Motion.of(x, y, footprint_mm=footprint_mm))


def inside_plate():
    return (X >= 2) & (X <= 12) & (Y >= 3) & (Y <= 9)


shares = st.floats(0, 1)


def test_a_background_alone():
    assert friction(laid([], 0.4), X, Y) == pytest.approx(0.4)
    grating = Grating(period_mm=3.0, wave="square", orientation_deg=20.0)
    for footprint in (0.0, 0.2):
        np.testing.assert_array_equal(
            friction(laid([], grating), X, Y, footprint), grating.friction(X, Y, footprint)
        )


def test_a_picture_at_its_place():
    whole = laid([region(PICTURE, 5.0, 7.0)], background=0.0)
    np.testing.assert_allclose(
        friction(whole, X, Y), PICTURE.friction(X - 5, Y - 7), rtol=0, atol=1e-12
    )


@settings(deadline=None)
@given(shares, shares, shares)
def test_blends_at_points(below, value, opacity):
    expected = {
        "over": value,
        "add": below + value,
        "multiply": below * value,
        "max": max(below, value),
        "min": min(below, value),
    }
    for blend, full in expected.items():
        region = plate(value, blend=blend, opacity=opacity)
        found = friction(laid([region], below), X, Y)
        mixed = below + opacity * (full - below)
        np.testing.assert_allclose(found, np.where(inside_plate(), mixed, below), atol=1e-12)


@settings(deadline=None)
@given(st.lists(st.tuples(shares, st.integers(-2, 2), st.floats(0, 8)), min_size=1, max_size=6))
def test_the_uppermost_is_felt(plates):
    regions = [plate(value, z=z, x_mm=x) for value, z, x in plates]
    found = friction(laid(regions, 0.0), X, Y)
    # The order of z, and of two at one height the later: by a stable sort, from below.
    expected = np.zeros(X.shape)
    for value, _, x in sorted(plates, key=lambda one: one[1]):
        expected[(x <= X) & (x + 10 >= X) & (Y >= 3) & (Y <= 9)] = value
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)


@settings(deadline=None, max_examples=40)
@given(st.permutations(range(4)), st.floats(0, 3))
def test_order_in_the_list_is_no_matter_where_z_differs(order, footprint):
    regions = [
        region(PICTURE, 1.0 + i, 2.0 * i, z=i, blend=blend, opacity=0.7)
        for i, blend in enumerate(("over", "add", "multiply", "max"))
    ]
    ground = Grating(period_mm=4.0)
    np.testing.assert_array_equal(
        friction(laid([regions[i] for i in order], ground), X, Y, footprint),
        friction(laid(regions, ground), X, Y, footprint),
    )


@settings(deadline=None, max_examples=40)
@given(
    st.floats(0, 5),
    st.sampled_from(["over", "add", "multiply", "max", "min"]),
    st.sampled_from(["rectangle", "ellipse"]),
)
def test_a_clear_region_changes_nothing(footprint, blend, shape):
    ground = Grating(period_mm=4.0, low=0.2)
    clear = region(PICTURE, 3.0, 3.0, blend=blend, opacity=0.0, shape=shape)
    twice = 2 * footprint if blend == "multiply" else footprint
    np.testing.assert_allclose(
        friction(laid([clear], ground), X, Y, footprint),
        ground.friction(X, Y, twice),
        rtol=0,
        atol=1e-14,
    )


@settings(deadline=None, max_examples=40)
@given(st.floats(0, 5), st.lists(st.tuples(shares, st.integers(0, 9)), max_size=4))
def test_over_stays_between_the_extremes(footprint, plates):
    regions = [plate(value, x_mm=float(x), shape="ellipse") for value, x in plates]
    found = friction(laid(regions, 0.5), X, Y, footprint)
    values = [0.5, *(value for value, _ in plates)]
    assert found.min() >= min(values) - 1e-12
    assert found.max() <= max(values) + 1e-12


def test_shapes_and_masks():
    oval = plate(1.0, shape="ellipse")
    found = friction(laid([oval], 0.0), X, Y)
    round_ = ((X - 7) / 5) ** 2 + ((Y - 6) / 3) ** 2
    np.testing.assert_array_equal(found[round_ < 0.999], 1.0)
    np.testing.assert_array_equal(found[round_ > 1.001], 0.0)

    half = RecordedProfile(np.array([0.0, 10.0]), np.array([0.0, 1.0]), "share")
    faded = friction(laid([plate(0.8, mask=half)], 0.2), [2.0, 4.5, 7.0, 11.5, 13.0], 5.0)
    np.testing.assert_allclose(faded, [0.2, 0.35, 0.5, 0.77, 0.2], atol=1e-9)


def test_edges_are_ramps_of_four_footprints():
    layout = laid([plate(1.0)], 0.0)
    x = np.array([0.9, 1.5, 2.0, 2.5, 3.1])
    np.testing.assert_allclose(friction(layout, x, 6.0, 0.5), [0, 0.25, 0.5, 0.75, 1], atol=1e-12)
    # A region narrower than its ramps keeps its area: 0.1 mm of 1 under ramps of 2 mm.
    thin = laid([plate(1.0, width_mm=0.1)], 0.0)
    along = np.linspace(0, 5, 5001)
    assert np.trapezoid(friction(thin, along, 6.0, 0.5), along) == pytest.approx(0.1, rel=1e-3)


def test_neighbours_meet_without_a_gap():
    both = laid([plate(0.7), plate(0.7, x_mm=12.0)], 0.7)
    np.testing.assert_allclose(friction(both, X, Y, 0.3), 0.7, atol=1e-12)


def test_layouts_nest():
    inner = laid([plate(0.9)], 0.1)
    outer = laid([region(inner, 4.0, 1.0, 14.0, 12.0)], 0.3)
    expected = np.where(
        (X >= 4) & (X <= 18) & (Y >= 1) & (Y <= 13), friction(inner, X - 4, Y - 1), 0.3
    )
    np.testing.assert_allclose(friction(outer, X, Y), expected, atol=1e-12)


def test_targets():
    absolute = Texture(LEVEL, 8.0, target="mu", low=0.2, high=0.5)
    assert laid([region(absolute)], 0.3, "mu").target == "mu"
    veil = laid([region(absolute), plate(0.5, blend="multiply")], 0.4, "mu")
    assert friction(veil, 11.0, 8.0) == pytest.approx(0.2)


BAD_REGIONS = {
    "x_mm": {"x_mm": np.nan},
    "z": {"z": np.inf},
    "width_mm": {"width_mm": 0.0},
    "height_mm": {"height_mm": -1.0},
    "blend": {"blend": "screen"},
    "shape": {"shape": "star"},
    "opacity": {"opacity": 1.5},
    "mask": {"mask": Grating(period_mm=2.0, target="mu", low=0.1, high=0.2)},
}


@pytest.mark.parametrize("name", BAD_REGIONS)
def test_bad_regions(name):
    with pytest.raises(InputError, match=name):
        laid([plate(0.5, **BAD_REGIONS[name])])


def test_what_does_not_fit_together():
    absolute = Texture(LEVEL, 8.0, target="mu", low=0.2, high=0.5)
    with pytest.raises(InputError, match="width_mm"):
        laid([region(Grating(period_mm=2.0))])
    with pytest.raises(InputError, match="multiplies"):
        laid([region(absolute, blend="multiply")])
    with pytest.raises(InputError, match="material"):
        laid([region(LEVEL)])
    with pytest.raises(InputError, match="background"):
        laid([], np.nan)
    with pytest.raises(InputError, match="target"):
        laid([], 0.0, target="volts")
    with pytest.raises(InputError, match="mask"):
        laid([plate(0.5, mask=LEVEL)])


@settings(deadline=None, max_examples=60)
@given(
    st.floats(0.01, 4),
    st.sampled_from(["rectangle", "ellipse"]),
    st.sampled_from([0.0, 45.0]),
    st.integers(0, 99),
)
def test_a_place_is_felt_the_same_whatever_else_the_block_holds(footprint, shape, turn, seed):
    """A block that is far from a region leaves it out; its ramps must have ended there."""
    slender = {"width_mm": 12.0, "height_mm": 1.0, "shape": shape, "rotation_deg": turn}
    layout = laid([plate(1.0, **slender)], 0.0)
    x, y = np.random.default_rng(seed).uniform(-15, 30, (2, 40))
    alone = [friction(layout, *place, footprint) for place in zip(x, y, strict=True)]
    np.testing.assert_allclose(
        friction(layout, x, y, footprint), np.array(alone).ravel(), atol=1e-12
    )
