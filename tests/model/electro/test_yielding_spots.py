"""Where contact spots yield the skin sinks: more gaps close, and the area follows from the load."""

from dataclasses import replace

import pytest
import torch

from benchmarks.yielding_spots import compared
from haptix import ContactModel, Finger, Screen
from haptix.model.electro.widening import sunk
from haptix.model.fidelity import MeanFieldBalance

SCREEN = Screen.preset("3m-sct3250")
DRY = Finger.preset("dry")


def test_gaps_of_even_density_are_narrower_by_the_share_that_closes() -> None:
    edges = torch.cat([torch.zeros(1), torch.logspace(-4, 0, 400)]).double()
    even = edges.diff()[None]  # gaps up to 1, and no contact
    for closed in (0.0, 0.1, 0.5):
        found = sunk(edges, even, torch.tensor([closed], dtype=torch.float64))[0]
        expected = (edges + closed).clamp(max=1.0).diff()
        assert found.tolist() == pytest.approx(expected.tolist(), abs=1e-8)


@pytest.mark.parametrize("hardness_pa", [5e7, 5e8])
def test_spots_and_gaps_share_the_area(hardness_pa: float) -> None:
    model = ContactModel(DRY.replace(hardness_pa=hardness_pa), SCREEN)
    fidelity, applied = model.solver.fidelity, torch.tensor([3e3, 2e4], dtype=torch.float64)
    gaps = fidelity.gap_mass(applied, None, applied).sum(-1)
    spots = fidelity.contact.area_fraction(applied)
    # Strips of the mean field leave out the last 1e-5 of the area.
    assert (gaps + spots).tolist() == pytest.approx([1.0, 1.0], abs=2e-5)


def test_yielded_spots_grow_as_the_load_and_the_pull_of_the_gaps() -> None:
    model = ContactModel(DRY, SCREEN)
    force = torch.tensor([0.1, 0.5, 1.0], dtype=torch.float64)
    driven, rest = (model.solve(force, volts, 4000.0) for volts in (200.0, 0.0))
    pulled = driven.gap_attraction_pa / (force / model.solver.terms.apparent_area_m2(force))
    assert (driven.mu / rest.mu - 1).tolist() == pytest.approx(pulled.tolist(), rel=1e-4)


@pytest.mark.parametrize(("hardness_pa", "is_same"), [(5e7, True), (4e7, False), (None, False)])
def test_a_table_is_lent_to_the_same_hardness_only(
    hardness_pa: float | None, is_same: bool
) -> None:
    contact = ContactModel(DRY, SCREEN).solver.fidelity.contact
    lender = MeanFieldBalance(contact)
    lender.prepare(torch.tensor([3e3, 2e4], dtype=torch.float64), None)
    assert MeanFieldBalance(replace(contact, hardness_pa=hardness_pa)).borrow(lender) is is_same


def test_skin_that_hardly_yields_is_elastic() -> None:
    elastic = ContactModel(DRY.replace(hardness_pa=None), SCREEN).solve(0.5, 150.0, 4000.0)
    hard = ContactModel(DRY.replace(hardness_pa=1e11), SCREEN).solve(0.5, 150.0, 4000.0)
    for name in ("mu", "gap_attraction_pa", "mean_gap_m", "capacitance_f"):
        assert float(getattr(hard, name)) == pytest.approx(float(getattr(elastic, name)), rel=1e-6)


def test_friction_follows_a_hardness_that_is_learned() -> None:
    def mu(hardness: torch.Tensor) -> torch.Tensor:
        return ContactModel(DRY.replace(hardness_pa=hardness), SCREEN).solve(0.3, 150.0, 4000.0).mu

    hardness = torch.tensor(4e8, dtype=torch.float64, requires_grad=True)
    (slope,) = torch.autograd.grad(mu(hardness), hardness)
    low, high = (float(mu(torch.tensor(f * 4e8, dtype=torch.float64))) for f in (0.999, 1.001))
    assert float(slope) == pytest.approx((high - low) / 8e5, rel=1e-3)


def test_boundary_elements_with_a_hardness_have_the_theory_s_ratio() -> None:
    """A finger has 13 to 18 waves of the roll-off under it, as boxes of four by four."""
    rows = [row for row in compared() if row.group and row.cell.waves == 4]
    assert len(rows) >= 4
    over = torch.cat([row.theory / row.elements for row in rows])
    # Elastic gaps, the narrowest of which yielding closes, have up to five times the ratio.
    assert float(over.min()) > 0.5
    assert float(over.max()) < 2.0
