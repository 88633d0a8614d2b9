"""Random and measured surfaces: their spectrum, their band, and what is refused."""

from math import pi

import numpy as np
import pytest
import torch

from haptix.base.errors import InputError
from haptix.model.contact import RoughnessSpectrum
from haptix.model.contact.boundary_elements import ResolutionWarning, Surfaces
from haptix.model.contact.boundary_elements.elements import corrected_area

WAVE = 2 * pi


def spectrum(shortest: float = 16.0, rolloff: float = 4.0) -> RoughnessSpectrum:
    return RoughnessSpectrum.self_affine(2e-6, 0.8, WAVE, rolloff * WAVE, shortest * WAVE)


def test_every_wave_has_its_mean_square() -> None:
    surface = Surfaces.random(spectrum(), 128, 1.0, surfaces=2)
    waves = np.fft.fft2(surface.height_m[1].numpy()) / 128**2
    k = np.fft.fftfreq(128, 1 / 128)
    q = WAVE * np.hypot(k[:, None], k[None])
    inside = (q > WAVE * 0.99) & (q < WAVE * 16.01)
    expected = spectrum()(torch.from_numpy(q[inside]).clamp(WAVE, 16 * WAVE)).numpy() * WAVE**2
    assert np.abs(waves[inside]) ** 2 == pytest.approx(expected, rel=1e-9)
    # Outside the band: rounding of the transforms.
    assert np.abs(waves[~inside]).max() < 1e-14 * 2e-6 * 128


def test_roughness_and_slope_achieved() -> None:
    surface = Surfaces.random(spectrum(), 128, 1.0, surfaces=3)
    # 3e-2: the disc of waves is a sum over whole waves here, an integral there.
    assert surface.h_rms_m.tolist() == pytest.approx([2e-6] * 3, rel=3e-2)
    slope = float(spectrum().slope_rms)
    assert surface.slope_rms.tolist() == pytest.approx([slope] * 3, rel=3e-2)
    # The same from differences over pixels 8 times finer than the shortest wave, whose error is
    # of second order: (pi / 8 / 8)^2 / 6 and less.
    fine = Surfaces.random(spectrum(), 1024, 1.0)
    h = fine.height_m[0]
    steps = [(h - h.roll(1, axis)) / fine.pixel_m for axis in (0, 1)]
    by_pixels = float((steps[0] ** 2 + steps[1] ** 2).mean().sqrt())
    assert by_pixels == pytest.approx(float(fine.slope_rms), rel=1e-3)


def test_a_seed_is_one_surface_on_every_grid_and_in_every_batch() -> None:
    coarse = Surfaces.random(spectrum(), 128, 1.0, surfaces=1, seed=3)
    fine = Surfaces.random(spectrum(), 256, 1.0, surfaces=3, seed=3)
    torch.testing.assert_close(fine.height_m[:1, ::2, ::2], coarse.height_m, rtol=0, atol=1e-18)
    assert not torch.equal(fine.height_m[0], fine.height_m[1])
    other = Surfaces.random(spectrum(), 128, 1.0, seed=4)
    assert not torch.equal(other.height_m, coarse.height_m)


def test_the_band_in_pixels_and_in_the_box() -> None:
    surface = Surfaces.random(spectrum(), 128, 1.0, q_high=16 * WAVE)
    assert surface.pixels_per_shortest_wave == pytest.approx(8)
    assert surface.waves_in_box == pytest.approx(4)


def test_a_measured_map_keeps_its_heights_and_finds_its_band() -> None:
    made = Surfaces.random(spectrum(), 128, 1.0, surfaces=2)
    taken = Surfaces.measured(made.height_m.numpy() + 5e-3, 1 / 128)
    torch.testing.assert_close(taken.height_m, made.height_m, rtol=0, atol=1e-17)
    assert taken.side_m == pytest.approx(1)
    # 99.9 % of the mean-square slope, not all of it, lies below the end that is found.
    assert taken.q_high == pytest.approx(made.q_high, rel=0.02)
    assert taken.slope_rms.tolist() == pytest.approx(made.slope_rms.tolist())


@pytest.mark.filterwarnings("ignore:.*per shortest wavelength", "ignore:.*roll-off wavelengths")
def test_a_map_whose_borders_do_not_meet() -> None:
    x = np.linspace(0, 1, 64)
    wave = np.cos(6 * pi * x)
    tilted = 1e-6 * (5 * x[:, None] + wave[:, None] * wave[None])
    with pytest.warns(ResolutionWarning, match="mirrored=True"):
        Surfaces.measured(tilted, 1e-6)
    mirrored = Surfaces.measured(tilted, 1e-6, mirrored=True)
    assert mirrored.points == 128
    assert mirrored.side_m == pytest.approx(128e-6)


def test_coarse_grids_and_small_boxes_are_said_or_refused() -> None:
    with pytest.warns(ResolutionWarning, match="4 pixels"):
        Surfaces.random(spectrum(), 64, 1.0)
    with pytest.warns(ResolutionWarning, match="2 roll-off"):
        Surfaces.random(spectrum(rolloff=2.0), 128, 1.0)
    with pytest.raises(InputError, match=r"2 pixels.*q_high"):
        Surfaces.random(spectrum(), 24, 1.0)
    with pytest.raises(InputError, match="one roll-off wavelength"):
        Surfaces.random(spectrum(), 128, 0.2)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"points": 8}, "points"),
        ({"points": 64.0}, "points"),
        ({"surfaces": 0}, "surfaces"),
        ({"seed": -1}, "seed"),
        ({"side_m": 0.0}, "side_m"),
        ({"q_high": float("nan")}, "q_high"),
        ({"q_high": 0.5 * WAVE}, "q_high"),
    ],
)
def test_impossible_surfaces(change: dict[str, object], message: str) -> None:
    arguments = {"points": 128, "side_m": 1.0} | change
    with pytest.raises(InputError, match=message):
        Surfaces.random(spectrum(), **arguments)


@pytest.mark.parametrize(
    ("height", "message"),
    [
        (np.ones((32, 33)), "square map"),
        (np.ones(32), "square map"),
        (np.ones((32, 32)), "flat"),
        (np.full((32, 32), np.nan), "finite"),
        (np.ones((8, 8)), "at least 16"),
    ],
)
def test_impossible_maps(height: np.ndarray, message: str) -> None:
    with pytest.raises(InputError, match=message):
        Surfaces.measured(height, 1e-6)


def test_the_correction_for_pixels_counts_the_border() -> None:
    # That it is right on a contact shows in the radius of Hertz' sphere.
    share = (pi - 1 + np.log(2)) / 24
    mask = torch.zeros(3, 32, 32, dtype=torch.bool)
    mask[1] = True
    mask[2, 5:21, :] = True  # half of the box, whose border is two lines
    expected = [0.0, 1.0, 0.5 - share * 2 / 32]
    assert corrected_area(mask).tolist() == pytest.approx(expected, rel=1e-12)
    # A square over the box's own border: 4 sides of 8 pixels.
    square = torch.zeros(32, 32, dtype=torch.bool)
    square[:8, :8] = True
    over_the_border = corrected_area(square.roll((-3, -5), (0, 1)))
    assert float(over_the_border) == pytest.approx((64 - share * 32) / 32**2, rel=1e-12)
