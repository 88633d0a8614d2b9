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
