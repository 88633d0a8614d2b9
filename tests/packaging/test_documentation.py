"""Examples in docstrings run; pictures have alternative text; the start pages' programs run."""

import doctest
import json
import os
import re
import subprocess
import sys
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest
from typer.main import get_command

import haptix
from calibration.keep.practice import compare_with_truth
from haptix.tasks.cli import COMMANDS
from haptix.tasks.cli.application import app

ROOT = Path(haptix.__file__).parents[1]
MODULES = sorted(
    path.relative_to(ROOT).with_suffix("").as_posix().replace("/", ".").removesuffix(".__init__")
    for package in ("haptix", "firmware_io", "calibration")
    for path in (ROOT / package).rglob("*.py")
    if ">>>" in path.read_text(encoding="utf-8")
)
PAGES = [*sorted((ROOT / "docs").rglob("*.md")), ROOT / "README.md"]


def test_there_are_examples_of_every_step():
    assert {name.split(".")[1] for name in MODULES if name.startswith("haptix.")} >= {
        "model", "feel", "play", "plan", "lab",
    }  # fmt: skip


@pytest.mark.parametrize(
    "name",
    [  # a plan takes seconds; test_kept_files.py makes the same one by the command
        pytest.param(name, marks=pytest.mark.slow if name.endswith("planning") else ())
        for name in MODULES
    ],
)
def test_examples_in_docstrings_run(name):
    found = doctest.testmod(import_module(name))
    assert found.attempted > 0
    assert not found.failed  # doctest prints what came instead


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_pictures_have_alternative_text(page):
    text = page.read_text(encoding="utf-8")
    for words, target in re.findall(r"!\[([^\]]*)\]\(([^)\s]+)", text):
        assert len(words.split()) > 2, f"{page.name}: {target}"
        assert (page.parent / target).is_file(), target
    assert not re.findall(r"<img(?![^>]*\balt=.\w)", text)


PYTHON = re.compile(
    r"^(?:<!-- not run: (?P<why_not>.+?) -->\n)?"
    r"```python(?: exec=.1. source=.*)?\n(?P<text>.*?)^```",
    re.M | re.S,
)


def program_of(text):
    """The blocks of Python of a page, at their lines, and why the others are not run."""
    lines, why_not = [""] * text.count("\n"), []
    for block in PYTHON.finditer(text):
        if block["why_not"]:
            why_not.append(block["why_not"])
        else:
            first = text.count("\n", 0, block.start("text"))
            lines[first : first + block["text"].count("\n")] = block["text"].splitlines()
    return "\n".join(lines), why_not


WITH_PYTHON = [page for page in (*PAGES, *ROOT.glob("clients/*/README.md"))
               if "```python" in page.read_text(encoding="utf-8")]  # fmt: skip


@pytest.fixture(scope="module")
def cache(tmp_path_factory):
    """One cache for all pages: many build the same surface."""
    return tmp_path_factory.mktemp("cache")


@pytest.mark.slow
@pytest.mark.parametrize("page", WITH_PYTHON, ids=lambda page: page.name)
def test_the_blocks_of_python_of_a_page_run_from_its_top(page, cache, tmp_path):
    program, _ = program_of(page.read_text(encoding="utf-8"))
    (tmp_path / page.name).write_text(program, encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "-W", "error:::haptix", "-X", "utf8", page.name], cwd=tmp_path,
        env=environment(cache), check=False, capture_output=True, text=True,
    )  # fmt: skip
    assert not done.returncode, done.stderr
    if page.name == "README.md":
        assert re.search(r"\d{4,} samples \(0 below reach, 0 above, 0 outside", done.stdout)


@pytest.fixture(scope="module")
def programs(tmp_path_factory):
    """A folder with the program of each page."""
    folder = tmp_path_factory.mktemp("programs")
    for page in WITH_PYTHON:
        program = program_of(page.read_text(encoding="utf-8"))[0]
        name = f"{page.parent.name}_{page.stem}".replace("-", "_")
        (folder / f"{name}_page.py").write_text(program, encoding="utf-8")
    return folder


@pytest.mark.slow
@pytest.mark.parametrize("checker", ["mypy --strict --config-file=", "pyright --warnings"])
def test_the_programs_of_the_pages_hold_to_the_types(programs, checker):
    strict = {
        "typeCheckingMode": "strict",
        "reportUnknownMemberType": False,  # matplotlib's own types are unknown in part
    }
    (programs / "pyrightconfig.json").write_text(json.dumps(strict), encoding="utf-8")
    if checker.startswith("pyright"):
        checker += f" --pythonpath {sys.executable} -p"
    done = subprocess.run(
        [sys.executable, "-m", *checker.split(), str(programs)],
        cwd=ROOT, check=False, capture_output=True, text=True,
    )  # fmt: skip
    assert not done.returncode, done.stdout


def test_all_blocks_of_python_are_marked_as_such_and_few_are_not_run():
    why_not = {page.name: program_of(page.read_text(encoding="utf-8"))[1] for page in PAGES}
    assert {name: len(reasons) for name, reasons in why_not.items() if reasons} == {
        "README.md": 1, "devices.md": 1, "scale.md": 1, "service.md": 2,
    }  # fmt: skip
    for page in PAGES:  # an indented block of Python would be run by nobody
        outside = re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.M | re.S)
        assert not re.findall(r"^    (?:import|from|with|def) .*", outside, re.M), page.name


def test_the_ten_lines_of_the_readme_are_those_of_the_app_developer():
    first, second = (
        program_of((ROOT / name).read_text(encoding="utf-8"))[0].strip()
        for name in ("README.md", "docs/start-app.md")
    )
    assert re.sub(r"  #.*", "", first) == second


def test_files_that_the_architecture_names_are_there():
    text = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    whole = re.findall(r"`((?:haptix|firmware_io|calibration)/[\w/.]+)`", text)
    assert len(whole) > 30
    assert not [name for name in whole if not (ROOT / name).exists()]
    files = {path.name for room in ("haptix", "firmware_io", "calibration", "benchmarks")
             for path in (ROOT / room).rglob("*")}  # fmt: skip
    assert not [name for name in re.findall(r"`([\w/]+\.(?:py|c))`", text)
                if Path(name).name not in files]  # fmt: skip


STARTS = sorted((ROOT / "docs").glob("start-*.md"))
BLOCK = re.compile(
    r"^(?:Save this as `(?P<file>[^`]+)`:\n+)?```(?P<kind>\w+)\n(?P<text>.*?)^```", re.M | re.S
)


def printed(page):
    """Files to save and commands to type, in the order of a page."""
    text = page.read_text(encoding="utf-8")
    for block in BLOCK.finditer(text):
        if block["file"]:
            yield block["file"], block["text"]
        elif block["kind"] == "sh":
            yield from (("sh", line) for line in block["text"].splitlines() if line)
    yield from (("sh", line) for line in re.findall(r"^    (haptix .*?) +#", text, re.M))


def test_the_commands_of_the_readme_are_those_of_the_start_pages():
    there = {one for page in STARTS for one in printed(page)}
    of_readme = [*printed(ROOT / "README.md")]
    assert ("sh", "haptix demo") in of_readme
    assert {*of_readme} <= there | {("sh", "haptix studio")}


def environment(folder):
    path = os.pathsep.join((str(Path(sys.executable).parent), os.environ["PATH"]))
    return {**os.environ, "PATH": path, "PYTHONPATH": str(ROOT), "HAPTIX_CACHE": str(folder)}


@pytest.mark.slow
@pytest.mark.parametrize("page", STARTS, ids=lambda page: page.name)
def test_what_a_start_page_prints_works_as_printed(page, tmp_path):
    def typed(text):
        done = subprocess.run(
            ["bash", "-c", text], cwd=tmp_path, env=environment(tmp_path), check=False,
            capture_output=True, text=True, stdin=subprocess.DEVNULL,
        )  # fmt: skip
        assert not done.returncode, f"{text}\n{done.stdout}{done.stderr}"
        return done.stdout

    ran = []
    for kind, text in printed(page):
        if kind != "sh":
            (tmp_path / kind).write_text(text, encoding="utf-8")
        elif text != "haptix studio":  # tests/studio/test_whole_studio.py
            assert text.startswith("haptix ")
            typed(text)
            ran.append(text)
    assert ran
    if page.name == "start-app.md":
        assert {one.name for one in (tmp_path / "haptix-demo").iterdir()} >= {
            "demo.png",
            "drive.wav",
        }
    if page.name == "start-technician.md":
        worst_jnd = compare_with_truth(tmp_path / "practice", 180.0).friction_error_worst_jnd
        assert worst_jnd < 0.5
        # The second time everything is there.
        (again,) = (text for text in ran if "calibrate run" in text)
        told = json.loads(typed(f"{again} --json"))["practice"]
        assert told["friction_error_worst_jnd"] < 0.5


def test_commands_on_the_pages_have_the_options_that_they_name():
    definition: Any = get_command(app)  # commands and groups of them
    tried = 0
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        found = re.findall(r"`haptix ([a-z][^`\n]*)`", text)
        found += re.findall(r"^(?:    )?haptix ([a-z][^\n#]*)", text, re.MULTILINE)
        for line in found:
            if line.split()[0] not in COMMANDS:
                continue  # a sentence
            command, words = definition, line.split()
            while words and hasattr(command, "list_commands") and words[0] != "--help":
                command, known = command.get_command(None, words[0]), command
                assert command, f"{page.name}: haptix {line}: {known.name} has no {words[0]}"
                words = words[1:]
            options = {one for parameter in command.params for one in parameter.opts} | {"--help"}
            options |= {one for parameter in command.params for one in parameter.secondary_opts}
            named = set(re.findall(r"(?<=\s)--[a-z][a-z0-9-]*", line))
            assert named <= options, f"{page.name}: haptix {line}"
            tried += 1
    assert tried > 60


def test_what_leads_into_the_repository_is_no_link_outside_it():
    from hatchling.metadata.core import ProjectMetadata
    from hatchling.plugin.manager import PluginManager

    text = ProjectMetadata(str(ROOT), PluginManager()).core.readme
    assert "haptix demo" in text
    assert "`docs/safety.md`" in text
    assert all(to.startswith("https://") for to in re.findall(r"\]\(([^)]*)\)", text))


@pytest.mark.parametrize(
    ("page", "heading"),
    [
        ("touch.md", "What your panel may do"),
        ("devices.md", "What your driver or interface may do"),
    ],
)
def test_each_behaviour_of_devices_has_its_test(page, heading):
    """Each row names a test, or a check of the guest, that is there."""
    text = (ROOT / "docs" / page).read_text(encoding="utf-8")
    _, _, section = text.partition(f"# {heading}\n")
    rows = re.findall(r"^\|(.+)\|$", section.partition("\n#")[0], re.MULTILINE)[2:]
    assert len(rows) > 10
    for row in rows:
        *_, last = row.split(" | ")
        named = re.findall(r"`([^`]+)`", last)
        assert named, row
        for file, test in (name.split("::") for name in named):
            code = (ROOT / file).read_text(encoding="utf-8")
            assert f"\ndef {test}(" in code, f"{file}: {test}"
            is_check = file.startswith("tests/devices/guest/")
            assert test.startswith("test_") != is_check, test
