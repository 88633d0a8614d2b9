"""A finger that a small box holds."""

from pathlib import Path

import pytest

from haptix import Finger, Screen
from haptix.model.contact import RoughnessSpectrum
from haptix.model.fidelity import BoundaryElementBox
from haptix.model.finger import MeasuredRoughness


@pytest.fixture
def gel(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Options for a finger and a screen whose contact a box of 64 x 64 solves in a second."""
    spectrum = RoughnessSpectrum.self_affine(1e-6, 0.8, 4.5e4, 9e4, 3.6e5)
    Finger(
        name="gel",
        roughness=MeasuredRoughness.of(spectrum, "made up"),
        apparent_area_at_1n_m2=50e-6,
        apparent_area_exponent=0.0,
    ).save(tmp_path / "gel.toml")
    Screen(insulator_thickness_m=8e-6, max_voltage_v=1000.0).save(tmp_path / "screen.toml")
    # There is no option for the box: the usual one takes ten times as long.
    monkeypatch.setattr(
        "haptix.model.friction.model.BoundaryElementBox",
        lambda: BoundaryElementBox(points=64, surfaces=2, q_high_per_m=3.6e5),
    )
    return ["--finger", f"{tmp_path / 'gel.toml'}", "--screen", f"{tmp_path / 'screen.toml'}"]
