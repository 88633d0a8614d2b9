"""Any place has a friction: outside, absurdly far and no number at all."""

import numpy as np
import pytest

from haptix.base.errors import InputError
from haptix.feel.materials import (
    FrictionField,
    Grating,
    Noise,
    RecordedProfile,
    Texture,
    as_mu,
    power_law,
)

LEVEL = np.random.default_rng(0).random((12, 20))
FIELDS = {
    "texture": Texture(LEVEL, 10.0, target="mu", low=0.2, high=0.6),
    "texture that holds": Texture(
        LEVEL, 10.0, target="contrast", low=-0.1, high=0.2, beyond="hold"
    ),
    "one pixel": Texture(np.ones((1, 1)), 4.0),
    "sine": Grating(period_mm=2.0, wave="sine", orientation_deg=30.0, low=0.1),
    "square": Grating(period_mm=2.0, wave="square", low=0.1),
    "noise": Noise(spectrum=power_law(1, 0.5, 8), mean=0.3, tile_mm=16, pixels=64),
    "ribbed noise": Noise(
        spectrum=power_law(1, 0.5, 8), tile_mm=16, pixels=64, grain="ribbed", orientation_deg=50
    ),
    "recording": RecordedProfile(np.array([1.0, 2.0, 4.0]), np.array([0.5, 0.3, 0.6])),
}
NOWHERE = [np.nan, np.inf, -np.inf, 1e300, -1e300, 1e18, -1.7e308]


@pytest.mark.parametrize("footprint", [0.0, 0.01, 3.0, 1e6, np.inf])
@pytest.mark.parametrize("name", FIELDS)
def test_no_place_has_the_friction_of_the_outside(name, footprint):
    field = FIELDS[name]
    assert isinstance(field, FrictionField)
    for where in NOWHERE:
        for x, y in ((where, 3.0), (3.0, where), (where, where), (where, -where)):
            assert field.friction(x, y, footprint) == field.outside
    # And it does not spoil its neighbours in a block.
    along = np.array([2.0, *NOWHERE, 3.0])
    block = field.friction(along, np.full(len(along), 2.5), footprint)
    alone = field.friction(np.array([2.0, 3.0]), np.array([2.5, 2.5]), footprint)
    np.testing.assert_allclose(block[[0, -1]], alone, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(block[1:-1], field.outside)
    assert np.isfinite(field.friction(along, 2.5, np.linspace(0, 2, len(along)))).all()


@pytest.mark.parametrize("name", FIELDS)
def test_shapes(name):
    field = FIELDS[name]
    assert field.friction(1.0, 2.0).shape == ()
    assert field.friction(1.0, 2.0, 0.1).dtype == np.float64
    assert field.friction(np.zeros((4, 1)), np.zeros(5), 0.1).shape == (4, 5)
    assert field.friction([1, 2], [3, 4], np.full((3, 1), 0.1)).shape == (3, 2)
    assert field.friction([], []).shape == (0,)
    assert field.friction(np.zeros((0, 3)), 1.0, 0.1).shape == (0, 3)
    np.testing.assert_array_equal(
        field.friction(np.arange(8)[::-2], np.arange(4.0)),
        field.friction([7.0, 5.0, 3.0, 1.0], [0.0, 1.0, 2.0, 3.0]),
    )
    with pytest.raises(InputError, match="broadcast"):
        field.friction(np.zeros(3), np.zeros(4))


@pytest.mark.parametrize("name", FIELDS)
def test_the_places_given_are_left_alone(name):
    x, y = np.linspace(-1, 9, 50), np.linspace(0, 8, 50)
    kept_x, kept_y = x.copy(), y.copy()
    first = FIELDS[name].friction(x, y, 0.3)
    first += 7.0  # the answer is the caller's own
    np.testing.assert_array_equal(x, kept_x)
    np.testing.assert_array_equal(y, kept_y)
    np.testing.assert_allclose(FIELDS[name].friction(x, y, 0.3), first - 7, rtol=0, atol=1e-14)


def test_what_values_mean():
    assert as_mu("mu", 0.4, 0.2, 0.3) == 0.4
    assert as_mu("contrast", -0.1, 0.2, 0.3) == pytest.approx(0.18)
    assert as_mu("share", np.array([0.0, 0.25, 1.0]), 0.2, 0.6) == pytest.approx([0.2, 0.3, 0.6])


WRONG = {
    "width_mm": lambda: Texture(LEVEL, "60 mm"),
    "level": lambda: Texture("bricks", 60.0),
    "low and high": lambda: Texture(LEVEL, 60.0, target="mu", high=0.3),
    "high: expected a finite": lambda: Texture(LEVEL, 60.0, high=np.nan),
    "low: expected a finite": lambda: Texture(LEVEL, 60.0, target="mu", low="low", high=1),
    "largest_bytes": lambda: Texture.from_image(LEVEL, 60.0, largest_bytes="1 GB"),
    "direction_deg": lambda: Texture.from_heights(LEVEL, 60.0, "slope-along", "left"),
    "period_mm": lambda: Grating(period_mm="2 mm"),
    "duty": lambda: Grating(period_mm=2.0, duty=True),
    "low": lambda: Grating(period_mm=2.0, low=None),
    "wave": lambda: Grating(period_mm=2.0, wave=["sine"]),
    "spectrum": lambda: Noise(spectrum="pink"),
    "exponent": lambda: power_law("pink", 1, 2),
    "pixels": lambda: Noise(spectrum=power_law(1, 1, 8), pixels=128.5),
    "seed": lambda: Noise(spectrum=power_law(1, 1, 8), seed=0.5),
    "position_mm": lambda: RecordedProfile(["left", "right"], [1, 2]),
    "x_mm, y_mm": lambda: Grating(period_mm=2.0).friction("here", 1.0),
    "footprint_mm": lambda: Grating(period_mm=2.0).friction(1.0, 1.0, "fast"),
}


@pytest.mark.parametrize("name", WRONG)
def test_things_of_another_kind(name):
    with pytest.raises(InputError, match=name) as caught:
        WRONG[name]()
    assert "\n" not in str(caught.value)
