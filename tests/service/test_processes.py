"""The whole service: every process is killed and hung, and the driver's record says when 0 V was.

The driver is a mock at real pace, served to the engine over TCP by this process, so it lives on
whatever dies. Times are the driver's own: samples between the fault and the last one above 0 V.

Here real time is the subject: each deadline is what a finger on a screen is promised. A machine
that lets programs wait adds to it; how long it lets one of ours wait is measured beside it.
"""

import contextlib
import os
import re
import signal
import subprocess
import sys
import textwrap
import threading
import time
from pathlib import Path

import numpy as np
import pytest

import haptix.service.client.connection
from firmware_io import MockDriver
from firmware_io.serve import DriverServer
from haptix.base.errors import DeviceError
from haptix.feel.gallery import ASSETS
from tests.waiting import PATIENCE_S, pause, wait_for

pytestmark = pytest.mark.slow  # each starts the whole service

LAYOUT = {
    "regions": [
        {
            "name": "ribs",
            "material": {"kind": "grating", "period_mm": 2.0, "low": 0.6, "high": 0.9},
            "x_mm": 0.0,
            "y_mm": 0.0,
            "width_mm": 100.0,
            "height_mm": 60.0,
        }
    ]
}
BUSY_S, HOPS = 0.25, 5
"""What a machine with two busy cores adds to a deadline, and how often between a fault and 0 V a
program of ours waits for its turn."""


class Lateness:
    """How long this machine lets a program wait for its turn, at most, since its begin."""

    EVERY_S = 0.005

    def __init__(self):
        self.ends, self.longest_s = threading.Event(), 0.0
        self.thread = threading.Thread(target=self.run, daemon=True)
        self.thread.start()

    def run(self):
        looked_s = time.monotonic()
        while not self.ends.wait(self.EVERY_S):
            now_s = time.monotonic()
            self.longest_s = max(self.longest_s, now_s - looked_s - self.EVERY_S)
            looked_s = now_s

    def stop(self):
        self.ends.set()
        self.thread.join()


class Running:
    """A service in processes of its own, and the driver that it plays to."""

    def __init__(self, folder, device=""):
        self.driver = MockDriver(pace="real", kept_s=600.0)
        self.server = DriverServer(self.driver)
        threading.Thread(target=self.server.serve, daemon=True).start()
        self.environment = os.environ | {"HAPTIX_SERVICE": str(folder)}
        self.process = subprocess.Popen(
            [
                *(sys.executable, "-m", "haptix.tasks.cli", "serve", "--port", "0"),
                *("--device", device or self.server.address),
            ],
            stdout=subprocess.PIPE,
            text=True,
            env=self.environment,
        )
        first = self.process.stdout.readline()
        assert "haptix serves" in first, first
        self.lines = [first, self.process.stdout.readline()]
        self.port = int(re.search(r"http://127.0.0.1:(\d+) with finger semi-wet,", first)[1])

    @property
    def helpers(self):
        """Process numbers of the front's children."""
        children = Path(f"/proc/{self.process.pid}/task/{self.process.pid}/children")
        return list(map(int, children.read_text().split()))

    @property
    def engine(self):
        """Process number of the engine; 0 while there is none."""
        return next(iter(self.helpers), 0)

    def connect(self, name="test", **fields):
        os.environ["HAPTIX_SERVICE"] = self.environment["HAPTIX_SERVICE"]
        return haptix.service.client.connection.connect(name, **fields)

    @contextlib.contextmanager
    def at_0_v_within(self, limit_s):
        """Fail if the last output above 0 V is later after the body's begin than a deadline."""
        lateness, began_s = Lateness(), time.monotonic()
        yield
        wait_for(lambda: not np.any(self.driver.output_v[-24_000:]))
        lateness.stop()
        volts, now_s = self.driver.output_v, time.monotonic()
        live = np.flatnonzero(volts)
        assert len(live), "nothing was played at all"
        silent_s = (len(volts) - 1 - live[-1]) / 48_000
        assert now_s - silent_s - began_s < limit_s + BUSY_S + HOPS * lateness.longest_s

    def is_live(self):
        """Whether there was voltage in the last 50 ms."""
        return bool(np.any(self.driver.output_v[-2400:]))

    def close(self):
        self.process.send_signal(signal.SIGINT)
        self.process.wait(PATIENCE_S)
        self.server.stop()


@pytest.fixture
def running(tmp_path):
    service = Running(tmp_path / "service")
    yield service
    service.close()


class Sliding:
    """A finger that slides to and fro in a thread, until it is told to stop."""

    def __init__(self, client):
        self.client, self.ends = client, threading.Event()
        self.thread = threading.Thread(target=self.run, daemon=True)
        self.thread.start()

    def run(self):
        began_s = time.monotonic()
        try:
            while not self.ends.wait(0.008):
                turn = (time.monotonic() - began_s) * 2.0
                place = 50.0 + 30.0 * np.sin(turn)
                self.client.touch(float(place), 30.0, 0.5)
        except DeviceError:
            pass  # the service is gone, as the test wanted

    def stop(self):
        self.ends.set()
        self.thread.join()


def felt(service, client):
    """Arm and slide until there is voltage."""
    client.layout_set(LAYOUT)
    client.acquire()
    client.arm()
    sliding = Sliding(client)
    wait_for(service.is_live)
    return sliding


@pytest.mark.slow  # waits until nothing more is loaded
def test_at_rest_three_processes_take_450_mb(running):
    with running.connect() as client:
        assert client.ask("inventory").kinds

    def used_mb():
        pages = [
            int(Path(f"/proc/{pid}/statm").read_text().split()[1])
            for pid in (running.process.pid, *running.helpers)
        ]
        return len(pages), sum(pages) * os.sysconf("SC_PAGE_SIZE") / 1e6

    seen = []

    def is_at_rest():
        seen.append(used_mb())
        pause(1.0)
        same = {(n, round(mb)) for n, mb in seen[-4:]} == {(3, round(seen[-1][1]))}
        return len(seen) > 3 and same

    wait_for(is_at_rest)
    assert seen[-1][1] < 450


def test_a_finger_feels_and_every_end_is_at_0_v(running):
    lateness = Lateness()
    with running.connect() as client:
        sliding = felt(running, client)
        # The first volts are those of the fade.
        wait_for(lambda: np.abs(running.driver.output_v).max() > 20.0)
        assert np.abs(running.driver.output_v).max() <= 200.0
        client.stop()
        assert client.output.state == "off"
        wait_for(lambda: not running.is_live())
        client.arm()
        wait_for(running.is_live)
        with running.at_0_v_within(0.05):
            client.stop()
        sliding.stop()
        lateness.stop()
        # A driver whose host does not run for a while is starved.
        assert running.driver.faults == 0 or lateness.longest_s > 0.05


def test_what_a_finger_does_is_told_and_what_an_app_sets_is_obeyed(running):
    events = []
    with running.connect() as client:
        for kind in ("contact", "effect_ended", "output"):
            client.on(kind, events.append)
        sliding = felt(running, client)
        frames = []
        client.on("frame", frames.append)
        assert client.ask("subscribe", streams={"stats": 20.0}).columns["stats"][3] == "touches"
        wait_for(lambda: len(frames) >= 3 and 0 < frames[0].rows[0, 3] < frames[-1].rows[0, 3])
        # A client that reads late is sent the newest frames only.
        numbers, touches = zip(*((one.number, one.rows[0, 3]) for one in [*frames]), strict=True)
        assert [*numbers] == sorted({*numbers}) and [*touches] == sorted(touches)
        # Reactions of the last touches, in a second in which some were in time.
        wait_for(lambda: any(0.0 < one.rows[0, 0] <= one.rows[0, 1] for one in frames))
        entered = wait_for(lambda: next((one for one in events if one.type == "contact"), None))
        assert (entered.event, entered.region, entered.touch_id) == ("enter", "ribs", 0)
        assert abs(client.now_s() - entered.t_s) < 60.0  # by the client's own clock
        assert client.ask("mute", on=True).muted
        wait_for(lambda: not running.is_live())
        assert not client.ask("mute", on=False).muted
        wait_for(running.is_live)
        assert client.intensity(0.0).intensity == 0.0
        wait_for(lambda: not running.is_live())
        assert client.ask("pause", on=True).paused
        assert not client.ask("pause", on=False).paused
        client.intensity(1.0)
        wait_for(running.is_live)
        curve = {"kind": "sine", "frequency_hz": 100.0, "length_s": 0.05, "amplitude": 0.4}
        effect = client.ask("play", effect={"kind": "transient", "curve": curve}).effect_id
        wait_for(lambda: any(event.type == "effect_ended" for event in events))
        ended = next(event for event in events if event.type == "effect_ended")
        assert (ended.effect_id, ended.how) == (effect, "played")
        client.layout_change([{"op": "remove", "name": "ribs"}])
        wait_for(lambda: not running.is_live())
        sliding.stop()


CLIENT = """
    import sys, time
    from math import sin
    import haptix.service.client.connection
    with haptix.service.client.connection.connect("to be killed") as h:
        h.layout_set({layout})
        h.acquire()
        h.arm()
        print("armed", flush=True)
        while True:
            h.touch(50 + 30 * sin(2 * time.monotonic()), 30.0, 0.5)
            time.sleep(0.008)
"""


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGSTOP])
def test_a_client_is_killed_or_hangs(running, how):
    script = textwrap.dedent(CLIENT).format(layout=LAYOUT)
    client = subprocess.Popen(
        [sys.executable, "-c", script], env=running.environment, stdout=subprocess.PIPE, text=True
    )
    try:
        assert client.stdout.readline() == "armed\n"
        wait_for(running.is_live)
        # A closed socket: 50 ms. Silence: two pings, 0.4 s without an answer, and 50 ms.
        limit_s = 0.05 if how == signal.SIGKILL else 0.2 + 0.4 + 0.05
        with running.at_0_v_within(limit_s):
            client.send_signal(how)
    finally:
        client.kill()
        client.wait()


def program_of(pid):
    return Path(f"/proc/{pid}/cmdline").read_text()


def is_armed(client):
    """Arm, once the new engine is there."""
    try:
        return client.arm().state == "armed"
    except haptix.service.client.connection.Refused as refused:
        assert refused.code == "device"
        return False


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGSTOP])
def test_the_engine_is_killed_or_hangs(running, how):
    reasons = []
    with running.connect() as client:
        client.on("output", lambda output: reasons.append((output.state, output.reason)))
        sliding = felt(running, client)
        engine = running.engine
        with running.at_0_v_within(0.16 + 0.05):  # the driver's watchdog is 160 ms at most
            os.kill(engine, how)
        wait_for(lambda: ("off", "the engine is there again") in reasons)
        told = [reason for state, reason in reasons if state == "failed"]
        assert ("hung" if how == signal.SIGSTOP else "ended with code -9") in told[0]
        assert engine not in running.helpers
        # The driver is a mock, which is armed again by itself, with the layout that it had.
        wait_for(running.is_live)
        sliding.stop()


def test_a_driver_that_goes_and_comes_back_is_felt_again(running):
    """Three times under a sliding finger; what an app and another client see of it."""
    port, states = running.server.port, []
    with running.connect() as client, running.connect("another") as another:
        another.on("output", lambda output: states.append(output.state))
        sliding = felt(running, client)
        for _ in range(3):
            states.clear()
            running.server.stop()  # the driver ramps to 0 V
            wait_for(lambda: "gone" in states)
            running.driver = MockDriver(pace="real", kept_s=600.0)
            running.server = DriverServer(running.driver, port=port)
            threading.Thread(target=running.server.serve, daemon=True).start()
            wait_for(running.is_live)
            wait_for(lambda: "armed" in states)
            seen = [
                state
                for state, before in zip(states, ["", *states], strict=False)
                if state != before
            ]
            assert seen == ["failed", "gone", "back", "armed"]
        sliding.stop()


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGSTOP])
def test_workers_are_killed_or_hang_under_a_finger_that_slides(running, how):
    """The virtual finger feels again, the voltage goes on, and no other session notices."""
    photograph = next(ASSETS.glob("*.*")).stem
    region = {"name": "wall", "width_mm": 60.0, "height_mm": 40.0}
    material = {"kind": "photograph", "file": f"sha256:{photograph}", "width_mm": 60.0}
    with running.connect() as client, running.connect("another") as another:
        frames, outputs, others = [], [], []
        client.on("frame", frames.append)
        client.on("output", outputs.append)
        for kind in ("lost", "warning", "error", "lease"):
            another.on(kind, others.append)
        before = another.layout_set(LAYOUT).revision
        client.ask("subscribe", streams={"felt": 100.0})
        lateness = Lateness()
        sliding = felt(running, client)
        failures = []

        def is_felt():
            failed = [output.reason for output in outputs if output.state == "failed"]
            if failed and is_armed(client):
                failures.extend(failed)
                outputs.clear()
            return bool(frames)

        wait_for(is_felt)
        others.clear()
        engine = running.engine
        workers = [one for one in running.helpers if "service.worker" in program_of(one)]
        assert len(workers) > 1  # the virtual finger's, and one that is nobody's yet
        for worker in workers:
            os.kill(worker, how)
        wait_for(lambda: not {*workers} & {*running.helpers})
        frames.clear()

        def is_decoded():
            """A new worker decodes the other session's photograph; it may start for long."""
            try:
                return another.layout_set({"regions": [{**region, "material": material}]})
            except DeviceError:
                return None

        assert wait_for(is_decoded).revision > before
        wait_for(is_felt)
        lateness.stop()
        # The driver is a thread of this process: one that gets no turn for long does not answer.
        assert not failures or lateness.longest_s > 0.1, failures
        assert running.engine == engine and not others
        assert np.abs(running.driver.output_v).max() <= 200.0
        with running.at_0_v_within(0.05):
            client.stop()
        sliding.stop()


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGSTOP])
def test_the_front_is_killed_or_hangs(running, how):
    with running.connect() as client:
        sliding = felt(running, client)
        client.ask("subscribe", streams={"felt": 100.0})
        wait_for(lambda: len(running.helpers) > 1)  # the virtual finger starts
        helpers = running.helpers
        # Its input ends, or no tick comes for 100 ms.
        limit_s = 0.05 if how == signal.SIGKILL else 0.1 + 0.02 + 0.05
        with running.at_0_v_within(limit_s):
            os.kill(running.process.pid, how)
        if how == signal.SIGKILL:
            # The virtual finger may still import what it needs, and hears of the end after that.
            wait_for(lambda: not any(Path(f"/proc/{one}").exists() for one in helpers))
        else:
            os.kill(running.process.pid, signal.SIGCONT)
        sliding.stop()
