"""Terms of the model against benchmarks/oracle.py, a slow solver that shares no code with it."""

import json
import math
from copy import copy
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
import torch
from scipy.linalg import solve_banded
from torch import Tensor

from haptix import ContactModel, Finger, Screen, Status
from haptix.model.contact import THEORIES
from haptix.model.finger import Roughness
from haptix.model.friction import in_theory
from haptix.model.terms import TERMS
from tests.programs import load

# What is asked of the package's grids in I, as in test_independent_mean_field. The oracle's own
# error is 3e-4 with combined gaps (its nearly closed strips), 3e-5 with plain ones.
ATTRACTION = 2e-3
# Up to 0.7 of pull-in (p up to 2.7 p0 here, or resting on the highest asperity) an error of the
# attraction is at most doubled in the load; that of the attraction is usually below 1e-3.
FRICTION = 2e-3
GAP = 1e-3  # asked of the mean gap, as in test_independent_mean_field
# The oracle integrates the spectrum by 1e5 trapezia, to 1e-8; two digits to spare.
AREA = 1e-6

SCREEN = Screen(max_voltage_v=5000.0)
FINGER = in_theory(Finger.preset("semi-wet"), "corrected")  # the oracle spreads attraction evenly
STIFF = Finger(
    theory="corrected",
    youngs_modulus_pa=1e9,
    poisson_ratio=0.3,
    roughness=Roughness(h_rms_m=5e-6, hurst=0.6, q0_per_m=2e3, q_rolloff_per_m=2e4, q1_per_m=1e8),
)
FINGERS = {"layered": FINGER, "half-space": STIFF}


def tensor(*values: float) -> Tensor:
    return torch.tensor(values, dtype=torch.float64)


@pytest.fixture(scope="module")
def slow() -> ModuleType:
    return load("benchmarks/oracle.py")


@cache  # a layer's response in 40 digits takes a second
def elastic(slow: ModuleType, finger: Finger) -> Any:
    rough = finger.roughness
    solid = slow.Solid(
        finger.youngs_modulus_pa,
        finger.poisson_ratio,
        finger.layer_thickness_m,
        finger.bulk_modulus_pa,
        finger.bulk_poisson_ratio,
    )
    theory = {"corrected": slow.CORRECTED, "open-gaps": slow.PUBLISHED}[finger.theory]
    return slow.Oracle(self_affine(slow, rough), solid, theory)


def oracle_of(slow: ModuleType, finger: Finger) -> Any:
    oracle = copy(elastic(slow, finger.replace(hardness_pa=None)))
    oracle.hardness = finger.hardness_pa
    return oracle


def self_affine(slow: ModuleType, rough: Roughness) -> Any:
    return slow.SelfAffine(
        rough.h_rms_m, rough.hurst, rough.q0_per_m, rough.q_rolloff_per_m, rough.q1_per_m
    )


def nominal(finger: Finger, force: float) -> float:
    return float(finger.apparent_area_at_1n_m2 * force**finger.apparent_area_exponent)


def resting(slow: ModuleType, oracle: Any, model: ContactModel, force: float) -> float:
    """Pressure [Pa] of the highest asperity, 0 where the model has no finite size."""
    if "finite-size" not in model.terms:
        return 0.0
    area = nominal(model.finger, force)
    return oracle.touching_pressure(oracle.height(self_affine(slow, model.finger.roughness), area))


def apart(found: Tensor, expected: float) -> float:
    return abs(float(found) / expected - 1)


# --- area and gaps of the corrected theory


@pytest.mark.parametrize("name", ["layered", pytest.param("half-space", marks=pytest.mark.slow)])
def test_area_gap_and_pull(name: str, slow: ModuleType) -> None:
    finger = FINGERS[name]
    oracle = oracle_of(slow, finger)
    contact = THEORIES["corrected"].mean_field(finger.roughness.spectrum(), finger.solid())
    for pressure in (10.0, 1e3, 3e4, 1e6):
        # The package's table of the stress under the spots is right to 1e-5.
        assert apart(contact.area_fraction(pressure), oracle.area_fraction(pressure)) < 2e-5
        assert apart(contact.mean_gap(pressure), oracle.mean_gap(pressure)) < GAP
    for pressure in (1e3, 3e4, 1e6):
        for h0 in (3e-8, 2e-7, 1e-6 - 4e-7j):
            found = contact.inverse_square_gap(pressure, h0, contact_spots="excluded")
            expected = oracle.gap_attraction(pressure, complex(h0))
            assert apart(found, expected) < ATTRACTION, (pressure, h0)


@pytest.mark.slow
def test_combined_gaps_of_the_published_cases(slow: ModuleType) -> None:
    path = Path(__file__).parents[1] / "data" / "meanfield.json"
    for case in json.loads(path.read_text())["cases"]:
        if case["gap_distribution"] != "combined":
            continue
        rough, solid = case["roughness"], case["solid"]
        oracle = slow.Oracle(
            slow.SelfAffine(rough["h_rms"], rough["H"], rough["q0"], rough["qr"], rough["q1"]),
            slow.Solid(solid["E"], solid["nu"], solid.get("d", 0.0), solid.get("E_bulk"), 0.5),
            slow.Theory(case["gamma"], combined=True),
        )
        for row in case["rows"]:
            area = oracle.area_fraction(row["p"])
            for h0, expected in zip(case["h0"], row["I"], strict=True):
                found = oracle.gap_attraction(row["p"], complex(h0)) + area / h0**2
                # The published values moved by 2e-4 between their two resolutions.
                assert found == pytest.approx(expected, rel=5e-4)


# --- finite size


@pytest.mark.parametrize(
    ("name", "theory", "spots"),
    [
        ("layered", "corrected", "excluded"),
        pytest.param("layered", "open-gaps", "excluded", marks=pytest.mark.slow),
        pytest.param("half-space", "corrected", "excluded", marks=pytest.mark.slow),
        pytest.param("half-space", "open-gaps", "included", marks=pytest.mark.slow),
    ],
)
def test_friction_of_a_finite_contact(name: str, theory: Any, spots: Any, slow: ModuleType) -> None:
    finger = FINGERS[name].replace(theory=theory)
    oracle = oracle_of(slow, finger)
    model = ContactModel(finger, SCREEN, contact_spots=spots, terms={"finite-size": True})
    forces, h0, light = tensor(1e-4, 0.05, 20.0), 2e-7, []
    # All at once: the table is solved once for them.
    voltages = 0.7 * model.solve(forces, 0.0, None, h0).pull_in_voltage_v
    states = model.solve(forces, voltages, None, h0)
    assert not bool((states.status == int(Status.PULL_IN)).any())
    for i, force in enumerate(forces.tolist()):
        applied = force / nominal(finger, force)
        touching = resting(slow, oracle, model, force)
        told = slow.State(applied, float(voltages[i]), complex(h0), spots == "included", touching)
        root = oracle.equilibrium(told, float(states.pressure_pa[i]))
        assert oracle.nothing_below(told, root, (0.5,))
        assert apart(states.area_fraction[i], oracle.area_fraction(root)) < FRICTION
        assert apart(states.mean_gap_m[i], oracle.mean_gap(root, touching)) < GAP
        light.append(applied < touching)
    assert any(light) and not all(light)  # loads on both sides of it were seen


# --- attraction beside the spots


@pytest.mark.slow
@pytest.mark.parametrize(
    ("force", "h0", "share"), [(0.5, 2e-7, 0.5), (0.1, 5e-8, 0.7), (1.0, 1e-6, 0.6)]
)
def test_attraction_beside_the_spots(
    force: float, h0: float, share: float, slow: ModuleType
) -> None:
    """Loads of 1.9, 3.4 and 3.7 p0; the equations are those of the page."""
    finger, skin = Finger.preset("semi-wet"), FINGER
    solid = slow.Solid(
        skin.youngs_modulus_pa,
        skin.poisson_ratio,
        skin.layer_thickness_m,
        skin.bulk_modulus_pa,
        skin.bulk_poisson_ratio,
    )
    # The weight v is a quotient of small differences, whose noise is the error here: eight times as
    # fine, the oracle moves by up to 1 %.
    oracle = slow.Oracle(self_affine(slow, skin.roughness), solid, slow.LOCAL, fineness=4)
    model = ContactModel(finger, SCREEN, theory="local", terms={"finite-size": False})
    voltage = share * float(model.solve(force, 0.0, None, h0).pull_in_voltage_v)
    state = model.solve(force, voltage, None, h0)
    applied, found = force / nominal(finger, force), float(state.pressure_pa)
    strength = slow.EPS0 * voltage**2 / 4
    total, gaps, moved = oracle.beside_the_spots(found, applied, complex(h0))
    assert apart(found - applied, strength * total) < ATTRACTION
    # The lift beside an edge moves this by 2e-4, and the oracle's noise takes it past 2e-3.
    assert apart(state.gap_attraction_pa, strength * gaps) < ATTRACTION + 1e-3
    assert apart(state.mean_gap_m, oracle.mean_gap(moved)) < GAP


# --- plasticity


def test_images_are_the_diffusion_between_two_walls(slow: ModuleType) -> None:
    # Crank-Nicolson on dP/dt = P''/2 from a narrow Gaussian, absorbed at 0 and 1.
    load, start, end, cells, steps = 0.3, 0.03, 0.4, 1000, 4000
    x = np.linspace(0, 1, cells + 1)[1:-1]
    density = np.exp(-(((x - load) / start) ** 2) / 2) / (start * math.sqrt(2 * math.pi))
    rate = (end**2 - start**2) / steps * cells**2 / 4
    left = np.array([np.full_like(x, -rate), np.full_like(x, 1 + 2 * rate), np.full_like(x, -rate)])
    for _ in range(steps):
        right = (1 - 2 * rate) * density
        right[1:] += rate * density[:-1]
        right[:-1] += rate * density[1:]
        density = solve_banded((1, 1), left, right)
    elastic, plastic = slow.two_walls(load, end)
    # Second order in cells of 1e-3 against a start of 0.03.
    assert density.sum() / cells == pytest.approx(elastic, rel=1e-4)
    assert load - (x * density).sum() / cells == pytest.approx(plastic, rel=1e-4)


def test_every_term_has_an_independent_solution(slow: ModuleType) -> None:
    assert set(slow.TERMS) == set(TERMS)


@pytest.mark.parametrize("force", [1e-4, 0.1, 1.0, 30.0])
def test_the_apparent_area(force: float, slow: ModuleType) -> None:
    active = ContactModel(FINGER, SCREEN).solver.terms
    expected = slow.apparent_area(
        force, FINGER.apparent_area_at_1n_m2, FINGER.apparent_area_exponent
    )
    assert float(active.apparent_area_m2(tensor(force))) == pytest.approx(expected, rel=1e-12)


def test_a_finger_in_time(slow: ModuleType) -> None:
    finger = FINGER.replace(contact_time_s=3.0, sliding_speed_mm_per_s=70.0)
    on = dict.fromkeys(("occlusion", "sliding-speed", "shear-area"), True)
    active = ContactModel(finger, SCREEN, terms=on).solver.terms
    q = torch.tensor([1e5], dtype=torch.float64)
    plain = ContactModel(finger, SCREEN).solver.terms
    share = float(active.solid().effective_modulus(q) / plain.solid().effective_modulus(q))
    # The oracle takes steps of 3 s / 20,000 of 5 s: their first-order error is below 1e-4.
    assert share == pytest.approx(slow.softened(1.0, 0.1, 3.0, 5.0), rel=1e-4)
    shear = slow.shear_at_speed(finger.frictional_shear_stress_pa, 70.0, 0.3)
    assert active.shear_stress_pa() == pytest.approx(shear, rel=1e-12)
    rest = float(plain.apparent_area_m2(tensor(0.5)))
    assert float(active.apparent_area_m2(tensor(0.5))) == pytest.approx(
        slow.sheared_area(rest, 0.2), rel=1e-12
    )


@pytest.mark.parametrize(
    "hardness", [5e6, *(pytest.param(h, marks=pytest.mark.slow) for h in (2e5, 5e8))]
)
@pytest.mark.parametrize("spots", ["excluded", "included"])
def test_friction_of_skin_that_yields(spots: Any, hardness: float, slow: ModuleType) -> None:
    finger = FINGER.replace(hardness_pa=hardness)
    oracle = oracle_of(slow, finger)
    model = ContactModel(finger, SCREEN, contact_spots=spots)
    pressure = tensor(1e3, 3e4, 1e6)
    areas = [oracle.area_fraction(float(p)) for p in pressure]
    assert model.solver.fidelity.contact.area_fraction(pressure).tolist() == pytest.approx(
        areas, rel=AREA
    )
    force = 0.3
    applied = force / nominal(finger, force)
    touching = resting(slow, oracle, model, force)
    end = float(model.solve(force, 0.0, 1e3, 1e-7).pull_in_voltage_v)
    skin = finger.dielectric
    table = skin.frequency_hz, skin.permittivity, skin.resistivity_ohm_m
    h0 = slow.thickness(1e-7, 1e3, finger.layer_thickness_m, table)
    state = model.solve(force, 0.7 * end, 1e3, 1e-7)
    told = slow.State(applied, 0.7 * end, h0, spots == "included", touching)
    root = oracle.equilibrium(told, float(state.pressure_pa))
    assert apart(state.area_fraction, oracle.area_fraction(root)) < FRICTION


# --- insulators, and the closed form


def test_insulators_skin_and_a_leaking_gap(slow: ModuleType) -> None:
    skin = FINGER.dielectric
    table = skin.frequency_hz, skin.permittivity, skin.resistivity_ohm_m
    model = ContactModel(FINGER, SCREEN.replace(gap_resistivity_ohm_m=1e6))
    for frequency in (1e-2, 125.0, 3.3e4, 1e7):
        found = model.solver.terms.thickness(tensor(1.25e-7), tensor(frequency))
        expected = slow.thickness(1.25e-7, frequency, 200e-6, table, 1e6)
        assert complex(found[0]) == pytest.approx(expected, rel=1e-12)  # rounding


# --- what gaps bear, and the circuit


@pytest.mark.parametrize(
    ("terms", "spots"),
    [
        ({"field-limit"}, "included"),
        pytest.param({"body-return"}, "excluded", marks=pytest.mark.slow),
        pytest.param({"body-return"}, "included", marks=pytest.mark.slow),
        ({"field-limit", "body-return", "leaky-gap"}, "excluded"),
    ],
)
def test_gaps_that_are_held_and_a_body_in_series(
    terms: set[str], spots: Any, slow: ModuleType
) -> None:
    finger = FINGER.replace(fingers_on_screen=2)
    rho = 3e6 if "leaky-gap" in terms else None
    screen = SCREEN.replace(body_capacitance_f=80e-12, gap_resistivity_ohm_m=rho)
    oracle, force, voltage = oracle_of(slow, finger), 0.2, 260.0
    on = dict.fromkeys(terms, True)
    model = ContactModel(finger, screen, contact_spots=spots, terms=on)
    state = model.solve(force, voltage, 1e3, 1e-7)
    skin, area = finger.dielectric, nominal(finger, force)
    table = skin.frequency_hz, skin.permittivity, skin.resistivity_ohm_m
    told = slow.State(
        force / area,
        voltage,
        slow.thickness(1e-7, 1e3, finger.layer_thickness_m, table, rho),
        spots == "included",
        resting(slow, oracle, model, force),
        "field-limit" in terms,
        80e-12 if "body-return" in terms else None,
        2,
        area,
        slow.leaking(1e3, rho),
    )
    root = oracle.equilibrium(told, float(state.pressure_pa))
    assert apart(state.area_fraction, oracle.area_fraction(root)) < FRICTION
    capacitance = oracle.capacitance(root, told)
    # A capacitance is of the first power in the gaps, an attraction of the second.
    assert apart(state.capacitance_f, capacitance.real) < ATTRACTION
    assert apart(state.conductance_s, 2 * math.pi * 1e3 * capacitance.imag) < 2 * ATTRACTION
    # Far enough from doing nothing.
    plain = ContactModel(finger, screen, contact_spots=spots, terms={})
    assert apart(plain.solve(force, voltage, 1e3, 1e-7).mu, float(state.mu)) > 20 * FRICTION


@pytest.mark.parametrize("spots", ["excluded", "included"])
def test_critical_voltage(spots: Any, slow: ModuleType) -> None:
    oracle = oracle_of(slow, FINGER)
    model = ContactModel(FINGER, SCREEN, fidelity="closed-form", contact_spots=spots)
    h0, force = 2e-7, 0.2
    reference = 0.5 / nominal(FINGER, 0.5)
    critical = oracle.critical_voltage(reference, complex(h0), spots == "included")
    state = model.solve(force, 0.8 * critical, None, h0)
    # The light branch ends at 31 p0, where (V/Vc)^2 = 30/31. V goes with the root of I.
    end = critical * math.sqrt(30 / 31)
    assert float(state.pull_in_voltage_v) == pytest.approx(end, rel=ATTRACTION / 2)
    applied = force / nominal(FINGER, force)
    area = oracle.closed_form_area(applied, 0.8 * critical, critical, reference)
    # dlnA/dlnI = x/(1 - x) = 1.8 with x = 0.8^2
    assert apart(state.area_fraction, area) < 1.8 * ATTRACTION
