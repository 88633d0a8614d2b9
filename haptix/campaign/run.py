"""Run a campaign: what is missing is done, what is finished is left alone.

A place has ``campaign.json`` (plan and versions), ``results/`` (see `haptix.results`), ``runs/``
(the costs, deaths and errors of each task), ``table.csv`` and ``report.html``.
"""

from __future__ import annotations

import json
import logging
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import BrokenExecutor, CancelledError, Executor
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from itertools import islice
from pathlib import Path
from typing import Any, Self

from haptix.campaign.kinds import Campaign, Value
from haptix.campaign.report import report_html
from haptix.campaign.worker import as_seen_here, differences, do, identity, record_of
from haptix.errors import HaptixError, InputError
from haptix.executors import Here, executor_of, finished
from haptix.files import csv_text
from haptix.results import ResultStore, folder_of
from haptix.version import __version__

_LOG = logging.getLogger("haptix.campaign")

PILOTS = 2
"""Tasks that an `estimate` does where none was measured yet; their results are kept."""

_MOST_LOST = 6  # workers in a row that may end before they begin a task
_SHORT_CALL_S, _LARGEST_CALL = 0.2, 64  # of tasks that are done by one call
_LAST = ("status", "seconds", "cpu_seconds", "peak_bytes", "bytes", "worker", "deaths", "error")


@dataclass
class CampaignResult:
    """A campaign that was run, or how far it is."""

    where: str
    """Folder or URL."""
    by_key: dict[str, dict[str, Value]] = field(default_factory=dict)
    """What is known of each task, in the order of the plan."""
    counts: Counter[str] = field(default_factory=Counter)
    """Tasks by status; what has not ended is "waiting"."""
    damaged: dict[str, str] = field(default_factory=dict)
    """What was wrong with results of an earlier run, by their folders; they are made again."""
    reused: int = 0
    """Tasks that an earlier run had finished."""
    seconds_left: float | None = None
    """From the ends so far; None before the second task has ended."""

    @classmethod
    def of(cls, store: ResultStore, campaign: Campaign, again: bool = False) -> Self:
        """Read, every byte, what a place has of a campaign.

        With `again`, forget what failed or was set aside.
        """
        tasks, there = cls(store.where), store.kept()
        for task in campaign.tasks():
            key = task.key
            if key in tasks.by_key:
                continue
            tasks.by_key[key] = {**task.labels, "status": "waiting"}
            tasks.counts["waiting"] += 1
            record = store.read_table(record_of(key)) or {}
            result, why = store.check(key) if key in there else (None, "")
            if result is not None:
                record = {**record, "status": "done", "error": "", "row": result["row"]}
                tasks.enter(key, record)
            elif why or record.get("status") == "done":
                tasks.damaged[folder_of(key)] = why or "is gone"
            elif record.get("status") in ("failed", "set aside"):
                if again:
                    store.write_table(record_of(key), {"status": "stopped"})
                else:
                    tasks.enter(key, record)
        return tasks

    def enter(self, key: str, record: Mapping[str, Any]) -> None:
        """Keep how a task ended."""
        _LOG.info("task %s: %s", key, record["status"])
        row = self.by_key[key]
        self.counts[str(row["status"])] -= 1
        self.counts[record["status"]] += 1
        for name, value in {**record.get("row", {}), **record}.items():
            if name != "row":
                row[name] = len(value) if isinstance(value, list) else value

    @property
    def total(self) -> int:
        """Tasks in all."""
        return len(self.by_key)

    @property
    def rows(self) -> tuple[dict[str, Any], ...]:
        """The table, with the same columns in each row: labels, numbers, status, costs and key."""
        names = dict.fromkeys(name for row in self.by_key.values() for name in row)
        columns = [*(name for name in names if name not in _LAST), *_LAST]
        return tuple(
            {**{name: row.get(name) for name in columns}, "key": key}
            for key, row in self.by_key.items()
        )


def run_campaign(
    campaign: Campaign,
    where: str | Path,
    executor: Any = None,
    on_progress: Callable[[CampaignResult], None] = lambda so_far: None,
    again: bool = False,
    most: int | None = None,
) -> CampaignResult:
    """Do the tasks of a campaign that are not done yet, or whose results are damaged.

    Parameters
    ----------
    campaign : Campaign
        The plan.
    where : str or Path
        Folder, or a URL of fsspec such as ``s3://bucket/campaign``.
    executor : concurrent.futures.Executor or Dask client, optional
        Where tasks are done; without it in this process, one after the other. Its workers must
        have this haptix and the campaign's kind, and reach `where`.
    on_progress : callable
        Called after each task with how far it is.
    again : bool
        Also do those again that failed or were set aside.
    most : int, optional
        End after so many tasks, as a measurement of costs does.

    Raises
    ------
    InputError
        If `where` belongs to another version, is in use, or cannot be written: a full disk. The
        same call goes on from there.
    HaptixError
        If the executor's workers are lost, have another version or cannot import the kind.
    """
    store = ResultStore(where)
    with store.held():
        _begin(store, campaign, identity(campaign.kind))
        tasks = CampaignResult.of(store, campaign, again)
        tasks.reused = tasks.counts["done"]
        with _workers(executor, store, campaign.kind) as workers:
            first = 0.0
            try:
                for ended, _ in enumerate(_ends(store, campaign, tasks, workers, most)):
                    now = time.monotonic()
                    first = first or now
                    # A worker may take long to start: its time counts from the first end on.
                    left = tasks.counts["waiting"] * (now - first) / ended if ended else None
                    on_progress(replace(tasks, seconds_left=left))
            except BrokenExecutor as error:
                raise HaptixError(
                    f"the executor has lost its workers ({error}); finished tasks are kept, and "
                    "the same call with a new one goes on"
                ) from None
            finally:
                _conclude(store, campaign, tasks)
    return tasks


@contextmanager
def _writing(store: ResultStore) -> Iterator[None]:
    """Say in one sentence that a place cannot be written to."""
    try:
        yield
    except OSError as error:
        raise InputError(f"cannot write to {store.where}: {error.strerror or error}") from None


def _begin(store: ResultStore, campaign: Campaign, versions: dict[str, str]) -> None:
    """Write what this campaign is, or check that it is of this version."""
    known = store.read_table("campaign.json")
    if other := differences((known or {}).get("identity", versions), versions):
        raise InputError(
            f"{store.where}: expected a campaign of this haptix, got one begun with "
            f"{', '.join(other)}; name another --out, since its results may differ"
        )
    plan = campaign.model_dump(mode="json", exclude_none=True)
    with _writing(store):
        store.write_table(
            "campaign.json", {"haptix": __version__, "identity": versions, "plan": plan}
        )


@contextmanager
def _workers(executor: Any, store: ResultStore, kind: str) -> Iterator[Executor]:
    """Give what tasks are done on, its workers checked before the first task."""
    client = executor if hasattr(executor, "get_executor") else None  # of Dask
    if client is not None:
        from haptix.campaign.cluster import DaskWorkers

        executor = DaskWorkers(client)
    try:
        workers = executor_of(executor)
        if hasattr(executor, "expect"):
            executor.expect(store.where, kind)
        elif not isinstance(workers, Here):
            _check(workers, store.where, kind)
        yield workers
    finally:
        if client is not None:
            executor.shutdown()


def _check(workers: Executor, where: str, kind: str) -> None:
    """Raise `HaptixError` unless a worker has this haptix and the kind, and reaches the place."""
    for _ in range(_MOST_LOST):
        try:
            seen = workers.submit(as_seen_here, where, kind).result()
        except (BrokenExecutor, CancelledError) as error:
            why = error
            continue
        if other := differences(seen, as_seen_here(where, kind)):
            raise HaptixError(
                f"the workers cannot do tasks of the kind {kind!r}: {', '.join(other)}; install "
                "on them what is installed here, or set PYTHONPATH for them"
            )
        return
    raise _never_begin(why)


def _never_begin(why: BaseException) -> HaptixError:
    return HaptixError(
        f"workers end before they begin a task, the last with: {why}; a script that starts "
        'processes needs `if __name__ == "__main__":`'
    )


def _call_of(store: ResultStore, *jobs: Mapping[str, Any]) -> str:
    return json.dumps({"where": store.where, "tasks": jobs})


def _ends(
    store: ResultStore,
    campaign: Campaign,
    tasks: CampaignResult,
    workers: Executor,
    most: int | None,
) -> Iterator[None]:
    """Do tasks, and enter each as it ends."""
    waiting = {key for key, row in tasks.by_key.items() if row["status"] == "waiting"}
    seconds: float | None = None  # of a task, lately
    lost = 0

    def calls() -> Iterator[str]:
        new = islice((task for task in campaign.tasks() if task.key in waiting), most)
        for task in new:
            # Calls of short tasks would cost more than the tasks.
            size = 1 if seconds is None else int(_SHORT_CALL_S / max(seconds, 1e-6))
            more = max(1, min(size, _LARGEST_CALL)) - 1
            call = {task.key: task for task in (task, *islice(new, more))}
            waiting.difference_update(call)
            jobs = ({"key": k, "kind": t.kind, "document": t.document} for k, t in call.items())
            yield _call_of(store, *jobs)

    texts: Iterable[str] = calls()
    while True:
        again: list[str] = []
        for text, future in finished(workers, do, texts):
            jobs = json.loads(text)["tasks"]
            try:
                records = json.loads(future.result())
            except (BrokenExecutor, CancelledError) as error:
                # A task that began counts its workers' deaths itself; where none began, the
                # workers are what is wrong. Any may have cost the worker: each goes alone.
                again += [_call_of(store, job) for job in jobs]
                kept = [store.read_table(record_of(job["key"])) or {} for job in jobs]
                began = any(record.get("status") in ("begun", "done", "failed") for record in kept)
                lost = 0 if began else lost + 1
                if lost > _MOST_LOST:
                    raise _never_begin(error) from None
                for job in jobs:
                    why = f"its worker is lost, it is done again: {error}"
                    _LOG.info("task %s: %s", job["key"], why)
                continue
            lost = 0
            for job, record in zip(jobs, records, strict=True):
                if record["status"] == "not written":
                    raise InputError(
                        f"cannot write to {store.where}: {record['error']}; finished tasks are "
                        "kept, and the same command goes on"
                    )
                took = record.get("seconds", seconds)
                seconds = took if seconds is None else 0.8 * seconds + 0.2 * took
                tasks.enter(job["key"], record)
                yield
        if not again:
            return
        texts = again


def _conclude(store: ResultStore, campaign: Campaign, tasks: CampaignResult) -> None:
    """Write the table and the report."""
    table = tasks.rows
    names = table[0] if table else ("status",)
    with _writing(store):
        store.write("table.csv", csv_text(names, (row.values() for row in table)).encode())
        store.write("report.html", report_html(campaign, table).encode())


def estimate(
    campaign: Campaign, where: str | Path, executor: Any = None
) -> tuple[str, list[dict[str, Any]]]:
    """Return a sentence and a row about tasks, hours and bytes, from the tasks done so far.

    Where there are none, the first `PILOTS` are done.

    Raises
    ------
    HaptixError
        If none of these has a result; the message has the reason of the first.
    """
    tasks = CampaignResult.of(ResultStore(where), campaign)
    if not tasks.counts["done"]:
        run_campaign(campaign, where, executor, most=PILOTS)
        tasks = CampaignResult.of(ResultStore(where), campaign)
    table = tasks.rows
    done = [row for row in table if row["status"] == "done" and row["seconds"] is not None]
    if not done:
        reason = next((row["error"] for row in table if row["error"]), "there are none")
        raise HaptixError(f"{campaign.name}: no task could be measured: {reason}")
    waiting = tasks.counts["waiting"]
    seconds, cpu_seconds, size = (
        sum(float(row[name] or 0) for row in done) / len(done)
        for name in ("seconds", "cpu_seconds", "bytes")
    )
    at_once = getattr(executor, "workers", 1)
    row = {
        "tasks": len(table),
        "done": tasks.counts["done"],
        "seconds_each": seconds,
        "hours_left": waiting * seconds / at_once / 3600,
        "cpu_hours_left": waiting * cpu_seconds / 3600,  # whatever else the machine did
        "at_once": at_once,
        "bytes_left": round(waiting * size),
        "bytes_in_all": round(len(table) * size),
    }
    return f"{campaign.name}: from the costs of {len(done)} tasks, kept in {where}", [row]
