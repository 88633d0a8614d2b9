"""What an example needs beside haptix is named where it is missing; a long run is announced."""

import ast
import re
import sys
import tomllib
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest

import haptix
from tests.programs import load

ROOT = Path(haptix.__file__).parents[1]
FOLDER = ROOT / "examples"


def unguarded_imports(source):
    """Modules whose absence nothing catches."""
    tree = ast.parse(source)
    guarded = {
        inner
        for node in ast.walk(tree)
        if isinstance(node, ast.Try)
        and any("ModuleNotFoundError" in ast.unparse(one.type) for one in node.handlers if one.type)
        for part in node.body
        for inner in ast.walk(part)
    }
    for node in ast.walk(tree):
        if node not in guarded and isinstance(node, ast.Import):
            yield from (name.name.partition(".")[0] for name in node.names)
        elif node not in guarded and isinstance(node, ast.ImportFrom):
            yield node.module.partition(".")[0]


def test_an_example_imports_what_is_always_there_or_says_what_is_missing():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    base = {re.split(r"[\s>=<;\[]", one)[0].lower() for one in project["dependencies"]}
    distributions = packages_distributions()
    always = sys.stdlib_module_names - {"tkinter"}  # which is a package of its own in Debian
    always |= {module for module, of in distributions.items() if base & {one.lower() for one in of}}
    always |= {"haptix", "firmware_io", "calibration"}
    programs = sorted(FOLDER.glob("*.py"))
    assert len(programs) > 9
    for path in programs:
        needed = set(unguarded_imports(path.read_text(encoding="utf-8")))
        assert needed <= always, path.name


def test_without_tkinter_the_window_names_its_package(monkeypatch):
    monkeypatch.setitem(sys.modules, "tkinter", None)
    with pytest.raises(SystemExit, match="python3-tk"):
        load("examples/mouse_finger.py")


def test_without_psychopy_the_script_names_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "psychopy", None)
    monkeypatch.setattr(sys, "argv", ["psychopy_schedule.py", "set", "log.tsv"])
    with pytest.raises(SystemExit, match="pip install psychopy"):
        load("examples/psychopy_schedule.py").main()


def test_a_script_without_its_files_says_how_it_is_called(monkeypatch):
    monkeypatch.setattr(sys, "argv", ["psychopy_schedule.py", "set"])
    with pytest.raises(SystemExit, match="FOLDER LOG"):
        load("examples/psychopy_schedule.py").main()


def test_without_evdev_the_touchscreen_names_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "evdev", None)
    with pytest.raises(haptix.HaptixError, match=r"\[evdev\]"):
        load("examples/touchscreen_photograph.py").main()


def test_a_calibration_says_first_how_long_it_takes(monkeypatch, capsys, tmp_path):
    class BegunError(Exception):
        pass

    def begin(*parts):
        raise BegunError

    monkeypatch.setattr(haptix, "ContactModel", begin)
    monkeypatch.setattr(sys, "argv", ["calibrate_screen.py", str(tmp_path)])
    with pytest.raises(BegunError):
        load("examples/calibrate_screen.py").main()
    assert re.search(r"takes .* minutes?", capsys.readouterr().out)
