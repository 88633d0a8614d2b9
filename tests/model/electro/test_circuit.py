"""The contact's capacitance, conductance and current."""

from math import pi

import pytest
import torch

from haptix import ContactModel, Finger, Screen
from haptix.model.electro import VACUUM_PERMITTIVITY
from haptix.model.electro.attraction import Circuit, bin_inverse
from haptix.model.finger import Roughness

SCREEN = Screen(max_voltage_v=1000.0)
GEL = Finger(name="gel")
EPS0, AREA = VACUUM_PERMITTIVITY, GEL.apparent_area_at_1n_m2


def test_gaps_and_spots_are_side_by_side() -> None:
    one = torch.ones(1, dtype=torch.float64)
    for h0 in (2e-7, 2e-7 - 1e-7j):
        circuit = Circuit.of_one(torch.tensor(h0, dtype=torch.complex128), 3 * one, states=1)
        # A tenth in contact, the rest a plate at 2 um, in a medium of eps_g = 3 that counts in h0.
        found = circuit.capacitance_f(0.9 / (2e-6 + torch.tensor(h0)), 0.1 * one, 1e-5 * one)
        expected = 3 * EPS0 * 1e-5 * (0.9 / (2e-6 + h0) + 0.1 / h0)
        assert complex(found[0]) == pytest.approx(expected, rel=1e-6)


def test_the_mean_over_a_bin() -> None:
    edges = 1e-6 * 1.042 ** torch.arange(5, dtype=torch.float64)
    thickness = torch.tensor([1e-9, 3e-7 - 2e-7j], dtype=torch.complex128)
    low, high = edges[:-1] + thickness[:, None], edges[1:] + thickness[:, None]
    exact = torch.log(high / low) / (high - low)
    # The next term of the series is (width / gap)^4 / 80 = 4e-8.
    torch.testing.assert_close(bin_inverse(edges, thickness), exact, rtol=1e-7, atol=0)


def smooth(h_rms_m: float) -> Finger:
    rough = Roughness(h_rms_m=h_rms_m, q0_per_m=1e3, q_rolloff_per_m=1e4, q1_per_m=1e7)
    return GEL.replace(roughness=rough, youngs_modulus_pa=1e5)


def test_complete_contact_is_the_insulators_capacitor() -> None:
    # Nearly flat, soft skin closes; h0 is 1e4 times the roughness, so that gaps do not matter.
    model = ContactModel(smooth(1e-10), SCREEN, terms={"apparent-area": False})
    for h0 in (1e-6, 3e-6):
        state = model.solve(1.0, 0.0, None, h0)
        assert float(state.capacitance_f) == pytest.approx(EPS0 * AREA / h0, rel=2e-4)
        assert state.current_a is None
        assert float(state.conductance_s) == 0.0


def test_leaking_skin_and_gap_conduct() -> None:
    resistivity, frequency, h0 = 1e4, 125.0, 1e-6
    screen = SCREEN.replace(gap_resistivity_ohm_m=resistivity)
    model = ContactModel(GEL, screen, terms={"skin-dielectric": False})
    state = model.solve(1.0, 50.0, frequency, h0)
    # The gap conducts so well that the film alone is left of the circuit.
    angular = 2 * pi * frequency
    admittance = complex(float(state.conductance_s), -angular * float(state.capacitance_f))
    film = EPS0 * AREA / h0
    gap_s = AREA / (resistivity * float(state.mean_gap_m))
    assert gap_s > 100 * angular * film  # so that the next lines test what they say
    assert admittance.imag == pytest.approx(-angular * film, rel=0.02)
    assert float(state.current_a) == pytest.approx(50.0 * abs(admittance), rel=1e-12)
    # Skin that conducts: its power is the conductance's, never negative.
    lossy = ContactModel(GEL, SCREEN).solve(1.0, 50.0, torch.tensor([10.0, 1e3, 1e5]))
    assert bool((lossy.conductance_s > 0).all())


@pytest.mark.parametrize("fidelity", ["mean-field", "closed-form"])
def test_the_capacitance_lies_between_its_bounds(fidelity: str) -> None:
    state = ContactModel(GEL, SCREEN, fidelity=fidelity).solve(
        torch.tensor([0.1, 1.0]), torch.tensor([[0.0], [100.0]]), None, 2e-7
    )
    area = GEL.apparent_area_m2(torch.tensor([0.1, 1.0], dtype=torch.float64))
    per_area = state.capacitance_f / (EPS0 * area)
    # By Jensen's inequality not below the plate of the mean gap, nor above the root mean square.
    assert bool((per_area > 1 / (state.mean_gap_m + 2e-7)).all())
    strength = EPS0 / 4 * 100.0**2
    assert bool((per_area[1] < (state.attraction_pa[1] / strength).sqrt()).all())
    assert bool((per_area[1] > per_area[0]).all())


def test_equal_insulators_share_a_column() -> None:
    h0 = torch.tensor([2e-7, 1e-7 - 1e-7j, 2e-7, 1e-7 + 1e-7j, 2e-7, 1e-7 - 1e-7j])
    medium = torch.tensor([1.0, 1.0, 1.0, 1.0, 3.0, 1.0])
    column = torch.tensor([5, 4, 3, 2, 1, 0, 0, 4])
    circuit = Circuit(h0, medium, column)
    shared = circuit.shared()
    assert len(shared.thickness_m) == 4  # the third and the last are like earlier ones
    for kept, of_all in ((shared.thickness_m, h0), (shared.medium, medium)):
        assert torch.equal(kept[shared.column], of_all[column])
    h0.requires_grad_()  # each has a gradient of its own
    assert Circuit(h0, medium, column).shared().column is column
