"""What attackers and faults do to `haptix serve`, in times; see --help.

Each starts a service of its own on the mock driver, and prints one line of figures. Half-open
connections are those that send the begin of a request and no more. With --all it also counts what
needs no service, and prints the table of docs/safety.md.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import re
import resource
import signal
import socket
import sys
import tempfile
import threading
import time
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from service import Service, serving  # type: ignore[import-not-found]

import haptix.service.client.connection

GRATING = {"kind": "grating", "period_mm": 2.0, "low": 0.6, "high": 0.9}
PLACE = {"x_mm": 0.0, "y_mm": 0.0, "width_mm": 100.0, "height_mm": 60.0}
LAYOUT = {"regions": [{"name": "ribs", "material": GRATING, **PLACE}]}
LOOK_S, PATIENCE_S = 0.002, 120.0


@contextlib.contextmanager
def sliding(service: Service) -> Iterator[tuple[Any, list[tuple[float, str]], list[float]]]:
    """A finger that slides; with when the output changed its state, and when it was felt."""
    os.environ["HAPTIX_SERVICE"] = service.environment["HAPTIX_SERVICE"]
    states: list[tuple[float, str]] = []
    felt: list[float] = []
    ends = threading.Event()

    def slides() -> None:
        while not ends.wait(0.008):
            client.touch(50 + 30 * float(np.sin(2 * time.monotonic())), 30.0, 0.5)

    def feels(frame: Any) -> None:
        if frame.stream == "friction" and np.nan_to_num(frame.rows[:, 7]).max() > 0:
            felt.append(time.monotonic())

    with haptix.service.client.connection.connect("attacked") as client:
        client.on("output", lambda output: states.append((time.monotonic(), output.state)))
        client.on("frame", feels)
        client.layout_set(LAYOUT)
        client.acquire()
        client.ask("subscribe", streams={"friction": 200.0})
        client.arm()
        thread = threading.Thread(target=slides)
        thread.start()
        try:
            wait(lambda: felt)
            yield client, states, felt
        finally:
            ends.set()
            thread.join()


def wait(look: Any) -> Any:
    end_s = time.monotonic() + PATIENCE_S
    while not (found := look()):
        if time.monotonic() > end_s:
            raise TimeoutError
        time.sleep(LOOK_S)
    return found


def hung_engine() -> dict[str, Any]:
    """SIGSTOP to the engine."""
    with serving() as service, sliding(service) as (_, states, felt):
        time.sleep(20.0)  # until its spare has loaded
        pid = service.pids["engine"]
        began_s = time.monotonic()
        os.kill(pid, signal.SIGSTOP)
        wait(lambda: [at_s for at_s, state in states if state == "failed" and at_s > began_s])
        told_s = next(at_s for at_s, state in states if state == "failed" and at_s > began_s)
        wait(lambda: felt[-1] > told_s + 0.2)
        again_s = next(at_s for at_s in felt if at_s > told_s)
        return {
            "told s": round(told_s - began_s, 2),
            "states": [(round(at_s - began_s, 2), state) for at_s, state in states],
            "felt again s": round(again_s - began_s, 2),
        }


def hung_worker() -> dict[str, Any]:
    """SIGSTOP to every process but front and engine: the virtual finger's is one of them."""
    felt_s: list[float] = []

    def feels(frame: Any) -> None:
        if frame.stream == "felt":
            felt_s.append(time.monotonic())

    with serving() as service, sliding(service) as (client, states, played_s):
        client.on("frame", feels)
        client.ask("subscribe", streams={"felt": 50.0, "friction": 200.0})
        wait(lambda: felt_s)
        time.sleep(20.0)
        began_s = time.monotonic()
        for name, pid in service.pids.items():
            if name not in ("front", "engine"):
                os.kill(pid, signal.SIGSTOP)
        wait(lambda: time.monotonic() - felt_s[-1] > 0.3)
        count = len(felt_s)
        wait(lambda: len(felt_s) > count)
        pauses_s = np.diff([at_s for at_s in played_s if at_s > began_s])
        return {
            "virtual finger feels again s": round(felt_s[count] - began_s, 2),
            "longest pause of what is played s": round(float(pauses_s.max()), 2),
            "states": [
                (round(at_s - began_s, 2), state) for at_s, state in states if at_s > began_s
            ],
        }


def connections(port: int, count: int, begin: bytes) -> list[socket.socket]:
    opened = []
    for _ in range(count):
        one = socket.socket()
        one.setblocking(False)
        one.connect_ex(("127.0.0.1", port))
        opened.append(one)
    for one in opened:
        with contextlib.suppress(OSError):
            one.send(begin)
    return opened


def stop_s(port: int) -> float:
    """How long STOP takes over HTTP, on a connection of its own."""
    began_s = time.monotonic()
    request = urllib.request.Request(f"http://127.0.0.1:{port}/stop", method="POST")
    with urllib.request.urlopen(request, timeout=60.0):
        return time.monotonic() - began_s


def crowd(count: int, begin: bytes, limit: int) -> dict[str, Any]:
    """So many connections that say nothing, or only begin to."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (limit, hard))
    with serving() as service:
        resource.setrlimit(resource.RLIMIT_NOFILE, (max(soft, 2 * count), hard))
        entry = Path(service.environment["HAPTIX_SERVICE"]) / "service.json"
        found = json.loads(entry.read_text())
        figures: dict[str, Any] = {}
        for path in ("port", "stop_port"):
            opened = connections(found[path], count, begin)
            took_ms = []
            for _ in range(21):
                took_ms.append(round(1e3 * stop_s(found[path]), 1))
                time.sleep(0.05)
            figures[f"{path}: first, longest later ms"] = (took_ms[0], max(took_ms[1:]))
            if path == "port":  # while the other path is crowded
                figures["stop_port beside it ms"] = round(1e3 * stop_s(found["stop_port"]), 1)
            for one in opened:
                one.close()
    return figures


def processor_s(service: Service) -> float:
    """Processor time of the front's loop: a busy machine changes nothing in it."""
    front = service.pids["front"]
    return int(Path(f"/proc/{front}/task/{front}/schedstat").read_text().split()[0]) * 1e-9


def flood(kind: str) -> dict[str, Any]:
    """One client sends as fast as it can; then its own stop, and another's, each many times.

    A client that sends more than can be read is disconnected, at 0 V: that counts as its stop.
    """
    from websockets.sync.client import connect
    from websockets.typing import Subprotocol

    with serving() as service:
        os.environ["HAPTIX_SERVICE"] = service.environment["HAPTIX_SERVICE"]
        folder = Path(service.environment["HAPTIX_SERVICE"])
        token = json.loads((folder / "service.json").read_text())["token"]
        address = f"ws://127.0.0.1:{service.port}/v1/session"
        own, others, worked, disconnected = [], [], [], 0
        with haptix.service.client.connection.connect("another") as another:
            for _ in range(10):
                with connect(
                    address, subprotocols=[Subprotocol("haptix.v1")], max_size=None
                ) as socket_:
                    hello = {"type": "hello", "id": 1, "protocol": "1.0", "client": "flood"}
                    socket_.send(json.dumps(hello | {"token": token}))
                    json.loads(socket_.recv())
                    halted, reading = threading.Event(), list[tuple[float, Any]]()
                    number = 2

                    def floods(socket_: Any = socket_, halted: Any = halted) -> None:
                        nonlocal number
                        end_s = time.monotonic() + 0.5
                        with contextlib.suppress(Exception):
                            while time.monotonic() < end_s:
                                message = {"type": kind, "id": number}
                                if kind == "layout_change":
                                    message["ops"] = [{"op": "remove", "name": "none"}]
                                number += 1
                                socket_.send(json.dumps(message))
                        halted.set()

                    def reads(socket_: Any = socket_, reading: Any = reading) -> None:
                        try:
                            while True:
                                text = socket_.recv()
                                reading.append((time.monotonic(), text))
                        except Exception:
                            reading.append((time.monotonic(), "disconnected"))

                    threading.Thread(target=reads, daemon=True).start()
                    threading.Thread(target=floods, daemon=True).start()
                    time.sleep(0.1)
                    while not halted.is_set():
                        began_s, work_s = time.monotonic(), processor_s(service)
                        another.stop()
                        others.append(time.monotonic() - began_s)
                        worked.append(processor_s(service) - work_s)
                        time.sleep(0.02)
                    disconnected += any(text == "disconnected" for _, text in reading)
                    began_s = time.monotonic()
                    with contextlib.suppress(Exception):
                        socket_.send(json.dumps({"type": "stop", "id": number}))
                    answer = re.compile(rf'"id":{number}\b|^disconnected$')

                    def answered(answer: Any = answer, reading: Any = reading) -> Any:
                        return [at for at, text in [*reading] if answer.search(text)]

                    own.append(max(0.0, wait(answered)[0] - began_s))
    return {
        "sent": number,
        "disconnected before its stop, of 10": disconnected,
        "own stop ms": [round(1e3 * float(np.percentile(own, p)), 1) for p in (50, 100)],
        "others' stop ms": [round(1e3 * float(np.percentile(others, p)), 1) for p in (50, 100)],
        "of that the front works ms": [
            round(1e3 * float(np.percentile(worked, p)), 1) for p in (50, 100)
        ],
    }


PROGRAMS = {
    "hung engine": hung_engine,
    "hung worker": hung_worker,
    "1300 idle at 1024": lambda: crowd(1300, b"", 1024),
    "4000 half-open": lambda: crowd(4000, b"POST /v1/pair HTTP/1.1\r\nHost: 127.0", 20_000),
    "flood of inventory": lambda: flood("inventory"),
    "flood of layouts": lambda: flood("layout_change"),
    "flood of acquire": lambda: flood("acquire"),
}


def zero_v() -> dict[str, Any]:
    """The longest time to 0 V after each fault, in device time."""
    from time_to_zero import times  # type: ignore[import-not-found]

    return {f"{name}, ms": round(max(times_ms), 2) for name, times_ms in times().items()}


def damaged_documents() -> dict[str, Any]:
    """Documents that are cut, doubled or changed, of each kind."""
    from tests.base.test_noticed_damage import DAMAGES, KINDS, PLACES, mistaken

    with tempfile.TemporaryDirectory() as folder:
        counts = {
            kind: sum(mistaken(kind, damage, Path(folder)) for damage in DAMAGES.values())
            for kind in KINDS
        }
    each = len(DAMAGES) * PLACES
    found = {"tried": each * len(counts), "read as something else": sum(counts.values())}
    return found | {f"of {each} of {kind}": count for kind, count in counts.items() if count}


def killed_writers() -> dict[str, Any]:
    """Writers of kept layouts that are killed; raises where a confirmed edit is lost."""
    from tests.service import test_kept_under_kills as kills

    parts = 10
    for part in range(parts):
        with tempfile.TemporaryDirectory() as folder:
            kills.test_no_confirmed_edit_is_lost_when_the_writer_is_killed(Path(folder), part)
    return {"writers killed": 3 * kills.SEQUENCES, "confirmed edits lost": 0}


DESK = {
    "time to 0 V": zero_v,
    "damaged documents": damaged_documents,
    "killed writers": killed_writers,
}
"""What needs no service."""


def row(name: str, figures: dict[str, Any]) -> str:
    """A line of the table of docs/safety.md."""
    cells = "; ".join(f"{key}: {value}" for key, value in figures.items() if key != "states")
    return f"| {name} | {cells} |"


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", choices=[[], *PROGRAMS, *DESK], help="these, or all")
    parser.add_argument("--all", action="store_true", help="all, and the table of the page")
    options = parser.parse_args()
    sys.path.insert(0, str(Path(__file__).parents[1]))  # the tests' own documents
    rows = []
    chosen = [*DESK, *PROGRAMS] if options.all else options.names or [*PROGRAMS]
    for name in chosen:
        try:
            figures = (PROGRAMS | DESK)[name]()
        except (OSError, TimeoutError, AssertionError) as error:
            figures = {"failed": f"{type(error).__name__}: {error}"}
        print(json.dumps({"attack": name} | figures), flush=True)
        rows.append(row(name, figures))
    if options.all:
        print("\n".join(["", "| attack | figures |", "|---|---|", *rows]))
    sys.exit()
