"""What the contact model refuses, and how it says so."""

import math
from typing import Any

import pytest
import torch

from haptix import ContactModel, Finger, HaptixError, InputError, LimitError, Screen

BAD = {
    "negative": -1.0,
    "NaN": math.nan,
    "infinite": math.inf,
    "one bad of three": [1e-7, -1e-7, 1e-7],
    "empty": [],
    "empty tensor": torch.empty(0),
    "text": "1 N",
    "ragged": [[1.0], [1.0, 2.0]],
    "object": object(),
    "complex": 1e-7 + 1e-7j,
}
INPUTS = ("normal_force_n", "voltage_v", "frequency_hz", "h0_m")


@pytest.mark.parametrize("kind", BAD)
@pytest.mark.parametrize("name", INPUTS)
def test_bad_values_are_named(semi_wet: ContactModel, name: str, kind: str) -> None:
    inputs: dict[str, Any] = {
        "normal_force_n": 0.5, "voltage_v": 50.0, "frequency_hz": 100.0, "h0_m": 1e-7
    }  # fmt: skip
    with pytest.raises(InputError, match=name):
        semi_wet.solve(**{**inputs, name: BAD[kind]})


@pytest.mark.parametrize("name", ["normal_force_n", "frequency_hz", "h0_m"])
def test_zero_is_refused_except_for_the_voltage(semi_wet: ContactModel, name: str) -> None:
    inputs = {"normal_force_n": 0.5, "voltage_v": 0.0, "frequency_hz": 100.0, "h0_m": 1e-7}
    semi_wet.solve(**inputs)
    with pytest.raises(InputError, match=f"{name}.*above 0.*got 0"):
        semi_wet.solve(**{**inputs, name: 0.0})


@pytest.mark.parametrize("first", INPUTS)
@pytest.mark.parametrize("second", INPUTS)
def test_shapes_that_do_not_broadcast(semi_wet: ContactModel, first: str, second: str) -> None:
    if first == second:
        return
    inputs: dict[str, Any] = {
        "normal_force_n": 0.5, "voltage_v": 50.0, "frequency_hz": 100.0, "h0_m": 1e-7
    }  # fmt: skip
    inputs[first] = torch.full((2,), 50.0)
    inputs[second] = torch.full((3,), 50.0)
    with pytest.raises(InputError, match="broadcast"):
        semi_wet.solve(**inputs)


def test_the_screens_limit_is_exact_and_named() -> None:
    screen = Screen(name="bench", max_voltage_v=120.0)
    model = ContactModel(Finger.preset("semi-wet"), screen)
    model.solve(0.5, 120.0)
    with pytest.raises(LimitError, match=r"120 V.*bench"):
        model.solve(0.5, torch.tensor([0.0, math.nextafter(120.0, 200.0)], dtype=torch.float64))


def test_the_limit_is_a_limit_of_haptix() -> None:
    assert issubclass(LimitError, HaptixError)
    assert issubclass(InputError, HaptixError)


def test_dry_skin_yields() -> None:
    finger, screen = Finger.preset("dry"), Screen.preset("3m-sct3250")
    state = ContactModel(finger, screen).solve(torch.tensor([0.1, 0.5, 0.9]), 0.0)
    # Spots of 1 GPa skin would bear some 600 MPa: all of them yield, A/A0 = p/sigma_Y and
    # mu = tau_f/sigma_Y = 13/50. The elastic remainder is exp(-pi^2 tau^2/4 sigma_Y^2) < 1e-9.
    assert state.mu.tolist() == pytest.approx([0.26] * 3, rel=1e-6)
    elastic = ContactModel(finger, screen, terms={"plasticity": False}).solve(0.5, 0.0)
    assert float(elastic.mu) < 0.05


@pytest.mark.parametrize(
    ("option", "sentence"),
    [
        ({"fidelity": "exact"}, "fidelity.*mean-field.*'exact'"),
        ({"contact_spots": "some"}, "contact_spots.*excluded.*included.*'some'"),
        ({"gap_distribution": "new"}, "gap_distribution.*plain.*combined.*'new'"),
    ],
)
def test_unknown_options(option: dict[str, Any], sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        ContactModel(Finger.preset("semi-wet"), Screen.preset("3m-sct3250"), **option)


def test_roughness_with_waves_in_the_wrong_order() -> None:
    with pytest.raises(InputError, match="q0_per_m <= q_rolloff_per_m"):
        Finger(roughness={"q0_per_m": 1e5, "q_rolloff_per_m": 1e4, "q1_per_m": 1e8})


def test_a_solve_leaves_its_inputs_alone(semi_wet: ContactModel) -> None:
    force = torch.tensor([0.2, 0.7], dtype=torch.float64)
    voltage = torch.tensor([50.0, 5000.0], dtype=torch.float64)
    kept = force.clone(), voltage.clone()
    semi_wet.solve(force, voltage)
    assert torch.equal(force, kept[0]) and torch.equal(voltage, kept[1])
