"""Logs of trials: nothing is lost, nothing comes twice, and nothing is mixed."""

import io
import json
import os
import random
import shutil
import signal
import subprocess
import sys
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from firmware_io import open_device
from haptix.base.errors import FileFormatError, InputError
from haptix.base.files import read_bytes
from haptix.feel import Constant
from haptix.lab.analysis.results import analyse
from haptix.lab.analysis.study import export
from haptix.lab.experiment import (
    ConstantStimuli,
    Experiment,
    Keys,
    SessionPlan,
    SimulatedObserver,
    StopRules,
    UpDown,
    trial_log,
)
from haptix.lab.experiment.recipe import ExperimentRecipe
from haptix.lab.stimuli import Stimulus, StimulusSet
from tests.lab.chained import rows_of, write_rows
from tests.lab.presented import at_level

WAVE = np.sin(2 * np.pi * 120 * np.arange(240) / 48_000)
KEPT = Path(__file__).parents[1] / "data" / "kept-files"


def experiment(device, path, method=None, made=None, **more):
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


def test_another_drive_does_not_continue_a_log(device, tmp_path):
    begin(device, tmp_path / "t.tsv", 3)
    before = (tmp_path / "t.tsv").read_bytes()
    for other in (at_level(0.9 * WAVE), at_level(WAVE[:-1])):
        with pytest.raises(FileFormatError, match=r"hashes\.drive"):
            experiment(device, tmp_path / "t.tsv", made=other)
    assert (tmp_path / "t.tsv").read_bytes() == before
    assert experiment(device, tmp_path / "t.tsv").trials == 3


@pytest.mark.usefixtures("own_cache")
@pytest.mark.parametrize("what", ["stimulus", "finger", "screen", "recipe"])
def test_a_log_is_of_one_stimulus_finger_screen_and_recipe(what, tmp_path, monkeypatch, surface):
    """Whatever else is the same: each has its hash in the head."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(
        "haptix.lab.stimuli.rendering.cached_surface", lambda *given: (surface, True)
    )
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
    monkeypatch.setattr("haptix.lab.experiment.trial_log.program", lambda: "0.0.9+aaaa")
    monkeypatch.setattr("haptix.lab.experiment.trials.program", lambda: "0.0.9+aaaa")
    begin(device, path, 2)
    monkeypatch.undo()
    with pytest.raises(FileFormatError, match=r"0\.0\.9\+aaaa"):
        experiment(device, path)
    experiment(device, path, another_program=True).run()
    versions = [row["version"] for row in rows_of(path)]
    assert versions[:2] == ["0.0.9+aaaa"] * 2 and set(versions[2:]) == {trial_log.program()}
    assert experiment(device, path).method.is_done  # asked for once


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
    write_rows(path, [*rows_of(path)[:-1], {**last, "date": later.isoformat()}])
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
        patch.setattr("haptix.lab.experiment.trial_log.os.fsync", full)
        run = experiment(device, path)
        with pytest.raises(InputError, match="No space left"):
            run.run()
    assert path.read_bytes() == before
    experiment(device, path).run()
    trials = [int(row["trial"]) for row in rows_of(path)]
    assert trials == list(range(len(trials))) and path.read_bytes().startswith(before)


def altered(lines, draw):
    """Rows that somebody has edited without care; the same number of columns in each."""
    lines, kind = list(lines), draw.choice(EDITS)
    at, other = draw.randrange(len(lines)), draw.randrange(len(lines))
    if kind == "cell":
        cells = lines[at].split("\t")
        cells[draw.randrange(len(cells))] = draw.choice(["1", "2", "true", "false", "n/a", "30.0"])
        lines[at] = "\t".join(cells)
    elif kind == "character":
        place = draw.randrange(len(lines[at]))
        lines[at] = lines[at][:place] + draw.choice("0123456789abcdef.-") + lines[at][place + 1 :]
    elif kind == "swap":
        lines[at], lines[other] = lines[other], lines[at]
    elif kind == "delete":
        del lines[min(at, other) : max(at, other) + 1]
    elif kind == "double":
        lines.insert(other, lines[at])
    elif kind == "reverse":
        lines[min(at, other) : max(at, other) + 1] = lines[min(at, other) : max(at, other) + 1][
            ::-1
        ]
    else:  # cut
        del lines[at:]
    return lines


EDITS = ("cell", "character", "swap", "delete", "double", "reverse", "cut")


@pytest.fixture(scope="module")
def two_logs(tmp_path_factory):
    """Lines and end of two finished logs of one plan, which differ in their answers."""
    folder, logs = tmp_path_factory.mktemp("logs"), []
    for seed in (2, 3):
        device = open_device("mock:")
        path = folder / f"{seed}.tsv"
        experiment(device, path, answer=SimulatedObserver(24.0, seed=seed)).run()
        device.close()
        logs.append((path.read_text().splitlines(), trial_log.End.of(path)))
    return logs


def test_no_careless_edit_is_accepted(two_logs):
    """What is read is what was written, or the log is refused; 6000 edits, swaps and merges."""
    draw, refused = random.Random(37), 0
    (first, end), (second, _) = two_logs
    head, rows = first[:2], first[2:]
    for number in range(6000):
        if number % 4 == 0:  # rows of another session among these
            at, n = draw.randrange(len(rows)), draw.randrange(1, 4)
            place = draw.randrange(len(second) - 3) + 2
            lines = rows[:at] + second[place : place + n] + rows[at + draw.choice([0, n]) :]
        else:
            lines = rows
            for _ in range(draw.choice([1, 1, 2, 5])):
                lines = altered(lines, draw) if lines else lines
        if draw.random() < 0.05:
            head = [first[0].replace("0.15", "0.25"), first[1]]
        data = "".join(f"{line}\n" for line in [*head, *lines]).encode()
        data = data[: -draw.randrange(1, 40)] if draw.random() < 0.05 else data
        is_whole = data.decode() == "".join(f"{line}\n" for line in first)
        head = first[:2]
        try:
            log = trial_log.parse_log(Path("t.tsv"), data, end)
        except FileFormatError:
            assert not is_whole
            refused += 1
        else:
            assert ["\t".join(row.values()) for row in log.rows] == rows and is_whole
    assert refused > 5000  # some edits leave a line as it is


def spoil(path, what):
    """Change a log of some rows; return the number of the row that is named."""
    head, names, *lines = path.read_text().splitlines()
    if what == "deleted":
        del lines[2]
    elif what == "doubled":
        lines.insert(3, lines[2])
    elif what == "reversed":
        lines[2:5] = lines[2:5][::-1]
    else:
        cells = lines[1].split("\t")
        cells[4] = "12.0"
        lines[1] = "\t".join(cells)
    path.write_text("\n".join([head, names, *lines]) + "\n")
    return {"deleted": 3, "doubled": 4, "reversed": 3, "edited": 3}[what]


@pytest.mark.parametrize("what", ["deleted", "doubled", "reversed", "edited"])
def test_rows_that_were_changed_are_found(device, tmp_path, what):
    path = tmp_path / "t.tsv"
    begin(device, path, 7)
    row = spoil(path, what)
    for read in (
        lambda: experiment(device, path),
        lambda: analyse(path),
        lambda: export(path, tmp_path / "study", "01", "1", "one"),
    ):
        with pytest.raises(FileFormatError, match=rf"t\.tsv: row {row} "):
            read()
    assert not (tmp_path / "study").exists()


@pytest.mark.parametrize(
    ("row", "name", "value"),
    [(2, "level_asked", "12.0"), (3, "level", "12.0"), (3, "right", "other"), (4, "trial", "5"),
     (0, "attempt", "1"), (1, "kind", "catch"), (5, "condition", "b"), (2, "is_right", "other"),
     (3, "accepted", "false")],
)  # fmt: skip
def test_rows_that_are_not_of_the_plan_are_found(device, tmp_path, row, name, value):
    """Where the hashes were made anew too, only the plan knows."""
    path = tmp_path / "t.tsv"
    begin(device, path, 8)
    rows = rows_of(path)
    if value == "other":
        value = {"1": "2", "2": "1", "true": "false", "false": "true"}[rows[row][name]]
    rows[row][name] = value
    write_rows(path, rows)
    named = row + 2 if name == "accepted" else row + 1  # the next is another attempt then
    for read in (lambda: experiment(device, path), lambda: analyse(path)):
        with pytest.raises(FileFormatError, match=rf"row {named} \(trial "):
            read()


def test_rows_of_another_program_that_chose_otherwise_are_a_note(device, tmp_path):
    path = tmp_path / "t.tsv"
    begin(device, path, 8)
    rows = [{**row, "version": "0.0.9+aaaa"} for row in rows_of(path)]
    rows[3]["level"] = rows[3]["level_asked"] = "12.0"
    write_rows(path, rows)
    assert "row 4 (trial 3): level_asked is 12.0" in " ".join(analyse(path).notes)
    with pytest.raises(FileFormatError, match="cannot continue it"):
        experiment(device, path, another_program=True)


def test_an_end_that_is_missing_is_told_from_a_stop(device, tmp_path):
    path, end = tmp_path / "t.tsv", tmp_path / "t_end.json"
    begin(device, path, 5)
    five = path.read_bytes(), end.read_bytes()
    begin(device, path, 1)
    six = path.read_bytes(), end.read_bytes()
    # Stopped between the row and the second file: six rows, and the next run says so.
    path.write_bytes(six[0])
    end.write_bytes(five[1])
    assert experiment(device, path).trials == 6
    assert end.read_bytes() == six[1]
    # Cut off, at a line and within one.
    for data in (five[0], six[0][:-1], six[0][:-30]):
        path.write_bytes(data)
        for read in (lambda: experiment(device, path), lambda: analyse(path)):
            with pytest.raises(FileFormatError, match=r"5 rows.*t_end\.json.*6"):
                read()
        assert path.read_bytes() == data
    for data in (b"", None):
        path.unlink() if data is None else path.write_bytes(data)
        with pytest.raises(FileFormatError, match="had 6 rows"):
            experiment(device, path)
    # Two rows more than the second file knows are no stop.
    path.write_bytes(six[0])
    begin(device, path, 1)
    end.write_bytes(five[1])
    with pytest.raises(FileFormatError, match="of other rows"):
        experiment(device, path)
    # Without the file nobody knows.
    end.unlink()
    with pytest.raises(FileFormatError, match=r"expected .*t_end\.json beside it"):
        experiment(device, path)
    assert "is not known without" in " ".join(analyse(path).notes)


def test_a_log_is_read_while_its_session_runs(device, tmp_path, monkeypatch):
    """A trial that ends just after the log was read has not cut it."""
    path, read = tmp_path / "t.tsv", read_bytes
    begin(device, path, 3)

    def read_and_go_on(*given):
        data = read(*given)
        with monkeypatch.context() as patch:
            patch.setattr(trial_log, "read_bytes", read)
            begin(device, path, 1)
        return data

    monkeypatch.setattr(trial_log, "read_bytes", read_and_go_on)
    assert len(trial_log.read_log(path).rows) == 3
    assert len(rows_of(path)) == 4


def test_a_finished_session_is_over_whatever_the_clock_says(device, tmp_path):
    """The rule of minutes begins anew with each resume; the log says that it was reached."""
    path, seconds = tmp_path / "t.tsv", iter(range(0, 10**6, 2))

    def run():
        return experiment(
            device, path, ConstantStimuli([20.0, 25.0], 50), clock=lambda: float(next(seconds)),
            plan=SessionPlan(stop=StopRules(most_minutes=2.0)),
        )  # fmt: skip

    run().run()
    before = path.read_bytes()
    assert json.loads((tmp_path / "t_end.json").read_text())["finished"]
    assert run().is_over
    run().run()
    assert path.read_bytes() == before
    assert "not over" not in analyse(path).tables["thresholds"][0]["warnings"]


def test_a_log_has_one_source(device, tmp_path):
    path = tmp_path / "t.tsv"
    typed = Keys(source=io.StringIO("1" * 3), sink=io.StringIO())
    with pytest.raises(InputError, match="keys ended"):
        experiment(device, path, answer=typed).run()
    assert [row["source"] for row in rows_of(path)] == ["imported"] * 3
    for other in ({}, {"answer": lambda question: "1"}, {"answer": typed, "source": "page"}):
        with pytest.raises(FileFormatError, match="of other settings: source"):
            experiment(device, path, **other)
    assert experiment(device, path, answer=typed).trials == 3
    assert json.loads(path.read_text().splitlines()[0][2:])["source"] == "imported"


def test_a_log_of_another_format_is_refused_and_stays(device, tmp_path):
    path = tmp_path / "t.tsv"
    begin(device, path, 2)
    head, rest = path.read_text().split("\n", 1)
    other = json.loads(head[2:]) | {"format": 2}
    path.write_text(f"# {json.dumps(other)}\n{rest}")
    before = path.read_bytes()
    for read in (analyse, lambda path: experiment(device, path)):
        with pytest.raises(FileFormatError, match="another version of haptix; name a new file"):
            read(path)
    assert path.read_bytes() == before


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
    places = [(PLACES.randint(10, 300), "experiment/trial_log.py") for _ in range(5)]
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
def test_make_never_replaces_a_trial_table_that_was_added_to(finger, screen, tmp_path):

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


@pytest.mark.slow
def test_the_program_of_a_log_is_all_that_its_trials_import():
    code = (
        "import sys, haptix.lab.experiment.recipe, haptix.lab.experiment.observer\n"
        "print(*{'/'.join(m.split('.')[:2]) for m in sys.modules if m.startswith('haptix.')})\n"
        "print(*{'firmware_io', 'calibration'} & {*sys.modules})"
    )
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, check=True)
    assert set(loaded.stdout.decode().split()) == set(trial_log._TRIALS_DEPEND_ON)
