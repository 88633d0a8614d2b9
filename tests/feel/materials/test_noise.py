"""Noise has the spectrum that it was asked for, and has it every time."""

from itertools import pairwise

import numpy as np
import pytest

from haptix import InputError
from haptix.feel.materials import Noise, power_law


def tile_of(noise):
    """Values at the tile's pixels."""
    places = (np.arange(noise.pixels) + 0.5) * noise.tile_mm / noise.pixels
    return noise.friction(places[None, :], places[:, None])


def test_radial_spectrum_by_rings():
    exponent = 2.6
    noise = Noise(spectrum=power_law(exponent, 0.4, 16.0), tile_mm=64, pixels=512, seed=1)
    tile = tile_of(noise) - noise.mean
    power = np.abs(np.fft.fft2(tile)) ** 2
    k = np.hypot(*np.meshgrid(*[np.fft.fftfreq(512, 64 / 512)] * 2))
    edges = np.geomspace(0.07, 2.4, 10)
    rings = [power[(k >= a) & (k < b)].mean() for a, b in pairwise(edges)]
    centres = np.sqrt(edges[1:] * edges[:-1])
    slope = np.polyfit(np.log(centres), np.log(rings), 1)[0]
    # The lowest ring has some 80 independent waves, 11 % of scatter: 0.03 in the slope over 3.5
    # octaves of weights.
    assert slope == pytest.approx(-exponent, abs=0.1)
    assert power[(k > 2.6) | (k < 0.06)].sum() < 1e-20 * power.sum()


def test_mean_and_deviation_are_those_of_the_tile():
    noise = Noise(
        spectrum=power_law(1, 0.5, 10),
        mean=0.3,
        deviation=0.07,
        target="mu",
        tile_mm=32,
        pixels=128,
    )
    tile = tile_of(noise)
    assert tile.mean() == pytest.approx(0.3, abs=1e-12)
    assert tile.std() == pytest.approx(0.07, abs=1e-12)
    assert noise.target == "mu"


def test_a_seed_is_a_texture():
    x, y = np.random.default_rng(0).uniform(0, 100, (2, 300))
    kind = power_law(2, 0.5, 10)
    one, same = (Noise(spectrum=kind, seed=5, pixels=256).friction(x, y) for _ in range(2))
    other = Noise(spectrum=kind, seed=6, pixels=256).friction(x, y)
    np.testing.assert_array_equal(one, same)
    assert abs(np.corrcoef(one, other)[0, 1]) < 0.5


@pytest.mark.parametrize("footprint", [0.0, 0.05, 0.7, 5.0])
def test_the_tile_repeats_without_a_seam(footprint):
    noise = Noise(spectrum=power_law(2, 0.5, 10), tile_mm=32, pixels=256)
    x, y = np.random.default_rng(0).uniform(0, 32, (2, 500))
    here = noise.friction(x, y, footprint)
    for dx, dy in ((32, 0), (0, -32), (-320, 64)):
        there = noise.friction(x + dx, y + dy, footprint)
        # Rounding of places some hundred millimetres off, times the steepest slope.
        np.testing.assert_allclose(there, here, rtol=0, atol=1e-12)
    across = np.linspace(-0.2, 0.2, 4001)
    steps = np.abs(np.diff(noise.friction(across, 3.0, footprint)))
    assert steps.max() < 1e-3  # 0.1 um at slopes of some 1 per mm


def test_ribs_lie_across_their_direction():
    noise = Noise(
        spectrum=power_law(0, 0.5, 4), tile_mm=32, pixels=512, grain="ribbed", orientation_deg=30
    )
    turn = np.radians(30)
    t = np.linspace(0, 20, 500)
    along = noise.friction(t * np.cos(turn), t * np.sin(turn))
    across = noise.friction(5 - t * np.sin(turn), 4 + t * np.cos(turn))
    assert along.std() > 0.1
    assert np.ptp(across) < 1e-12


def test_any_spectrum_will_do():
    bump = Noise(
        spectrum=lambda k: np.exp(-(((k - 1.0) / 0.05) ** 2)),
        tile_mm=64,
        pixels=1024,
        grain="ribbed",
    )
    value = bump.friction((np.arange(1024) + 0.5) / 16, 0.0)
    power = np.abs(np.fft.rfft(value - value.mean())) ** 2
    k = np.fft.rfftfreq(1024, 1 / 16)
    # exp(-2^2) at two widths: 4.7e-3 of the density are outside, in a random sum of a few waves.
    assert power[np.abs(k - 1) < 0.1].sum() > 0.98 * power.sum()


@pytest.mark.parametrize(
    "options",
    [
        {"deviation": 0.0},
        {"tile_mm": np.nan},
        {"mean": np.inf},
        {"pixels": 100},
        {"pixels": 2},
        {"pixels": 8192},
        {"grain": "wood"},
        {"target": "volts"},
        {"spectrum": lambda k: -np.ones_like(k)},
        {"spectrum": lambda k: k * np.nan},
        {"spectrum": lambda k: 0 * k},
        {"spectrum": power_law(0, 0.001, 0.002)},
    ],
)
def test_bad_noise(options):
    with pytest.raises(InputError):
        Noise(**{"spectrum": power_law(1, 0.5, 10), "pixels": 64, **options})


@pytest.mark.parametrize("ends", [(0, 1), (2, 1), (1, np.inf), (np.nan, 1)])
def test_bad_wavelengths(ends):
    with pytest.raises(InputError, match="est_mm"):
        power_law(1.0, *ends)
