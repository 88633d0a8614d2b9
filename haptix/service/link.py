"""The engine, and the virtual finger beside it, as the service's front sees them."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from haptix.service.messages import Problem
from haptix.service.pool import IDLE_S, Process
from haptix.service.told import Told
from haptix.service.wire import AMPLITUDE, TELEMETRY, frame, touch_frame
from haptix.touch.events import TouchEvent

_AGAIN_S = 1.0  # from the end of a process to its next start
_ENGINE_FULL_S, _FINGER_NICE = 0.05, 5


class FeltFingerProcess(Process):
    """The virtual finger's worker; it runs while somebody wants what it feels, and a minute more.

    Parameters
    ----------
    hear_frame : callable
        Takes its telemetry.
    """

    def __init__(self, hear_frame: Callable[[bytes], None]) -> None:
        super().__init__(nice=_FINGER_NICE)
        self._hear_frame = hear_frame
        self._opening: dict[str, Any] = {}
        self._is_wanted = self._is_open = False
        self._starter: asyncio.Task[None] | None = None
        self._rests: asyncio.TimerHandle | None = None

    def opens(self, opening: dict[str, Any]) -> None:
        """Set what it feels: finger, screen and carrier."""
        self._opening = opening
        self.want(self._is_wanted)

    def want(self, on: bool) -> None:
        """Start it if it is wanted, and end it when it was not for a while."""
        if self._is_wanted and not on:
            self._rests = asyncio.get_running_loop().call_later(IDLE_S, self.kill)
        self._is_wanted = on
        if on and self._rests is not None:
            self._rests.cancel()
            self._rests = None
        if on and self._opening and (self._starter is None or self._starter.done()):
            self._starter = asyncio.create_task(self._start(0.0))

    async def stop(self) -> None:
        """End it."""
        self._is_wanted = False
        await super().stop()

    async def _start(self, after_s: float) -> None:
        await asyncio.sleep(after_s)
        if not self._is_wanted or self.pid is not None:
            return
        await self.launch()
        with suppress(Problem):  # it has ended, and is started again
            await self.ask("feel", **self._opening)
            self._is_open = True

    def feed(self, data: bytes) -> None:
        """Pass on what it feels, once it has made its tables: they take seconds."""
        if self._is_open and self._is_wanted:
            self.write(data)

    def heard_frame(self, kind: int, data: bytes) -> None:
        """Pass telemetry on."""
        if kind == TELEMETRY:
            self._hear_frame(data)

    def ended(self, code: int | None) -> None:
        """Start it again."""
        self._is_open = False
        if self._is_wanted:
            self._starter = asyncio.create_task(self._start(_AGAIN_S))


class EngineProcess(Process):
    """Starts the engine, and again when it has died; disarmed each time.

    A new one is told the layouts and settings of the one before.

    Parameters
    ----------
    opening : dict
        First message to the engine: device, surface, finger, screen.
    hear : callable
        Takes the engine's events.
    hear_frame : callable
        Takes telemetry, of the engine and of its virtual finger.
    """

    def __init__(
        self,
        opening: dict[str, Any],
        hear: Callable[[dict[str, Any]], None],
        hear_frame: Callable[[bytes], None],
    ) -> None:
        # One that hangs is killed: the driver's watchdog ends at 0 V.
        super().__init__("engine", _ENGINE_FULL_S)
        self._opening, self._hear, self._hear_frame = opening, hear, hear_frame
        self._ends = self._is_open = False
        self._rates: dict[str, float] = {}
        self._told = Told()
        self.felt_finger = FeltFingerProcess(hear_frame)

    async def start(self) -> dict[str, Any]:
        """Start the engine; return what it has opened."""
        await self.launch()
        found = await super().ask("open", **self._opening)
        self._is_open = True
        self.felt_finger.opens({name: found[name] for name in ("finger", "screen", "carrier_hz")})
        if self._rates:
            self.tell("streams", rates=self._rates)
        for do, fields in self._told.again():
            super().tell(do, **fields)
        return found

    async def ask(self, do: str, **fields: Any) -> dict[str, Any]:
        """Return the answer to a question."""
        if not self._is_open:  # it would answer once its driver is there, which takes seconds
            raise Problem("device", f"{do}: the engine is being started again; try anew")
        found = await super().ask(do, **fields)
        self._told.note(do, fields)
        return found

    async def stop(self) -> None:
        """End at 0 V."""
        self._ends = True
        await asyncio.gather(super().stop(), self.felt_finger.stop())

    def tell(self, do: str, **fields: Any) -> None:
        """Say something that has no answer."""
        if do == "streams":
            self._rates = fields["rates"]
            self.felt_finger.want(self._rates.get("felt", 0.0) > 0)
        self._told.note(do, fields)
        super().tell(do, **fields)

    def layouts(self) -> list[dict[str, Any]]:
        """Return the documents of all layouts that the engine has."""
        return [one["document"] for one in self._told.layouts()]

    def touch(self, reports: list[TouchEvent]) -> None:
        """Pass touches on."""
        data = touch_frame(reports)
        self.write(data)
        self.felt_finger.feed(data)

    def heard(self, message: dict[str, Any]) -> None:
        """Pass events on."""
        self._hear(message)

    def heard_frame(self, kind: int, data: bytes) -> None:
        """Pass telemetry on, and what was played to the virtual finger."""
        if kind == TELEMETRY:
            self._hear_frame(data)
        elif kind == AMPLITUDE:
            self.felt_finger.feed(frame(AMPLITUDE, data))

    def ended(self, code: int | None) -> None:
        """Start it again."""
        self._is_open = False
        if not self._ends:
            reason = f"the engine ended with code {code}; it is started again"
            self._hear({"event": "output", "state": "failed", "reason": reason})
            self._restart = asyncio.create_task(self._start_again())

    async def _start_again(self) -> None:
        await asyncio.sleep(_AGAIN_S)
        try:
            await self.start()
        except Problem as problem:
            self._hear({"event": "output", "state": "failed", "reason": problem.sentence})
        else:
            self._hear({"event": "output", "state": "off", "reason": "the engine is there again"})
