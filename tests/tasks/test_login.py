"""The service at log-in: what each system is told, by its own checker where there is one."""

import plistlib
import shutil
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptix.tasks.login import LaunchdLogin, SystemdLogin, WindowsLogin, service_command

AWKWARD = ["/opt/a b/python", "--device", 'mock:name="50 %h" $HOME', "back\\slash", "é", ""]
TASK = "{http://schemas.microsoft.com/windows/2004/02/mit/task}"


@pytest.fixture
def home(tmp_path, monkeypatch):
    for name in ("XDG_CONFIG_HOME", "XDG_STATE_HOME", "HAPTIX_SERVICE"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("USERPROFILE", str(tmp_path))
    return tmp_path


@pytest.fixture
def system(home, monkeypatch):
    """A manager that takes all but what `refuses` names; what it was told stands in `told`."""

    class Manager:
        def __init__(self):
            self.refuses, self.told = "", []

        def run(self, command, **_):
            self.told.append(" ".join(command))
            failed = bool(self.refuses) and self.refuses in self.told[-1]
            return subprocess.CompletedProcess(command, int(failed), "", "no bus" if failed else "")

    manager = Manager()
    monkeypatch.setattr(subprocess, "run", manager.run)
    monkeypatch.setattr(sys, "platform", "linux")
    return manager


def test_systemd_accepts_the_unit(home):
    if not shutil.which("systemd-analyze"):
        pytest.skip("systemd-analyze")
    unit = home / "haptix.service"
    unit.write_bytes(SystemdLogin(home).text([sys.executable, "-P", *AWKWARD[1:]]))

    def verified():
        return subprocess.run(
            ["systemd-analyze", "--user", "verify", unit], capture_output=True, text=True,
            check=False,
            env={"XDG_RUNTIME_DIR": str(home), "HOME": str(home), "PATH": "/usr/bin:/bin"},
        )  # fmt: skip

    assert (verified().returncode, verified().stderr) == (0, "")
    unit.write_text(unit.read_text().replace("RestartSec=2", "RestartSec=soon"))
    assert "sec value" in verified().stderr  # it reads what it is given


@given(st.lists(st.text(st.characters(codec="utf-8", exclude_categories=["C"])), min_size=1))
def test_launchd_gets_each_word(words):
    fields = plistlib.loads(LaunchdLogin(Path("/Users/a")).text(words))
    assert fields["ProgramArguments"] == words
    assert fields["RunAtLoad"] is True


def test_windows_starts_it_for_this_user_alone_and_never_ends_it(home):
    text = WindowsLogin(home).text(["C:\\a b\\pythonw.exe", "-m", "one two", 'say "it"'])
    assert text.startswith(b"\xff\xfe")  # schtasks reads UTF-16
    root = ElementTree.fromstring(text)

    def read(path):
        return root.findtext("/".join(TASK + name for name in path.split("/")))

    assert read("Actions/Exec/Command") == "C:\\a b\\pythonw.exe"
    assert read("Actions/Exec/Arguments") == '-m "one two" "say \\"it\\""'
    assert read("Triggers/LogonTrigger/UserId") == read("Principals/Principal/UserId") != ""
    assert read("Principals/Principal/RunLevel") == "LeastPrivilege"
    assert read("Settings/ExecutionTimeLimit") == "PT0S"  # by default it ends after three days


def test_install_again_and_remove(haptix_cli, home, system):
    installed = haptix_cli("service", "install", "--device", "mock:pace=real,serial=a", "--port", 7)
    assert installed.code == 0, installed.err
    unit = home / ".config" / "systemd" / "user" / "haptix.service"
    first = unit.read_text()
    assert '"--device" "mock:pace=real,serial=a" "--port" "7"' in first
    assert haptix_cli("service", "install").code == 0
    assert "serial=a" not in unit.read_text()
    assert "systemctl --user restart haptix.service" in system.told
    assert haptix_cli("service", "remove").code == 0
    assert not [path for path in home.rglob("*") if path.is_file()]
    assert haptix_cli("service", "remove").code == 0  # a second time there is nothing to do


def test_where_no_manager_takes_it_nothing_is_left(haptix_cli, home, system):
    system.refuses = "enable"
    done = haptix_cli("service", "install")
    assert done.code == 2
    assert "no bus" in done.err
    assert "haptix serve" in done.err
    assert not [path for path in home.rglob("*") if path.is_file()]


def test_a_service_that_should_run_and_does_not_is_a_failure(haptix_cli, system):
    assert haptix_cli("service", "status").code == 0  # not installed
    haptix_cli("service", "install")
    assert haptix_cli("service", "status").code == 0
    system.refuses = "is-active"
    assert haptix_cli("service", "status").code == 1


def test_the_command_imports_nothing_of_the_working_folder(tmp_path):
    command = service_command(tmp_path / "a.log", ["--port", "x"])
    (tmp_path / "haptix.py").write_text("raise SystemExit('the wrong one')")
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert "--port" in done.stderr
    assert done.returncode == 2
