"""Roughness spectra: moments by quadrature, tables, and spectra of maps."""

import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad

from haptix import ContactModel, Finger, Screen
from haptix.base.errors import InputError
from haptix.model.contact import HalfSpace, MeanField, RoughnessSpectrum
from haptix.model.finger import MeasuredRoughness

SURFACES = [
    (22e-6, 0.86, 1e3, 3992.9, 1e9),
    (2e-6, 0.8, 1e4, 1e4, 1e7),
    (1e-6, 0.5, 1e4, 5e4, 1e6),  # q^3 C is flat beyond the roll-off
    (1e-6, 1.0, 1e4, 5e4, 1e8),  # q^3 C ~ 1/q: the slope's integral is a logarithm
    (1e-6, 0.3, 1e4, 1e6, 1e6),  # a plateau and nothing else
]


def moment_by_quad(
    surface: tuple[float, ...], power: int, above: float = 0.0, level: float = 1.0
) -> float:
    """``2 pi int q^power C dq`` in ln q, piece by piece; C = level up to the roll-off."""
    _, hurst, q0, qr, q1 = surface

    def integrand(t: float) -> float:
        q = math.exp(t)
        return q ** (power + 1) * level * max(q / qr, 1.0) ** (-2 * (1 + hurst))

    ends = [math.log(max(q, above)) for q in (q0, qr, q1)]
    return 2 * math.pi * sum(quad(integrand, a, b, epsrel=1e-12)[0] for a, b in pairwise(ends))


@pytest.mark.parametrize("surface", SURFACES)
def test_height_and_slope_by_quadrature(surface: tuple[float, ...]) -> None:
    spectrum = RoughnessSpectrum.self_affine(*surface)
    level = surface[0] ** 2 / moment_by_quad(surface, 1)
    # 1e-9 leaves room for the quadrature, not for a wrong formula.
    assert float(spectrum.h_rms_m) == pytest.approx(surface[0], rel=1e-12)
    slope = math.sqrt(moment_by_quad(surface, 3, level=level))
    assert float(spectrum.slope_rms) == pytest.approx(slope, rel=1e-9)
    q = np.geomspace(surface[2], surface[4], 31)
    expected = level * np.maximum(q / surface[3], 1.0) ** (-2 * (1 + surface[1]))
    assert spectrum(torch.tensor(q)).tolist() == pytest.approx(expected.tolist(), rel=1e-9)


@pytest.mark.parametrize(
    ("q1", "rolloff", "level"),
    [(1e9, 3992.9, 4.6013e-18), (1e8, 5981.5, 2.0170e-18), (1e7, 9142.0, 8.570e-19)],
)
def test_stand_ins_for_the_papers_finger(q1: float, rolloff: float, level: float) -> None:
    spectrum = RoughnessSpectrum.self_affine(22e-6, 0.86, 1e3, rolloff, q1)
    # Printed: the slope to two digits, the level to four or five.
    assert float(spectrum.slope_rms) == pytest.approx(0.91, abs=0.005)
    assert float(spectrum.density[0]) == pytest.approx(level, rel=1e-3)


@settings(max_examples=60, deadline=None)
@given(
    surface=st.sampled_from(SURFACES),
    share=st.floats(0.0, 1.0),
    power=st.sampled_from([0, 1, 2, 3]),
)
def test_moments_above_a_wave_by_quadrature(
    surface: tuple[float, ...], share: float, power: int
) -> None:
    spectrum = RoughnessSpectrum.self_affine(*surface)
    low, high = surface[2], surface[4]
    above = min(low * (high / low) ** share, high)
    level = surface[0] ** 2 / moment_by_quad(surface, 1)
    expected = moment_by_quad(surface, power, above, level)
    value = spectrum.moment(power, torch.tensor(above, dtype=torch.float64))
    # The difference of two nearly equal waves costs digits at the very end of the band only.
    scale = moment_by_quad(surface, power, 0.0, level)
    assert float(value) == pytest.approx(expected, rel=1e-8, abs=1e-14 * scale)


def test_moment_at_the_ends() -> None:
    spectrum = RoughnessSpectrum.self_affine(*SURFACES[0])
    whole, nothing = spectrum.moment(1, torch.tensor([1e3, 1e9], dtype=torch.float64)).tolist()
    assert whole == pytest.approx(22e-6**2, rel=1e-12)  # rounding
    assert nothing == 0.0


@pytest.mark.parametrize("surface", SURFACES)
def test_a_table_of_the_nodes_is_the_same_surface(surface: tuple[float, ...]) -> None:
    spectrum = RoughnessSpectrum.self_affine(*surface)
    few = RoughnessSpectrum.from_table(spectrum.wavenumber.tolist(), spectrum.density.tolist())
    nodes = np.unique(np.concatenate([np.geomspace(surface[2], surface[4], 40), surface[2:]]))
    nodes = np.clip(nodes, surface[2], surface[4])
    many = RoughnessSpectrum.from_table(nodes, spectrum(torch.tensor(nodes)))
    for table in (few, many):
        # A power law is a straight line in log-log: only rounding is left.
        assert float(table.h_rms_m) == pytest.approx(float(spectrum.h_rms_m), rel=1e-12)
        assert float(table.slope_rms) == pytest.approx(float(spectrum.slope_rms), rel=1e-12)
        assert (table.q0, table.q1) == (surface[2], surface[4])


BAD_TABLES: dict[str, tuple[Any, Any, str]] = {
    "empty": ([], [], "2 or more"),
    "one row": ([1.0], [1.0], "2 or more"),
    "lengths differ": ([1.0, 2.0, 3.0], [1.0, 1.0], "one length"),
    "two-dimensional": ([[1.0, 2.0]], [[1.0, 2.0]], "one-dimensional"),
    "not increasing": ([1.0, 3.0, 2.0], [1.0, 1.0, 1.0], "increasing"),
    "repeated": ([1.0, 1.0], [1.0, 1.0], "increasing"),
    "q zero": ([0.0, 1.0], [1.0, 1.0], "positive wavenumbers"),
    "q negative": ([-1.0, 1.0], [1.0, 1.0], "positive wavenumbers"),
    "q NaN": ([1.0, math.nan], [1.0, 1.0], "^q:"),
    "q infinite": ([1.0, math.inf], [1.0, 1.0], "^q:"),
    "c zero": ([1.0, 2.0], [1.0, 0.0], "^c:"),
    "c negative": ([1.0, 2.0], [1.0, -1.0], "^c:"),
    "c NaN": ([1.0, 2.0], [math.nan, 1.0], "^c:"),
    "c infinite": ([1.0, 2.0], [math.inf, 1.0], "^c:"),
    "text": (["a", "b"], [1.0, 1.0], "q"),
}


@pytest.mark.parametrize("name", BAD_TABLES)
def test_bad_tables_are_rejected(name: str) -> None:
    q, c, sentence = BAD_TABLES[name]
    with pytest.raises(InputError, match=sentence):
        RoughnessSpectrum.from_table(q, c)


BAD_SURFACES = [
    ((0.0, 0.8, 1e4, 1e4, 1e7), "h_rms_m"),
    ((math.nan, 0.8, 1e4, 1e4, 1e7), "h_rms_m"),
    ((1e-6, 0.0, 1e4, 1e4, 1e7), "hurst"),
    ((1e-6, 1.01, 1e4, 1e4, 1e7), "hurst"),
    ((1e-6, math.nan, 1e4, 1e4, 1e7), "hurst"),
    ((1e-6, 0.8, 0.0, 1e4, 1e7), "q0"),
    ((1e-6, 0.8, 1e4, 1e3, 1e7), "q0 <= q_rolloff"),
    ((1e-6, 0.8, 1e4, 1e8, 1e7), "q_rolloff <= q1"),
    ((1e-6, 0.8, 1e4, math.nan, 1e7), "q_rolloff"),
    ((1e-6, 0.8, 1e4, 1e4, 1e4), "q0 < q1"),
    ((1e-6, 0.8, 1e4, 1e4, math.inf), "q1"),
]


@pytest.mark.parametrize(("surface", "sentence"), BAD_SURFACES)
def test_impossible_surfaces(surface: tuple[float, ...], sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        RoughnessSpectrum.self_affine(*surface)


PIXELS, PIXEL_M = 512, 2e-6
ROLLOFF_WAVES = 60  # of the map's side


def random_map(seed: int) -> tuple[np.ndarray, float, float]:
    """A periodic Gaussian map of C = const up to a roll-off, then q^-3.6; h_rms and C's level."""
    side = PIXELS * PIXEL_M
    f = np.fft.fftfreq(PIXELS, 1 / PIXELS)
    waves = np.hypot(f[:, None], f[None])  # per side
    shape = np.maximum(waves / ROLLOFF_WAVES, 1.0) ** -3.6
    shape[(waves == 0) | (waves > PIXELS / 2)] = 0
    dq = 2 * math.pi / side
    level = (1e-6) ** 2 / (shape.sum() * dq**2)  # h_rms^2 = int C d^2q
    noise = np.fft.fft2(np.random.default_rng(seed).standard_normal((PIXELS, PIXELS)))
    return np.fft.ifft2(noise * np.sqrt(level * shape) * dq * PIXELS).real, 1e-6, level


@pytest.mark.parametrize("tilt", [0.0, 0.05])
def test_spectrum_of_a_random_map(tilt: float) -> None:
    height, h_rms, level = random_map(1)
    height = height + 3e-4 + tilt * PIXEL_M * np.arange(PIXELS)
    spectrum = RoughnessSpectrum.from_topography(height, PIXEL_M)
    # Some pi 60^2 / 2 waves carry the height; the window leaves about a quarter of them
    # independent, so h_rms scatters by 1/(2 sqrt(1400)) = 1.3 %. Four of that.
    assert float(spectrum.h_rms_m) == pytest.approx(h_rms, rel=0.055)
    q = spectrum.wavenumber.numpy()
    dq = 2 * math.pi / (PIXELS * PIXEL_M)
    use = (q > 15 * dq) & (q < 0.8 * math.pi / PIXEL_M)
    shape = np.maximum(q / (ROLLOFF_WAVES * dq), 1.0) ** -3.6
    ratio = np.log(spectrum.density.numpy() / (level * shape))[use]
    # A ring at 15 waves holds some 50 independent ones and scatters by 14 %, later ones less; the
    # curvature within a ring lifts the steep part by 3 %. The mean over the rings scatters by 4 %.
    assert abs(ratio.mean()) < 0.12
    assert np.abs(ratio).max() < 0.5
    # The band is that of the map, up to rounding.
    assert spectrum.q0 >= dq * (1 - 1e-9)
    assert spectrum.q1 <= math.pi / PIXEL_M * (1 + 1e-9)


def test_a_map_of_another_shape_and_pixel_scales() -> None:
    height, _, _ = random_map(2)
    one = RoughnessSpectrum.from_topography(height[:200, :300], PIXEL_M)
    turned = RoughnessSpectrum.from_topography(height[:200, :300].T, PIXEL_M)
    # Turning the map changes nothing but the order of summation.
    np.testing.assert_allclose(one.density, turned.density, rtol=1e-9)
    larger = RoughnessSpectrum.from_topography(3 * height[:200, :300], 3 * PIXEL_M)
    np.testing.assert_allclose(larger.density, 81 * one.density, rtol=1e-9)  # C is in m^4
    np.testing.assert_allclose(larger.wavenumber, one.wavenumber / 3, rtol=1e-12)


BAD_MAPS: dict[str, Any] = {
    "one-dimensional": np.ones(100),
    "too small": np.ones((7, 100)),
    "missing point": np.where(np.eye(20) > 0, np.nan, 1.0),
    "empty": np.ones((0, 0)),
}


@pytest.mark.parametrize("name", BAD_MAPS)
def test_bad_maps_are_rejected(name: str) -> None:
    with pytest.raises(InputError, match=r"height_m"):
        RoughnessSpectrum.from_topography(BAD_MAPS[name], 1e-6)


@pytest.mark.parametrize("bad", [0.0, -1e-6, math.nan, math.inf])
def test_impossible_pixels(bad: float) -> None:
    with pytest.raises(InputError, match="pixel_m"):
        RoughnessSpectrum.from_topography(random_map(3)[0], bad)


def test_a_topography_brings_its_unit_and_its_band() -> None:
    topography = pytest.importorskip("SurfaceTopography", reason="the extra topography")
    height, _, _ = random_map(4)
    side_m = PIXELS * PIXEL_M
    measured = topography.Topography(height * 1e6, (side_m * 1e6,) * 2, unit="um")
    spectrum = RoughnessSpectrum.from_topography(measured)
    plain = RoughnessSpectrum.from_topography(height, PIXEL_M)
    np.testing.assert_allclose(spectrum.density, plain.density, rtol=1e-9)  # rounding of units
    np.testing.assert_allclose(spectrum.wavenumber, plain.wavenumber, rtol=1e-12)
    finger = Finger(roughness=MeasuredRoughness.of(spectrum, "a map made for this test"))
    model = ContactModel(finger, Screen())
    assert "roughness spectrum of the finger" not in model.placeholders()
    told = model.describe()["roughness"]
    assert f"{spectrum.q0:.3g} to {spectrum.q1:.3g} /m" in told
    # Light contact: sqrt(8/pi) p / (E* slope), E* = 40 MPa / 0.75.
    state = model.solve(0.01, 0.0)
    expected = math.sqrt(8 / math.pi) * float(state.pressure_pa) * 0.75 / 40e6
    assert float(state.area_fraction) == pytest.approx(
        expected / float(spectrum.slope_rms), rel=1e-3
    )  # the cubic term of erf
    for wrong, sentence in (
        ((topography.Topography(height, (1.0, 1.0)),), "unit is known"),
        ((topography.Topography(height, (1.0, 2.0), unit="m"),), "square pixels"),
        ((measured, 1e-6), "brings its own pixels"),
    ):
        with pytest.raises(InputError, match=sentence):
            RoughnessSpectrum.from_topography(*wrong)
    with pytest.raises(InputError, match="pixel_m"):
        RoughnessSpectrum.from_topography(height)


def test_a_spectrum_of_one_wave_has_no_short_ones() -> None:
    narrow = RoughnessSpectrum.from_table([1e4, 2e4], [1e-20, 1e-21])
    with pytest.raises(InputError, match=r"spectrum: .*10000 to 20"):
        MeanField(narrow, HalfSpace(1e6, 0.5))


@pytest.mark.parametrize(
    ("fields", "sentence"),
    [
        ({"q_per_m": (1e4, 1e3), "density_m4": (1e-20, 1e-21)}, "roughness.*increasing"),
        ({"q_per_m": (1e3, 1e4), "density_m4": (1e-20, 0.0)}, "roughness.*positive"),
        ({"q_per_m": (1e3, 1e4), "density_m4": (1e-20,)}, "roughness.*one length"),
    ],
)
def test_a_finger_refuses_a_table_that_is_no_spectrum(fields: Any, sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        Finger(roughness=fields)
