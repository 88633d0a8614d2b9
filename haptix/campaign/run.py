"""Run a campaign: what is missing is done, what is finished is left alone."""

from __future__ import annotations

import json
import time
from collections import Counter, deque
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, CancelledError, Executor
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

from haptix.campaign.kinds import Campaign
from haptix.campaign.ledger import Ledger
from haptix.campaign.report import report_html
from haptix.campaign.store import Store, record_of, store_at
from haptix.campaign.worker import do, identity
from haptix.errors import HaptixError, InputError
from haptix.executors import executor_of, finished
from haptix.version import __version__

_MOST_LOST = 6  # workers in a row that may end before they begin a task
_BEGAN = ("begun", "done", "failed")
_TABLE_EVERY_S = 60.0
_SHORT_CALL_S, _LARGEST_CALL = 0.2, 64  # of tasks that are done by one call


@dataclass(frozen=True)
class Seen:
    """How far a campaign is."""

    total: int
    """Tasks in all."""
    counts: Counter[str]
    """Tasks by status; what has not begun is "waiting"."""
    seconds_left: float | None
    """From the costs measured so far; None before the second task has ended."""


Progress = Callable[[Seen], None]


@dataclass(frozen=True)
class CampaignResult:
    """A campaign that was run."""

    where: str
    """Folder or URL."""
    rows: tuple[dict[str, Any], ...]
    """The table: labels, numbers, status, costs and key of each task."""
    counts: Counter[str]
    """Tasks by status."""
    reused: int
    """Tasks that an earlier run had finished."""


def run_campaign(
    campaign: Campaign,
    where: str | Path,
    executor: Any = None,
    on_progress: Progress = lambda seen: None,
    again: bool = False,
    most: int | None = None,
) -> CampaignResult:
    """Do the tasks of a campaign that are not done yet.

    Parameters
    ----------
    campaign : Campaign
        The plan.
    where : str or Path
        Folder, or a URL of fsspec such as ``s3://bucket/campaign``.
    executor : concurrent.futures.Executor or Dask client, optional
        Where tasks are done; without it in this process, one after the other. Its workers must
        have this haptix and reach `where`.
    on_progress : callable
        Called with a `Seen` after each task.
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
        If the executor's workers are lost, or have another version.
    """
    store = store_at(where)
    with store.held():
        _begin(store, campaign, identity(campaign.kind))
        ledger = Ledger.of(store, campaign, again)
        reused = ledger.counts["done"]
        with _workers(executor, store) as workers:
            try:
                records = _records(store, campaign, ledger, workers, most)
                _go_on(store, ledger, records, on_progress)
            finally:
                ledger.let_go()
                _conclude(store, campaign, ledger)
    return CampaignResult(store.where, tuple(ledger.table()), ledger.counts, reused)


def _go_on(
    store: Store,
    ledger: Ledger,
    records: Iterator[None],
    on_progress: Progress,
) -> None:
    """Let tasks be done, and say how far they are."""
    first = 0.0
    written = time.monotonic()
    for before, _ in enumerate(records):
        now = time.monotonic()
        first = first or now
        # A worker may take long to start: its time counts from the first end on.
        each = (now - first) / before if before else None
        left = ledger.counts["waiting"] + ledger.counts["in work"]
        on_progress(Seen(len(ledger.rows), ledger.counts, each and left * each))
        if now - written > _TABLE_EVERY_S:
            written = now
            store.write("table.csv", ledger.csv().encode())


def _begin(store: Store, campaign: Campaign, own: dict[str, str]) -> None:
    """Write what this campaign is, or check that it is of this version."""
    known = store.read_table("campaign.json")
    before = (known or {}).get("identity", own)
    other = [
        f"{name} {before.get(name)} (here {own[name]})"
        for name in own
        if before.get(name) != own[name]
    ]
    if other:
        raise InputError(
            f"{store.where}: expected a campaign of this haptix, got one begun with "
            f"{', '.join(other)}; name another --out, since its results may differ"
        )
    plan = campaign.model_dump(mode="json", exclude_none=True)
    try:
        store.write_table(
            "campaign.json",
            {"haptix": __version__, "identity": own, "plan": plan},
        )
    except OSError as error:
        raise InputError(f"cannot write to {store.where}: {error.strerror or error}") from None


@contextmanager
def _workers(executor: Any, store: Store) -> Iterator[Executor]:
    """Give what tasks are done on, its workers checked where they are elsewhere."""
    own = None
    if hasattr(executor, "get_executor"):  # a Dask client
        from haptix.campaign.cluster import DaskWorkers

        executor = own = DaskWorkers(executor)
    try:
        if hasattr(executor, "expect"):
            executor.expect(store.where)
        yield executor_of(executor)
    finally:
        if own is not None:
            own.shutdown()


class _Waiting:
    """The tasks that are to be done, as texts for `do`; some may come back."""

    def __init__(self, store: Store, campaign: Campaign, ledger: Ledger, most: int | None) -> None:
        self._where, self._ledger = store.where, ledger
        self._tasks = islice(self._new(campaign), most)
        self._again: deque[dict[str, Any]] = deque()
        self._jobs: dict[str, list[dict[str, Any]]] = {}
        self._seconds: float | None = None  # of a task, lately

    def _new(self, campaign: Campaign) -> Iterator[dict[str, Any]]:
        for task in campaign.tasks():
            if self._ledger.take(task.key):
                yield {"key": task.key, "kind": task.kind, "document": task.document}

    def __iter__(self) -> Iterator[str]:
        return self

    def __next__(self) -> str:
        # Tasks that came back may have cost a worker: each goes alone.
        jobs = [self._again.popleft()] if self._again else [*islice(self._tasks, self._size)]
        if not jobs:
            raise StopIteration
        text = json.dumps({"where": self._where, "tasks": jobs})
        self._jobs[text] = jobs
        return text

    @property
    def _size(self) -> int:
        """Tasks in one call: calls of short tasks would cost more than the tasks."""
        if self._seconds is None:
            return 1
        return max(1, min(_LARGEST_CALL, int(_SHORT_CALL_S / max(self._seconds, 1e-6))))

    def pop(self, text: str) -> list[str]:
        """Keys of a call that has ended."""
        return [job["key"] for job in self._jobs.pop(text)]

    def give_back(self, text: str) -> list[str]:
        """Keys of a call that was lost; its tasks are to be done again."""
        self._again += self._jobs[text]
        return self.pop(text)

    def learn(self, seconds: float) -> None:
        """Take the time of a task into account."""
        self._seconds = seconds if self._seconds is None else 0.8 * self._seconds + 0.2 * seconds


def _records(
    store: Store,
    campaign: Campaign,
    ledger: Ledger,
    executor: Executor,
    most: int | None,
) -> Iterator[None]:
    """Do tasks, and enter each into the ledger as it ends."""
    waiting, lost = _Waiting(store, campaign, ledger, most), 0
    try:
        for text, future in finished(executor, do, waiting):
            try:
                records = json.loads(future.result())
            except (BrokenExecutor, CancelledError) as error:
                # A task that began counts its workers' deaths itself; where none began, the
                # workers are what is wrong.
                found = (store.read_table(record_of(key)) for key in waiting.give_back(text))
                lost = 0 if any((one or {}).get("status") in _BEGAN for one in found) else lost + 1
                if lost > _MOST_LOST:
                    raise HaptixError(
                        f"workers end before they begin a task, the last with: {error}; a script "
                        'that starts processes needs `if __name__ == "__main__":`'
                    ) from None
                continue
            lost = 0
            for key, record in zip(waiting.pop(text), records, strict=True):
                if record["status"] == "not written":
                    raise InputError(
                        f"cannot write to {store.where}: {record['error']}; finished tasks are "
                        "kept, and the same command goes on"
                    )
                if "seconds" in record:
                    waiting.learn(record["seconds"])
                ledger.enter(key, record)
                yield
    except BrokenExecutor as error:
        raise HaptixError(
            f"the executor has lost its workers ({error}); finished tasks are kept, and the same "
            "call with a new one goes on"
        ) from None


def _conclude(store: Store, campaign: Campaign, ledger: Ledger) -> None:
    """Write the table and the report."""
    try:
        store.write("table.csv", ledger.csv().encode())
        store.write("report.html", report_html(campaign, ledger.table()).encode())
    except OSError as error:
        raise InputError(f"cannot write to {store.where}: {error.strerror or error}") from None
