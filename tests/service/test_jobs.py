"""Jobs: queued, watched, answered, cancelled; each in a real process."""

import json
import os
import signal
import subprocess
import sys
import time
from http.client import HTTPConnection
from importlib import import_module
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import calibration
import haptix
from haptix.base.task import Context
from haptix.feel.motion import Trajectory
from haptix.lab.experiment import Question
from haptix.play.render import LiveSettings
from haptix.play.simulation import Setting, simulate
from haptix.play.virtual_finger import TouchPanel
from haptix.service.front.jobs import Job
from haptix.service.protocol.messages import JobMessage
from haptix.service.protocol.messages.reading import asyncapi
from haptix.service.worker.process import JobWork
from haptix.tasks.stimuli import judgement
from tests.service.service_under_test import Service
from tests.service.test_sessions import Client
from tests.waiting import PATIENCE_S, wait_for

GRATING = {"kind": "grating", "period_mm": 3.0, "low": 0.2, "high": 0.8}
RECIPE: dict[str, Any] = {
    "name": "threshold",
    "stimulus": {
        "quantity": "contrast",
        "carrier_hz": 4000.0,
        "signal": {"kind": "sine", "amplitude": 0.1, "frequency_hz": 60.0, "length_s": 0.1},
    },
    "pedestal": {"kind": "constant", "value": 0.15},
    "method": {"kind": "constant-stimuli", "levels": [-6.0, 0.0], "repeats": 2},
}
SLOW = {"t_s": [0.0, 30.0], "x_mm": [0.0, 900.0], "y_mm": [5.0, 5.0], "normal_force_n": [0.4, 0.6]}


@pytest.fixture(scope="module")
def service(tmp_path_factory):
    folder = tmp_path_factory.mktemp("service")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("HAPTIX_CACHE", str(folder / "cache"))
        service = Service(folder)
        service.hub.jobs.context = {
            "finger": "semi-wet",
            "screen": "3m-sct3250",
            "device": "mock:",
            "assets": str(folder / "assets"),
            "logs": str(folder / "logs"),
        }
        yield service
        service.close()


def rest(service, method, path, body=None, status=None, page=None):
    """Ask as a program, or as a page: its origin and its token."""
    connection = HTTPConnection("127.0.0.1", service.port, timeout=PATIENCE_S)
    origin, token = page or (None, service.access.native)
    headers = {"Authorization": f"Bearer {token}"} | ({"Origin": origin} if origin else {})
    text = None if body is None else json.dumps(body)
    headers |= {"Content-Type": "application/json"} if text else {}
    connection.request(method, path, text, headers)
    answer = connection.getresponse()
    content = answer.read()
    assert status in (None, answer.status), content
    return json.loads(content) if content else None


def until(service, job, *states):
    """The job once it is in one of some states."""
    end_s = time.monotonic() + PATIENCE_S
    while True:
        found = rest(service, "GET", f"/v1/jobs/{job}", status=200)
        if found["state"] in states:
            return found
        assert time.monotonic() < end_s, found
        time.sleep(0.05)


def begin(service, kind, **body):
    return rest(service, "POST", f"/v1/{kind}", body, 202)["job"]


def test_one_runs_eight_wait_and_any_can_be_cancelled(service):
    jobs = [begin(service, "renderings", material=GRATING, **SLOW)]
    hang(service, jobs[0])
    jobs += [begin(service, "renderings", material=GRATING, **SLOW) for _ in range(8)]
    body = {"material": GRATING, **SLOW}
    assert rest(service, "POST", "/v1/renderings", body, 429)["code"] == "limit"
    assert until(service, jobs[1], "queued")["share"] == 0.0
    with Client(service) as client:
        client.ask("watch", job=jobs[0])
        pid = service.hub.jobs.get(jobs[0], "programs").pid
        for job in jobs[2:] + jobs[:1]:
            rest(service, "DELETE", f"/v1/jobs/{job}", status=204)
        told = client.until(lambda m: m["type"] == "job" and m["id"] == 0)
        assert (told["job"], told["state"]) == (jobs[0], "cancelled")
    wait_for(lambda: not is_alive(pid))
    # A process that is killed from outside fails its job alone, and the next goes on.
    hang(service, jobs[1])
    os.kill(service.hub.jobs.get(jobs[1], "programs").pid, signal.SIGKILL)
    assert "code -9" in until(service, jobs[1], "failed")["sentence"]
    after = begin(service, "experiments", recipe={"ceiling_v": 190.0}, log="never")
    assert "no volts" in until(service, after, "failed")["sentence"]


def hang(service, job):
    """Stop the process of a job, so that it is busy for as long as the test wants."""
    until(service, job, "running")
    os.kill(service.hub.jobs.get(job, "programs").pid, signal.SIGSTOP)


def is_alive(pid):
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


def test_a_job_is_known_to_who_began_it_alone(service):
    pages = []
    for origin in ("https://lab.example", "https://other.example"):
        pages.append((origin, service.access.pair(service.access.code(), origin, "page")))
    lab, other = pages
    body = {"recipe": {"ceiling_v": 190.0}, "log": "of-a-participant"}
    job = rest(service, "POST", "/v1/experiments", body, 202, lab)["job"]
    assert [one["job"] for one in rest(service, "GET", "/v1/jobs", None, 200, lab)] == [job]
    for who in (other, None):  # another page, and a program
        assert job not in str(rest(service, "GET", "/v1/jobs", None, 200, who))
        for method, path in (("GET", ""), ("DELETE", ""), ("POST", "/answer")):
            given = {"text": "1"} if path else None
            refused = rest(service, method, f"/v1/jobs/{job}{path}", given, 404, who)
            assert refused["code"] == "unknown"
    with Client(service) as client:
        assert client.ask("watch", job=job)["code"] == "unknown"
    rest(service, "DELETE", f"/v1/jobs/{job}", None, 204, lab)


@pytest.mark.slow  # loads torch in a process; refusals and answers are quick above and below
def test_an_experiment_asks_and_borrows_the_device(service):
    began = len(service.engine.told)
    job = begin(service, "experiments", recipe=RECIPE, log="first")
    for trial in range(4):
        asked = until(service, job, "asking", "failed")
        assert asked["state"] == "asking" and len(asked["choices"]) == 2, asked
        assert service.hub.control.output.lent_to == "experiment"
        if trial == 0:
            wrong = rest(service, "POST", f"/v1/jobs/{job}/answer", {"text": "maybe"}, 422)
            assert wrong["path"] == "/text"
        rest(service, "POST", f"/v1/jobs/{job}/answer", {"text": asked["choices"][0]}, 204)
    done = until(service, job, "done", "failed")
    assert done["result"]["trials"] == 4
    rest(service, "POST", f"/v1/jobs/{job}/answer", {"text": "1"}, 409)

    def told():
        found = [do for do, *_ in service.engine.told[began:]]
        return [do for do in found if do in ("stop", "lend", "take_back")]

    # Before these stands what a job of another test is ended with, if that takes longer.
    wait_for(lambda: told()[-3:] == ["stop", "lend", "take_back"])
    wait_for(lambda: not service.hub.control.output.lent_to)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"ceiling_v": 190.0}, "no volts"),
        ({"stimulus": {**RECIPE["stimulus"], "quantity": "volts"}}, "volts"),
        ({"stimulus": {**RECIPE["stimulus"], "signal": {"file": "/etc/passwd"}}}, "nor files"),
        ({"finger": "../finger.toml"}, "one of"),
        ({"folder": "/etc"}, "folder"),
    ],
)
def test_a_recipe_of_the_network_names_no_files_and_no_volts(tmp_path, change, words):
    context = {"finger": "semi-wet", "screen": "3m-sct3250", "device": "mock:"}
    context |= {"assets": str(tmp_path), "logs": str(tmp_path)}
    work = JobWork(context, lambda **_: None, None)
    with pytest.raises(haptix.InputError, match=words):
        work.experiment(recipe={**RECIPE, **change}, log="log")


@pytest.mark.slow  # builds a surface, and renders twice
def test_a_magnitude_is_asked_for_until_a_number_above_zero_comes():
    said, answers = [], iter(("strong", "-1", "nan", "inf", "3.5", "2"))

    class Person(Context):
        def ask(self, prompt, choices=()):
            said.append(prompt)
            return next(answers)

    question = Question(0, (), 1.0, "", asks="How strong?")
    assert judgement(Person(), question) == "3.5"
    assert said == ["How strong?"] * 5
    assert judgement(Person(), Question(0, ("1", "2"), 1.0, "1")) == "2"


def test_a_rendering_has_the_numbers_of_haptix_render(tmp_path, model, monkeypatch):
    monkeypatch.setenv("HAPTIX_CACHE", str(tmp_path))
    t_s = np.arange(0, 0.3, 0.01)
    stroke = {"t_s": t_s, "x_mm": 60 * t_s, "y_mm": 5.0 + 0 * t_s, "normal_force_n": 0.5 + 0 * t_s}
    context = {"finger": "semi-wet", "screen": "3m-sct3250", "assets": str(tmp_path)}
    said = []
    work = JobWork(context, lambda **fields: said.append(fields), None)
    lists = {name: column.tolist() for name, column in stroke.items()}
    found = work.rendering(material=GRATING, **lists, touch_latency_ms=20.0, reaction_ms=3.0)
    setting = Setting(
        model, haptix.feel.materials.material_of(GRATING), Trajectory.of(*stroke.values())
    )
    surface, was_kept = setting.surface()
    assert was_kept  # the job has built the very surface that `haptix render` takes
    whole = simulate(setting, surface, TouchPanel(100.0, 0.02), LiveSettings(reaction_s=0.003))
    assert found["evaluation"]["error_rms_jnd"] == whole.evaluation.error_rms_jnd
    shares = [one["share"] for one in said if "share" in one]
    assert shares == sorted(shares) and shares[-1] > 0.9
    told = json.dumps(found)
    assert '"voltage' not in told and '_v"' not in told


@pytest.mark.slow  # plans a calibration, and makes a virtual screen
def test_a_calibration_asks_before_each_stroke_and_is_continued(tmp_path, monkeypatch):
    # A drawn person presses 15 % off in one of some 400 strokes, and is asked once more.
    monkeypatch.setattr("calibration.keep.practice.randbelow", lambda most: 1)
    context = {"finger": "semi-wet", "screen": "3m-sct3250", "device": "mock:"}
    context["calibrations"] = str(tmp_path)
    said, answers = [], iter(("go", "stop", "stop"))
    work = JobWork(context, lambda **fields: said.append(fields), answers)
    first = work.calibration(name="panel-7", minutes=2.0)
    assert first["verdict"] is None
    second = work.calibration(name="panel-7", minutes=2.0)  # goes on where it was stopped
    prompts = [one["prompt"] for one in said if "prompt" in one]
    assert len(prompts) == 3 and prompts[1] == prompts[2] != prompts[0]
    assert second["still_open"] == first["still_open"]
    total = int(prompts[0].split(" of ")[1].split(":")[0])
    assert len(first["still_open"]) == total - 1
    assert not any(" V" in prompt or "olt" in prompt for prompt in prompts)


def test_a_calibration_tells_each_of_its_steps(tmp_path, monkeypatch):
    class EndedError(Exception):
        pass

    def measured(session, source, device, context):
        context.tell(step="stroke 1: force off: press harder")
        context.progress("measure", 1.0)
        return SimpleNamespace(still_open=())

    def decided(folder, context, go_on):
        context.progress("fit", 0.0)
        context.progress("verify", 0.0)
        raise EndedError

    # `calibration.measure` is the function of that name, beside the folder.
    for module, name, what in (
        ("measure.measuring", "measure_guided", measured),
        ("steps", "finish_decided", decided),
    ):
        monkeypatch.setattr(import_module(f"calibration.{module}"), name, what)
    monkeypatch.setattr(calibration.Session, "open_strokes", ())
    context = {"finger": "semi-wet", "screen": "3m-sct3250", "device": "mock:"}
    context["calibrations"] = str(tmp_path)
    said = []
    work = JobWork(context, lambda **fields: said.append(fields), iter(()))
    with pytest.raises(EndedError):
        work.calibration(name="panel-7", minutes=2.0)
    steps = [one["step"] for one in said if "step" in one]
    # After a fault of a stroke the page shows again that it measures.
    assert steps == ["measure", "stroke 1: force off: press harder", "measure", "fit", "verify"]


def test_a_worker_that_was_silent_and_goes_on_is_not_said_to_be_silent(monkeypatch):
    job = Job("programs", JobMessage(job="a1", kind="calibration", state="running"), {}, list)
    monkeypatch.setattr(job, "has_loaded", lambda: None)
    job.on_silence(0.7)
    assert job.message.sentence.startswith("silent for 0.7 s")
    job.on_message({"step": "fit"})
    assert (job.message.step, job.message.sentence) == ("fit", "")
    job.on_silence(0.9)
    assert job.message.sentence.startswith("silent for 0.9 s")


def test_a_job_that_is_not_there(service):
    for method, path in (("GET", ""), ("DELETE", ""), ("POST", "/answer")):
        body = {"text": "1"} if method == "POST" else None
        assert rest(service, method, f"/v1/jobs/abc{path}", body, 404)["code"] == "unknown"
    with Client(service) as client:
        assert client.ask("watch", job="abc")["code"] == "unknown"
    assert rest(service, "GET", "/v1/surfaces", status=200) == []


def test_the_page_of_routes_and_messages_is_whole_and_loads_nothing(service):
    connection = HTTPConnection("127.0.0.1", service.port, timeout=PATIENCE_S)
    connection.request("GET", "/docs")  # no token: it is a page
    answer = connection.getresponse()
    text = answer.read().decode()
    assert answer.status == 200
    assert "default-src 'none'" in answer.headers["content-security-policy"]
    for path, methods in rest(service, "GET", "/v1/openapi.json", status=200)["paths"].items():
        for method in methods:
            assert f"<code>{method.upper()} {path}</code>" in text
    assert rest(service, "GET", "/v1/asyncapi.json", status=200) == asyncapi()
    assert "<code>layout_change</code>" in text and "<code>subscribed</code>" in text
    assert "<script" not in text and "http" not in text and service.access.native not in text


@pytest.mark.skipif(sys.platform != "linux", reason="other systems have no such limit")
def test_what_takes_too_much_memory_is_refused_it():
    program = (
        "from haptix.service.worker.process import limit_memory; limit_memory(200 * 2**20)\n"
        "try: bytearray(400 * 2**20)\n"
        "except MemoryError: print('refused')"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.stdout == "refused\n", done.stderr
