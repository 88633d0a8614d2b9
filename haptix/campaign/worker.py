"""What a worker does: one task, told and answered as JSON text.

A worker knows everything by name and takes no code from a message. Before a task begins its record
says so, and afterwards how it ended. A task that finds itself begun and never ended has cost a
worker its life; after three of them it is set aside.
"""

from __future__ import annotations

import hashlib
import json
import os
import socket
import sys
import time
from collections.abc import Mapping
from contextlib import suppress
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

from haptix.campaign.kinds import KINDS, Outcome, kind_named
from haptix.campaign.store import MANIFEST, Store, folder_of, record_of, store_at
from haptix.errors import HaptixError
from haptix.version import __version__

MOST_DEATHS = 3
"""Workers that a task may cost."""

_PACKAGES = ("calibration", "firmware_io", "haptix")
# Rooms that no result depends on.
_NO_RESULT = {"cli", "service", "studio", "client"}

_store = lru_cache(maxsize=4)(store_at)
_begun: list[tuple[Store, str, dict[str, Any]]] = []  # the task that this process is doing


def do(text: str) -> str:
    """Do some tasks, one after the other, and answer with their records.

    Parameters
    ----------
    text : str
        JSON: ``where``, and ``tasks``, each with its ``key``, ``kind`` and ``document``.

    Returns
    -------
    str
        JSON of the records: ``status`` ("done", "failed", "set aside" or "not written") and more;
        of a task that is done also its ``row``.
    """
    given = json.loads(text)
    store = _store(given["where"])
    return json.dumps([_do_one(store, job) for job in given["tasks"]])


def _do_one(store: Store, job: dict[str, Any]) -> dict[str, Any]:
    from haptix.threads import one_thread

    key = str(job["key"])
    name = record_of(key)
    record = store.read_table(name) or {}
    if record.get("status") == "done":  # by a worker whose answer was lost
        result = store.read_table(f"{folder_of(key)}/{MANIFEST}")
        if result is not None:
            return {**record, "row": result["row"]}
    deaths = [*record.get("deaths", ())]
    if record.get("status") == "begun":
        deaths.append(str(record.get("worker")))
    about: dict[str, Any] = {"worker": worker_name(), "deaths": deaths}
    if len(deaths) >= MOST_DEATHS:
        error = f"its worker died {len(deaths)} times: {', '.join(deaths)}"
        return _ended(store, name, {**about, "status": "set aside", "error": error})
    try:
        store.write_table(name, {**about, "status": "begun"})
    except (OSError, HaptixError) as error:
        return {**about, "status": "not written", "error": _said(error)}
    here = (store, name, {**about, "status": "stopped"})
    _begun.append(here)
    _forget_peak_memory()
    began, began_cpu = time.perf_counter(), time.process_time()
    try:
        with one_thread():
            found = kind_named(job["kind"]).run(job["document"])
        about |= {
            "seconds": time.perf_counter() - began,
            "cpu_seconds": time.process_time() - began_cpu,
            "peak_bytes": _peak_memory(),
            **found.measured,
        }
    except Exception as error:  # whatever it is, it is this task's
        _begun.remove(here)
        return _ended(store, name, {**about, "status": "failed", "error": _said(error)})
    try:
        about["bytes"] = _publish(store, job, found)
    except Exception as error:  # a full disk, or a place that is gone
        _begun.remove(here)
        if store.read(f"{folder_of(key)}/{MANIFEST}") is None:
            with suppress(Exception):
                store.write_table(name, {**about, "status": "stopped"})
            return {**about, "status": "not written", "error": _said(error)}
    _begun.remove(here)
    return _ended(store, name, {**about, "status": "done"}, dict(found.row))


def _publish(store: Store, job: dict[str, Any], found: Outcome) -> int:
    result = {
        "kind": job["kind"],
        "haptix": __version__,
        "document": job["document"],
        "row": dict(found.row),
    }
    return store.publish(job["key"], found.files, result)


def _ended(
    store: Store, name: str, record: dict[str, Any], row: dict[str, Any] | None = None
) -> dict[str, Any]:
    with suppress(Exception):  # the results are what counts
        store.write_table(name, record)
    return record if row is None else {**record, "row": row}


def _said(error: BaseException) -> str:
    return " ".join(f"{type(error).__name__}: {error}".split())[:1000]


def release() -> None:
    """Say of the task that this process is doing that it was stopped, and did not fail."""
    for store, name, record in _begun:
        with suppress(Exception):
            store.write_table(name, record)


def worker_name() -> str:
    """Host and process of this worker."""
    return f"{socket.gethostname()}:{os.getpid()}"


def identity(kind: str) -> dict[str, str]:
    """Return what must be equal on all workers of a kind, for equal bytes."""
    import numpy
    import torch

    found = {
        "haptix": __version__,
        "code": code_digest(),
        "torch": str(torch.__version__).partition("+")[0],
        "numpy": numpy.__version__,
        "processor": torch.backends.cpu.get_cpu_capability(),
    }
    if kind not in KINDS:
        file = sys.modules[kind_named(kind).__module__].__file__
        found[kind] = hashlib.sha256(Path(str(file)).read_bytes()).hexdigest()[:16]
    return found


def differences(found: Mapping[str, Any], own: Mapping[str, str]) -> list[str]:
    """Return what of `own` is another in `found`, as people read it."""
    return [f"{k} {found.get(k)} (here {v})" for k, v in own.items() if found.get(k) != v]


def as_seen_here(where: str) -> dict[str, str]:
    """Return `identity`, and the hash of the campaign's own file as this process sees it."""
    file, kind = f"{where}/campaign.json", next(iter(KINDS))
    try:
        data = _store(where).read("campaign.json")
        seen = "no file" if data is None else hashlib.sha256(data).hexdigest()[:16]
        if data is not None:
            kind = str(json.loads(data)["plan"]["kind"])
    except (OSError, HaptixError) as error:
        seen = _said(error)
    try:
        return {**identity(kind), file: seen}
    except HaptixError as error:  # a module that is not installed here
        return {**identity(next(iter(KINDS))), kind: _said(error), file: seen}


@cache
def code_digest() -> str:
    """Hash of the source code of everything that results may depend on."""
    code, root = hashlib.sha256(), Path(__file__).parents[2]
    for package in _PACKAGES:
        for file in sorted((root / package).rglob("*.py")):
            if file.relative_to(root).parts[1] not in _NO_RESULT:
                code.update(file.read_bytes())
    return code.hexdigest()[:16]


def _forget_peak_memory() -> None:
    with suppress(OSError):  # Linux only
        Path("/proc/self/clear_refs").write_text("5")


def _peak_memory() -> int | None:
    """Return the most memory [bytes] that this process had since `_forget_peak_memory`."""
    with suppress(OSError):
        for line in Path("/proc/self/status").read_text().splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) * 1024
    return None
