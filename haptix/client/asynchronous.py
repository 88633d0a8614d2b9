"""The client with ``await``; see `haptix.client`."""

from __future__ import annotations

import asyncio
import json
import logging
from collections.abc import Awaitable, Callable
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple, Self

from haptix.client.layout import ClientLayout
from haptix.client.touching import ReportsTouches
from haptix.errors import DeviceError, HaptixError, from_extra
from haptix.files import read_json
from haptix.service import messages as m
from haptix.service.access import service_folder
from haptix.service.batches import TelemetryFrame, read_frame, write_touches

_LOG = logging.getLogger("haptix.client")

with from_extra("serve"):
    from websockets.asyncio.client import ClientConnection
    from websockets.asyncio.client import connect as _connect
    from websockets.exceptions import WebSocketException
    from websockets.typing import Subprotocol

_SUBPROTOCOL = Subprotocol("haptix.v1")
_WAIT_S, _CLOSE_S = 10.0, 1.0
_FIRST_S, _LAST_S = 0.1, 5.0  # between two attempts to connect again
_KEPT = ("geometry", "subscribe")  # what the service does not keep for who resumes


class LostConnection(NamedTuple):
    """The connection broke; it is tried again, unless `is_final`."""

    reason: str
    is_final: bool


class Refused(HaptixError):
    """The service refused a message; `code` and `path` say what and where."""

    def __init__(self, error: m.Error) -> None:
        place = f" ({error.path})" if error.path else ""
        super().__init__(f"{error.sentence}{place}")
        self.code, self.path = error.code, error.path


class AsyncClient(ReportsTouches[Awaitable[None]]):
    """A session with the service; made by `connect_async`.

    A broken connection is opened again, with the lease and layout where the service kept them, and
    never armed: "lost" and "resumed" tell it, and "closed" that nothing more comes.

    Attributes
    ----------
    welcome : Welcome
        What the service said at first: limits, devices, profiles.
    layout : ClientLayout
        What is felt where, by calls.
    """

    welcome: m.Welcome

    def __init__(self, name: str, find: Callable[[], tuple[str, str]], resume: str = "") -> None:
        self._name, self._find, self._resume = name, find, resume
        self.layout = ClientLayout(self.layout_change)
        self._asked: dict[int, asyncio.Future[Any]] = {}
        self._handlers: dict[str, list[Callable[[Any], None]]] = {}
        self._number = self._batch = 0
        self._kept: dict[str, dict[str, Any]] = {}
        self._watched: set[str] = set()  # jobs
        self._ended = "it was not opened"  # why there is no connection; "" while there is one
        self._closes = False
        self._socket: ClientConnection | None = None
        self._reader: asyncio.Task[None] | None = None
        self._runner: asyncio.Task[None] | None = None

    async def open(self) -> None:
        """Connect and say hello; `connect_async` has done it."""
        await self._open()
        self._runner = asyncio.create_task(self._run())

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
        self._closes = True
        with suppress(DeviceError):
            await self._send(json.dumps({"type": "bye", "id": self._number + 1}))
        if self._socket is not None:
            await self._socket.close()
        if self._runner is not None and self._reader is not None and self._reader.done():
            self._runner.cancel()  # it waits for the next attempt
        tasks = (task for task in (self._reader, self._runner) if task is not None)
        await asyncio.gather(*tasks, return_exceptions=True)

    def on(self, kind: str, handler: Callable[[Any], None]) -> None:
        """Call `handler` with each event of a type: "contact", "output", "frame", "lost" ..."""
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
        number = self._number
        answer: asyncio.Future[Any] = asyncio.get_running_loop().create_future()
        self._asked[number] = answer
        try:
            await self._send(json.dumps({"type": kind, "id": number, **fields}))
            found = await asyncio.wait_for(answer, _WAIT_S)
        except TimeoutError:
            raise DeviceError(f"{kind}: the service did not answer within {_WAIT_S:g} s") from None
        finally:
            self._asked.pop(number, None)
        if kind == "subscribe":  # a stream that is not named stays as it was
            fields = {"streams": self._kept.get(kind, {}).get("streams", {}) | fields["streams"]}
        if kind in _KEPT:
            self._kept[kind] = fields
        if kind == "watch":
            self._watched.add(fields["job"])
        return found

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

    async def touches(self, touches: list[m.TouchMessage]) -> None:
        """Report many touches in one batch of bytes."""
        self._batch += 1
        await self._send(write_touches(touches, self._batch))

    async def watch(self, job: str) -> m.JobMessage:
        """Return how far a job is; `on("job", ...)` is called with its changes until it ends.

        So it is with how far the job is then, after each time that the connection was lost.
        """
        found: m.JobMessage = await self.ask("watch", job=job)
        return found

    async def _open(self) -> None:
        address, token = self._find()
        try:
            socket = await _connect(
                address,
                subprotocols=[_SUBPROTOCOL],
                proxy=None,
                compression=None,
                ping_interval=None,
                close_timeout=_CLOSE_S,
            )
        except (OSError, WebSocketException) as error:
            raise DeviceError(
                f"no service answers at {address}: {error}; start haptix serve"
            ) from None
        self._socket, self._ended = socket, ""
        self._reader = asyncio.create_task(self._read(socket))
        protocol = "{}.{}".format(*m.PROTOCOL)
        try:
            self.welcome = await self.ask(
                "hello", protocol=protocol, client=self._name, token=token, resume=self._resume
            )
            self._resume = self.welcome.resume
            for kind, fields in list(self._kept.items()):
                await self.ask(kind, **fields)
            for job in list(self._watched):
                try:
                    self._tell("job", await self.ask("watch", job=job))  # it may have ended since
                except Refused:  # another service knows none
                    self._watched.discard(job)
        except BaseException:
            self._ended = self._ended or "it could not be opened"
            await socket.close()
            await asyncio.gather(self._reader, return_exceptions=True)
            raise

    async def _run(self) -> None:
        """Connect again when the connection breaks, until `close`."""
        while not self._closes:
            assert self._reader is not None
            await asyncio.gather(self._reader, return_exceptions=True)
            if self._closes:
                break
            _LOG.info("the connection is lost: %s", self._ended)
            self._tell("lost", LostConnection(self._ended, False))
            wait_s = _FIRST_S
            while not self._closes:
                _LOG.info("connects again in %g s", wait_s)
                await asyncio.sleep(wait_s)
                try:
                    await self._open()
                except Refused as error:
                    self._tell("closed", LostConnection(str(error), True))
                    return
                except HaptixError:
                    wait_s = min(2 * wait_s, _LAST_S)
                else:
                    _LOG.info("connected again as session %d", self.welcome.session)
                    self._tell("resumed", self.welcome)
                    break
        self._tell("closed", LostConnection(self._ended or "closed", True))

    def check(self) -> None:
        """Raise `DeviceError` while there is no connection."""
        if self._ended:
            raise DeviceError(f"the connection to the service is gone: {self._ended}")

    async def _send(self, data: str | bytes) -> None:
        self.check()
        assert self._socket is not None
        try:
            await self._socket.send(data)
        except WebSocketException as error:
            raise DeviceError(f"the connection to the service is gone: {error}") from None

    async def _read(self, socket: ClientConnection) -> None:
        silent_s = _WAIT_S
        try:
            while True:
                async with asyncio.timeout(silent_s):
                    data = await socket.recv()
                if isinstance(data, bytes):
                    self._tell("frame", read_frame(data))
                    continue
                message = m.read_server(data)
                if isinstance(message, m.Welcome):
                    silent_s = 3 * message.keep_alive.idle_s  # a service that hangs closes nothing
                await self._take(message)
        except TimeoutError:
            self._ended = f"the service is silent for {silent_s:g} s"
            asyncio.get_running_loop().call_soon(socket.transport.abort)
        except WebSocketException as error:
            self._ended = socket.close_reason or str(error)
        finally:
            self._ended = self._ended or "it was closed"
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

    def _tell(self, kind: str, event: m.Message | TelemetryFrame | LostConnection) -> None:
        for handler in self._handlers.get(kind, ()):
            try:
                handler(event)
            except Exception as error:  # one of the app; pings must be answered nevertheless
                context = {"message": f"the handler of {kind} failed", "exception": error}
                asyncio.get_running_loop().call_exception_handler(context)


async def connect_async(
    name: str, address: str = "", token: str = "", resume: str = ""
) -> AsyncClient:
    """Open a session; see `haptix.client.connect`."""

    def find() -> tuple[str, str]:
        if address and token:
            return address, token
        found = _found()  # at each attempt: a service that was started again has another token
        here = address or f"ws://127.0.0.1:{found['port']}/v1/session"
        return here, token or str(found["token"])

    client = AsyncClient(name, find, resume)
    await client.open()
    return client


def _found() -> dict[str, Any]:
    path: Path = service_folder() / "service.json"
    if not path.exists():
        raise DeviceError("no service runs for this user: start haptix serve")
    return read_json(path)
