"""Golden sessions and the docs' programs against `haptix serve` itself, with a mock driver."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from haptix.service.client.connection import Refused, connect
from tests.clients.compiled import compiled, compiled_for_unity
from tests.clients.golden import GOLDEN, SESSIONS, Run
from tests.made_clients import CSHARP, ROOT, TYPESCRIPT, node_tools
from tests.waiting import PATIENCE_S, wait_for

CONTRACT = [json.loads(line) for line in (ROOT / "clients/contract.jsonl").read_text().splitlines()]

pytestmark = pytest.mark.slow  # the same sessions run against the front alone


@pytest.fixture(scope="module")
def environment(tmp_path_factory):
    environment = os.environ | {"HAPTIX_SERVICE": str(tmp_path_factory.mktemp("service"))}
    command = [sys.executable, "-m", "haptix.tasks.cli", "serve", "--port", "0"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment) as process:
        assert "haptix serves" in process.stdout.readline()
        yield environment
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=PATIENCE_S)


@pytest.mark.parametrize("name", SESSIONS)
def test_python(environment, name):
    found = json.loads((Path(environment["HAPTIX_SERVICE"]) / "service.json").read_text())
    Run(found["port"], found["token"]).play(name)


def test_the_contract_s_answers_are_those_of_the_engine(environment):
    found = json.loads((Path(environment["HAPTIX_SERVICE"]) / "service.json").read_text())
    address = f"ws://127.0.0.1:{found['port']}/v1/session"
    with connect("contract", address, found["token"]) as h:
        answer: Any = None
        for line in CONTRACT:
            if "sends" not in line or line["do"] in ("watch", "touch", "lift"):
                continue  # the job and the fingers are of the front's own tests
            fields = {key: value for key, value in line["sends"].items() if key != "type"}
            if line["do"] == "cancel" and "answers" in line:
                fields["effect_id"] = answer.effect_id
            if "refuses" in line:
                with pytest.raises(Refused) as refused:
                    h.ask(line["sends"]["type"], **fields)
                answer, expected = refused.value, line["refuses"]
            else:
                answer = h.ask(line["sends"]["type"], **fields)
                expected = line.get("answers", {})
            for key in expected.keys() - {"effect_id", "revision"}:  # counted by other sessions too
                assert getattr(answer, key) == expected[key], line


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


def test_a_slider_tells_the_numbers_of_its_detents(environment):
    found = json.loads((Path(environment["HAPTIX_SERVICE"]) / "service.json").read_text())
    address = f"ws://127.0.0.1:{found['port']}/v1/session"
    with connect("slider", address, found["token"]) as h:
        contacts = []
        h.on("contact", contacts.append)
        slider = {"kind": "slider", "travel_mm": 40, "detents": 5, "start_mm": 3}
        h.layout.add(slider, name="volume", x_mm=10, y_mm=0, width_mm=46, height_mm=20)
        h.acquire()
        h.arm()
        for step in range(45):  # from 1 mm left of the first to 3 mm right of the last
            h.touch(12.0 + step, 10.0, 0.5)
            time.sleep(0.005)
        h.lift()
        wait_for(lambda: contacts and contacts[-1].event == "leave")
    told = [one.value for one in contacts if one.event == "detent"]
    # Of moves that a busy machine delivers late, the service leaves out all but the newest.
    assert told == sorted({*told}) and {*told} <= {1.0, 2.0, 3.0, 4.0} and told[-1] == 4.0


@pytest.mark.parametrize(
    ("inputs", "pointer"), [("legacy", "legacy"), ("new", "new"), ("new", "mouse"), ("both", "new")]
)
def test_unity_s_component_is_felt(environment, tmp_path, inputs, pointer):
    """With regions of the inspector, a layout, time that stands, and second scenes."""
    player = compiled_for_unity(tmp_path, inputs)
    layout = CSHARP / "Samples~" / "Ribs" / "layout.json"
    done = subprocess.run(
        ["mono", player, pointer, inputs],
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        env=environment | {"LAYOUT": str(layout)},
    )
    assert done.returncode == 0, done.stdout + done.stderr
    felt = re.findall(r"felt (\w+)", done.stdout)
    assert felt == ["ribs", "ribs", "rim", "ribs", "rim", "ribs"]
    assert "log enter ribs" in done.stdout  # of the sample


def programs(page, language):
    """Return the programs of a page."""
    return re.findall(rf"```{language}\n(.*?)```", page.read_text(), re.DOTALL)


def program(page, language):
    """Return the first program of a page."""
    return programs(page, language)[0]


def feels_ribs(command, environment, folder):
    """Run a program of the docs as a stranger does; it prints the friction of each moment."""
    done = subprocess.run(
        command, capture_output=True, text=True, timeout=PATIENCE_S, env=environment, cwd=folder,
        input="\n",
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    told = [float(one) for one in re.findall(r"friction (\d[.\d]*)", done.stdout)]
    assert max(told) > 1.1 * min(told)  # a rib is more than a JND of 10 %


def test_the_program_for_python_is_felt(environment, tmp_path):
    *_, long = programs(ROOT / "docs" / "service.md", "python")
    (tmp_path / "app.py").write_text(long)
    feels_ribs([sys.executable, "app.py"], environment, tmp_path)


def test_three_lines_feel_a_texture(environment, tmp_path):
    short, *_ = programs(ROOT / "docs" / "service.md", "python")
    slides = """
h, frames = region.session, []
h.on("frame", frames.append)
h.subscribe({"friction": 100})
for i in range(200):
    h.touch(10 + 0.2 * i, 20, 0.5)
    __import__("time").sleep(0.005)
reached = [row[4] for frame in frames for row in frame.rows if row[4] > 0]
print("friction", min(reached))
print("friction", max(reached))
h.close()
"""
    (tmp_path / "app.py").write_text(short + slides)
    feels_ribs([sys.executable, "app.py"], environment, tmp_path)


def test_the_program_for_node_is_felt(environment, tmp_path):
    packages = tmp_path / "node_modules"
    packages.mkdir()
    (packages / "haptix-client").symlink_to(TYPESCRIPT)
    (packages / "ws").symlink_to(node_tools() / "ws")
    (tmp_path / "app.mjs").write_text(program(TYPESCRIPT / "README.md", "js"))
    feels_ribs(["node", "app.mjs"], environment, tmp_path)


def test_the_program_for_csharp_is_felt(environment, tmp_path):
    (tmp_path / "source").mkdir()
    (tmp_path / "source" / "App.cs").write_text(program(CSHARP / "README.md", "csharp"))
    app = compiled(tmp_path / "App.exe", tmp_path / "source")
    feels_ribs(["mono", app], environment, tmp_path)
