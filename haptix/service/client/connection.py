"""A client of `haptix serve`, for programs that render friction under a finger.

::

    with haptix.service.connect("demo") as h:
        h.layout_set({"regions": [...]})
        h.acquire()
        h.arm()
        for t_s, x_mm, y_mm in path:
            h.touch(x_mm, y_mm, t_s=t_s)

Needs the extra ``serve``. `connect_async` gives the same with ``await``.
"""

from __future__ import annotations

import asyncio
import atexit
import json
import logging
import re
import secrets
import threading
import time
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Awaitable, Callable, Coroutine
from concurrent.futures import Future
from contextlib import suppress
from hashlib import sha256
from numbers import Integral, Real
from pathlib import Path
from typing import Annotated, Any, Generic, Literal, NamedTuple, Self, TypeVar
from urllib.error import HTTPError
from urllib.request import ProxyHandler, Request, build_opener

from pydantic import BaseModel, Field, ValidationError

from haptix.base.errors import DeviceError, HaptixError, InputError, from_extra
from haptix.base.files import read_json, write_whole
from haptix.service.client.calls import (
    AsyncCalls,
    ClientLayout,
    ClientRegion,
    Document,
    PlainCalls,
    PlainLayout,
    PlainRegion,
    given,
)
from haptix.service.protocol import messages as m
from haptix.service.protocol.batches import TelemetryFrame, read_frame, write_touches
from haptix.service.protocol.limiter import Limiter, service_folder
from haptix.service.protocol.messages import reading

with from_extra("serve"):
    from websockets.asyncio.client import ClientConnection
    from websockets.asyncio.client import connect as _connect
    from websockets.exceptions import InvalidStatus, InvalidURI, WebSocketException
    from websockets.typing import Subprotocol

_LOG = logging.getLogger("haptix.service.client.connection")
_WORD_BYTES, _WORD = 16, re.compile(r"[\w-]{22}", re.ASCII)  # as base64
_SUBPROTOCOL = Subprotocol("haptix.v1")
# The service gives up a request after 20 s, with an error.
_WAIT_S, _CLOSE_S, _FILE_S = 25.0, 1.0, 60.0
_STOP_S = 1.0  # for STOP on its own path
_FIRST_S, _LAST_S = 0.1, 5.0  # between two attempts to connect again
# Of the token: a service that begins opens its port before it writes the new one.
_MOST_REFUSALS = 4
_REPLAYED = ("geometry", "subscribe")  # sent again on resuming: the service does not keep them
_CLOSED = "this client is closed; connect again"
_FELT = "felt"  # name of the region that `feel` makes
_MOST_SENDING = 64  # batches that are not sent yet; above this, a touch waits

TouchKind = Literal["down", "move", "up"]
Sent = TypeVar("Sent", covariant=True)
Result = TypeVar("Result")


class ReportsTouches(ABC, Generic[Sent]):
    """Touches in millimetres; `Sent` is the type that a client returns for a batch."""

    @abstractmethod
    def touches(self, touches: list[m.TouchMessage]) -> Sent:
        """Report many touches in one batch of bytes."""

    def touch(
        self,
        x_mm: float,
        y_mm: float,
        normal_force_n: float | None = None,
        touch_id: int = 0,
        kind: TouchKind = "move",
        t_s: float | None = None,
    ) -> Sent:
        """Report a touch, at `now_s` unless `t_s` is given.

        Parameters
        ----------
        x_mm, y_mm : float
        normal_force_n : float, optional
            Normal force [N], if measured.
        touch_id : int
        kind : str
            "down", "move" or "up".
        t_s : float, optional
            Time of the session [s]; `now_s` if not given.

        Raises
        ------
        InputError
            If no finger makes such a touch.
        """
        stamp_s = self.now_s() if t_s is None else t_s
        try:
            touch = m.TouchMessage(
                t_s=stamp_s,
                touch_id=touch_id,
                kind=kind,
                x_mm=x_mm,
                y_mm=y_mm,
                normal_force_n=normal_force_n,
            )
        except ValidationError as error:
            wrong = error.errors(include_url=False)[0]
            name, why = wrong["loc"][0], wrong["msg"].lower()
            raise InputError(f"touch: {name}: {why}, got {wrong['input']!r:.80}") from None
        return self.touches([touch])

    def lift(self, touch_id: int = 0, t_s: float | None = None) -> Sent:
        """Take a finger off.

        Parameters
        ----------
        touch_id : int
        t_s : float, optional
            Time of the session [s]; `now_s` if not given.
        """
        return self.touch(0.0, 0.0, touch_id=touch_id, kind="up", t_s=t_s)

    @staticmethod
    def now_s() -> float:
        """Time of the clock that stamps touches."""
        return time.monotonic()


def _document(value: object) -> Any:
    if isinstance(value, BaseModel):
        return value.model_dump(mode="json", exclude_none=True)
    if isinstance(value, Integral):  # one of numpy
        return int(value)
    if isinstance(value, Real):
        return float(value)
    raise InputError(f"expected a material or a document of JSON, got {type(value).__name__}")


def _text(kind: str, message: dict[str, Any]) -> str:
    try:
        return json.dumps(message, default=_document, allow_nan=False)
    except HaptixError as error:  # of `_document`
        raise InputError(f"{kind}: {error}") from None
    except ValueError as error:
        raise InputError(
            f"{kind}: expected finite numbers, got one that is none: {error}"
        ) from None


class LostConnection(NamedTuple):
    """The connection broke; the client connects again, unless `is_final`.

    Parameters
    ----------
    reason : str
        Why it broke.
    is_final : bool
        Whether the client gives up.
    """

    reason: str
    is_final: bool


class Refused(HaptixError):
    """The service refused a message; `code` and `path` name the error and its place."""

    def __init__(self, error: m.Error) -> None:
        place = f" ({error.path})" if error.path else ""
        super().__init__(f"{error.sentence}{place}")
        self.code, self.path = error.code, error.path


class Lost(DeviceError):
    """The connection to the service is gone, or no answer came."""


class AsyncClient(ReportsTouches[Awaitable[None]], AsyncCalls):
    """A session with the service; made by `connect_async`.

    A broken connection is opened again, with the lease and layout if the service kept them, but not
    armed, except that `feel` arms a virtual driver again. The events "lost" and "resumed" report
    it; "closed" is the last event.

    Parameters
    ----------
    name : str
        Name of the app, for others to see.
    find : callable
        Returns the service's address and token.

    Attributes
    ----------
    welcome : Welcome
        First message of the service: limits, devices, profiles.
    lease : Lease
        Who holds the output, by the last message.
    output : OutputMessage
        State of the output, by the last message.
    layout : ClientLayout
        Calls that change the layout.
    """

    welcome: m.Welcome
    lease: m.Lease
    output: m.OutputMessage

    def __init__(self, name: str, find: Callable[[], tuple[str, str]]) -> None:
        self._name, self._find, self._resume = name, find, ""
        self.stop_port: int | None = None  # of the service of this machine
        self._app = _word_of(name)
        self._felt: Document | None = None  # what `feel` shows
        self._on: dict[tuple[int, str], m.ContactMessage] = {}  # the last of each region
        self.layout = ClientLayout(self)
        self._pending: dict[int, asyncio.Future[Any]] = {}
        self._handlers: dict[str, list[Callable[[Any], None]]] = {}
        self._number = self._batch = 0
        limits = m.Limits()
        self._batches = Limiter(limits.batches_per_s, self.now_s, _MOST_SENDING)
        self._touches = Limiter(limits.touches_per_s, self.now_s, limits.batch_touches)
        self._in_order = asyncio.Lock()  # first come, first served
        self._replayed: dict[str, dict[str, Any]] = {}
        self._watched: set[str] = set()  # jobs
        self._ended = "it was not opened"  # why there is no connection; "" while there is one
        self._is_closing = False
        self._socket: ClientConnection | None = None
        self._reader: asyncio.Task[None] | None = None
        self._runner: asyncio.Task[None] | None = None

    async def open(self) -> None:
        """Connect and send hello; `connect_async` does it for you."""
        await self._open()
        self._runner = asyncio.create_task(self._run())

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()

    async def close(self) -> None:
        """Leave; an armed output goes to 0 V, and the lease is free."""
        self._is_closing = True
        with suppress(DeviceError):
            await self._send(json.dumps({"type": "bye", "id": self._number + 1}))
        if self._socket is not None:
            await self._socket.close()
        if self._runner is not None and self._reader is not None and self._reader.done():
            self._runner.cancel()  # it waits for the next attempt
        tasks = (task for task in (self._reader, self._runner) if task is not None)
        await asyncio.gather(*tasks, return_exceptions=True)

    def on(self, kind: str, handler: Callable[[Any], None]) -> Callable[[], None]:
        """Call `handler` with each event of a type: "contact", "output", "frame", "lost" ...

        Parameters
        ----------
        kind : str
            The type of event, such as "contact", "output", "frame" or "lost".
        handler : callable
            Takes the event.

        Returns
        -------
        callable
            Removes the handler.
        """
        handlers = self._handlers.setdefault(kind, [])
        handlers.append(handler)
        return lambda: handlers.remove(handler)

    async def stop(self) -> m.Done:
        """End at 0 V, whoever holds the output; the holder keeps the lease."""
        if self.stop_port is None:
            return await super().stop()
        pressing = asyncio.create_task(asyncio.to_thread(_press_stop, self.stop_port))
        try:
            return await super().stop()
        finally:
            await pressing  # it must not stop the output that is armed next

    async def ask(self, kind: str, **fields: Any) -> Any:
        """Send a message and return its answer; fields that are None are left out.

        Raises `Refused` if the service refuses it; `Lost` if the connection is gone, or no answer
        came within 25 s.
        """
        self._number += 1
        number = self._number
        answer: asyncio.Future[Any] = asyncio.get_running_loop().create_future()
        self._pending[number] = answer
        try:
            message = {"type": kind, "id": number, **given(**fields)}
            await self._send(_text(kind, message))
            reply = await asyncio.wait_for(answer, _WAIT_S)
        except TimeoutError:
            raise Lost(f"{kind}: the service did not answer within {_WAIT_S:g} s") from None
        finally:
            self._pending.pop(number, None)
        if kind == "subscribe":  # a stream that is not named stays as it was
            fields = {
                "streams": self._replayed.get(kind, {}).get("streams", {}) | fields["streams"]
            }
        if kind in _REPLAYED:
            self._replayed[kind] = fields
        if kind == "layout_set":
            self._felt = None  # a layout of the app's own
        if kind == "watch":
            self._watched.add(fields["job"])
        return reply

    async def feel(self, material: Document, *, person_asked: bool = False) -> ClientRegion:
        """Fill the screen with a material and arm: all that it takes to feel one.

        The layout before is replaced. After a lost connection it is felt again, where it was felt
        until then: the layout as it was changed since, or on a service that was begun anew this
        material, with intensity, mute and pause as they were. A virtual driver is armed by itself;
        after `stop`, `release` or a layout of the app's own nothing is.

        Parameters
        ----------
        material : Material or dict
            One of `haptix.feel` that names no files, or its document.
        person_asked : bool
            Whether a person has asked for the voltage of a real driver, which is not armed
            otherwise. A virtual one always is.

        Returns
        -------
        ClientRegion
            The region, with this client as its `session`.

        Raises
        ------
        Refused
            If the material is none, or another app holds the output.
        """
        await self._feel(material, None)
        if person_asked:
            await self.arm()
        else:
            await self._arm_virtual()
        return ClientRegion(self, _FELT)

    async def _feel(self, material: Document, before: m.OutputMessage | None) -> None:
        await self.acquire()
        width_mm, height_mm = self.welcome.inventory.screen_mm
        place = {"x_mm": 0.0, "y_mm": 0.0, "width_mm": width_mm, "height_mm": height_mm}
        region = {"name": _FELT, "material": material, **place}
        await self.layout_set({"regions": [region]})
        self._felt = material
        if before is not None:
            await self.intensity(before.intensity)
            await self.mute(before.muted)
            await self.pause(before.paused)

    async def _arm_virtual(self) -> None:
        if any(one.is_real for one in self.welcome.inventory.devices):
            _LOG.warning("the driver is real: call `arm` once a person asks for its voltage")
        else:
            await self.arm()

    async def _feel_again(self, before: m.OutputMessage) -> None:
        """Arm again what was felt before the connection was lost."""
        assert self._felt is not None
        try:
            if not self.welcome.lease.is_mine:  # a service that was begun anew: it has no layout
                await self._feel(self._felt, before)
            await self._arm_virtual()
        except HaptixError as error:
            _LOG.warning("nothing is felt after the lost connection: %s", error)

    async def asset(self, path: str | Path) -> str:
        """Send a file that materials read; return ``sha256:...``, as a document calls it.

        Raises
        ------
        Refused
            If it is too large, or of a kind that nothing reads.
        """
        return await asyncio.to_thread(self._send_file, Path(path))

    def _send_file(self, path: Path) -> str:
        address, token = self._find()
        content = path.read_bytes()
        most = self.welcome.limits.asset_bytes
        if len(content) > most:  # the service would close the connection in the midst of the file
            has = f"{path.name} has {len(content)} bytes"
            why = f"{has}; expected at most {most}: send a smaller file"
            raise Refused(m.Error(id=0, code="limit", sentence=why))
        digest = sha256(content).hexdigest()
        base = address.removesuffix("/v1/session").replace("ws", "http", 1)
        request = Request(
            f"{base}/v1/assets/{digest}?suffix={path.suffix.lower()}",
            content,
            {"authorization": f"Bearer {token}"},
            method="PUT",
        )
        try:
            with build_opener(ProxyHandler({})).open(request, timeout=_FILE_S):
                return f"sha256:{digest}"
        except HTTPError as error:
            raise Refused(m.Error.model_validate_json(error.read())) from None
        except OSError as error:
            raise Lost(f"the service does not take {path.name}: {error}") from None

    async def touches(self, touches: list[m.TouchMessage]) -> None:
        """Report many touches in one batch of bytes.

        Touches that come faster than the service takes them wait; other messages overtake them.
        """
        self.check()
        most = self.welcome.limits.batch_touches
        async with self._in_order:
            for at in range(0, len(touches), most):
                some = touches[at : at + most]
                wait_s = max(self._batches.wait_s(), self._touches.wait_s(len(some)))
                if wait_s > 0:
                    await asyncio.sleep(wait_s)
                self._batch += 1
                await self._send(write_touches(some, self._batch))

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
        except InvalidURI:
            raise InputError(
                f"address: expected ws://HOST:PORT/v1/session, got {address!r}"
            ) from None
        except InvalidStatus as error:
            raise Lost(f"the service at {address} refuses the connection: {error}") from None
        except (OSError, WebSocketException) as error:
            raise Lost(f"no service answers at {address}: {error}; start haptix serve") from None
        self._socket, self._ended = socket, ""
        self._reader = asyncio.create_task(self._read(socket))
        protocol = "{}.{}".format(*m.PROTOCOL)
        try:
            self.welcome = await self.ask(
                "hello",
                protocol=protocol,
                client=self._name,
                token=token,
                resume=self._resume,
                app=self._app,
            )
            self._resume = self.welcome.resume
            for kind, fields in list(self._replayed.items()):
                await self.ask(kind, **fields)
            for job in list(self._watched):
                try:
                    self._emit("job", await self.ask("watch", job=job))  # it may have ended since
                except Refused:  # another service knows none
                    self._watched.discard(job)
        except BaseException:
            self._ended = self._ended or "it could not be opened"
            await socket.close()
            await asyncio.gather(self._reader, return_exceptions=True)
            raise

    async def _run(self) -> None:
        """Connect again when the connection breaks, until `close`."""
        while not self._is_closing:
            assert self._reader is not None
            await asyncio.gather(self._reader, return_exceptions=True)
            if self._is_closing:
                break
            _LOG.info("the connection is lost: %s", self._ended)
            was_felt = self._felt is not None and self.lease.is_mine and self.output.state != "off"
            before = self.output
            self._emit("lost", LostConnection(self._ended, False))
            wait_s, refusals = _FIRST_S, 0
            while not self._is_closing:
                _LOG.info("connects again in %g s", wait_s)
                await asyncio.sleep(wait_s)
                try:
                    await self._open()
                except HaptixError as error:
                    refusals += isinstance(error, Refused)
                    if isinstance(error, Refused) and (
                        error.code != "access" or refusals == _MOST_REFUSALS
                    ):
                        self._emit("closed", LostConnection(str(error), True))
                        return
                    wait_s = min(2 * wait_s, _LAST_S)
                else:
                    _LOG.info("connected again as session %d", self.welcome.session)
                    if was_felt:
                        await self._feel_again(before)
                    self._emit("resumed", self.welcome)
                    break
        self._emit("closed", LostConnection(self._ended or "closed", True))

    def check(self) -> None:
        """Raise `Lost` while there is no connection."""
        if self._is_closing and self._ended:
            raise Lost(_CLOSED)
        if self._ended:
            raise Lost(f"the connection to the service is gone: {self._ended}")

    async def _send(self, data: str | bytes) -> None:
        self.check()
        assert self._socket is not None
        try:
            await self._socket.send(data)
        except WebSocketException:
            why = self._socket.close_reason or "it broke off"
            raise Lost(f"the connection to the service is gone: {why}") from None

    async def _read(self, socket: ClientConnection) -> None:
        silent_s = _WAIT_S
        try:
            while True:
                async with asyncio.timeout(silent_s):
                    data = await socket.recv()
                if isinstance(data, bytes):
                    self._emit("frame", read_frame(data))
                    continue
                message = reading.read_server(data)
                if isinstance(message, m.Welcome):
                    silent_s = 3 * message.keep_alive.idle_s  # a service that hangs closes nothing
                await self._take(message)
        except TimeoutError:
            self._ended = f"the service is silent for {silent_s:g} s"
            asyncio.get_running_loop().call_soon(socket.transport.abort)
        except WebSocketException:
            self._ended = socket.close_reason or "it broke off"
        finally:
            self._ended = self._ended or "it was closed"
            self._leave_all()
            for answer in self._pending.values():
                if not answer.done():
                    answer.set_exception(Lost(f"the service is gone: {self._ended}"))

    async def _take(self, message: Any) -> None:
        if isinstance(message, m.PingMessage):
            pong = {"type": "pong", "n": message.n, "clock_s": self.now_s()}
            await self._send(json.dumps(pong))
            return
        if isinstance(message, m.Welcome):
            self.lease, self.output = message.lease, message.output
        elif isinstance(message, m.Lease):
            self.lease = message
        elif isinstance(message, m.OutputMessage):
            self.output = message
        answer = self._pending.get(message.id)
        if answer is None or answer.done():
            self._emit(message.type, message)
        elif isinstance(message, m.Error):
            answer.set_exception(Refused(message))
        else:
            answer.set_result(message)

    def _leave_all(self) -> None:
        """Report that fingers are on no region any more: nothing arrives over a lost connection."""
        on, self._on = self._on, {}
        for contact in on.values():
            for event in ("release", "leave") if contact.event == "press" else ("leave",):
                ends = {"event": event, "t_s": self.now_s(), "value": None}
                self._emit("contact", contact.model_copy(update=ends))

    def _emit(self, kind: str, event: m.Message | TelemetryFrame | LostConnection) -> None:
        if isinstance(event, m.ContactMessage) and event.event != "detent":
            self._on[event.touch_id, event.region] = event
            if event.event == "leave":
                del self._on[event.touch_id, event.region]
        for handler in tuple(self._handlers.get(kind, ())):
            try:
                handler(event)
            except Exception as error:  # one of the app; pings must be answered nevertheless
                context = {"message": f"the handler of {kind} failed", "exception": error}
                asyncio.get_running_loop().call_exception_handler(context)


async def connect_async(name: str, address: str = "", token: str = "") -> AsyncClient:
    """Open a session; see `haptix.service.connect`.

    Parameters
    ----------
    name, address, token : str
        As in `haptix.service.connect`.
    """

    def find() -> tuple[str, str]:
        if address and token:
            return address, token
        entry = _service_file()  # at each attempt: a restarted service has another token
        client.stop_port = None if address else entry.stop_port
        return address or entry.url, token or entry.token

    client = AsyncClient(name, find)
    await client.open()
    return client


class ServiceEntry(BaseModel):
    """Where the service of this user is, as its file ``service.json`` has it."""

    url: Annotated[str, Field(pattern=r"^wss?://")]
    token: Annotated[str, Field(pattern=r"^[\w-]+$")]
    stop_port: Annotated[int, Field(ge=1, le=65535)] | None = None


def _press_stop(port: int) -> None:
    """STOP, on the path that no other client can crowd."""
    request = Request(f"http://127.0.0.1:{port}/stop", method="POST")
    with suppress(OSError), build_opener(ProxyHandler({})).open(request, timeout=_STOP_S):
        pass


def _service_file() -> ServiceEntry:
    path: Path = service_folder() / "service.json"
    if not path.exists():
        raise Lost("no service runs for this user: start haptix serve")
    try:
        return ServiceEntry.model_validate(read_json(path))
    except (HaptixError, ValidationError):
        raise Lost(f"{path} is damaged: start haptix serve again, which writes it anew") from None


def _word_of(name: str) -> str:
    """Return the word by which the service knows an app again that crashed."""
    path = service_folder() / "apps" / sha256(name.encode()).hexdigest()
    try:
        word = path.read_text("ascii", "replace") if path.exists() else ""
        if not _WORD.fullmatch(word):  # none yet, or a damaged one
            path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
            write_whole(path, word := secrets.token_urlsafe(_WORD_BYTES), is_secret=True)
        return word
    except (OSError, HaptixError) as error:
        _LOG.warning("after a crash the output is refused for 30 s: %s", error)
        return ""


class Client(ReportsTouches[None], PlainCalls):
    """The blocking form of `AsyncClient`: the same calls, without ``await``.

    A thread of its own answers the service's pings, so a program that computes for long stays
    alive. Handlers are called in that thread, where this client cannot be used. `touches` does not
    wait until they are sent.

    Parameters
    ----------
    name, address, token : str
        As in `haptix.service.connect`.
    """

    def __init__(self, name: str, address: str = "", token: str = "") -> None:
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(
            target=self._loop.run_forever, name="haptix client", daemon=True
        )
        self._thread.start()
        try:
            self._client: AsyncClient = self._run(connect_async(name, address, token))
        except BaseException:
            self._end()
            raise
        self.on = self._client.on
        self.layout = PlainLayout(self)
        self._sending: deque[Future[None]] = deque()
        atexit.register(self.close)  # else the lease stays with a program that ends without it

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def ask(self, kind: str, **fields: Any) -> Any:
        """Send a message and return its answer; see `AsyncClient.ask`."""
        return self._run(self._client.ask(kind, **fields))

    def stop(self) -> m.Done:
        """End at 0 V, whoever holds the output; the holder keeps the lease."""
        return self._run(self._client.stop())

    def feel(self, material: Document, *, person_asked: bool = False) -> PlainRegion:
        """Fill the screen with a material and arm; see `AsyncClient.feel`.

        Parameters
        ----------
        material : Material or dict
        person_asked : bool
            Whether a person has asked for the voltage of a real driver.
        """
        region = self._run(self._client.feel(material, person_asked=person_asked))
        return PlainRegion(self, region.name)

    def asset(self, path: str | Path) -> str:
        """Send a file that materials read; return ``sha256:...``, as a document calls it."""
        return self._run(self._client.asset(path))

    @property
    def welcome(self) -> m.Welcome:
        """First message of the service: limits, devices, profiles."""
        return self._client.welcome

    @property
    def lease(self) -> m.Lease:
        """Who holds the output, by the last message."""
        return self._client.lease

    @property
    def output(self) -> m.OutputMessage:
        """State of the output, by the last message."""
        return self._client.output

    def touches(self, touches: list[m.TouchMessage]) -> None:
        """Report many touches in one batch of bytes.

        Raises
        ------
        DeviceError
            If the connection is gone.
        """
        self._client.check()
        sending = asyncio.run_coroutine_threadsafe(self._client.touches(touches), self._loop)
        self._sending.append(sending)
        while self._sending and (self._sending[0].done() or len(self._sending) > _MOST_SENDING):
            self._sending.popleft().result()

    def close(self) -> None:
        """Leave; an armed output goes to 0 V. A program that ends leaves, too."""
        atexit.unregister(self.close)
        if self._thread.is_alive():
            self._run(self._client.close())
            self._end()

    def _run(self, coroutine: Coroutine[Any, Any, Result]) -> Result:
        if threading.current_thread() is self._thread:
            coroutine.close()
            raise InputError("a handler cannot wait for the service: use connect_async, or a queue")
        if self._loop.is_closed():
            coroutine.close()
            raise Lost(_CLOSED)
        future: Future[Result] = asyncio.run_coroutine_threadsafe(coroutine, self._loop)
        return future.result()

    def _end(self) -> None:
        async def leave_out() -> None:  # touches that still wait
            others = asyncio.all_tasks() - {asyncio.current_task()}
            for task in others:
                task.cancel()
            await asyncio.gather(*others, return_exceptions=True)

        asyncio.run_coroutine_threadsafe(leave_out(), self._loop).result()
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()


def connect(name: str, address: str = "", token: str = "") -> Client:
    """Open a session with the service of this machine.

    A program that crashed and is started again under its name has its lease back at once.

    Parameters
    ----------
    name : str
        Name of this program in the list of sessions.
    address, token : str
        Address and access token of the service; by default those in ``service.json``.

    Raises
    ------
    DeviceError
        If no service runs.
    Refused
        If the service does not admit this client.
    """
    return Client(name, address, token)


def feel(material: Document, name: str = "feel", *, person_asked: bool = False) -> PlainRegion:
    """Open a session and fill the screen with a material: a felt texture in one call.

    Parameters
    ----------
    material : Material or dict
        One of `haptix.feel` that names no files, or its document.
    name : str
        Name of this program in the list of sessions.
    person_asked : bool
        Whether a person has asked for the voltage of a real driver, which is not armed otherwise.

    Returns
    -------
    PlainRegion
        The region; its `session` is the `Client`. Nothing is felt any more once the program ends.

    Raises
    ------
    DeviceError
        If no service runs.
    Refused
        If the material is none, or another app holds the output.
    """
    client = connect(name)
    try:
        return client.feel(material, person_asked=person_asked)
    except BaseException:
        client.close()
        raise
