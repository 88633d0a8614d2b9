"""Panel after panel: what stopped goes on where it was, and two rigs share a batch."""

import json
from typing import Any

import pytest
from filelock import FileLock
from typer.testing import CliRunner

from calibration import Session, SessionInfo, Stroke
from calibration.plan.protocol import Protocol
from calibration.register import Register
from calibration.tasks import RunCalibration
from haptix.base.errors import InputError
from haptix.base.task import Result
from haptix.tasks.cli.application import group_of

app = group_of("calibrate", "Calibrate a screen.")


@pytest.fixture
def rig(monkeypatch, finger, screen):
    """A rig whose person makes so many strokes before stopping; each panel has one."""
    made: dict[str, Any] = {"left": 9, "runs": []}

    def run(self, context):
        made["runs"].append(self.name)
        plan = Protocol(
            strokes=[Stroke(number=1, normal_force_n=0.5, voltage_v=0.0, frequency_hz=125.0)]
        )
        info = SessionInfo(screen=screen.replace(name=self.name), finger=finger)
        session = Session.begin(self.folder, plan, info, resume=True)
        if session.open_strokes and made["left"]:
            made["left"] -= 1
            path = session.path_of(plan.strokes[0])
            path.parent.mkdir(exist_ok=True)
            path.write_text(self.name)
        return Result({}, failed=bool(session.open_strokes))

    monkeypatch.setattr(RunCalibration, "run", run)
    return made


def batch(folder, *more):
    command = ["batch", str(folder / "line"), "--panel", "A 7", "--panel", "B", "--json"]
    command += ["--register-file", str(folder / "panels.json"), "--source", "virtual", *more]
    return CliRunner().invoke(app, command)


def test_a_batch_goes_on_where_it_stopped(rig, tmp_path):
    rig["left"] = 0
    stopped = batch(tmp_path)
    assert stopped.exit_code == 1
    assert rig["runs"] == ["A 7"]  # the person has stopped: B is not begun
    assert Register.load(tmp_path / "panels.json").panels[0].open_strokes == 1
    rig["left"] = 9
    done = batch(tmp_path)
    assert done.exit_code == 0, done.output
    assert [row["panel"] for row in json.loads(done.stdout)] == ["A 7", "B"]
    assert rig["runs"] == ["A 7", "A 7", "B"]
    kept = {one.panel: one.open_strokes for one in Register.load(tmp_path / "panels.json").panels}
    assert kept == {"A 7": 0, "B": 0}


def test_a_panel_that_another_rig_measures_is_passed_over(rig, tmp_path):
    (tmp_path / "line").mkdir()
    with FileLock(tmp_path / "line" / "A-7.lock"):
        rows = json.loads(batch(tmp_path).stdout)
    assert rows[0]["state"] == "measured by another rig"
    assert rig["runs"] == ["B"]


def test_a_damaged_register_is_a_sentence_and_no_stroke_is_lost(rig, tmp_path):
    (tmp_path / "panels.json").write_text("{")
    failed = batch(tmp_path)
    assert "panels.json" in str(failed.exception)
    assert (tmp_path / "panels.json").read_text() == "{"
    assert Session.open(tmp_path / "line" / "A-7").open_strokes == ()


def test_names_of_one_folder_are_refused(rig, tmp_path):
    made = batch(tmp_path, "--panel", "a-7")
    assert isinstance(made.exception, InputError) and "names that differ" in str(made.exception)
