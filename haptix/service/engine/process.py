"""``python -m haptix.service.engine.process``: owns the surface, the renderer and the device.

It reads frames from its standard input and answers on its standard output. Four threads:

- The main thread handles at once touches, stop and sleep, which must not wait.
- A worker does what takes time: opening, arming.
- Another worker builds layouts.
- A watch looks for the front's ticks: without one for 100 ms the output sleeps, for 2 s it stops.
  While nothing plays it asks the driver whether it is there, and opens one again that was gone.

At the end of the input the process ends at 0 V. Below all, the driver has a watchdog of its own.
"""

from __future__ import annotations

import gc
import importlib
import logging
import queue
import signal
import sys
import threading
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, Literal

import numpy as np

from haptix.base.checks import Array
from haptix.base.errors import DeviceDisconnectedError, DeviceFaultError, HaptixError, InputError
from haptix.base.files import parse_json
from haptix.feel.materials.memory import MapMemory
from haptix.play.touch.events import ForceModel, TouchEvent
from haptix.service.engine.session_layout import MOST_MAP_BYTES
from haptix.service.engine.touch_gate import TouchGate
from haptix.service.protocol.batches import TelemetryFrame, write_frame
from haptix.service.protocol.messages import SCREEN_MM, Stream
from haptix.service.protocol.wire import (
    BEAT,
    JSON,
    TELEMETRY,
    TOUCHES,
    FrameReader,
    Outbox,
    amplitude_frame,
    answer_of,
    frame,
    frame_output,
    touches_of,
)

if TYPE_CHECKING:
    from haptix.feel.layout import LayoutEvent
    from haptix.model.finger import Finger
    from haptix.model.screen import Screen
    from haptix.play.render.master import EffectEnd
    from haptix.play.sensing import FingerEstimate, FingerObserver
    from haptix.service.engine.session_layout import SessionLayout

_LOG = logging.getLogger("haptix.service.engine.process")

SLEEP_S, STOP_S = 0.1, 2.0
_LOOK_S = 0.02
_ASK_S, _OPEN_S = 0.5, 0.25  # between two questions to a driver that rests; two tries to open it
_MOST_TOUCH_INTERVAL_S = 0.02  # two of a touchscreen of 100 Hz
_LAYOUTS = ("layout_set", "layout_change", "layout_restore", "forget")
"""Slow work in parallel, so that one session's large pictures delay no other session."""
_OF_DEVICE = ("arm", "open", "lend", "take_back")
_RENDERS = (
    "haptix.play.devices",
    "haptix.model.friction.model",
    "haptix.model.surface.friction_surface",
    "haptix.feel.materials.panels",
    "haptix.play.render.live",
    "haptix.feel.layout.layout",
)
_SETTLED_S = 0.015  # a driver reports refused revisions within its status' period
_MOST_STATS_HZ = 50.0
_LAST_REACTIONS = 500  # reactions of which percentiles are reported


class Telemetry:
    """Streams of one engine, at the rates that somebody asks for.

    Parameters
    ----------
    write : callable
        Takes frames of the link.
    look_s : float
        Between two calls of `tell`.
    """

    def __init__(self, write: Callable[[bytes], None], look_s: float) -> None:
        self._write, self._look_s = write, look_s
        self._rates: Mapping[Stream, float] = {}
        self._stats_sent_s = 0.0

    def ask(self, rates: Mapping[Stream, float]) -> None:
        """Set the rate of each stream; 0 or none ends it."""
        self._rates = rates

    def tell(self, renderer: Any, now_s: float) -> None:
        """Send the new telemetry of a renderer at a time of its clock."""
        self._tell_stats(renderer, now_s)
        wanted = [name for name in ("friction", "felt") if self._rates.get(name, 0.0) > 0]
        if not wanted:
            renderer.record = None
            return
        if renderer.record is None:
            from haptix.play.render.played import PlayedRecord

            renderer.record = PlayedRecord(renderer)
        part = renderer.record.take(now_s - _SETTLED_S)
        if part is None:
            return
        if "felt" in wanted:
            self._write(amplitude_frame(part.t0_s, part.step_s, part.amplitude_v))
        if "friction" in wanted:
            for touch_id, rows in part.rows.items():
                self._tell("friction", touch_id, part.t0_s, part.row_s, rows)

    def _tell_stats(self, renderer: Any, now_s: float) -> None:
        rate_hz = min(self._rates.get("stats", 0.0), _MOST_STATS_HZ)
        if not rate_hz or now_s - self._stats_sent_s < 1 / rate_hz - self._look_s / 2:
            return
        self._stats_sent_s = now_s
        last = [*renderer.stats.reactions_s][-_LAST_REACTIONS:]
        times = np.percentile(last or [np.nan], (50, 99))
        counts = renderer.stats.underruns, renderer.touch_counts.taken
        row = (*times, *counts, renderer.scene_s, *_sensed(renderer.stats.finger))
        self._tell("stats", 0, now_s, 1 / rate_hz, np.array([row]))

    def _tell(self, stream: Stream, touch_id: int, t0_s: float, step_s: float, rows: Array) -> None:
        telemetry = TelemetryFrame(stream, touch_id, 0, 0, t0_s, step_s, rows)
        self._write(frame(TELEMETRY, write_frame(telemetry)))


def _sensed(finger: FingerEstimate | None) -> tuple[float, ...]:
    """Number of the state of sensing, and the estimate of the finger; NaN without sensing."""
    if finger is None:
        return (np.nan,) * 5
    state = [*type(finger.state)].index(finger.state)
    known = np.exp(finger.log_gain), finger.log_gain_sd, finger.force_n, finger.force_sd
    return (state, *known)


class EngineServer:
    """One device, one renderer, one layout.

    Parameters
    ----------
    output : binary file
        Where answers and events go.
    """

    def __init__(self, output: BinaryIO) -> None:
        self._outbox = Outbox(output)
        self._work: queue.SimpleQueue[dict[str, Any]] = queue.SimpleQueue()
        self._layout_work: queue.SimpleQueue[dict[str, Any]] = queue.SimpleQueue()
        self._lock = threading.Lock()  # of the renderer's coming and going
        self._renderer: Any = None
        self._stops = 0  # an arming that was overtaken by a stop is undone
        self._sleeps = self._is_muted = self._is_paused = self._senses = False
        self._contact_current: Any = None  # of this surface, made once
        self._virtual_finger: Any = None  # which a mock senses
        self._live_current: Any = None  # of a virtual finger on a mock
        self._intensity = 1.0
        self._touching: set[int] = set()
        self._entered: dict[tuple[int, int], str] = {}  # regions by finger and key of the region
        self._touches = TouchGate(self._touch, self._touch_interval_s)
        self._effects: dict[int, Any] = {}
        self._next_effect = 1
        self._tick_s = time.monotonic()
        self._force = ForceModel()
        self._device: Any = None
        self._known: Any = None  # the driver's capabilities when it was opened first
        self._is_free = threading.Semaphore()  # the device: no renderer has it, nobody opens it
        self._gone = ""  # why the driver is gone
        self._look_s = 0.0  # when to look for it
        self._told = 0  # reports of the output's state
        self._unloaded = ""  # why nothing can be rendered
        self._surface: Any = None
        self._driven: Any = None
        self._layouts: dict[int, Any] = {}  # by session
        self._maps = MapMemory(MOST_MAP_BYTES, "all sessions' materials")
        self._ended = threading.Event()
        self._telemetry = Telemetry(self._outbox.tell, _LOOK_S)

    def run(self, source: FrameReader) -> None:
        """Handle frames until the input ends; then end at 0 V."""
        for name, target in (
            ("worker", partial(self._works, self._work)),
            ("layouts", partial(self._works, self._layout_work)),
            ("watch", self._watches),
        ):
            threading.Thread(target=target, name=f"haptix engine {name}", daemon=True).start()
        try:
            while frames := source.read():
                # Of all that has come, the newest touches count.
                touches: list[TouchEvent] = []
                for kind, data in frames:
                    if kind == BEAT:
                        self._outbox.tell(frame(BEAT, b""))
                    elif kind == TOUCHES:
                        touches += touches_of(data)
                    elif kind == JSON:
                        self._put(touches)
                        touches = []
                        self._dispatch(data)
                self._put(touches)
        finally:
            self._ended.set()
            self._stop("the service ended")
            if self._device is not None:
                self._device.close()
            self._outbox.close()

    # --- at once ---------------------------------------------------------------------------------

    def _dispatch(self, data: bytes) -> None:
        try:
            message = parse_json(data)
        except ValueError as error:  # a fault of the front; the other clients go on
            sys.excepthook(type(error), error, error.__traceback__)
            return
        do = message["do"]
        if do == "tick":
            self._tick_s = time.monotonic()
        elif do == "stop":
            self._stop(message["reason"])
        elif do in ("sleep", "wake"):
            self._sleep(do == "sleep")
        elif do == "lift":
            self._lift()
        elif do == "streams":
            self._telemetry.ask(message["rates"])
        elif do in _LAYOUTS:
            self._layout_work.put(message)
        else:
            self._work.put(message)

    def _put(self, touches: list[TouchEvent]) -> None:
        if touches:
            self._touches.put(touches)

    def _touch(self, touches: list[TouchEvent]) -> None:
        renderer = self._renderer
        if renderer is None or self._sleeps:
            return
        try:
            renderer.events(touches)
            for touch in touches:
                if self._live_current is not None:
                    self._draw(touch)
                if touch.kind == "up":
                    self._touching.discard(touch.touch_id)
                else:
                    self._touching.add(touch.touch_id)
        except Exception as error:
            self._fail(error)

    def _draw(self, touch: TouchEvent) -> None:
        """Let the virtual finger of a mock draw the current of a touch."""
        if touch.kind == "up":
            self._live_current.lift(touch.touch_id)
            return
        known = self._force.estimate(touch.normal_force_n, touch.contact_area_m2)
        force_n = (known or self._force.assumed).normal_force_n
        self._live_current.touch(touch.t_s, touch.x_mm, touch.y_mm, force_n, touch.touch_id)

    def _touch_interval_s(self) -> float:
        """Twice the time that a window took of late, where nothing else held it up."""
        renderer = self._renderer
        times = [] if renderer is None else renderer.stats.block_s  # another thread appends to it
        took = (times[-number] for number in range(1, min(len(times), 8) + 1))
        return min(2 * min(took, default=0.0), _MOST_TOUCH_INTERVAL_S)

    def _lift(self) -> None:
        self._touches.forget()
        renderer, touching = self._renderer, list(self._touching)
        self._touching.clear()
        if renderer is not None:
            try:
                for touch_id in touching:
                    renderer.lift(renderer.now_s(), touch_id)
            except Exception as error:
                self._fail(error)

    def _sleep(self, on: bool) -> None:
        self._sleeps = on
        _LOG.info("sleeps" if on else "wakes")
        if on:
            self._lift()
        try:
            self._set_mute(self._renderer)
        except Exception as error:
            self._fail(error)

    def _set_mute(self, renderer: Any) -> None:
        if renderer is not None:
            renderer.mute(self._sleeps or self._is_muted)

    def _stop(self, reason: str) -> None:
        with self._lock:
            self._stops += 1
            renderer, self._renderer = self._renderer, None
        if renderer is None:
            return
        _LOG.info("stops: %s", reason)
        error = InputError(reason)  # leaving with an error drops the queue
        try:
            renderer.__exit__(InputError, error, None)
        except HaptixError as failure:
            self._tell_output("failed", str(failure))
        finally:
            self._look_s = 0.0
            self._is_free.release()
        self._entered.clear()
        self._outbox.say(event="all_left")

    def _tell_output(self, state: str, reason: str) -> None:
        """Report a state of the output, with the number of this report."""
        self._told += 1
        self._outbox.say(event="output", state=state, reason=reason, number=self._told)

    def _fail(self, error: Exception) -> None:
        """End at 0 V with a reason; no thread ends by an exception of a driver or of ours."""
        _LOG.info("fails, %s: %s", type(error).__name__, error)
        if not isinstance(error, HaptixError):
            sys.excepthook(type(error), error, error.__traceback__)
        self._stop(str(error))
        self._tell_output("failed", str(error))

    def _watches(self) -> None:
        asleep: Any = None  # the renderer that sleeps because the front is silent
        while not self._ended.wait(_LOOK_S):
            silent_s = time.monotonic() - self._tick_s
            renderer = self._renderer
            if renderer is None:
                self._look_after_driver()
                continue
            try:
                renderer.poll()
                self._telemetry.tell(renderer, time.monotonic())
            except Exception as error:
                self._fail(error)
            if silent_s > STOP_S:
                self._stop("the service's front is silent")
            elif silent_s > SLEEP_S and asleep is not renderer:
                asleep = renderer
                self._sleep(True)
            elif silent_s <= SLEEP_S and asleep is renderer:
                asleep = None
                self._sleep(False)

    def _look_after_driver(self) -> None:
        """Ask a driver that rests whether it is there; open one again that is gone."""
        if time.monotonic() < self._look_s or not self._is_free.acquire(blocking=False):
            return
        try:
            self._look_s = time.monotonic() + _ASK_S
            if self._device is not None:
                self._device.progress(is_fresh=True)
            elif self._gone:
                self._open_again()
                self._tell_output("back", "the driver is there again")
        except DeviceFaultError:  # it is at 0 V, and can be armed
            pass
        except HaptixError as error:
            self._lose(str(error))
        except Exception as error:  # a fault of ours ends no thread
            sys.excepthook(type(error), error, error.__traceback__)
        finally:
            self._is_free.release()

    def _open_again(self) -> None:
        """Open the driver that was there before, and no other."""
        from haptix.play.devices import open_again

        self._device, self._gone = open_again(self._address, self._known), ""
        self._touch_mock()

    def _lose(self, reason: str) -> None:
        """Close a driver that does not answer, and tell why, once."""
        self._look_s = time.monotonic() + _OPEN_S
        if reason != self._gone:
            self._gone = reason
            self._tell_output("gone", reason)
        device, self._device = self._device, None
        if device is not None:
            with suppress(HaptixError, OSError):
                device.close()
            del device
            _forget_renderers()

    # --- in turn ---------------------------------------------------------------------------------

    def _works(self, work: queue.SimpleQueue[dict[str, Any]]) -> None:
        if work is self._work:
            try:
                _load()  # while the front starts, too
            except Exception as error:  # such as a library in C that this system cannot load
                sys.excepthook(type(error), error, error.__traceback__)
                self._unloaded = f"the engine cannot load: {error}; install haptix anew"
        while True:
            message = work.get()
            number = message.pop("n", None)
            answer = self._answer(message)
            if number is not None:
                self._outbox.say(n=number, **answer)

    def _answer(self, message: dict[str, Any]) -> dict[str, Any]:
        do = message.pop("do")
        if self._unloaded:
            return {"problem": {"code": "device", "sentence": self._unloaded}}
        code = "device" if do in _OF_DEVICE else "document"
        return answer_of(do, lambda: getattr(self, f"_do_{do}")(**message), code)

    def _do_open(
        self,
        device: str,
        surface: str | None,
        finger: str | None,
        screen: str | None,
        assets: str,
        touched_by: str | None = None,
    ) -> dict[str, Any]:
        """Open the device, and load or build the surface that its finger and screen need."""
        from haptix.base.threads import return_freed_memory
        from haptix.feel.materials import KINDS, schema
        from haptix.feel.materials.decoded import FOLDER, keep_in
        from haptix.model.finger import Finger
        from haptix.model.screen import Screen
        from haptix.play.devices import open_device, profiles_for
        from haptix.play.render.samples import carrier_hz, driven_surface
        from haptix.service.worker.document_work import profiles_of, surface_of

        self._assets = Path(assets)
        keep_in(self._assets.parent / FOLDER, makes=False)
        self._address = device
        self._device = self._device or open_device(device)  # a first try may have failed later
        self._known = self._device.capabilities
        finger, screen = profiles_for(self._device, finger, screen)
        used = Finger.named(finger), Screen.named(screen)
        used_by = {"finger": finger, "screen": screen, "ceiling_v": self._device.limits.ceiling_v}
        self._surface = surface_of({"surface": surface, **used_by})
        self._driven = driven_surface(self._surface, self._device)
        self._load_sensing(used[0] if touched_by is None else Finger.named(touched_by), used[1])
        return_freed_memory()
        return {
            "device": self._device.name,
            "is_real": not self._known.is_virtual,
            **used_by,
            "touched_by": finger if touched_by is None else touched_by,
            "screen_mm": (used[1].width_mm or SCREEN_MM, used[1].height_mm or SCREEN_MM),
            "profiles": profiles_of(*used, {"finger": finger, "screen": screen}),
            "carrier_hz": carrier_hz(self._surface),
            "highest_v": self._driven.voltage_limit_v,
            "kinds": sorted(KINDS),
            "schema": schema(),
        }

    def _do_reach(self, normal_force_n: float) -> dict[str, Any]:
        """Return the lowest and the highest friction coefficient that are played at a force."""
        column = self._driven.column(normal_force_n, None)
        return {"reachable_mu": (float(column.lowest_mu), float(column.highest_mu))}

    def _do_layout_set(self, session: int, document: dict[str, Any]) -> dict[str, Any]:
        return self._changed(session, "set", document)

    def _do_layout_change(self, session: int, ops: list[dict[str, Any]]) -> dict[str, Any]:
        return self._changed(session, "change", ops)

    def _do_layout_restore(
        self, session: int, document: dict[str, Any], values: dict[str, float], revision: int
    ) -> None:
        """Take the layout of a session that the engine before this one had."""
        self._changed(session, "set", document)
        ops = [{"op": "value", "name": name, "value": value} for name, value in values.items()]
        self._changed(session, "change", ops)
        self._layouts[session].revision = revision

    def _changed(self, session: int, how: str, change: Any) -> dict[str, Any]:
        from haptix.service.engine.session_layout import SessionLayout

        layout = self._layouts.get(session)
        if layout is None:
            layout = self._layouts.setdefault(session, SessionLayout(self._assets, self._maps))
        getattr(layout, how)(change)
        return {"revision": layout.revision}

    def _do_forget(self, session: int) -> None:
        self._layouts.pop(session, None)
        if self._renderer is None:  # it takes milliseconds
            _forget_renderers()

    def _do_arm(self, session: int) -> dict[str, Any]:
        if session not in self._layouts:
            raise InputError("arm: expected a layout; send layout_set first")
        stops, layout = self._stops + 1, self._layouts[session]
        self._stop("armed anew")
        self._check_device()
        self._is_free.acquire()
        try:
            return self._arm(session, stops, layout)
        except BaseException:
            self._is_free.release()
            raise

    def _check_device(self) -> None:
        if self._gone:
            raise DeviceDisconnectedError(
                f"arm: the driver is gone ({self._gone}); it is opened again once it is there"
            )
        if self._device is None:
            raise InputError("arm: a job has the device; wait for it, or cancel it")

    def _arm(self, session: int, stops: int, layout: SessionLayout) -> dict[str, Any]:
        """Arm the device, which is free; the renderer keeps it until it stops."""
        from haptix.play.render import LiveRenderer, LiveSettings
        from haptix.play.render.samples import carrier_hz

        self._check_device()  # it may have gone meanwhile
        observer = self._observer() if self._senses else False
        renderer = LiveRenderer(
            self._surface,
            layout.layout,
            self._device,
            settings=LiveSettings(strict=False, own_thread=False),  # it keeps a record
            sense=observer,
        )
        renderer.verified.on_warning = self._beyond_verified
        for kind in ("enter", "leave", "press", "release", "detent"):
            renderer.on(kind, partial(self._contact, session, layout))
        self._tick_s = time.monotonic()
        self._sleeps = False  # the client that arms is alive, even if an earlier holder fell silent
        renderer.__enter__()
        renderer.intensity(self._intensity)
        self._set_mute(renderer)
        if self._is_paused:
            renderer.pause()
        with self._lock:
            overtaken, told = self._stops != stops, self._told
            if not overtaken:
                self._renderer = renderer
        _LOG.info("armed for session %d%s", session, ", and overtaken by a stop" * overtaken)
        if overtaken:
            error = InputError("stopped while arming")
            renderer.__exit__(InputError, error, None)
            raise error
        drive = {"carrier_hz": carrier_hz(self._surface), "highest_v": renderer.highest_v}
        return {"full_drive": drive, "told": told}

    def _observer(self) -> FingerObserver | Literal[False]:
        """Return a new observer without an estimate; warn if the driver measures no current."""
        from haptix.play.sensing import FingerObserver

        if self._contact_current is None:
            self._outbox.say(
                event="warning",
                sentence="sense: this driver measures no current, so nothing is learned; a mock "
                "does with mock:pace=real,mode=envelope,sense_rate_hz=250",
            )
            return False
        return FingerObserver(self._contact_current)

    def _load_sensing(self, finger: Finger, screen: Screen) -> None:
        """Prepare what takes seconds, where a driver senses; a virtual finger loads a mock."""
        from haptix.model.friction import ContactModel
        from haptix.play.render.samples import carrier_hz
        from haptix.play.sensing import ContactCurrent
        from haptix.play.virtual_finger import VirtualCurrent

        device, hertz = self._device, carrier_hz(self._surface)
        if not device.capabilities.sense_rate_hz or device.mode != "envelope":
            return
        self._contact_current = ContactCurrent.of_surface(self._surface, hertz)
        if device.mock is not None:
            self._virtual_finger = VirtualCurrent(ContactModel(finger, screen), hertz)
            self._touch_mock()

    def _touch_mock(self) -> None:
        """Let the virtual finger load a mock that was opened."""
        from haptix.play.virtual_finger import LiveCurrent

        if self._virtual_finger is not None:
            self._live_current = LiveCurrent.on(self._device, self._virtual_finger)

    def _beyond_verified(self, sentence: str) -> None:
        self._outbox.say(event="warning", sentence=sentence)

    def _contact(self, session: int, layout: SessionLayout, event: LayoutEvent) -> None:
        if event.region is None:
            return
        place = event.touch_id, event.region.key
        if event.kind == "enter":
            names = (name for name, region in layout.regions.items() if region is event.region)
            self._entered[place] = next(names, "")
        # One that was removed under a finger is left by the name that it had.
        region = self._entered.get(place, "")
        if event.kind == "leave":
            self._entered.pop(place, None)
        with self._lock:
            if region and self._renderer is not None:  # nothing comes after `all_left`
                value = None if event.kind != "detent" else event.detent
                self._outbox.say(
                    event="contact",
                    session=session,
                    what=event.kind,
                    region=region,
                    touch_id=event.touch_id,
                    t_s=event.t_s,
                    value=value,
                )

    def _do_intensity(self, value: float) -> None:
        self._intensity = value
        if self._renderer is not None:
            self._renderer.intensity(value)

    def _do_mute(self, on: bool) -> None:
        self._is_muted = on
        self._set_mute(self._renderer)

    def _do_pause(self, on: bool) -> None:
        renderer, self._is_paused = self._renderer, on
        if renderer is not None:
            renderer.pause(on)

    def _do_sense(self, on: bool) -> None:
        self._senses = on

    def _do_play(self, effect: dict[str, Any]) -> dict[str, Any]:
        from haptix.base.kinds import in_folder
        from haptix.feel.materials import material_of

        renderer = self._renderer
        if renderer is None:
            raise InputError("play: expected an armed output; send arm first")
        number = self._next_effect
        self._next_effect += 1
        with self._maps.counts(), in_folder(self._assets, is_sealed=True):
            material = material_of(effect)
            playing = renderer.play(material, done=partial(self._ended_effect, number))
        self._effects[number] = playing
        return {"effect_id": number}

    def _ended_effect(self, number: int, ended: EffectEnd) -> None:
        self._effects.pop(number, None)
        self._outbox.say(
            event="effect_ended",
            effect_id=number,
            how=ended.outcome,
            sample=int(ended.sample),
            felt_share=float(ended.felt_share),
        )

    def _do_cancel(self, effect_id: int) -> None:
        effect = self._effects.get(effect_id)
        if effect is None:
            raise InputError(f"effect_id: expected an effect that plays, got {effect_id}")
        effect.stop()

    def _do_lend(self) -> None:
        """Let another process have the device."""
        self._stop("a job has the device")
        with self._is_free:
            device, self._device, self._gone = self._device, None, ""
            if device is not None:
                device.close()

    def _do_take_back(self) -> None:
        """Open the device again."""
        with self._is_free:
            if self._device is None:
                try:
                    self._open_again()
                except HaptixError as error:
                    self._lose(str(error))
                    raise


def _forget_renderers() -> None:
    """Free renderers that have ended: megabytes in few objects, in cycles with their layouts."""
    from haptix.base.threads import return_freed_memory

    gc.collect()
    return_freed_memory()


def _load() -> None:
    """Import all that renders. An import in the midst of a stroke would hold the stream up."""
    gc.disable()  # a fifth of the time; nothing that imports make is garbage
    for name in _RENDERS:
        importlib.import_module(name)
    gc.freeze()
    gc.enable()


def main() -> None:
    """Serve the front until it closes our input."""
    # An interrupt of the terminal goes to all processes of its group; the front ends us in order.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    EngineServer(frame_output()).run(FrameReader(sys.stdin.fileno()))


if __name__ == "__main__":
    main()
