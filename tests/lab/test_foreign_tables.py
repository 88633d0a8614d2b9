"""Tables of trials of other programs, such as PsychoPy's, give the thresholds of their answers."""

import json
import shutil

import numpy as np
import pytest

from haptix.base.errors import FileFormatError, InputError
from haptix.lab.analysis.foreign import TrialColumns
from haptix.lab.analysis.results import analyse
from haptix.lab.experiment.psychometric import fit, function_named
from tests.command_line import run_haptix

LEVELS = np.arange(10.0, 34.0, 4.0)
TRUTHS = {"p1": 20.0, "p2": 23.0, "p3": 21.0}
COLUMNS = TrialColumns(
    level="staircase.intensity", level_unit="dB", is_right="key_resp.corr", task="2ifc"
)


def answers(truth, seed, repeats=20):
    share = function_named("weibull")(LEVELS, truth, 3.0, 0.5, 0.02)
    draw = np.random.default_rng(seed)
    return [(float(at), bool(draw.random() < p)) for _ in range(repeats)
            for at, p in zip(LEVELS, share, strict=True)]  # fmt: skip


def of_psychopy(path, who, given, sign=","):
    """As PsychoPy's ExperimentHandler writes it: a BOM, rows of instructions, a last empty name."""
    names = ["trials.thisN", "staircase.intensity", "key_resp.keys", "key_resp.corr",
             "participant", "session", "date", "psychopyVersion", ""]  # fmt: skip
    rows = [["", "", "", "", who, "001", "2026-11-27_10h", "2026.2.5", ""]]
    rows += [
        [str(k), f"{level}", "1", str(int(right)), who, "001", "2026-11-27_10h", "2026.2.5", ""]
        for k, (level, right) in enumerate(given)
    ]
    path.write_text("\n".join(sign.join(row) for row in [names, *rows]) + "\n", "utf-8-sig")


@pytest.fixture
def folder(tmp_path):
    for seed, (who, truth) in enumerate(TRUTHS.items()):
        of_psychopy(tmp_path / f"{who}_exp_2026.csv", who, answers(truth, seed))
    return tmp_path


def test_psychopy_s_tables_give_the_thresholds_of_their_answers(folder):
    found = analyse(folder, columns=COLUMNS)
    rows = {row["participant"]: row for row in found.tables["thresholds"]}
    assert set(rows) == set(TRUTHS) and found.notes == ()
    for seed, (who, truth) in enumerate(TRUTHS.items()):
        alone = fit(answers(truth, seed), "weibull", 0.5)
        assert rows[who]["threshold_db"] == pytest.approx(alone.threshold, abs=1e-9)
        assert (rows[who]["trials"], rows[who]["source"]) == (120, "imported")
    assert found.tables["group"][0]["participants"] == 3


def test_reaction_times_of_another_program_tell_fast_guesses(tmp_path):
    draw, rows = np.random.default_rng(3), ["level,right,rt"]
    share = function_named("weibull")
    for k in range(200):
        is_fast, level = draw.random() < 0.3, float(LEVELS[k % len(LEVELS)])
        p = 0.5 if is_fast else float(share(level, 20.0, 3.0, 0.5, 0.02))
        time_s = (0.25 if is_fast else 0.8) * np.exp(0.2 * draw.standard_normal())
        rows.append(f"{level},{int(draw.random() < p)},{time_s:.4f}")
    (tmp_path / "p1.csv").write_text("\n".join(rows) + "\n")
    columns = TrialColumns(level="level", level_unit="dB", is_right="right", task="2ifc")
    file = tmp_path / "map.toml"  # the name of a column, under a key whose end names a unit
    file.write_text('level = "level"\nlevel_unit = "dB"\nis_right = "right"\ntask = "2ifc"\n'
                    'reaction_s = "rt"\n')  # fmt: skip
    of_times = TrialColumns.load(file)
    alone, timed = (
        analyse(tmp_path, columns=one).tables["thresholds"][0] for one in (columns, of_times)
    )
    assert alone.get("fast_guesses") is None
    assert timed["fast_guesses"] == pytest.approx(0.3, abs=0.06)
    assert timed["low_db"] < 20.0 < timed["high_db"]
    (tmp_path / "p1.csv").write_text("\n".join(rows).replace("rt", "time") + "\n")
    with pytest.raises(FileFormatError, match="rt"):
        analyse(tmp_path, columns=of_times)


def test_copies_are_one_and_two_of_a_name_are_asked_about(folder):
    shutil.copy(folder / "p1_exp_2026.csv", folder / "p1_exp_2026 (1).csv")
    found = analyse(folder, columns=COLUMNS)
    assert len(found.tables["thresholds"]) == 3
    assert any("is a copy of" in note for note in found.notes)
    of_psychopy(folder / "p9.csv", "p1", answers(25.0, 9))
    with pytest.raises(InputError, match=r"p1_exp.*p9.*of one person\?"):
        analyse(folder, columns=COLUMNS)


def test_any_table_with_conditions_and_linear_levels(tmp_path):
    rows = ["Volt;Antwort;Bedingung"]
    for condition, truth in (("hoch", 20.0), ("tief", 26.0)):
        rows += [
            f"{10 ** (level / 20):.9g}".replace(".", ",") + f";{right};{condition}"
            for level, right in answers(truth, 3)
        ]
    (tmp_path / "anna.csv").write_text("\n".join(rows))
    columns = TrialColumns(
        level="Volt", level_unit="linear", is_right="Antwort", condition="Bedingung", task="2afc"
    )
    found = analyse(tmp_path / "anna.csv", columns=columns).tables["thresholds"]
    by_condition = {row["condition"]: row["threshold_db"] for row in found}
    assert {row["participant"] for row in found} == {"anna"}
    assert by_condition["hoch"] == pytest.approx(20.0, abs=2.0)
    assert by_condition["tief"] == pytest.approx(26.0, abs=2.0)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("a,b\n1,2\n", r"missing columns 'staircase\.intensity', 'key_resp\.corr'; .*a, b"),
        ("staircase.intensity,key_resp.corr\n10,maybe\n", "line 2: key_resp.corr: expected 1 or 0"),
        ("staircase.intensity,key_resp.corr\nhigh,1\n", "expected a level in dB, got 'high'"),
        ("staircase.intensity,key_resp.corr\n10,1\ninf,1\n", "line 3: .*in dB, got 'inf'"),
        ("staircase.intensity,key_resp.corr\n1e300,1\n", "line 2: .*in dB, got '1e300'"),
        ("staircase.intensity,key_resp.corr\n,\n", "expected trials"),
    ],
)
def test_wrong_tables_are_named(tmp_path, text, said):
    (tmp_path / "x.csv").write_text(text)
    with pytest.raises(FileFormatError, match=said):
        analyse(tmp_path / "x.csv", columns=COLUMNS)


def test_a_reaction_time_without_an_end_is_named(tmp_path):
    (tmp_path / "x.csv").write_text("staircase.intensity,key_resp.corr,rt\n10,1,inf\n")
    columns = COLUMNS.replace(reaction_s="rt")
    with pytest.raises(FileFormatError, match="line 2: rt: expected seconds, got 'inf'"):
        analyse(tmp_path / "x.csv", columns=columns)


def test_the_command_says_what_a_foreign_table_needs(folder):
    table = folder / "p1_exp_2026.csv"
    done = run_haptix("stimuli", "analyse", table)
    assert done.code == 2
    for said in ("PsychoPy's", "--columns", 'level = "staircase.intensity"', "key_resp.corr"):
        assert said in done.err
    (folder / "map.toml").write_text(
        'level = "staircase.intensity"\nlevel_unit = "dB"\nis_right = "key_resp.corr"\n'
        'task = "2ifc"\n'
    )
    done = run_haptix("stimuli", "analyse", table, "--columns", folder / "map.toml")
    assert done.code == 0 and "p1" in done.out
    # Results of earlier analyses lie in the folder: p1_exp_2026_analysis, and then analysis.
    first, second = (
        run_haptix("stimuli", "analyse", folder, "--columns", folder / "map.toml", "--json")
        for _ in range(2)
    )
    assert first.code == second.code == 0, second.err
    assert json.loads(first.out) == json.loads(second.out)
    assert len(json.loads(second.out)[0]["thresholds"]) == 3
