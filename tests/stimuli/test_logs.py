"""Logs of trials: nothing is lost, nothing comes twice, and nothing is mixed."""

import json
import os
import random
import shutil
import signal
import sys
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from firmware_io import open_device
from haptix.errors import FileFormatError, InputError
from haptix.stimuli import Constant, Stimulus, StimulusSet
from haptix.stimuli.adaptive import (
    ConstantStimuli,
    Experiment,
    SimulatedObserver,
    UpDown,
    trial_log,
)
from haptix.stimuli.recipe import ExperimentRecipe
from tests.stimuli.presented import at_level

WAVE = np.sin(2 * np.pi * 120 * np.arange(240) / 48_000)
KEPT = Path(__file__).parents[1] / "data" / "kept-files"


def experiment(device, path, made=None, method=None, **more):
    return Experiment(
        method or UpDown(40.0, (8.0, 4.0), stop_after=4),
        made or at_level(WAVE),
        device,
        more.pop("answer", SimulatedObserver(24.0, seed=2)),
        path,
        wait=lambda seconds: None,
        **more,
    )


def begin(device, path, count, **more):
    """Stop after some trials."""
    run = iter(experiment(device, path, **more))
    for _ in range(count):
        next(run)
    run.close()


def rows_of(path):
    _, names, *lines = path.read_text().splitlines()
    return [dict(zip(names.split("\t"), line.split("\t"), strict=True)) for line in lines]


def test_another_drive_does_not_continue_a_log(device, tmp_path):
    begin(device, tmp_path / "t.tsv", 3)
    before = (tmp_path / "t.tsv").read_bytes()
    for other in (at_level(0.9 * WAVE), at_level(WAVE[:-1])):
        with pytest.raises(FileFormatError, match=r"hashes\.drive"):
            experiment(device, tmp_path / "t.tsv", other)
    assert (tmp_path / "t.tsv").read_bytes() == before
    assert experiment(device, tmp_path / "t.tsv").trials == 3


@pytest.mark.usefixtures("own_cache")
@pytest.mark.parametrize("what", ["stimulus", "finger", "screen", "recipe"])
def test_a_log_is_of_one_stimulus_finger_screen_and_recipe(what, tmp_path, monkeypatch, surface):
    """Whatever else is the same: each has its hash in the head."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("haptix.stimuli.rendering.cached_surface", lambda *given: (surface, True))
    shutil.copy(KEPT / "session" / "finger.toml", "finger.toml")
    Path("screen.toml").write_text('name = "one"\ninsulator_thickness_m = "1.4 um"')
    recipe = {
        "name": "one", "finger": "finger.toml", "screen": "screen.toml", "folder": tmp_path,
        "stimulus": {"quantity": "volts", "drive_hz": 120, "length_s": 0.01,
                     "signal": {"kind": "sine", "amplitude": 1.0, "frequency_hz": 120}},
        "method": {"kind": "up-down", "start": 30.0},
    }  # fmt: skip
    before = dict(ExperimentRecipe(**recipe).presentation(48_000.0).hashes(0.0))
    assert set(before) == {"stimulus", "finger", "screen", "recipe"}
    if what == "stimulus":
        recipe["stimulus"]["signal"]["amplitude"] = 1.1
    elif what == "recipe":
        recipe["seed"] = 9
    else:
        path = Path(f"{what}.toml")
        name = 'name = "one"' if what == "screen" else 'name = "'
        path.write_text(path.read_text().replace(name, name.replace('"', '"x', 1), 1))
    after = ExperimentRecipe(**recipe).presentation(48_000.0).hashes(0.0)
    changed = {name for name in before if before[name] != after[name]}
    assert changed == {what, "recipe"} if what == "stimulus" else {what}


FOREIGN = ["", "my notes", "my notes\n", "participant\tage\n01\t30\n", "# {}\n", "# {}\nx\n1\n"]


@pytest.mark.parametrize("text", FOREIGN)
def test_a_file_that_no_log_has_made_is_never_replaced(device, tmp_path, text):
    path = tmp_path / "mine.tsv"
    path.write_text(text)
    if not text:  # holds nothing
        assert experiment(device, path).trials == 0
        return
    with pytest.raises(FileFormatError, match="stays"):
        experiment(device, path)
    assert path.read_text() == text


def test_one_writer(device, tmp_path):
    """In another process as in this one; and whoever wrote meanwhile is seen."""
    path, other = tmp_path / "t.tsv", open_device("mock:")
    first = iter(experiment(device, path))
    next(first)
    with pytest.raises(InputError, match="another experiment"):
        experiment(other, path)
    read, write = os.pipe()
    if (child := os.fork()) == 0:  # pragma: no cover
        try:
            experiment(other, path)
        except InputError as error:
            os.write(write, str(error).encode())
        finally:
            os._exit(0)
    os.waitpid(child, 0)
    assert b"another experiment is writing" in os.read(read, 1000)
    first.close()
    waits = experiment(device, path)
    waits.log.close()
    begin(other, path, 1)
    with pytest.raises(InputError, match="changed meanwhile"):
        next(iter(waits))
    other.close()
    assert [row["trial"] for row in rows_of(path)] == ["0", "1"]


def test_what_is_added_from_elsewhere_is_not_written_over(device, tmp_path):
    path = tmp_path / "t.tsv"
    run = iter(experiment(device, path))
    next(run)
    with path.open("a") as file:
        file.write("a note\n")
    with pytest.raises(InputError, match="changed meanwhile"):
        next(run)
    assert path.read_text().endswith("a note\n")


def test_another_program_continues_only_on_request(device, tmp_path, monkeypatch):
    path = tmp_path / "t.tsv"
    monkeypatch.setattr("haptix.stimuli.adaptive.trial_log.program", lambda: "0.0.9+aaaa")
    monkeypatch.setattr("haptix.stimuli.adaptive.experiment.program", lambda: "0.0.9+aaaa")
    begin(device, path, 2)
    monkeypatch.undo()
    with pytest.raises(FileFormatError, match=r"0\.0\.9\+aaaa"):
        experiment(device, path)
    experiment(device, path, another_program=True).run()
    versions = [row["version"] for row in rows_of(path)]
    assert versions[:2] == ["0.0.9+aaaa"] * 2 and set(versions[2:]) == {trial_log.program()}
    assert experiment(device, path).method.is_done  # asked for once


def test_a_log_of_before_is_read_and_continued_on_request(device, tmp_path):
    path = shutil.copy(KEPT / "trials.tsv", tmp_path / "t.tsv")
    recipe = ExperimentRecipe.load(KEPT / "threshold.toml")

    def resumed(**more):
        return experiment(device, path, method=recipe.make_method(), seed=5, **more)

    whole = resumed()
    assert whole.trials == 40 and whole.method.is_done
    del whole
    path.write_bytes(b"".join(path.read_bytes().splitlines(keepends=True)[:-3]))
    with pytest.raises(FileFormatError, match="--another-program"):
        resumed()
    again = resumed(another_program=True)
    again.run()
    rows = rows_of(path)
    assert [row["trial"] for row in rows] == [str(k) for k in range(40)]
    assert rows[36]["version"] == "n/a" and rows[37]["version"] == trial_log.program()
    assert float(rows[37]["time_s"]) >= float(rows[36]["time_s"])


def test_rows_say_when_and_with_what(device, tmp_path):
    path, now = tmp_path / "t.tsv", [100.0]

    def answer(question):
        now[0] += 0.7
        return question.right

    def wait(seconds):
        now[0] += seconds

    began = datetime.now(UTC) - timedelta(milliseconds=1)  # dates are rounded down to 1 ms
    for session in (1, 2):
        now[0] = 50.0 * session  # the clock of another boot
        run = Experiment(
            ConstantStimuli([30.0, 34.0], 3), at_level(WAVE), device, answer, path,
            clock=lambda: now[0], wait=wait, pause_s=0.5,
        )  # fmt: skip
        for _ in zip(range(3), run, strict=False):
            pass
        run.log.close()
    rows = rows_of(path)
    assert [row["session"] for row in rows] == ["1"] * 3 + ["2"] * 3
    times = [float(row["time_s"]) for row in rows]
    assert times == sorted(times) and times[:3] == [1.2, 2.4, 3.6]
    # The second session begins after the first, by what has really passed: less than a second.
    assert 4.8 <= times[3] < 4.8 + 60
    for row in rows:
        assert float(row["reaction_s"]) == pytest.approx(0.7)
        # The output of the mock begins a lead after it was sent.
        # Both are rounded to 1 ms.
        assert -2e-3 < float(row["onset_s"]) - (float(row["time_s"]) - 1.2) < 60
        assert began <= datetime.fromisoformat(row["date"]) <= datetime.now(UTC)
        assert row["version"] == trial_log.program() and "MOCK0001" in row["device"]


def test_a_clock_that_was_set_back_takes_no_time_back(device, tmp_path):
    """The last trial lies in the future of the computer's clock, by an hour."""
    path = tmp_path / "t.tsv"
    begin(device, path, 3)
    last = rows_of(path)[-1]
    later = datetime.fromisoformat(last["date"]) + timedelta(hours=1)
    path.write_text(path.read_text().replace(last["date"], later.isoformat()))
    experiment(device, path).run()
    times = [float(row["time_s"]) for row in rows_of(path)]
    assert times == sorted(times) and times[3] < times[2] + 600


def test_a_log_goes_on_in_a_renamed_folder(device, tmp_path):
    (tmp_path / "before").mkdir()
    begin(device, tmp_path / "before" / "t.tsv", 3)
    (tmp_path / "before").rename(tmp_path / "after wards")
    run = experiment(device, tmp_path / "after wards" / "t.tsv")
    assert run.trials == 3
    run.run()
    trials = [int(row["trial"]) for row in rows_of(tmp_path / "after wards" / "t.tsv")]
    assert trials == list(range(len(trials))) and len(trials) > 3


def test_a_disk_that_was_full_has_cost_no_trial(device, tmp_path, monkeypatch):
    """The row that found no room is not there in part, and its trial comes again."""
    path = tmp_path / "t.tsv"
    begin(device, path, 3)
    before = path.read_bytes()

    def full(descriptor):
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr("haptix.stimuli.adaptive.trial_log.os.fsync", full)
        run = experiment(device, path)
        with pytest.raises(InputError, match="No space left"):
            run.run()
    assert path.read_bytes() == before
    experiment(device, path).run()
    trials = [int(row["trial"]) for row in rows_of(path)]
    assert trials == list(range(len(trials))) and path.read_bytes().startswith(before)


PLACES = random.Random(22)


def killed_after(calls, file, run):
    """Run in a child that kills itself at the n-th call within a file; False once it ended."""
    child = os.fork()
    if child == 0:  # pragma: no cover
        left = [calls]

        def count(frame, event, argument):
            left[0] -= frame.f_code.co_filename.endswith(file)
            if left[0] <= 0:
                os.kill(os.getpid(), signal.SIGKILL)

        sys.setprofile(count)
        try:
            run()
        finally:
            os._exit(0)
    _, status = os.waitpid(child, 0)
    return os.WIFSIGNALED(status)


def test_kills_at_random_places_lose_nothing_and_repeat_nothing(tmp_path):
    def run(path):
        def to_the_end():
            method = UpDown(40.0, (8.0, 4.0), stop_after=4)
            one = open_device("mock:")
            experiment(one, path, method=method).run()

        return to_the_end

    run(tmp_path / "whole.tsv")()
    (tmp_path / "killed").mkdir()
    path, kills, acknowledged = tmp_path / "killed" / "t.tsv", 0, 0
    # Anywhere in some trials, and between the steps by which the log is written.
    places = [(PLACES.randint(10, 300), "adaptive/trial_log.py") for _ in range(5)]
    places += [(PLACES.randint(4000, 60_000), ".py") for _ in range(40)]
    while killed_after(*places[kills], run(path)):
        kills += 1
        now = len(rows_of(path)) if path.exists() and path.read_bytes().endswith(b"\n") else 0
        assert now >= acknowledged
        acknowledged = max(acknowledged, now)
    assert kills > 3
    names = ("trial", "attempt", "level", "right", "answer", "accepted")
    whole, found = (
        [[row[name] for name in names] for row in rows_of(one)]
        for one in (tmp_path / "whole.tsv", path)
    )
    assert found == whole
    sessions = [int(row["session"]) for row in rows_of(path)]
    assert sessions == sorted(sessions) and sessions[-1] > 1


@pytest.mark.usefixtures("own_cache")
def test_make_never_replaces_a_trial_table_that_was_added_to(finger, screen, tmp_path, monkeypatch):
    monkeypatch.setattr("haptix.stimuli.drawing.contact_sheet", lambda *given: b"")  # takes long

    def make(volts):
        one = Stimulus("one", Constant(volts).lasting(0.01), "volts")
        return StimulusSet("set", (one,), finger, (screen,)).make(tmp_path)

    make(20.0)
    make(21.0)  # its own table is as it was made
    table = tmp_path / "events.tsv"
    with table.open("a") as file:
        file.write("answers\n")
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir() if path.is_file()}
    with pytest.raises(InputError, match=r"events\.tsv: was changed"):
        make(22.0)
    assert before == {path.name: path.read_bytes() for path in tmp_path.iterdir() if path.is_file()}
    json.loads((tmp_path / "manifest.json").read_text())
    table.rename(tmp_path / "mine.tsv")
    make(22.0)
