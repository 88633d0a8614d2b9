"""Workers: each for one owner, ended in time, and with the front whatever they compute then."""

import asyncio
import hashlib
import os
import signal
import subprocess
import sys

import pytest

from haptix.service.front import pool as pool_module
from haptix.service.front.pool import MOST_WAITING, Pool, Process
from haptix.service.protocol.messages import Problem
from haptix.service.protocol.wire import json_frame
from tests.service.test_decoding import OPENING, bomb
from tests.waiting import PATIENCE_S

BUSY = """
import sys
from haptix.service.protocol.wire import Outbox
from haptix.service.worker.process import frames
for _, data in frames(Outbox(sys.stderr.buffer), last_s=0.1):
    print(data.decode(), flush=True)
    while True:
        pass
"""


def test_a_worker_that_computes_ends_when_its_input_does():
    with subprocess.Popen(
        [sys.executable, "-c", BUSY], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as process:
        process.stdin.write(json_frame({"do": "compute"}))
        process.stdin.flush()
        assert b"compute" in process.stdout.readline()
        assert process.poll() is None
        process.stdin.close()
        assert process.wait(PATIENCE_S) == 1


@pytest.mark.parametrize("do", ["open", "job"])
def test_a_worker_whose_front_has_gone_says_nothing(do):
    """Both pipes close, as when the front is killed while an answer is on its way."""
    with subprocess.Popen(
        [sys.executable, "-m", "haptix.service.worker.process", "15"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    ) as process:
        process.stdout.close()
        asked = {"n": 1, "do": do, "assets": ".", **OPENING}
        if do == "job":
            context = {"finger": "semi-wet", "screen": "3m-sct3250", "assets": "."}
            context |= {"device": "mock:", "logs": "."}
            asked = {"n": 1, "do": do, "kind": "experiment", "context": context}
            asked |= {"recipe": {"folder": "."}, "log": "x"}
        process.stdin.write(json_frame(asked))
        process.stdin.close()
        said = process.stderr.read()
        process.wait(PATIENCE_S)
        assert b"BrokenPipe" not in said and b"Traceback" not in said


@pytest.fixture(autouse=True)
def is_not_starved(monkeypatch):
    """Other tests leave little for who yields."""
    monkeypatch.setattr(pool_module, "START_S", PATIENCE_S)
    monkeypatch.setattr(pool_module, "NICE", 1)


@pytest.fixture
def assets(tmp_path):
    """A folder with one picture; a document names it."""
    folder = tmp_path / "assets"
    folder.mkdir()
    return folder


def keep(assets, number):
    content = bomb(1) + str(number).encode()
    digest = hashlib.sha256(content).hexdigest()
    (assets / f"{digest}.png").write_bytes(content)
    return digest


def processes(pool):
    return {one.pid for one in pool.processes if one.pid is not None}


async def until(is_so):
    async with asyncio.timeout(PATIENCE_S):
        while not is_so():
            await asyncio.sleep(0.01)


def running(assets, scenario):
    """Run a scenario with a pool, which ends after it."""

    async def runs():
        pool = Pool({**OPENING, "assets": str(assets)}, longest_s=PATIENCE_S)
        try:
            await scenario(pool)
        finally:
            await pool.stop()
        assert not processes(pool)

    asyncio.run(runs())


def test_a_worker_works_for_one_owner_alone(assets):
    async def scenario(pool):
        worked = {}
        for owner in ("one", "two", "one"):
            before = processes(pool)
            assert await pool.ask(owner, "decode", digest=keep(assets, owner)) == {}
            (new,) = processes(pool) - before or {worked.get(owner)}
            assert worked.setdefault(owner, new) == pool.owned[owner].process.pid == new
        assert worked["one"] != worked["two"]

    running(assets, scenario)


def test_there_are_no_more_workers_than_may_be_and_a_spare_of_nobody(assets, monkeypatch):
    monkeypatch.setattr(pool_module, "MOST_WORKERS", 2)

    async def scenario(pool):
        pool.warm()
        spare = (await pool.spare).pid
        digest = keep(assets, 1)
        for number in range(3):
            await pool.ask(str(number), "decode", digest=digest)
            if number == 0:
                assert pool.owned["0"].process.pid == spare  # it was there already
            there = [one.process.pid for one in pool.owned.values() if one.is_there]
            assert len(there) == min(number + 1, 2)
        assert (await pool.spare).pid not in there
        await until(lambda: len(processes(pool)) == 2 + 1)

    running(assets, scenario)


def test_who_is_held_up_holds_up_nobody_else(assets, monkeypatch):
    monkeypatch.setattr(pool_module, "LONGEST_SILENCE_S", 1e6)  # hung ones: test_heartbeat.py

    async def scenario(pool):
        digest = keep(assets, 1)
        await pool.ask("stuck", "decode", digest=digest)
        pid = pool.owned["stuck"].process.pid
        os.kill(pid, signal.SIGSTOP)
        stuck = asyncio.create_task(pool.ask("stuck", "decode", digest=digest))
        await asyncio.sleep(0)
        assert await pool.ask("another", "decode", digest=digest) == {}
        assert not stuck.done()
        os.kill(pid, signal.SIGKILL)
        with pytest.raises(Problem, match="code -9"):
            await stuck
        assert await pool.ask("stuck", "decode", digest=digest) == {}  # of a new one

    running(assets, scenario)


ANSWERS = """
from haptix.base.files import parse_json
from haptix.service.protocol.wire import JSON, Outbox, frame_output
from haptix.service.worker.process import frames
outbox = Outbox(frame_output())
for kind, data in frames(outbox):
    if kind == JSON:
        outbox.say(n=parse_json(data)["n"])
"""


@pytest.fixture
def light_workers(monkeypatch):
    """Workers that answer each question at once, and load nothing; the questions of each."""
    asked = {}

    async def spawns(process):
        return await asyncio.create_subprocess_exec(
            sys.executable, "-c", ANSWERS,
            stdin=asyncio.subprocess.PIPE, stdout=asyncio.subprocess.PIPE,
        )  # fmt: skip

    async def asks(process, do, **fields):
        asked.setdefault(process.pid, []).append(do)
        return await Process.ask(process, do, **fields)

    monkeypatch.setattr(pool_module._Worker, "_spawn", spawns)
    monkeypatch.setattr(pool_module._Worker, "ask", asks)
    return asked


def test_a_spare_is_opened_anew_for_its_owner_and_answers_each_question(assets, light_workers):
    async def scenario(pool):
        pool.warm()
        spare = (await pool.spare).pid
        for do in ("picture", "check", "currents"):
            await pool.ask("me", do)
        assert light_workers[spare] == ["open", "open", "picture", "check", "currents"]

    running(assets, scenario)


def test_a_spare_that_dies_is_replaced(assets, light_workers):
    async def scenario(pool):
        pool.warm()
        first = await pool.spare
        os.kill(first.pid, signal.SIGKILL)
        await until(lambda: first.pid is None)
        assert (await pool.spare).pid is not None

    running(assets, scenario)


@pytest.mark.slow  # who hangs is tested in test_heartbeat.py
def test_a_spare_that_hangs_is_left_for_a_new_one(assets):
    async def scenario(pool):
        pool.warm()
        spare = (await pool.spare).pid
        os.kill(spare, signal.SIGSTOP)
        assert await pool.ask("one", "decode", digest=keep(assets, 1)) == {}
        assert pool.owned["one"].process.pid not in (spare, None)

    running(assets, scenario)


def test_a_worker_that_rests_is_ended(assets, monkeypatch):
    monkeypatch.setattr(pool_module, "IDLE_S", 0.0)

    async def scenario(pool):
        await pool.ask("me", "decode", digest=keep(assets, 1))
        await until(lambda: not processes(pool))
        assert not pool.owned

    running(assets, scenario)


def test_few_questions_may_wait(assets):
    async def scenario(pool):
        digest = keep(assets, 1)
        waiting = [
            asyncio.create_task(pool.ask("me", "decode", digest=digest))
            for _ in range(MOST_WAITING)
        ]
        await until(lambda: processes(pool))
        with pytest.raises(Problem, match="questions that wait"):
            await pool.ask("you", "decode", digest=digest)
        for task in waiting:
            task.cancel()
        await asyncio.gather(*waiting, return_exceptions=True)

    running(assets, scenario)


def test_questions_that_wait_when_the_service_ends_are_refused(assets):
    async def scenario(pool):
        digest = keep(assets, 1)
        asked = [
            asyncio.create_task(pool.ask("me", "decode", digest=digest))
            for _ in range(MOST_WAITING + 1)
        ]
        await until(lambda: processes(pool))
        pool.end()
        refused = await asyncio.gather(*asked, return_exceptions=True)
        assert [one.code for one in refused] == ["device"] * MOST_WAITING + ["limit"]

    running(assets, scenario)


class Sleeper(Process):
    """A process that returns no beat, as one that imports torch on a busy machine."""

    async def _spawn(self):
        return await asyncio.create_subprocess_exec(
            "sleep", "600", stdin=asyncio.subprocess.PIPE, stdout=asyncio.subprocess.PIPE
        )


def test_a_process_that_is_stopped_while_it_loads_is_ended_and_one_that_loads_is_not():
    """Counted in beats of a tenth of a second: a machine that is busy gives it more time."""

    async def run():
        loads, stopped = Sleeper(), Sleeper()
        await loads.launch()
        await stopped.launch()
        os.kill(stopped.pid, signal.SIGSTOP)
        question = asyncio.create_task(stopped.ask("picture"))
        with pytest.raises(Problem, match="hung"):
            await asyncio.wait_for(question, PATIENCE_S)
        assert stopped.has_hung
        assert loads.pid is not None and not loads.has_hung
        loads.kill()
        for process in (loads, stopped):
            await process.stop()

    asyncio.run(run())
