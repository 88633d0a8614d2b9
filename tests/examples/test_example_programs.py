"""The example programs, run as a person runs them: on the mock, one picture each."""

import re
import runpy
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from skimage.io import imread

import haptix
from tests.programs import load

FOLDER = Path(__file__).parents[2] / "examples"
SHORT_PATH = "t_s,x_mm,y_mm,normal_force_n\n" + "".join(
    f"{i / 100},{5 + i},{20 + i / 5},0.5\n" for i in range(31)
)


@pytest.fixture
def short(tmp_path, monkeypatch):
    """A program, and the arguments that make it short."""
    (tmp_path / "path.csv").write_text(SHORT_PATH)
    monkeypatch.chdir(tmp_path)

    def program(name):
        module = load(f"examples/{name}.py")
        if hasattr(module, "SECONDS"):
            monkeypatch.setattr(module, "SECONDS", 0.8)
        options = {"path": Path("path.csv")} if name == "photograph_explorer" else {}
        return lambda **more: module.main(**{**options, **more})

    return program


PROGRAMS = ("photograph_explorer", "moving_edge", "slider_with_detents", "two_fingers")


@pytest.mark.parametrize(
    "name",
    [
        name if name.startswith(("photo", "slider")) else pytest.param(name, marks=pytest.mark.slow)
        for name in PROGRAMS
    ],
)
def test_a_program_draws_its_picture(short, name, capsys, tmp_path):
    short(name)(out=Path("picture.png"))
    picture = imread(tmp_path / "picture.png")
    # More than a blank page: paper, lines of several colours.
    assert picture.shape[0] > 500
    assert len(np.unique(picture[::7, ::7, :3].reshape(-1, 3), axis=0)) > 20
    assert [file.name for file in tmp_path.iterdir() if file.suffix == ".png"] == ["picture.png"]
    printed = capsys.readouterr().out
    felt = [float(number) for number in re.findall(r"([\d.]+) JND", printed)]
    # A drive that is nowhere near the texture errs by the range: 0.06 of 0.27, some 2 JND.
    assert felt
    assert max(felt) < 1.5
    assert "0 underruns" in printed


def test_the_picture_of_the_readme_is_of_a_photograph_and_of_what_is_felt(tmp_path, capsys):
    pytest.importorskip("matplotlib", reason="the extra figures")
    program = load("examples/photograph_to_friction.py")
    program.main(out=str(tmp_path / "picture.png"))
    kept = imread(FOLDER.parent / "docs" / "photograph-to-friction.png")
    made = imread(tmp_path / "picture.png")
    assert made.shape == kept.shape
    # Another matplotlib may draw letters and lines a little otherwise; another stroke differs more.
    assert np.abs(made.astype(float) - kept).mean() < 8
    assert float(re.search(r"within ([\d.]+) JND", capsys.readouterr().out)[1]) < 0.5


def test_real_time_is_played_and_not_evaluated(short, steady_mock, capsys, tmp_path):
    short("moving_edge")(device="mock:pace=real")
    printed = capsys.readouterr().out
    # How much of the path is rendered in time, and how many underruns there are, is this machine's
    # affair: the numbers are there.
    assert int(re.match(r"(\d+) samples .*, \d+ underruns", printed)[1]) > 0
    assert not list(tmp_path.glob("*.png"))


WRONG: dict[str, list[tuple[dict[str, Any], str]]] = {
    "photograph_explorer": [
        ({"photograph": Path("missing.png")}, r"missing\.png"),
        ({"width_mm": 3.0}, "beside it.*--width-mm or --path"),
        ({"width_mm": -3.0}, "width_mm.*above 0"),
        ({"path": Path("missing.csv")}, r"missing\.csv"),
    ],
    "moving_edge": [({"device": "tape:"}, "tape:")],
    "slider_with_detents": [({"steps": 40}, "--steps.*40"), ({"steps": 1}, "--steps.*1")],
    "two_fingers": [({"combination": "loudest"}, "strongest.*'loudest'")],
}


@pytest.mark.parametrize("name", PROGRAMS)
def test_what_is_wrong_is_said_in_one_sentence(short, name, tmp_path):
    for options, pattern in WRONG[name]:
        with pytest.raises(haptix.HaptixError, match=pattern) as caught:
            short(name)(**options)
        assert "\n" not in str(caught.value)
    assert not list(tmp_path.glob("*.png"))


def test_a_shell_gets_one_line_and_an_exit_code(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["slider_with_detents.py", "--steps", "40"])
    with pytest.raises(SystemExit) as ended:
        runpy.run_path(str(FOLDER / "slider_with_detents.py"), run_name="__main__")
    # A text is Python's own way to say: this on the standard error, and the exit code 1.
    assert re.fullmatch(r"slider_with_detents: --steps: .*40.*", str(ended.value.code))
    assert capsys.readouterr() == ("", "")
