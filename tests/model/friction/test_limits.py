"""No state is OK where the model has no physics: past each declared limit its status says which."""

from __future__ import annotations

import pytest
import torch

from haptix import ContactModel, Finger, Screen, Status
from haptix.model.status import LIMITS

STATES = 6_000


@pytest.fixture(scope="module")
def screen() -> Screen:
    return Screen.preset("3m-sct3250")


def test_a_wet_finger_at_the_highest_voltage_is_not_ok(screen: Screen) -> None:
    state = ContactModel(Finger.preset("wet"), screen).solve(0.7, 200.0, 125.0)
    assert float(state.mu) > 5
    assert Status(int(state.status)) == Status.FRICTION
    assert any("friction above 5" in words for words in state.warnings())


def test_no_state_past_a_limit_is_ok() -> None:
    """Fingers, screens, forces, voltages and frequencies at random, many beyond any finger."""
    draw = torch.Generator().manual_seed(12)

    def spread(low: float, high: float, *shape: int) -> torch.Tensor:
        share = torch.rand(shape, generator=draw, dtype=torch.float64)
        return low * (high / low) ** share

    found: set[int] = set()
    models = 4
    for number in range(models):
        finger = Finger.preset(("semi-wet", "wet", "dry")[number % 3])
        factor = {name: float(spread(0.3, 3.0)) for name in ("modulus", "tau", "area")}
        finger = finger.replace(
            youngs_modulus_pa=finger.youngs_modulus_pa * factor["modulus"],
            frictional_shear_stress_pa=finger.frictional_shear_stress_pa * factor["tau"],
            apparent_area_at_1n_m2=finger.apparent_area_at_1n_m2 * factor["area"],
        )
        screen = Screen(
            insulator_thickness_m=float(spread(1e-7, 1e-4)), max_voltage_v=float(spread(50, 2000))
        )
        if (
            number == models - 1
        ):  # hardly any other breaks down in gaps before its friction is past 5
            finger = Finger.preset("semi-wet")
            screen = Screen(insulator_thickness_m=1.1e-5, max_voltage_v=1500.0)
        model, size = ContactModel(finger, screen), STATES // 3
        # A few frequencies, since each has a table of its own.
        force, frequency = spread(0.02, 5.0, size), spread(10.0, 1e5, 5).repeat(size // 5)
        voltage = screen.max_voltage_v * torch.rand(size, generator=draw, dtype=torch.float64)
        state = model.solve(force, voltage, frequency)
        ok = state.status == Status.OK
        real_area = finger.apparent_area_m2(force) * state.area_fraction
        pressure = force / real_area + state.attraction_pa / state.area_fraction
        broken = state.pull_past_breakdown * state.gap_attraction_pa / state.attraction_pa
        assert bool((state.mu[ok] <= LIMITS[Status.FRICTION].most).all())
        assert bool((pressure[ok] <= LIMITS[Status.PRESSURE].most * (1 + 1e-12)).all())
        # Here a bin of gaps, 4 % wide, that the boundary crosses counts in part, there not at all
        # or whole: 4 % of its gaps' share at most.
        assert bool((broken[ok & (voltage > 1)] <= LIMITS[Status.BREAKDOWN].most + 0.04).all())
        past = state.status == Status.BREAKDOWN
        assert bool((broken[past] >= LIMITS[Status.BREAKDOWN].most - 0.04).all())
        assert bool((voltage[ok] <= state.pull_in_voltage_v[ok]).all())
        assert state.spot_pressure_pa.tolist() == pytest.approx(pressure.tolist(), rel=1e-12)
        found |= set(state.status.unique().tolist())
    assert found == {int(Status.OK), *map(int, LIMITS)}  # so that each was tried


def test_a_finger_of_the_paper_breaks_down_nowhere(screen: Screen) -> None:
    """Its share stays near 0.61 up to 200 V, also where spots lift the gaps beside them."""
    force = torch.logspace(-1, 0, 12, dtype=torch.float64)[:, None, None]
    frequency = torch.tensor([31.6, 111.56, 1e3, 1e4], dtype=torch.float64)[:, None]
    model = ContactModel(Finger.preset("semi-wet"), screen)
    state = model.solve(force, torch.linspace(1, 200, 40, dtype=torch.float64), frequency)
    broken = state.pull_past_breakdown * state.gap_attraction_pa / state.attraction_pa
    assert float(broken.max()) < 0.65
    assert not bool((state.status == Status.BREAKDOWN).any())
