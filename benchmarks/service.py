"""Figures of `haptix serve`, on this machine and its mock driver; see --help.

Latency: one finger slides in a client, which prints when it sent each batch. The engine notes when
it took the touch, and each revision that the driver obeyed: when it was begun, and when the mock
plays its first sample. The first revision begun after a touch was taken is the first that knew it.
All by CLOCK_MONOTONIC.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np

HERE = Path(__file__).parent
CSHARP = HERE.parent / "clients" / "csharp"
TICK_HZ = os.sysconf("SC_CLK_TCK")
CLIENTS = ("Python", "asyncio", "TypeScript", "C#")


# --- in the service's own processes ---------------------------------------------------------------


def front() -> None:
    """Serve as `haptix serve` does, with an engine that takes notes."""
    from haptix.tasks.cli import main

    start = asyncio.create_subprocess_exec

    def starts(program: str, *arguments: str, **options: Any) -> Any:
        if "haptix.service.engine.process" in arguments:
            arguments = (__file__, "--engine")
        return start(program, *arguments, **options)

    asyncio.create_subprocess_exec = starts  # type: ignore[assignment]
    sys.argv = ["haptix", "serve", "--port", "0"]
    main()


def engine() -> None:
    """Render as the engine does, and write what was noted to HAPTIX_NOTES at the end."""
    import firmware_io.playback
    from firmware_io.reviser import Reviser
    from haptix.play.render import LiveRenderer
    from haptix.service.engine.process import main

    taken: list[float] = []
    obeyed: list[tuple[float, float]] = []

    class NotingReviser(Reviser):
        def __init__(self, *arguments: Any) -> None:
            super().__init__(*arguments)
            self._begun: deque[tuple[float, float]] = deque()

        def _revise(self) -> None:
            began_s, waiting = self._clock(), len(self._under_way)
            super()._revise()
            if len(self._under_way) > waiting:
                self._begun.append((began_s, self._under_way[-1][1]))

        def _observe(self, progress: Any) -> None:
            count = min(progress.revisions - self._obeyed, len(self._begun))
            undone = progress.revisions_undone - self._undone
            super()._observe(progress)
            obeyed.extend(self._begun.popleft() for _ in range(count))
            if undone:
                self._begun.clear()

    take = LiveRenderer._take

    def takes(renderer: Any, events: Any, *arguments: Any) -> None:
        take(renderer, events, *arguments)
        taken.extend([time.monotonic()] * len(events))  # batches may be taken together

    setattr(firmware_io.playback, "Reviser", NotingReviser)  # noqa: B010
    setattr(LiveRenderer, "_take", takes)  # noqa: B010
    try:
        main()
    finally:
        notes = {"taken_s": taken, "obeyed_s": obeyed}
        Path(os.environ["HAPTIX_NOTES"]).write_text(json.dumps(notes))


# --- around them ----------------------------------------------------------------------------------


class Service:
    """The service in processes of its own."""

    def __init__(self, folder: Path, notes: bool) -> None:
        self.notes = folder / "notes.json"
        folder.mkdir(exist_ok=True)
        self.environment = os.environ | {"HAPTIX_SERVICE": str(folder / "service")}
        self.environment |= {"HAPTIX_NOTES": str(self.notes), "PYTHONPATH": str(HERE.parent)}
        how = [__file__, "--front"] if notes else ["-m", "haptix.tasks.cli", "serve", "--port", "0"]
        began_s = time.monotonic()
        self.process = subprocess.Popen(
            [sys.executable, *how], stdout=subprocess.PIPE, text=True, env=self.environment
        )
        assert self.process.stdout is not None
        line = self.process.stdout.readline()
        self.started_s = time.monotonic() - began_s
        found = re.search(r"http://127.0.0.1:(\d+)", line)
        assert found, line
        self.port = int(found[1])

    @property
    def pids(self) -> dict[str, int]:
        """Process numbers of the front, and of its children by their order."""
        children = Path(f"/proc/{self.process.pid}/task/{self.process.pid}/children").read_text()
        names = ("front", "engine", *(f"worker {number}" for number in range(9)))
        return dict(zip(names, (self.process.pid, *map(int, children.split())), strict=False))

    def cpu_s(self) -> dict[str, float]:
        """Processor time of each."""
        found = {}
        for name, pid in self.pids.items():
            fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
            found[name] = (int(fields[11]) + int(fields[12])) / TICK_HZ
        return found

    def holds(self) -> dict[str, tuple[float, int]]:
        """Resident memory [MB] and descriptors of each."""
        found = {}
        for name, pid in self.pids.items():
            pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
            memory = pages * os.sysconf("SC_PAGE_SIZE") / 1e6
            found[name] = (memory, len([*Path(f"/proc/{pid}/fd").iterdir()]))
        return found

    def close(self) -> None:
        self.process.send_signal(signal.SIGINT)
        self.process.wait(20)


@contextmanager
def serving(notes: bool = False) -> Iterator[Service]:
    with tempfile.TemporaryDirectory() as folder:
        service = Service(Path(folder), notes)
        try:
            yield service
        finally:
            service.close()


@contextmanager
def busy(count: int) -> Iterator[None]:
    """So many processes that compute without an end."""
    others = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(count)]
    try:
        yield
    finally:
        for other in others:
            other.kill()
            other.wait()


def command(client: str, folder: Path) -> list[str]:
    """Return the command of a client that slides."""
    here = HERE / "touching"
    if client == "TypeScript":
        return ["node", str(here / "touching.mjs")]
    if client == "C#":
        target = folder / "touching.exe"
        library = "/usr/lib/cli/Newtonsoft.Json-5.0/Newtonsoft.Json.dll"
        subprocess.run(["make", "-C", HERE.parent, "-s", "clients"], check=True)
        sources = [*map(str, CSHARP.glob("*.cs")), str(here / "Touching.cs")]
        options = ["-langversion:6", "-r:System.dll", f"-r:{library}", f"-out:{target}"]
        subprocess.run(["mcs", *options, *sources], check=True)
        shutil.copy(library, folder)
        return ["mono", str(target)]
    return [sys.executable, str(here / "touching.py")]


def latency(client: str, count: int, interval_s: float) -> dict[str, Any]:
    """Return times from the sending of a touch to the first sample that knew it [ms]."""
    with tempfile.TemporaryDirectory() as name:
        run = [*command(client, Path(name)), str(count), str(interval_s)]
        run += ["asyncio"] * (client == "asyncio")
        with serving(notes=True) as service:
            done = subprocess.run(
                run, stdout=subprocess.PIPE, text=True, check=True, env=service.environment
            )
            service.close()
            notes = json.loads(service.notes.read_text())
    sent, taken = np.array(json.loads(done.stdout)), np.array(notes["taken_s"])
    if len(sent) != len(taken):
        return {"client": client, "sent": len(sent), "taken": len(taken)}
    began, first = np.array(notes["obeyed_s"]).T
    at = np.searchsorted(began, taken)
    known = at < len(began)
    way, whole = taken - sent, first[at[known]] - sent[known]
    return {"client": client, "batches": len(sent)} | {
        f"{what} {name}": round(1e3 * float(np.percentile(times, share)), 2)
        for what, times in (("to the engine", way), ("to the sample", whole))
        for name, share in (("p50", 50), ("p99", 99), ("largest", 100))
    }


def load(seconds: float, every_s: float = 10.0) -> Iterator[dict[str, Any]]:
    """Ten fingers at 1 kHz and five observers: what it takes, every so often."""
    import haptix.service.client.connection

    with serving() as service:
        os.environ["HAPTIX_SERVICE"] = service.environment["HAPTIX_SERVICE"]
        run = [sys.executable, str(HERE / "touching" / "touching.py"), "ten"]
        ten = subprocess.Popen(run, env=service.environment)
        rows: deque[Any] = deque(maxlen=1)
        observers = [
            haptix.service.client.connection.connect(f"observer {number}") for number in range(5)
        ]
        for observer in observers:
            observer.on("frame", lambda frame: rows.append(frame.rows[-1]))
            observer.ask("subscribe", streams={"stats": 20.0})
        while not rows or not rows[-1][3]:  # until it is armed
            time.sleep(0.1)
        time.sleep(2.0)
        end_s, touches = time.monotonic() + seconds, float(rows[-1][3])
        while time.monotonic() < end_s:
            began_s, cpu_s = time.monotonic(), service.cpu_s()
            time.sleep(min(every_s, max(0.1, end_s - began_s)))
            spent_s = time.monotonic() - began_s
            # A worker that was begun meanwhile stands in another's place.
            used = {
                name: max(0.0, used - cpu_s.get(name, 0.0))
                for name, used in service.cpu_s().items()
            }
            holds = service.holds()
            row, before = rows[-1], touches
            touches = float(row[3])
            yield {
                "seconds": round(time.monotonic() - (end_s - seconds), 1),
                "touches a second": round((touches - before) / spent_s),
                "underruns": int(row[2]),
                "reaction p99 ms": round(1e3 * float(row[1]), 2),
                "CPU share": {name: round(used[name] / spent_s, 3) for name in used},
                "of a core": round(sum(used.values()) / spent_s, 3),
                "MB": {name: round(memory, 1) for name, (memory, _) in holds.items()},
                "descriptors": {name: count for name, (_, count) in holds.items()},
            }
        ten.send_signal(signal.SIGINT)
        ten.wait()
        for observer in observers:
            observer.close()


def starts(times: int) -> Iterator[dict[str, Any]]:
    """Starts, with an empty cache and with the surface in it."""
    with tempfile.TemporaryDirectory() as cache:
        os.environ["HAPTIX_CACHE"] = cache
        for number in range(times + 1):
            with serving() as service:
                yield {
                    "start": "cached" if number else "without a surface",
                    "seconds": round(service.started_s, 2),
                    "processor s": service.cpu_s(),
                }
        del os.environ["HAPTIX_CACHE"]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--front", action="store_true", help=argparse.SUPPRESS)
    parser.add_argument("--engine", action="store_true", help=argparse.SUPPRESS)
    parser.add_argument("--latency", nargs="*", choices=CLIENTS, help="of these clients, or all")
    parser.add_argument("--batches", type=int, default=1000)
    parser.add_argument("--interval-ms", type=float, default=8.0)
    parser.add_argument("--busy", type=int, default=0, help="so many other processes compute")
    parser.add_argument("--load", type=float, help="ten fingers and five observers [s]")
    parser.add_argument("--soak", type=float, help="the same, and what memory has become [s]")
    parser.add_argument("--starts", type=int, help="so many starts with the surface kept")
    options = parser.parse_args()
    if options.front or options.engine:
        (front if options.front else engine)()
        return
    with busy(options.busy):
        if options.starts is not None:
            for row in starts(options.starts):
                print(json.dumps(row), flush=True)
        if options.latency is not None:
            for client in options.latency or CLIENTS:
                row = latency(client, options.batches, options.interval_ms / 1e3)
                print(json.dumps(row), flush=True)
        if options.load:
            for row in load(options.load):
                print(json.dumps(row), flush=True)
        if options.soak:
            soak(options.soak)


def soak(seconds: float) -> None:
    """Memory and descriptors after the first tenth, at least a minute, and at the end."""
    first: dict[str, Any] | None = None
    for row in load(seconds, every_s=min(60.0, seconds / 10)):
        print(json.dumps(row), flush=True)
        if first is None and row["seconds"] >= max(seconds / 10, min(70.0, seconds / 2)):
            first = row
        last = row
    assert first is not None
    grown = {name: round(last["MB"][name] - first["MB"][name], 1) for name in first["MB"]}
    row = {"grown MB": grown, "flat": max(grown.values()) <= 10.0}
    row["no descriptor lost"] = last["descriptors"] == first["descriptors"]
    print(json.dumps(row))


if __name__ == "__main__":
    with suppress(KeyboardInterrupt):
        main()
