"""The share of the attraction that comes from gaps past what they bear."""

import json

import numpy as np
import pytest
import torch
from typer.testing import CliRunner

from haptix import ContactModel, Finger, Screen
from haptix.model.electro.breakdown import bearable_field, breakdown_voltage, share_past
from haptix.tasks.cli.application import app

SCREEN = Screen.preset("3m-sct3250")
GEL = Finger(name="gel")  # a half-space: its tables are cheap


def tensor(*values: float) -> torch.Tensor:
    return torch.tensor(values, dtype=torch.float64)


def test_what_gaps_bear() -> None:
    borne = bearable_field(tensor(0.0, 1e-6, 7.5e-6, 75e-6), 8.0, 500e6)
    # The physics page's numbers; ten times Paschen's minimum bears 10 / (1 + ln 10) times 327 V.
    expected = [350e6, 350e6, 327 / 7.5e-6, 327 / 7.5e-6 / (1 + np.log(10))]
    assert borne.tolist() == pytest.approx(expected, rel=1e-12)
    # A film of 10 V/um and eps1 = 2 gives way first, and at every gap.
    assert bearable_field(tensor(0.0, 1e-6), 2.0, 10e6).tolist() == [20e6, 20e6]
    gaps = torch.logspace(-9, -3, 500, dtype=torch.float64)
    assert bool((bearable_field(gaps, 8.0, 500e6).diff() <= 0).all())


def test_a_bin_that_the_boundary_crosses_counts_in_part() -> None:
    attraction = tensor(3.0, 1.0, 2.0)
    field, borne = tensor(8.0, 6.0, 2.0, 1.0), tensor(3.0, 3.0, 3.0, 3.0)
    # The excess is 5, 3, -1, -2: the second bin is past in three quarters.
    assert float(share_past(attraction, field, borne)) == pytest.approx((3 + 0.75) / 6)
    assert float(share_past(tensor(0.0), tensor(2.0, 2.0), tensor(1.0, 1.0))) == 0.0


@pytest.mark.parametrize("fidelity", ["mean-field", "closed-form"])
def test_the_share_of_a_state(fidelity: str) -> None:
    model = ContactModel(GEL, SCREEN, fidelity=fidelity)
    h0 = tensor(2e-7)
    broken = float(breakdown_voltage(h0, 8.0, 500e6))
    state = model.solve(0.5, tensor(0.0, 0.99 * broken, 150.0, 200.0), None, 2e-7)
    share = state.pull_past_breakdown.tolist()
    # Short of breakdown no gap is past it, and above more with every volt.
    assert share[:2] == [0.0, 0.0]
    assert 0 < share[2] < share[3] < 1
    # The same by the gap distribution itself: gaps below V / 350 V/um - h0, integrated finely.
    pressure = float(state.pressure_pa[3])
    edge = 200 / 350e6 - 2e-7
    decades = torch.logspace(-12, 0, 4000).double(), torch.logspace(0, 4, 4000)
    gaps = edge * torch.cat(decades)
    density = model.contact.gap_density(pressure, gaps) / (gaps + 2e-7) ** 2
    narrow, whole = (torch.trapezoid(density[:n], gaps[:n]) for n in (4000, 8000))
    # The closed form has the gaps of 0.5 N without voltage, whose share is 1 % lower.
    close = 2e-3 if fidelity == "mean-field" else 0.02
    assert share[3] == pytest.approx(float(narrow / whole), rel=close)


def test_the_wet_finger_of_the_query_is_far_past() -> None:
    command = ["query", "--finger", "wet", "--normal-force-n", "0.1", "--voltage-v", "185"]
    command += ["--frequency-hz", "125", "--theory", "open-gaps"]
    result = CliRunner().invoke(app, [*command, "--json"])
    assert result.exit_code == 0, result.output
    (row,) = json.loads(result.stdout)
    # 2.9 times the breakdown voltage, and friction that no skin is known for.
    assert row["status"] == "FRICTION"
    assert row["pull_past_breakdown"] > 0.8
    shown = " ".join(CliRunner().invoke(app, command).stdout.split())
    assert "88% of the attraction comes from gaps whose field is past what they bear" in shown
