"""Height maps: friction from height or slope, by a rule with a name."""

import numpy as np
import pytest
from skimage.io import imsave

from haptix import InputError, Texture

# A ridge along y, steeper on its left: heights 0 at 0 and 30, 1 at 10.
X = np.arange(31.0)
RIDGE = np.tile(np.interp(X, [0, 10, 30], [0, 1, 0]), (20, 1))


def test_height():
    texture = Texture.from_heights(RIDGE, 31.0, "height", target="mu", low=0.2, high=0.4)
    low, high = np.percentile(RIDGE, [1, 99])
    expected = 0.2 + 0.2 * np.clip((RIDGE[5] - low) / (high - low), 0, 1)
    np.testing.assert_allclose(texture.friction(X + 0.5, 5.5), expected, atol=1e-12)


def test_slope_magnitude_does_not_know_up_from_down():
    level = Texture.from_heights(RIDGE, 31.0, "slope-magnitude").level
    assert level[5, 5] == pytest.approx(1)
    assert level[5, 20] == pytest.approx(0.5)  # half as steep
    turned = Texture.from_heights(-RIDGE.T, 20.0, "slope-magnitude").level
    np.testing.assert_allclose(turned, level.T, atol=1e-12)


@pytest.mark.parametrize(("direction", "uphill", "downhill"), [(0, 1, 0.25), (180, 0, 0.75)])
def test_slope_along_the_stroke(direction, uphill, downhill):
    level = Texture.from_heights(RIDGE, 31.0, "slope-along", direction_deg=direction).level
    assert level[5, 5] == pytest.approx(uphill)
    assert level[5, 20] == pytest.approx(downhill)
    down = Texture.from_heights(RIDGE.T, 20.0, "slope-along", direction_deg=direction + 90).level
    np.testing.assert_allclose(down, level.T, atol=1e-12)


def test_across_the_slope_it_is_flat():
    level = Texture.from_heights(
        RIDGE + 0.01 * np.arange(20)[:, None], 31.0, "slope-along", direction_deg=90
    ).level
    np.testing.assert_allclose(level, 1, atol=1e-9)  # the same slope everywhere, downwards


def test_scale_of_the_heights_does_not_matter(tmp_path):
    sixteen = np.round(RIDGE * 60000).astype(np.uint16)
    imsave(tmp_path / "ridge.tif", sixteen, check_contrast=False)
    for rule in ("height", "slope-magnitude", "slope-along"):
        read = Texture.from_heights(tmp_path / "ridge.tif", 31.0, rule).level
        same = Texture.from_heights(3e-6 * RIDGE - 7, 31.0, rule).level
        # Rounding to 1/60000 of the range; steps of height are a twentieth of it and more.
        np.testing.assert_allclose(read, same, rtol=0, atol=1e-3)


@pytest.mark.parametrize(
    ("heights", "rule", "options", "complaint"),
    [
        (RIDGE, "steepness", {}, "rule"),
        (np.ones((5, 5)), "height", {}, "contrast"),
        (np.ones((5, 5)), "slope-magnitude", {}, "plane"),
        (RIDGE[:1], "slope-along", {}, "2 x 2"),
        (RIDGE, "slope-along", {"direction_deg": np.nan}, "direction_deg"),
        (RIDGE, "height", {"target": "mu", "low": 0.1}, "low and high"),
        (RIDGE, "height", {"target": "contrast", "low": -2, "high": 0}, "contrast"),
        (RIDGE, "height", {"low": 0, "high": 2}, "share"),
    ],
)
def test_bad_height_maps(heights, rule, options, complaint):
    with pytest.raises(InputError, match=complaint):
        Texture.from_heights(heights, 10.0, rule, **options)
