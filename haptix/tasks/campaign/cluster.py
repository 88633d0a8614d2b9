"""Workers of a Dask cluster: each is checked when it arrives, and gets tasks as text.

Dask's messages can run code: a cluster needs Dask's TLS, or a network whose users are all trusted.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from concurrent.futures import BrokenExecutor, Executor, Future
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from haptix.base.errors import HaptixError, InputError, from_extra
from haptix.tasks.campaign.processes import PROCESS_BYTES, processes_that_fit
from haptix.tasks.campaign.task_worker import as_seen_here, differences

_LOG = logging.getLogger("haptix.tasks.campaign")

Result = TypeVar("Result")

_LOOK_EVERY_S = 1.0
_FIRST_WORKER_S = 60
# haptix reports a failure of the cluster in one sentence; their tracebacks would only repeat it.
_TOLD_BY_US = tuple(
    f"distributed.{part}" for part in ("batched", "client", "comm", "core", "utils")
)


class _Call(NamedTuple):
    """A call, Dask's future of it, and the workers that may do it."""

    work: Callable[..., Any]
    args: tuple[Any, ...]
    sent: Any
    workers: frozenset[str]


class DaskWorkers(Executor):
    """Executor of the workers of a Dask cluster that are of this version and see the same files.

    Parameters
    ----------
    client : distributed.Client
        The cluster.
    on_refused : callable
        Called with a sentence about each worker that is not used.
    """

    def __init__(self, client: Any, on_refused: Callable[[str], None] = lambda why: None) -> None:
        self.client, self._on_refused = client, on_refused
        self._owned: list[Any] = []
        self._asked: tuple[str, ...] = ()
        self._own: dict[str, str] = {}
        self._good: dict[str, int] = {}  # threads of the workers that are used, by address
        self._known: set[str] = set()
        self.refused: dict[str, str] = {}
        """Reasons by the names of workers that are not used."""
        self._calls: dict[Future[Any], _Call] = {}
        self._lock = threading.RLock()
        self._ended = threading.Event()

    @classmethod
    def on(
        cls,
        place: str,
        workers: int | None = None,
        memory_bytes: int | None = None,
        on_refused: Callable[[str], None] = lambda why: None,
    ) -> DaskWorkers:
        """Open a local cluster ("dask"), or connect to an address or a scheduler file.

        Raises `HaptixError` if Dask is not installed, or nothing answers.
        """
        with from_extra("cluster"):
            from distributed import Client, LocalCluster
        for name in _TOLD_BY_US:
            logging.getLogger(name).setLevel(logging.CRITICAL)
        owned: list[Any] = []
        address: dict[str, Any]
        if place == "dask":
            count = processes_that_fit(memory_bytes or 0, workers)
            limit = "auto" if memory_bytes is None else PROCESS_BYTES + memory_bytes
            cluster = LocalCluster(
                n_workers=count, threads_per_worker=1, memory_limit=limit, dashboard_address=None
            )
            owned, address = [cluster], {"address": cluster}
        elif "://" in place:
            address = {"address": place}
        elif Path(place).is_file():
            address = {"scheduler_file": place}
        else:
            raise InputError(
                f"--on: expected processes, dask, an address such as tcp://HOST:8786, or a "
                f"scheduler file, got {place!r:.80}"
            )
        try:
            opened = cls(Client(**address), on_refused)
        except (OSError, ValueError, TypeError) as error:  # the last: TLS without a certificate
            raise HaptixError(f"--on: no Dask scheduler answers at {place}: {error}") from None
        opened._owned = [opened.client, *owned]
        return opened

    @property
    def workers(self) -> int:
        """Tasks that the workers do at a time."""
        return max(1, sum(self._good.values()))

    @property
    def at_once(self) -> int:
        """Calls in flight: for each that runs, another one waits."""
        return 2 * self.workers

    def expect(self, where: str, kind: str = "") -> None:
        """Check the workers that there are, and from now on each that arrives.

        Raises `HaptixError` if none may be used; the message names each and its reason.

        Parameters
        ----------
        where, kind : str
            Place of the campaign, which workers must reach, and its kind, which they must import.
        """
        self._asked, self._own = (where, kind), as_seen_here(where, kind)
        with suppress(TimeoutError):
            self.client.wait_for_workers(1, timeout=_FIRST_WORKER_S)
        self._look()
        if not self._good:
            reasons = "; ".join(f"{name}: {why}" for name, why in self.refused.items())
            raise HaptixError(
                "expected workers of this version that can import the campaign's kind, got none "
                f"that may be used ({reasons or 'none'})"
            )
        threading.Thread(target=self._keep_looking, daemon=True).start()

    def _keep_looking(self) -> None:
        while not self._ended.wait(_LOOK_EVERY_S):
            with suppress(Exception):  # the scheduler is gone: calls report that
                self._look()

    def _look(self) -> None:
        """Check new workers; send calls again whose workers have all gone."""
        workers = self.client.scheduler_info(n_workers=-1)["workers"]
        if new := [address for address in workers if address not in self._known]:
            seen = self.client.run(as_seen_here, *self._asked, workers=new, on_error="return")
            for address in new:
                self._judge(address, workers[address], seen.get(address))
        with self._lock:
            self._good = {at: n for at, n in self._good.items() if at in workers}
            present_workers = set(workers)
            lost = [
                future for future, call in self._calls.items() if not call.workers & present_workers
            ]
            for future in lost if self._good else []:
                call = self._calls[future]
                _LOG.info("a call is sent again: its workers are gone")
                self._send(future, call.work, call.args)
                call.sent.cancel()

    def _judge(self, address: str, about: dict[str, Any], seen: Any) -> None:
        name = str(about.get("name", address))
        if isinstance(seen, dict):
            other = differences(seen, self._own)
        else:  # it has no haptix, or another one; or it is gone already
            other = [f"{type(seen).__name__}: {seen}"]
        self._known.add(address)
        if not other:
            self._good[address] = int(about.get("nthreads", 1))
        else:
            self.refused[name] = ", ".join(other)[:500]
            self._on_refused(f"worker {name} ({address}) is not used: {self.refused[name]}")

    def submit(self, work: Callable[..., Result], /, *args: Any, **named: Any) -> Future[Result]:
        """Send a call of a module's function to a worker that may do it."""
        future: Future[Result] = Future()
        future.add_done_callback(self._forget)
        with self._lock:
            self._send(future, work, args)
        return future

    def _send(self, future: Future[Any], work: Callable[..., Any], args: tuple[Any, ...]) -> None:
        workers = frozenset(self._good)
        try:
            sent = self.client.submit(work, *args, pure=False, workers=[*workers])
        except Exception as error:
            raise _gone(error) from None
        self._calls[future] = _Call(work, args, sent, workers)
        sent.add_done_callback(lambda answer: self._take(future, answer))

    def _take(self, future: Future[Any], sent: Any) -> None:
        with self._lock:
            call = self._calls.get(future)
            if call is None or call.sent is not sent:
                return  # cancelled, or sent again
            if sent.status == "finished":
                try:
                    future.set_result(sent.result())
                except Exception as error:
                    future.set_exception(_gone(error))
            elif sent.status == "error":
                why = sent.exception()
                killed = type(why).__name__ == "KilledWorker"
                future.set_exception(BrokenExecutor(str(why)) if killed else why)
            else:
                future.set_exception(_gone(sent.status))

    def _forget(self, future: Future[Any]) -> None:
        with self._lock:
            call = self._calls.pop(future, None)
        if call is not None and future.cancelled():
            call.sent.cancel()

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Leave the cluster; a local one ends. Calls that run are not interrupted."""
        self._ended.set()
        for opened in self._owned:
            with suppress(Exception):
                opened.close()


def _gone(why: Any) -> HaptixError:
    return HaptixError(
        f"the scheduler does not answer any more ({why}); finished tasks are kept: start it and "
        "its workers, and the same command goes on"
    )
