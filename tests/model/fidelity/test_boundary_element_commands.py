"""``haptix build`` and ``query`` by boundary elements: what they say, and how they go on."""

import json
from pathlib import Path
from typing import Any

import pytest

from haptix import FrictionSurface
from haptix.model.contact.boundary_elements import ensemble
from haptix.model.fidelity import BoundaryElementBalance
from tests.command_line import CommandLine

EXACT = ["--fidelity", "boundary-element"]
LOADS = ["--normal-force-n", "0.5,1", "--voltage-v", "150", "--frequency-hz", "125"]

pytestmark = pytest.mark.filterwarnings(
    "ignore::haptix.model.contact.boundary_elements.ResolutionWarning"
)


@pytest.mark.slow
def test_an_interrupted_build_says_its_price_and_resumes(
    haptix_cli: CommandLine, gel: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    target, kept = tmp_path / "a.surface", tmp_path / "a.surface.partial.npz"
    command = ["build", target, *EXACT, *gel, *LOADS, "--tolerance", "0.1"]
    follow, places = BoundaryElementBalance.follow_loads, []

    def counted(self: BoundaryElementBalance, place: Any, strengths: Any) -> None:
        places.append(place)
        follow(self, place, strengths)

    def interrupted(self: BoundaryElementBalance, place: Any, strengths: Any) -> None:
        counted(self, place, strengths)
        if len(places) == 3:
            raise KeyboardInterrupt

    monkeypatch.setattr(BoundaryElementBalance, "follow_loads", interrupted)
    done = haptix_cli(*command)
    assert done.code != 0
    assert not target.exists()
    assert kept.exists()
    # Said before the work: three forces by three voltages.
    assert "9 states of boundary elements, some " in done.err
    assert f"resumes from {kept}" in done.err

    # A checkpoint is of one job: another one does not go on from it, and says how to go on.
    other = [*command]
    other[other.index("0.5,1")] = "0.6,1"
    refused = haptix_cli(*other)
    assert refused.code == 2
    assert "delete it or name another file" in refused.err

    places.clear()
    monkeypatch.setattr(BoundaryElementBalance, "follow_loads", counted)
    done = haptix_cli(*command, "--json")
    assert done.code == 0, done.err
    assert len(places) == 1  # the last of three forces
    assert not kept.exists()
    (row,) = json.loads(done.out)
    surface = FrictionSurface.load(target)
    assert surface.info["model"]["fidelity"] == "boundary-element"
    assert len(surface.info["boundary_elements"]["places"]) == 3
    assert row["mu_low"] == surface.info["mu_low"]


def test_a_damaged_checkpoint_is_one_sentence(
    haptix_cli: CommandLine, gel: list[str], tmp_path: Path
) -> None:
    (tmp_path / "a.surface.partial.npz").write_text("something else")
    done = haptix_cli("build", tmp_path / "a.surface", *EXACT, *gel, *LOADS, "--tolerance", "0.1")
    assert done.code == 2
    assert "delete it to start again" in done.err
    assert "pickle" not in done.err
    assert not (tmp_path / "a.surface").exists()


def test_too_little_memory_is_said_before_the_work(
    haptix_cli: CommandLine, gel: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ensemble, "free_bytes", lambda device: 10**6)
    done = haptix_cli("build", tmp_path / "a.surface", *EXACT, *gel, *LOADS)
    assert done.code == 2
    assert len(done.err.splitlines()) == 1
    assert "GiB free on cpu" in done.err
    assert "fewer points or fewer surfaces" in done.err
    assert list(tmp_path.glob("a.surface*")) == []


@pytest.mark.slow
def test_voltage_beyond_snap_in_is_a_status(haptix_cli: CommandLine, gel: list[str]) -> None:
    done = haptix_cli(
        *["query", *EXACT, *gel],
        *["--normal-force-n", "0.2", "--voltage-v", "50,950", "--h0-m", "2e-6", "--json"],
    )
    assert done.code == 0, done.err
    light, past = json.loads(done.out)
    assert (light["status"], past["status"]) == ("OK", "PULL_IN")
    assert light["mu"] < past["mu"]
    assert 50 < past["pull_in_voltage_v"] < 950
    assert light["pull_in_voltage_v"] == past["pull_in_voltage_v"]
