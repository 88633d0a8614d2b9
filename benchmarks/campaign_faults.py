"""A campaign on a Dask cluster whose workers are killed: the same bytes as in one process?

    python benchmarks/campaign_faults.py [--tasks 10000] [--seconds 0.005] [--every 10] [--for 60]
        [--namespaces]

Starts a scheduler and two workers, runs small tasks that each write a file, kills one worker with
SIGKILL at intervals and starts another, and compares all results with those of a plain loop. It
prints the overhead per task beside the same loop. With ``--namespaces`` (Linux, root) scheduler and
workers are on two hosts: network namespaces joined by a virtual cable.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

from haptix.base.results import ResultStore
from haptix.base.task import Context, Result, Task
from haptix.base.version import __version__
from haptix.tasks.campaign import Campaign, CampaignTask, run_campaign
from haptix.tasks.campaign.cluster import DaskWorkers
from haptix.tasks.campaign.plans import kind_named

HOSTS = {"haptix-a": "10.77.0.1", "haptix-b": "10.77.0.2"}


class Wait(Task):
    """Takes a given time and writes a small file."""

    number: int
    seconds: float

    def run(self, context: Context) -> Result:
        end = time.perf_counter() + self.seconds
        value = self.number
        while time.perf_counter() < end:
            value = (1103515245 * value + 12345) % 2**31
        return Result({"number": self.number})


class Small(Campaign):
    """Tasks that take a given time and write a small file."""

    numbers: int
    seconds: float

    def tasks(self):
        for number in range(self.numbers):
            yield CampaignTask(Wait(number=number, seconds=self.seconds))


def tree(folder: Path) -> dict[str, str]:
    """Hashes of all results."""
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in folder.glob("results/*/*/*")
    }


def namespaces(make: bool) -> None:
    """Make or remove two hosts joined by a cable."""
    if not make:
        for name in HOSTS:
            subprocess.run(["ip", "netns", "del", name], check=False, capture_output=True)
        return
    (a, at), (b, there) = HOSTS.items()
    lines = [
        *(f"netns add {name}" for name in HOSTS),
        f"link add veth-a netns {a} type veth peer name veth-b netns {b}",
        *(f"-n {name} link set lo up" for name in HOSTS),
        f"-n {a} addr add {at}/24 dev veth-a",
        f"-n {b} addr add {there}/24 dev veth-b",
        f"-n {a} link set veth-a up",
        f"-n {b} link set veth-b up",
    ]
    for line in lines:
        subprocess.run(["ip", *line.split()], check=True)


class Cluster:
    """A scheduler and workers, each a process of its own; one may be killed."""

    def __init__(self, folder: Path, hosts: bool) -> None:
        self.hosts, self.file = hosts, folder / "scheduler.json"
        self.started = 0
        at = ["--host", HOSTS["haptix-a"]] if hosts else []
        options = ["--port", "0", "--no-dashboard", "--scheduler-file", str(self.file), *at]
        self.scheduler = self._dask("haptix-a", "scheduler", *options)
        while not self.file.exists():
            time.sleep(0.1)
        self.workers = [self.worker() for _ in range(2)]

    def _dask(self, host: str, *words: str) -> subprocess.Popen[bytes]:
        inside = ["ip", "netns", "exec", host] if self.hosts else []
        python = [sys.executable, "-m", "dask", *words]
        return subprocess.Popen(
            [*inside, *python], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )

    def worker(self) -> subprocess.Popen[bytes]:
        """Start a worker without a nanny, which would start it anew after a kill."""
        name = [*HOSTS][self.started % 2]
        self.started += 1
        options = ["--scheduler-file", str(self.file), "--nthreads", "1", "--no-nanny"]
        return self._dask(name, "worker", *options, "--no-dashboard", "--name", f"w{self.started}")

    def kill_one(self) -> None:
        """Kill the older worker, and start another."""
        victim = self.workers.pop(0)
        victim.send_signal(signal.SIGKILL)
        victim.wait()
        self.workers.append(self.worker())

    def end(self) -> None:
        """End all."""
        for one in (*self.workers, self.scheduler):
            one.kill()
            one.wait()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tasks", type=int, default=10_000)
    parser.add_argument("--seconds", type=float, default=0.005)
    parser.add_argument("--every", type=float, default=10.0, help="seconds between kills; 0: none")
    parser.add_argument("--for", type=float, default=60.0, dest="length", help="seconds of kills")
    parser.add_argument("--namespaces", action="store_true")
    parser.add_argument("--inside", action="store_true", help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.namespaces and not asked.inside:
        # The client is on the scheduler's host.
        namespaces(False)
        namespaces(True)
        try:
            again = [sys.executable, *sys.argv, "--inside"]
            subprocess.run(["ip", "netns", "exec", "haptix-a", *again], check=True)
        finally:
            namespaces(False)
        return
    own = Path(__file__).resolve()
    os.environ["PYTHONPATH"] = os.pathsep.join([str(own.parent), str(own.parents[1])])
    os.environ |= dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
    kind = "campaign_faults:Small"
    # By the name of this module, which workers can import, and not as __main__.
    small: Any = kind_named(kind)
    plan = small(name="small", kind=kind, numbers=asked.tasks, seconds=asked.seconds)
    folder = Path(tempfile.mkdtemp(prefix="haptix-faults-"))
    loop, began = ResultStore(folder / "loop"), time.perf_counter()
    for task in plan.tasks():  # the same loop: computed and written
        about = {"task": task.task.path(), "haptix": __version__, "document": task.document}
        found = task.task.run(Context())
        loop.publish(task.key, found.files, {**about, "row": found.row})
    loop_s = time.perf_counter() - began
    cluster = Cluster(folder, asked.namespaces)
    workers = DaskWorkers.on(str(cluster.file))
    ends: list[float] = []
    kills, first = 0, 0.0

    def progress(seen: object) -> None:
        nonlocal kills, first
        now = time.perf_counter()
        ends.append(now)
        first = first or now
        if asked.every and now - first < asked.length and now - first > asked.every * (kills + 1):
            cluster.kill_one()
            kills += 1

    try:
        done = run_campaign(plan, folder / "cluster", workers, progress)
    finally:
        workers.shutdown()
        cluster.end()
    here, there = tree(folder / "loop"), tree(folder / "cluster")
    each = (ends[-1] - ends[0]) / (len(ends) - 1)
    print(f"{done.counts['done']} of {asked.tasks} tasks done, {kills} workers killed")
    print(f"identical to the loop: {here == there}, {len(here)} results compared")
    print(f"loop {1e3 * loop_s / asked.tasks:.2f} ms a task; cluster {1e3 * each:.2f} ms a task")
    busy = 1e3 * loop_s / asked.tasks / 2
    print(f"overhead of a worker's task: {2 * (1e3 * each - busy):.2f} ms on 2 workers")
    with suppress(OSError):
        shutil.rmtree(folder)


if __name__ == "__main__":
    main()
