"""Run a campaign: what is missing is done, what is finished is left alone.

A place has ``campaign.json`` (plan and versions), ``results/`` (see `haptix.results`), ``runs/``
(the costs, deaths and errors of each task), ``table.csv`` and ``report.html``.
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
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from haptix.campaign.kinds import Campaign, Value
from haptix.campaign.worker import as_seen_here, differences, do, identity, record_of
from haptix.errors import HaptixError, InputError, MissingExtraError, from_extra
from haptix.executors import Here, executor_of, finished
from haptix.files import csv_text
from haptix.report import page, paragraph, picture, table
from haptix.results import ResultStore, folder_of
from haptix.version import __version__

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_LOG = logging.getLogger("haptix.campaign")

PILOTS = 2
"""Tasks that an `estimate` does where none was measured yet; their results are kept."""

_MOST_LOST = 6  # workers in a row that may end before they begin a task
SHORT_CALL_S, _LARGEST_CALL = 0.2, 64  # of tasks that are done by one call
_MOST_FAILURES = 50  # that the report lists
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
            size = 1 if seconds is None else int(SHORT_CALL_S / max(seconds, 1e-6))
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
    rows = tasks.rows
    names = rows[0] if rows else ("status",)
    with _writing(store):
        store.write("table.csv", csv_text(names, (row.values() for row in rows)).encode())
        store.write("report.html", report_html(campaign, rows).encode())


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
    rows = tasks.rows
    done = [row for row in rows if row["status"] == "done" and row["seconds"] is not None]
    if not done:
        reason = next((row["error"] for row in rows if row["error"]), "there are none")
        raise HaptixError(f"{campaign.name}: no task could be measured: {reason}")
    waiting = tasks.counts["waiting"]
    seconds, cpu_seconds, size = (
        sum(float(row[name] or 0) for row in done) / len(done)
        for name in ("seconds", "cpu_seconds", "bytes")
    )
    at_once = getattr(executor, "workers", 1)
    row = {
        "tasks": len(rows),
        "done": tasks.counts["done"],
        "seconds_each": seconds,
        "hours_left": waiting * seconds / at_once / 3600,
        "cpu_hours_left": waiting * cpu_seconds / 3600,  # whatever else the machine did
        "at_once": at_once,
        "bytes_left": round(waiting * size),
        "bytes_in_all": round(len(rows) * size),
    }
    return f"{campaign.name}: from the costs of {len(done)} tasks, kept in {where}", [row]


def report_html(campaign: Campaign, rows: Sequence[dict[str, Any]]) -> str:
    """Return the page of a campaign, which says what is drawn, and its table."""
    done = [row for row in rows if row["status"] == "done"]
    counts = Counter(row["status"] for row in rows)
    facts = {"kind": campaign.kind, "haptix": __version__, "tasks": len(rows), **counts}
    for name, text in (("cpu_seconds", "processor time [h]"), ("seconds", "time of tasks [h]")):
        facts[text] = f"{sum(_numbers(done, name)) / 3600:.4g}"
    facts["results [MB]"] = f"{sum(_numbers(done, 'bytes')) / 1e6:.4g}"
    if peaks := _numbers(done, "peak_bytes"):
        facts["largest memory of a worker [MB]"] = f"{max(peaks) / 1e6:.4g}"
    parts = [table("", [{"": name, "value": value} for name, value in facts.items()])]
    try:
        parts += [picture(title, figure) for title, figure in _pictures(campaign, done)]
    except MissingExtraError as error:
        parts.append(paragraph(f"Without pictures: {error}"))
    if wrong := [row for row in rows if row["status"] in ("failed", "set aside")]:
        kept = ("key", "status", "worker", "error")
        listed = [{name: row[name] for name in kept} for row in wrong[:_MOST_FAILURES]]
        parts.append(table(f"{len(wrong)} without results", listed))
    return page(campaign.name, parts)


def _pictures(campaign: Campaign, done: Sequence[dict[str, Any]]) -> Iterator[tuple[str, Figure]]:
    with from_extra("figures"):
        from matplotlib.figure import Figure

    shown = [(name, "tasks") for name in (*campaign.shown, "cpu_seconds")]
    for x, y in (*shown, *campaign.maps):
        names = (x,) if y == "tasks" else (x, y)
        rows = [row for row in done if all(_is_number(row.get(name)) for name in names)]
        if len(rows) < 2:
            continue
        figure = Figure(figsize=(6.4, 3.6), layout="constrained")
        axes = figure.add_subplot()
        axes.set(xlabel=x, ylabel=y)
        values = _numbers(rows, x)
        if y == "tasks":
            axes.hist(values, bins="auto" if len(set(values)) > 1 else 1)
            yield f"{x}: {min(values):.4g} to {max(values):.4g}", figure
            continue
        axes.plot(values, _numbers(rows, y), ".")
        for axis, column in (("x", values), ("y", _numbers(rows, y))):
            if min(column) > 0 and max(column) > 10 * min(column):
                axes.set(**{f"{axis}scale": "log"})
        yield f"{y} against {x}", figure


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _numbers(rows: Sequence[dict[str, Any]], name: str) -> list[float]:
    return [row[name] for row in rows if _is_number(row.get(name))]
