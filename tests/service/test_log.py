"""The service's log: who came, who held the output and why it ended; no secret and no answer."""

import asyncio
import json
import logging
import os
import signal
import subprocess
import sys

import pytest

import haptix.service.client.connection
from haptix.base.errors import HaptixError
from haptix.service.front.jobs import Job
from haptix.service.protocol.messages import JobMessage, Problem
from tests.service.service_under_test import Service
from tests.waiting import PATIENCE_S, wait_for


@pytest.fixture
def service(tmp_path, caplog):
    caplog.set_level(logging.DEBUG, "haptix")
    service = Service(tmp_path)
    yield service
    service.close()


def test_a_session_is_told_without_its_token(service, caplog):
    url = f"ws://127.0.0.1:{service.port}/v1/session"
    token, code = service.access.native, service.access.code()
    paired = service.access.pair(code, "https://lab.example", "page")
    with haptix.service.client.connection.connect("a program", url, token) as h:
        h.acquire()
        h.arm()
        h.touch(7.0, 8.0)
        h.intensity(0.5)
        resume = next(iter(service.hub.sessions.values())).resume
    with pytest.raises(HaptixError):
        haptix.service.client.connection.connect("a guess", url, "Geheim-token")
    said = [record.getMessage() for record in caplog.records if record.name == "haptix.service"]
    assert "session 1: hello of 'a program', free" in said
    assert "lease: session 1, acquired" in said
    assert "output: state armed, reason armed by its holder" in said
    assert "session 1: 1 touches" in said
    assert "session 1: its socket is closed" in said
    assert "session 2: refused, access at '/token'" in said
    for secret in (token, code, paired, resume, "Geheim"):
        assert secret not in caplog.text


def test_a_job_is_told_without_what_it_asks_and_is_answered(caplog):
    caplog.set_level(logging.DEBUG, "haptix")
    message = JobMessage(job="a1", kind="experiment", state="queued")

    async def run():
        job = Job("programs", message, {}, lambda _: None)
        job.change(state="running")
        job.on_message({"prompt": "How strong, sub-07?", "choices": ["weakest-1", "stronger-2"]})
        with pytest.raises(Problem):
            job.answer("no choice of theirs")
        job.answer("stronger-2")
        job.change(state="done", result={"felt": "stronger-2", "participant": "sub-07"})

    asyncio.run(run())
    said = [record.getMessage() for record in caplog.records if record.name == "haptix.service"]
    assert said == [
        f"job a1: experiment, {state}" for state in ("running", "asking", "running", "done")
    ]


@pytest.mark.slow  # starts the whole service; what its parts log is tested above
def test_all_processes_of_a_service_log(tmp_path):
    command = [sys.executable, "-m", "haptix.tasks.cli", "serve", "--port", "0"]
    environment = os.environ | {"HAPTIX_SERVICE": str(tmp_path / "service")}

    def logged() -> str:
        return "".join(path.read_text() for path in sorted(tmp_path.glob("a*.log")))

    with subprocess.Popen(
        [*command, "--log", tmp_path / "a.log"], stdout=subprocess.PIPE, text=True, env=environment
    ) as process:
        try:
            assert "haptix serves" in process.stdout.readline()
            found = json.loads((tmp_path / "service" / "service.json").read_text())
            url = f"ws://127.0.0.1:{found['port']}/v1/session"
            with haptix.service.client.connection.connect("a program", url, found["token"]) as h:
                h.layout.add({"kind": "grating", "period_mm": 2.0}, width_mm=60.0, height_mm=60.0)
                h.acquire()
                h.arm()
                h.touch(7.0, 8.0)
                wait_for(lambda: "mock > Revise " in logged())
        finally:
            process.send_signal(signal.SIGTERM)  # as systemd and `kill` end it
            process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 0
    assert not (tmp_path / "service" / "service.json").exists()
    for file in tmp_path.glob("a*.log"):  # each process has a file of its own
        assert len({line.split()[1] for line in file.read_text().splitlines()}) == 1, file
    text = logged()
    assert found["token"] not in text
    for line in (
        "haptix.base.log INFO haptix.tasks.cli begins",
        "haptix.base.log INFO haptix.service.engine.process begins",
        "haptix.service INFO lease: session 1, acquired",
        "haptix.service.engine.process INFO armed for session 1",
        "firmware_io.stream INFO mock: armed for revisions",
        "firmware_io.protocol DEBUG mock > Revise ",
        "firmware_io.protocol DEBUG mock < ",
        "at 0 V and disarmed after",
        "haptix.service INFO engine: process ",
    ):
        assert line in text, line


@pytest.mark.slow  # starts the whole service
def test_a_service_that_still_begins_ends_by_sigterm(tmp_path):
    """As where systemd restarts it: what waited for its processes would hang until it is killed."""
    command = [sys.executable, "-m", "haptix.tasks.cli", "serve", "--port", "0"]
    environment = os.environ | {"HAPTIX_SERVICE": str(tmp_path)}
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, env=environment) as process:
        wait_for((tmp_path / "service.json").exists)
        process.send_signal(signal.SIGTERM)
        assert process.wait(PATIENCE_S) in (0, -signal.SIGTERM)
