"""Gratings against their closed forms."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import signal

from haptix import InputError
from haptix.feel.materials import Grating

ALONG = np.linspace(-7.3, 9.1, 3001)


@settings(deadline=None, max_examples=50)
@given(st.floats(0.3, 20), st.floats(0, 360), st.floats(-2, 2), st.floats(0.05, 0.95))
def test_waves_at_points(period, angle, phase, duty):
    rng = np.random.default_rng(0)
    x, y = rng.uniform(-50, 50, (2, 400))
    turn = np.radians(angle)
    place = (x * np.cos(turn) + y * np.sin(turn)) / period + phase
    fraction = place % 1
    # Away from the steps by more than the rounding of places as large as these.
    clear = np.min(np.abs(fraction[:, None] - [0, duty, 1]), axis=1) > 1e-9
    expected = {
        "sine": 0.5 + 0.5 * np.sin(2 * np.pi * place),
        "square": 0.5 + 0.5 * signal.square(2 * np.pi * fraction, duty),
        "sawtooth": 0.5 + 0.5 * signal.sawtooth(2 * np.pi * fraction),
    }
    for wave, share in expected.items():
        grating = Grating(
            period_mm=period,
            wave=wave,
            orientation_deg=angle,
            duty=duty,
            target="contrast",
            low=-0.2,
            high=0.6,
            phase=phase,
        )
        found = grating.friction(x, y)
        np.testing.assert_allclose(found[clear], (-0.2 + 0.8 * share)[clear], rtol=0, atol=1e-9)


@pytest.mark.parametrize("wave", ["square", "sawtooth"])
def test_a_small_footprint_leaves_the_wave(wave):
    grating = Grating(period_mm=2.0, wave=wave, duty=0.4)
    exact, limited = grating.friction(ALONG, 0.0), grating.friction(ALONG, 0.0, 1e-4)
    fraction = ALONG / 2 % 1
    distance = np.min(np.abs(fraction[:, None] - [0, 0.4, 1]), axis=1)
    # 1024 harmonics: Lanczos' series is within 1 % some two of the last wavelengths from a step.
    assert np.abs(exact - limited)[distance > 0.003].max() < 0.01


@pytest.mark.parametrize("wave", ["sine", "square", "sawtooth"])
def test_a_wave_shorter_than_two_footprints_is_flat_at_its_mean(wave):
    grating = Grating(period_mm=2.0, wave=wave, duty=0.3, low=0.2, high=0.7)
    mean = 0.2 + 0.5 * (0.3 if wave == "square" else 0.5)
    np.testing.assert_allclose(grating.friction(ALONG, 1.0, 1.0), mean, rtol=0, atol=1e-12)
    np.testing.assert_allclose(grating.friction(ALONG, 1.0, 50.0), mean, rtol=0, atol=1e-12)


@pytest.mark.parametrize("wave", ["sine", "square", "sawtooth"])
def test_places_and_footprints_are_read_between_the_tables(wave):
    grating = Grating(period_mm=1.7, wave=wave, orientation_deg=25.0, duty=0.3, phase=0.2, low=0.1)
    random = np.random.default_rng(4)
    (x, y), turn = random.uniform(-30, 30, (2, 500)), np.radians(25.0)
    footprints = 10 ** random.uniform(-4, 1, 500) * (random.random(500) > 0.1)
    place = ((x * np.cos(turn) + y * np.sin(turn)) / 1.7 + 0.2) % 1
    levels = np.array([
        np.interp(place * len(table), np.arange(len(table) + 1), [*table, table[0]])
        for table in grating.tables
    ])  # fmt: skip
    last = len(levels) - 1
    depth = np.log2(1.7 / (2 * np.maximum(footprints, 1e-9))).clip(0, last)
    low, at = np.minimum(depth.astype(int), max(last - 1, 0)), np.arange(500)
    high = levels[np.minimum(low + 1, last), at]
    wanted = levels[low, at] + (depth - low) * (high - levels[low, at])
    wanted[footprints == 0] = grating.friction(x, y)[footprints == 0]
    np.testing.assert_allclose(grating.friction(x, y, footprints), wanted, rtol=0, atol=1e-11)
    for i in range(0, 500, 50):
        one = grating.friction(x, y, float(footprints[i]))
        assert one[i] == pytest.approx(wanted[i], abs=1e-11)


def test_a_place_that_is_none_is_outside():
    grating = Grating(period_mm=2.0, low=0.3)
    for footprint_mm in (0.0, 0.1):
        found = grating.friction([np.nan, 1e7, 0.5], [0.0, 0.0, -np.inf], footprint_mm)
        assert found.tolist() == [0.3] * 3


def test_series_do_not_ring():
    grating = Grating(period_mm=2.0, wave="square")
    for footprint in (0.01, 0.03, 0.1, 0.2, 0.4):
        value = grating.friction(ALONG, 0.0, footprint)
        # Lanczos' factors leave 2 % of a step; cutting the series off would leave 9 %.
        assert value.min() > -0.03
        assert value.max() < 1.03


def test_orientation_and_asymmetry():
    right, down = (
        Grating(period_mm=4.0, wave="sawtooth"),
        Grating(period_mm=4.0, wave="sawtooth", orientation_deg=90.0),
    )
    assert right.friction(1.0, 3.3) == pytest.approx(0.25)
    assert right.friction(3.0, 0.3) == pytest.approx(0.75)
    assert down.friction(3.3, 1.0) == pytest.approx(0.25)
    assert Grating(period_mm=4.0, wave="sawtooth", orientation_deg=180.0).friction(
        1.0, 3.3
    ) == pytest.approx(0.75)


@pytest.mark.parametrize(
    ("options", "name"),
    [
        ({"period_mm": 0.0}, "period_mm"),
        ({"period_mm": np.nan}, "period_mm"),
        ({"wave": "triangle"}, "wave"),
        ({"orientation_deg": np.inf}, "orientation_deg"),
        ({"phase": np.nan}, "phase"),
        ({"duty": 0.0}, "duty"),
        ({"duty": 1.0}, "duty"),
        ({"target": "friction"}, "target"),
        ({"low": 0.6, "high": 0.6}, "low, high"),
        ({"high": 1.2}, "low, high"),
        ({"target": "mu", "low": -0.1, "high": 0.3}, "low, high"),
        ({"target": "contrast", "low": -1.1, "high": 0.3}, "low, high"),
        ({"target": "mu", "high": np.inf}, "high"),
    ],
)
def test_bad_gratings(options, name):
    with pytest.raises(InputError, match=name) as caught:
        Grating(**{"period_mm": 2.0, **options})
    assert "\n" not in str(caught.value)
