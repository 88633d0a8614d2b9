"""Campaigns in this process and on processes of this machine."""

import csv
import hashlib
import json
import os
import signal
import subprocess
import sys
from concurrent.futures import Executor, Future
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from itertools import accumulate, count, islice
from pathlib import Path
from random import Random

import pytest

from haptix.base.errors import HaptixError, InputError
from haptix.base.results import ResultStore, folder_of
from haptix.tasks.campaign import load_campaign, run_campaign
from haptix.tasks.campaign.processes import Processes
from haptix.tasks.campaign.run import estimate, report_html
from haptix.tasks.campaign.task_worker import as_seen_here, do
from tests.tasks.campaign.countable import Countable, Square
from tests.waiting import PATIENCE_S, wait_for

KIND = "tests.tasks.campaign.countable:Countable"


def plan(**fields):
    return Countable(name="squares", kind=KIND, **fields)


@pytest.fixture(autouse=True)
def pages(monkeypatch, request):
    """Reports without pictures, which take half a second each; tests of pictures ask for them."""
    if "pictures" not in request.fixturenames:
        monkeypatch.setattr("haptix.tasks.campaign.run.report_html", lambda campaign, tasks: "page")


@pytest.fixture
def pictures():
    """Reports with pictures."""


def finished(folder):
    """Keys of the tasks whose results are whole."""
    store = ResultStore(folder)
    return {key for key in store.kept() if store.check(key)[0] is not None}


def results(folder):
    """Hashes of everything under results/, by path."""
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.glob("results/**/*"))
        if path.is_file()
    }


def test_each_task_leaves_its_result_and_a_row(tmp_path, pictures):
    seen = []
    done = run_campaign(plan(numbers=4, file_bytes=10), tmp_path, on_progress=seen.append)
    assert [(row["label"], row["square"], row["status"]) for row in done.rows] == [
        (f"n{n}", n * n, "done") for n in range(4)
    ]
    assert done.counts["done"] == 4 and done.reused == 0
    assert len(seen) == 4 and seen[0].seconds_left is None and seen[-1].seconds_left == 0
    with (tmp_path / "table.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["square"] for row in rows] == ["0", "1", "4", "9"]
    for row in rows:
        folder = tmp_path / "results" / row["key"][:2] / row["key"]
        result = json.loads((folder / "result.json").read_text())
        data = (folder / "numbers.bin").read_bytes()
        assert result["files"]["numbers.bin"]["sha256"] == hashlib.sha256(data).hexdigest()
        assert result["row"] == {"number": int(row["number"]), "square": int(row["square"])}
        assert float(row["seconds"]) >= 0 and row["worker"].endswith(str(os.getpid()))
    page = (tmp_path / "report.html").read_text()
    assert page.count("<img") == 1 and "squares" in page


def test_what_is_finished_is_not_done_again_and_a_longer_plan_goes_on(tmp_path):
    run_campaign(plan(numbers=3), tmp_path)
    before = {path: path.stat().st_mtime_ns for path in tmp_path.glob("results/*/*/*")}
    done = run_campaign(plan(numbers=5), tmp_path)
    assert done.reused == 3 and done.counts["done"] == 5
    assert all(path.stat().st_mtime_ns == at for path, at in before.items())


def emptied(path, random):
    path.write_bytes(b"")


def one_bit(path, random):
    data = bytearray(path.read_bytes())
    data[random.randrange(len(data))] ^= 1 << random.randrange(8)
    path.write_bytes(data)


def swapped(path, random):
    """Take the place of the same file of another result, and that one's its own."""
    others = sorted(set(path.parents[2].glob(f"*/*/{path.name}")) - {path})
    other = random.choice(others)
    mine, its = path.read_bytes(), other.read_bytes()
    path.write_bytes(its)
    other.write_bytes(mine)
    return other


def removed(path, random):
    path.unlink()


@pytest.mark.parametrize("where", ["result.json", "numbers.bin", "both"])
def test_twenty_results_damaged_at_random_are_named_and_made_again(tmp_path, where):
    random = Random(23)
    given = plan(numbers=60, file_bytes=50)
    run_campaign(given, tmp_path)
    whole, hurt = results(tmp_path), set()
    names = ["result.json", "numbers.bin"] if where == "both" else [where]
    folders = sorted(path.parent for path in tmp_path.glob("results/*/*/result.json"))
    for number, folder in enumerate(random.sample(folders, 20)):
        path = folder / random.choice(names)
        other = (emptied, one_bit, swapped, removed)[number % 4](path, random)
        hurt |= {str(one.parent.relative_to(tmp_path)) for one in (path, other) if one}
    # A swap may take what was hurt before, and leave it as it was: compare the bytes.
    now = results(tmp_path)
    hurt = {folder for folder in hurt if any(
        now.get(f"{folder}/{name}") != whole[f"{folder}/{name}"]
        for name in ("result.json", "numbers.bin")
    )}  # fmt: skip
    assert len(hurt) >= 20
    done = run_campaign(given, tmp_path)
    assert set(done.damaged) == hurt
    assert done.reused == 60 - len(hurt) and done.counts["done"] == 60
    assert results(tmp_path) == whole
    again = run_campaign(given, tmp_path)
    assert again.reused == 60 and not again.damaged


@pytest.mark.parametrize(
    ("harm", "file", "why"),
    [
        (emptied, "numbers.bin", "numbers.bin is empty"),
        (one_bit, "numbers.bin", "numbers.bin was changed since it was written"),
        (removed, "numbers.bin", "numbers.bin is missing"),
        (emptied, "result.json", "result.json is empty"),
        (one_bit, "result.json", "result.json was changed since it was written"),
        (swapped, "result.json", "result.json was changed since it was written"),
        (removed, "result.json", "is gone"),
    ],
)
def test_what_is_damaged_is_named(tmp_path, harm, file, why):
    run_campaign(plan(numbers=3, file_bytes=9), tmp_path)
    victim = sorted(tmp_path.glob(f"results/*/*/{file}"))[0]
    harm(victim, Random(5))
    done = run_campaign(plan(numbers=3, file_bytes=9), tmp_path)
    assert done.damaged[str(victim.parent.relative_to(tmp_path))] == why


@pytest.mark.slow  # two processes with torch
def test_the_command_says_what_it_made_again(tmp_path, haptix_cli):
    (tmp_path / "plan.toml").write_text(f'name = "squares"\nkind = "{KIND}"\nnumbers = 2\n')
    out = tmp_path / "out"
    run_campaign(load_campaign(tmp_path / "plan.toml"), out)
    victim = sorted(out.glob("results/*/*/result.json"))[0]
    emptied(victim, None)
    said = haptix_cli("campaign", tmp_path / "plan.toml", "--out", out, "--processes", "1")
    assert said.code == 0
    place = f"{out}/{victim.parent.relative_to(out)}"
    assert f"{place}: result.json is empty; its task was done again" in said.err


def test_every_byte_of_a_manifest_counts(tmp_path):
    store = ResultStore(tmp_path)
    store.publish("ab" * 32, {"a.txt": "text"}, {"row": {"x": 1.5}})
    file = tmp_path / folder_of("ab" * 32) / "result.json"
    data = file.read_bytes()
    for place in range(len(data)):
        hurt = bytearray(data)
        hurt[place] ^= 1 << place % 8
        file.write_bytes(hurt)
        assert store.check("ab" * 32) == (None, "result.json was changed since it was written")


def test_what_fails_has_its_reason_and_is_done_again_only_when_asked(tmp_path):
    first = run_campaign(plan(numbers=3, wrong=(1,)), tmp_path)
    assert first.counts["failed"] == 1 and first.counts["done"] == 2
    assert first.rows[1]["error"] == "ValueError: no square of 1"
    assert "no square of 1" in report_html(plan(numbers=3), first)
    calls = []
    run_campaign(plan(numbers=3, wrong=(1,)), tmp_path, on_progress=calls.append)
    assert calls == []
    run_campaign(plan(numbers=3, wrong=(1,)), tmp_path, on_progress=calls.append, again=True)
    assert len(calls) == 1


def test_what_is_foretold_is_what_it_costs(tmp_path):
    given = plan(numbers=12, seconds=0.02, file_bytes=1000)
    [told] = estimate(given, tmp_path)[1]
    assert (told["tasks"], told["done"], told["at_once"]) == (12, 2, 1)
    done = run_campaign(given, tmp_path)
    left = done.rows[2:]
    assert told["bytes_left"] == pytest.approx(sum(row["bytes"] for row in left), rel=0.01)
    # Each sleeps for its time, and may take longer where the machine is busy.
    assert told["hours_left"] * 3600 >= 10 * 0.02
    assert estimate(given, tmp_path)[1][0]["hours_left"] == 0
    with pytest.raises(HaptixError, match="ValueError: no square of 0"):
        estimate(plan(numbers=2, wrong=(0, 1)), tmp_path / "wrong")


class Killed(BaseException):
    """As the death of the process: nothing after it is done."""


def test_a_task_that_never_ends_is_set_aside_after_three_times(tmp_path, monkeypatch):
    real = Square.run

    def run(task, context):
        if task.number == 1:
            raise Killed
        return real(task, context)

    monkeypatch.setattr(Square, "run", run)
    for _ in range(3):
        with pytest.raises(Killed):
            run_campaign(plan(numbers=3), tmp_path)
    done = run_campaign(plan(numbers=3), tmp_path)
    assert [row["status"] for row in done.rows] == ["done", "set aside", "done"]
    assert "its worker died 3 times" in done.rows[1]["error"]
    monkeypatch.setattr(Square, "run", real)
    assert run_campaign(plan(numbers=3), tmp_path).counts["set aside"] == 1
    assert run_campaign(plan(numbers=3), tmp_path, again=True).counts["done"] == 3


def test_processes_leave_the_same_bytes_as_this_one(tmp_path):
    with Processes(1) as pool:
        there = run_campaign(plan(numbers=4, wrong=(1,), file_bytes=7), tmp_path / "a", pool)
    here = run_campaign(plan(numbers=4, wrong=(1,), file_bytes=7), tmp_path / "b")
    assert there.counts == here.counts
    assert len({row["worker"] for row in there.rows} | {here.rows[0]["worker"]}) == 2
    assert results(tmp_path / "a") == results(tmp_path / "b")


@pytest.mark.slow
def test_a_deadly_task_is_set_aside_and_the_others_are_done_the_same(tmp_path):
    with Processes(2) as pool:
        hurt = run_campaign(plan(numbers=6, deadly=(2,), file_bytes=9), tmp_path / "hurt", pool)
    assert hurt.counts["done"] == 5 and hurt.counts["set aside"] == 1
    assert "its worker died 3 times" in hurt.rows[2]["error"]
    assert len(set(hurt.rows[2]["error"].split(": ", 1)[1].split(", "))) == 3  # three workers
    # In this process and in order: the same bytes.
    alone = run_campaign(plan(numbers=6, wrong=(2,), file_bytes=9), tmp_path / "alone")
    assert alone.counts["done"] == 5
    assert results(tmp_path / "alone") == results(tmp_path / "hurt")


@pytest.mark.slow
def test_a_worker_that_dies_while_it_writes_leaves_no_half_of_a_result(tmp_path):
    marker = tmp_path / "died"
    given = plan(numbers=3, file_bytes=100_000, dies_writing=str(marker))
    with Processes(1) as pool:
        hurt = run_campaign(given, tmp_path / "hurt", pool)
    assert marker.exists() and hurt.counts["done"] == 3
    assert sorted(row["deaths"] for row in hurt.rows) == [0, 0, 1]
    run_campaign(given, tmp_path / "whole")  # nobody dies again
    assert results(tmp_path / "hurt") == results(tmp_path / "whole")


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="the limit is Linux's")
def test_a_task_that_needs_more_memory_than_it_may_fails_alone(tmp_path):
    with Processes(1, memory_bytes=500_000_000) as pool:
        done = run_campaign(plan(numbers=3, greedy=(1,)), tmp_path, pool)
    assert [row["status"] for row in done.rows] == ["done", "failed", "done"]
    assert "MemoryError" in done.rows[1]["error"]


def test_a_place_of_fsspec_has_the_same_bytes_as_a_folder(tmp_path):
    memory = pytest.importorskip("fsspec").filesystem("memory")
    first = run_campaign(plan(numbers=2, file_bytes=9), "memory://squares/a")
    done = run_campaign(plan(numbers=3, file_bytes=9), "memory://squares/a")
    assert first.counts["done"] == 2 and done.reused == 2 and done.counts["done"] == 3
    run_campaign(plan(numbers=3, file_bytes=9), tmp_path)
    for name in results(tmp_path):
        assert memory.cat_file(f"/squares/a/{name}") == (tmp_path / name).read_bytes()
    assert memory.cat_file("/squares/a/table.csv").startswith(b"label,number,square")
    # A store without whole writes has no draft left, and another one is refused by name.
    run_campaign(plan(numbers=3, file_bytes=9), f"file://{tmp_path / 'b'}")
    assert results(tmp_path / "b") == results(tmp_path)
    with pytest.raises(InputError, match=r"nowhere://x.*fsspec"):
        run_campaign(plan(numbers=1), "nowhere://x")


@pytest.mark.parametrize("renames", [True, False])
def test_a_place_of_fsspec_that_breaks_half_way_never_has_a_half_result(
    tmp_path, renames, monkeypatch
):
    monkeypatch.setattr("haptix.base.results.WRITES_WHOLE", {"whole"})
    fsspec = pytest.importorskip("fsspec")
    from fsspec.implementations.memory import MemoryFileSystem

    calls, gap = count(1), count(4)
    breaks = list(accumulate(islice(gap, 12)))  # further and further apart

    class Breaking(MemoryFileSystem):  # type: ignore[misc]  # it has no types
        """Writes whole objects, as S3 does, or leaves half of a file where it breaks."""

        protocol = "breaking" if renames else "whole"
        store, pseudo_dirs = {}, [""]

        @classmethod
        def _strip_protocol(cls, path):
            return super()._strip_protocol(path.removeprefix(f"{cls.protocol}:/"))

        def pipe_file(self, path, value, **options):
            if next(calls) in breaks:
                if renames:
                    super().pipe_file(path, value[: len(value) // 2])
                raise OSError(5, "the network is gone")
            super().pipe_file(path, value)

    fsspec.register_implementation(Breaking.protocol, Breaking, clobber=True)
    given, where = plan(numbers=5, file_bytes=60), f"{Breaking.protocol}://squares"
    run_campaign(given, tmp_path)
    whole, system, stops = results(tmp_path), Breaking(), 0
    for _ in breaks:
        try:
            run_campaign(given, where)
        except InputError:
            stops += 1
        there = {
            name.partition("squares/")[2]: hashlib.sha256(system.cat_file(name)).hexdigest()
            for name in system.find("/squares/results")
            if not name.endswith(".part")
        }
        assert there.items() <= whole.items()
    assert there == whole and stops > 4


def test_another_version_does_not_mix_its_results(tmp_path, monkeypatch):
    run_campaign(plan(numbers=1), tmp_path)
    monkeypatch.setattr("haptix.tasks.campaign.task_worker.code_digest", lambda *folders: "other")
    with pytest.raises(InputError, match=r"code .*--out"):
        run_campaign(plan(numbers=2), tmp_path)


def test_two_at_once_are_refused(tmp_path):
    class Second(Exception):
        pass

    def meanwhile(seen):
        with pytest.raises(InputError, match="another campaign"):
            run_campaign(plan(numbers=1), tmp_path)
        raise Second

    with pytest.raises(Second):
        run_campaign(plan(numbers=1), tmp_path, on_progress=meanwhile)


@contextmanager
def small_disk(folder, size_bytes):
    """A disk of some size, which grows when the body calls what it gets.

    Without root, which may mount one, a file system that refuses the larger of the files.
    """
    if os.geteuid() == 0 and sys.platform == "linux":
        folder.mkdir()
        subprocess.run(
            ["mount", "-t", "tmpfs", "-o", f"size={size_bytes}", "tmpfs", folder], check=True
        )
        try:
            yield lambda: subprocess.run(
                ["mount", "-o", f"remount,size={20 * size_bytes}", folder], check=True
            )
        finally:
            subprocess.run(["umount", "--lazy", folder], check=True)
        return
    resource = pytest.importorskip("resource")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (50_000, before[1]))
    try:
        yield lambda: resource.setrlimit(resource.RLIMIT_FSIZE, before)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def test_a_full_disk_stops_it_and_the_same_call_goes_on(tmp_path):
    given = plan(numbers=8, file_bytes=60_000)
    with small_disk(tmp_path / "disk", 400_000) as grow:
        with pytest.raises(InputError, match="cannot write"):
            run_campaign(given, tmp_path / "disk" / "out")
        left = results(tmp_path / "disk" / "out")
        grow()
        done = run_campaign(given, tmp_path / "disk" / "out")
        found = results(tmp_path / "disk" / "out")
    assert done.counts["done"] == 8 and done.reused == len(left) // 2
    run_campaign(given, tmp_path / "whole")
    assert found == results(tmp_path / "whole")
    assert left.items() <= found.items()  # nothing half-written had a name
    assert not any(row["deaths"] for row in done.rows)


def test_two_workers_that_do_the_same_task_at_once_leave_it_once(tmp_path):
    """As where a client was killed and its worker goes on beside the next one's."""
    store = ResultStore(tmp_path)
    late = []

    def write(path):
        path.write_bytes(b"same")
        if not late:  # the other one comes while this one writes
            late.append(0)
            late.append(store.publish("abcd", {"a.bin": write}, {"row": {}}))

    assert store.publish("abcd", {"a.bin": write}, {"row": {}}) == late[1]
    names = sorted(str(one.relative_to(tmp_path)) for one in tmp_path.rglob("*.*"))
    assert names == ["results/ab/abcd/a.bin", "results/ab/abcd/result.json"]


def test_what_a_killed_worker_left_is_no_result_and_goes(tmp_path):
    run_campaign(plan(numbers=1, file_bytes=5), tmp_path)
    [key] = finished(tmp_path)
    manifest = tmp_path / "results" / key[:2] / key / "result.json"
    draft = manifest.rename(manifest.with_name(".result.json.0123.part"))
    assert finished(tmp_path) == set()
    assert run_campaign(plan(numbers=1, file_bytes=5), tmp_path).reused == 0
    assert not draft.exists() and finished(tmp_path) == {key}


def start(folder, *options):
    """The command, in a process group of its own."""
    return subprocess.Popen(
        [sys.executable, "-m", "haptix.tasks.cli", "campaign", str(folder / "plan.toml"),
         "--out", str(folder / "out"), *options],
        start_new_session=True, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("kill", [signal.SIGKILL, signal.SIGINT])
def test_a_client_that_is_stopped_leaves_no_process_and_goes_on(tmp_path, kill):
    gate, out = tmp_path / "gate", tmp_path / "out"
    (tmp_path / "plan.toml").write_text(
        f'name = "squares"\nkind = "{KIND}"\nnumbers = 5\nfile_bytes = 5\n'
        f'held = [2]\nwaits_for = "{gate}"\n'
    )
    command = start(tmp_path, "--processes", "1")
    # One after the other: two have ended, and the third is held.
    wait_for(lambda: len(finished(out)) == 2)
    wait_for(lambda: any("begun" in p.read_text() for p in out.glob("runs/*/*.json")))
    command.send_signal(kill)
    said = command.communicate(timeout=PATIENCE_S)[1]  # to the end of all who hold its stderr
    if kill == signal.SIGINT:
        assert command.returncode == 130 and "the same command goes on" in said
    # The worker has said that it was stopped.
    assert not any("begun" in p.read_text() for p in out.glob("runs/*/*.json"))
    gate.touch()
    done = run_campaign(load_campaign(tmp_path / "plan.toml"), out)
    assert done.reused == 2 and done.counts["done"] == 5
    assert not any(row["deaths"] for row in done.rows)
    run_campaign(load_campaign(tmp_path / "plan.toml"), tmp_path / "whole")
    assert results(out) == results(tmp_path / "whole")


@pytest.mark.slow
def test_an_executor_that_lost_its_workers_is_one_sentence(tmp_path):
    from concurrent.futures import ProcessPoolExecutor
    from multiprocessing import get_context

    with (
        ProcessPoolExecutor(1, get_context("spawn")) as pool,
        pytest.raises(HaptixError, match="lost its workers"),
    ):
        run_campaign(plan(numbers=2, deadly=(0,)), tmp_path, pool)


class Calling(Executor):
    """Does calls here, and hands each to `hears`, which may lose the answer or change it."""

    at_once = 1

    def __init__(self, hears):
        self.hears = hears

    def submit(self, work, /, *given, **named):
        future, answer = Future(), work(*given, **named)
        try:
            future.set_result(self.hears(work, answer))
        except BrokenProcessPool as error:
            future.set_exception(error)
        return future


def test_short_tasks_share_calls_and_a_lost_answer_costs_no_task_twice(tmp_path, monkeypatch):
    monkeypatch.setattr(
        "haptix.tasks.campaign.run.SHORT_CALL_S", 1e9
    )  # however slow this machine is
    calls, numbers, real = [], [], Square.run

    def run(task, context):
        numbers.append(task.number)
        return real(task, context)

    def hears(work, answer):
        if work is do:
            calls.append(len(json.loads(answer)))
            if len(calls) == 2:  # all of it is done, but nobody hears
                raise BrokenProcessPool("gone")
        return answer

    monkeypatch.setattr(Square, "run", run)
    done = run_campaign(plan(numbers=100), tmp_path, Calling(hears))
    # One alone, 64 whose answer is lost, the rest, and the lost ones one by one.
    assert calls == [1, 64, 35, *[1] * 64]
    assert sorted(numbers) == [*range(100)]
    assert [row["square"] for row in done.rows] == [n**2 for n in range(100)]
    assert not any(row["deaths"] for row in done.rows)


@pytest.mark.slow  # the next test covers the same code
def test_a_kind_that_workers_cannot_import_is_said_before_the_first_task(tmp_path):
    (tmp_path / "here").mkdir()
    (tmp_path / "here" / "kind_of_here.py").write_text(
        "from tests.tasks.campaign import countable as c\n\n\nclass Here(c.Countable):\n    pass\n"
    )
    script = (
        "import sys\n"
        "from haptix.tasks.campaign import run_campaign\n"
        "from haptix.tasks.campaign.plans import kind_named\n"
        "from haptix.tasks.campaign.processes import Processes\n"
        "if __name__ == '__main__':\n"
        f"    with Processes(1) as workers:\n"
        "        workers.submit(len, 'abc').result()  # they have started, with today's paths\n"
        f"        sys.path.append({str(tmp_path / 'here')!r})\n"
        "        plan = kind_named('kind_of_here:Here')(\n"
        "            name='a', kind='kind_of_here:Here', numbers=1)\n"
        f"        run_campaign(plan, {str(tmp_path / 'out')!r}, workers)\n"
    )
    (tmp_path / "run.py").write_text(script)
    ended = subprocess.run(
        [sys.executable, tmp_path / "run.py"], capture_output=True, text=True,
        env={**os.environ, "PYTHONPATH": str(Path.cwd())},
    )  # fmt: skip
    assert "the workers cannot do tasks of the kind 'kind_of_here:Here'" in ended.stderr
    assert "No module named 'kind_of_here'" in ended.stderr
    assert not [*(tmp_path / "out").glob("runs/*")]


def test_workers_of_another_version_are_refused_before_the_first_task(tmp_path):
    def hears(work, answer):
        return {**answer, "torch": "1.0"} if work is as_seen_here else answer

    with pytest.raises(HaptixError, match=r"torch 1\.0 \(here"):
        run_campaign(plan(numbers=2), tmp_path, Calling(hears))
    assert not [*tmp_path.glob("runs/*")]


class Stillborn(Executor):
    """Its workers end before they begin."""

    calls = 0

    def submit(self, work, /, *given, **named):
        self.calls += 1
        future = Future()
        future.set_exception(BrokenProcessPool("a worker ended"))
        return future


def test_workers_that_never_begin_end_the_campaign(tmp_path):
    workers = Stillborn()
    with pytest.raises(HaptixError, match=r"before .*a worker ended"):
        run_campaign(plan(numbers=100), tmp_path, workers)
    assert workers.calls < 20


def test_a_wrong_plan_is_one_sentence(tmp_path):
    path = tmp_path / "plan.toml"
    for text, why in (
        ('name = "a"\n', "whose kind is one of surfaces"),
        ('name = "a"\nkind = "surface"\n', "kind: expected one of surfaces"),
        ('name = "a"\nkind = "os:system"\n', "neither a Task nor a Campaign"),
        ('name = "a"\nkind = "nowhere:Any"\n', "No module named 'nowhere'"),
        ('name = "a"\nkind = "surfaces"\nscene = {}\nfinger = "wet"\n', r"finger: extra"),
        ('name = "a"\nkind = "surfaces"\nscene = {}\nfolder = "b"\n', r"folder: a file has none"),
    ):
        path.write_text(text)
        with pytest.raises(HaptixError, match=why):
            load_campaign(path)
