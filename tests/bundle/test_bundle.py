"""The bundle that `make bundle` has built: it runs alone, plays, and is small enough."""

import json
import os
import socket
import subprocess
from pathlib import Path

import pytest

from haptix.feel import Grating
from haptix.service import connect
from tests.waiting import wait_for

FOLDER = Path(__file__).parents[2] / "build" / "bundle" / "haptix"
MOST_BYTES = 700e6
pytestmark = [pytest.mark.slow, pytest.mark.optional]


@pytest.fixture
def alone(tmp_path):
    """An environment without any Python, the checkout or a folder of haptix."""
    if not (FOLDER / "haptix").exists():
        pytest.skip("make bundle")
    return {"HOME": str(tmp_path), "PATH": "/usr/bin:/bin"}


def run(alone, *words):
    return subprocess.run(
        [FOLDER / "haptix", *words], env=alone, cwd=alone["HOME"], capture_output=True, text=True,
        check=False, timeout=300,
    )  # fmt: skip


def test_it_is_small_enough(alone):
    files = [path for path in FOLDER.rglob("*") if path.is_file() and not path.is_symlink()]
    assert sum(path.stat().st_size for path in files) < MOST_BYTES


def test_the_demo_runs(alone):
    done = run(alone, "demo", "--out", "demo")
    assert done.returncode == 0, done.stderr
    assert (Path(alone["HOME"]) / "demo" / "summary.json").exists()


def test_apps_feel_through_its_service(alone, monkeypatch):
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = str(free.getsockname()[1])
    monkeypatch.setenv("HAPTIX_SERVICE", str(Path(alone["HOME"]) / ".local/state/haptix/service"))
    served = subprocess.Popen(
        [FOLDER / "haptix", "serve", "--port", port], env=alone, cwd=alone["HOME"],
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, stdin=subprocess.DEVNULL,
    )  # fmt: skip
    try:

        def address():
            return json.loads(run(alone, "service", "status", "--json").stdout)["address"]

        assert wait_for(address) == f"http://127.0.0.1:{port}"
        with connect("test") as client:
            client.acquire()
            client.feel(Grating(period_mm=2))
            assert client.arm().state == "armed"
            client.stop()
            wait_for(lambda: client.output.state == "off")
    finally:
        served.terminate()
        served.wait(30)
    assert served.returncode in (0, 130, -15)


def test_uninstalling_leaves_nothing(alone, tmp_path):
    home, copy = Path(alone["HOME"]), tmp_path / "programs" / "haptix"
    copy.mkdir(parents=True)
    (copy / "_internal").symlink_to(FOLDER / "_internal")
    for name in ("haptix", "install.sh"):
        os.link(FOLDER / name, copy / name)
    for words in ((), ("remove",)):
        done = subprocess.run(
            [copy / "install.sh", *words], env=alone, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr
        entry = home / ".local" / "share" / "applications" / "haptix.desktop"
        assert entry.exists() == (not words)
    assert not copy.exists()
    assert not [path for path in home.rglob("*") if path.is_file()]
    assert (FOLDER / "_internal").is_dir()
