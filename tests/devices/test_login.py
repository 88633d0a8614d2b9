"""The service at log-in under a real user instance of systemd, and by the schtasks of Wine."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from haptix.tasks.login import WindowsLogin

pytestmark = pytest.mark.devices


def test_systemd_starts_it_again_and_forgets_it(tmp_path):
    if not Path("/lib/systemd/systemd").exists() or not shutil.which("unshare") or os.getuid():
        pytest.skip("systemd, unshare and root, for a user instance of its own")
    done = subprocess.run(
        ["unshare", "-m", "--propagation", "private", sys.executable,
         Path(__file__).with_name("login_session.py"), tmp_path],
        capture_output=True, text=True, check=False, timeout=300,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    seen = json.loads(done.stdout)
    assert (seen["installed"], seen["again"], seen["removed"]) == (0, 0, 0)
    assert seen["running"]["running"] is True
    assert (seen["enabled"], seen["stop"]) == ("enabled", 204)
    assert seen["after a crash"]["address"] == seen["running"]["address"]
    assert seen["ended"] is True
    assert (seen["after"]["installed"], seen["after"]["running"]) == (False, False)
    assert "0 unit files" in seen["known"]
    assert all(name.startswith(".cache/haptix/") for name in seen["left"])  # solved surfaces


def test_schtasks_takes_the_task(tmp_path, monkeypatch):
    if not shutil.which("wine"):
        pytest.skip("wine")
    monkeypatch.setenv("HAPTIX_SERVICE", str(tmp_path))
    task = WindowsLogin(tmp_path)
    environment = {
        **os.environ, "WINEPREFIX": str(tmp_path / "wine"), "HOME": str(tmp_path),
        "WINEDEBUG": "-all", "DISPLAY": "",
    }  # fmt: skip

    def schtasks(*words):
        return subprocess.run(
            ["wine", "schtasks", *words], env=environment, capture_output=True, check=False,
            timeout=300,
        ).returncode  # fmt: skip

    windows_path = "Z:" + str(task.path).replace("/", "\\")
    text = task.text(["C:\\windows\\system32\\cmd.exe", "/c", "a b"])
    task.path.write_bytes(text)
    create = ("/Create", "/TN", "haptix", "/XML", windows_path, "/F")
    assert schtasks(*create) == 0
    assert schtasks("/Delete", "/TN", "haptix", "/F") == 0
    broken = text.decode("utf-16").replace("mit/task", "mit/tusk")
    task.path.write_bytes(broken.encode("utf-16"))
    assert schtasks(*create) != 0  # Wine reads the namespace and the parts, not all their fields
