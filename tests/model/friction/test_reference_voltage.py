"""Real contact area under voltage: values of an independent solver."""

import json
from pathlib import Path
from typing import Any

import pytest
import torch

from haptix import ContactModel, Finger, Screen, Status
from haptix.model.finger import Roughness

AREA_M2 = 1e-4
CASES = json.loads((Path(__file__).parents[2] / "data" / "meanfield.json").read_text())["cases"]
SWEEPS = [
    pytest.param(case, sweep, spots, id=f"{case['name']}, h0 {sweep['h0']:g} m, spots {spots}")
    for case in CASES
    for sweep in case.get("voltage", [])
    for spots in ("included", "excluded")
]


def model_of(case: dict[str, Any], spots: str) -> ContactModel:
    rough, solid = case["roughness"], case["solid"]
    skin = {}
    if "d" in solid:
        skin = {"layer_thickness_m": solid["d"], "bulk_poisson_ratio": solid["nu_bulk"]}
    finger = Finger(
        youngs_modulus_pa=solid["E"],
        poisson_ratio=solid["nu"],
        bulk_modulus_pa=solid.get("E_bulk"),
        apparent_area_at_1n_m2=AREA_M2,
        apparent_area_exponent=0,
        roughness=Roughness(
            h_rms_m=rough["h_rms"],
            hurst=rough["H"],
            q0_per_m=rough["q0"],
            q_rolloff_per_m=rough["qr"],
            q1_per_m=rough["q1"],
        ),
        **skin,
    )
    return ContactModel(
        finger,
        Screen(max_voltage_v=1e4),
        contact_spots=spots,
        gap_distribution=case["gap_distribution"],
    )


@pytest.mark.parametrize(("case", "sweep", "spots"), SWEEPS)
def test_area_at_given_voltages(case: dict[str, Any], sweep: dict[str, Any], spots: str) -> None:
    force = sweep["p0"] * AREA_M2
    voltage = torch.tensor(sweep["V0"], dtype=torch.float64)
    state = model_of(case, spots).solve(force, voltage, h0_m=sweep["h0"])
    area = state.area_fraction.tolist()
    status = state.status.tolist()
    expected = sweep[f"area_spots_{spots}"]
    for at, value in enumerate(expected):
        if value is None:  # past 31 p0
            assert status[at] == Status.PULL_IN
            assert float(state.pull_in_voltage_v[at]) < sweep["V0"][at]
        else:
            assert status[at] == Status.OK
            # I is within 2e-3 of these values, and so, near enough, is its share in p.
            assert area[at] == pytest.approx(value, rel=2e-3)
    assert bool(state.area_fraction.isfinite().all() and state.mu.isfinite().all())


def test_the_file_has_a_case_past_pull_in() -> None:
    assert any(
        None in sweep["area_spots_included"] for case in CASES for sweep in case.get("voltage", [])
    )
