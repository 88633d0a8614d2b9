"""The sessions, the lease on the output, and what becomes of a client that falls silent.

One session at a time holds the lease: only it arms, touches and changes what is felt. Anyone may
stop. A lease is never taken without 0 V first, and nobody who gets one is armed by that.
"""

from __future__ import annotations

import asyncio
import hmac
import time
from collections import deque
from collections.abc import Callable
from math import cos, radians, sin
from typing import Any, NamedTuple, Protocol

from haptix.service import messages as m
from haptix.service.access import Access
from haptix.service.batches import COLUMNS, read_touches
from haptix.service.messages import Problem
from haptix.service.session import ServiceSession
from haptix.service.wire import TouchRecord
from haptix.version import __version__

TICK_S = 0.02
"""Between two looks at the sessions. A silent client's voltage is gone a tick after its limit."""
_FIRST_PINGS = 8
_MOST_PINGS = 64  # that wait for an answer
_MOST_SESSIONS = 16
_WAIT_S = 5.0  # for the engine


class Engine(Protocol):
    """What renders, in a process of its own."""

    async def ask(self, do: str, **fields: Any) -> dict[str, Any]:
        """Return the answer to a question; raises `Problem`."""

    def tell(self, do: str, **fields: Any) -> None:
        """Say something that has no answer."""

    def touch(self, reports: list[TouchRecord]) -> None:
        """Pass touches on, by the service's clock."""


class Kept(NamedTuple):
    """The lease and layout of a holder whose socket closed, for its return."""

    session: int
    resume: str
    until_s: float


class Hub:
    """All sessions, and the one output.

    Parameters
    ----------
    access : Access
        Whose tokens are good.
    engine : Engine
        What renders.
    inventory : Inventory
        What there is.
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
        self.material_schema: dict[str, Any] = {}
        self.now_s = now_s
        self.sessions: dict[int, ServiceSession] = {}
        self.keep_alive = m.KeepAlive()
        self.holder: ServiceSession | None = None
        self._kept: Kept | None = None
        self._next = 1
        self.output = m.OutputMessage(
            state="off",
            device=device,
            intensity=1.0,
            muted=False,
            paused=False,
            reason="nobody has armed it",
        )

    # --- coming and going ------------------------------------------------------------------------

    def open(self, origin: str | None) -> ServiceSession:
        """Let a client in, before its hello."""
        if len(self.sessions) >= _MOST_SESSIONS:
            raise Problem("limit", f"expected at most {_MOST_SESSIONS} sessions")
        session = ServiceSession(self._next, origin, self.now_s)
        self._next += 1
        self.sessions[session.number] = session
        return session

    def gone(self, session: ServiceSession) -> None:
        """Take note that a socket is closed: 0 V at once if it held the output."""
        if self.sessions.pop(session.number, None) is None:
            return
        session.close(1000, "")
        if self.holder is session:
            self.engine.tell("stop", reason="the client that held the output is gone")
            until_s = self.now_s() + self.keep_alive.free_s
            self._kept = Kept(session.number, session.resume, until_s)
            self._take_lease(None, "the holder is gone")
            self._set_output(state="off", reason="the client that held the output is gone")
        else:
            self.engine.tell("forget", session=session.number)

    def tick(self) -> None:
        """Look after pings and silences; every `TICK_S`."""
        now_s, keep = self.now_s(), self.keep_alive
        self.engine.tell("tick")
        if self._kept is not None and now_s > self._kept.until_s:
            self._forget_kept()
        for session in list(self.sessions.values()):
            silent_s = 0.0 if session.unanswered_s is None else now_s - session.unanswered_s
            if not session.is_welcome:
                if now_s - session.began_s > 2.0:
                    session.close(4408, "expected hello within two seconds")
                continue
            if silent_s > keep.close_s:
                session.close(4408, f"silent for {keep.close_s:g} s")
                continue
            holds = self.holder is session
            if holds and self.output.state == "armed" and silent_s > keep.silent_s:
                self.engine.tell("sleep")
                self._set_output(state="asleep", reason=f"silent for {silent_s:.1f} s")
            if holds and silent_s > keep.free_s:
                self._disarm("silent for too long")
                self._take_lease(None, "the holder was silent for too long")
            is_live = holds and self.output.state in ("armed", "asleep")
            if now_s - session.pinged_s >= (keep.armed_s if is_live else keep.idle_s):
                self._ping(session)

    # --- messages --------------------------------------------------------------------------------

    def receive(self, session: ServiceSession, data: str | bytes) -> float:
        """Take what a client sent; return how long not to read from it [s].

        Pongs, touches and stop are obeyed at once; the others wait for their turn in `work`.
        """
        if session.closing is not None:
            return 0.0
        wait_s = (session.batches if isinstance(data, bytes) else session.messages).wait_s()
        try:
            if isinstance(data, bytes):
                self._heard(session)
                if not session.is_welcome:
                    raise Problem("order", "expected hello first")
                touches = read_touches(data).touches
                wait_s = max(wait_s, session.touches.wait_s(len(touches)))
                self._touch(session, touches)
            else:
                message = m.read_client(data)
                self._heard(session)
                wait_s = max(wait_s, self._sort(session, message))
        except Problem as problem:
            self._refuse(session, m.id_of(data) if isinstance(data, str) else 0, problem)
        return wait_s

    def _sort(self, session: ServiceSession, message: Any) -> float:
        if not session.is_welcome and not isinstance(message, m.HelloMessage):
            raise Problem("order", "expected hello first", "/type")
        if isinstance(message, m.Pong):
            self._pong(session, message)
            return 0.0
        if isinstance(message, m.TouchesMessage) and message.id is None:
            self._touch(session, message.touches)
            return session.touches.wait_s(len(message.touches))
        if message.id <= session.last_id:
            raise Problem("order", f"id: expected more than {session.last_id}", "/id")
        session.last_id = message.id
        if isinstance(message, m.HelloMessage):
            self._hello(session, message)
        elif isinstance(message, m.Plain) and message.type == "stop":
            self._stop(session, message.id)
        else:
            session.asked.append(message)
            session.has_asked.set()
        return 0.0

    async def work(self, session: ServiceSession) -> None:
        """Answer a session's messages in their order, until it closes."""
        while session.closing is None:
            if not session.asked:
                session.has_asked.clear()
                await session.has_asked.wait()
                continue
            message = session.asked.popleft()
            try:
                answer = await self._answer(session, message)
                if answer is not None:
                    session.send(answer)
            except Problem as problem:
                self._refuse(session, message.id, problem)

    async def _answer(self, session: ServiceSession, message: Any) -> m.Message | None:
        number: int = message.id
        if isinstance(message, m.Acquire):
            self._acquire(session, message)
            return self._lease_of(session, "", number)
        if isinstance(message, m.Geometry):
            session.geometry = message
            return m.Done(id=number)
        if isinstance(message, m.Subscribe):
            session.streams.update(message.streams.items())
            wanted: dict[str, tuple[str, ...]] = {
                name: COLUMNS[name] for name, rate in session.streams.items() if rate > 0
            }
            self._tell_streams()
            return m.Subscribed(id=number, columns=wanted)
        if isinstance(message, m.Plain) and message.type == "inventory":
            return self.inventory.model_copy(update={"id": number})
        if isinstance(message, m.Plain) and message.type == "bye":
            if self.holder is session:  # nothing is kept for who says goodbye
                self._disarm("its holder has left")
                self._take_lease(None, "its holder has left")
            session.close(1000, "bye")
            return None
        if isinstance(message, m.LayoutSet | m.LayoutChange):
            fields = message.model_dump(exclude={"type", "id"}, exclude_none=True)
            found = await self._ask(message.type, session=session.number, **fields)
            return m.LayoutReply(id=number, revision=found["revision"], sample=found.get("sample"))
        if self.holder is not session:
            raise Problem("lease", f"{message.type}: expected the lease; send acquire first")
        if isinstance(message, m.TouchesMessage):
            self._touch(session, message.touches)
        elif isinstance(message, m.Play):
            fields = message.model_dump(exclude={"type", "id"})
            return m.PlayingMessage(
                id=number, effect_id=(await self._ask("play", **fields))["effect_id"]
            )
        elif isinstance(message, m.Cancel):
            await self._ask("cancel", effect_id=message.effect_id)
        elif isinstance(message, m.Intensity):
            await self._ask("intensity", value=message.value)
            return self._set_output(number, intensity=message.value)
        elif isinstance(message, m.Switch):
            await self._ask(message.type, on=message.on)
            changed: dict[str, Any] = {"muted" if message.type == "mute" else "paused": message.on}
            return self._set_output(number, **changed)
        elif message.type == "release":
            self._disarm("released")
            self._take_lease(None, "released")
        elif message.type == "arm":
            await self._ask("arm", session=session.number)
            if self.holder is not session:  # it left, or lost the lease, while the engine armed
                self.engine.tell("stop", reason="the lease was lost while arming")
                raise Problem("lease", "arm: the lease was lost meanwhile")
            return self._set_output(number, state="armed", reason="armed by its holder")
        else:
            await self._ask("disarm")
            return self._set_output(number, state="off", reason="disarmed by its holder")
        return m.Done(id=number)

    async def _ask(self, do: str, **fields: Any) -> dict[str, Any]:
        try:
            return await asyncio.wait_for(self.engine.ask(do, **fields), _WAIT_S)
        except TimeoutError:
            self.engine.tell("stop", reason=f"{do} took too long")
            raise Problem("internal", f"{do}: the engine did not answer within 5 s") from None

    def hear_engine(self, event: dict[str, Any]) -> None:
        """Pass on what the engine says unasked."""
        kind = event.pop("event")
        if kind == "output":
            self._set_output(state=event["state"], reason=event["reason"])
        elif kind == "contact" and self.holder is not None:
            t_s = self.holder.clock.client_s(event.pop("t_s"))
            self.holder.send(m.ContactMessage(event=event.pop("what"), t_s=t_s, **event))
        elif kind == "effect_ended" and self.holder is not None:
            self.holder.send(m.EffectEnded(**event))
        elif kind == "warning":
            for session in self._welcome():
                session.send(m.WarningMessage(sentence=event["sentence"]))

    def hear_frame(self, stream: m.Stream, frame: bytes) -> None:
        """Pass telemetry on to those who subscribed to it."""
        for session in self._welcome():
            if session.streams.get(stream):
                session.send_frame(frame)

    # --- parts -----------------------------------------------------------------------------------

    def _hello(self, session: ServiceSession, message: m.HelloMessage) -> None:
        major, minor = (int(part) for part in message.protocol.split("."))
        if session.is_welcome:
            raise Problem("order", "hello was said already", "/type")
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
            self._refuse(session, message.id, wrong)
            session.close(4400 if wrong.code == "version" else 4403, wrong.sentence)
            return
        session.name = message.client
        reason = "resumed" if self._resumes(session, message.resume) else "free"
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
                output=self.output,
                lease=self._lease_of(session, reason),
            )
        )
        for _ in range(_FIRST_PINGS):
            self._ping(session)

    def _resumes(self, session: ServiceSession, resume: str) -> bool:
        """Give the lease and layout of the connection before back; whether there was one."""
        for old in list(self.sessions.values()):
            # It noticed first that its connection was lost: the old socket looks open here.
            if old is not session and hmac.compare_digest(resume.encode(), old.resume.encode()):
                self.gone(old)
        kept = self._kept
        if kept is None or not hmac.compare_digest(resume.encode(), kept.resume.encode()):
            return False
        self._kept = None
        self.engine.tell("adopt", session=session.number, of=kept.session)
        self._take_lease(session, "resumed")
        return True

    def _acquire(self, session: ServiceSession, message: m.Acquire) -> None:
        if self.holder is session:
            return
        if self.holder is not None and not message.takeover:
            raise Problem(
                "lease",
                f"session {self.holder.number} ({self.holder.name}) holds the output; ask with "
                "takeover to take it",
                "/takeover",
            )
        if self.holder is None and self._kept is not None and not message.takeover:
            raise Problem(
                "lease",
                "the output is kept for a client whose socket closed; ask with takeover, or wait",
                "/takeover",
            )
        self._disarm("another client takes over")
        self._forget_kept()
        self._take_lease(session, "taken over" if message.takeover else "acquired")

    def _forget_kept(self) -> None:
        kept, self._kept = self._kept, None
        if kept is not None:
            self.engine.tell("forget", session=kept.session)

    def _take_lease(self, session: ServiceSession | None, reason: str) -> None:
        self.holder = session
        for each in self._welcome():
            each.send(self._lease_of(each, reason))

    def _lease_of(self, session: ServiceSession, reason: str, number: int = 0) -> m.Lease:
        holder = self.holder
        return m.Lease(
            id=number,
            holder=holder.number if holder else None,
            is_mine=holder is session,
            reason=reason or "acquired",
        )

    def _disarm(self, reason: str) -> None:
        self.engine.tell("stop", reason=reason)
        if self.output.state != "off":
            self._set_output(state="off", reason=reason)

    def _stop(self, session: ServiceSession, number: int) -> None:
        reason = f"stopped by session {session.number} ({session.name})"
        self.stop(reason)
        session.send(m.Done(id=number))

    def stop(self, reason: str) -> None:
        """End at 0 V, for all. What was asked before it and is not done is refused."""
        self.engine.tell("stop", reason=reason)
        for session in self._welcome():
            asked, session.asked = session.asked, deque()
            for message in asked:
                self._refuse(session, message.id, Problem("order", reason))
        self._set_output(state="off", reason=reason)

    def _set_output(self, number: int = 0, **changes: Any) -> m.OutputMessage:
        self.output = self.output.model_copy(update=changes)
        for session in self._welcome():
            if not (number and session is self.holder):
                session.send(self.output)
        return self.output.model_copy(update={"id": number})

    def _touch(self, session: ServiceSession, touches: tuple[m.TouchMessage, ...]) -> None:
        if self.holder is not session:
            raise Problem("lease", "touch: expected the lease; send acquire first")
        now_s = self.now_s()
        reports: list[TouchRecord] = []
        for index, touch in enumerate(touches):
            path = f"/touches/{index}"
            t_s = session.clock.stamp(touch.t_s, now_s, f"{path}/t_s")
            x_mm, y_mm = self._place(session, touch, path)
            reports.append(
                TouchRecord(
                    t_s,
                    touch.touch_id,
                    touch.kind,
                    x_mm,
                    y_mm,
                    touch.normal_force_n,
                    touch.contact_area_m2,
                )
            )
        if reports:
            self.engine.touch(reports)

    @staticmethod
    def _place(session: ServiceSession, touch: m.TouchMessage, path: str) -> tuple[float, float]:
        if touch.x_mm is not None and touch.y_mm is not None and touch.x_px is None:
            return touch.x_mm, touch.y_mm
        if touch.x_px is not None and touch.y_px is not None and touch.x_mm is None:
            geometry = session.geometry
            if geometry is None:
                raise Problem("order", "x_px: send geometry first, or millimetres", f"{path}/x_px")
            turn = radians(geometry.rotation_deg)
            x, y = touch.x_px / geometry.px_per_mm, touch.y_px / geometry.px_per_mm
            return (
                geometry.origin_mm[0] + x * cos(turn) - y * sin(turn),
                geometry.origin_mm[1] + x * sin(turn) + y * cos(turn),
            )
        if touch.kind == "up" and touch.x_mm is None and touch.x_px is None:
            return 0.0, 0.0
        raise Problem("message", "expected x_mm and y_mm, or x_px and y_px", path)

    def _heard(self, session: ServiceSession) -> None:
        session.unanswered_s = None
        if self.holder is session and self.output.state == "asleep":
            self.engine.tell("wake")
            self._set_output(state="armed", reason="its holder is heard again")

    def _ping(self, session: ServiceSession) -> None:
        now_s = self.now_s()
        session.pinged_s = now_s
        if session.unanswered_s is None:
            session.unanswered_s = now_s
        session.pings[session.next_ping] = now_s
        while len(session.pings) > _MOST_PINGS:
            session.pings.pop(next(iter(session.pings)))
        session.send(m.PingMessage(n=session.next_ping, clock_s=now_s))
        session.next_ping += 1

    def _pong(self, session: ServiceSession, message: m.Pong) -> None:
        sent_s = session.pings.pop(message.n, None)
        if sent_s is None:
            raise Problem("order", f"n: no ping {message.n} waits for an answer", "/n")
        if session.clock.add(sent_s, self.now_s(), message.clock_s):
            if self.holder is session:
                self.engine.tell("lift")
            session.send(m.WarningMessage(sentence="your clock jumped; it is compared anew"))

    def _tell_streams(self) -> None:
        rates: dict[str, float] = {}
        for session in self._welcome():
            for name, rate in session.streams.items():
                rates[name] = max(rates.get(name, 0.0), rate)
        self.engine.tell("streams", rates=rates)

    @staticmethod
    def _refuse(session: ServiceSession, number: int, problem: Problem) -> None:
        session.send(
            m.Error(id=number, code=problem.code, sentence=problem.sentence, path=problem.path)
        )

    def _welcome(self) -> list[ServiceSession]:
        return [session for session in self.sessions.values() if session.is_welcome]
