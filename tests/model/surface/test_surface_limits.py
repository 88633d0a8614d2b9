"""Surfaces end where a limit of the model is passed, unless they are asked to go on."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import torch

from haptix import ContactModel, Finger, FrictionSurface, Screen, Status
from haptix.base.errors import InputError
from haptix.model.status import LIMITS
from haptix.model.surface import Slice
from tests.command_line import CommandLine

RANGES = {"normal_force_n": (0.1, 0.5), "frequency_hz": 60.0}
# A wet finger has a friction of 7 at 150 V, which is 93 % of pull-in; one with twice the shear
# stress has it well before that.
STICKY = Finger.preset("wet").replace(frictional_shear_stress_pa=7e6)
SCREEN = Screen.preset("3m-sct3250")
MOST = LIMITS[Status.FRICTION].most
TOLERANCE = 0.02


@pytest.fixture(scope="module")
def model() -> ContactModel:
    return ContactModel(STICKY, SCREEN)


@pytest.fixture(scope="module")
def surface(model: ContactModel) -> FrictionSurface:
    return FrictionSurface.build(model, RANGES, TOLERANCE)


def test_a_surface_ends_at_the_limit_of_friction(
    model: ContactModel, surface: FrictionSurface
) -> None:
    force = torch.linspace(0.1, 0.5, 33, dtype=torch.float64)[:, None]
    voltage = torch.linspace(0.0, 200.0, 201, dtype=torch.float64)
    truth, ours = model.solve(force, voltage, 60.0), surface.evaluate(force, voltage)
    # An error of the end of 1 %, which builds allow, is one of the friction that rises so steeply.
    assert not bool(((ours.status == Status.OK) & (truth.mu > 1.3 * MOST)).any())
    assert not bool(((ours.status == Status.FRICTION) & (truth.mu < MOST / 1.3)).any())
    _, high = surface.reachable(force[:, 0])
    assert high.tolist() == pytest.approx([MOST] * 33, rel=0.05)
    found = surface.voltage(torch.tensor([0.9, 1.5]) * MOST, 0.3)
    assert found.status.tolist() == [Status.OK, Status.FRICTION]
    end = surface.highest_voltage(0.3)
    assert float(found.voltage_v[1]) == pytest.approx(float(end), rel=1e-6)


def test_slices_and_files_say_so_as_well(surface: FrictionSurface, tmp_path: Path) -> None:
    surface.save(tmp_path / "sticky.surface")
    loaded = FrictionSurface.load(tmp_path / "sticky.surface")
    assert loaded.table.limited_by == Status.FRICTION
    column = loaded.column(0.3, 60.0)
    assert column.ends_by == Status.FRICTION
    _, status = column.voltage(np.array([0.9 * MOST, 1.5 * MOST]))
    assert status.tolist() == [Status.OK, Status.FRICTION]
    lowest, highest = Slice.of(loaded.table).reach(np.array([0.3]))
    assert (lowest[0], highest[0]) == pytest.approx((column.lowest_mu, column.highest_mu))


def test_past_the_limits_on_request(model: ContactModel) -> None:
    surface = FrictionSurface.build(model, RANGES, "0.5 JND", past_limits=True)
    assert surface.table.limited_by == Status.OK
    assert float(surface.reachable(0.3)[1]) > 1.2 * MOST
    found = surface.voltage(1.2 * MOST, 0.3)
    assert int(found.status) == Status.OK
    assert float(model.solve(0.3, found.voltage_v, 60.0).mu) == pytest.approx(1.2 * MOST, rel=0.06)


def test_a_finger_past_a_limit_without_voltage_has_no_surface() -> None:
    stone = Finger.preset("semi-wet").replace(youngs_modulus_pa=1e9)  # its spots bear 0.5 GPa
    model = ContactModel(stone, SCREEN)
    assert int(model.solve(0.5, 0.0).status) == Status.PRESSURE
    with pytest.raises(InputError, match=r"100 MPa in the contact spots.*--past-limits"):
        FrictionSurface.build(model, {"normal_force_n": 0.5})
    FrictionSurface.build(model, {"normal_force_n": 0.5}, past_limits=True)


@pytest.mark.slow  # two builds; limits are tested above, commands in tests/tasks/cli
def test_the_commands_say_it_in_words(haptix_cli: CommandLine, tmp_path: Path) -> None:
    at = ["--normal-force-n", "0.7", "--voltage-v", "200", "--frequency-hz", "125"]
    done = haptix_cli("query", "--finger", "wet", *at)
    assert "FRICTION" in done.out
    assert "friction above 5" in " ".join(done.out.split())
    STICKY.save(tmp_path / "sticky.toml")
    build = ["build", str(tmp_path / "a.surface"), "--finger", str(tmp_path / "sticky.toml")]
    build += ["--frequency-hz", "60", "--normal-force-n", "0.3", "--tolerance", "1 JND"]
    for more, word in (([], "FRICTION"), (["--past-limits", "--overwrite"], "OK")):
        done = haptix_cli(*build, *more)
        assert done.code == 0, done.err
        found = haptix_cli("invert", build[1], "--mu", "6", "--normal-force-n", "0.3", "--json")
        assert [row["status"] for row in json.loads(found.out)] == [word]
