"""Processes that hang are ended and begun again; who waits for them is told, or notices nothing."""

import asyncio
import json
import os
import signal

import pytest

from haptix.service.front import pool as pool_module
from haptix.service.front.access import Access
from haptix.service.front.hub import Hub
from haptix.service.front.pool import Process
from haptix.service.protocol import messages as m
from tests.hand_clock import HandClock
from tests.service.service_under_test import WrittenEngine
from tests.service.test_decoding import OPENING
from tests.service.test_pool import assets, keep, running, until  # noqa: F401
from tests.waiting import PATIENCE_S


def test_a_worker_that_hangs_is_ended_and_another_answers(assets, monkeypatch):  # noqa: F811
    monkeypatch.setattr(pool_module, "START_S", PATIENCE_S)

    told = []

    async def scenario(pool):
        pool.tell = lambda *warning: told.append(warning)
        digest = keep(assets, 1)
        await pool.ask("one", "decode", digest=digest)
        hung = pool.owned["one"].process
        number = hung.pid
        os.kill(number, signal.SIGSTOP)
        assert await pool.ask("one", "decode", digest=digest) == {}
        assert [(owner, "silent" in sentence) for owner, sentence in told] == [("one", True)]
        assert hung.has_hung
        assert pool.owned["one"].process.pid != number
        await until(lambda: hung.pid is None)

    running(assets, scenario)


def test_a_process_that_loads_is_waited_for_and_a_hung_one_refuses_its_questions(
    tmp_path, monkeypatch
):
    monkeypatch.setattr(pool_module, "BEAT_S", 0.1)  # the process is stopped: it beats no more

    async def scenario():
        process = Process()
        await process.launch()
        os.kill(process.pid, signal.SIGSTOP)
        question = asyncio.create_task(process.ask("open", **OPENING, assets=str(tmp_path)))
        await asyncio.sleep(2 * pool_module.MOST_SILENT * pool_module.BEAT_S)
        assert not process.has_hung and not question.done()  # it may load torch
        process.has_loaded()
        with pytest.raises(m.Problem, match="the worker hung"):
            await question
        assert process.pid is None

    asyncio.run(scenario())


def test_of_a_hung_worker_those_are_told_whom_it_concerns(tmp_path):
    inventory = m.Inventory(devices=(), finger="f", screen="s", kinds=())
    hub = Hub(Access(1, tmp_path), WrittenEngine(), inventory, "x", HandClock())
    feels, draws = hub.open(None), hub.open(None)
    feels.name, draws.name, draws.owner = "feels", "draws", "https://example.org"
    feels.streams["felt"] = 100.0
    hub.on_engine_event({"event": "warning", "stream": "felt", "sentence": "the finger hung"})
    hub.warn("https://example.org", "its worker is silent")
    hub.warn(f"session {feels.number}", "a worker of the session is silent")
    assert ["finger hung" in feels.waiting[0], "session is silent" in feels.waiting[1]] == [1, 1]
    assert ["its worker" in text for text in draws.waiting] == [True]


@pytest.mark.parametrize(
    ("is_real", "meanwhile", "is_armed"),
    [(False, "", True), (True, "", False), (False, "stop", False), (False, "leave", False)],
)
@pytest.mark.parametrize("states", [("failed", "failed", "off"), ("failed", "gone", "back")])
def test_a_virtual_driver_is_armed_again_and_a_real_one_by_a_person(
    tmp_path, is_real, meanwhile, is_armed, states
):
    device = m.DeviceMessage(address="x", name="x", is_real=is_real)
    inventory = m.Inventory(devices=(device,), finger="f", screen="s", kinds=())
    hub = Hub(Access(1, tmp_path), WrittenEngine(), inventory, "x", HandClock())
    session = hub.open(None)
    session.name = "holder"
    hub.control.acquire(session, False)
    hub.control.set(state="armed", reason="armed by its holder")
    watcher = hub.open(None)
    watcher.name = "watcher"
    *failures, back = states
    for state in failures:
        hub.on_engine_event({"event": "output", "state": state, "reason": "it failed"})
    if meanwhile == "stop":
        hub.stop("a person stopped it")
    elif meanwhile == "leave":
        hub.closed(session)
    if meanwhile:  # who comes now is told what is so
        assert hub.control.output.state == ("gone" if "gone" in states else "off")
    hub.on_engine_event({"event": "output", "state": back, "reason": "it is there again"})
    told = [json.loads(text) for text in watcher.waiting]
    told = [one["state"] for one in told if one["type"] == "output"]
    assert [state for state in told if state != "off"] == [one for one in states if one != "off"]
    assert [message.type for message in session.requests] == ["arm"] * is_armed
