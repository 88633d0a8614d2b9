"""`make quick` finds the tests of a change; `make mutants` makes errors that Python can read."""

import ast
from pathlib import Path
from types import SimpleNamespace

import pytest

import haptix
from tests.programs import load

ROOT = Path(haptix.__file__).parents[1]
quick = load("scripts/quick.py")
mutants = load("scripts/mutants.py")


@pytest.fixture(scope="module")
def imports():
    return quick.Imports()


def test_names_that_load_on_first_use_are_found_where_they_are_defined(imports):
    for name in ("Finger", "FrictionSurface", "Layout"):
        assert imports.defined(f"haptix.{name}") == getattr(haptix, name).__module__
    assert imports.defined("numpy.ndarray") == ""


@pytest.mark.parametrize(
    ("changed", "covers"),
    [
        ("firmware_io/limits.py", "firmware_io/test_drive_limits.py"),
        ("firmware_io/firmware/haptix_window.c", "firmware_io/test_output_window.py"),
        ("haptix/studio/static/make.css", "studio/test_make.py"),
        ("tests/waiting.py", "service/test_heartbeat.py"),
        ("tests/packaging/test_figures.py", "packaging/test_figures.py"),
        ("docs/figures.toml", "packaging/test_quick.py"),
    ],
)
def test_the_nearest_tests_of_a_file_cover_it(imports, changed, covers):
    assert (ROOT / changed).is_file()
    near = quick.tests_near([Path(changed)], imports)
    assert Path("tests", covers) in near[: len(near) // 2 + 1]


def test_a_test_imports_what_its_folder_s_fixtures_import(imports):
    near = quick.tests_near([Path("tests/calibration/conftest.py")], imports)
    tests = sorted((ROOT / "tests" / "calibration").glob("test_*.py"))
    assert {ROOT / path for path in near} == {*tests}


def test_every_mutant_is_another_program():
    file = Path("firmware_io/limits.py")
    source = (ROOT / file).read_bytes()
    made = [*mutants.mutants_of(file)]
    assert len(made) > 50
    for one in made:
        end = one.start + len(one.before.encode())
        assert source[one.start : end] == one.before.encode()
        wrong = source[: one.start] + one.after.encode() + source[end:]
        assert ast.dump(ast.parse(wrong)) != ast.dump(ast.parse(source)), str(one)


def test_the_choice_of_mutants_follows_from_the_seed():
    first, again, other = (mutants.chosen(["firmware_io"], 20, seed) for seed in (1, 1, 2))
    assert first == again != other
    assert mutants.chosen(["firmware_io"], 10, 1) == first[:10]


def test_no_test_begins_after_its_minute_and_the_files_left_out_are_counted():
    tests = [SimpleNamespace(path=ROOT / name) for name in ("near", "far", "far")]
    in_time, late = (quick.ForAMinute([], seconds) for seconds in (60.0, 0.0))
    # None: pytest runs it as ever.
    assert {in_time.pytest_runtest_protocol(one) for one in tests} == {None}
    assert {late.pytest_runtest_protocol(one) for one in tests} == {True}
    assert (in_time.left_out, late.left_out) == (set(), {ROOT / "near", ROOT / "far"})
