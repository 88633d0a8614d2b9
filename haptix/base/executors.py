"""Many calls on an executor: a few at a time, each result as soon as it is ready."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from itertools import islice
from os import cpu_count
from typing import Any, TypeVar

from haptix.base.checks import instance

Item = TypeVar("Item")
Result = TypeVar("Result")


class Here(Executor):
    """An executor that does each call at once, in the thread that submits it."""

    at_once = 1

    def submit(
        self, work: Callable[..., Result], /, *arguments: Any, **options: Any
    ) -> Future[Result]:
        """Do the call, and return a future that has ended."""
        future: Future[Result] = Future()
        try:
            future.set_result(work(*arguments, **options))
        except Exception as error:
            future.set_exception(error)
        return future


def executor_of(executor: Any) -> Executor:
    """Return an executor: the argument itself, that of a Dask client, or `Here` for None.

    Raises `InputError` if it is none of these.
    """
    if executor is None:
        return Here()
    if hasattr(executor, "get_executor"):  # a Dask client
        threads = sum(executor.nthreads().values())
        executor = executor.get_executor(pure=False)
        executor.at_once = 2 * max(1, threads)
    instance("executor", executor, Executor, "those of concurrent.futures, or a Dask client")
    return executor  # type: ignore[no-any-return]  # checked


def finished(
    executor: Executor,
    work: Callable[[Item], Result],
    items: Iterable[Item],
    until_idle: bool = False,
) -> Generator[tuple[Item, Future[Result]], None, None]:
    """Do `work` on all items, and yield each item with its future once that has ended.

    Items are taken from `items` only when they can be worked on, so `items` may be long or may
    grow. If the iteration ends early, calls that have not begun are cancelled.

    The executor's ``at_once`` is the number of calls that may be in flight. It is read each time,
    since workers come and go. Without it there are two calls per core: one runs while the next
    waits.

    Parameters
    ----------
    executor : Executor
        Where calls are done.
    work : callable
        Makes one item's result. If the executor has processes of its own, a module's function.
    items : iterable
        The items.
    until_idle : bool
        If the iteration ends early, wait for the calls that have begun.
    """
    waiting = iter(items)
    running: dict[Future[Result], Item] = {}
    try:
        while True:
            free = getattr(executor, "at_once", 2 * (cpu_count() or 1)) - len(running)
            for item in islice(waiting, max(0, free)):
                running[executor.submit(work, item)] = item
            if not running:
                return
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                yield running.pop(future), future
    finally:
        for future in running:
            future.cancel()
        if until_idle:
            wait(running)
