"""The service at log-in: a unit of systemd, an agent of launchd, or a scheduled task of Windows."""

from __future__ import annotations

import getpass
import json
import os
import plistlib
import shutil
import subprocess
import sys
from abc import ABC, abstractmethod
from collections.abc import Sequence
from http.client import HTTPException
from pathlib import Path, PurePath
from typing import Annotated, Any
from urllib.request import ProxyHandler, Request, build_opener
from xml.etree import ElementTree

import platformdirs
from pydantic import Field

from haptix.base.errors import HaptixError, InputError
from haptix.base.fields import Address
from haptix.base.files import read_json, write_whole
from haptix.base.task import Context, Result, Task
from haptix.model.presets import FingerName, ScreenName
from haptix.service.protocol.limiter import service_folder

ABOUT = "haptix: friction for the apps of this user"
_WAITS_S = 60.0
_ANSWERS_S = 2.0
_DIRECT = build_opener(ProxyHandler({}))  # no proxy knows this machine


class Login(ABC):
    """What starts a program when this user logs in; one class for each system.

    Parameters
    ----------
    home : Path
        The user's home folder.
    """

    def __init__(self, home: Path) -> None:
        self.home = home

    path: Path
    """The file that the system reads, or from which it was registered."""

    @abstractmethod
    def text(self, command: Sequence[str]) -> bytes:
        """Return the file for a command."""

    begin: Sequence[Sequence[str]]
    """Commands that let the system read the file and start the service; all must succeed."""
    end: Sequence[Sequence[str]]
    """Commands that stop it and let the system forget it; those that fail had nothing to do."""
    forget: Sequence[Sequence[str]] = ()
    """Commands after the file is gone."""
    state: Sequence[str]
    """Command that succeeds while the system runs the service."""


class SystemdLogin(Login):
    """A user unit: `man systemd.service`, `man systemd.unit`."""

    def __init__(self, home: Path) -> None:
        super().__init__(home)
        config = os.environ.get("XDG_CONFIG_HOME") or home / ".config"
        self.path = Path(config) / "systemd" / "user" / "haptix.service"
        control = ("systemctl", "--user")
        self.begin = (
            (*control, "daemon-reload"),
            (*control, "enable", self.path.name),
            (*control, "restart", self.path.name),
        )
        self.end = ((*control, "disable", "--now", self.path.name),)
        self.forget = ((*control, "daemon-reload"), (*control, "reset-failed", self.path.name))
        self.state = (*control, "--quiet", "is-active", self.path.name)

    def text(self, command: Sequence[str]) -> bytes:
        """Return the unit; after five failures in a minute it is left alone."""
        quoted = " ".join(_in_unit(word) for word in command)
        return (
            f"[Unit]\nDescription={ABOUT}\nStartLimitIntervalSec=60\nStartLimitBurst=5\n\n"
            f"[Service]\nExecStart={quoted}\nRestart=on-failure\nRestartSec=2\n\n"
            "[Install]\nWantedBy=default.target\n"
        ).encode()


def _in_unit(word: str) -> str:
    r"""Quote a word of a command: ``%`` and ``$`` stand for themselves where they are doubled."""
    for sign, written in (("\\", "\\\\"), ('"', '\\"'), ("%", "%%"), ("$", "$$")):
        word = word.replace(sign, written)
    return f'"{word}"'


class LaunchdLogin(Login):
    """A LaunchAgent: `man launchd.plist`."""

    label = "org.haptix.service"

    def __init__(self, home: Path) -> None:
        super().__init__(home)
        self.path = home / "Library" / "LaunchAgents" / f"{self.label}.plist"
        domain = f"gui/{getattr(os, 'getuid', int)()}"
        self.begin = (("launchctl", "bootstrap", domain, str(self.path)),)
        self.end = (("launchctl", "bootout", f"{domain}/{self.label}"),)
        self.state = ("launchctl", "print", f"{domain}/{self.label}")

    def text(self, command: Sequence[str]) -> bytes:
        """Return the agent; it is started again after a failure, ten seconds apart."""
        fields = {
            "Label": self.label,
            "ProgramArguments": [*command],
            "RunAtLoad": True,
            "KeepAlive": {"SuccessfulExit": False},
            "ProcessType": "Interactive",  # touches are answered in milliseconds
        }
        return plistlib.dumps(fields)


class WindowsLogin(Login):
    """A task of the Task Scheduler for this user, without rights of an administrator.

    Its form is the schema of [MS-TSCH] 2.5, version 1.2.
    """

    name = "haptix"

    def __init__(self, home: Path) -> None:
        super().__init__(home)
        self.path = service_folder() / "at-log-in.xml"
        task = ("/TN", self.name)
        self.begin = (
            ("schtasks", "/Create", *task, "/XML", str(self.path), "/F"),
            ("schtasks", "/Run", *task),
        )
        self.end = (("schtasks", "/End", *task), ("schtasks", "/Delete", *task, "/F"))
        self.state = ("schtasks", "/Query", *task)

    def text(self, command: Sequence[str]) -> bytes:
        """Return the task, which starts again three times after a failure."""
        domain = os.environ.get("USERDOMAIN")
        user = f"{domain}\\{getpass.getuser()}" if domain else getpass.getuser()
        tree: dict[str, Any] = {
            "RegistrationInfo": {"Description": ABOUT},
            "Triggers": {"LogonTrigger": {"Enabled": "true", "UserId": user}},
            "Principals": {
                "Principal": {
                    "@id": "Author",
                    "UserId": user,
                    "LogonType": "InteractiveToken",
                    "RunLevel": "LeastPrivilege",
                }
            },
            "Settings": {
                "MultipleInstancesPolicy": "IgnoreNew",
                "DisallowStartIfOnBatteries": "false",
                "StopIfGoingOnBatteries": "false",
                "ExecutionTimeLimit": "PT0S",
                "RestartOnFailure": {"Interval": "PT1M", "Count": "3"},
            },
            "Actions": {
                "@Context": "Author",
                "Exec": {
                    "Command": str(command[0]),
                    "Arguments": subprocess.list2cmdline(command[1:]),
                },
            },
        }
        marks = {
            "@version": "1.2",
            "@xmlns": "http://schemas.microsoft.com/windows/2004/02/mit/task",
        }
        root = _element("Task", marks | tree)
        text = ElementTree.tostring(root, encoding="unicode")
        return f'<?xml version="1.0" encoding="UTF-16"?>\n{text}'.encode("utf-16")


def _element(name: str, content: dict[str, Any] | str) -> ElementTree.Element:
    """Return an element with its children; a name with ``@`` is an attribute."""
    if isinstance(content, str):
        element = ElementTree.Element(name)
        element.text = content
        return element
    marks = {key[1:]: value for key, value in content.items() if key.startswith("@")}
    element = ElementTree.Element(name, marks)
    element.extend(_element(key, each) for key, each in content.items() if key[0] != "@")
    return element


def login() -> Login:
    """Return that of this system."""
    system = {"darwin": LaunchdLogin, "win32": WindowsLogin}.get(sys.platform, SystemdLogin)
    return system(Path.home())


def log_file() -> Path:
    """Return the file to which the service at log-in logs."""
    return platformdirs.user_log_path("haptix", appauthor=False) / "service.log"


def service_command(log: Path, options: Sequence[str]) -> list[str]:
    """Return the command that serves; on Windows by the Python that opens no console."""
    python = PurePath(sys.executable)
    quiet = Path(python.with_name("pythonw.exe"))
    if sys.platform == "win32" and python.name.lower() == "python.exe" and quiet.exists():
        python = quiet
    module = ("-P", "-m", "haptix.tasks.cli")  # -P: no file of the working folder is imported
    return [str(python), *module, "--log", "info", "serve", "--log", str(log), *options]


class InstallService(Task, command="service install"):
    """Start the service whenever you log in, and now. The same command again replaces it.

    It is `haptix serve` with these options. It starts at 0 V, and an app arms it.
    """

    device: Address = Field("mock:pace=real", description="The driver, see `haptix devices`.")
    finger: FingerName | None = Field(
        None, description="Finger. [default: finger.toml beside a calibrated screen, or semi-wet]"
    )
    screen: ScreenName | None = Field(
        None, description="Screen. [default: the device's installed profile, or 3m-sct3250]"
    )
    port: Annotated[int, Field(ge=1, le=65535)] = Field(7421, description="TCP port.")

    def run(self, context: Context) -> Result:
        """Write the file of this system, and start the service."""
        system, log = login(), log_file()
        options = ["--device", self.device, "--port", str(self.port)]
        for name in ("finger", "screen"):
            if value := getattr(self, name):
                there = Path(value).expanduser()
                options += [f"--{name}", str(there.absolute()) if there.exists() else value]
        log.parent.mkdir(parents=True, exist_ok=True)
        system.path.parent.mkdir(parents=True, exist_ok=True)
        _do(system.end)  # a running one reads its file no more
        write_whole(system.path, system.text(service_command(log, options)))
        try:
            _do(system.begin, must=True)
        except HaptixError:
            system.path.unlink()
            raise
        return Result(
            {"file": str(system.path), "log": str(log)},
            lines=[f"the service starts when you log in, and now: {system.path}", f"log: {log}"],
        )


class RemoveService(Task, command="service remove"):
    """Stop the service, and start it no more. What you made stays: layouts, profiles, surfaces.

    Its file and its log are removed, the tokens of pages, the person's strength, and the pictures
    that pages sent;
    `haptix cache --clear` removes the surfaces that were solved by themselves.
    """

    def run(self, context: Context) -> Result:
        """Remove what `haptix service install` and the service have written for themselves."""
        system, log, folder = login(), log_file(), service_folder()
        was_there = system.path.exists()
        _do(system.end)
        gone = [system.path, *log.parent.glob(f"{log.stem}*.log"), *log.parent.glob(".*.log.lock")]
        if running_service() is None:  # that of `haptix serve` keeps its own
            gone += [folder / f"{name}.json" for name in ("service", "tokens", "person")]
            gone += [folder / name for name in ("studio.html", "service.lock")]
            for name in ("assets", "apps"):
                shutil.rmtree(folder / name, ignore_errors=True)
        for path in gone:
            path.unlink(missing_ok=True)
        for empty in (log.parent, folder):
            if empty.is_dir() and not any(empty.iterdir()):
                empty.rmdir()
        _do(system.forget)
        state = "removed" if was_there else "there was none"
        return Result({"removed": was_there}, lines=[f"the service at log-in: {state}"])


class ServiceStatus(Task, command="service status"):
    """Say whether the service starts when you log in, whether it runs, and where its log is."""

    def run(self, context: Context) -> Result:
        """Ask the system, and the port that service.json names."""
        system, log = login(), log_file()
        is_installed = system.path.exists()
        runs = is_installed and _do([system.state])
        document = {
            "installed": is_installed,
            "running": runs,
            "address": f"http://127.0.0.1:{found[0]}" if (found := running_service()) else "",
            "file": str(system.path),
            "log": str(log),
        }
        row = {
            name: ("no", "yes")[value] if isinstance(value, bool) else value
            for name, value in document.items()
        }
        table = ("the service at log-in", [row])
        return Result(document, [table], failed=is_installed and not runs)


def _do(commands: Sequence[Sequence[str]], must: bool = False) -> bool:
    """Run commands in turn; return whether all succeeded, or raise the first complaint."""
    good = True
    for command in commands:
        try:
            done = subprocess.run(
                command, capture_output=True, text=True, errors="replace", check=False,
                timeout=_WAITS_S, stdin=subprocess.DEVNULL,
            )  # fmt: skip
            failed, why = done.returncode != 0, (done.stderr or done.stdout).strip()
        except (OSError, subprocess.TimeoutExpired) as error:
            failed, why = True, str(error)
        good = good and not failed
        if failed and must:
            raise InputError(
                f"{' '.join(command[:3])}: {' '.join(why.split())[:300]}; log in at this machine's "
                "screen and try again, or run `haptix serve` yourself"
            )
    return good


def running_service() -> tuple[int, str] | None:
    """Return port and code of the service of this user, or None where none answers."""
    try:
        found = read_json(service_folder() / "service.json")
        port = int(found["port"])
        request = Request(
            f"http://127.0.0.1:{port}/v1/pair/code",
            headers={"Authorization": f"Bearer {found['token']}"},
        )
        with _DIRECT.open(request, timeout=_ANSWERS_S) as answer:
            return port, str(json.load(answer)["code"])
    except (HaptixError, HTTPException, OSError, ValueError, KeyError, TypeError):
        return None  # its file is damaged, or another program has its port
