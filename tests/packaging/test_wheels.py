"""The wheel installed alone: no source tree, no compiler, no extras; if it can be, no network."""

import json
import os
import platform
import re
import shlex
import shutil
import subprocess
import sys
import sysconfig
import zipfile
from email.parser import Parser
from importlib.metadata import distribution, requires
from pathlib import Path

import pytest

import haptix

ROOT = Path(haptix.__file__).parents[1]
TARGETS = {("Linux", "x86_64"): "linux-x86_64", ("Linux", "aarch64"): "linux-aarch64",
           ("Windows", "AMD64"): "windows-x86_64", ("Darwin", "arm64"): "macos-arm64",
           ("Darwin", "x86_64"): "macos-x86_64"}  # fmt: skip
pytestmark = pytest.mark.slow


def run(*arguments, **options):
    done = subprocess.run(
        [str(one) for one in arguments], capture_output=True, text=True, check=False, **options
    )
    assert not done.returncode, done.stdout + done.stderr
    return done.stdout


def build(folder, target):
    run(sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", folder, cwd=ROOT,
        env={**os.environ, "HAPTIX_TARGET": target})  # fmt: skip
    (wheel,) = folder.glob("*.whl")
    return wheel


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    pytest.importorskip("ziglang", reason="the extra release")
    target = TARGETS.get((platform.system(), platform.machine()))
    if target is None:
        pytest.skip(f"no wheel for {platform.machine()}")
    return build(tmp_path_factory.mktemp("platform"), target)


def base_distributions(wheel):
    """Distributions that `pip install` of the wheel brings, by its metadata and by theirs."""
    with zipfile.ZipFile(wheel) as file:
        (name,) = (name for name in file.namelist() if name.endswith(".dist-info/METADATA"))
        own = Parser().parsestr(file.read(name).decode()).get_all("Requires-Dist")
    found, left = set(), [own]
    while left:
        for line in left.pop():
            wanted, _, marker = line.partition(";")
            needed = re.split(r"[\s<>=!~\[(]", wanted.strip())[0].lower()
            if "extra ==" in marker or needed in found:
                continue
            try:
                distribution(needed)
            except ModuleNotFoundError:  # another system's, or CUDA's beside the CPU build of torch
                continue
            found.add(needed)
            left.append(requires(needed) or [])
    return found


@pytest.fixture(scope="module")
def alone(wheel, tmp_path_factory):
    """A fresh environment with the wheel; the base's dependencies are linked, not copied."""
    folder = tmp_path_factory.mktemp("alone")
    run(sys.executable, "-m", "venv", "--without-pip", folder / "venv")
    (packages,) = (folder / "venv").rglob("site-packages")
    for name in base_distributions(wheel):
        one = distribution(name)
        for top in {file.parts[0] for file in one.files or ()} - {"..", "__pycache__"}:
            source = Path(str(one.locate_file(top)))
            if source.exists() and not (packages / top).exists():
                (packages / top).symlink_to(source)
    (python,) = (folder / "venv").glob("*/python")
    run(sys.executable, "-m", "pip", "--python", python, "install", "-q", "--no-deps",
        "--no-index", wheel)  # fmt: skip
    empty = folder / "empty"
    empty.mkdir()
    unshare = shutil.which("unshare")
    without = (unshare, "-rn") if unshare else ()
    if without and subprocess.run([*without, "true"], check=False, capture_output=True).returncode:
        without = ()  # not every user may have a network of his own

    def haptix_alone(*arguments):
        # On PATH there is nothing but the environment: no compiler.
        own = {"PATH": str(python.parent), "HOME": str(empty), "XDG_CACHE_HOME": str(empty)}
        return run(*without, python.parent / "haptix", *arguments, cwd=empty, env=own)

    return haptix_alone, packages, empty


def test_the_demo_plays_with_nothing_else(alone):
    haptix_alone, packages, empty = alone
    told = haptix_alone("demo")
    assert "haptix-electrovibration[figures]" in re.sub(r"\s+", "", told)
    assert (empty / "haptix-demo" / "drive.wav").stat().st_size > 100_000
    assert "matplotlib" not in {path.name for path in packages.iterdir()}


def test_the_firmware_is_the_compiled_one(alone):
    haptix_alone, packages, _ = alone
    rows = {row["check"]: row for row in json.loads(haptix_alone("doctor", "--json"))}
    assert rows["haptix"]["detail"].startswith(haptix.__version__)
    assert rows["firmware"]["ok"] == "yes"
    assert {"usb", "hid", "serial", "audio", "daq"} <= set(rows)  # links, by their entry points
    assert list((packages / "firmware_io" / "firmware").glob("haptix-firmware.*"))
    assert not list((packages / "firmware_io" / "firmware").glob("*.c"))


@pytest.mark.parametrize("board", ["pico", "pico2"])
def test_the_firmware_of_a_pico_is_in_the_wheel(alone, board):
    haptix_alone, _, empty = alone
    haptix_alone("firmware", board, "--out", str(empty / "board.uf2"))
    assert (empty / "board.uf2").read_bytes().startswith(b"UF2")


def test_a_wheel_holds_what_runs(wheel):
    names = zipfile.ZipFile(wheel).namelist()
    tops = {name.partition("/")[0] for name in names}
    assert {top for top in tops if not top.endswith(".dist-info")} == {
        "haptix", "firmware_io", "calibration",
    }  # fmt: skip
    odd = re.compile(r"fuzz|\.c$|Makefile|boards/|test_|__pycache__|benchmark|c_libraries")
    assert not [name for name in names if odd.search(name)]


def test_a_wheel_from_the_sources_that_are_published_is_for_this_machine(tmp_path):
    """As `pip install` makes it, which is given no target."""
    run(sys.executable, "-m", "hatchling", "build", "-t", "sdist", "-d", tmp_path, cwd=ROOT)
    (archive,) = tmp_path.glob("*.tar.gz")
    run(sys.executable, "-m", "pip", "wheel", "-q", "--no-deps", "--no-build-isolation",
        "--no-index", "-w", tmp_path, archive)  # fmt: skip
    (wheel,) = tmp_path.glob("*.whl")
    own = re.sub(r"[-.]", "_", sysconfig.get_platform())
    assert wheel.name.endswith(f"-py3-none-{own}.whl")
    libraries = [name for name in zipfile.ZipFile(wheel).namelist() if "/haptix-firmware." in name]
    assert len(libraries) == 1


def test_a_wheel_knows_the_pages_of_the_project_where_the_release_names_them(tmp_path):
    code = (
        "from hatchling.metadata.core import ProjectMetadata as M; "
        "from hatchling.plugin.manager import PluginManager as P; "
        "core = M('.', P()).core; "
        "import json; print(json.dumps([core.urls, core.authors_data]))"
    )
    plain = {
        n: value for n, value in os.environ.items() if n not in ("HAPTIX_HOME", "HAPTIX_EMAIL")
    }
    urls, authors = json.loads(run(sys.executable, "-c", code, cwd=ROOT, env=plain))
    assert (urls, authors) == ({}, {"name": ["The haptix authors"], "email": []})
    env = {**plain, "HAPTIX_HOME": "https://example.org/x/haptix", "HAPTIX_EMAIL": "x@example.org"}
    urls, authors = json.loads(run(sys.executable, "-c", code, cwd=ROOT, env=env))
    assert authors == {"name": [], "email": ["The haptix authors <x@example.org>"]}
    assert urls["Homepage"] == "https://example.org/x/haptix"
    assert {"Documentation", "Changelog", "Issues"} <= set(urls)


def test_the_wheel_is_fit_to_be_published(wheel):
    pytest.importorskip("twine")
    assert "PASSED" in run(sys.executable, "-m", "twine", "check", "--strict", wheel)
    if sys.platform == "linux":
        told = run(sys.executable, "-m", "auditwheel", "show", wheel)
        assert '"manylinux_2_17_x86_64"' in told or "manylinux_2_17_aarch64" in told


@pytest.mark.parametrize("page", ["README.md", "docs/index.md"])
def test_the_line_of_a_page_installs_this_version(wheel, page):
    line = re.search(r"pip install --find-links dist .*", (ROOT / page).read_text("utf-8"))
    given = [wheel.parent if word == "dist" else word for word in shlex.split(line.group())[2:]]
    # --no-deps: what haptix needs is another test's; --no-index: PyPI has none yet.
    said = run(sys.executable, "-m", "pip", "install", "--dry-run", "--no-deps", "--no-index",
               "--ignore-installed", *given)  # fmt: skip
    assert f"Would install haptix-electrovibration-{haptix.__version__}" in said


def test_one_command_builds_in_a_fresh_clone(tmp_path):
    target = TARGETS.get((platform.system(), platform.machine()))
    run("git", "clone", "-q", ROOT, tmp_path / "clone")
    run("bash", "scripts/wheels.sh", cwd=tmp_path / "clone",
        env={**os.environ, "TARGETS": str(target)})  # fmt: skip
    built = [*(tmp_path / "clone" / "dist").glob(f"*-{haptix.__version__}-*.whl")]
    assert len(built) == 1
