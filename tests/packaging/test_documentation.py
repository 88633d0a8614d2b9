"""Examples in docstrings run; pictures have alternative text; the start pages' programs run."""

import doctest
import re
from importlib import import_module
from pathlib import Path

import pytest

import haptix

ROOT = Path(haptix.__file__).parents[1]
MODULES = sorted(
    path.relative_to(ROOT).with_suffix("").as_posix().replace("/", ".").removesuffix(".__init__")
    for package in ("haptix", "firmware_io", "calibration")
    for path in (ROOT / package).rglob("*.py")
    if ">>>" in path.read_text(encoding="utf-8")
)
PAGES = [*sorted((ROOT / "docs").glob("*.md")), ROOT / "README.md"]


def test_there_are_examples_of_every_step():
    assert {name.split(".")[1] for name in MODULES if name.startswith("haptix.")} >= {
        "contact", "friction", "surface", "texture", "layout", "motion", "signals", "gallery",
    }  # fmt: skip


@pytest.mark.parametrize("name", MODULES)
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


@pytest.mark.slow
def test_the_ten_lines_run(capsys):
    first, second = (
        re.findall(r"```python\n(.*?)```", (ROOT / name).read_text("utf-8"), re.DOTALL)
        for name in ("README.md", "docs/start-app.md")
    )
    (program,) = first
    assert [re.sub(r"  #.*", "", program)] == second
    exec(compile(program, "README.md", "exec"), {})
    assert re.search(r"\d{4,} samples, at most \d+ V", capsys.readouterr().out)


def test_what_leads_into_the_repository_is_no_link_outside_it():
    from hatchling.metadata.core import ProjectMetadata
    from hatchling.plugin.manager import PluginManager

    text = ProjectMetadata(str(ROOT), PluginManager()).core.readme
    assert "haptix demo" in text
    assert "`docs/safety.md`" in text
    assert all(to.startswith("https://") for to in re.findall(r"\]\(([^)]*)\)", text))
