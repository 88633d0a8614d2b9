"""A link that another package brings: the example of docs/devices.md, installed and opened."""

import os
import re
import signal
import subprocess
import sys
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest

import haptix
from firmware_io import DeviceError, link, open_device, survey_buses
from tests.waiting import PATIENCE_S

ROOT = Path(haptix.__file__).parents[1]
PAGE = (ROOT / "docs" / "devices.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def environment(tmp_path_factory):
    """Of processes that find the package of the page beside haptix."""
    pytest.importorskip("hatchling", reason="the extra release")
    source, site = tmp_path_factory.mktemp("kept-link"), tmp_path_factory.mktemp("site")
    for name, text in re.findall(
        r"```\w+\n# (kept_link\.py|pyproject\.toml)\n(.*?)```", PAGE, re.S
    ):
        (source / name).write_text(text)
    subprocess.run(
        [sys.executable, "-m", "pip", "install", "-q", "--no-deps", "--no-index",
         "--no-build-isolation", "--target", site, source],
        check=True, timeout=300,
    )  # fmt: skip
    folder = tmp_path_factory.mktemp("service")
    return os.environ | {"PYTHONPATH": str(site), "HAPTIX_SERVICE": str(folder)}


def run(environment, *arguments):
    return subprocess.run(
        [sys.executable, *arguments],
        env=environment, capture_output=True, text=True, timeout=300, cwd=ROOT,
    )  # fmt: skip


def test_a_device_plays_through_it(environment, tmp_path):
    code = (
        "import sys; from firmware_io import open_device\n"
        "with open_device(f'kept:file={sys.argv[1]},ceiling_v=150') as device:\n"
        "    device.write([1.0, 2.0, 1.0]); print(device.capabilities.ceiling_v)\n"
    )
    done = run(environment, "-c", code, tmp_path / "host.bin")
    assert (done.stdout, done.stderr) == ("150.0\n", "")
    # What it keeps are frames: HELLO, SETUP, ARM, the samples and STOP, each begun alike.
    assert (tmp_path / "host.bin").read_bytes().count(b"HX") >= 5


def test_the_command_line_knows_its_keys(environment):
    for command, wrong, said in (
        (["play", "--device"], "kept:colour=red", r"the\s+keys\s+are\s+file,\s+ceiling_v"),
        (["serve", "--port", "0", "--device"], "kept:ceiling_v=high", r"must\s+be\s+a\s+number"),
    ):
        done = run(environment, "-m", "haptix.tasks.cli", *command, wrong)
        assert done.returncode == 2
        assert re.search(said, done.stderr)


@pytest.mark.slow  # starts the service; the command and a device open it above
def test_the_service_opens_it(environment, tmp_path):
    file = tmp_path / "host.bin"
    command = ["-m", "haptix.tasks.cli", "serve", "--port", "0", "--device", f"kept:file={file}"]
    with subprocess.Popen(
        [sys.executable, *command], stdout=subprocess.PIPE, text=True, env=environment, cwd=ROOT
    ) as process:
        assert process.stdout is not None
        assert "haptix serves kept" in process.stdout.readline()
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=PATIENCE_S)
    assert file.stat().st_size > 0


@pytest.fixture
def brings(monkeypatch):
    """Let a package bring a link, of the name and value that are given."""

    def bring(name, value):
        own = EntryPoint(name, value, "haptix.links")
        monkeypatch.setattr(link, "entry_points", lambda group: [own])
        link._links.cache_clear()
        link.scheme_names.cache_clear()

    yield bring
    monkeypatch.undo()
    link._links.cache_clear()
    link.scheme_names.cache_clear()


@pytest.mark.parametrize("value", ["no_such_module:SCHEME", "json:loads", "json:SCHEME"])
def test_one_that_cannot_be_used_is_told_and_hides_no_other(brings, value):
    brings("odd", value)
    with pytest.raises(DeviceError, match=rf"odd.*{value}"):
        open_device("odd:")
    reports = {report.kind: report for report in survey_buses()}
    assert not reports["odd"].available
    assert value in reports["odd"].detail
    assert "usb" in reports
    open_device("mock:").close()


def test_none_takes_the_place_of_one_of_ours(brings):
    brings("mock", "json:loads")
    open_device("mock:").close()
