"""A client of `haptix serve`: another program's way to friction under a finger.

::

    with haptix.client.connect("demo") as h:
        h.layout_set({"regions": [...]})
        h.acquire()
        h.arm()
        for t_s, x_mm, y_mm in path:
            h.touch(x_mm, y_mm, t_s=t_s)

Needs the extra ``serve``. `connect_async` gives the same with ``await``.
"""

from __future__ import annotations

import asyncio
import json
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Any, Literal, Self

from websockets.asyncio.client import ClientConnection
from websockets.asyncio.client import connect as _connect
from websockets.exceptions import WebSocketException
from websockets.typing import Subprotocol

from haptix.errors import DeviceError, HaptixError
from haptix.files import read_json
from haptix.service import messages as m
from haptix.service.access import service_folder
from haptix.service.batches import TelemetryFrame, read_frame, write_touches

_SUBPROTOCOL = Subprotocol("haptix.v1")
_WAIT_S = 10.0
TouchKind = Literal["down", "move", "up"]


class Refused(HaptixError):
    """The service refused a message; `code` and `path` say what and where."""

    def __init__(self, error: m.Error) -> None:
        place = f" ({error.path})" if error.path else ""
        super().__init__(f"{error.sentence}{place}")
        self.code, self.path = error.code, error.path


class AsyncClient:
    """A session with the service; made by `connect_async`.

    Attributes
    ----------
    welcome : Welcome
        What the service said at first: limits, devices, profiles.
    """

    welcome: m.Welcome

    def __init__(self, socket: ClientConnection) -> None:
        self._socket = socket
        self._asked: dict[int, asyncio.Future[Any]] = {}
        self._handlers: dict[str, list[Callable[[Any], None]]] = {}
        self._number = self._batch = 0
        self._ended: BaseException | None = None
        self._reader = asyncio.create_task(self._read())

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        await self.close()

    async def close(self) -> None:
        """Leave; an armed output goes to 0 V, and the lease is free."""
        with suppress(DeviceError):
            await self._send(json.dumps({"type": "bye", "id": self._number + 1}))
        await self._socket.close()
        await asyncio.gather(self._reader, return_exceptions=True)

    def on(self, kind: str, handler: Callable[[Any], None]) -> None:
        """Call `handler` with each event of a type ("contact", "output", ...) or with "frame"."""
        self._handlers.setdefault(kind, []).append(handler)

    async def ask(self, kind: str, **fields: Any) -> Any:
        """Send a message and return its answer.

        Raises
        ------
        Refused
            If the service refuses it.
        DeviceError
            If the connection is gone.
        """
        self._number += 1
        answer: asyncio.Future[Any] = asyncio.get_running_loop().create_future()
        self._asked[self._number] = answer
        try:
            await self._send(json.dumps({"type": kind, "id": self._number, **fields}))
            return await asyncio.wait_for(answer, _WAIT_S)
        except TimeoutError:
            raise DeviceError(f"{kind}: the service did not answer within {_WAIT_S:g} s") from None
        finally:
            self._asked.pop(self._number, None)

    async def acquire(self, takeover: bool = False) -> m.Lease:
        """Ask for the lease on the output."""
        lease: m.Lease = await self.ask("acquire", takeover=takeover)
        return lease

    async def release(self) -> None:
        """Give the lease back; 0 V first."""
        await self.ask("release")

    async def arm(self) -> m.OutputMessage:
        """Let touches be felt."""
        output: m.OutputMessage = await self.ask("arm")
        return output

    async def disarm(self) -> m.OutputMessage:
        """End at 0 V and keep the lease."""
        output: m.OutputMessage = await self.ask("disarm")
        return output

    async def stop(self) -> None:
        """End at 0 V, whoever holds the output."""
        await self.ask("stop")

    async def layout_set(self, document: dict[str, Any]) -> m.LayoutReply:
        """Replace the layout."""
        reply: m.LayoutReply = await self.ask("layout_set", document=document)
        return reply

    async def layout_change(self, *ops: dict[str, Any]) -> m.LayoutReply:
        """Change the layout: all, or nothing."""
        reply: m.LayoutReply = await self.ask("layout_change", ops=list(ops))
        return reply

    async def intensity(self, value: float) -> m.OutputMessage:
        """Set the share of friction that is asked for, 0 to 1."""
        output: m.OutputMessage = await self.ask("intensity", value=value)
        return output

    async def touch(
        self,
        x_mm: float,
        y_mm: float,
        normal_force_n: float | None = None,
        touch_id: int = 0,
        kind: TouchKind = "move",
        t_s: float | None = None,
    ) -> None:
        """Report a touch, at `now_s` unless `t_s` says when."""
        await self.touches(
            [
                m.TouchMessage(
                    t_s=self.now_s() if t_s is None else t_s,
                    touch_id=touch_id,
                    kind=kind,
                    x_mm=x_mm,
                    y_mm=y_mm,
                    normal_force_n=normal_force_n,
                )
            ]
        )

    async def touches(self, touches: list[m.TouchMessage]) -> None:
        """Report many touches in one batch of bytes."""
        self._batch += 1
        await self._send(write_touches(touches, self._batch))

    async def lift(self, touch_id: int = 0, t_s: float | None = None) -> None:
        """Take a finger off."""
        await self.touch(0.0, 0.0, touch_id=touch_id, kind="up", t_s=t_s)

    @staticmethod
    def now_s() -> float:
        """Time of the clock that stamps touches."""
        return time.monotonic()

    async def _send(self, data: str | bytes) -> None:
        if self._ended is not None:
            raise DeviceError(f"the connection to the service is gone: {self._ended}")
        try:
            await self._socket.send(data)
        except WebSocketException as error:
            raise DeviceError(f"the connection to the service is gone: {error}") from None

    async def _read(self) -> None:
        try:
            async for data in self._socket:
                if isinstance(data, bytes):
                    self._tell("frame", read_frame(data))
                else:
                    await self._take(m.read_server(data))
            self._ended = DeviceError(self._socket.close_reason or "it was closed")
        except WebSocketException as error:
            self._ended = error
        finally:
            for answer in self._asked.values():
                if not answer.done():
                    answer.set_exception(DeviceError(f"the service is gone: {self._ended}"))

    async def _take(self, message: Any) -> None:
        if isinstance(message, m.PingMessage):
            pong = {"type": "pong", "n": message.n, "clock_s": self.now_s()}
            await self._send(json.dumps(pong))
            return
        answer = self._asked.get(message.id)
        if answer is None or answer.done():
            self._tell(message.type, message)
        elif isinstance(message, m.Error):
            answer.set_exception(Refused(message))
        else:
            answer.set_result(message)

    def _tell(self, kind: str, event: m.Message | TelemetryFrame) -> None:
        for handler in self._handlers.get(kind, ()):
            handler(event)


async def connect_async(
    name: str, address: str = "", token: str = "", resume: str = ""
) -> AsyncClient:
    """Open a session; see `connect`."""
    if not address or not token:
        found = _found()
        address = address or f"ws://127.0.0.1:{found['port']}/v1/session"
        token = token or str(found["token"])
    try:
        socket = await _connect(
            address,
            subprotocols=[_SUBPROTOCOL],
            proxy=None,
            compression=None,
            ping_interval=None,
        )
    except (OSError, WebSocketException) as error:
        raise DeviceError(f"no service answers at {address}: {error}; start haptix serve") from None
    client = AsyncClient(socket)
    protocol = "{}.{}".format(*m.PROTOCOL)
    try:
        client.welcome = await client.ask(
            "hello", protocol=protocol, client=name, token=token, resume=resume
        )
    except BaseException:
        await client.close()
        raise
    return client


class Client:
    """The plain face of `AsyncClient`: the same calls, without ``await``.

    A thread of its own answers the service's pings, so a program that computes for long stays
    alive. Handlers are called in that thread.
    """

    def __init__(self, name: str, address: str = "", token: str = "", resume: str = "") -> None:
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(
            target=self._loop.run_forever, name="haptix client", daemon=True
        )
        self._thread.start()
        try:
            self._client = self._run(connect_async(name, address, token, resume))
        except BaseException:
            self._end()
            raise
        self.welcome: m.Welcome = self._client.welcome
        self.on, self.now_s = self._client.on, self._client.now_s

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
        call = getattr(self._client, name)

        def plain(*args: Any, **fields: Any) -> Any:
            return self._run(call(*args, **fields))

        return plain

    def close(self) -> None:
        """Leave; an armed output goes to 0 V."""
        if self._thread.is_alive():
            self._run(self._client.close())
            self._end()

    def _run(self, coroutine: Any) -> Any:
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


def _found() -> dict[str, Any]:
    path: Path = service_folder() / "service.json"
    if not path.exists():
        raise DeviceError("no service runs for this user: start haptix serve")
    return read_json(path)
