"""``haptix stimuli`` as its user types it: the examples, and what a person may get wrong."""

import json
import re
import tomllib
from datetime import UTC, datetime, timedelta
from functools import partial
from pathlib import Path

import pytest

from haptix.tasks.stimuli import ExperimentJob
from tests.lab.chained import rows_of, write_rows

EXAMPLES = Path(__file__).parents[2] / "examples" / "stimuli"

pytestmark = pytest.mark.usefixtures("own_cache")

SET = """
schema_version = 1
name = "mine"
screens = ["3m-sct3250", "thick.toml"]
[trials]
in_order = true
[[designs]]
kind = "equal-friction"
name = "same"
base = { quantity = "mu", length_s = 0.05, signal = { kind = "constant", value = 0.272 } }
factors = { "normal_force_n" = [0.5, 0.6] }
"""

EXPERIMENT = """
name = "mine"
task = "2afc"
[stimulus]
quantity = "contrast"
length_s = 0.01
signal = { kind = "constant", value = 1.0 }
[method]
kind = "up-down"
start = -16.0
steps = [4.0, 2.0]
stop_after = 4
"""


@pytest.fixture
def haptix_stimuli(haptix_cli, monkeypatch, tmp_path):
    """Call ``haptix stimuli ARGUMENTS`` in an empty folder."""
    folder = tmp_path / "here"
    folder.mkdir()
    monkeypatch.chdir(folder)
    (folder / "set.toml").write_text(SET)
    (folder / "experiment.toml").write_text(EXPERIMENT)
    (folder / "thick.toml").write_text('name = "thick"\ninsulator_thickness_m = "1.5 um"')

    return partial(haptix_cli, "stimuli")


def test_a_file_is_not_made_again_from_anything(haptix_stimuli):
    done = haptix_stimuli("again", "set.toml", "--out", "again.wav")
    assert done.code == 2 and "expected a JSON file" in done.err


@pytest.mark.slow  # processes of their own, with torch
def test_workers_change_no_byte(haptix_stimuli):
    for name, workers in (("a", "1"), ("b", "2")):
        done = haptix_stimuli("make", "set.toml", "--out", name, "--workers", workers)
        assert done.code == 0, done.err
    for path in Path("a").iterdir():
        assert path.read_bytes() == (Path("b") / path.name).read_bytes(), path.name


@pytest.mark.slow
def test_a_recipe_is_made_and_shown(haptix_stimuli):
    done = haptix_stimuli("make", "set.toml", "--out", "out")
    assert done.code == 0, done.err
    assert "4 stimuli in out" in done.out and "same-01_on_thick.wav" in done.out
    again = haptix_stimuli("again", "out/same-01_on_thick.json", "--out", "again.wav")
    assert "byte for byte" in again.out, again.err
    rows = json.loads(haptix_stimuli("make", "set.toml", "--out", "out", "--json").out)
    assert [row["conditions"]["normal_force_n"] for row in rows] == [0.5, 0.6, 0.5, 0.6]
    by_file = {row["file"]: row["peak_v"] for row in rows}
    assert by_file["same-01_on_thick.wav"] > by_file["same-01_on_3m-sct3250.wav"]
    listed = " ".join(haptix_stimuli("show", "out").out.split())
    assert "all files are whole" in listed
    assert "mA (limit 0.7)" in listed and "mA (limit 0.5) rms" in listed
    shown = haptix_stimuli("show", "out/same-01_on_thick.wav")
    assert shown.code == 0 and Path("out/same-01_on_thick.png").is_file()
    Path("out/events_on_thick.tsv").write_text("changed")
    assert "events_on_thick.tsv" in haptix_stimuli("show", "out").err


def test_the_examples_are_good(haptix_stimuli):
    done = haptix_stimuli("make", EXAMPLES / "gratings.toml", "--out", "gratings")
    assert done.code == 0, done.err
    assert len(list(Path("gratings").glob("*.flac"))) == 7
    done = haptix_stimuli(
        "run", EXAMPLES / "threshold.toml", "--log", "t.tsv", "--simulate-db", "24.5", "--json"
    )
    assert done.code == 0, done.err
    (row,) = json.loads(done.out)
    assert row["trials"] == 40
    assert row["low_db"] < 24.5 < row["high_db"]
    assert len(Path("t.tsv").read_text().splitlines()) == 42


def test_an_experiment_on_friction(haptix_stimuli):
    done = haptix_stimuli(
        "run", "experiment.toml", "--log", "log.tsv", "--simulate-db", "-22", "--json"
    )
    assert done.code == 0, done.err
    assert json.loads(done.out)[0]["trials"] > 6
    again = haptix_stimuli(
        "run", "experiment.toml", "--log", "log.tsv", "--simulate-db", "-22", "--json"
    )
    assert json.loads(again.out) == json.loads(done.out)  # it was over


def test_a_session_runs_into_a_study_and_is_analysed(haptix_stimuli):
    """The same command again adds nothing; sessions differ in their trials, not in their recipe."""
    run = ("run", "experiment.toml", "--study", "study", "--simulate-db", "-22", "--json")
    for who in ("01", "p2"):
        done = haptix_stimuli(*run, "--participant", who)
        assert done.code == 0, done.err
        before = {one: one.read_bytes() for one in Path("study").rglob("*") if one.is_file()}
        again = haptix_stimuli(*run, "--participant", who)
        assert json.loads(again.out) == json.loads(done.out)
        assert before == {
            one: one.read_bytes() for one in Path("study").rglob("*") if one.is_file()
        }
    logs = sorted(Path("study/sourcedata").rglob("*_log.tsv"))
    assert [one.name for one in logs] == [
        f"sub-{who}_ses-01_task-mine_log.tsv" for who in ("01", "p2")
    ]
    heads = [json.loads(one.read_text().splitlines()[0][2:]) for one in logs]
    assert heads[0]["hashes"] == heads[1]["hashes"] and heads[0]["seed"] != heads[1]["seed"]
    kept = logs[0].with_name("sub-01_ses-01_task-mine_experiment.toml")
    assert kept.read_text() == EXPERIMENT
    assert Path("study/participants.tsv").read_text().split() == [
        "participant_id", "sub-01", "sub-p2"
    ]  # fmt: skip
    found = haptix_stimuli("analyse", "study", "--json")
    assert found.code == 0, found.err
    (tables,) = json.loads(found.out)
    stated = json.loads(done.out)[0]["threshold_db"]
    assert [row["participant"] for row in tables["thresholds"]] == ["01", "p2"]
    assert tables["thresholds"][1]["threshold_db"] == stated
    assert tables["group"][0]["participants"] == 2 and tables["notes"] == []
    assert Path("study/derivatives/haptix/report.html").is_file()
    Path("experiment.toml").write_text(EXPERIMENT.replace("-16.0", "-15.0"))
    edited = haptix_stimuli(*run, "--participant", "01")
    assert edited.code == 2 and "another experiment, or of other settings" in edited.err


def test_typed_answers_are_not_continued_by_a_simulated_observer(haptix_stimuli):
    """Nor the other way round: a log has one source, and says which."""
    run = ("run", "experiment.toml", "--log", "t.tsv")
    typed = haptix_stimuli(*run, stdin="llrlr")
    assert typed.code == 2 and "the keys ended" in typed.err
    before = Path("t.tsv").read_bytes()
    assert len(before.splitlines()) == 7
    other = haptix_stimuli(*run, "--simulate-db", "-22")
    assert other.code == 2 and "of other settings: source" in other.err
    assert Path("t.tsv").read_bytes() == before
    haptix_stimuli(*run, stdin="lr")
    rows = rows_of(Path("t.tsv"))
    assert [row["source"] for row in rows] == ["imported"] * 7  # keys of a pipe are nobody's


def test_the_order_of_a_log_is_the_participants(haptix_stimuli):
    """As in a study, by pseudonym and session; without a participant it is the recipe's."""
    orders = {}
    for name, *more in (
        ("plain",), ("one", "--participant", "01"), ("two", "--participant", "02"),
        ("second", "--participant", "01", "--session", "02"),
        ("study", "--participant", "01", "--study", "s"),
    ):  # fmt: skip
        to = () if "--study" in more else ("--log", f"{name}.tsv")
        done = haptix_stimuli("run", "experiment.toml", "--simulate-db", "-22", *to, *more)
        assert done.code == 0, done.err
        log = Path(f"{name}.tsv") if to else next(Path("s").rglob("*_log.tsv"))
        orders[name] = [row["right"] for row in rows_of(log)]
    assert orders["one"] == orders.pop("study")
    assert len({tuple(order[:6]) for order in orders.values()}) == 4


MAGNITUDES = """
name = "mine"
task = "magnitude"
method = { kind = "magnitudes" }
items = [{ name = "a" }, { name = "b" }, { name = "c" }, { name = "d" }, { name = "e" }]
[stimulus]
quantity = "volts"
drive_hz = 120.0
signal = { kind = "sine", amplitude = 1.0, frequency_hz = 120.0, length_s = 0.05 }
"""


def test_each_session_has_an_order_of_items_of_its_own(haptix_stimuli):
    Path("m.toml").write_text(MAGNITUDES)
    orders = []
    for who, session in (("a11", "01"), ("a12", "01"), ("a11", "02"), ("a21", "01"), ("b11", "01")):
        more = "--participant", who, "--session", session, "--simulate-db", "0"
        done = haptix_stimuli("run", "m.toml", "--log", f"{who}-{session}.tsv", *more)
        assert done.code == 0, done.err
        orders.append([row["level"] for row in rows_of(Path(f"{who}-{session}.tsv"))])
    assert len({*map(tuple, orders)}) == 5


class Answers:
    """What a job has around it; the participant always answers the first choice."""

    def __init__(self, folder):
        self.folder = folder

    def ask(self, question, choices):
        return choices[0]

    def tell(self, **what):
        pass


def test_each_log_of_a_page_has_an_order_of_its_own(tmp_path):
    """Also that of the practice, which the page begins with the same number."""
    orders = set()
    for log in ("a", "a-practice", "b"):
        job = ExperimentJob(recipe=tomllib.loads(EXPERIMENT), log=log)
        job.run(Answers(tmp_path))
        orders.add(tuple(row["right"] for row in rows_of(tmp_path / f"{log}.csv"))[:8])
    assert len(orders) == 3


def test_a_session_of_days_ago_goes_on_only_when_asked_to(haptix_stimuli):
    run = ("run", "experiment.toml", "--log", "t.tsv")
    haptix_stimuli(*run, stdin="llr")
    rows = rows_of(Path("t.tsv"))
    date = (datetime.now(UTC) - timedelta(hours=30)).isoformat(timespec="milliseconds")
    write_rows(Path("t.tsv"), [{**row, "date": date} for row in rows])
    before = Path("t.tsv").read_bytes()
    for typed in ("no\n", "\n", ""):
        done = haptix_stimuli(*run, stdin=typed)
        assert done.code == 2 and "was 30 hours ago. Does the same person go on? no/yes" in done.err
        assert Path("t.tsv").read_bytes() == before
    assert "hours ago" not in haptix_stimuli(*run, "--ask-after-h", "31", stdin="l").err
    write_rows(Path("t.tsv"), [{**row, "date": date} for row in rows])
    haptix_stimuli(*run, stdin="yes\nrl")
    assert len(rows_of(Path("t.tsv"))) == 5
    assert "after 1800 minutes; was it the same person?" in haptix_stimuli("analyse", "t.tsv").out


def test_the_ranges_of_a_recipe_are_checked(haptix_stimuli):
    """Nobody touches the mock; a simulated observer has no finger."""
    path = Path("experiment.toml")
    path.write_text(EXPERIMENT + "[touch]\nnormal_force_n = [0.4, 0.6]\n")
    done = haptix_stimuli("run", path, "--log", "t.tsv", stdin="l" * 30)
    assert done.code == 2 and "20 attempts were off, the last since no touch" in done.err
    assert "force [" in done.err and "not counted: no touch" in done.err
    rows = rows_of(Path("t.tsv"))
    assert [(row["accepted"], row["why"]) for row in rows] == [("false", "no touch")] * 20
    simulated = haptix_stimuli("run", path, "--log", "s.tsv", "--simulate-db", "-22")
    assert simulated.code == 0, simulated.err
    assert {row["normal_force_n"] for row in rows_of(Path("s.tsv"))} == {"n/a"}
    path.write_text(EXPERIMENT + "[touch]\nnormal_force_n = [0.6, 0.4]\n")
    wrong = haptix_stimuli("run", path, "--log", "u.tsv", stdin="l")
    assert wrong.code == 2 and "expected [least, most]" in wrong.err


def test_one_participant_has_one_spelling_in_a_study(haptix_stimuli):
    run = ("run", "experiment.toml", "--study", "s", "--simulate-db", "-22", "--participant")
    assert haptix_stimuli(*run, "07").code == 0
    for who in ("7", "007"):
        done = haptix_stimuli(*run, who)
        assert done.code == 2 and "the study has '07', which could be the same" in done.err
    for who in ("70", "p7", "17"):
        assert haptix_stimuli(*run, who).code == 0
    log = next(Path("s").rglob("sub-07*_log.tsv"))
    done = haptix_stimuli("bids", log, "--study", "s", "--participant", "7")
    assert done.code == 2 and "the study has '07'" in done.err
    names = sorted(one.name for one in Path("s").glob("sub-*"))
    assert names == ["sub-07", "sub-17", "sub-70", "sub-p7"]


def test_a_log_goes_into_a_study_as_the_participant_who_ran_it(haptix_stimuli):
    run = ("run", "experiment.toml", "--simulate-db", "-22", "--log")
    assert haptix_stimuli(*run, "elsewhere.tsv", "--participant", "03").code == 0
    assert haptix_stimuli(*run, "nobody.tsv").code == 0
    bids = partial(haptix_stimuli, "bids", "--study", "s", "--participant")
    done = bids("04", "elsewhere.tsv")
    assert done.code == 2 and "elsewhere.tsv was run as participant '03', got '04'" in done.err
    assert not Path("s").exists()
    assert bids("3", "elsewhere.tsv").code == bids("04", "nobody.tsv").code == 0
    for who, log in (("05", "nobody.tsv"), ("04", "nobody.tsv")):  # again, as the same one
        done = bids(who, log)
        assert done.code == (0 if who == "04" else 2)
        assert who == "04" or "the study has it as sub-04_ses-01_task-detection_log" in done.err
    assert sorted(one.name for one in Path("s").glob("sub-*")) == ["sub-04", "sub-3"]


def test_a_finished_session_is_said_to_be(haptix_stimuli):
    run = ("run", "experiment.toml", "--study", "s", "--participant", "1", "--simulate-db", "-22")
    first = haptix_stimuli(*run)
    log = next(Path("s").rglob("*_log.tsv"))
    before = log.read_bytes()
    again = haptix_stimuli(*run)
    assert first.code == again.code == 0 and log.read_bytes() == before
    assert "was finished before" in again.out and "was finished before" not in first.out


def test_a_rejected_set_has_a_line_for_each_stimulus(haptix_stimuli):
    path = Path("set.toml")
    path.write_text(path.read_text().replace("value = 0.272", "value = 9.0"))
    done = haptix_stimuli("make", "set.toml")
    assert done.code == 2
    head, *lines = done.err.splitlines()
    assert head.endswith("friction:") and "rejected whole, nothing was written" in head
    assert len(lines) == 4 and all(line.startswith("  same-") for line in lines)
    assert "\\" not in done.err


def test_a_folder_that_is_no_set_is_named_for_what_it_is(haptix_stimuli):
    assert haptix_stimuli("new", "study").code == 0
    done = haptix_stimuli("show", "study")
    assert done.code == 2 and "study: is a study" in done.err
    assert "haptix stimuli analyse study" in done.err
    Path("other").mkdir()
    done = haptix_stimuli("show", "other")
    assert done.code == 2 and "haptix stimuli make" in done.err


@pytest.mark.parametrize(
    ("forces", "warned"),
    [
        ("0.5, 0.6", ""),
        # The contact area of the presets is from forces of 0.1 to 0.9 N (`Finger`), ...
        ("40.0, 50.0", "a normal force of 50 N: the contact area was measured from 0.1 to 0.9 N"),
        # ... and the theory was compared with boundary elements from x = 5e-5 on.
        ("0.02, 0.03", "validated from 5e-05"),
    ],
)
def test_a_force_beyond_what_was_measured_is_warned_of(haptix_stimuli, forces, warned):
    path = Path("set.toml")
    text = path.read_text().replace("0.5, 0.6", forces).replace(', "thick.toml"', "")
    text = text.replace('"equal-friction"', '"factorial"').replace('"mu"', '"contrast"')
    path.write_text(text.replace("0.272", "0.01"))
    made, seen = haptix_stimuli("make", "set.toml"), haptix_stimuli("show", "mine")
    for done in (made, seen):
        assert done.code == 0, done.err
        assert ("warning" in done.out) == bool(warned)
        assert warned in " ".join(done.out.split())
    experiment = Path("experiment.toml")
    touch = f"[stimulus]\nnormal_force_n = {forces.split()[-1]}\n"
    experiment.write_text(EXPERIMENT.replace("[stimulus]\n", touch))
    run = haptix_stimuli("run", experiment, "--log", "t.tsv", "--simulate-db", "-22")
    assert run.code == 0 and warned in run.err and ("warning" in run.err) == bool(warned)


def test_a_drive_past_breakdown_is_warned_of_when_its_set_is_made(haptix_stimuli):
    path = Path("set.toml")
    path.write_text(path.read_text().replace("value = 0.272", "value = 0.3"))
    made, seen = haptix_stimuli("make", "set.toml"), haptix_stimuli("show", "mine")
    for done in (made, seen):
        assert done.code == 0 and "gaps whose field is past" in " ".join(done.out.split()), done.err


def test_who_cannot_be_a_participant(haptix_stimuli):
    for who in ("../x", "../07", "Jane Doe 1", "anna", "0", "-1", "", "7/1", "1" * 80, "n\u00e41"):
        done = haptix_stimuli(
            "run", "experiment.toml", "--study", "s", "--participant", who, "--simulate-db", "-22"
        )
        assert done.code == 2 and "--participant: expected letters and digits" in done.err, who
    for more in (("--session", "../1"), ("--task", "a b"), ("--session", "")):
        done = haptix_stimuli(
            "run", "experiment.toml", "--study", "s", "--simulate-db", "-22",
            "--participant", "1", *more,
        )  # fmt: skip
        assert done.code == 2 and "labels have letters and digits alone" in done.err, more
    for both in ((), ("--study", "s", "--log", "t.tsv")):
        done = haptix_stimuli("run", "experiment.toml", "--simulate-db", "-22", *both)
        assert done.code == 2 and "either --log FILE or --study FOLDER" in done.err
    nobody = haptix_stimuli("run", "experiment.toml", "--study", "s")
    assert nobody.code == 2 and "a study needs one" in nobody.err
    assert not Path("s").exists()
    for source, why in (("no", "there is no such"), ("set.toml", "is not a log"), (".", "no log")):
        done = haptix_stimuli("analyse", source)
        assert done.code == 2 and why in done.err, done.err


def test_a_set_s_name_stays_inside_its_folder(haptix_stimuli):
    for name in ("../mine", "/tmp/mine", "a/b", "..", "", "a\\\\b", "mine "):
        Path("set.toml").write_text(SET.replace('"mine"', f'"{name}"'))
        done = haptix_stimuli("make", "set.toml")
        assert done.code == 2 and "name: names a file or a folder" in done.err, name


def test_a_log_is_refused_in_a_sentence(haptix_stimuli):
    Path("thesis.txt").write_text("all of it")
    done = haptix_stimuli("run", "experiment.toml", "--log", "thesis.txt", "--simulate-db", "-22")
    assert done.code == 2 and "is not a log of trials, and stays as it is" in done.err
    assert Path("thesis.txt").read_text() == "all of it"


WRONG = {
    "missing": (("make", "no.toml"), "", "", r"no\.toml"),
    "no TOML": (("make", "set.toml"), "name", "= = name", "TOML"),
    "unknown key": (("make", "set.toml"), "schema_version", "colour = 1\nschema_version", "colour"),
    "later schema": (("make", "set.toml"), "schema_version = 1", "schema_version = 2", "version"),
    "unknown screen": (("make", "set.toml"), "3m-sct3250", "ipad", "'ipad'"),
    "unknown design": (("make", "set.toml"), "equal-friction", "latin-square", "latin-square"),
    "no stimuli": (("make", "set.toml"), "[[designs]]", "[extra]", "extra"),
    "wrong signal": (("make", "set.toml"), '"constant"', '"triangle"', "kind.*sine.*triangle"),
    "wrong place": (("make", "set.toml"), "normal_force_n", "signal.of.value", "signal.of.value"),
    "units": (("make", "set.toml"), "1.5 um", "1.5 kg", ""),
    "out of reach": (("make", "set.toml"), "0.272", "0.9", "highest is 0.3"),
    "not of a percept": (("make", "set.toml"), '"mu"', '"contrast"', '"mu"'),
    "no method": (("run", "experiment.toml"), "up-down", "guess", "'guess'"),
    "wrong method": (("run", "experiment.toml"), "stop_after", "stops_after", "stops_after"),
    "no start": (("run", "experiment.toml"), "start = -16.0", "", "start"),
    "wrong task": (("run", "experiment.toml"), "2afc", "yes-no", "task"),
    "no device": (("run", "experiment.toml", "--device", "abacus:"), "", "", "abacus"),
}


@pytest.mark.parametrize("name", WRONG)
def test_wrong_input_is_one_sentence(haptix_stimuli, name):
    (command, file, *more), old, new, pattern = WRONG[name]
    if old:
        path = Path(file)
        path.write_text(path.read_text().replace(old, new, 1))
        if name == "units":
            Path("thick.toml").write_text('insulator_thickness_m = "1.5 kg"')
    extra = ["--log", "log.tsv", "--simulate-db", "-20"] if command == "run" else ["--out", "out"]
    done = haptix_stimuli(command, file, *more, *extra)
    assert done.code == 2
    assert done.err.startswith("haptix: ") and "Traceback" not in done.err
    assert re.search(pattern, done.err), done.err
    assert not list(Path("out").glob("*.wav")) if Path("out").exists() else True
