"""The holder of the output, and the output's state machine.

    off, failed, back --arm--> armed --its holder is silent--> asleep
                               armed <--its holder answers---- asleep
    any state but gone --stop, release, takeover, a closed socket, a job--> off
    any state --the driver or the engine fails--> failed --the engine is there again--> off
    any state --the driver does not answer--> gone --it was opened again--> back

Only `armed` has voltage, and only its holder's `arm` leads there. A virtual driver that was armed
when it failed is armed again for its holder, unless somebody has stopped it since. The engine gets
the order for 0 V before the state changes.
"""

from __future__ import annotations

import hmac
import logging
from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

from haptix.play.touch.events import TouchEvent
from haptix.service.front.client_session import ServiceSession, Settings
from haptix.service.protocol import messages as m
from haptix.service.protocol.messages import Problem

_LOG = logging.getLogger("haptix.service")


class Engine(Protocol):
    """The process that renders, as the front speaks to it."""

    async def ask(self, do: str, **fields: Any) -> dict[str, Any]:
        """Return the answer to a question; raises `Problem`."""

    def tell(self, do: str, **fields: Any) -> None:
        """Send a message that has no answer."""

    def touch(self, reports: list[TouchEvent]) -> None:
        """Pass touches on, by the service's clock."""


class KeptLease(NamedTuple):
    """A holder whose socket closed: its lease and layout are kept for its return."""

    session: ServiceSession
    until_s: float


class OutputControl:
    """The one output: its state, and the session that holds it.

    Parameters
    ----------
    engine : Engine
        What renders.
    device : str
        Address of the driver.
    welcome : callable
        Returns the sessions that changes are sent to.
    """

    def __init__(
        self, engine: Engine, device: str, welcome: Callable[[], list[ServiceSession]]
    ) -> None:
        self.engine, self._welcome = engine, welcome
        self.holder: ServiceSession | None = None
        self._kept: KeptLease | None = None
        self._was_live = False  # when the driver or the engine failed
        self.heard = 0  # number of the engine's last report of the output
        self._sent = Settings()  # the engine's settings
        self.output = m.OutputMessage(
            state="off",
            device=device,
            intensity=1.0,
            muted=False,
            paused=False,
            reason="nobody has armed it",
        )

    def acquire(self, session: ServiceSession, takeover: bool) -> None:
        """Give a session the lease, not armed.

        Raises `Problem` if another one has it, and `takeover` is not asked for.
        """
        if self.holder is session:
            return
        if self.holder is not None and not takeover:
            raise Problem(
                "lease",
                f"session {self.holder.number} ({self.holder.name}) holds the output; ask with "
                "takeover to take it",
                "/takeover",
            )
        if self.holder is None and self._kept is not None and not takeover:
            raise Problem(
                "lease",
                "the output is kept for a client whose socket closed; ask with takeover, or wait",
                "/takeover",
            )
        self.disarm("another client takes over")
        self._forget()
        self._give(session, "taken over" if takeover else "acquired")

    def release(self, reason: str, lease_reason: str = "") -> None:
        """Disarm, and let the lease be free."""
        self.disarm(reason)
        self._give(None, lease_reason or reason)

    def keep(self, until_s: float) -> None:
        """Keep lease and layout of the holder, whose socket is closed: 0 V at once."""
        session, self.holder = self.holder, None
        if session is not None:
            self._kept = KeptLease(session, until_s)
            self.disarm("the client that held the output is gone")
            self._give(None, "the holder is gone")

    def resumes(self, session: ServiceSession, resume: str) -> bool:
        """Give a kept lease back to the client that knows its word; return whether one was kept.

        An app that was started anew begins with an empty layout and settings of its own.
        """
        if self._kept is None:
            return False
        kept = self._kept.session
        if hmac.compare_digest(resume.encode(), kept.resume.encode()):
            self._kept = None
            session.layout, session.settings = kept.layout, kept.settings
        elif session.is_same_app(kept):
            self._forget()
        else:
            return False
        self._give(session, "resumed")
        return True

    def tick(self, now_s: float) -> None:
        """Forget sessions that were kept for too long."""
        if self._kept is not None and now_s > self._kept.until_s:
            self._forget()

    def disarm(self, reason: str) -> None:
        """End at 0 V."""
        self.engine.tell("stop", reason=reason)
        rest = self.rests()
        if self.output.state != rest:  # many stops are no flood to all others
            self.set(state=rest, reason=reason)

    def rests(self) -> str:
        """Return the state without voltage; the output is not armed again by itself."""
        self._was_live = False
        return "gone" if self.output.state == "gone" else "off"

    def follow_driver(self, state: str, reason: str) -> bool:
        """Take the engine's report of the output; return whether it was armed and is back."""
        had_failed = self.output.state in ("failed", "gone")
        was_live = self.is_live or (had_failed and self._was_live)
        self.set(state=state, reason=reason)
        self._was_live = was_live and state in ("failed", "gone")
        return was_live and had_failed and state in ("off", "back")

    def lend(self, kind: str) -> None:
        """End at 0 V and report the kind of job that has the device now; "" at its end."""
        if kind:
            self.disarm("a job has the device")
        self.set(lent_to=kind)

    @property
    def is_live(self) -> bool:
        """Whether it is armed, or asleep and would wake."""
        return self.output.state in ("armed", "asleep")

    def sleep(self, reason: str) -> None:
        """Be at 0 V until `wake`."""
        if self.output.state == "armed":
            self.engine.tell("sleep")
            self.set(state="asleep", reason=reason)

    def wake(self) -> None:
        """Be as before `sleep`."""
        if self.output.state == "asleep":
            self.engine.tell("wake")
            self.set(state="armed", reason="its holder answers again")

    def set(self, number: int = 0, **changes: Any) -> m.OutputMessage:
        """Change the state of the output, send it to all, and return the answer to a message."""
        self.output = self.output.model_copy(update=changes)
        _LOG.info("output: %s", ", ".join(f"{name} {value}" for name, value in changes.items()))
        for session in self._welcome():
            if not (number and session is self.holder):
                session.send(self.output)
        return self.output.model_copy(update={"id": number})

    def news(self, settings: Settings) -> list[tuple[str, dict[str, Any]]]:
        """Return the messages that give the engine a session's settings and the person's own."""
        person, before = self.output, self._sent
        muted = settings.muted or person.person_muted
        intensity = settings.intensity * person.person_intensity
        now = Settings(intensity, muted, settings.paused, settings.senses)
        self._sent = now
        whole = (
            ("intensity", {"value": now.intensity}, now.intensity != before.intensity),
            ("mute", {"on": now.muted}, now.muted != before.muted),
            ("pause", {"on": now.paused}, now.paused != before.paused),
            ("sense", {"on": now.senses}, now.senses != before.senses),
        )
        return [(do, fields) for do, fields, is_new in whole if is_new]

    def follow(self, **of_person: Any) -> None:
        """Send the engine the settings of the holder and of the person."""
        settings = self.holder.settings if self.holder else Settings()
        changes = settings._asdict() | of_person
        if self.output != self.output.model_copy(update=changes):
            self.set(**changes)
        for do, fields in self.news(settings):
            self.engine.tell(do, **fields)

    def lease_of(self, session: ServiceSession, reason: str, number: int = 0) -> m.Lease:
        """Return who holds the output, as a message to a session."""
        holder = self.holder
        return m.Lease(
            id=number,
            holder=holder.number if holder else None,
            is_mine=holder is session,
            reason=reason or "acquired",
        )

    def _give(self, session: ServiceSession | None, reason: str) -> None:
        self.holder = session
        _LOG.info("lease: session %s, %s", session.number if session else None, reason)
        for each in self._welcome():
            each.send(self.lease_of(each, reason))
        self.follow()

    def _forget(self) -> None:
        kept, self._kept = self._kept, None
        if kept is not None:
            self.engine.tell("forget", session=kept.session.layout)
