"""The HTTP server in front of the service."""

from __future__ import annotations

from collections.abc import Callable
from types import FrameType
from typing import Any

import uvicorn

from haptix.service.hub import Hub
from haptix.service.listen import Listen
from haptix.service.messages import MOST_TEXT_BYTES


class HttpServer(uvicorn.Server):
    """Goes to 0 V before it lets its clients go.

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
        self._hub, self._end = hub, end
        super().__init__(
            uvicorn.Config(
                app,
                log_level="warning",
                ws="websockets-sansio",
                ws_max_size=MOST_TEXT_BYTES,
                ws_per_message_deflate=False,  # work for bytes that leave no machine
                ws_ping_interval=None,  # the session's own pings show that the script lives
                timeout_graceful_shutdown=2,
                server_header=False,
                ssl_certfile=listen.certificate if listen else None,
                ssl_keyfile=listen.key if listen else None,
            )
        )

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        """Take a signal to end."""
        self._hub.stop("the service ends")
        self._end()
        super().handle_exit(sig, frame)
