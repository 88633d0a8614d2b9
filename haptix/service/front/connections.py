"""The HTTP server's connections: their number and age, and the sessions on their sockets.

A new connection is always accepted: the one that needs its place least is closed for it. So idle
and half-open connections, however many, cannot block STOP.

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
import time
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from types import FrameType
from typing import Any

import uvicorn
from fastapi import WebSocket
from starlette.websockets import WebSocketDisconnect
from uvicorn.protocols.http.h11_impl import H11Protocol
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol

from haptix.service.front.access import Listen
from haptix.service.front.client_session import ServiceSession
from haptix.service.front.hub import Hub
from haptix.service.protocol import messages as m
from haptix.service.protocol.batches import COLUMNS
from haptix.service.protocol.messages import MOST_TEXT_BYTES, Problem, reading

MOST_CONNECTIONS, MOST_OF_PEER = 256, 192
_FILES = 1024  # that the process may have open; some systems grant 256 until asked
REQUEST_S, UPLOAD_S = 10.0, 60.0
"""For a request to come and be answered; of who has shown a token, for its body to come."""
_AT_ONCE, _WAITING = 24, 4096  # newcomers taken in one turn of the loop, and waiting for it
_READ_BYTES, _SESSION_BYTES = 16 * 1024, 4 * 1024
"""Of a connection in one turn of the loop, then others have theirs. A session's messages may be of
30 bytes, and another session's STOP takes four turns: with 4 KiB of them a turn takes 2 ms."""
_IDLE, _STRANGER, _OWNER, _SESSION = range(4)


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
        newcomer = self._newcomers.popleft()
        self._crowd.add(_Newcomer(*newcomer))
        return newcomer

    def _drain(self) -> Iterator[tuple[socket.socket, Any]]:
        taken: deque[socket.socket] = deque()
        with suppress(BlockingIOError):
            for _ in range(_WAITING):
                newcomer = super().accept()
                taken.append(newcomer[0])
                if len(taken) > _AT_ONCE:
                    taken.popleft().close()
                yield newcomer


class _Newcomer:
    """A connection that asyncio has not announced yet, because its TLS handshake is not done."""

    def __init__(self, socket: socket.socket, address: tuple[Any, ...]) -> None:
        self.socket, self.number, self.peer = socket, socket.fileno(), address[0]
        self._since_s = time.monotonic()

    def abort(self) -> None:
        """End the handshake; asyncio closes the socket then."""
        with suppress(OSError):
            self.socket.shutdown(socket.SHUT_RDWR)

    def rank(self) -> int:
        """How much it needs its place."""
        return _IDLE

    def is_late(self, now_s: float) -> bool:
        """Whether it is closed, or has used up its time."""
        return now_s - self._since_s > REQUEST_S or self.socket.fileno() < 0


class Crowd:
    """All connections, the one that was quiet for longest first."""

    def __init__(self) -> None:
        self.connections: dict[_Connection | _Newcomer, None] = {}
        self._of_peer: Counter[str] = Counter()
        self._newcomers: dict[int, _Newcomer] = {}  # by the number of their sockets

    def add(self, newcomer: _Connection | _Newcomer) -> None:
        """Take a connection, and close another where there are too many."""
        if before := self._newcomers.pop(newcomer.number, None):  # itself, or one that is closed
            self.remove(before)
        if isinstance(newcomer, _Newcomer):
            self._newcomers[newcomer.number] = newcomer
        peer = newcomer.peer
        if self._of_peer[peer] >= MOST_OF_PEER:
            self._end(self._least(known for known in self.connections if known.peer == peer))
        elif len(self.connections) >= MOST_CONNECTIONS:
            self._end(self._least(self.connections))
        self.connections[newcomer] = None
        self._of_peer[peer] += 1

    def remove(self, connection: _Connection | _Newcomer) -> None:
        """Forget a connection that is closed."""
        if connection in self.connections:
            del self.connections[connection]
            self._of_peer[connection.peer] -= 1
            if not self._of_peer[connection.peer]:
                del self._of_peer[connection.peer]

    def look(self, now_s: float) -> None:
        """Close those that take too long."""
        for late in [known for known in self.connections if known.is_late(now_s)]:
            self._end(late)

    def _end(self, connection: _Connection | _Newcomer) -> None:
        self.remove(connection)
        connection.abort()

    @staticmethod
    def _least(connections: Iterable[_Connection | _Newcomer]) -> _Connection | _Newcomer:
        """Return the one that needs its place least; of several, the one quiet for longest."""
        least = None
        for connection in connections:
            if (rank := connection.rank()) == _IDLE:
                return connection
            if least is None or rank < least.rank():
                least = connection
        assert least is not None
        return least


class _Connection:
    """A connection of any protocol."""

    crowd: Crowd
    transport: Any
    scope: Any = None
    cycle: Any = None

    def connection_made(self, transport: Any) -> None:
        super().connection_made(transport)  # type: ignore[misc]
        transport.max_size = _READ_BYTES
        self.since_s = time.monotonic()
        self.peer = (transport.get_extra_info("peername") or ("",))[0]
        self.number = transport.get_extra_info("socket").fileno()
        self.crowd.add(self)

    def connection_lost(self, exc: Exception | None) -> None:
        self.crowd.remove(self)
        super().connection_lost(exc)  # type: ignore[misc]

    def abort(self) -> None:
        """Close it at once."""
        self.transport.abort()

    def rank(self) -> int:
        """How much it needs its place."""
        state = self.scope["state"] if self.scope else {}
        session = state.get("session")
        if session is not None and session.is_welcome and session.closing is None:
            return _SESSION
        if self.cycle is None or self.cycle.response_complete or self.cycle.more_body:
            return _IDLE
        return _OWNER if "owner" in state else _STRANGER

    def is_late(self, now_s: float) -> bool:
        """Whether it has used up its time."""
        is_owner = self.scope is not None and "owner" in self.scope["state"]
        limit_s = UPLOAD_S if is_owner else REQUEST_S
        return self.rank() < _OWNER and now_s - self.since_s > limit_s


class _Http(_Connection, H11Protocol):
    def data_received(self, data: bytes) -> None:
        if self in self.crowd.connections:  # it was quiet until now
            self.crowd.connections[self] = self.crowd.connections.pop(self)
        super().data_received(data)

    def on_response_complete(self) -> None:
        self.since_s = time.monotonic()
        super().on_response_complete()

    def handle_websocket_upgrade(self, event: Any) -> None:
        self.crowd.remove(self)  # the socket takes its place
        super().handle_websocket_upgrade(event)


class _Socket(_Connection, WebSocketsSansIOProtocol):
    """A session's socket."""

    def connection_made(self, transport: Any) -> None:
        super().connection_made(transport)
        transport.max_size = _SESSION_BYTES
        self.close_timeout = 1.0  # a client that is disconnected may go on sending

    def data_received(self, data: bytes) -> None:
        now_s = time.monotonic()
        if len(data) < _SESSION_BYTES or self.scope is None:  # else more has come already
            self.since_s = now_s
        elif (session := self.scope["state"].get("session")) is not None:
            session.behind_s = now_s - self.since_s
        super().data_received(data)


class HttpServer(uvicorn.Server):
    """A server that sets 0 V before it closes its clients' connections.

    Parameters
    ----------
    app : ASGI application
        What `haptix.service.front.application.application` returns.
    hub : Hub
        Is stopped first.
    listen : Listen, optional
        Where other machines reach it.
    end : callable
        Called before it waits for answers that are under way.
    """

    def __init__(self, app: Any, hub: Hub, listen: Listen | None, end: Callable[[], None]) -> None:
        self._hub, self._end, self.crowd = hub, end, Crowd()
        shared = {"crowd": self.crowd}
        super().__init__(
            uvicorn.Config(
                app,
                http=type("Http", (_Http,), shared),
                ws=type("Socket", (_Socket,), shared),
                log_level="critical",  # the client gets its own error
                backlog=_AT_ONCE,
                ws_max_size=4 * MOST_TEXT_BYTES,  # too long is an error, and closes nothing
                ws_per_message_deflate=False,  # work for bytes that leave no machine
                ws_ping_interval=None,  # the session's own pings show that the script lives
                timeout_graceful_shutdown=2,
                server_header=False,
                ssl_certfile=listen.certificate if listen else None,
                ssl_keyfile=listen.key if listen else None,
            )
        )

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Listen."""
        with suppress(ImportError, ValueError, OSError):
            import resource

            soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
            resource.setrlimit(resource.RLIMIT_NOFILE, (max(soft, min(_FILES, hard)), hard))
        sockets = [Listener(socket.detach(), self.crowd) for socket in sockets or ()]
        await super().startup(sockets)
        for listener in sockets:
            listener.listen(_WAITING)

    async def on_tick(self, counter: int) -> bool:
        """Look at the connections, ten times a second."""
        self.crowd.look(time.monotonic())
        return await super().on_tick(counter)

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        """Take a signal to end."""
        self._hub.stop("the service ends")
        self._end()
        super().handle_exit(sig, frame)


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
