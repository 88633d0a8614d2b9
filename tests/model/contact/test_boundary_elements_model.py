"""Ensembles, attraction and its snap-in, and everything that is refused before the work."""

from math import pi
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from haptix.base.errors import FileFormatError, InputError
from haptix.model.contact import HalfSpace, RoughnessSpectrum
from haptix.model.contact.boundary_elements import (
    BoundaryElements,
    Surfaces,
    ensemble,
    estimated_bytes,
)
from haptix.model.contact.boundary_elements.bounded import BoundedProblem
from haptix.model.contact.boundary_elements.coupled import AttractedContacts

UNIT = HalfSpace(1.0, 0.0)
WAVE = 2 * pi


@pytest.fixture(scope="module")
def surfaces() -> Surfaces:
    spectrum = RoughnessSpectrum.self_affine(1.0, 0.8, WAVE, 4 * WAVE, 12 * WAVE)
    return Surfaces.random(spectrum, 96, 1.0, surfaces=3)


@pytest.fixture(scope="module")
def solver(surfaces: Surfaces) -> BoundaryElements:
    return BoundaryElements(surfaces, UNIT)


QUANTITIES = [
    "area_fraction",
    "area_fraction_raw",
    "mean_gap_m",
    "gap_quantiles_m",
    "attraction_gaps_pa",
    "attraction_spots_pa",
    "status",
    "snap_in_strength",
]


def assert_same(a: Any, b: Any, names: list[str] = QUANTITIES) -> None:
    for name in names:
        torch.testing.assert_close(
            getattr(a, name), getattr(b, name), rtol=0, atol=0, equal_nan=True
        )


# ---- ensembles


def test_a_batch_is_its_surfaces(surfaces: Surfaces, solver: BoundaryElements) -> None:
    loads = [3.0, 0.3]
    together = BoundaryElements(surfaces, UNIT, at_a_time=3).solve(loads)
    alone = solver.solve(loads)
    assert alone.area_fraction.shape == (2, 3)
    assert alone.gap_quantiles_m.shape == (2, 3, 32)
    assert bool((alone.area_fraction[0] > alone.area_fraction[1]).all())
    # A surface's steps depend on its batch where one of its neighbours meets a bound: within the
    # tolerance, 1e-5 of h_rms = 1.
    torch.testing.assert_close(together.mean_gap_m, alone.mean_gap_m, rtol=0, atol=1e-5)
    difference = (together.area_fraction_raw - alone.area_fraction_raw).abs().max()
    assert float(difference) <= 2 / 96**2


def test_threads_change_nothing(solver: BoundaryElements) -> None:
    one = solver.solve([0.3, 1.0])
    before = torch.get_num_threads()
    torch.set_num_threads(2)
    try:
        two = solver.solve([0.3, 1.0])
        assert torch.get_num_threads() == 2
    finally:
        torch.set_num_threads(before)
    assert_same(one, two)


def test_an_interrupted_ensemble_resumes(solver: BoundaryElements, tmp_path: Path) -> None:
    path = tmp_path / "ensemble.npz"
    seen: list[tuple[int, int]] = []

    def interrupt(done: int, of: int) -> None:
        seen.append((done, of))
        if done == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        solver.solve([0.3, 1.0], checkpoint=path, progress=interrupt)
    assert [p.name for p in tmp_path.iterdir()] == ["ensemble.npz"]
    resumed = solver.solve([0.3, 1.0], checkpoint=path, progress=lambda *at: seen.append(at))
    assert seen == [(1, 3), (2, 3), (3, 3)]
    assert_same(resumed, solver.solve([0.3, 1.0]))
    solver.solve([0.3, 1.0], checkpoint=path, progress=lambda *at: seen.append(at))
    assert len(seen) == 3


def test_a_foreign_or_damaged_checkpoint_is_refused(
    solver: BoundaryElements, tmp_path: Path
) -> None:
    path = tmp_path / "ensemble.npz"
    solver.solve(0.3, checkpoint=path)
    with pytest.raises(FileFormatError, match="other surfaces"):
        solver.solve(0.4, checkpoint=path)
    path.write_bytes(path.read_bytes()[:100])
    with pytest.raises(FileFormatError, match="checkpoint"):
        solver.solve(0.3, checkpoint=path)


# ---- attraction


def test_an_attraction_that_is_the_same_everywhere_is_a_pressure(solver: BoundaryElements) -> None:
    pulled = solver.solve_attracted([0.3, 1.0], lambda u: torch.full_like(u, 0.5), [0.0, 1.0])
    pressed = solver.solve([0.3, 1.0, 0.8, 1.5])
    assert pulled.area_fraction.shape == (2, 2, 3)
    order = [0, 2, 1, 3]
    # The strength is met to 3e-4, and the contact's level to the tolerance, 1e-5 of h_rms = 1.
    expected = pressed.mean_gap_m[order].reshape(2, 2, 3)
    torch.testing.assert_close(pulled.mean_gap_m, expected, rtol=3e-4, atol=1e-5)
    torch.testing.assert_close(
        pulled.attraction_pa[:, 1], torch.full((2, 3), 0.5, dtype=torch.float64)
    )
    assert bool((pulled.attraction_pa[:, 0] == 0).all())
    share = pulled.attraction_spots_pa[:, 1] / 0.5
    torch.testing.assert_close(share, pulled.area_fraction_raw[:, 1])


def settle(
    surface: Surfaces, pressure: float, strength: float, h0: float
) -> tuple[float, float, float]:
    """Area, mean gap and mean attraction by plain iteration at a fixed strength, from none."""
    problem = BoundedProblem.on_grid(UNIT, surface.points, surface.side_m)
    height = surface.height_m[:1]
    scale = height.std((-2, -1))
    traction, start = torch.zeros_like(height), None
    for _ in range(2000):
        heights = height + problem.levels[0].displacement(traction)
        mean = pressure + traction.mean((-2, -1))
        solved = problem.solve(heights, mean, scale, 1e-7, start)
        start = solved.pressure_pa
        new = strength * (h0 / (solved.gap_m.clamp(min=0) + h0)) ** 2
        change = float((new - traction).abs().max()) / strength
        traction = new
        if change < 1e-5:
            break
    gap = float(solved.gap_m.clamp(min=0).mean())
    return float((start > 0).double().mean()), gap, float(traction.mean())


@pytest.mark.parametrize("strength", [3.0, pytest.param(12.0, marks=pytest.mark.slow)])
def test_plain_rounds_at_fixed_strength_end_in_the_same_state(
    surfaces: Surfaces, solver: BoundaryElements, strength: float
) -> None:
    h0 = 0.3
    found = solver.solve_attracted(0.3, lambda u: (h0 / (u + h0)) ** 2, strength)
    area, gap, attraction = settle(surfaces, 0.3, strength, h0)
    # The strength is met to 3e-4, and the attraction's shape to 3e-4; where a contact gives way the
    # gaps answer a few times as strongly. The area is a count of a few hundred pixels.
    assert float(found.attraction_pa[0, 0, 0]) == pytest.approx(attraction, rel=3e-3)
    assert float(found.mean_gap_m[0, 0, 0]) == pytest.approx(gap, rel=3e-3)
    assert float(found.area_fraction_raw[0, 0, 0]) == pytest.approx(area, rel=1e-2)
    assert bool(found.converged.all())


@pytest.mark.slow
def test_attracted_contacts_of_a_batch_are_those_of_each_alone(surfaces: Surfaces) -> None:
    height = surfaces.height_m[:2]
    applied, pull = torch.tensor([[0.3, 0.6], [0.5, 3.0]], dtype=torch.float64)
    thickness = torch.tensor([0.3, 1.0], dtype=torch.float64)[:, None, None]

    def contacts(at: slice, ceiling: float | None = None) -> AttractedContacts:
        h0 = thickness[at]
        solid = BoundedProblem.on_grid(UNIT, surfaces.points, surfaces.side_m, ceiling)
        return AttractedContacts(
            solid, height[at], applied[at], lambda u: (h0 / (u + h0)) ** 2, 1e-5
        )

    both = contacts(slice(2))
    strength = both.strength(pull)
    assert bool(both.converged.all())
    for row in (slice(1), slice(1, 2)):
        alone = contacts(row)
        # Each is solved on its own but for the pixels that stop or go on with the batch: the
        # residual's 1e-5 of h_rms is a ten-thousandth of these insulators.
        torch.testing.assert_close(strength[row], alone.strength(pull[row]), rtol=1e-4, atol=0)
        spots = (field.contact.pressure_pa > 0 for field in (alone, both))
        apart = next(spots)[0] ^ next(spots)[row][0]
        assert float(apart.double().mean()) < 1e-3

    # A surface that would yield as a whole keeps its state; the other is solved as before.
    yielding = contacts(slice(2), ceiling=4.0)
    unmoved = yielding.contact.pressure_pa[1].clone()
    found = yielding.strength(torch.tensor([0.5, 9.0], dtype=torch.float64))
    by_itself = contacts(slice(1), ceiling=4.0).strength(pull[:1])
    torch.testing.assert_close(found[:1], by_itself, rtol=1e-4, atol=0)
    assert torch.equal(yielding.contact.pressure_pa[1], unmoved)
    assert yielding.attraction_pa.tolist() == [0.5, 0.0]


@pytest.mark.slow
def test_snap_in_is_bracketed() -> None:
    # A wave whose crests stick: past some strength the contact spreads over its flanks at once.
    x = np.arange(96) / 96
    wave = 0.01 * np.cos(WAVE * x)[:, None] * np.cos(WAVE * x)[None]
    surface = Surfaces(torch.from_numpy(wave)[None], 1.0, WAVE, 2 * WAVE, 1.0)
    solver = BoundaryElements(surface, UNIT, tolerance=1e-7)
    h0, pressure = 1e-3, 1e-4
    found = solver.solve_attracted(pressure, lambda u: (h0 / (u + h0)) ** 2, [0.01, 0.04, 0.1, 1.0])
    assert found.status[0, :, 0].tolist() == [0, 0, 1, 1]
    low, high = found.snap_in_strength[0, 0, 0].tolist()
    assert low < high <= 1.03 * low
    end = float(found.area_fraction_raw[0, 2, 0])
    assert float(found.area_fraction_raw[0, 3, 0]) == end
    # At fixed strength plain rounds stay on the branch below the bracket and leave it above.
    # Contacts grow by rings of pixels here, of which one moves the strength by about 1 %.
    below, _, _ = settle(surface, pressure, 0.98 * low, h0)
    above, _, _ = settle(surface, pressure, 1.02 * high, h0)
    assert below <= end * 1.01
    assert above > end * 1.1


@pytest.fixture(scope="module")
def single(surfaces: Surfaces) -> BoundaryElements:
    height = surfaces.height_m[:1]
    one = Surfaces(height, 1.0, surfaces.q_low, surfaces.q_high, surfaces.waves_in_box)
    return BoundaryElements(one, UNIT)


def test_a_thin_insulator_under_a_rough_skin_is_solved(
    surfaces: Surfaces, single: BoundaryElements
) -> None:
    # h0 a hundredth of h_rms: contacts solved to a share of h_rms left noise in the attraction, and
    # the iteration never settled.
    h0 = 0.01
    found = single.solve_attracted(0.3, lambda u: (h0 / (u + h0)) ** 2, [1.0, 10.0])
    assert bool(found.converged.all())
    assert bool((found.attraction_pa.diff(dim=1) > 0).all())
    area, gap, attraction = settle(surfaces, 0.3, 10.0, h0)
    # As above; of the few pixels that stick one more or less is a per cent.
    assert float(found.attraction_pa[0, 1, 0]) == pytest.approx(attraction, rel=0.02)
    assert float(found.mean_gap_m[0, 1, 0]) == pytest.approx(gap, rel=0.01)
    assert float(found.area_fraction_raw[0, 1, 0]) == pytest.approx(area, rel=0.02)


def test_the_branch_ends_with_light_contact_where_asked(single: BoundaryElements) -> None:
    h0, pressure = 0.3, 0.3

    def attraction(gap: torch.Tensor) -> torch.Tensor:
        return (h0 / (gap + h0)) ** 2

    whole = single.solve_attracted(pressure, attraction, [3.0, 12.0])
    assert float(whole.attraction_gaps_pa[0, 1, 0]) > pressure
    light = single.solve_attracted(pressure, attraction, [3.0, 12.0, 50.0], light_limit=2.0)
    torch.testing.assert_close(
        light.area_fraction[0, 0], whole.area_fraction[0, 0], rtol=2e-3, atol=0
    )
    assert light.status[0, :, 0].tolist() == [0, 1, 1]
    low, high = light.snap_in_strength[0, 0, 0].tolist()
    assert 3 < low < high <= 1.03 * low
    assert high < 12
    # The end is met to 2 % of the strength, and the gaps' attraction rises no faster.
    assert float(light.attraction_gaps_pa[0, -1, 0]) == pytest.approx(pressure, rel=0.03)
    # How far is asked does not matter.
    nearer = single.solve_attracted(pressure, attraction, 15.0, light_limit=2.0)
    assert nearer.snap_in_strength[0, 0, 0].tolist() == pytest.approx([low, high], rel=0.02)
    with pytest.raises(InputError, match="light_limit"):
        single.solve_attracted(pressure, attraction, 1.0, light_limit=1.0)


def test_a_pull_that_makes_all_yield_is_past_the_end(surfaces: Surfaces) -> None:
    hard = BoundaryElements(surfaces, UNIT, hardness_pa=2.0)
    found = hard.solve_attracted(0.5, lambda u: (0.5 / (u + 0.5)) ** 2, [0.5, 50.0])
    assert found.status[0].tolist() == [[0] * 3, [1] * 3]
    for values in (found.area_fraction, found.mean_gap_m, found.attraction_pa):
        assert bool(values.isfinite().all())
    assert bool((0.5 + found.attraction_pa < 2.0).all())


# ---- refusals


@pytest.mark.parametrize("bad", [0.0, -1.0, float("nan"), float("inf"), [[1.0]], []])
def test_impossible_pressures(solver: BoundaryElements, bad: Any) -> None:
    with pytest.raises(InputError, match="pressure_pa"):
        solver.solve(bad)


def test_loads_beyond_full_contact_or_the_hardness(
    surfaces: Surfaces, solver: BoundaryElements
) -> None:
    full = float(solver.full_contact_pressure().min())
    with pytest.raises(InputError, match=f"{full:.4g} Pa"):
        solver.solve([0.3, 1.01 * full])
    hard = BoundaryElements(surfaces, UNIT, hardness_pa=2.0)
    with pytest.raises(InputError, match="hardness, 2 Pa"):
        hard.solve(2.5)


@pytest.mark.parametrize("bad", [[], [2.0, 1.0], [-1.0], [float("nan")], [float("inf")]])
def test_impossible_strengths(solver: BoundaryElements, bad: list[float]) -> None:
    with pytest.raises(InputError, match="strength"):
        solver.solve_attracted(0.3, lambda u: 1 / (1 + u), bad)


@pytest.mark.parametrize("bad", [lambda u: u, lambda u: -1 / (1 + u), lambda u: 1 / u])
def test_impossible_attractions(solver: BoundaryElements, bad: Any) -> None:
    with pytest.raises(InputError, match="attraction"):
        solver.solve_attracted(0.3, bad, 1.0)


def test_impossible_settings(surfaces: Surfaces) -> None:
    with pytest.raises(InputError, match="hardness_pa"):
        BoundaryElements(surfaces, UNIT, hardness_pa=0.0)
    with pytest.raises(InputError, match="tolerance"):
        BoundaryElements(surfaces, UNIT, tolerance=0.1)
    with pytest.raises(InputError, match="at_a_time"):
        BoundaryElements(surfaces, UNIT, at_a_time=0)


def test_too_little_memory_is_said_before_the_work(
    solver: BoundaryElements, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ensemble, "free_bytes", lambda device: estimated_bytes(96, 1) - 1)
    with pytest.raises(InputError, match="GiB free on cpu"):
        solver.solve(0.3)
    with pytest.raises(InputError, match="GiB"):
        solver.solve_attracted(0.3, lambda u: 1 / (1 + u), 1.0)


@pytest.mark.optional
@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a GPU that torch can use")
def test_a_gpu_agrees(surfaces: Surfaces, solver: BoundaryElements) -> None:
    found = BoundaryElements(surfaces, UNIT, device="cuda").solve([0.3, 3.0])
    expected = solver.solve([0.3, 3.0])
    # Within the tolerance, 1e-5 of h_rms = 1, and a pixel or two.
    torch.testing.assert_close(found.mean_gap_m, expected.mean_gap_m, rtol=0, atol=1e-5)
    torch.testing.assert_close(
        found.area_fraction_raw, expected.area_fraction_raw, rtol=0, atol=2 / 96**2
    )
