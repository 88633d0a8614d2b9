"""The libraries in C of a checkout: built at its own place, and again when a source has changed."""

import shutil
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

import haptix
from tests.programs import load

ROOT = Path(haptix.__file__).parents[1]
NAME = "haptix-firmware"


@pytest.fixture
def checkout(tmp_path):
    """A checkout with nothing but what the firmware needs, and no library yet."""
    shutil.copytree(
        ROOT / "firmware_io", tmp_path / "firmware_io", ignore=shutil.ignore_patterns("__pycache__")
    )
    shutil.copy(ROOT / "c_libraries.py", tmp_path)
    return tmp_path


@pytest.fixture
def builder(checkout):
    """Its c_libraries.py as a module."""
    return load(checkout / "c_libraries.py")


def kept(checkout):
    return sorted((checkout / "build" / "libraries").glob("*"))


def opens(checkout):
    """What a new process in a checkout says of the library that it loaded."""
    code = """
        from firmware_io.firmware.core import compiled
        compiled()
        print(*(line.split()[-1] for line in open("/proc/self/maps") if "haptix-firmware" in line))
    """
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(code)],
        cwd=checkout, capture_output=True, text=True, check=True,
    )  # fmt: skip
    return set(map(Path, done.stdout.split()))


@pytest.mark.skipif(sys.platform != "linux", reason="reads Linux's list of loaded files")
def test_a_process_loads_the_library_of_its_own_checkout_as_its_sources_are(checkout):
    before = opens(checkout)
    assert before == set(kept(checkout))
    assert len(before) == 1
    with (checkout / "firmware_io" / "firmware" / "haptix_window.c").open("a") as source:
        source.write("int hx_added(void);\nint hx_added(void) { return 1; }\n")
    after = opens(checkout)
    assert len(after) == 1
    assert after.isdisjoint(before)
    assert b"hx_added" in after.pop().read_bytes()


def test_a_library_is_built_once(builder, checkout):
    path = builder.built(NAME)
    built = path.stat().st_mtime_ns
    assert builder.built(NAME) == path
    assert path.stat().st_mtime_ns == built
    assert kept(checkout) == [path]


@pytest.mark.parametrize("changed", ["a header", pytest.param("a flag", marks=pytest.mark.slow)])
def test_what_else_goes_into_it_builds_it_again(builder, checkout, monkeypatch, changed):
    path = builder.built(NAME)
    if changed == "a header":
        with (checkout / "firmware_io" / "firmware" / "haptix_sine.h").open("a") as header:
            header.write("\n")
    else:
        own = builder.LIBRARIES[NAME]
        monkeypatch.setitem(builder.LIBRARIES, NAME, own._replace(flags=(*own.flags, "-DHX=1")))
    assert builder.built(NAME) != path


@pytest.fixture
def without_ziglang(builder, monkeypatch):
    monkeypatch.setattr(builder, "find_spec", lambda name: None)


@pytest.mark.usefixtures("without_ziglang")
def test_without_ziglang_the_systems_compiler_builds_it(builder, monkeypatch):
    if shutil.which("cc") is None:
        pytest.skip("cc is missing")
    monkeypatch.setenv("CC", "cc -DHX_NAMED")
    commands = []
    run = subprocess.run

    def seen(command, **options):
        commands.append(command)
        return run(command, **options)

    monkeypatch.setattr(subprocess, "run", seen)
    assert builder.built(NAME).exists()
    assert commands[0][:2] == ["cc", "-DHX_NAMED"]


@pytest.mark.usefixtures("without_ziglang")
def test_without_any_compiler_one_sentence_says_what_is_missing(builder, checkout, monkeypatch):
    monkeypatch.setenv("PATH", str(checkout))
    monkeypatch.delenv("CC", raising=False)
    with pytest.raises(builder.BuildError, match="pip install ziglang"):
        builder.built(NAME)
    with pytest.raises(builder.BuildError, match=r"aarch64-macos.*ziglang"):
        builder.compile_library(NAME, checkout / "any.dylib", "aarch64-macos")
    assert kept(checkout) == []


@pytest.mark.usefixtures("without_ziglang")
def test_a_compiler_that_fails_is_told_and_nothing_is_kept(builder, checkout, monkeypatch):
    if shutil.which("false") is None:
        pytest.skip("false is missing")
    monkeypatch.setenv("CC", "false")
    with pytest.raises(builder.BuildError, match=r"false -fPIC .*haptix-firmware"):
        builder.built(NAME)
    assert kept(checkout) == []


def test_a_full_disk_is_told_by_its_folder(builder, checkout, monkeypatch):
    def fill_up(*arguments, **options):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(builder, "compile_library", fill_up)
    with pytest.raises(builder.BuildError, match="No space left"):
        builder.built(NAME)
    assert kept(checkout) == []
