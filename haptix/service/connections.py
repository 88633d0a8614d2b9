"""The HTTP server: number and age of connections, and which one is closed for a new one.

A new connection is always accepted: the one that needs its place least is closed for it. So idle
and half-open connections, however many, cannot block STOP.
"""

from __future__ import annotations

import socket
import time
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from types import FrameType
from typing import Any

import uvicorn
from uvicorn.protocols.http.h11_impl import H11Protocol
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol

from haptix.service.access import Listen
from haptix.service.hub import Hub
from haptix.service.messages import MOST_TEXT_BYTES

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
            self._end(self._least(one for one in self.connections if one.peer == peer))
        elif len(self.connections) >= MOST_CONNECTIONS:
            self._end(self._least(self.connections))
        self.connections[newcomer] = None
        self._of_peer[peer] += 1

    def remove(self, one: _Connection | _Newcomer) -> None:
        """Forget a connection that is closed."""
        if one in self.connections:
            del self.connections[one]
            self._of_peer[one.peer] -= 1
            if not self._of_peer[one.peer]:
                del self._of_peer[one.peer]

    def look(self, now_s: float) -> None:
        """Close those that take too long."""
        for one in [one for one in self.connections if one.is_late(now_s)]:
            self._end(one)

    def _end(self, one: _Connection | _Newcomer) -> None:
        self.remove(one)
        one.abort()

    @staticmethod
    def _least(connections: Iterable[_Connection | _Newcomer]) -> _Connection | _Newcomer:
        """Return the one that needs its place least; of several, the one quiet for longest."""
        least = None
        for one in connections:
            if (rank := one.rank()) == _IDLE:
                return one
            if least is None or rank < least.rank():
                least = one
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
        What `haptix.service.front.application` returns.
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
        sockets = [Listener(one.detach(), self.crowd) for one in sockets or ()]
        await super().startup(sockets)
        for one in sockets:
            one.listen(_WAITING)

    async def on_tick(self, counter: int) -> bool:
        """Look at the connections, ten times a second."""
        self.crowd.look(time.monotonic())
        return await super().on_tick(counter)

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        """Take a signal to end."""
        self._hub.stop("the service ends")
        self._end()
        super().handle_exit(sig, frame)
