"""The pages quote the stored figures; a figure that is older than its sources does not stay so."""

import datetime
import re
import tomllib
from dataclasses import replace
from pathlib import Path

import pytest

import haptix
from firmware_io.limits import ABSOLUTE_CEILING_V
from haptix.model.perception.thresholds import WEBER_FRACTION
from tests.programs import load

ROOT = Path(haptix.__file__).parents[1]
figures = load("scripts/figures.py")
KEPT = figures.read()
DAY = datetime.timedelta(days=1)


@pytest.mark.parametrize("page", figures.PAGES, ids=lambda page: page.name)
def test_a_page_quotes_the_figures_that_are_stored(page):
    text = page.read_text(encoding="utf-8")
    assert figures.filled(text, KEPT) == text, "run scripts/figures.py write"
    changed = {name: replace(one, value="3 bananas") for name, one in KEPT.items()}
    assert figures.filled(text, changed) != text


@pytest.mark.parametrize("name", KEPT)
def test_a_figure_says_where_it_comes_from(name):
    figure = KEPT[name]
    assert (ROOT / figure.command.split()[0]).is_file()
    assert re.fullmatch("[0-9a-f]{7,}", figure.commit)
    assert bool(figure.groups) != bool(figure.page)
    for source in figure.sources:
        assert (ROOT / source).exists(), source


@pytest.mark.parametrize("name", [name for name, one in KEPT.items() if one.page])
def test_a_page_says_the_value_and_which_program_made_it(name):
    page = (ROOT / KEPT[name].page).read_text(encoding="utf-8")
    assert KEPT[name].value in page
    assert Path(KEPT[name].command.split()[0]).stem in page


def test_every_program_that_measures_has_a_figure_or_serves_another():
    programs = {path.stem: path.read_text("utf-8") for path in (ROOT / "benchmarks").glob("*.py")}
    named = {Path(one.command.split()[0]).stem for one in KEPT.values()}
    users = [*programs.values(), (ROOT / "Makefile").read_text("utf-8")]
    for folder in ("examples", "tests"):
        users += [path.read_text("utf-8") for path in (ROOT / folder).rglob("*.py")]
    for name in set(programs) - named:
        uses = rf"import {name}\b|from (?:benchmarks\.)?{name} import|benchmarks/{name}\.py"
        others = [text for text in users if text is not programs[name]]
        assert any(re.search(uses, text) for text in others), name


@pytest.mark.optional
def test_a_figure_names_a_commit_of_this_history():
    if figures.git("rev-parse", "--is-shallow-repository") != "false":
        pytest.skip("needs a clone with its history")
    known = set(figures.git("log", "--format=%h", "--abbrev=7").splitlines())
    lost = {one.name: one.commit for one in KEPT.values() if one.commit not in known}
    assert not lost, "made on a branch that was rebased: name the commit that brought it here"


def test_the_readme_has_the_numbers_of_the_code():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    assert f"(JND) is {100 * WEBER_FRACTION:.0f} % of the friction" in text
    assert f"up to {ABSOLUTE_CEILING_V:.0f} V" in text
    assert f"Python {settings['project']['requires-python'].removeprefix('>=')} or newer" in text


@pytest.mark.parametrize("name", KEPT)
def test_no_figure_stays_older_than_its_sources(name):
    assert not KEPT[name].is_stale(figures.last_change()), (
        f"its sources changed and it is more than {figures.GRACE_DAYS} days old: "
        f"scripts/figures.py make {name}"
    )


def test_at_a_release_every_figure_is_of_its_sources():
    old = [name for name, one in KEPT.items() if one.groups and not one.is_current]
    assert "dev" in haptix.__version__ or not old


def test_a_changed_source_is_told_and_after_a_time_an_error(tmp_path, monkeypatch):
    monkeypatch.setattr(figures, "ROOT", tmp_path)
    (tmp_path / "room").mkdir()
    source = tmp_path / "room" / "physics.py"
    source.write_text("A = 1\n")
    figure = replace(KEPT["contact"], sources=("room",), sha256=figures.digest(("room",)))
    much_later = figure.date + 365 * DAY
    assert figure.is_current
    assert not figure.is_stale(much_later)  # a figure of the same sources does not age
    source.write_text("A = 2\n")
    assert not figure.is_current
    assert not figure.is_stale(figure.date + 30 * DAY)
    assert figure.is_stale(figure.date + 31 * DAY)
    source.write_text("A = 1\n")
    (tmp_path / "room" / "more.c").write_text("int a;\n")
    assert not figure.is_current


def test_a_value_is_the_worst_of_the_numbers_that_a_command_prints():
    printed = "A/A0 2e-15 mean gap 3e-06 I 1e-04\nA/A0 9e-16 mean gap 4e-06 I 2e-04\n"
    assert KEPT["contact"].value_of(printed) == "2e-15, 4e-06, 2e-04"
    with pytest.raises(ValueError, match="contact"):
        KEPT["contact"].value_of("nothing")
