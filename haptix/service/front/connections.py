"""The HTTP server's connections: a bounded number, read piece by piece.

A new connection is always accepted: where there are too many, the one that needs its place least
is closed for it. So connections that say nothing, however many, take neither a session's place nor
all files that the process may open, on this port and on STOP's own (`stop_path`).

So it is where asyncio calls `accept` and `recv` of a socket. On Windows it does not: there a
request is refused with 503 while as many connections are open, and sessions are not read piece by
piece.
"""

from __future__ import annotations

import asyncio
import signal
import socket
import sys
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from types import FrameType
from typing import Any

import uvicorn
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol
from websockets.frames import Frame

from haptix.service.protocol.messages import MOST_TEXT_BYTES

MOST_CONNECTIONS = 256
_FILES = 1024  # that the process may have open; some systems grant 256 until asked
_AT_ONCE, _WAITING = 24, 4096  # newcomers taken in one turn of the loop, and waiting for it
_READ_BYTES, _SESSION_BYTES = 16 * 1024, 4 * 1024
"""Of a connection in one turn of the loop, then others have theirs. A session's messages may be of
30 bytes, and another session's STOP takes four turns: with 4 KiB of them a turn takes 2 ms."""

_UNREAD_BYTES = 4 * 2**20
_MOST_PIECES = 1024


class SessionProtocol(WebSocketsSansIOProtocol):
    """WebSocket of a session. What its client makes it keep is bounded, beside a message's size.

    Pongs are written whether they are read or not, and pieces of a message may be empty.
    """

    def handle_ping(self) -> None:
        """Answer, unless the client does not read."""
        if self.transport.get_write_buffer_size() > _UNREAD_BYTES:
            self.transport.abort()
        else:
            super().handle_ping()

    def handle_cont(self, event: Frame) -> None:
        """Take the next piece of a message."""
        if len(self.frames) >= _MOST_PIECES:
            self.transport.abort()
        else:
            super().handle_cont(event)


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
            with suppress(BlockingIOError):
                for _ in range(_WAITING):
                    self._newcomers.append(super().accept())
                    if len(self._newcomers) > _AT_ONCE:
                        self._newcomers.popleft()[0].close()
        if not self._newcomers:
            raise BlockingIOError
        accepted, address = self._newcomers.popleft()
        connection = Connection(accepted.detach(), address[:2], self._crowd)
        self._crowd.add(connection)
        return connection, address


class Crowd:
    """All connections, the one that was quiet for longest first."""

    def __init__(self) -> None:
        self.connections: dict[tuple[str, int], Connection] = {}

    def add(self, newcomer: Connection) -> None:
        """Take a connection, and end another where there are too many."""
        if len(self.connections) >= MOST_CONNECTIONS:
            min(self.connections.values(), key=Connection.rank).end()
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
        """Let an application answer, and note its subject."""
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
                log_config=None,  # its own would close the handlers of the log that runs
                log_level="critical",  # the client gets its own error
                backlog=_AT_ONCE,
                limit_concurrency=MOST_CONNECTIONS if sys.platform == "win32" else None,
                proxy_headers=False,  # the crowd knows connections by their own addresses
                ws_max_size=4 * MOST_TEXT_BYTES,  # too long is an error, and closes nothing
                ws_per_message_deflate=False,  # work for bytes that leave no machine
                ws_ping_interval=None,  # the session's own pings show that the script lives
                timeout_graceful_shutdown=2,
                server_header=False,
                **{"ws": SessionProtocol, **options},
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
        if sig == signal.SIGTERM:
            self.should_exit = True  # uvicorn would raise it again at its end: files would stay
        else:
            super().handle_exit(sig, frame)
