"""STOP on a port of its own, which no other connection can crowd."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any

from haptix.service.front.access import listens
from haptix.service.front.connections import HttpServer


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
