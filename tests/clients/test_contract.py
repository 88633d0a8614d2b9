"""One contract of actions, `clients/contract.jsonl`, kept by the client of every language.

A line is a call (`do`, of a region `of`), its arguments (`with`), what it sends, and what comes of
it: `answers`, `refuses`, `hears` an event, or `fails` with `Lost` and a sentence. The service reads
what each client sends.
"""

import json
import runpy
import subprocess
import sys
from functools import partial

import pytest

import haptix.service.client.connection
from haptix.service.front.jobs import Job
from haptix.service.protocol import messages as m
from haptix.service.protocol.messages import reading
from tests.clients.compiled import compiled
from tests.made_clients import CSHARP, ROOT, TYPESCRIPT, node_tools
from tests.waiting import PATIENCE_S, wait_for

CONTRACT = ROOT / "clients" / "contract.jsonl"
LINES = [json.loads(line) for line in CONTRACT.read_text().splitlines()]
FIRST_ID = {"id": 1}


@pytest.fixture
def keeps(service, monkeypatch):
    """A service that remembers what it was sent; call it to compare that with the contract."""
    texts = []
    receive = service.hub.receive

    def receives(client, data):
        if isinstance(data, str):
            texts.append(json.loads(data))
        return receive(client, data)

    monkeypatch.setattr(service.hub, "receive", receives)
    monkeypatch.setenv("HAPTIX_SERVICE", str(service.access.folder))
    service.engine.reports.clear()
    running = m.JobMessage(job="a1", kind="surface", state="running")
    service.hub.jobs.jobs["a1"] = Job("programs", running, {}, lambda _: None)

    def compare():
        sent = [text for text in texts if text["type"] not in ("hello", "pong", "bye")]
        told = [line for line in LINES if "sends" in line or "refuses" in line]
        expected = [line for line in told if line["do"] != "asset"]
        assert [each["type"] for each in sent] == [
            line["sends"]["type"] if "sends" in line else sent[index]["type"]
            for index, line in enumerate(expected)
        ]
        for line, message in zip(expected, sent, strict=True):
            if "sends" in line:  # defaults, and 1 for 1.0, are the same message
                wanted = reading.read_client(json.dumps(line["sends"] | FIRST_ID))
                assert reading.read_client(json.dumps(message | FIRST_ID)) == wanted, line
        touches = [(3, 7.0, "down"), (0, 9.0, "move"), (3, 0.0, "up"), (0, 0.0, "up")]
        reports = service.engine.reports
        wait_for(lambda: [(one.touch_id, one.x_mm, one.kind) for one in reports] == touches)

    return compare


def fits(expected, event):
    return all(getattr(event, key) == value for key, value in expected.items())


def note(heard, kind, event):
    heard.append((kind, event))


def is_heard(heard, kind, expected):
    return any(one == kind and fits(expected, event) for one, event in heard)


def test_python(keeps, tmp_path):
    with haptix.service.client.connection.connect("contract") as h:
        heard = []
        for kind in ("contact", "error", "frame"):
            h.on(kind, partial(note, heard, kind))
        regions = {}
        for line in LINES:
            *path, name = line["do"].split(".")
            target = regions[line["of"]] if "of" in line else h
            call = getattr(getattr(target, path[0]) if path else target, name)
            fields = line.get("with", {})
            if line["do"] == "asset":
                file = tmp_path / fields["name"]
                file.write_text(fields["text"])
                fields = {"path": file}
            heard.clear()
            if "refuses" in line:
                with pytest.raises(haptix.service.client.connection.Refused) as refused:
                    call(**fields)
                assert fits(line["refuses"], refused.value), line
                continue
            if "fails" in line:
                with pytest.raises(haptix.service.client.connection.Lost, match=line["fails"]):
                    call(**fields)
                continue
            answer = call(**fields)
            assert fits(line.get("answers", {}), answer), line
            assert line.get("names") in (None, answer)
            if "as" in line:
                assert answer.name == line["as"]
                regions[answer.name] = answer
            for kind, expected in line.get("hears", {}).items():
                wait_for(partial(is_heard, heard, kind, expected))
    keeps()


def test_typescript(keeps):
    node_tools()
    command = ["node", TYPESCRIPT / "test" / "contract.js"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S)
    assert done.returncode == 0, done.stderr[-4000:]
    keeps()


def test_csharp(keeps, tmp_path):
    program = compiled(tmp_path / "test.exe", CSHARP / "Test~")
    command = ["mono", program, CONTRACT, "contract"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S)
    assert done.returncode == 0, done.stdout + done.stderr
    keeps()


def test_every_call_of_the_description_is_in_the_contract():
    script = runpy.run_path(str(ROOT / "scripts" / "client_calls.py"))
    names = {call.name for call in script["calls"](reading.asyncapi())}
    names |= {call.name for call in script["changes"](reading.asyncapi())}
    done = {line["do"].rpartition(".")[2] for line in LINES}
    assert names <= done and len(LINES) >= 40


def test_the_calls_of_the_clients_are_those_of_the_description():
    script = runpy.run_path(str(ROOT / "scripts" / "client_calls.py"))
    for path, write in script["WRITTEN"].items():
        assert path.read_text() == write(), f"run {sys.executable} scripts/client_calls.py"


KEPT = (ROOT / "clients" / "made-from").read_text().strip()  # before a test makes it anew


@pytest.mark.slow
def test_the_types_of_a_checkout_are_those_of_the_schema():
    name = str(ROOT / "scripts" / "make-clients.py")
    script = runpy.run_path(name)
    # In a process of its own: other tests make kinds, which the schema then has as well.
    code = f"import runpy; print(runpy.run_path({name!r})['hash_of_shapes']())"
    shapes = subprocess.run([sys.executable, "-c", code], capture_output=True, cwd=ROOT, check=True)
    assert shapes.stdout.decode().strip() == KEPT, "run make clients, and commit what it makes"
    for path in (path for paths in script["MADE"].values() for path in paths):
        assert path.stat().st_size > 1000
