"""Boundary elements on what is known exactly, and pixel for pixel against another solver."""

from math import pi, sqrt

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from haptix.model.contact import HalfSpace, Layered, RoughnessSpectrum
from haptix.model.contact.boundary_elements import BoundaryElements, Surfaces
from haptix.model.contact.elasticity import ElasticSolid
from tests.model.contact.closed_forms import (
    HertzSphere,
    WavySurface,
    crossed_waves_full_contact_pressure,
)

UNIT = HalfSpace(1.0, 0.0)  # E* = 1
WAVE = 2 * pi


def rough(points: int, surfaces: int = 1, seed: int = 0, shortest: float = 8.0) -> Surfaces:
    """Self-affine from a quarter of the box down to `shortest` pixels, h_rms about 1, side 1."""
    spectrum = RoughnessSpectrum.self_affine(
        1.0, 0.8, WAVE, 4 * WAVE, WAVE * max(5.0, points / shortest)
    )
    return Surfaces.random(spectrum, points, 1.0, surfaces=surfaces, seed=seed)


def given_heights(height: np.ndarray) -> Surfaces:
    """Heights on a box of side 1 as they are, whatever their band."""
    field = torch.from_numpy(height)[None]
    return Surfaces(field - field.mean(), 1.0, WAVE, WAVE, 4.0)


def centred(points: int) -> np.ndarray:
    return (np.arange(points) - points // 2) / points


# ---- closed forms


def westergaard(points: int, share: float) -> tuple[float, float]:
    """Error of the pressure (rms over that at the crest) and of the contact width in pixels."""
    wave = WavySurface(0.01, 1.0, 1.0)
    x = centred(points)
    height = np.repeat(wave.amplitude_m * np.cos(WAVE * x)[None], points, 0)
    mean = share * wave.full_contact_pressure_pa
    solved = BoundaryElements(given_heights(height), UNIT, tolerance=1e-9).fields(mean)
    pressure = solved.pressure_pa[0].numpy()
    exact = wave.pressure_pa(mean, x)
    error = np.sqrt(((pressure - exact) ** 2).mean()) / exact.max()
    width = (pressure > 0).mean() - float(wave.contact_fraction(mean))
    return float(error), float(width * points)


def test_westergaard_wave_and_its_order_of_convergence() -> None:
    grids, shares = [32, 64, 128, 256], [0.05, 0.1, 0.2, 0.3, 0.5, 0.8]
    found = np.array([[westergaard(n, share) for share in shares] for n in grids])
    errors, widths = found[..., 0], found[..., 1]
    # The border is known to a pixel on either side.
    assert np.abs(widths).max() <= 2
    # The pressure ends in a root: one pixel there is off by the root of its size, which over all
    # pixels is an rms error of order 1. One load's error jumps as the border moves over pixels, so
    # the mean over loads is taken, and a tenth allowed for what is left of that.
    order = np.polyfit(np.log(grids), np.log(errors).mean(1), 1)[0]
    assert -order > 0.9
    # What that first order allows on 256 pixels: half a pixel of the wave, 2e-3.
    assert errors[-1].mean() < 2e-3


def hertz(points: int) -> tuple[float, float, float]:
    """Relative errors of the peak, of the contact radius and (rms) of the pressure of a sphere."""
    radius = 1 / 24
    sphere, force = HertzSphere(1.0, 1.0), 4 / 3 * radius**3
    x = centred(points)
    distance = np.hypot(x[:, None], x[None])
    solver = BoundaryElements(given_heights(-(distance**2) / 2), UNIT, tolerance=1e-8)
    pressure = solver.fields(force).pressure_pa[0].numpy()
    exact = sphere.pressure_pa(force, distance)
    area = float(solver.solve(force).area_fraction)
    return (
        pressure.max() / exact.max() - 1,
        sqrt(area / pi) / float(sphere.contact_radius_m(force)) - 1,
        float(np.sqrt(((pressure - exact) ** 2).sum() / (exact**2).sum())),
    )


def test_hertz_sphere_and_its_order_of_convergence() -> None:
    grids = [64, 128, 256, 512]
    errors = np.array([hertz(n) for n in grids])
    # The periodic images bend the surface by about (a/L)^3 = 7e-5 of the sphere's curvature.
    peak, radius, rms = np.abs(errors[-1])
    assert peak < 1e-3
    assert radius < 1e-3
    # As for the wave: the root at the border, here over a contact of 21 pixels' radius.
    assert rms < 1e-2
    # Corrected for its pixels the contact's radius, to one pixel at worst, falls at least as the
    # pixel; from 3 to 21 pixels' radius.
    order = np.polyfit(np.log(grids), np.log(np.abs(errors[:, 1])), 1)[0]
    assert -order > 1


def test_full_contact_of_crossed_waves() -> None:
    x = centred(64)
    height = 0.01 * np.cos(WAVE * x)[:, None] * np.cos(WAVE * x)[None]
    solver = BoundaryElements(given_heights(height), UNIT)
    exact = crossed_waves_full_contact_pressure(0.01, 1.0, 1.0)
    # One wave of the grid: rounding alone.
    assert float(solver.full_contact_pressure()) == pytest.approx(exact, rel=1e-12)
    below = solver.solve([0.9 * exact, 0.999 * exact])
    # The gap closes last in the four troughs: not yet, but all but a tenth and a few pixels of it.
    assert bool((below.area_fraction_raw < 1).all())
    assert below.area_fraction_raw[:, 0].tolist() == pytest.approx([0.9, 0.99], abs=0.1)


# ---- another solver


@pytest.mark.parametrize("x", [1e-3, 1e-2, 1e-1, 0.3])
def test_the_same_pixels_and_gaps_as_tamaas(x: float) -> None:
    tamaas = pytest.importorskip("tamaas", reason="needs tamaas, a boundary-element code")
    tamaas.set_log_level(tamaas.LogLevel.error)
    points = 256
    surface = rough(points, seed=4)
    pressure = x * float(surface.slope_rms)
    model = tamaas.ModelFactory.createModel(tamaas.model_type.basic_2d, [1.0, 1.0], [points] * 2)
    model.E, model.nu = 1.0, 0.0
    height = surface.height_m[0].numpy()
    tamaas.PolonskyKeerRey(model, height, 1e-9).solve(pressure)
    contact = model.traction > 0
    gap = model.displacement - height
    gap -= gap[contact].mean()
    solved = BoundaryElements(surface, UNIT, tolerance=1e-7).fields(pressure)
    ours = solved.pressure_pa[0].numpy() > 0
    # Pixels whose pressure is within rounding of 0 may fall either way; a lone one always may.
    assert (ours ^ contact).sum() <= max(1, 1e-3 * contact.sum())
    assert np.abs(solved.gap_m[0].numpy() - gap).max() <= 1e-4 * float(surface.h_rms_m)
    assert solved.pressure_pa.mean().item() == pytest.approx(pressure, rel=1e-12)


@pytest.mark.parametrize("share", [0.02, 0.3])
def test_the_same_yield_as_tamaas(share: float) -> None:
    tamaas = pytest.importorskip("tamaas", reason="needs tamaas, a boundary-element code")
    tamaas.set_log_level(tamaas.LogLevel.error)
    points = 64
    surface = rough(points, seed=2)
    hardness = 0.3 * float(surface.slope_rms)
    model = tamaas.ModelFactory.createModel(tamaas.model_type.basic_2d, [1.0, 1.0], [points] * 2)
    model.E, model.nu = 1.0, 0.0
    solver = tamaas.KatoSaturated(model, surface.height_m[0].numpy(), 1e-9, hardness)
    solver.max_iter = 10000
    solver.solve(share * hardness)
    solver = BoundaryElements(surface, UNIT, hardness_pa=hardness, tolerance=1e-7)
    ours = solver.fields(share * hardness).pressure_pa[0].numpy()
    # Its projected gradients stop a little early; ours is a hundred times sharper.
    assert np.abs(ours - model.traction).max() <= 1e-4 * hardness
    yielding = (model.traction >= hardness * (1 - 1e-6)).mean()
    assert float(solver.solve(share * hardness).plastic_fraction) == pytest.approx(yielding)
    assert yielding > 0


# ---- conditions that any solution meets

solids = st.sampled_from(
    [
        UNIT,
        HalfSpace(3.0, 0.5),
        Layered(100.0, 0.5, 0.05, 1.0, 0.5),
        Layered(1.0, 0.3, 0.1, 9.0, 0.45),
    ]
)


@settings(max_examples=25, deadline=None)
@given(
    solid=solids,
    seed=st.integers(0, 10**6),
    load=st.floats(-4, -0.2).map(lambda e: 10**e),
    yielding=st.sampled_from([None, 2.0, 1.2]),
)
def test_the_contact_conditions_hold(
    solid: ElasticSolid, seed: int, load: float, yielding: float | None
) -> None:
    points, tolerance = 40, 1e-6
    surface = rough(points, seed=seed)
    full = float(BoundaryElements(surface, solid).full_contact_pressure())
    mean = load * full
    hardness = None if yielding is None else yielding * mean * load ** (-0.5 * (yielding > 1.5))
    solver = BoundaryElements(surface, solid, hardness_pa=hardness, tolerance=tolerance)
    solved = solver.fields(mean)
    assert bool(solved.converged.all())
    p, height = solved.pressure_pa[0].numpy(), surface.height_m[0].numpy()
    # The displacement wave by wave on the whole plane of wavenumbers, in numpy.
    k = WAVE * np.fft.fftfreq(points, 1 / points)
    q = np.hypot(k[:, None], k[None])
    q[0, 0] = 1.0
    response = 2 / (q * solid.effective_modulus(torch.from_numpy(q)).numpy())
    response[0, 0] = 0.0
    gap = np.fft.ifft2(np.fft.fft2(p) * response).real - height
    ceiling = np.inf if hardness is None else hardness
    inside = (p > 0) & (p < ceiling)
    gap -= gap[inside].mean() if inside.any() else (gap - solved.gap_m[0].numpy()).mean()
    # Twice the tolerance: here the level is not taken from the same points at a rounding.
    allowed = 2 * tolerance * float(surface.h_rms_m)
    assert np.abs(gap[inside]).max(initial=0.0) <= allowed
    assert gap[p == 0].min(initial=0.0) >= -allowed
    assert gap[p >= ceiling].max(initial=0.0) <= allowed
    assert p.min() >= 0
    assert p.max() <= ceiling * (1 + 1e-12)
    assert p.mean() == pytest.approx(mean, rel=1e-9)


@pytest.mark.filterwarnings("ignore:3.99 pixels")
def test_a_layer_thousands_of_times_stiffer_than_what_is_below_converges() -> None:
    """Steps taken whatever they did to the energy went round and round here."""
    spectrum = RoughnessSpectrum.self_affine(22e-6, 0.86, 1e3, 3992.9, 3.2e4)
    surfaces = Surfaces.random(spectrum, 128, 2 * pi * 4 / 3992.9)
    skin = Layered(40e6, 0.5, 200e-6, 10e3, 0.5)
    found = BoundaryElements(surfaces, skin).solve([3e3, 2e4, 1e5])
    assert bool(found.converged.all())
    assert int(found.iterations.max()) < 500
    assert bool((found.area_fraction.diff(dim=0) > 0).all())
    assert bool((found.mean_gap_m.diff(dim=0) < 0).all())
