"""The window of the bundle, on a display of its own, over a real service."""

import os
import shutil
import socket
import subprocess
import sys
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[2] / "bundle"

PROGRAM = """
import json, sys, time, webbrowser
sys.path.insert(0, sys.argv[1])
from urllib.request import urlopen
import haptix
import window
opened = []
webbrowser.open = opened.append
shown = window.Window(["--port", sys.argv[2]])
def until(holds):
    end = time.monotonic() + 120
    while not holds():
        assert time.monotonic() < end, shown.state.get()
        shown.root.update()
        time.sleep(0.01)
until(lambda: "runs" in shown.state.get())
shown.studio_button.invoke()
address, code = opened[0].split("/#code=")
with haptix.service.feel(haptix.feel.Grating(period_mm=2)).session as app:
    assert app.output.state == "armed"
    shown.stop_button.invoke()
    until(lambda: app.output.state == "off")
    reason = app.output.reason
own = shown._own
shown.close()
json.dump({"address": address, "reason": reason, "ended": own.poll() is not None}, sys.stdout)
"""


@pytest.mark.slow
def test_it_opens_the_studio_and_stops(tmp_path):
    if not shutil.which("xvfb-run"):
        pytest.skip("xvfb-run")
    environment = {name: text for name, text in os.environ.items() if not name.startswith("HAPTIX")}
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = str(free.getsockname()[1])
    done = subprocess.run(
        ["xvfb-run", "-a", sys.executable, "-c", PROGRAM, FOLDER, port],
        env=environment | {"HOME": str(tmp_path)}, capture_output=True, text=True, check=False,
        timeout=300,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert f'"address": "http://127.0.0.1:{port}"' in done.stdout
    assert '"reason": "stopped by the button"' in done.stdout
    assert '"ended": true' in done.stdout
