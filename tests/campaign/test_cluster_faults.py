"""A cluster of processes that loses its scheduler, its client and its workers: nothing is lost."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from haptix.campaign import load_campaign, run_campaign
from tests.campaign.test_local_campaigns import KIND, pages, results, wait_for  # noqa: F401

pytest.importorskip("distributed")
pytestmark = pytest.mark.slow  # tests of clusters in one process cover the same code

ROOT = Path(__file__).parents[2]
PATIENCE_S = 240  # of a machine with two cores that others use


class Cluster:
    """A scheduler and workers, each a process of its own."""

    def __init__(self, folder):
        self.file, self.running = folder / "scheduler.json", []
        self.scheduler = self.start_scheduler()

    def start(self, *words, path=""):
        python = os.pathsep.join(filter(None, [path, str(ROOT)]))
        env = {**os.environ, "PYTHONPATH": python, "OMP_NUM_THREADS": "1"}
        one = subprocess.Popen(
            [sys.executable, "-m", *words],
            env=env,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        self.running.append(one)
        return one

    def start_scheduler(self):
        self.file.unlink(missing_ok=True)
        options = ["--host", "127.0.0.1", "--port", "0", "--no-dashboard"]
        one = self.start("dask", "scheduler", *options, "--scheduler-file", str(self.file))
        wait_for(self.file.exists, PATIENCE_S)
        return one

    def start_worker(self, name, *options, path=""):
        words = ["--scheduler-file", str(self.file), "--nthreads", "1", "--no-dashboard"]
        return self.start("dask", "worker", *words, "--name", name, *options, path=path)

    def end(self):
        for one in self.running:
            one.terminate()  # a nanny ends its worker
        for one in self.running:
            try:
                one.wait(10)
            except subprocess.TimeoutExpired:
                one.kill()
                one.wait()


@pytest.fixture
def cluster(tmp_path):
    cluster = Cluster(tmp_path)
    yield cluster
    cluster.end()


def plan_of(folder, **fields):
    path = folder / "plan.toml"
    lines = [f"{name} = {value}" for name, value in fields.items()]
    path.write_text("\n".join(['name = "squares"', f'kind = "{KIND}"', *lines]))
    return path


def start_command(cluster, plan, out):
    words = ["haptix.cli", "campaign", str(plan), "--on", str(cluster.file), "--out", str(out)]
    return subprocess.Popen(
        [sys.executable, "-m", *words], stderr=subprocess.PIPE, text=True,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )  # fmt: skip


def done_in(out):
    return len([*out.glob("results/*/*/result.json")])


def test_a_killed_scheduler_and_client_lose_nothing(cluster, tmp_path):
    plan = plan_of(tmp_path, numbers=60, file_bytes=3000, pause_s=0.2)
    out = tmp_path / "out"
    workers = [cluster.start_worker(f"w{n}", "--no-nanny") for n in range(2)]

    # The client goes in the middle of a write; its workers end what they do.
    command = start_command(cluster, plan, out)
    wait_for(lambda: done_in(out) and [*out.glob("results/*/.*.part")], PATIENCE_S)
    command.kill()
    command.communicate()

    # The scheduler goes, once a command is at work.
    command = start_command(cluster, plan, out)
    assert " of 60 tasks" in command.stderr.readline()
    cluster.scheduler.kill()
    said = command.communicate(timeout=PATIENCE_S)[1]
    assert command.returncode == 2, said
    assert "the scheduler does not answer any more" in said and "Traceback" not in said
    assert done_in(out) < 60
    for one in workers:
        one.kill()
        one.wait()

    cluster.start_scheduler()
    workers = [cluster.start_worker(f"w{n}", "--no-nanny") for n in (2, 3)]
    command = start_command(cluster, plan, out)
    said = command.communicate(timeout=PATIENCE_S)[1]
    assert command.returncode == 0, said
    run_campaign(load_campaign(plan), tmp_path / "alone")
    assert results(out) == results(tmp_path / "alone")
