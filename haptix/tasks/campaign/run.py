"""Run a campaign: do the tasks that have no result yet, and keep the results of the others.

A place has ``campaign.json`` (plan and versions), ``results/`` (see `haptix.base.results`),
``runs/`` (the costs, deaths and errors of each task), ``table.csv`` and ``report.html``.
"""

from __future__ import annotations

import json
import logging
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import BrokenExecutor, CancelledError, Executor
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from itertools import islice
from math import ceil
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from haptix.base.errors import HaptixError, InputError, MissingExtraError, from_extra
from haptix.base.executors import Here, executor_of, finished
from haptix.base.files import csv_text, json_text
from haptix.base.report import page, paragraph, picture, table
from haptix.base.results import ResultStore, folder_of
from haptix.base.version import __version__
from haptix.tasks.campaign.plans import Campaign, Value
from haptix.tasks.campaign.task_worker import as_seen_here, differences, do, identity, record_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_LOG = logging.getLogger("haptix.tasks.campaign")

PILOTS = 2
"""Tasks that an `estimate` does if none was measured yet; their results are kept."""

_MOST_LOST = 6  # workers in a row that may end before they begin a task
SHORT_CALL_S, _LARGEST_CALL = 0.2, 64  # duration and number of tasks of one call
_MOST_FAILURES = 50  # failures that the report lists
_PANELS = 12  # panels of one picture
_LAST = ("status", "seconds", "cpu_seconds", "peak_bytes", "bytes", "worker", "deaths", "error")


@dataclass
class CampaignResult:
    """A campaign that was run, or how far it is."""

    where: str
    """Folder or URL."""
    by_key: dict[str, dict[str, Value]] = field(default_factory=dict)
    """Record of each task, by its key, in the order of the plan."""
    counts: Counter[str] = field(default_factory=Counter)
    """Number of tasks by status; tasks that have not ended are "waiting"."""
    damaged: dict[str, str] = field(default_factory=dict)
    """Faults of results of an earlier run, by folder; these results are made again."""
    reused: int = 0
    """Tasks that an earlier run had finished."""
    seconds_left: float | None = None
    """Estimate from the tasks that have ended; None before the second one."""

    @classmethod
    def of(cls, store: ResultStore, campaign: Campaign, again: bool = False) -> Self:
        """Read every byte that a place has of a campaign.

        With `again`, forget tasks that failed or were set aside.
        """
        tasks, kept = cls(store.where), store.kept()
        for task in campaign.tasks():
            key = task.key
            if key in tasks.by_key:
                continue
            tasks.by_key[key] = {**task.labels, "status": "waiting"}
            tasks.counts["waiting"] += 1
            record = store.read_table(record_of(key)) or {}
            result, why = store.check(key) if key in kept else (None, "")
            if result is not None:
                tasks.enter(key, {**record, "status": "done", "error": "", "row": result["row"]})
            elif why or record.get("status") == "done":
                tasks.damaged[folder_of(key)] = why or "is gone"
            elif record.get("status") in ("failed", "set aside"):
                if again:
                    store.write_table(record_of(key), {"status": "stopped"})
                else:
                    tasks.enter(key, record)
        tasks.reused = tasks.counts["done"]
        return tasks

    def enter(self, key: str, record: Mapping[str, Any]) -> None:
        """Record how a task ended."""
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

    @property
    def verdict(self) -> str:
        """The number of tasks by status, in words."""
        counts = ", ".join(f"{count} {status}" for status, count in self.counts.items() if count)
        return f"{counts}, {self.reused} of them before"

    @property
    def failures(self) -> list[dict[str, Any]]:
        """Rows of the tasks that have no result, and why."""
        names = ("status", "worker", "error")
        wrong = [row for row in self.rows if row["status"] in ("failed", "set aside")]
        return [{"key": row["key"][:12], **{name: row[name] for name in names}} for row in wrong]


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
        Called after each task with the result so far.
    again : bool
        Also repeat tasks that failed or were set aside.
    most : int, optional
        End after so many tasks, as a measurement of costs does.

    Raises
    ------
    InputError
        If `where` belongs to another version, is in use, or cannot be written, as on a full disk.
        The same call then continues.
    HaptixError
        If the executor's workers are lost, have another version or cannot import the kind.
    """
    store = ResultStore(where)
    with store.locked():
        _begin(store, campaign)
        tasks = CampaignResult.of(store, campaign, again)
        with _workers(executor, store, campaign.kind) as workers:
            first = 0.0
            try:
                for ended, _ in enumerate(_ends(store, campaign, tasks, workers, most)):
                    now = time.monotonic()
                    first = first or now
                    # A worker may start slowly: time is counted from the first task that ends.
                    left = tasks.counts["waiting"] * (now - first) / ended if ended else None
                    on_progress(replace(tasks, seconds_left=left))
            except BrokenExecutor as error:
                raise HaptixError(
                    f"the executor has lost its workers ({error}); finished tasks are kept, and "
                    "the same call with a new one goes on"
                ) from None
            finally:
                rows = tasks.rows
                text = csv_text(rows[0] if rows else ["status"], (row.values() for row in rows))
                _write(store, "table.csv", text)
                _write(store, "report.html", report_html(campaign, tasks))
    return tasks


def _write(store: ResultStore, name: str, text: str) -> None:
    try:
        store.write(name, text.encode())
    except OSError as error:
        raise InputError(f"cannot write to {store.where}: {error.strerror or error}") from None


def _begin(store: ResultStore, campaign: Campaign) -> None:
    """Write the campaign's plan, or check that the one here is of this version."""
    versions = identity(campaign.kind)
    known = store.read_table("campaign.json") or {}
    if other := differences(known.get("identity", versions), versions):
        raise InputError(
            f"{store.where}: expected a campaign of this haptix, got one begun with "
            f"{', '.join(other)}; name another --out, since its results may differ"
        )
    plan = campaign.model_dump(mode="json", exclude_none=True)
    about = {"haptix": __version__, "identity": versions, "plan": plan}
    _write(store, "campaign.json", json_text(about))


@contextmanager
def _workers(executor: Any, store: ResultStore, kind: str) -> Iterator[Executor]:
    """Yield the executor of the tasks, with its workers checked before the first task."""
    client = executor if hasattr(executor, "get_executor") else None  # of Dask
    if client is not None:
        from haptix.tasks.campaign.cluster import DaskWorkers

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
                "on them the packages of this machine, or set PYTHONPATH for them"
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
    """Do the waiting tasks, and record each when it ends."""
    waiting = {key for key, row in tasks.by_key.items() if row["status"] == "waiting"}
    seconds: float | None = None  # running mean of the duration of a task
    lost = 0

    def calls() -> Iterator[str]:
        new = islice((task for task in campaign.tasks() if task.key in waiting), most)
        for task in new:
            # Short tasks go into one call, since a call would cost more than the task.
            size = 1 if seconds is None else int(SHORT_CALL_S / max(seconds, 1e-6))
            more = max(1, min(size, _LARGEST_CALL)) - 1
            call = {task.key: task for task in (task, *islice(new, more))}
            waiting.difference_update(call)
            yield _call_of(
                store,
                *(
                    {"key": key, "task": planned.task.path(), "document": planned.document}
                    for key, planned in call.items()
                ),
            )

    texts: Iterable[str] = calls()
    while True:
        again: list[str] = []
        for text, future in finished(workers, do, texts):
            jobs = json.loads(text)["tasks"]
            try:
                records = json.loads(future.result())
            except (BrokenExecutor, CancelledError) as error:
                # The record of a task that began counts its workers' deaths. If no task began, the
                # workers are at fault. Any task may have killed its worker: send each one alone.
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


def estimate(
    campaign: Campaign, where: str | Path, executor: Any = None
) -> tuple[str, list[dict[str, Any]]]:
    """Return a sentence and a row about tasks, hours and bytes, from the tasks done so far.

    If there are none, the first `PILOTS` are done. Raises `HaptixError` if none of these has a
    result; the message has the first one's reason.
    """
    tasks = CampaignResult.of(ResultStore(where), campaign)
    if not tasks.reused:
        tasks = run_campaign(campaign, where, executor, most=PILOTS)
    rows, waiting = tasks.rows, tasks.counts["waiting"]
    done = [row for row in rows if row["status"] == "done" and row["seconds"] is not None]
    if not done:
        reason = next((row["error"] for row in rows if row["error"]), "there are none")
        raise HaptixError(f"{campaign.name}: no task could be measured: {reason}")
    seconds, cpu_seconds, size = (
        sum(_numbers(done, name)) / len(done) for name in ("seconds", "cpu_seconds", "bytes")
    )
    at_once = getattr(executor, "workers", 1)
    row = {
        "tasks": len(rows),
        "done": tasks.counts["done"],
        "seconds_each": seconds,
        "hours_left": waiting * seconds / at_once / 3600,
        "cpu_hours_left": waiting * cpu_seconds / 3600,  # does not depend on other load
        "at_once": at_once,
        "bytes_left": round(waiting * size),
        "bytes_in_all": round(len(rows) * size),
    }
    return f"{campaign.name}: from the costs of {len(done)} tasks, kept in {where}", [row]


def report_html(campaign: Campaign, tasks: CampaignResult) -> str:
    """Return the page of a campaign: its costs, its pictures and the tasks without a result."""
    done = [row for row in tasks.rows if row["status"] == "done"]
    summary = {
        "kind": campaign.kind,
        "haptix": __version__,
        "tasks": tasks.verdict,
        "processor time [h]": sum(_numbers(done, "cpu_seconds")) / 3600,
        "time of tasks [h]": sum(_numbers(done, "seconds")) / 3600,
        "results [MB]": sum(_numbers(done, "bytes")) / 1e6,
        "largest memory of a worker [MB]": max(_numbers(done, "peak_bytes"), default=0) / 1e6,
    }
    parts = [table("", [{"": name, "value": value} for name, value in summary.items()])]
    try:
        parts += [picture("distributions", figure) for figure in _pictures(campaign, done)]
    except MissingExtraError as error:
        parts.append(paragraph(f"Without pictures: {error}"))
    wrong = tasks.failures
    parts.append(table(f"{len(wrong)} without results", wrong[:_MOST_FAILURES]))
    return page(campaign.name, parts)


def _pictures(campaign: Campaign, done: Sequence[dict[str, Any]]) -> Iterator[Figure]:
    """Draw each number that differs from task to task, and the campaign's pairs of them."""
    with from_extra("figures"):
        from matplotlib.figure import Figure

    names = [
        name for name in (done[0] if done else ()) if name == "cpu_seconds" or name not in _LAST
    ]
    panels = [(name, "tasks") for name in names if len({*_numbers(done, name)}) > 1]
    panels += [pair for pair in campaign.maps if {*pair} <= {name for name, _ in panels}]
    for first in range(0, len(panels), _PANELS):
        some = panels[first : first + _PANELS]
        figure = Figure(figsize=(9.6, 2.4 * ceil(len(some) / 3)), layout="constrained")
        places = [*figure.subplots(ceil(len(some) / 3), 3, squeeze=False).flat]
        for axes, (x, y) in zip(places, some, strict=False):
            axes.set(xlabel=x, ylabel=y)
            if y == "tasks":
                axes.hist(_numbers(done, x), bins=30)
            else:
                axes.plot([row[x] for row in done], [row[y] for row in done], ".")
                for axis, values in (("x", _numbers(done, x)), ("y", _numbers(done, y))):
                    if min(values) > 0 and max(values) > 10 * min(values):
                        axes.set(**{f"{axis}scale": "log"})
        for axes in places[len(some) :]:
            axes.set_axis_off()
        yield figure


def _numbers(rows: Sequence[dict[str, Any]], name: str) -> list[float]:
    values = (row.get(name) for row in rows)
    return [
        value for value in values if isinstance(value, int | float) and not isinstance(value, bool)
    ]
