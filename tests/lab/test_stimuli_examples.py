"""The example programs run; that for PsychoPy with stand-ins for its window and its keyboard."""

import sys
from pathlib import Path

import numpy as np
import pytest

from firmware_io import open_device
from haptix.feel import Constant
from haptix.lab.stimuli import Stimulus, StimulusSet, TrialPlan
from tests.programs import load

EXAMPLES = Path(__file__).parents[2] / "examples"

pytestmark = pytest.mark.usefixtures("own_cache")


def test_constant_stimuli(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["constant_stimuli.py", str(tmp_path / "set")])
    load("examples/constant_stimuli.py").main()
    said = capsys.readouterr().out
    assert "180 trials" in said and "placeholders" in said
    threshold = float(said.split("threshold ")[1].split(" dB")[0])
    assert abs(threshold) < 2  # three of the spreads that 180 trials leave


def test_a_psychopy_script_schedules_the_device(finger, screen, tmp_path):
    schedule = load("examples/psychopy_schedule.py")
    stimuli = tuple(
        Stimulus(name, Constant(volts).lasting(0.02), "volts")
        for name, volts in (("weak", 20.0), ("strong", 90.0))
    )
    plan = TrialPlan(repeats=3, seed=1)
    StimulusSet("two", stimuli, finger, (screen,), trials=plan).make(tmp_path / "set")
    device, shown = open_device("mock:"), []
    count = schedule.run(tmp_path / "set", tmp_path / "log.tsv", device, shown.append, lambda: "4")
    assert count == 6 and len(shown) == 12
    assert len((tmp_path / "log.tsv").read_text().splitlines()) == 7
    assert np.abs(device.mock.played_v).max() == pytest.approx(90, abs=0.1)
    assert not device.is_armed
    (tmp_path / "set" / "weak.wav").write_bytes(b"")
    with pytest.raises(SystemExit, match="weak"):
        schedule.run(tmp_path / "set", tmp_path / "b.tsv", device, print, lambda: "4")
    device.close()
