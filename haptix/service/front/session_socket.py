"""The socket of a session: read, written and answered in turn until either side closes it.

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
from contextlib import suppress
from typing import Any

from fastapi import WebSocket
from starlette.websockets import WebSocketDisconnect

from haptix.service.front.client_session import ServiceSession
from haptix.service.front.hub import Hub
from haptix.service.protocol import messages as m
from haptix.service.protocol.batches import COLUMNS
from haptix.service.protocol.messages import Problem, reading

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
        return m.LayoutReply(id=number, revision=answer["revision"])
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
