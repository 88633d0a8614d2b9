"""Files that users keep are read, and give the numbers that they gave."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import soundfile
from typer.testing import CliRunner

from calibration.fit.result import Fit
from haptix import Scene
from haptix.feel.materials import load
from haptix.tasks.cli.application import app

KEPT = Path(__file__).parents[1] / "data" / "kept-files"
EXPECTED = json.loads((KEPT / "expected.json").read_text())


@pytest.fixture
def kept(tmp_path, monkeypatch):
    """A copy, since some commands write beside what they read."""
    folder = tmp_path / "kept"
    shutil.copytree(KEPT, folder)
    monkeypatch.chdir(folder)
    return folder


@pytest.mark.parametrize("case", EXPECTED, ids=lambda case: " ".join(case["command"][:4]))
@pytest.mark.usefixtures("kept")
@pytest.mark.filterwarnings("ignore::haptix.model.screen.CalibrationWarning")
def test_a_command_prints_what_it_printed(case):
    result = CliRunner().invoke(app, [*case["command"], "--json"])
    assert result.exit_code == 0, result.output
    rows = json.loads(result.stdout)
    rows = rows if isinstance(rows, list) else [rows]
    assert len(rows) == len(case["prints"])
    for row, expected in zip(rows, case["prints"], strict=True):
        for name, value in expected.items():
            if isinstance(value, float):
                # Rounding for what is read, the solver's own error for what is solved anew.
                value = pytest.approx(value, rel=case["relative_tolerance"], abs=1e-7)
            assert row[name] == value, name


def test_a_recipe_makes_the_same_stimuli(kept):
    result = CliRunner().invoke(app, ["stimuli", "make", "gratings.toml", "--out", "made"])
    assert result.exit_code == 0, result.output
    events = (kept / "stimuli" / "events.tsv").read_text()
    assert (kept / "made" / "events.tsv").read_text() == events
    for name in ("grating-01", "noise"):
        before, rate = soundfile.read(kept / "stimuli" / f"{name}.flac")
        after, rate_after = soundfile.read(kept / "made" / f"{name}.flac")
        assert rate == rate_after
        # Two steps of the file's 24 bits: its own rounding, and one of the arithmetic.
        np.testing.assert_allclose(after, before, rtol=0, atol=2 * 2.0**-23)


def test_documents_are_read_as_they_are(kept):
    assert [Scene.load(kept / f"{name}.toml").budget_jnd for name in ("carrier", "direct")] == [
        0.5
    ] * 2
    fit = Fit.load(kept / "session" / "fit.json")
    fit.check_unedited()
    assert fit.finger_prior().names
    table = json.loads((kept / "layout.json").read_text())
    regions = load(kept / "layout.json").describe()["regions"]
    assert [region["name"] for region in regions] == [region["name"] for region in table["regions"]]
    assert regions[0].items() >= {"x_mm": 10.0, "width_mm": 30.0, "height_mm": 20.0}.items()
