"""Spectra of height maps and line scans against closed forms and the maps' own mean squares."""

import math
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import resample

from haptix import Finger
from haptix.base.errors import InputError
from haptix.model.contact import HalfSpace, MeanField, RoughnessSpectrum

POINTS, PIXEL_M = 256, 1e-5
SIDE_M = POINTS * PIXEL_M
X_M = np.arange(POINTS) * PIXEL_M


def ridges(spacing_m: float, rms_m: float = 15e-6, turn: float = 0.0) -> np.ndarray:
    along = X_M[:, None] * math.sin(turn) + X_M * math.cos(turn)
    return math.sqrt(2) * rms_m * np.sin(2 * math.pi * along / spacing_m + 0.3)


def isotropic(seed: int, points: int = POINTS, roll: float = 12.0) -> np.ndarray:
    """A periodic Gaussian map of 1 um rms: constant up to `roll` waves a side, then q^-3.6."""
    f = np.fft.fftfreq(points, 1 / points)
    waves = np.hypot(f[:, None], f)
    shape = np.maximum(waves / roll, 1.0) ** -1.8 * (waves > 0) * (waves < points / 2)
    noise = np.fft.fft2(np.random.default_rng(seed).standard_normal((points, points)))
    height = np.fft.ifft2(noise * shape).real
    return np.asarray(1e-6 * height / height.std())


@settings(max_examples=12, deadline=None)
@given(
    st.floats(0.2e-3, 0.8e-3),
    st.floats(0, math.pi),
    st.sampled_from([0.0, 0.2e-6, 2e-6]),
    st.booleans(),
)
def test_ridges_keep_their_height_and_slope(
    spacing_m: float, turn: float, noise_m: float, is_tilted: bool
) -> None:
    noise = noise_m * np.random.default_rng(1).standard_normal((POINTS, POINTS))
    height = ridges(spacing_m, turn=turn) + noise
    found = RoughnessSpectrum.from_topography(height + 0.01 * is_tilted * X_M, PIXEL_M)
    plane = np.stack(np.broadcast_arrays(X_M, X_M[:, None], 1.0), -1).reshape(-1, 3)
    tilt = np.linalg.lstsq(plane, height.ravel(), rcond=None)[0]
    level = height.ravel() - plane @ tilt
    assert float(found.h_rms_m) == pytest.approx(level.std(), rel=1e-6)
    # A sine of amplitude a has the mean square slope a^2 q^2 / 2. White noise of variance s^2 has
    # s^2/2 (pi/pixel)^2 within the circle of the shortest waves, pi/4 of all. The window widens
    # the line by a wave of 3 to 13 a side, and weighs the phases at the borders.
    slope2 = (15e-6 * 2 * math.pi / spacing_m) ** 2
    slope2 += noise_m**2 * math.pi / 8 * (math.pi / PIXEL_M) ** 2
    assert float(found.slope_rms) == pytest.approx(math.sqrt(slope2), rel=0.08)


def test_ridges_with_noise_have_the_contact_of_a_line_and_a_plateau() -> None:
    noise_m, spacing_m = 2e-6, 0.25e-3
    noise = noise_m * np.random.default_rng(0).standard_normal((POINTS, POINTS))
    measured = RoughnessSpectrum.from_topography(ridges(spacing_m) + noise, PIXEL_M)
    q, floor = 2 * math.pi / spacing_m, noise_m**2 * PIXEL_M**2 / (4 * math.pi**2)
    low, high = q / 1.05, q * 1.05
    line = 15e-6**2 / (math.pi * (high**2 - low**2))
    exact = RoughnessSpectrum.from_table(
        [2 * math.pi / SIDE_M, low * (1 - 1e-6), low, high, high * (1 + 1e-6), math.pi / PIXEL_M],
        [floor, floor, line, line, floor, floor],
    )
    solid = Finger.preset("semi-wet").solid()
    for reach in (1.3, 4.0):
        found, wanted = (MeanField(s, solid, reach=reach) for s in (measured, exact))
        at = torch.tensor([3e3, 3e4], dtype=torch.float64)
        # The noise's rms slope scatters by 1 %, the window widens the line: 2 %, where panels that
        # pass over the line missed the gap by 20 %.
        torch.testing.assert_close(found.mean_gap(at), wanted.mean_gap(at), rtol=0.02, atol=0)
        pulls = (field.inverse_square_gap(at, 2e-7, "excluded") for field in (found, wanted))
        torch.testing.assert_close(*pulls, rtol=0.04, atol=0)


def test_a_table_of_very_many_nodes_has_the_contact_of_its_law() -> None:
    law = RoughnessSpectrum.self_affine(15e-6, 0.8, 2e3, 8e3, 2e6)
    q = torch.linspace(2e3, 2e6, 1500, dtype=torch.float64)
    scatter = torch.from_numpy(np.random.default_rng(2).chisquare(16, 1500) / 16)
    many = RoughnessSpectrum.from_table(q, law(q) * scatter)
    found, wanted = (MeanField(spectrum, HalfSpace(4e7, 0.5)) for spectrum in (many, law))
    # The first 10 nodes, which scatter by 35 %, hold most of the height.
    gaps = float(found.mean_gap(1e4) / wanted.mean_gap(1e4))
    assert gaps == pytest.approx(float(many.h_rms_m / law.h_rms_m), rel=0.05)


def test_a_periodic_map_has_no_window_and_keeps_its_single_waves() -> None:
    height = isotropic(1) + ridges(SIDE_M / 2)
    for turned in (height, -height[::-1]):
        found = RoughnessSpectrum.from_topography(turned, PIXEL_M, is_periodic=True)
        assert float(found.h_rms_m) == pytest.approx(height.std(), rel=1e-9)
        below = float(found.h_rms_m**2 - found.moment(1, torch.tensor(2.6 * 2 * math.pi / SIDE_M)))
        within = height.std() ** 2 - float(
            found.moment(1, torch.tensor(2.6 * 2 * math.pi / SIDE_M, dtype=torch.float64))
        )
        assert within == pytest.approx(15e-6**2, rel=0.02)
        assert below > 0


@pytest.mark.parametrize(("remove", "radius_m"), [("radius", 9e-3), ("form", 3e-3)])
def test_the_form_of_a_fingertip(remove: Any, radius_m: float) -> None:
    rough = 13 * isotropic(3)
    y, x = np.meshgrid(X_M - SIDE_M / 2, X_M - SIDE_M / 2, indexing="ij")
    height = rough + np.sqrt(radius_m**2 - x**2 - y**2)
    left = RoughnessSpectrum.from_topography(height, PIXEL_M)
    told = [note for note in left.notes if note.startswith("warning: ")]
    assert len(told) == 1 and 'remove="radius"' in told[0]
    found = RoughnessSpectrum.from_topography(height, PIXEL_M, remove=remove)
    # The polynomial takes 6 or 15 of some 450 waves up to the roll-off.
    assert float(found.h_rms_m) == pytest.approx(13e-6, rel=0.06)
    assert not any(note.startswith("warning: ") for note in found.notes)
    assert any(remove in note for note in found.notes)
    plain = RoughnessSpectrum.from_topography(rough, PIXEL_M)
    assert not any(note.startswith("warning: ") for note in plain.notes)


def test_missing_points_are_filled_or_refused() -> None:
    height = isotropic(4)
    holes = np.random.default_rng(5).random(height.shape) < 0.01
    holes[40:60, 100:130] = True
    wanted = RoughnessSpectrum.from_topography(height, PIXEL_M)
    for filler in (9.97e36, math.nan):
        masked = np.ma.masked_array(np.where(holes, filler, height), mask=holes)
        for holed in (masked, np.where(holes, math.nan, height)):
            found = RoughnessSpectrum.from_topography(holed, PIXEL_M)
            # 2 % of the points, of which the smooth fill keeps the long waves.
            assert float(found.h_rms_m) == pytest.approx(float(wanted.h_rms_m), rel=0.01)
            assert float(found.slope_rms) == pytest.approx(float(wanted.slope_rms), rel=0.03)
            assert any("missing" in note for note in found.notes)
    for wrong, sentence in (
        (np.where(holes, 9.97e36, height), "mask"),
        (height * 1e6, "metres"),
        (np.ma.masked_array(height, mask=np.eye(POINTS)[::-1].cumsum(0) > 0), "missing"),
        (np.full((20, 20), math.nan), "missing"),
    ):
        with pytest.raises(InputError, match=f"height_m.*{sentence}"):
            RoughnessSpectrum.from_topography(wrong, PIXEL_M)


@pytest.mark.parametrize("ratio", [1 + 4.5e-7, 1 + 6e-4, 1.25])
def test_pixels_that_are_nearly_square(ratio: float) -> None:
    height = ridges(0.3e-3)
    found = RoughnessSpectrum.from_topography(height, (PIXEL_M, PIXEL_M * ratio))
    square = RoughnessSpectrum.from_topography(height, PIXEL_M)
    assert float(found.h_rms_m) == pytest.approx(float(square.h_rms_m), rel=1e-3)
    # Ridges along the rows, whose pixels are wider.
    assert float(found.slope_rms * ratio) == pytest.approx(float(square.slope_rms), rel=0.02)


def test_line_scans_of_an_isotropic_map_have_its_spectrum() -> None:
    topography = pytest.importorskip("SurfaceTopography", reason="the extra topography")
    height = isotropic(6, 512)
    side_um = 512 * PIXEL_M * 1e6
    whole = RoughnessSpectrum.from_topography(height, PIXEL_M)
    even = [topography.UniformLineScan(row * 1e6, side_um, unit="um") for row in height[::4]]
    places = np.sort(np.random.default_rng(7).choice(8 * 512, 1024, replace=False))
    fine = [resample(row * 1e6, 8 * 512)[places] for row in height[::4]]
    x_um = places * PIXEL_M * 1e6 / 8
    uneven = [topography.NonuniformLineScan(x_um, row, unit="um") for row in fine]
    for scans in (even, uneven):
        found = RoughnessSpectrum.from_topography(scans)
        # A scan loses the waves that run across it, some 2 % of the mean square here.
        assert float(found.h_rms_m) == pytest.approx(float(whole.h_rms_m), rel=0.06)
        # The gradient of a map is sqrt(2) times the slope along a line.
        assert float(found.slope_rms) == pytest.approx(float(whole.slope_rms), rel=0.12)
    one = RoughnessSpectrum.from_topography(height[0], PIXEL_M)
    assert float(one.h_rms_m) == pytest.approx(height[0].std(), rel=0.1)  # its line is removed


def test_a_scan_across_ridges_keeps_their_height_and_slope() -> None:
    scan = ridges(0.3e-3)[0] + 1e-7 * np.random.default_rng(8).standard_normal(POINTS)
    found = RoughnessSpectrum.from_topography(scan, PIXEL_M)
    assert float(found.h_rms_m) == pytest.approx(15e-6, rel=0.01)
    assert float(found.slope_rms) == pytest.approx(15e-6 * 2 * math.pi / 0.3e-3, rel=0.15)


def test_topographies_bring_their_period_and_their_holes() -> None:
    topography = pytest.importorskip("SurfaceTopography", reason="the extra topography")
    height = isotropic(9)
    size = (SIDE_M * 1e6,) * 2
    periodic = topography.Topography(height * 1e6, size, unit="um", periodic=True)
    found = RoughnessSpectrum.from_topography(periodic)
    assert float(found.h_rms_m) == pytest.approx(height.std(), rel=1e-9)
    assert "no window, since it is periodic" in found.notes
    holes = np.zeros(height.shape, bool)
    holes[3, 5] = True
    masked = topography.Topography(np.ma.masked_array(height * 1e6, holes), size, unit="um")
    assert any("missing" in note for note in RoughnessSpectrum.from_topography(masked).notes)
    short = topography.UniformLineScan(np.arange(5.0), 1.0, unit="um")
    with pytest.raises(InputError, match="8 points"):
        RoughnessSpectrum.from_topography(short)


def test_the_conventions_of_spectra_are_those_of_their_papers() -> None:
    topography = pytest.importorskip("SurfaceTopography", reason="the extra topography")
    height = isotropic(10, 512)
    size = (512 * PIXEL_M,) * 2
    measured = topography.Topography(height, size, unit="m", periodic=True)
    for convention, (q, c) in (
        ("C_iso", measured.power_spectrum_from_area(nb_points_per_decade=20)),
        ("C_1D", measured.power_spectrum_from_profile(nb_points_per_decade=20)),
    ):
        there = ~np.ma.getmaskarray(c) & (np.ma.getdata(c) > 0)
        found = RoughnessSpectrum.from_table(
            np.ma.getdata(q)[there], np.ma.getdata(c)[there], convention
        )
        # The bins of the tool end below the shortest waves, and a line between their middles cuts
        # the corner at the roll-off; a factor of 4 pi^2 is 6.3 in rms.
        assert float(found.h_rms_m) == pytest.approx(1e-6, rel=0.08), convention
    with pytest.raises(InputError, match=r"convention.*C_iso.*got 'PSD'"):
        RoughnessSpectrum.from_table([1e3, 1e4], [1.0, 1.0], "PSD")


def test_waves_that_were_not_seen_are_added_by_a_stated_law() -> None:
    whole = RoughnessSpectrum.self_affine(22e-6, 0.86, 1e3, 4e3, 1e9)
    nodes = torch.tensor([2e3, 4e3, 3.14e5], dtype=torch.float64)
    seen = RoughnessSpectrum.from_table(nodes, whole(nodes))
    assert float(seen.slope_rms) < 0.3 * float(whole.slope_rms)
    found = seen.extended(hurst=0.86, q1=1e9, q0=1e3)
    assert float(found.h_rms_m) == pytest.approx(22e-6, rel=1e-9)  # the law is exact
    assert float(found.slope_rms) == pytest.approx(float(whole.slope_rms), rel=1e-9)
    assert len(found.notes) == 2 and "H = 0.86" in found.notes[1]
    assert seen.extended(0.8, q1=1e5) is seen  # it reaches further already
    for hurst in (0.0, 1.1, math.nan):
        with pytest.raises(InputError, match="hurst"):
            seen.extended(hurst)


@pytest.mark.parametrize("hurst", [0.5, 0.8, 1.0])
def test_a_line_s_spectrum_of_a_power_law_gives_it_back(hurst: float) -> None:
    """``C_1D(k) = 2 pi int C dq_y``, of which a line that begins at q0 shows no waves below."""
    q = np.geomspace(1e4, 1e7, 200)
    density = 1e-6 * q ** (-2 * (1 + hurst))
    of_all_y = math.sqrt(math.pi) * math.gamma(hurst + 0.5) / math.gamma(hurst + 1)
    along = 2 * math.pi * density * q * of_all_y
    found = RoughnessSpectrum.from_table(q, along, "C_1D")
    at = np.log([2e4, 1e5, 1e6])
    log_density = np.interp(at, found.wavenumber.log(), found.density.log())
    # Rings of a tenth of a decade, and waves beyond 1e7 that the closed form has and no ring.
    np.testing.assert_allclose(log_density, np.interp(at, np.log(q), np.log(density)), atol=0.05)


@pytest.mark.parametrize("kind", [np.asarray, torch.from_numpy])
def test_a_list_of_arrays_is_line_scans_and_no_map(kind: Any) -> None:
    x, phases = np.arange(1024) * 2e-6, np.random.default_rng(0).uniform(0, 2 * math.pi, 32)
    scans = [1e-6 * np.sin(2 * math.pi * x / 1e-4 + phase) for phase in phases]
    found = RoughnessSpectrum.from_topography([kind(scan) for scan in scans], 2e-6)
    one = RoughnessSpectrum.from_topography(scans[0], 2e-6)
    # All show the same wave, at places of their own: as rows of a map they would be steep.
    assert float(found.slope_rms) == pytest.approx(float(one.slope_rms), rel=0.02)
    assert "32 line scans, taken as those of an isotropic surface" in found.notes
    with pytest.raises(InputError, match="8 points"):
        RoughnessSpectrum.from_topography([kind(scan[:5]) for scan in scans], 2e-6)
