"""One client of the service: its limits, and the messages that wait for it."""

from __future__ import annotations

import asyncio
import hmac
import logging
import secrets
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from math import ceil
from typing import Any, NamedTuple

from haptix.play.touch.events import TouchEvent
from haptix.service.front.client_touches import ClientClock, TouchInbox
from haptix.service.protocol import messages as m
from haptix.service.protocol.batches import TelemetryFrame, numbered, write_frame
from haptix.service.protocol.limiter import Limiter

_LOG = logging.getLogger("haptix.service")

_MOST_WAITING = 64  # replies that a client has not read
_MOST_FRAMES = 4
_MOST_PINGS = 64  # that wait for an answer
_TOUCH_ERRORS_PER_S = 10
_FORGOTTEN_S = 10.0  # without a report: its up was lost
_DROPPED_S = 10.0  # between two warnings of touches that were left out


class Settings(NamedTuple):
    """A session's settings of the output, while it holds the lease."""

    intensity: float = 1.0
    muted: bool = False
    paused: bool = False
    senses: bool = False


@dataclass
class _Feed:
    """Waiting frames of one stream and finger, and a count of the sent ones."""

    frames: deque[bytes] = field(default_factory=lambda: deque(maxlen=_MOST_FRAMES))
    number: int = 0
    dropped: int = 0
    skip: int = 0  # rows of the next frame that the rate leaves out


class ServiceSession:
    """One client. Its messages wait in `waiting` and its feeds for its writer."""

    def __init__(self, number: int, origin: str | None, now_s: Callable[[], float]) -> None:
        self.number, self.origin = number, origin
        self.layout = number  # of its layout in the engine; a client that returns keeps the old one
        self.name = self.owner = self.app = ""
        self.resume = secrets.token_urlsafe(16)
        self.clock = ClientClock()
        self.geometry: m.Geometry | None = None
        self.settings = Settings()
        self._fingers: dict[int, float] = {}  # time of each finger's last report
        self._on: dict[tuple[int, str], bool] = {}  # regions under fingers, and whether pressed
        self.last_id = 0
        self.began_s = now_s()
        self.unanswered_s: float | None = None  # first ping that it has not answered
        self.pinged_s = float("-inf")
        self.pings: dict[int, float] = {}
        self.next_ping = 0
        self.streams: dict[m.Stream, float] = {}
        self.watched: set[str] = set()  # jobs
        self.waiting: deque[str] = deque()
        self._feeds: dict[tuple[m.Stream, int], _Feed] = {}
        self._full: deque[_Feed] = deque()  # each once, in the order of their oldest frames
        self.has_more = asyncio.Event()
        self.ahead: deque[str | bytes] = deque()  # read, and not yet taken
        self.ahead_bytes = 0
        self.behind_s = 0.0  # for so long more has come than could be read
        self.has_ahead = asyncio.Event()
        self.requests: deque[Any] = deque()  # messages that wait for the engine
        self.has_requests = asyncio.Event()
        self.closing: tuple[int, str] | None = None
        limits = m.Limits()
        self.messages = Limiter(limits.messages_per_s, now_s)
        self.batches = Limiter(limits.batches_per_s, now_s)
        self.touches = Limiter(limits.touches_per_s, now_s)
        self._touch_errors = Limiter(_TOUCH_ERRORS_PER_S, now_s)
        self._left_out = 0  # touches that were refused without an error message
        self.inbox = TouchInbox()
        self._warned_s = float("-inf")

    @property
    def is_welcome(self) -> bool:
        """Whether hello was sent."""
        return bool(self.name)

    def is_same_app(self, other: ServiceSession) -> bool:
        """Whether both are of one app, by the word that only it knows."""
        known = hmac.compare_digest(self.app.encode(), other.app.encode())
        return known and self.app != "" and self.owner == other.owner

    def ping(self, now_s: float) -> None:
        """Ask for a pong."""
        self.pinged_s = now_s
        if self.unanswered_s is None:
            self.unanswered_s = now_s
        self.pings[self.next_ping] = now_s
        while len(self.pings) > _MOST_PINGS:
            self.pings.pop(next(iter(self.pings)))
        self.send(m.PingMessage(n=self.next_ping, clock_s=now_s))
        self.next_ping += 1

    def pong(self, message: m.Pong, now_s: float) -> bool:
        """Take the answer to a ping; return whether the client's clock has jumped.

        Raises `Problem` if no such ping waits.
        """
        sent_s = self.pings.pop(message.n, None)
        if sent_s is None:
            raise m.Problem("order", f"n: no ping {message.n} waits for an answer", "/n")
        jumped = self.clock.add(sent_s, now_s, message.clock_s)
        if jumped:
            self.send(m.WarningMessage(sentence="your clock jumped; it is compared anew"))
        return jumped

    def send(self, message: m.Message) -> None:
        """Queue a message; close the session of a client that does not read its messages."""
        if self.closing is None:
            self.waiting.append(message.model_dump_json())
            if len(self.waiting) > _MOST_WAITING:
                self.close(4409, "the client does not read its answers")
            self.has_more.set()

    def refuse(self, number: int, problem: m.Problem) -> None:
        """Answer a message by an error."""
        # Not the sentence: it may quote the client's text.
        _LOG.info("session %d: refused, %s at %r", self.number, problem.code, problem.path)
        self.send(
            m.Error(id=number, code=problem.code, sentence=problem.sentence, path=problem.path)
        )

    def refuse_flood(self, most: int) -> None:
        """Refuse a message that was read and is not kept, at most ten times a second."""
        if self._touch_errors.takes():
            why = f"more than {most} messages, or 4 MiB, wait: this one and others are left out"
            self.refuse(0, m.Problem("limit", why))

    def refuse_touches(self, left_out: int, first: m.Problem | None) -> None:
        """Refuse the first of the touches that were left out, at most ten times a second."""
        self._left_out += left_out
        if first is not None and self._touch_errors.takes():
            more = f" ({self._left_out - 1} more were left out)" if self._left_out > 1 else ""
            self.refuse(0, m.Problem(first.code, first.sentence + more, first.path))
            self._left_out = 0

    def complete(self, touches: Sequence[TouchEvent]) -> tuple[list[TouchEvent], int]:
        """Return touches of as many fingers as there may be, and how many are left out.

        Where a finger comes down again its lift was lost, and is added.
        """
        events: list[TouchEvent] = []
        left_out = 0
        for touch in touches:
            last_s = self._fingers.get(touch.touch_id)
            if touch.kind == "up":
                self._fingers.pop(touch.touch_id, None)
            elif last_s is None and len(self._fingers) >= m.Limits().fingers:
                left_out += 1
                continue
            else:
                if touch.kind == "down" and last_s is not None and touch.t_s > last_s:
                    events.append(touch._replace(kind="up"))
                self._fingers[touch.touch_id] = max(touch.t_s, last_s or touch.t_s)
            events.append(touch)
        return events, left_out

    def forgotten(self, now_s: float) -> list[TouchEvent]:
        """Return the lifts of fingers of which nothing has come for ten seconds."""
        lost = [finger for finger, t_s in self._fingers.items() if now_s - t_s > _FORGOTTEN_S]
        for finger in lost:
            del self._fingers[finger]
        return [TouchEvent(now_s, finger, 0.0, 0.0, "up") for finger in lost]

    def tell_contact(self, contact: m.ContactMessage) -> None:
        """Send a finger's event on a region, so that each is left as often as entered."""
        place = contact.touch_id, contact.region
        if contact.event == "leave":
            self._on.pop(place, None)
        elif contact.event != "detent":
            self._on[place] = contact.event == "press"
        self.send(contact)

    def tell_all_left(self, now_s: float) -> None:
        """Send that no finger is on a region any more: the output has ended."""
        t_s = self.clock.client_s(now_s)
        for (touch_id, region), is_pressed in list(self._on.items()):
            leave = m.ContactMessage(event="leave", region=region, touch_id=touch_id, t_s=t_s)
            if is_pressed:
                self.tell_contact(leave.model_copy(update={"event": "release"}))
            self.tell_contact(leave)

    def warn_of_dropped(self, now_s: float) -> None:
        """Warn of touches that were left out because the service was late, every ten seconds."""
        if self.inbox.dropped and now_s - self._warned_s > _DROPPED_S:
            sentence = (
                f"this machine was busy: {self.inbox.dropped} touches came late to the service, "
                "and newer ones of the same fingers replaced them"
            )
            self.send(m.WarningMessage(sentence=sentence))
            _LOG.info("session %d: dropped %d late touches", self.number, self.inbox.dropped)
            self.inbox.dropped, self._warned_s = 0, now_s

    def send_frame(self, frame: TelemetryFrame) -> None:
        """Queue rows at no more than the rate that was asked for; new frames replace unread ones.

        Rows come at even times: every second, third, ... of them is sent.
        """
        rate_hz = self.streams.get(frame.stream, 0.0)
        if not rate_hz:
            return
        feed = self._feeds.setdefault((frame.stream, frame.touch_id), _Feed())
        every = max(1, ceil(1 / (rate_hz * frame.step_s) - 1e-6))
        rows, skip = frame.rows[feed.skip :: every], feed.skip
        feed.skip = (skip - len(frame.rows)) % every
        if not len(rows):
            return
        left = frame._replace(
            t0_s=frame.t0_s + skip * frame.step_s, step_s=every * frame.step_s, rows=rows
        )
        if not feed.frames:
            self._full.append(feed)
        if len(feed.frames) == _MOST_FRAMES:
            feed.dropped += 1
            _LOG.debug("session %d: dropped a frame of %s", self.number, frame.stream)
        feed.frames.append(numbered(write_frame(left), feed.number, feed.dropped))
        feed.number += 1
        self.has_more.set()

    def next_frame(self) -> bytes | None:
        """Return the frame to send next; None without one."""
        if not self._full:
            return None
        feed = self._full.popleft()
        frame = feed.frames.popleft()
        if feed.frames:
            self._full.append(feed)
        return frame

    def close(self, code: int, reason: str) -> None:
        """Close the session, after the messages that wait are sent."""
        if self.closing is None:
            if self.is_welcome and code != 4409:
                self.waiting.append(m.Bye(reason=reason).model_dump_json())
            _LOG.info("session %d: closes, %d %s", self.number, code, reason)
            self.closing = (code, reason)
            self.has_more.set()
            self.has_requests.set()
