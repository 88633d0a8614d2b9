"""A worker: it gets tasks as JSON text and answers in JSON text.

A message names tasks and carries no code. Before a task begins, its record is written as "begun",
and afterwards with how it ended:

    (none) -> begun -> done | failed | stopped (on request) | set aside (after three deaths)

If a record is still "begun" when a worker takes the task again, the task has killed its worker.
"""

from __future__ import annotations

import hashlib
import json
import os
import socket
import time
from collections.abc import Mapping
from contextlib import suppress
from functools import lru_cache
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from haptix.base.errors import HaptixError
from haptix.base.results import ResultStore
from haptix.base.task import Context, Result, task_at
from haptix.base.version import __version__, code_digest

MOST_DEATHS = 3
"""Number of workers that a task may kill before it is set aside."""

_RESULTS_DEPEND_ON = (
    "calibration", "firmware_io", "haptix/base", "haptix/model", "haptix/feel", "haptix/play",
    "haptix/plan", "haptix/lab", "haptix/tasks",
)  # fmt: skip

_store = lru_cache(maxsize=4)(ResultStore)
_begun: list[tuple[ResultStore, str, dict[str, Any]]] = []  # tasks that this process is doing


def record_of(key: str) -> str:
    """Return the file with the record of a task: its costs, worker, deaths and error."""
    return f"runs/{key[:2]}/{key}.json"


def do(text: str) -> str:
    """Do some tasks, one after the other, and answer with their records.

    Parameters
    ----------
    text : str
        JSON: ``where``, and ``tasks``, each with its ``key``, its ``task`` as module:Class, and its
        ``document``.

    Returns
    -------
    str
        JSON of the records: ``status`` ("done", "failed", "set aside" or "not written") and more;
        of a task that is done also its ``row``.
    """
    call = json.loads(text)
    store = _store(call["where"])
    return json.dumps([_done(store, job) for job in call["tasks"]])


def _done(store: ResultStore, job: dict[str, Any]) -> dict[str, Any]:
    key = job["key"]
    before = store.read_table(record_of(key)) or {}
    if before.get("status") == "done":  # a worker did it, and its answer was lost
        manifest, _ = store.check(key)
        if manifest is not None:
            return {**before, "row": manifest["row"]}
    deaths = [*before.get("deaths", ())]
    if before.get("status") == "begun":
        deaths.append(str(before.get("worker")))
    record = {"worker": f"{socket.gethostname()}:{os.getpid()}", "deaths": deaths}
    if len(deaths) >= MOST_DEATHS:
        why = f"its worker died {len(deaths)} times: {', '.join(deaths)}"
        return _ended(store, key, {**record, "status": "set aside", "error": why})
    stopped = (store, key, {**record, "status": "stopped"})
    try:
        store.write_table(record_of(key), {**record, "status": "begun"})
        _begun.append(stopped)
        with TemporaryDirectory(prefix="haptix-task-") as folder:
            try:
                result, costs = _measured(job, Path(folder))
            except Exception as error:  # every error here is the task's own
                return _ended(store, key, {**record, "status": "failed", "error": said(error)})
            about = {"task": job["task"], "haptix": __version__, "document": job["document"]}
            size = store.publish(key, result.files, {**about, "row": result.row})
    except Exception as error:  # a full disk, or a place that is gone
        _ended(*stopped)
        return {**record, "status": "not written", "error": said(error)}
    finally:
        if stopped in _begun:
            _begun.remove(stopped)
    record = _ended(store, key, {**record, **costs, "bytes": size, "status": "done"})
    return {**record, "row": result.row}


def _measured(job: dict[str, Any], folder: Path) -> tuple[Result, dict[str, Any]]:
    """Do a task on one thread; return its result and its costs."""
    from haptix.base.threads import one_thread

    with suppress(OSError):  # reset the peak of the memory, on Linux only
        Path("/proc/self/clear_refs").write_text("5")
    began, began_cpu = time.perf_counter(), time.process_time()
    with one_thread():
        result = task_at(job["task"])(**job["document"]).run(Context(folder))
    seconds, cpu_seconds = time.perf_counter() - began, time.process_time() - began_cpu
    costs = {"seconds": seconds, "cpu_seconds": cpu_seconds, "peak_bytes": _peak_memory()}
    return result, {**costs, **result.costs}


def _peak_memory() -> int | None:
    """Return the peak memory [bytes] of this process since the last reset."""
    with suppress(OSError):
        for line in Path("/proc/self/status").read_text().splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) * 1024
    return None


def _ended(store: ResultStore, key: str, record: dict[str, Any]) -> dict[str, Any]:
    with suppress(Exception):  # a lost record does no harm: the results count
        store.write_table(record_of(key), record)
    return record


def said(error: BaseException) -> str:
    """Return an error as one sentence."""
    return " ".join(f"{type(error).__name__}: {error}".split())[:1000]


def release() -> None:
    """Record the task that this process is doing as stopped, and not as failed."""
    for stopped in _begun:
        _ended(*stopped)


def identity(kind: str) -> dict[str, str]:
    """Return the versions that all workers of a kind must share for equal results.

    If something is missing, such as the kind's module, its value is the reason.
    """
    import numpy
    import torch

    versions = {
        "haptix": __version__,
        "code": code_digest(*_RESULTS_DEPEND_ON)[:16],
        "torch": str(torch.__version__).partition("+")[0],
        "numpy": numpy.__version__,
        "processor": torch.backends.cpu.get_cpu_capability(),
    }
    if ":" in kind:
        try:
            file = import_module(kind.partition(":")[0]).__file__
            versions[kind] = hashlib.sha256(Path(str(file)).read_bytes()).hexdigest()[:16]
        except Exception as error:
            versions[kind] = said(error)
    return versions


def as_seen_here(where: str, kind: str = "") -> dict[str, str]:
    """Return `identity` and the hash of the campaign's file as this process sees it."""
    file = f"{where}/campaign.json"
    try:
        data = _store(where).read("campaign.json") or b"no file"
    except (OSError, HaptixError) as error:
        return {**identity(kind), file: said(error)}
    return {**identity(kind), file: hashlib.sha256(data).hexdigest()[:16]}


def differences(seen: Mapping[str, Any], here: Mapping[str, str]) -> list[str]:
    """Describe which values of `here` differ in `seen`."""
    return [f"{k} {seen.get(k)} (here {v})" for k, v in here.items() if seen.get(k) != v]
