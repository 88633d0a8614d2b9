"""Install, kill and remove the service under a user instance of systemd; what it saw, as JSON.

    unshare -m --propagation private python login_session.py HOME [PROGRAM OF A BUNDLE]

In a mount namespace of its own: systemd runs user instances only where /run/systemd/system exists.
"""

import json
import os
import socket
import subprocess
import sys
import time
import urllib.request
from pathlib import Path

PROGRAM = sys.argv[2:] or [sys.executable, "-m", "haptix.tasks.cli"]


def main(home):
    run = Path("/run")
    subprocess.run(["mount", "-t", "tmpfs", "tmpfs", run], check=True)
    (run / "systemd" / "system").mkdir(parents=True)
    (run / "user").mkdir(mode=0o700)
    os.environ.update(HOME=home, XDG_RUNTIME_DIR=str(run / "user"))
    for name in ("XDG_CONFIG_HOME", "XDG_STATE_HOME", "HAPTIX_SERVICE", "DBUS_SESSION_BUS_ADDRESS"):
        os.environ.pop(name, None)
    with subprocess.Popen(["/lib/systemd/systemd", "--user"], stderr=subprocess.DEVNULL) as system:
        try:
            json.dump(session(home), sys.stdout)
        finally:
            system.terminate()


def session(home):
    until(lambda: systemctl("is-system-running").returncode == 0)
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    seen = {"installed": haptix("install", "--port", str(port)).returncode}
    seen["again"] = haptix("install", "--port", str(port)).returncode
    until(lambda: status()["running"] and status()["address"])
    seen["running"] = status()
    seen["enabled"] = systemctl("is-enabled", "haptix").stdout.strip()
    stop = urllib.request.Request(f"http://127.0.0.1:{port}/stop", b"", method="POST")
    with urllib.request.urlopen(stop, timeout=10) as answer:
        seen["stop"] = answer.status
    first = main_pid()
    os.kill(first, 9)
    until(lambda: main_pid() not in (0, first) and status()["address"])
    seen["after a crash"] = status()
    last = main_pid()
    seen["removed"] = haptix("remove").returncode
    seen["ended"] = not Path(f"/proc/{last}").exists()
    seen["after"] = status()
    seen["known"] = systemctl("list-unit-files", "haptix*").stdout
    seen["left"] = sorted(
        str(path.relative_to(home)) for path in Path(home).rglob("*") if path.is_file()
    )
    return seen


def haptix(*words):
    return subprocess.run(
        [*PROGRAM, "service", *words],
        capture_output=True, text=True, check=False, timeout=60,
    )  # fmt: skip


def status():
    return json.loads(haptix("status", "--json").stdout)


def systemctl(*words):
    return subprocess.run(
        ["systemctl", "--user", *words], capture_output=True, text=True, check=False, timeout=60
    )


def main_pid():
    return int(systemctl("show", "haptix", "-P", "MainPID").stdout)


def until(holds):
    end = time.monotonic() + 60
    while not holds():
        if time.monotonic() > end:
            raise SystemExit("waited for 60 s")
        time.sleep(0.1)


main(sys.argv[1])
