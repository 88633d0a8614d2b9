"""Sessions in the form of BIDS: what was presented, answered and touched; a validator reads it."""

import csv
import gzip
import json
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from firmware_io import Device, MockDriver, MockLink
from haptix.base.errors import FileFormatError, InputError
from haptix.base.files import write_whole
from haptix.lab.analysis.study import begin, export
from haptix.lab.experiment import (
    Catch,
    ConstantStimuli,
    Experiment,
    Pairs,
    Practice,
    SessionPlan,
)
from haptix.lab.experiment.recipe import ExperimentRecipe
from tests.hand_clock import HandClock
from tests.lab.chained import rows_of, stopped_after, write_rows
from tests.lab.presented import at_level

WAVE = np.sin(2 * np.pi * 120 * np.arange(4800) / 48_000)
FORCE_N, STEP_MM = 0.5, 2.0


PRACTISED = SessionPlan(practice=Practice(trials=1, level=36.0))


def session(path, method=None, task="2ifc", plan=PRACTISED):
    """A session whose panel reports a stroke in each trial; returns the path of each stroke.

    Time passes only where this says so.
    """
    clock, strokes = HandClock(), []
    device = Device(MockLink(MockDriver(pace="real", clock=clock), sleep=clock.sleep), clock=clock)

    class Sliding:
        def __getattr__(self, name):
            return getattr(device, name)

        def __enter__(self):
            device.__enter__()
            return self

        def __exit__(self, *error):
            return device.__exit__(*error)

        def write(self, volts):
            device.write(volts)
            strokes.append([])
            for k in range(4):
                clock.sleep(len(volts) / 48_000 / 8)  # all four while the samples are played
                at = (10.0 + STEP_MM * k, 20.0 + len(strokes))
                assert device.mock.touch(*at, FORCE_N)
                strokes[-1].append(at)
                device.progress(is_fresh=True)

    def answer(question):
        clock.sleep(0.3)
        return question.right

    Experiment(
        method or ConstantStimuli([30.0, 34.0], 2),
        at_level(WAVE),
        Sliding(),
        answer,
        path,
        task,
        clock=clock,
        wait=lambda seconds: None,
        plan=plan,
    ).run()
    device.close()
    return strokes


@pytest.fixture
def log(tmp_path):
    path = tmp_path / "log.tsv"
    return path, session(path)


def table(path):
    with path.open(newline="") as file:
        return list(csv.DictReader(file, delimiter="\t"))


def test_a_session_has_the_answers_the_path_and_the_force(log, tmp_path):
    path, strokes = log
    study = tmp_path / "study"
    export(path, study, "07", "1", "detection")
    base = "sub-07_ses-1_task-detection"
    place = study / "sub-07" / "ses-1"
    rows = table(place / "beh" / f"{base}_beh.tsv")
    assert rows[0]["level"] == "36.0" and len(rows) == 5
    assert [row["kind"] for row in rows] == ["practice"] + ["trial"] * 4
    assert all(row["answer"] == row["correct"] for row in rows)
    described = json.loads((place / "beh" / f"{base}_beh.json").read_text())
    assert set(rows[0]) <= set(described)
    # The path is the strokes', all of them in their order; its times rise from 0.
    motion = np.loadtxt(place / "motion" / f"{base}_tracksys-panel_motion.tsv")
    np.testing.assert_allclose(motion[:, :2], [at for one in strokes for at in one])
    assert motion[0, 2] == 0 and (np.diff(motion[:, 2]) >= 0).all()
    channels = table(place / "motion" / f"{base}_tracksys-panel_channels.tsv")
    assert [one["name"] for one in channels] == ["x", "y", "latency"]
    about = json.loads((place / "beh" / f"{base}_physio.json").read_text())
    assert about["Columns"] == ["normal_force"]
    force, level = continuous(study, "physio")[1], continuous(study, "stim")[1]
    assert set(force[~np.isnan(force)]) == {FORCE_N}
    assert set(level[~np.isnan(level)]) == {36.0, 30.0, 34.0}
    events = table(place / "motion" / f"{base}_events.tsv")
    assert len(events) == 5 and all(float(row["duration"]) > 0 for row in events)
    # The touches of a trial lie within it, by one clock.
    start = float(rows[0]["onset_s"]) - float(events[0]["onset"])
    first = motion[:8, 2] + start
    assert (first < float(rows[0]["time_s"]) + 1e-3).all()


def continuous(study, name):
    """What a table of regular times says of itself, and its values."""
    [file] = study.rglob(f"*_{name}.tsv.gz")
    about = json.loads(file.with_name(file.name.replace(".tsv.gz", ".json")).read_text())
    with gzip.open(file, "rt") as lines:
        return about, np.array([float(one.replace("n/a", "nan")) for one in lines])


def at_other_times(path, time_of):
    """Rewrite when the trials of a log were; return its rows."""
    rows = rows_of(path)
    for row in rows:
        answered_s, reaction_s = float(row["time_s"]), float(row["reaction_s"])
        row["onset_s"] = f"{time_of(float(row['onset_s'])):.4f}"
        row["time_s"] = f"{time_of(answered_s):.3f}"
        row["reaction_s"] = f"{time_of(answered_s) - time_of(answered_s - reaction_s):.4f}"
    write_rows(path, rows)
    return rows


def presented(log, study):
    """What the stimulus of a session says of itself, its steps, and the levels of the log."""
    export(log, study, "07", "1", "detection")
    about, level = continuous(study, "stim")
    steps = level[np.diff(level, prepend=np.nan) != 0]
    levels = [float(row["level"]) for row in rows_of(log) if row["kind"] == "trial"]
    return about["level"], steps[~np.isnan(steps)].tolist(), levels


def test_no_stimulus_is_stated_where_there_was_no_target(tmp_path):
    plan = SessionPlan(catch=Catch(share=0.5))
    session(tmp_path / "log.tsv", ConstantStimuli([30.0, 34.0], 5), "yes-no", plan)
    about, steps, levels = presented(tmp_path / "log.tsv", tmp_path / "study")
    assert steps == levels and len(levels) < len(rows_of(tmp_path / "log.tsv"))
    assert about["Units"] == "dB"


def test_numbers_of_items_are_no_levels_in_db(tmp_path):
    method = Pairs([0, 1, 2], 1, items=("denim", "silk", "wool"))
    session(tmp_path / "log.tsv", method, "pairs", SessionPlan())
    about, steps, levels = presented(tmp_path / "log.tsv", tmp_path / "study")
    assert steps == levels
    assert "Units" not in about and "denim, silk, wool" in about["Description"]


@pytest.mark.parametrize("scale", [0.001, 0.01, 0.1, 1.0, 10.0])
def test_no_stimulus_is_lost_however_short_its_trial(log, tmp_path, scale):
    path, _ = log
    rows = at_other_times(path, lambda t_s: scale * t_s)
    export(path, tmp_path / "study", "07", "1", "detection")
    about, level = continuous(tmp_path / "study", "stim")
    rate_hz = about["SamplingFrequency"]
    closest_s = np.diff([float(row["onset_s"]) for row in rows]).min()
    assert rate_hz == 100.0 if closest_s >= 0.01 else 1 <= rate_hz * closest_s < 2
    assert about["level"]["Description"].endswith("pauses included")
    # Each begins at its onset, to half of a sample.
    first = [(float(row["onset_s"]) - about["StartTime"]) * rate_hz for row in rows]
    for at, row in zip(first, rows, strict=True):
        assert float(row["level"]) in level[int(at) : int(at) + 2]
    assert len({round(at + 0.001) for at in first}) == 5


def test_a_stimulus_that_has_no_sample_is_counted_in_the_data(log, tmp_path, monkeypatch):
    """Trials milliseconds apart, and a long rest: a table so long is not made so fine."""
    monkeypatch.setattr("haptix.lab.analysis.study.MOST_SAMPLES", 500)
    path, _ = log
    rows = at_other_times(path, lambda t_s: 0.01 * t_s + (5.0 if t_s > 1 else 0.0))
    assert [float(row["onset_s"]) < 1 for row in rows] == [True, True, False, False, False]
    export(path, tmp_path / "study", "07", "1", "detection")
    about, level = continuous(tmp_path / "study", "stim")
    # Of the three after the rest, at 0, 5.5 and 11 ms, two come to one sample of 10 ms.
    assert about["SamplingFrequency"] == 100.0 and len(level) == pytest.approx(500, abs=10)
    assert "without 1 trials that began less than a sample before" in about["level"]["Description"]


def test_the_force_of_a_single_report_is_kept(log, tmp_path):
    path, _ = log
    touches = path.with_name("log_touches.tsv")
    head, *lines = touches.read_text().splitlines(keepends=True)
    touches.write_text("".join([head, *lines[::4]]))  # one of each stroke, two to a trial
    export(path, tmp_path / "study", "07", "1", "detection")
    _, force = continuous(tmp_path / "study", "physio")
    assert np.count_nonzero(force == FORCE_N) == len(lines[::4]) == 10


def test_participants_are_added_and_nothing_else_is_touched(log, tmp_path):
    path, _ = log
    study = tmp_path / "study"
    export(path, study, "07", "1", "detection")
    mine = '{"Name": "mine", "BIDSVersion": "1.10.0"}'
    (study / "dataset_description.json").write_text(mine)
    (study / "participants.tsv").write_text("participant_id\tage\nsub-07\t31\n")
    session(second := tmp_path / "second.tsv")
    export(second, study, "08", "1", "detection")
    export(path, study, "07", "1", "detection")
    for labels in (("09", "1", "detection"), ("07", "2", "detection"), ("07", "1", "other")):
        with pytest.raises(InputError, match="has it as sub-07_ses-1_task-detection_log"):
            export(path, study, *labels)
    assert (study / "dataset_description.json").read_text() == mine
    rows = table(study / "participants.tsv")
    assert rows == [{"participant_id": "sub-07", "age": "31"},
                    {"participant_id": "sub-08", "age": "n/a"}]  # fmt: skip
    for name in ("Jane Doe", "../07", "", "sub-07"):
        with pytest.raises(InputError, match="participant"):
            export(path, study, name, "1", "detection")
    other = tmp_path / "notes.tsv"
    other.write_text("a\tb\n")
    with pytest.raises(FileFormatError, match="log of trials"):
        export(other, study, "09", "1", "detection")
    assert not (study / "sub-09").exists()


def test_nothing_of_a_session_is_replaced(log, tmp_path):
    """Neither by another log of the same name, nor what somebody has written into its files."""
    path, _ = log
    study = tmp_path / "study"
    whole, rows = path.read_bytes(), rows_of(path)
    stopped_after(path, 3)
    export(path, study, "07", "1", "detection")
    write_rows(path, rows)
    assert path.read_bytes() == whole
    export(path, study, "07", "1", "detection")  # it has gone on
    other = tmp_path / "other.tsv"
    other.write_bytes(whole)
    write_rows(other, [{**row, "device": "mock MOCK0002"} for row in rows])
    before = {one: one.read_bytes() for one in study.rglob("*") if one.is_file()}
    assert before[study / "sourcedata/sub-07/ses-1/sub-07_ses-1_task-detection_log.tsv"] == whole
    with pytest.raises(InputError, match="has other trials"):
        export(other, study, "07", "1", "detection")
    beh = study / "sub-07" / "ses-1" / "beh" / "sub-07_ses-1_task-detection_beh.tsv"
    beh.write_bytes(before[beh] + b"my notes\n")
    with pytest.raises(InputError, match=r"beh\.tsv: .*changed"):
        export(path, study, "07", "1", "detection")
    beh.write_bytes(before[beh])
    assert before == {one: one.read_bytes() for one in study.rglob("*") if one.is_file()}


def test_an_export_that_was_stopped_is_done_again(log, tmp_path, monkeypatch):
    """After any of its files; the log has grown meanwhile, so that every file differs."""
    path, _ = log
    rows = rows_of(path)
    stopped_after(path, 3)
    export(path, tmp_path / "study", "07", "1", "detection")
    write_rows(path, rows)
    for most in range(1, 13):
        study, written = shutil.copytree(tmp_path / "study", tmp_path / str(most)), [0]

        def write(file, content, most=most, written=written):
            written[0] += 1
            if written[0] > most:
                raise KeyboardInterrupt
            write_whole(file, content)

        with monkeypatch.context() as patch:
            patch.setattr("haptix.lab.analysis.study.write_whole", write)
            with pytest.raises(KeyboardInterrupt):
                export(path, study, "07", "1", "detection")
        export(path, study, "07", "1", "detection")
        assert len(table(next(study.rglob("*_beh.tsv")))) == 5


def test_touches_of_a_trial_that_was_stopped_are_left_out(log, tmp_path):
    path, _ = log
    touches = path.with_name("log_touches.tsv")
    with touches.open("a") as file:
        file.write("2\t3\t0\t9.9\t1.0\t1.0\t0.5\t0\tmove\n2\t3\t0\t9.9")
    export(path, tmp_path / "study", "07", "1", "detection")
    motion = next((tmp_path / "study").rglob("*_motion.tsv")).read_text().splitlines()
    assert len(motion) == len(touches.read_text().splitlines()) - 3


def test_a_study_begins_with_an_experiment_that_runs(tmp_path):
    study = tmp_path / "roughness"
    files = begin(study, "roughness")
    assert json.loads((study / "dataset_description.json").read_text())["Name"] == "roughness"
    recipe = ExperimentRecipe.load(study / "code" / "experiment.toml")
    method: Any = recipe.make_method()
    assert set(method.methods) == {"felt-240Hz", "felt-160Hz"}
    assert {one.guess for one in method.methods.values()} == {1 / 3}
    assert recipe.session_plan().practice.trials == 6
    with pytest.raises(InputError, match="not empty"):
        begin(study, "again")
    assert all(path.exists() for path in files)


def test_the_recipe_of_a_log_from_elsewhere_comes_with_it(log, tmp_path):
    path, _ = log
    beside = path.with_name(f"{path.stem}_experiment.toml")
    own = tmp_path / "own.toml"
    own.write_text('name = "own"\n')
    copies = []
    for participant, recipe in (("01", None), ("02", own)):
        study = tmp_path / participant
        export(path, study, participant, "1", "detection", recipe)
        copies += [*study.rglob("*_experiment.toml")]
    assert [one.read_bytes() for one in copies] == [own.read_bytes()]  # the log has none beside
    try:
        beside.write_text('name = "beside"\n')
        export(path, tmp_path / "03", "03", "1", "detection")
        (copy,) = (tmp_path / "03" / "sourcedata").rglob("*_experiment.toml")
        assert copy.read_bytes() == beside.read_bytes()
    finally:
        beside.unlink()


def test_what_haptix_knows_of_a_session_is_said(log, tmp_path):
    path, _ = log
    export(path, tmp_path / "study", "01", "1", "detection")
    (about,) = (tmp_path / "study" / "sub-01").rglob("*_beh.json")
    fields = json.loads(about.read_text())
    assert fields["Instructions"].endswith("?") and fields["TaskDescription"]
    assert set(fields["kind"]["HED"]) == set(fields["kind"]["Levels"])
    assert json.loads((tmp_path / "study" / "dataset_description.json").read_text())["HEDVersion"]
    names = about.with_suffix(".tsv").read_text().split("\n")[0].split("\t")
    assert not {"onset", "duration"} & set(names) and {"onset_s", "duration_s"} <= set(names)


OF_THE_LABORATORY = {
    "InstitutionName", "InstitutionAddress", "InstitutionalDepartmentName", "Manufacturer",
    "ManufacturersModelName", "SoftwareVersions", "SubjectArtefactDescription", "CogAtlasID",
    "CogPOID", "Authors", "License", "SourceDatasets",
}  # fmt: skip


@pytest.mark.slow  # starts the validator's own runtime; what the files hold is tested above
def test_the_validator_finds_nothing_that_haptix_knows(log, tmp_path):
    path, _ = log
    study = tmp_path / "study"
    begin(study, "study")
    session(second := tmp_path / "second.tsv")
    for participant, ran in (("01", path), ("02", second)):
        export(ran, study, participant, "1", "detection")
    found = shutil.which("bids-validator-deno", path=Path(sys.executable).parent)
    assert found is not None, "install the dev extra"
    done = subprocess.run(
        [found, str(study), "--format", "json"], capture_output=True, text=True, timeout=300,
        check=False,
    )  # fmt: skip
    issues = json.loads(done.stdout)["issues"]["issues"]
    # What remains is of the laboratory alone: who, where, by whose panel, under which license.
    ours = [one for one in issues if one.get("subCode") not in OF_THE_LABORATORY]
    ours = [one for one in ours if one["code"] != "TOO_FEW_AUTHORS"]
    assert not ours, json.dumps(ours, indent=1)[:4000]
