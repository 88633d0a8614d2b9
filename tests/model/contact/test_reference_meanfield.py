"""Published mean-field values: area, mean gap and attraction of an independent solver."""

from collections.abc import Callable
from typing import Any

import pytest
import torch

from haptix.model.contact import HalfSpace, Layered, MeanField, RoughnessSpectrum

NAMES = [
    "self-affine, half space",
    "self-affine, half space, combined gap variance",
    "finger, layered",
    "finger, layered, combined gap variance",
]
# The values carry a `resolution_change` of 2e-4 at most, except that of A, which is a closed form:
# 1e-6 there is the interpolation of tau(q), and 1e-3 and 2e-3 are ten times that change.
AREA, GAP, ATTRACTION = 1e-6, 1e-3, 2e-3

Solver = tuple[MeanField, dict[str, Any]]


@pytest.fixture(scope="module")
def solved(reference_cases: dict[str, dict[str, Any]]) -> Callable[[str], Solver]:
    made: dict[str, Solver] = {}

    def solver(name: str) -> Solver:
        if name not in made:
            case = reference_cases[name]
            rough, solid = case["roughness"], case["solid"]
            skin: HalfSpace | Layered = HalfSpace(solid["E"], solid["nu"])
            if "d" in solid:
                skin = Layered(
                    solid["E"], solid["nu"], solid["d"], solid["E_bulk"], solid["nu_bulk"]
                )
            spectrum = RoughnessSpectrum.self_affine(
                rough["h_rms"], rough["H"], rough["q0"], rough["qr"], rough["q1"]
            )
            made[name] = (MeanField(spectrum, skin, case["gamma"], case["gap_distribution"]), case)
        return made[name]

    return solver


def pressures(case: dict[str, Any]) -> torch.Tensor:
    return torch.tensor([row["p"] for row in case["rows"]], dtype=torch.float64)


def test_every_case_of_the_file_is_here(reference_cases: dict[str, Any]) -> None:
    assert list(reference_cases) == NAMES


@pytest.mark.parametrize("name", NAMES)
def test_real_contact_area(solved: Callable[[str], Solver], name: str) -> None:
    field, case = solved(name)
    expected = [row["area"] for row in case["rows"]]
    assert field.area_fraction(pressures(case)).tolist() == pytest.approx(expected, rel=AREA)


@pytest.mark.parametrize("name", NAMES)
def test_mean_gap(solved: Callable[[str], Solver], name: str) -> None:
    field, case = solved(name)
    expected = [row["ubar"] for row in case["rows"]]
    assert field.mean_gap(pressures(case)).tolist() == pytest.approx(expected, rel=GAP)


@pytest.mark.parametrize("name", NAMES)
def test_inverse_square_gap_at_real_and_complex_h0(
    solved: Callable[[str], Solver], name: str
) -> None:
    field, case = solved(name)
    for at, h0 in enumerate(case["h0"]):
        h0 = complex(*h0) if isinstance(h0, list) else h0
        included = field.inverse_square_gap(pressures(case), h0, contact_spots="included")
        expected = [row["I"][at] for row in case["rows"]]
        assert included.tolist() == pytest.approx(expected, rel=ATTRACTION)
        gaps_only = field.inverse_square_gap(pressures(case), h0, contact_spots="excluded")
        by_hand = [row["I"][at] - row["area"] / abs(h0) ** 2 for row in case["rows"]]
        assert gaps_only.tolist() == pytest.approx(by_hand, rel=ATTRACTION)


@pytest.mark.parametrize("name", NAMES)
def test_contact_spots_add_their_area_over_h0_squared(
    solved: Callable[[str], Solver], name: str
) -> None:
    field, case = solved(name)
    h0 = 1.5e-7 + 1e-7j
    included = field.inverse_square_gap(pressures(case), h0)
    excluded = field.inverse_square_gap(pressures(case), h0, "excluded")
    expected = field.area_fraction(pressures(case)) / abs(h0) ** 2
    # The difference of two numbers up to ten times larger: rounding alone.
    torch.testing.assert_close(included - excluded, expected, rtol=1e-12, atol=0)


# Physics page, section 5: H = 0.8, q1/q0 = 1e3, no roll-off, h_rms = q0 = E* = 1.
BARE = [(1e-4, 2.070566e-5, 4.5714), (1e-2, 2.070563e-3, 2.3627), (1e-1, 2.070333e-2, 1.2086)]


@pytest.mark.parametrize(("pressure", "area", "gap"), BARE)
def test_self_affine_surface_without_roll_off(pressure: float, area: float, gap: float) -> None:
    field = MeanField(RoughnessSpectrum.self_affine(1.0, 0.8, 1.0, 1.0, 1e3), HalfSpace(0.75, 0.5))
    # Half a unit of the last digit that is printed, and for the gap the resolution on top.
    assert float(field.area_fraction(pressure)) == pytest.approx(area, rel=5e-7)
    assert float(field.mean_gap(pressure)) == pytest.approx(gap, abs=5e-5, rel=2e-5)
