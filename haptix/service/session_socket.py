"""A session's socket: what it reads and writes, until either side closes it."""

from __future__ import annotations

import asyncio
import contextlib

from fastapi import WebSocket
from starlette.websockets import WebSocketDisconnect

from haptix.service.answers import work
from haptix.service.hub import Hub
from haptix.service.session import ServiceSession

_GATHER_S = 0.005
"""Batches that come closer to each other are passed on together: each pass costs the front, the
engine and the virtual finger a turn. A batch that comes later than that is passed on at once."""
_TURNS_S = 0.0005  # for the loop to read what has come meanwhile


async def serve_session(hub: Hub, socket: WebSocket, client: ServiceSession) -> None:
    """Serve one session until it closes, by whichever side."""
    tasks = [
        asyncio.create_task(part)
        for part in (_reads(hub, socket, client), _writes(socket, client), work(hub, client))
    ]
    try:
        await asyncio.wait(tasks[:2], return_when=asyncio.FIRST_COMPLETED)
    finally:
        hub.gone(client)
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


async def _reads(hub: Hub, socket: WebSocket, client: ServiceSession) -> None:
    with contextlib.suppress(WebSocketDisconnect):
        while client.closing is None:
            message = await socket.receive()
            if message["type"] == "websocket.disconnect":
                return
            data = message.get("text")
            wait_s = hub.receive(client, message["bytes"] if data is None else data)
            if client.inbox and not client.inbox.is_due:
                wait_s = max(wait_s, _gather(hub, client))
            if wait_s > 0:
                await asyncio.sleep(wait_s)
        await asyncio.sleep(1.0)  # its writer says why, and closes


def _gather(hub: Hub, client: ServiceSession) -> float:
    """See to it that touches are passed on; return how long to read no more."""
    loop = asyncio.get_running_loop()
    client.inbox.is_due = True
    wait_s = client.inbox.passed_s + _GATHER_S - hub.now_s()
    if wait_s <= 0:
        loop.call_soon(hub.pass_touches, client)  # once all that was read is taken
        return 0.0
    loop.call_later(wait_s + _TURNS_S, hub.pass_touches, client)
    return wait_s


async def _writes(socket: WebSocket, client: ServiceSession) -> None:
    with contextlib.suppress(WebSocketDisconnect, RuntimeError):
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
