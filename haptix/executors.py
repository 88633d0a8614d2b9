"""Many calls on an executor: a few at a time, each result as soon as it is there."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from itertools import islice
from typing import Any, TypeVar

from haptix.checks import instance

Item = TypeVar("Item")
Result = TypeVar("Result")


class Here(Executor):
    """An executor that does each call at once, in the thread that submits it."""

    def submit(self, work: Callable[..., Result], /, *given: Any, **named: Any) -> Future[Result]:
        """Do the call, and return a future that has ended."""
        future: Future[Result] = Future()
        try:
            future.set_result(work(*given, **named))
        except Exception as error:
            future.set_exception(error)
        return future


def executor_of(given: Any) -> Executor:
    """Return an executor: the one given, that of a Dask client, or `Here` for None.

    Raises
    ------
    InputError
        If it is none of these.
    """
    if given is None:
        return Here()
    if hasattr(given, "get_executor"):  # a Dask client
        given = given.get_executor(pure=False)
    instance("executor", given, Executor, "concurrent.futures has some; a Dask client is one too")
    return given  # type: ignore[no-any-return]  # checked


def finished(
    executor: Executor,
    work: Callable[[Item], Result],
    items: Iterable[Item],
    at_once: Callable[[], int],
) -> Iterator[tuple[Item, Future[Result]]]:
    """Do `work` on all items, and yield each item with its future once that has ended.

    Items are taken from `items` as room becomes free, so that it may be long, or may grow. Where
    the iteration ends early, what has not begun is cancelled.

    Parameters
    ----------
    executor : Executor
        Where calls are done.
    work : callable
        One item's result. A module's function where the executor has processes of its own.
    items : iterable
        The items.
    at_once : callable
        Most calls in flight; asked each time, since workers come and go.
    """
    waiting = iter(items)
    running: dict[Future[Result], Item] = {}
    try:
        while True:
            for item in islice(waiting, max(0, at_once() - len(running))):
                running[executor.submit(work, item)] = item
            if not running:
                return
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                yield running.pop(future), future
    finally:
        for future in running:
            future.cancel()
