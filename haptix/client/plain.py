"""The client without ``await``; see `haptix.client`."""

from __future__ import annotations

import asyncio
import threading
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from types import TracebackType
from typing import Any, Self

from haptix.client.asynchronous import AsyncClient, connect_async
from haptix.client.layout import ClientRegion
from haptix.client.touching import ReportsTouches
from haptix.errors import InputError
from haptix.service import messages as m

_MOST_SENDING = 64  # batches that are not sent yet; then a touch waits


class _Plain:
    """What is called with await, called without."""

    def __init__(self, target: Any, run: Callable[[Any], Any]) -> None:
        self._target, self._run = target, run

    def __getattr__(self, name: str) -> Any:
        call = getattr(self._target, name)
        if not callable(call):
            return call

        def plain(*args: Any, **fields: Any) -> Any:
            found = self._run(call(*args, **fields))
            return _Plain(found, self._run) if isinstance(found, ClientRegion) else found

        return plain


class Client(ReportsTouches[None]):
    """The plain face of `AsyncClient`: the same calls, without ``await``.

    A thread of its own answers the service's pings, so a program that computes for long stays
    alive. Handlers are called in that thread, where this face cannot be used. Touches do not wait
    until they are sent.
    """

    def __init__(self, name: str, address: str = "", token: str = "", resume: str = "") -> None:
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(
            target=self._loop.run_forever, name="haptix client", daemon=True
        )
        self._thread.start()
        try:
            self._client: AsyncClient = self._run(connect_async(name, address, token, resume))
        except BaseException:
            self._end()
            raise
        self.on = self._client.on
        self.layout = _Plain(self._client.layout, self._run)
        self._sent: deque[Future[None]] = deque()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()

    def __getattr__(self, name: str) -> Callable[..., Any]:
        call: Callable[..., Any] = getattr(_Plain(self._client, self._run), name)
        return call

    @property
    def welcome(self) -> m.Welcome:
        """What the service said at first: limits, devices, profiles."""
        return self._client.welcome

    def touches(self, touches: list[m.TouchMessage]) -> None:
        """Report many touches in one batch of bytes.

        Raises
        ------
        DeviceError
            If the connection is gone.
        """
        self._client.check()
        sending = asyncio.run_coroutine_threadsafe(self._client.touches(touches), self._loop)
        self._sent.append(sending)
        while self._sent and (self._sent[0].done() or len(self._sent) > _MOST_SENDING):
            self._sent.popleft().result()

    def close(self) -> None:
        """Leave; an armed output goes to 0 V."""
        if self._thread.is_alive():
            self._run(self._client.close())
            self._end()

    def _run(self, coroutine: Any) -> Any:
        if threading.current_thread() is self._thread:
            coroutine.close()
            raise InputError("a handler cannot wait for the service: use connect_async, or a queue")
        future: Future[Any] = asyncio.run_coroutine_threadsafe(coroutine, self._loop)
        return future.result()

    def _end(self) -> None:
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()


def connect(name: str, address: str = "", token: str = "", resume: str = "") -> Client:
    """Open a session with the service of this machine.

    Parameters
    ----------
    name : str
        Who comes, for those who look at the sessions.
    address, token : str
        Where the service is, and what lets in; by default what ``service.json`` says.
    resume : str
        `welcome.resume` of a session whose connection was lost within the last 30 s.

    Raises
    ------
    DeviceError
        If no service runs.
    Refused
        If it does not let this client in.
    """
    return Client(name, address, token, resume)
