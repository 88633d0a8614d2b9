"""A cluster of processes that loses its scheduler, its client and its workers: nothing is lost."""

import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from haptix.tasks.campaign import load_campaign, run_campaign
from tests.tasks.campaign.test_local_campaigns import KIND, pages, results  # noqa: F401
from tests.waiting import PATIENCE_S, wait_for

distributed = pytest.importorskip("distributed")
pytestmark = pytest.mark.slow  # tests of clusters in one process cover the same code

ROOT = Path(__file__).parents[3]


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
            cwd=path or ROOT,  # which python -m looks into first
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        self.running.append(one)
        return one

    def start_scheduler(self):
        self.file.unlink(missing_ok=True)
        options = ["--host", "127.0.0.1", "--port", "0", "--no-dashboard"]
        one = self.start("dask", "scheduler", *options, "--scheduler-file", str(self.file))
        wait_for(self.file.exists)
        return one

    def start_worker(self, name, *options, path=""):
        words = ["--scheduler-file", str(self.file), "--nthreads", "1", "--no-dashboard"]
        return self.start("dask", "worker", *words, "--name", name, *options, path=path)

    def end(self):
        for one in self.running:
            one.terminate()  # a nanny ends its worker
        for one in self.running:
            try:
                one.wait(2)  # one whose scheduler was killed may seek it without end
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
    words = [
        "haptix.tasks.cli",
        "campaign",
        str(plan),
        "--on",
        str(cluster.file),
        "--out",
        str(out),
    ]
    return subprocess.Popen(
        [sys.executable, "-m", *words], stderr=subprocess.PIPE, text=True,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )  # fmt: skip


def done_in(out):
    return len([*out.glob("results/*/*/result.json")])


def is_begun(out):
    """Whether a worker is at a task."""
    return any('"begun"' in path.read_text() for path in out.glob("runs/*/*.json"))


def test_a_killed_scheduler_and_client_lose_nothing(cluster, tmp_path):
    gate, out = tmp_path / "gate", tmp_path / "out"
    plan = plan_of(tmp_path, numbers=12, file_bytes=3000, waits_for=f'"{gate}"')
    workers = [cluster.start_worker(f"w{n}", "--no-nanny") for n in range(2)]

    # The client goes in the middle of a write; its workers end what they do.
    command = start_command(cluster, plan, out)
    wait_for(lambda: is_begun(out))
    command.kill()
    command.communicate()
    gate.touch()
    with distributed.Client(scheduler_file=str(cluster.file)) as client:
        wait_for(lambda: not any(client.processing().values()))
    wait_for(lambda: not is_begun(out))
    assert 1 <= done_in(out) < 12
    gate.unlink()

    # The scheduler goes, in the middle of another's.
    command = start_command(cluster, plan, out)
    wait_for(lambda: is_begun(out))
    cluster.scheduler.kill()
    said = command.communicate(timeout=PATIENCE_S)[1]
    assert command.returncode == 2, said
    assert "the scheduler does not answer any more" in said and "Traceback" not in said
    for one in workers:
        one.kill()
        one.wait()

    gate.touch()
    cluster.start_scheduler()
    workers = [cluster.start_worker(f"w{n}", "--no-nanny") for n in (2, 3)]
    command = start_command(cluster, plan, out)
    said = command.communicate(timeout=PATIENCE_S)[1]
    assert command.returncode == 0, said
    run_campaign(load_campaign(plan), tmp_path / "alone")
    assert results(out) == results(tmp_path / "alone")


def test_another_version_is_refused_by_name_and_a_deadly_task_is_set_aside(cluster, tmp_path):
    other = tmp_path / "other"
    for package in ("haptix", "firmware_io", "calibration"):
        shutil.copytree(ROOT / package, other / package, ignore=shutil.ignore_patterns("*.pyc"))
    with (other / "haptix" / "base" / "units.py").open("a") as file:
        file.write("\n# another version\n")
    cluster.start_worker("changed", "--no-nanny", path=str(other))
    with distributed.Client(scheduler_file=str(cluster.file)) as client:
        client.wait_for_workers(1, timeout=PATIENCE_S)
    plan = plan_of(tmp_path, numbers=8, seconds=0.01, file_bytes=9, deadly="[3]")
    out = tmp_path / "out"
    command = start_command(cluster, plan, out)
    said = command.communicate(timeout=PATIENCE_S)[1]
    assert command.returncode == 2
    assert "none that may be used (changed: code " in said

    cluster.start_worker("good", "--nanny")  # which starts it again
    with distributed.Client(scheduler_file=str(cluster.file)) as client:
        client.wait_for_workers(2, timeout=PATIENCE_S)
    command = start_command(cluster, plan, out)
    said = command.communicate(timeout=PATIENCE_S)[1]
    assert "worker changed (tcp://127" in said and "is not used: code" in said
    assert command.returncode == 1  # one task has no result
    rows = run_campaign(load_campaign(plan), out).rows
    assert [row["status"] for row in rows] == ["done"] * 3 + ["set aside"] + ["done"] * 4
    assert rows[3]["deaths"] == 3 and "its worker died 3 times" in rows[3]["error"]


def test_ctrl_c_leaves_what_is_finished(cluster, tmp_path):
    plan = plan_of(tmp_path, numbers=300, seconds=0.3)
    out = tmp_path / "out"
    cluster.start_worker("w", "--no-nanny")
    command = start_command(cluster, plan, out)
    wait_for(lambda: done_in(out) >= 2)
    command.send_signal(signal.SIGINT)
    said = command.communicate(timeout=PATIENCE_S)[1]
    assert command.returncode == 130 and "the same command goes on" in said
    assert 2 <= done_in(out) < 300
    assert (out / "table.csv").exists()
