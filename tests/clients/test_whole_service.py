"""Every client's golden sessions against `haptix serve` itself, with a mock driver."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from tests.clients.compiled import compiled
from tests.clients.golden import GOLDEN, SESSIONS, Run
from tests.made_clients import CSHARP, TYPESCRIPT, node_tools
from tests.waiting import PATIENCE_S

pytestmark = pytest.mark.slow  # the same sessions run against the front alone


@pytest.fixture(scope="module")
def environment(tmp_path_factory):
    environment = os.environ | {"HAPTIX_SERVICE": str(tmp_path_factory.mktemp("service"))}
    command = [sys.executable, "-m", "haptix.cli", "serve", "--port", "0"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment) as process:
        assert "haptix serves" in process.stdout.readline()
        yield environment
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=PATIENCE_S)


@pytest.mark.parametrize("name", SESSIONS)
def test_python(environment, name):
    found = json.loads((Path(environment["HAPTIX_SERVICE"]) / "service.json").read_text())
    Run(found["port"], found["token"]).play(name)


def test_typescript(environment):
    node_tools()
    command = ["node", TYPESCRIPT / "test" / "golden.test.js"]
    done = subprocess.run(
        command, capture_output=True, text=True, timeout=PATIENCE_S, env=environment
    )
    assert done.returncode == 0, done.stdout[-4000:]


def test_csharp(environment, tmp_path):
    program = compiled(tmp_path / "test.exe", CSHARP / "Test~")
    command = ["mono", program, GOLDEN, "golden"]
    done = subprocess.run(
        command, capture_output=True, text=True, timeout=PATIENCE_S, env=environment
    )
    assert done.returncode == 0, done.stdout + done.stderr
