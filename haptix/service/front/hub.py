"""All sessions: access, the immediate effect of each message, and time-outs.

One session at a time holds the lease (`OutputControl`): only it arms, touches and changes the
layout that is felt. Any session may stop. Before the lease goes to another session, the output is
at 0 V; the new holder must arm it.
"""

from __future__ import annotations

import hmac
import logging
import time
from collections import deque
from collections.abc import Awaitable, Callable, Sequence
from typing import Any

from haptix.base.version import __version__
from haptix.service.front.access import Access
from haptix.service.front.client_session import ServiceSession
from haptix.service.front.client_touches import Stalls, touch_events
from haptix.service.front.control import Engine, OutputControl
from haptix.service.front.jobs import JobBoard
from haptix.service.protocol import messages as m
from haptix.service.protocol.batches import read_frame, read_touches
from haptix.service.protocol.messages import Problem, reading

_LOG = logging.getLogger("haptix.service")

TICK_S = 0.02
"""Between two looks at the sessions. A silent client's voltage is gone a tick after its limit."""
_FIRST_PINGS = 8
_MOST_SESSIONS = 16
MOST_STRANGERS = 128
"""Sessions before their hello. With few of them, silent sockets that come again at once would close
the socket of an honest client in the milliseconds that its hello takes."""
_MANY_REQUESTS, _MOST_REQUESTS = 32, 60  # of one session, that wait for the engine
_REQUEST_WAIT_S = 0.02
_MOST_REACHED = 256  # forces that the friction is kept of
_QUESTIONS = ("inventory", "watch", "subscribe", "geometry", "bye")  # they move nothing


class Hub:
    """All sessions, and the one output.

    Parameters
    ----------
    access : Access
        Checks tokens and origins.
    engine : Engine
        Renders.
    inventory : Inventory
        Devices, finger, screen and kinds of material.
    device : str
        Address of the driver.
    now_s : callable
        The clock, the same as the engine's.
    """

    def __init__(
        self,
        access: Access,
        engine: Engine,
        inventory: m.Inventory,
        device: str,
        now_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self.access, self.engine, self.inventory = access, engine, inventory
        self.profiles: dict[str, Any] = {}
        self.schema: dict[str, Any] = {}  # of all kinds of material; empty before the engine knows
        self.decode: Callable[[str, dict[str, Any]], Awaitable[None]] | None = None  # pictures
        self.full_drive: dict[str, Any] | None = None  # carrier and amplitude, once armed
        self._reached: dict[float, tuple[float, float]] = {}  # friction by force
        self.now_s = now_s
        self.stalls = Stalls(now_s())
        self.sessions: dict[int, ServiceSession] = {}
        self.keep_alive = m.KeepAlive()
        self._next = 1
        self.control = OutputControl(engine, device, self.welcome)
        self.jobs = JobBoard(engine, self.on_job_change, self.control.lend)

    async def reach(self, normal_force_n: float) -> tuple[float, float]:
        """Return the lowest and highest friction coefficient that the screen gives at a force.

        Raises `Problem` where the surface has no such force, or the engine is not there and nobody
        has asked it before.
        """
        if normal_force_n not in self._reached:
            answer = await self.engine.ask("reach", normal_force_n=normal_force_n)
            if len(self._reached) >= _MOST_REACHED:
                self._reached.clear()
            self._reached[normal_force_n] = answer["reachable_mu"]
        low, high = self._reached[normal_force_n]
        return low, high

    # --- coming and going ------------------------------------------------------------------------

    def open(self, origin: str | None) -> ServiceSession:
        """Let a client in, before its hello."""
        if len(self.welcome()) >= _MOST_SESSIONS:
            raise Problem("limit", f"expected at most {_MOST_SESSIONS} sessions")
        strangers = [
            session
            for session in self.sessions.values()
            if not (session.is_welcome or session.closing)
        ]
        for session in strangers[: max(0, len(strangers) + 1 - MOST_STRANGERS)]:
            session.close(4408, "more connections arrived, and this one had sent no hello")
        session = ServiceSession(self._next, origin, self.now_s)
        self._next += 1
        self.sessions[session.number] = session
        _LOG.info("session %d: its socket is open", session.number)
        return session

    def closed(self, session: ServiceSession) -> None:
        """Take note that a socket is closed: 0 V at once if it held the output."""
        if self.sessions.pop(session.number, None) is None:
            return
        _LOG.info("session %d: its socket is closed", session.number)
        session.close(1000, "")
        if self.control.holder is session:
            self.control.keep(self.now_s() + self.keep_alive.free_s)
        else:
            self.engine.tell("forget", session=session.layout)
        if session.streams:
            self.tell_streams()

    def tick(self) -> None:
        """Ping the sessions and act on those that are silent; called every `TICK_S`."""
        now_s, keep, control = self.now_s(), self.keep_alive, self.control
        self.stalls.look(now_s)
        self.engine.tell("tick")
        control.tick(now_s)
        if control.holder is not None and (lifts := control.holder.forgotten(now_s)):
            self.engine.touch(lifts)
        for session in list(self.sessions.values()):
            silent_s = 0.0 if session.unanswered_s is None else now_s - session.unanswered_s
            if not session.is_welcome:
                if now_s - session.began_s > 2.0:
                    session.close(4408, "expected hello within two seconds")
                continue
            if silent_s > keep.close_s:
                session.close(4408, f"silent for {keep.close_s:g} s")
                continue
            holds = control.holder is session
            if holds and silent_s > keep.silent_s:
                control.sleep(f"silent for {silent_s:.1f} s")
            if holds and silent_s > keep.free_s:
                control.release("silent for too long", "the holder was silent for too long")
            every_s = keep.armed_s if holds and control.is_live else keep.idle_s
            if now_s - session.pinged_s >= every_s:
                session.ping(self.now_s())

    # --- messages --------------------------------------------------------------------------------

    def receive(self, session: ServiceSession, data: str | bytes) -> float:
        """Take a client's message; return the pause before its next one is read [s].

        Pongs and stop take effect at once. Touches in bytes wait for `pass_touches`, which is
        called before the next message. Other messages wait for `session_socket.answer_in_turn`.
        """
        if session.closing is not None:
            return 0.0
        if isinstance(data, bytes):
            wait_s = session.batches.wait_s()
        else:
            wait_s = session.messages.wait_s(1 + len(data) // m.COUNTED_BYTES)
            self.pass_touches(session)
        try:
            if isinstance(data, bytes):
                self._note_answer(session)
                if not session.is_welcome:
                    raise Problem("order", "expected hello first")
                touches = read_touches(data).touches
                wait_s = max(wait_s, session.touches.wait_s(len(touches)))
                session.inbox.put(touches)
            else:
                most_bytes = m.MOST_TEXT_BYTES if session.is_welcome else m.MOST_HELLO_BYTES
                message = reading.read_client(data, most_bytes)
                self._note_answer(session)
                wait_s = max(wait_s, self._sort(session, message))
        except Problem as problem:
            session.refuse(reading.id_of(data) if isinstance(data, str) else 0, problem)
        return wait_s

    def pass_touches(self, session: ServiceSession) -> None:
        """Pass on the touches in bytes that a client has sent."""
        if session.inbox:
            now_s = self.now_s()
            late_s = self.stalls.late_s(now_s)
            batches = session.inbox.take(session.clock, now_s, late_s)
            session.refuse_touches(*self.touch(session, *batches))
            session.warn_of_dropped(now_s)

    def _sort(self, session: ServiceSession, message: Any) -> float:
        if not session.is_welcome and not isinstance(message, m.HelloMessage):
            raise Problem("order", "expected hello first", "/type")
        if isinstance(message, m.Pong):
            if session.pong(message, self.now_s()) and self.control.holder is session:
                self.engine.tell("lift")
            return 0.0
        wait_s = 0.0
        if isinstance(message, m.TouchesMessage):
            wait_s = session.touches.wait_s(len(message.touches))
            if message.id is None:
                session.refuse_touches(*self.touch(session, message.touches))
                return wait_s
        if is_stop := isinstance(message, m.Plain) and message.type == "stop":
            # Whatever its id is.
            self.stop(f"stopped by session {session.number} ({session.name})", session)
        if message.id <= session.last_id:
            raise Problem("order", f"id: expected more than {session.last_id}", "/id")
        session.last_id = message.id
        if isinstance(message, m.HelloMessage):
            self._hello(session, message)
        elif is_stop:
            session.send(m.Done(id=message.id))
        elif len(session.requests) >= _MOST_REQUESTS:
            raise Problem(
                "limit", f"expected at most {_MOST_REQUESTS} messages that wait; await some"
            )
        else:
            session.requests.append(message)
            session.has_requests.set()
            if len(session.requests) > _MANY_REQUESTS:
                wait_s = max(wait_s, _REQUEST_WAIT_S)
        return wait_s

    def on_engine_event(self, event: dict[str, Any]) -> None:
        """Pass on an event of the engine."""
        kind = event.pop("event")
        if kind == "output":
            self.control.heard = event.pop("number", 0)
            self._on_output(event["state"], event["reason"])
        elif kind == "contact" and (holder := self.control.holder) is not None:
            if event.pop("session") == holder.layout:  # not of the holder before
                t_s = holder.clock.client_s(event.pop("t_s"))
                holder.tell_contact(m.ContactMessage(event=event.pop("what"), t_s=t_s, **event))
        elif kind == "all_left":
            self._all_left()
        elif kind == "effect_ended" and self.control.holder is not None:
            self.control.holder.send(m.EffectEnded(**event))
        elif kind == "warning":
            stream = event.get("stream")
            for session in self.welcome():
                if stream is None or session.streams.get(stream):
                    session.send(m.WarningMessage(sentence=event["sentence"]))

    def warn(self, owner: str, sentence: str) -> None:
        """Warn the sessions of a token's owner, or one that is named by its number."""
        for session in self.welcome():
            if owner in (session.owner, f"session {session.number}"):
                session.send(m.WarningMessage(sentence=sentence))

    def _on_output(self, state: str, reason: str) -> None:
        """Take a state of the output from the engine; a virtual driver is armed again by itself."""
        is_back = self.control.follow_driver(state, reason)
        self._all_left()  # an engine that has died does not report it
        is_real = any(device.is_real for device in self.inventory.devices)
        if is_back and not is_real and (holder := self.control.holder) is not None:
            holder.requests.append(m.Plain.model_construct(type="arm", id=0))
            holder.has_requests.set()

    def _all_left(self) -> None:
        for session in self.welcome():
            session.tell_all_left(self.now_s())

    def on_job_change(self, job: m.JobMessage) -> None:
        """Pass a job's change on to those who watch it."""
        for session in self.welcome():
            if job.job in session.watched:
                session.send(job)

    def on_telemetry(self, data: bytes) -> None:
        """Pass telemetry on to those who subscribed to it."""
        frame = read_frame(data)
        for session in self.welcome():
            session.send_frame(frame)

    # --- parts -----------------------------------------------------------------------------------

    def _hello(self, session: ServiceSession, message: m.HelloMessage) -> None:
        major, minor = (int(part) for part in message.protocol.split("."))
        if session.is_welcome:
            raise Problem("order", "hello was sent already", "/type")
        if major != m.PROTOCOL[0]:
            wrong = Problem(
                "version",
                f"expected protocol {m.PROTOCOL[0]}.x, got {message.protocol}",
                "/protocol",
            )
        elif not self.access.lets_in(message.token, session.origin):
            wrong = Problem(
                "access",
                "token: expected one that was given to this client: a page is paired by the code "
                "of the terminal, a program reads service.json",
                "/token",
            )
        else:
            wrong = None
        if wrong is not None:
            session.refuse(message.id, wrong)
            session.close(4400 if wrong.code == "version" else 4403, wrong.sentence)
            return
        session.name, session.owner = message.client, self.access.owner_of(message.token)
        session.app = message.app
        for old in list(self.sessions.values()):
            if old is session:
                continue
            # It noticed first that its connection was lost: the old socket looks open here.
            is_same = hmac.compare_digest(message.resume.encode(), old.resume.encode())
            if is_same or (session.is_same_app(old) and self._is_silent(old)):  # the latter hung
                self.closed(old)
        reason = "resumed" if self.control.resumes(session, message.resume) else "free"
        _LOG.info("session %d: hello of %r, %s", session.number, message.client, reason)
        speaks = min((major, minor), m.PROTOCOL)
        session.send(
            m.Welcome(
                id=message.id,
                protocol=f"{speaks[0]}.{speaks[1]}",
                server=f"haptix {__version__}",
                session=session.number,
                resume=session.resume,
                keep_alive=self.keep_alive,
                clock_s=self.now_s(),
                inventory=self.inventory,
                output=self.control.output,
                lease=self.control.lease_of(session, reason),
            )
        )
        for _ in range(_FIRST_PINGS):
            session.ping(self.now_s())

    def _is_silent(self, session: ServiceSession) -> bool:
        asked_s = session.unanswered_s
        return asked_s is not None and self.now_s() - asked_s > self.keep_alive.silent_s

    def stop(self, reason: str, by: ServiceSession | None = None) -> None:
        """End at 0 V, for all sessions, and refuse requests that wait.

        Of the session that sends stop all are refused, of others all but questions.
        """
        self.control.disarm(reason)
        self.jobs.end_playing()  # the engine has lent them the device
        for session in self.welcome():
            requests, session.requests = session.requests, deque()
            for message in requests:
                if session is by or message.type not in _QUESTIONS:
                    session.refuse(message.id, Problem("order", reason))
                else:
                    session.requests.append(message)

    def touch(
        self, session: ServiceSession, *batches: Sequence[m.TouchMessage | Problem | None]
    ) -> tuple[int, Problem | None]:
        """Pass the holder's touches on; return how many are left out, and why the first is."""
        if self.control.holder is not session:
            touches = [touch for touches in batches for touch in touches if touch is not None]
            wrong = next((touch for touch in touches if isinstance(touch, Problem)), None)
            wrong = wrong or Problem("lease", "touch: expected the lease; send acquire first")
            return len(touches), wrong
        now_s = self.now_s()
        late_s = self.stalls.late_s(now_s)
        clock, geometry = session.clock, session.geometry
        usable = [touch_events(clock, geometry, touches, now_s, late_s) for touches in batches]
        sent = [event for touches in usable for event in touches.events]
        events, left_out = session.complete(sent)
        if events:
            self.engine.touch(events)
            _LOG.debug("session %d: %d touches", session.number, len(events))
        first = next((touches.problem for touches in usable if touches.problem is not None), None)
        if first is None and left_out:
            most = m.Limits().fingers
            first = Problem("limit", f"touch_id: expected at most {most} fingers at once; lift one")
        return sum(touches.left_out for touches in usable) + left_out, first

    def _note_answer(self, session: ServiceSession) -> None:
        session.unanswered_s = None
        if self.control.holder is session:
            self.control.wake()

    def tell_streams(self) -> None:
        """Send the engine the subscribed streams with their rates."""
        rates: dict[str, float] = {}
        for session in self.welcome():
            for name, rate in session.streams.items():
                rates[name] = max(rates.get(name, 0.0), rate)
        self.engine.tell("streams", rates=rates)

    def welcome(self) -> list[ServiceSession]:
        """Return the sessions after their hello."""
        return [session for session in self.sessions.values() if session.is_welcome]
