"""Arguments that no command can use are refused in one sentence before torch loads."""

import json
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

import haptix

ROOT = Path(haptix.__file__).parents[1]

# Tries every wrong value of every parameter that the command line defines, in one process.
TRY_ALL = """
import contextlib, inspect, io, json, sys
from typing import get_args, get_type_hints
from typer.main import get_command
import haptix.cli

def commands(group, before=()):
    for name in group.list_commands(None):
        found = group.get_command(None, name)
        if hasattr(found, "list_commands"):
            yield from commands(found, (*before, name))
        else:
            yield (*before, name), found

NUMBERS = ("nan", "-inf", "ten", "", "1,2,3,4")
TEXTS = ("normal_force_n", "voltage_v", "frequency_hz", "h0_m", "mu", "mu_range")
results = []

def attempt(words, value, option):
    option = [option.opts[0], value] if option.opts[0].startswith("-") else ["--", value]
    out, err = io.StringIO(), io.StringIO()
    sys.argv = ["haptix", *words, *option]
    code, error = 0, ""
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            haptix.cli.main()
        except SystemExit as end:
            code = end.code
        except BaseException as raised:
            error = repr(raised)
    results.append([" ".join(words), *option, code, out.getvalue(), err.getvalue(), error,
                    "torch" in sys.modules])

for words, command in commands(get_command(haptix.cli.app)):
    hints = get_type_hints(inspect.unwrap(command.callback))
    for one in command.params:
        kinds = {hints.get(one.name)} | set(get_args(hints.get(one.name)))
        if kinds & {float, int, list[float]} or one.name in TEXTS:
            for value in NUMBERS:
                attempt(words, value, one)
print(json.dumps(results))
"""


def test_every_number_that_is_none_is_refused_in_a_sentence_before_torch_loads():
    done = subprocess.run(
        [sys.executable, "-c", TRY_ALL], capture_output=True, text=True, cwd=ROOT, check=False
    )
    assert done.returncode == 0, done.stderr
    tried = [Tried(*one) for one in json.loads(done.stdout)]
    assert len(tried) > 250
    assert [one for one in tried if not one.is_refused] == []


@dataclass(frozen=True)
class Tried:
    words: str
    option: str
    value: str
    code: int
    out: str
    err: str
    raised: str
    loads_torch: bool

    @property
    def is_refused(self):
        told = self.err.startswith("haptix: ") or "Error: " in self.err
        return (self.code, self.out, self.raised) == (2, "", "") and told and not self.loads_torch


@pytest.mark.parametrize(
    "arguments",
    [
        ("invert", "missing.surface", "--mu", "0.3", "--normal-force-n", "0.5"),
        ("plan", "."),
        ("build", "a.surface", "--tolerance", "0.002 N"),
        ("build", "a.surface", "--tolerance", "1e-12"),
        ("build", "a.surface", "--tolerance", "1e-12 %"),
        ("demo", "--width-mm", "1e-9"),
        ("render", "--lead-ms", "1e6"),
        ("play", "--horizon-ms", "1e6"),
        ("build", "a.surface", "--normal-force-n", ""),
        ("export", "a" * 5000, "b.nc"),
        ("material", "show", "ribs.toml"),
        ("render", "--trajectory", "."),
        ("calibrate", "plan", "p.toml", "--finger", "mine.toml"),
        ("calibrate", "plan", "p.toml", "--screen", "ipad"),
        ("calibrate", "plan", "p.toml", "--protocol", "long"),
        ("calibrate", "run", "file", "--practice"),
        ("stimuli", "run", "missing.toml", "--log", "l.csv"),
        ("play", "--device", "tape:"),
        ("query", "--normal-force-n", "1", "--voltage-v", "1", "--theory", "mine"),
        ("demo", "--out", "file/deep"),
    ],
)
def test_words_and_files_that_are_none_are_refused_before_anything_is_read(
    haptix_cli, own_folder, monkeypatch, arguments
):
    (own_folder / "file").write_text("x")
    for name in (
        "torch",
        "haptix.surface.surface",
        "haptix.friction",
        "haptix.finger",
        "haptix.scene",
    ):
        monkeypatch.setitem(sys.modules, name, None)  # importing it would be an error
    shown = haptix_cli(*arguments)
    assert (shown.code, shown.out) == (2, "")
    assert shown.err.startswith("haptix: ")
    assert len(shown.err.splitlines()) == 1


@pytest.mark.parametrize(
    ("arguments", "kept"),
    [
        (("export", "a.surface", "a.surface", "--overwrite"), "a.surface"),
        (("build", "scene.toml", "--out", "scene.toml", "--overwrite"), "scene.toml"),
        (("build", "./mine.toml.surface", "--finger", "mine.toml", "--overwrite"), "mine.toml"),
        (("material", "show", "m.toml", "--out", "./m.toml"), "m.toml"),
        (("stimuli", "show", "s.wav", "--out", "s.wav"), "s.wav"),
        (("stimuli", "show", "s.wav", "--out", "s.json"), "s.json"),
    ],
)
def test_no_output_destroys_an_input(haptix_cli, own_folder, arguments, kept):
    for name in ("a.surface", "scene.toml", "m.toml", "s.wav", "s.json", "mine.toml"):
        (own_folder / name).write_text("what took hours")
    if "--finger" in arguments:  # by another name
        (own_folder / "mine.toml.surface").hardlink_to(own_folder / "mine.toml")
    shown = haptix_cli(*arguments)
    assert (shown.code, shown.out) == (2, "")
    assert "name another" in shown.err
    assert (own_folder / kept).read_text() == "what took hours"


def test_an_unknown_key_is_told_before_one_that_is_missing(haptix_cli, own_folder):
    (own_folder / "scene.toml").write_text("nmae = 'mistyped'")
    shown = haptix_cli("plan", "scene.toml")
    assert shown.code == 2
    assert "nmae" in shown.err
