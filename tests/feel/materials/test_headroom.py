"""How much of the wanted friction a surface gives, against counting by hand."""

import io

import numpy as np
import pytest
from PIL import Image

import haptix
from haptix import InputError, Status
from haptix.feel.materials import Grating, Texture, headroom

FORCE_N = 0.5


@pytest.fixture(scope="module")
def surface():
    model = haptix.ContactModel(
        haptix.Finger.preset("semi-wet"), haptix.Screen.preset("3m-sct3250")
    )
    ranges = {"normal_force_n": (0.4, 0.6), "frequency_hz": 4000}
    return haptix.FrictionSurface.build(model, ranges, tolerance=5e-3)


@pytest.fixture(scope="module")
def reach(surface):
    return tuple(float(end) for end in surface.reachable(FORCE_N))


def ramp(**options):
    """Level 0 to 1 from left to right, even steps over 100 columns of 1 mm."""
    return Texture(np.tile(np.linspace(0, 1, 100), (20, 1)), 100.0, **options)


def test_shares_are_within_reach(surface):
    found = headroom(ramp(), surface, FORCE_N, columns=100)
    assert (found.within, found.below, found.above) == (1, 0, 0)
    assert found.worst_jnd == 0


def test_parts_of_an_absolute_ramp(surface, reach):
    low, high = reach
    span = high - low
    # From half a span below the reach to a whole one above it: a fifth, two fifths, two fifths.
    field = ramp(target="mu", low=low - 0.5 * span, high=high + span, beyond="hold")
    found = headroom(field, surface, FORCE_N, columns=100)
    # A column more or less at each end of the reach.
    assert found.below == pytest.approx(0.2, abs=0.011)
    assert found.within == pytest.approx(0.4, abs=0.021)
    assert found.above == pytest.approx(0.4, abs=0.011)
    row = found.status[10]
    assert (np.diff(np.flatnonzero(row == Status.BELOW)) == 1).all()
    assert row[0] == Status.BELOW
    assert row[-1] in (Status.ABOVE, Status.PULL_IN, Status.BREAKDOWN)
    assert found.shortfall_mu.max() == pytest.approx(span)
    assert found.shortfall_mu.min() == pytest.approx(-0.5 * span)
    expected = max(span / (0.11 * high), 0.5 * span / (0.11 * low))
    assert found.worst_jnd == pytest.approx(expected)
    assert found.numbers()["most_target_mu"] > high


def test_contrast_starts_from_the_friction_without_voltage(surface, reach):
    grating = Grating(period_mm=8.0, wave="square", target="contrast", low=-0.2, high=0.01)
    found = headroom(grating, surface, FORCE_N, 64.0, 16.0, columns=64)
    assert found.below == 0.5
    assert found.within == 0.5
    assert found.target_mu.min() == pytest.approx(0.8 * reach[0])
    # A fast finger feels the mean of the wave only, everywhere below.
    assert headroom(grating, surface, FORCE_N, 64.0, 16.0, 64, footprint_mm=5.0).below == 1


def test_the_drawing_is_a_picture(surface, reach):
    field = ramp(target="mu", low=0.9 * reach[0], high=1.1 * reach[1])
    png = headroom(field, surface, FORCE_N).png()
    picture = np.asarray(Image.open(io.BytesIO(png)).convert("RGB"))
    assert picture.shape[0] > 300
    assert picture.std() > 10


def test_bad_questions(surface):
    with pytest.raises(InputError, match="width_mm"):
        headroom(Grating(period_mm=2.0), surface, FORCE_N)
    with pytest.raises(InputError, match="height_mm"):
        headroom(Grating(period_mm=2.0), surface, FORCE_N, 10.0, -1.0)
    with pytest.raises(InputError, match="normal_force_n"):
        headroom(ramp(), surface, 5.0)
    with pytest.raises(InputError, match="columns"):
        headroom(ramp(), surface, FORCE_N, columns=0)
