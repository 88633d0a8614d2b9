"""The HTTP server's connections: their number, and the sessions on their sockets.

A new connection is always accepted: the one that needs its place least is closed for it. So idle
and half-open connections, however many, cannot block STOP. STOP also has a port, a thread and a
crowd of its own (`StopPath`), which can do nothing but stop.

So it is where asyncio calls `accept` and `recv` of a socket. On Windows it does not: there a
request is refused with 503 while as many connections are open, and sessions are not read piece by
piece.

A session's socket is read, written and answered in turn until either side closes it:

    socket --_reads--> ahead --_takes, at the client's rate--> hub --answer_in_turn--> engine
              +--stop, at once--> hub

The reader always reads, so that a stop does not wait for the client's earlier messages. Messages
above the client's rate wait in `ahead`; those that do not fit there are refused. A client that
sends faster than the reader reads is disconnected, at 0 V, because its stop would come too late.
"""

from __future__ import annotations

import asyncio
import logging
import re
import socket
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import suppress
from functools import partial
from types import FrameType
from typing import Any

import uvicorn
from fastapi import WebSocket
from starlette.websockets import WebSocketDisconnect

from haptix.service.front.access import listens
from haptix.service.front.client_session import ServiceSession
from haptix.service.front.hub import Hub
from haptix.service.protocol import messages as m
from haptix.service.protocol.batches import COLUMNS
from haptix.service.protocol.messages import MOST_TEXT_BYTES, Problem, reading

MOST_CONNECTIONS, MOST_OF_PEER = 256, 192
_FILES = 1024  # that the process may have open; some systems grant 256 until asked
_AT_ONCE, _WAITING = 24, 4096  # newcomers taken in one turn of the loop, and waiting for it
_READ_BYTES, _SESSION_BYTES = 16 * 1024, 4 * 1024
"""Of a connection in one turn of the loop, then others have theirs. A session's messages may be of
30 bytes, and another session's STOP takes four turns: with 4 KiB of them a turn takes 2 ms."""


class Connection(socket.socket):
    """A connection that was accepted. asyncio reads it piece by piece, others in between."""

    def __init__(self, fileno: int, peer: tuple[str, int], crowd: Crowd) -> None:
        super().__init__(fileno=fileno)
        self.peer, self._crowd = peer, crowd
        self.scope: Any = None  # of the request under way
        self._since_s = 0.0

    @property
    def _most_bytes(self) -> int:
        return _SESSION_BYTES if self._is_session else _READ_BYTES

    @property
    def _is_session(self) -> bool:
        return self.scope is not None and self.scope["type"] == "websocket"

    def recv(self, size: int, flags: int = 0, /) -> bytes:
        """Read a piece."""
        data = super().recv(min(size, self._most_bytes), flags)
        self._note(len(data))
        return data

    def recv_into(self, buffer: Any, size: int = 0, flags: int = 0) -> int:
        """Read a piece, as TLS does."""
        count = super().recv_into(buffer, min(size or len(buffer), self._most_bytes), flags)
        self._note(count)
        return count

    def _note(self, count: int) -> None:
        self._crowd.heard(self)
        now_s = time.monotonic()
        if count < self._most_bytes or not self._is_session:  # else more has come already
            self._since_s = now_s
        elif (session := self.scope["state"].get("session")) is not None:
            session.behind_s = now_s - self._since_s

    def close(self) -> None:
        """Close it."""
        self._crowd.remove(self)
        super().close()

    def end(self) -> None:
        """End it at once; asyncio closes it then."""
        self._crowd.remove(self)
        with suppress(OSError):
            self.shutdown(socket.SHUT_RDWR)

    def rank(self) -> int:
        """How much it needs its place."""
        state = self.scope["state"] if self.scope is not None else {}
        session = state.get("session")
        if session is not None:
            return 2 if session.is_welcome and session.closing is None else 0
        return 1 if "owner" in state else 0


class Listener(socket.socket):
    """A listening socket that accepts the newest connections of more than one turn can take.

    Older ones would be closed for the newest a moment later, at ten times the cost.
    """

    def __init__(self, fileno: int, crowd: Crowd) -> None:
        super().__init__(fileno=fileno)
        self._crowd = crowd
        self._newcomers: deque[tuple[socket.socket, Any]] = deque()

    def accept(self) -> tuple[socket.socket, Any]:
        """Return the next connection."""
        if not self._newcomers:
            self._newcomers = deque(self._drain(), _AT_ONCE)
        if not self._newcomers:
            raise BlockingIOError
        accepted, address = self._newcomers.popleft()
        connection = Connection(accepted.detach(), address[:2], self._crowd)
        self._crowd.add(connection)
        return connection, address

    def _drain(self) -> Iterator[tuple[socket.socket, Any]]:
        taken: deque[socket.socket] = deque()
        with suppress(BlockingIOError):
            for _ in range(_WAITING):
                newcomer = super().accept()
                taken.append(newcomer[0])
                if len(taken) > _AT_ONCE:
                    taken.popleft().close()
                yield newcomer


class Crowd:
    """All connections, the one that was quiet for longest first."""

    def __init__(self) -> None:
        self.connections: dict[tuple[str, int], Connection] = {}

    def add(self, newcomer: Connection) -> None:
        """Take a connection, and end another where there are too many."""
        known = [*self.connections.values()]
        same = [one for one in known if one.peer[0] == newcomer.peer[0]]
        if len(same) >= MOST_OF_PEER:
            min(same, key=Connection.rank).end()
        elif len(known) >= MOST_CONNECTIONS:
            min(known, key=Connection.rank).end()
        self.connections[newcomer.peer] = newcomer

    def heard(self, connection: Connection) -> None:
        """Note that it was not quiet."""
        if self.connections.pop(connection.peer, None) is not None:
            self.connections[connection.peer] = connection

    def remove(self, connection: Connection) -> None:
        """Forget a connection that is closed."""
        if self.connections.get(connection.peer) is connection:
            del self.connections[connection.peer]

    async def serve(self, app: Any, scope: Any, receive: Any, send: Any) -> None:
        """Let an application answer, and note what it is about."""
        connection = self.connections.get(tuple(scope.get("client") or ()))
        if connection is None:
            await app(scope, receive, send)
            return
        connection.scope = scope
        try:
            await app(scope, receive, send)
        finally:
            if scope["type"] == "websocket":  # a client that is disconnected may go on sending
                asyncio.get_running_loop().call_later(1.0, connection.end)
            connection.scope = None


class HttpServer(uvicorn.Server):
    """A server whose connections are bounded.

    Parameters
    ----------
    app : ASGI application
        What `haptix.service.front.application.application` returns.
    end : callable
        Called by a signal to end, before it closes its clients' connections.
    **options
        Of `uvicorn.Config`.
    """

    def __init__(self, app: Any, end: Callable[[], None] = lambda: None, **options: Any) -> None:
        self._end, self.crowd = end, Crowd()
        super().__init__(
            uvicorn.Config(
                partial(self.crowd.serve, app),
                interface="asgi3",
                http="h11",
                log_level="critical",  # the client gets its own error
                backlog=_AT_ONCE,
                limit_concurrency=MOST_CONNECTIONS if sys.platform == "win32" else None,
                proxy_headers=False,  # the crowd knows connections by their own addresses
                ws_max_size=4 * MOST_TEXT_BYTES,  # too long is an error, and closes nothing
                ws_per_message_deflate=False,  # work for bytes that leave no machine
                ws_ping_interval=None,  # the session's own pings show that the script lives
                timeout_graceful_shutdown=2,
                server_header=False,
                **{"ws": "websockets-sansio", **options},
            )
        )

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Listen."""
        with suppress(ImportError, ValueError, OSError):
            import resource

            soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
            resource.setrlimit(resource.RLIMIT_NOFILE, (max(soft, min(_FILES, hard)), hard))
        listeners = [Listener(socket.detach(), self.crowd) for socket in sockets or ()]
        await super().startup([*listeners])
        for listener in listeners:
            listener.listen(_WAITING)

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        """Take a signal to end."""
        self._end()
        super().handle_exit(sig, frame)


class StopPath:
    """A port of this machine that can do nothing but stop: nothing else waits on it or crowds it.

    Its thread asks the service's own loop to stop. Where that does not come to it in 0.1 s, the
    engine goes to 0 V by itself.

    Parameters
    ----------
    stop : callable
        Stops; called in the loop that runs when this is made.
    """

    def __init__(self, stop: Callable[[str], None]) -> None:
        self._stop, self._loop = stop, asyncio.get_running_loop()
        listener = listens("127.0.0.1", 0)
        self.port: int = listener.getsockname()[1]
        self._server = HttpServer(self._answer, lifespan="off", ws="none")
        self._thread = threading.Thread(
            target=self._server.run, args=([listener],), name="stop", daemon=True
        )
        self._thread.start()

    def close(self) -> None:
        """End."""
        self._server.should_exit = True
        self._thread.join()

    async def _answer(self, scope: Any, receive: Any, send: Any) -> None:
        headers = dict(scope["headers"])
        hosts = (f"127.0.0.1:{self.port}".encode(), f"localhost:{self.port}".encode())
        status = 204
        if (scope["method"], scope["path"]) != ("POST", "/stop"):
            status = 404
        elif headers.get(b"host") not in hosts:  # DNS rebinding
            status = 421
        elif headers.get(b"sec-fetch-site") == b"cross-site":
            status = 403
        else:
            done: Future[None] = Future()
            self._loop.call_soon_threadsafe(self._stops, done)
            await asyncio.wrap_future(done)
        fields = [(b"access-control-allow-origin", b"*"), (b"connection", b"close")]
        await send({"type": "http.response.start", "status": status, "headers": fields})
        await send({"type": "http.response.body"})

    def _stops(self, done: Future[None]) -> None:
        self._stop("stopped by the button")
        done.set_result(None)


_LOG = logging.getLogger("haptix.service")

_GATHER_S = 0.005
"""Batches that come closer to each other are passed on together: each pass costs the front, the
engine and the virtual finger a turn. A batch that comes later than that is passed on at once."""
_MOST_AHEAD, _MOST_AHEAD_BYTES = 1000, 4 * 2**20
_EVERY = 256  # messages read, others have a turn
_LONGEST_BEHIND_S = 0.03  # bytes read at most; a stop behind more would take over 50 ms
_STOP = re.compile(r'"type"\s*:\s*"stop"')
_TURNS_S = 0.0005  # lets the loop read arrived messages


async def serve_session(hub: Hub, socket: WebSocket, client: ServiceSession) -> None:
    """Serve one session until it closes, by whichever side."""
    tasks = [
        asyncio.create_task(part)
        for part in (
            _reads(hub, socket, client),
            _writes(socket, client),
            _takes(hub, client),
            answer_in_turn(hub, client),
        )
    ]
    try:
        await asyncio.wait(tasks[:2], return_when=asyncio.FIRST_COMPLETED)
    finally:
        hub.closed(client)
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


async def _reads(hub: Hub, socket: WebSocket, client: ServiceSession) -> None:
    read = 0
    with suppress(WebSocketDisconnect):
        while client.closing is None:
            message = await socket.receive()
            if message["type"] == "websocket.disconnect":
                return
            text = message.get("text")
            data = message["bytes"] if text is None else text
            read += 1
            client.ahead_bytes += len(data)
            if is_stop := text is not None and _is_stop(text):
                hub.receive(client, data)
            elif len(client.ahead) < _MOST_AHEAD and client.ahead_bytes <= _MOST_AHEAD_BYTES:
                client.ahead.append(data)
                client.has_ahead.set()
                data = ""
            else:
                client.refuse_flood(_MOST_AHEAD)
                if client.behind_s > _LONGEST_BEHIND_S:
                    client.close(4429, "sends more than can be read; a stop would come too late")
            client.ahead_bytes -= len(data)
            if is_stop or read % _EVERY == 0:  # the writer sends the answer to a stop
                await asyncio.sleep(0)
        hub.closed(client)  # 0 V at once
        await asyncio.sleep(1.0)  # its writer sends the reason, and closes


def _is_stop(text: str) -> bool:
    if not _STOP.search(text):
        return False
    with suppress(Problem):
        message = reading.read_client(text)
        return isinstance(message, m.Plain) and message.type == "stop"
    return False


async def _takes(hub: Hub, client: ServiceSession) -> None:
    """Take messages from `ahead`, at the client's rate at most."""
    while client.closing is None:
        if not client.ahead:
            client.has_ahead.clear()
            await client.has_ahead.wait()
            continue
        data = client.ahead.popleft()
        client.ahead_bytes -= len(data)
        wait_s = hub.receive(client, data)
        if client.inbox and not client.inbox.is_due:
            wait_s = max(wait_s, _gather(hub, client))
        if wait_s > 0 or client.waiting:  # its writer has a turn
            await asyncio.sleep(wait_s)


def _gather(hub: Hub, client: ServiceSession) -> float:
    """Pass touches on; return how long to pause reading."""
    loop = asyncio.get_running_loop()
    client.inbox.is_due = True
    wait_s = client.inbox.passed_s + _GATHER_S - hub.now_s()
    if wait_s <= 0:
        loop.call_soon(hub.pass_touches, client)  # once all that was read is taken
        return 0.0
    loop.call_later(wait_s + _TURNS_S, hub.pass_touches, client)
    return wait_s


async def _writes(socket: WebSocket, client: ServiceSession) -> None:
    with suppress(WebSocketDisconnect, RuntimeError):
        while True:
            if client.waiting:
                await socket.send_text(client.waiting.popleft())
            elif client.closing is not None:
                code, reason = client.closing
                await socket.close(code, reason[:120])
                return
            elif (frame := client.next_frame()) is not None:
                await socket.send_bytes(frame)
            else:
                client.has_more.clear()
                await client.has_more.wait()


_WAIT_S, LAYOUT_WAIT_S = 5.0, 20.0  # for the engine


async def answer_in_turn(hub: Hub, session: ServiceSession) -> None:
    """Answer a session's messages in their order, until it closes."""
    while session.closing is None:
        if not session.requests:
            session.has_requests.clear()
            await session.has_requests.wait()
            continue
        message = session.requests.popleft()
        try:
            reply = await _answer(hub, session, message)
            if reply is not None:
                session.send(reply)
        except Problem as problem:
            session.refuse(message.id, problem)
        except Exception as error:  # a full disk, or a fault of ours
            _LOG.warning("%s: %s: %s", message.type, type(error).__name__, error)
            what = error.strerror if isinstance(error, OSError) else type(error).__name__
            session.refuse(message.id, Problem("internal", f"{message.type}: {what}"))


async def _answer(hub: Hub, session: ServiceSession, message: Any) -> m.Message | None:
    """Handle a message; return its answer, or None if the session ends."""
    number: int = message.id
    control = hub.control
    if isinstance(message, m.Acquire):
        control.acquire(session, message.takeover)
        return control.lease_of(session, "", number)
    if isinstance(message, m.Geometry):
        session.geometry = message
        return m.Done(id=number)
    if isinstance(message, m.Subscribe):
        session.streams.update(message.streams.items())
        wanted: dict[str, tuple[str, ...]] = {
            name: COLUMNS[name] for name, rate in session.streams.items() if rate > 0
        }
        hub.tell_streams()
        return m.Subscribed(id=number, columns=wanted)
    if isinstance(message, m.Watch):
        job = hub.jobs.get(message.job, session.owner).message
        session.watched.add(message.job)
        return job.model_copy(update={"id": number})
    if isinstance(message, m.Plain) and message.type == "inventory":
        return hub.inventory.model_copy(update={"id": number})
    if isinstance(message, m.Plain) and message.type == "bye":
        if control.holder is session:  # no lease is kept after a goodbye
            control.release("its holder has left")
        session.close(1000, "bye")
        return None
    if isinstance(message, m.LayoutSet | m.LayoutChange):
        fields = message.model_dump(exclude={"type", "id"}, exclude_none=True)
        if hub.decode is not None:
            await hub.decode(f"session {session.number}", fields)
        answer = await _ask(hub, message.type, session=session.layout, **fields)
        return m.LayoutReply(id=number, revision=answer["revision"], sample=answer.get("sample"))
    if control.holder is not session:
        raise Problem("lease", f"{message.type}: expected the lease; send acquire first")
    if isinstance(message, m.TouchesMessage):
        _, problem = hub.touch(session, message.touches)
        if problem is not None:
            raise problem
    elif isinstance(message, m.Play):
        fields = message.model_dump(exclude={"type", "id"})
        if hub.decode is not None:
            await hub.decode(f"session {session.number}", fields)
        return m.PlayingMessage(
            id=number, effect_id=(await _ask(hub, "play", **fields))["effect_id"]
        )
    elif isinstance(message, m.Cancel):
        await _ask(hub, "cancel", effect_id=message.effect_id)
    elif isinstance(message, m.Intensity | m.Switch):
        changed: dict[str, Any]
        if isinstance(message, m.Intensity):
            changed = {"intensity": message.value}
        else:
            name = {"mute": "muted", "pause": "paused", "sense": "senses"}[message.type]
            changed = {name: message.on}
        settings = session.settings._replace(**changed)
        for do, fields in control.news(settings):
            await _ask(hub, do, **fields)
        session.settings = settings
        return control.set(number, **changed)
    elif message.type == "release":
        control.release("released")
    elif message.type == "arm" and control.is_live:
        return control.output.model_copy(update={"id": number})
    else:
        armed = await _ask(hub, "arm", session=session.layout)
        hub.full_drive = armed.get("full_drive")
        if control.holder is not session:  # it left, or lost the lease, while the engine armed
            hub.engine.tell("stop", reason="the lease was lost while arming")
            raise Problem("lease", "arm: the lease was lost meanwhile")
        if control.heard > armed.get("told", control.heard):  # it has failed since
            return control.output.model_copy(update={"id": number})
        return control.set(number, state="armed", reason="armed by its holder")
    return m.Done(id=number)


async def _ask(hub: Hub, do: str, **fields: Any) -> dict[str, Any]:
    is_layout = do.startswith("layout")  # the engine makes those in parallel
    wait_s = LAYOUT_WAIT_S if is_layout else _WAIT_S
    try:
        return await asyncio.wait_for(hub.engine.ask(do, **fields), wait_s)
    except TimeoutError:
        if is_layout:  # perhaps an observer's, which stops nobody
            why = f"{do}: took more than {wait_s:g} s and may still come; use smaller files"
            raise Problem("limit", why) from None
        hub.engine.tell("stop", reason=f"{do} took too long")
        raise Problem("internal", f"{do}: the engine did not answer within {wait_s:g} s") from None
