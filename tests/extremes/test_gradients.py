"""Gradients of mu by inputs and by the finger's own materials, against central differences."""

from collections.abc import Iterator
from unittest.mock import Mock

import pytest
import torch
from torch import Tensor

from haptix import ContactModel, ContactState, Finger, Screen, Status
from haptix.model.electro import AttractionTable
from haptix.model.finger import Roughness

AT = {
    "normal_force_n": 0.5,
    "h0_m": 2e-7,
    "youngs_modulus_pa": 40e6,
    "layer_thickness_m": 200e-6,
    "frictional_shear_stress_pa": 8e6,
    "h_rms_m": 22e-6,
}
MODELS = {
    "plain": {},
    "spots, combined": {"contact_spots": "included", "gap_distribution": "combined"},
    "finite size": {"terms": {"finite-size": True}},
    "closed form": {"fidelity": "closed-form"},
}


def solve(values: dict[str, Tensor | float], voltage: Tensor | float, model: str) -> ContactState:
    finger = Finger(
        youngs_modulus_pa=values["youngs_modulus_pa"],
        layer_thickness_m=values["layer_thickness_m"],
        frictional_shear_stress_pa=values["frictional_shear_stress_pa"],
        bulk_modulus_pa=1e5,
        roughness=Roughness(h_rms_m=values["h_rms_m"]),
    )
    contact = ContactModel(finger, Screen(max_voltage_v=5000.0), **MODELS[model])
    return contact.solve(values["normal_force_n"], voltage, 200.0, values["h0_m"])


# Directions in the logarithms of the numbers: all together, so that every part raises mu and none
# hides another; and each alone, which is slow.
ALONE = {name: {name: 1.0} for name in AT}
TOGETHER = {
    "normal_force_n": -0.3,
    "h0_m": -0.4,
    "youngs_modulus_pa": -0.5,
    "layer_thickness_m": -0.6,
    "frictional_shear_stress_pa": 0.2,
    "h_rms_m": -0.3,
}
# One model's checks belong to the ordinary run; the others take as long again.
EACH_MODEL = [
    pytest.param(model, marks=() if model in ("plain", "closed form") else pytest.mark.slow)
    for model in MODELS
]
CHECKS = [
    pytest.param(*each.values, TOGETHER, id=f"{each.values[0]}: all together", marks=each.marks)
    for each in EACH_MODEL
]
CHECKS += [
    pytest.param("plain", direction, id=f"plain: {name}", marks=pytest.mark.slow)
    for name, direction in ALONE.items()
]


@pytest.mark.parametrize(("model", "direction"), CHECKS)
def test_gradients_of_everything(model: str, direction: dict[str, float]) -> None:
    end = float(solve(AT, 0.0, model).pull_in_voltage_v)
    voltages = torch.tensor([0.0, 0.5, 0.9, 0.99], dtype=torch.float64) * end
    leaves = {
        name: torch.tensor(AT[name], dtype=torch.float64).requires_grad_() for name in direction
    }
    mu = solve({**AT, **leaves}, voltages, model).mu
    # Five points with steps of 2e-4: 1e-9 of curvature away from the end, where mu bends on the
    # scale of 1 - V/V_end, and 1e-10 of rounding and of the tables' own roughness.
    step = 2e-4
    value = {
        side: solve(
            {name: at * (1 + side * step * direction.get(name, 0.0)) for name, at in AT.items()},
            voltages,
            model,
        ).mu
        for side in (-2, -1, 1, 2)
    }
    expected = (8 * (value[1] - value[-1]) - (value[2] - value[-2])) / (12 * step)
    # One backward pass for all voltages: each weighs as much as the others, but where mu hardly
    # depends on a number (h0 at V0 = 0), since there the difference is noise.
    weight = 1 / (expected.abs() + 1e-3 * mu.detach())
    slopes = torch.autograd.grad((weight * mu).sum(), list(leaves.values()))
    found = sum(
        along * AT[name] * float(slope)
        for slope, (name, along) in zip(slopes, direction.items(), strict=True)
    )
    assert found == pytest.approx(float((weight * expected).sum()), abs=1e-4)


@pytest.mark.parametrize("model", EACH_MODEL)
def test_gradients_by_voltage(model: str) -> None:
    end = float(solve(AT, 0.0, model).pull_in_voltage_v)
    voltages = torch.tensor([0.0, 0.1, 0.5, 0.9, 0.99], dtype=torch.float64) * end
    leaf = voltages.clone().requires_grad_()
    (found,) = torch.autograd.grad(solve(AT, leaf, model).mu.sum(), leaf)
    steps = torch.tensor([-2, -1, 1, 2], dtype=torch.float64)[:, None] * 2e-4
    value = solve(AT, voltages * (1 + steps), model).mu
    expected = (8 * (value[2] - value[1]) - (value[3] - value[0])) / (12 * 2e-4)
    # As above; at V0 = 0 both are zero.
    torch.testing.assert_close(found * voltages, expected, rtol=1e-4, atol=1e-9)
    assert float(found[0]) == 0.0


@pytest.mark.parametrize(  # a limit, and a moving one
    "model", ["closed form", pytest.param("finite size", marks=pytest.mark.slow)]
)
def test_gradients_of_the_end(model: str) -> None:
    names = [name for name in AT if name != "frictional_shear_stress_pa"]  # it moves no end
    leaves = {name: torch.tensor(AT[name], dtype=torch.float64).requires_grad_() for name in names}
    end = solve({**AT, **leaves}, 0.0, model).pull_in_voltage_v
    found = torch.autograd.grad(end, list(leaves.values()), materialize_grads=True)
    for name, slope in zip(names, found, strict=True):
        sides = [
            float(solve({**AT, name: AT[name] * (1 + side * 2e-4)}, 0.0, model).pull_in_voltage_v)
            for side in (-1, 1)
        ]
        expected = (sides[1] - sides[0]) / 4e-4
        assert float(slope) * AT[name] == pytest.approx(expected, rel=1e-4), name


def test_gradients_beside_and_past_the_end_are_finite() -> None:
    end = float(solve(AT, 0.0, "plain").pull_in_voltage_v)
    leaves = {name: torch.tensor(v, dtype=torch.float64).requires_grad_() for name, v in AT.items()}
    shares = [0.99, 0.9999, 1 - 1e-9, 1 + 1e-9, 2.0]
    state = solve(leaves, torch.tensor(shares, dtype=torch.float64) * end, "plain")
    assert (state.status == int(Status.PULL_IN)).tolist() == [False] * 3 + [True] * 2
    # One that is not finite makes the sum so.
    slopes = torch.autograd.grad(state.mu.sum(), list(leaves.values()))
    assert all(bool(slope.isfinite()) for slope in slopes)


def test_past_the_end_mu_follows_the_load() -> None:
    # There p = 31 p0, so mu = tau_f A(31 p0) A0/F hardly depends on the force.
    end = float(solve(AT, 0.0, "plain").pull_in_voltage_v)
    force = torch.tensor(0.5, dtype=torch.float64).requires_grad_()
    mu = solve({**AT, "normal_force_n": force}, 1.5 * end, "plain").mu
    (slope,) = torch.autograd.grad(mu, force)
    up, down = (
        float(solve({**AT, "normal_force_n": 0.5 * (1 + s)}, 1.5 * end, "plain").mu)
        for s in (1e-4, -1e-4)
    )
    at = float(mu.detach())
    assert float(slope) * 0.5 / at == pytest.approx((up - down) / 2e-4 / at, abs=1e-3)


@pytest.fixture
def two_threads() -> Iterator[None]:
    before = torch.get_num_threads()
    torch.set_num_threads(2)
    yield
    torch.set_num_threads(before)


@pytest.mark.parametrize("fails", [False, True])
def test_backward_runs_on_one_thread_and_gives_the_others_back(
    two_threads: None, fails: bool
) -> None:
    # On two threads a backward pass took ten times the forward, since they wait by spinning.
    force = torch.tensor([0.3, 0.5], dtype=torch.float64).requires_grad_()
    seen: list[int] = []

    def watch(_: Tensor) -> None:
        seen.append(torch.get_num_threads())
        if fails:
            raise RuntimeError("stop")

    given = force * 1.0
    given.register_hook(watch)  # the last to be reached
    state = solve({**AT, "normal_force_n": given}, 10.0, "closed form")
    total = (state.mu + state.area_fraction).sum()
    if fails:
        with pytest.raises(RuntimeError, match="stop"):
            total.backward()
    else:
        total.backward()
    assert seen == [1]
    assert torch.get_num_threads() == 2


def test_one_table_serves_all_blocks_of_a_material_that_is_differentiated(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("haptix.model.friction.solver.BLOCK", 2)
    solve_table = Mock(wraps=AttractionTable.solve)
    monkeypatch.setattr(AttractionTable, "solve", solve_table)
    modulus = torch.tensor(40e6, dtype=torch.float64).requires_grad_()
    voltages = torch.linspace(0.0, 5.0, 4, dtype=torch.float64)
    for _ in range(2):  # each call has a graph of its own, so a table too
        state = solve({**AT, "youngs_modulus_pa": modulus}, voltages, "plain")
        state.mu.sum().backward()
    assert solve_table.call_count == 2
