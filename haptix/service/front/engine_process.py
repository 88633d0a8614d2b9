"""The engine and the virtual finger beside it, as the service's front sees them.

The front starts both and restarts either when it dies. It replays to a new engine the state that
the last one had accepted: layouts, intensity, mute, pause and sensing (`EngineReplay`).
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from typing import Any

from haptix.play.touch.events import TouchEvent
from haptix.service.front.pool import BEAT_S, IDLE_S, LONGEST_SILENCE_S, Process
from haptix.service.protocol.messages import Problem
from haptix.service.protocol.wire import AMPLITUDE, TELEMETRY, frame, touch_frame


class LayoutRecord:
    """The layout of one session as a document: the last one set, and the changes since."""

    def __init__(self) -> None:
        self.revision = 0
        self._regions: dict[str, dict[str, Any]] = {}
        self._values: dict[str, float] = {}

    def set(self, document: Mapping[str, Any]) -> None:
        """Take a document that the engine has accepted."""
        self._values = {}
        self._regions = {region["name"]: dict(region) for region in document["regions"]}
        self.revision += 1

    def change(self, ops: Iterable[Mapping[str, Any]]) -> None:
        """Take changes that the engine has accepted."""
        for op in ops:
            fields = dict(op)
            kind, name = fields.pop("op"), fields["name"]
            if kind == "remove":
                del self._regions[name]
                self._values.pop(name, None)
            elif kind == "value":
                self._values[name] = fields["value"]
            else:
                fields.pop("over_s", None)
                if "material" in fields:
                    self._values.pop(name, None)
                self._regions[name] = {**self._regions.get(name, {}), **fields}
        self.revision += 1

    @property
    def message(self) -> dict[str, Any]:
        """Fields of `layout_restore`, which makes the same layout."""
        return {
            "document": {"regions": list(self._regions.values())},
            "values": self._values,
            "revision": self.revision,
        }


class EngineReplay:
    """The accepted messages of one engine, replayed to the next; no replayed message arms."""

    def __init__(self) -> None:
        self._layouts: dict[int, LayoutRecord] = {}  # by session
        self._settings: dict[str, dict[str, Any]] = {}

    def record(self, do: str, fields: Mapping[str, Any]) -> None:
        """Record a message that was accepted."""
        session = fields.get("session", 0)
        if do == "layout_set":
            self._layouts.setdefault(session, LayoutRecord()).set(fields["document"])
        elif do == "layout_change":
            self._layouts.setdefault(session, LayoutRecord()).change(fields["ops"])
        elif do == "forget":
            self._layouts.pop(session, None)
        elif do in ("intensity", "mute", "pause", "sense"):
            self._settings[do] = dict(fields)

    def messages(self) -> list[tuple[str, dict[str, Any]]]:
        """Return the messages that bring a new engine to the same state."""
        layouts = ({"session": by, **layout.message} for by, layout in self._layouts.items())
        return [*(("layout_restore", layout) for layout in layouts), *self._settings.items()]


_RESTART_S = 0.2  # from the end of a process to its next start: its driver ramps to 0 V
_RETRY_S, _FINGER_NICE = 1.0, 5
_SPARE_S = 5.0  # from the first arming to the start of the spare, which loads for seconds


class FeltFingerProcess(Process):
    """The virtual finger's worker; it ends a minute after its last subscriber has left.

    Parameters
    ----------
    on_event, on_telemetry : callable
        Take its event that it hangs, and its telemetry.
    """

    def __init__(
        self, on_event: Callable[[dict[str, Any]], None], on_telemetry: Callable[[bytes], None]
    ) -> None:
        super().__init__()
        self._on_event, self._on_telemetry = on_event, on_telemetry
        self._opening: dict[str, Any] = {}
        self._is_wanted = self._is_open = False
        self._is_known = asyncio.Event()
        self._starter: asyncio.Task[None] | None = None
        self._rests: asyncio.TimerHandle | None = None

    def opens(self, opening: dict[str, Any]) -> None:
        """Set its finger, screen and carrier."""
        self._opening = opening
        self._is_known.set()

    def want(self, on: bool) -> None:
        """Start it if it is wanted; end it when it has not been wanted for a while."""
        if self._is_wanted and not on:
            self._rests = asyncio.get_running_loop().call_later(IDLE_S, self.kill)
        self._is_wanted = on
        if on and self._rests is not None:
            self._rests.cancel()
            self._rests = None
        if on and (self._starter is None or self._starter.done()):
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
        pid = self.pid
        with suppress(Problem):  # it has ended, and is started again
            await self.ask("get_ready")  # while the engine opens
            await self._is_known.wait()
            if self.pid != pid:
                return
            await self.ask("feel", nice=_FINGER_NICE, **self._opening)
            self._is_open = True
            self.has_loaded()

    def feed(self, data: bytes) -> None:
        """Send it touches and amplitudes, once it has made its tables, which takes seconds."""
        if self._is_open and self._is_wanted:
            self.write(data)

    def on_frame(self, kind: int, data: bytes) -> None:
        """Pass telemetry on."""
        if kind == TELEMETRY:
            self._on_telemetry(data)

    def on_exit(self, code: int | None) -> None:
        """Start it again."""
        self._is_open = False
        if self._is_wanted:
            how = "hung" if self.has_hung else f"ended with code {code}"
            sentence = f"the virtual finger {how}; another one is started"
            self._on_event({"event": "warning", "stream": "felt", "sentence": sentence})
            self._starter = asyncio.create_task(self._start(_RESTART_S))


class EngineProcess(Process):
    """Starts the engine, and restarts it disarmed when it has died.

    Parameters
    ----------
    opening : dict
        First message to the engine: device, surface, finger, screen.
    on_event : callable
        Takes the engine's events.
    on_telemetry : callable
        Takes telemetry, of the engine and of its virtual finger.
    """

    def __init__(
        self,
        opening: dict[str, Any],
        on_event: Callable[[dict[str, Any]], None],
        on_telemetry: Callable[[bytes], None],
    ) -> None:
        # An engine that hangs is killed; the driver's watchdog then ends the output at 0 V.
        super().__init__("engine")
        self._opening, self._on_event, self._on_telemetry = opening, on_event, on_telemetry
        self._is_ending = self._is_open = self._was_open = False
        self._spare: asyncio.subprocess.Process | None = None
        self._spare_start: asyncio.Task[None] | None = None
        self._rates: dict[str, float] = {}
        self._replay = EngineReplay()
        self.felt_finger = FeltFingerProcess(on_event, on_telemetry)

    async def start(self) -> dict[str, Any]:
        """Start the engine; return the device and surface that it has opened."""
        if self.pid is None:
            await self.launch()
        try:
            opened = await super().ask("open", **self._opening)
        except Problem as problem:
            if self.has_gone and not self._was_open:
                why = "the engine ended before it was there; its own message stands above"
                raise Problem("device", why) from problem
            raise
        self._is_open = self._was_open = True
        self.has_loaded()
        felt = {name: opened[name] for name in ("screen", "carrier_hz")}
        self.felt_finger.opens({"finger": opened["touched_by"], **felt})
        self.felt_finger.want(self._rates.get("felt", 0.0) > 0)
        if self._rates:
            self.tell("streams", rates=self._rates)
        for do, fields in self._replay.messages():
            with suppress(Problem):  # a file may be gone: the next `arm` reports that
                await super().ask(do, **fields)
        return opened

    async def _start_spare(self) -> None:
        """Keep a process that has loaded torch and opened nothing, for when the engine dies."""
        await asyncio.sleep(_SPARE_S)
        self._spare = await super()._spawn()

    async def _spawn(self) -> asyncio.subprocess.Process:
        spare, self._spare = self._spare, None
        if spare is None:
            return await super()._spawn()
        self._spare_start = None
        if spare.returncode is not None:
            return await super()._spawn()
        self.has_loaded(round(LONGEST_SILENCE_S / BEAT_S))  # it may hang, too
        return spare

    async def ask(self, do: str, **fields: Any) -> dict[str, Any]:
        """Return the answer to a question."""
        if not self._is_open:  # it would answer once its driver is there, which takes seconds
            raise Problem("device", f"{do}: the engine is being started again; try anew")
        answer = await super().ask(do, **fields)
        self._replay.record(do, fields)
        if do == "arm" and self._spare_start is None and not self._is_ending:
            self._spare_start = asyncio.create_task(self._start_spare())
        return answer

    async def stop(self) -> None:
        """End at 0 V."""
        self._is_ending = True
        if self._spare_start is not None:
            self._spare_start.cancel()
            with suppress(asyncio.CancelledError):
                await self._spare_start
        if self._spare is not None:
            with suppress(ProcessLookupError):
                self._spare.kill()
            await self._spare.wait()
        await asyncio.gather(super().stop(), self.felt_finger.stop())

    def tell(self, do: str, **fields: Any) -> None:
        """Send a message that has no answer."""
        if do == "streams":
            self._rates = fields["rates"]
            self.felt_finger.want(self._rates.get("felt", 0.0) > 0)
        self._replay.record(do, fields)
        super().tell(do, **fields)

    def touch(self, reports: list[TouchEvent]) -> None:
        """Pass touches on."""
        data = touch_frame(reports)
        self.write(data)
        self.felt_finger.feed(data)

    def on_message(self, message: dict[str, Any]) -> None:
        """Pass events on."""
        self._on_event(message)

    def on_frame(self, kind: int, data: bytes) -> None:
        """Pass telemetry on; send played amplitudes to the virtual finger."""
        if kind == TELEMETRY:
            self._on_telemetry(data)
        elif kind == AMPLITUDE:
            self.felt_finger.feed(frame(AMPLITUDE, data))

    def on_exit(self, code: int | None) -> None:
        """Start it again."""
        self._is_open = False
        if self._was_open and not self._is_ending:
            how = "hung" if self.has_hung else f"ended with code {code}"
            self._say("failed", f"the engine {how}; it is started again")
            self._restart = asyncio.create_task(self._restart_later())

    async def _restart_later(self) -> None:
        """Start it; try again until its driver can be opened."""
        reason, wait_s = "", _RESTART_S
        while not self._is_ending:
            await asyncio.sleep(wait_s)
            try:
                await self.start()
            except Problem as problem:
                if self.pid is None:
                    return
                if problem.sentence != reason:
                    self._say("failed", reason := problem.sentence)
                wait_s = _RETRY_S
            else:
                self._say("off", "the engine is there again")
                return

    def _say(self, state: str, reason: str) -> None:
        self._on_event({"event": "output", "state": state, "reason": reason})
