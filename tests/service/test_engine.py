"""The engine in this process: what fails while it is watched ends at 0 V, and the watch goes on."""

import io
import json
import threading
import time
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from firmware_io import MockDriver
from firmware_io.serve import DriverServer
from haptix.base.errors import DeviceError, InputError
from haptix.feel.layout.layout import Listeners
from haptix.feel.motion import Report
from haptix.model.finger import Finger
from haptix.model.friction import ContactModel
from haptix.model.screen import Screen
from haptix.model.surface import FrictionSurface
from haptix.play import devices
from haptix.play.touch.events import TouchEvent
from haptix.service.engine import process as engine_module
from haptix.service.engine.process import EngineServer
from haptix.service.engine.session_layout import SessionLayout
from haptix.service.protocol.wire import BEAT, JSON, frame, read_frame, touch_frame
from tests.waiting import wait_for

SIZE = {"x_mm": 0.0, "y_mm": 0.0, "width_mm": 30.0, "height_mm": 20.0}


def test_a_frame_that_its_reader_refuses_ends_no_engine(capsys):
    """It would be a fault of the front, and other clients share the engine."""
    frames = iter([[(JSON, b'{"do": "tick", "n": NaN}')], [(BEAT, b"")], []])
    output = io.BytesIO()
    EngineServer(output).run(SimpleNamespace(read=lambda: next(frames)))
    assert output.getvalue() == frame(BEAT, b"")
    assert "NaN" in capsys.readouterr().err


class FakeRenderer:
    """A renderer that raises where its driver has failed."""

    is_muted = False
    stats = SimpleNamespace(block_s=[])
    highest_v = 1.0
    verified = SimpleNamespace(on_warning=None)

    def __init__(self, error=None, at=""):
        self.error, self.at, self.exits = error, at, 0

    def on(self, kind, handler):
        pass

    def __enter__(self):
        return self

    def _do(self, name):
        if name == self.at:
            raise self.error

    def now_s(self):
        return time.monotonic()

    def poll(self):
        self._do("poll")

    def lift(self, t_s, touch_id):
        self._do("lift")

    def mute(self, on):
        if on:
            self._do("mute")
        self.is_muted = on

    def intensity(self, value):
        pass

    def events(self, events):
        self._do("events")

    def __exit__(self, *what):
        self.exits += 1


def told(output):
    """What the engine has said."""
    stream, found = io.BytesIO(output.getvalue()), []
    while (one := read_frame(stream)) is not None:
        assert one[0] == JSON
        found.append(json.loads(one[1]))
    return found


class Input:
    """Frames that come when the test says so, then the end."""

    def __init__(self, batches):
        self.batches = batches

    def read(self):
        return next(self.batches, [])


def said(*messages):
    """Frames of messages to the engine."""
    return [(JSON, json.dumps(message).encode()) for message in messages]


def has_ended(renderer):
    return renderer.exits == 1


@pytest.mark.parametrize("at", ["poll", "lift", "mute", "events"])
@pytest.mark.parametrize("error", [DeviceError("starved"), ZeroDivisionError("a fault of ours")])
def test_a_driver_that_fails_while_the_front_is_silent_ends_at_0_v(monkeypatch, at, error):
    monkeypatch.setattr(engine_module, "SLEEP_S", 60.0 if at == "events" else 0.01)
    monkeypatch.setattr(EngineServer, "_works", lambda self, work: None)
    if isinstance(error, ZeroDivisionError):
        monkeypatch.setattr("sys.excepthook", lambda *what: None)
    monkeypatch.setattr("haptix.service.engine.process.Telemetry.tell", lambda *what: None)
    output = io.BytesIO()
    server = EngineServer(output)
    failing = [FakeRenderer(error, at) for _ in range(2)]

    def batches():
        for one in failing:  # the second is armed once the first has failed: it is watched, too
            yield said({"do": "tick"}, {"do": "wake"})
            server._touching, server._renderer = {1}, one
            touch = TouchEvent(time.monotonic(), 1, 1.0, 1.0, "down", None, None)
            yield [read_frame(io.BytesIO(touch_frame([touch])))]
            wait_for(partial(has_ended, one))

    server.run(Input(batches()))
    failed = [one for one in told(output) if one["event"] == "output"]
    assert [one["state"] for one in failed] == ["failed", "failed"]
    assert all("starved" in one["reason"] or "fault" in one["reason"] for one in failed)


def test_a_region_that_is_removed_under_a_finger_is_left_and_nothing_comes_after_the_end():
    output = io.BytesIO()
    server, layout = EngineServer(output), SessionLayout(Path())
    layout.change(
        [{"op": "add", "name": "ribs", "material": {"kind": "grating", "period_mm": 2.0}, **SIZE}]
    )
    renderer = FakeRenderer()
    server._renderer = renderer
    listeners = Listeners()
    for kind in ("enter", "leave"):
        listeners.on(kind, partial(server._contact, 7, layout))
    on = Report(0.0, 5.0, 5.0, 0.5)
    listeners.report(layout.layout, 1, 0.0, on)
    listeners.report(layout.layout, 2, 0.0, on)
    layout.change([{"op": "remove", "name": "ribs"}])
    listeners.report(layout.layout, 1, 1.0, on._replace(t_s=1.0))
    server._stop("it ends")
    listeners.report(layout.layout, 2, 1.0, on._replace(t_s=1.0))
    server._outbox.close()
    heard = [(one["event"], one.get("what"), one.get("touch_id")) for one in told(output)]
    assert heard == [
        ("contact", "enter", 1),
        ("contact", "enter", 2),
        ("contact", "leave", 1),
        ("all_left", None, None),
    ]
    assert {(one["session"], one["region"]) for one in told(output)[:3]} == {(7, "ribs")}


@pytest.fixture
def flat(monkeypatch):
    """A surface that takes no time to build, and an engine that opens with it."""
    model = ContactModel(Finger(), Screen(), fidelity="closed-form")
    surface = FrictionSurface.build(model, {"normal_force_n": (0.4, 0.6)}, 0.01)
    monkeypatch.setattr("haptix.model.surface.cached_surface", lambda *_: (surface, True))
    monkeypatch.setattr(
        "haptix.feel.materials.decoded.keep_in", lambda *_, **__: None
    )  # for all tests


class Watched:
    """An engine whose device is looked after, as in its process."""

    def __init__(self, device, folder):
        self.output = io.BytesIO()
        self.server = EngineServer(self.output)
        self.opened = self.server._do_open(device, None, None, None, str(folder))
        self.server._do_layout_set(1, {"regions": []})
        self.thread = threading.Thread(target=self.server._watches)
        self.thread.start()

    @property
    def states(self):
        return [one["state"] for one in told(self.output) if one.get("event") == "output"]

    def end(self):
        self.server._ended.set()
        self.thread.join()
        self.server._stop("done")
        if self.server._device is not None:
            self.server._device.close()


def test_a_device_below_the_screen_is_armed_up_to_its_ceiling(tmp_path, flat):
    engine = Watched("mock:pace=real,ceiling_v=150", tmp_path)
    assert engine.opened["ceiling_v"] == 150.0
    assert engine.server._do_arm(1)["full_drive"]["highest_v"] == 150.0
    engine.end()


@pytest.mark.parametrize("options", ["", ",mode=envelope", ",ceiling_v=150"])
def test_the_reach_is_that_of_the_highest_amplitude_which_is_sent(tmp_path, flat, options):
    engine = Watched(f"mock:pace=real{options}", tmp_path)
    low, high = engine.server._do_reach(0.5)["reachable_mu"]
    highest_v = engine.server._do_arm(1)["full_drive"]["highest_v"]
    engine.end()
    assert highest_v < engine.server._surface.voltage_limit_v or highest_v == 150.0
    assert engine.opened["highest_v"] == highest_v
    expected = [float(engine.server._surface.mu(0.5, amplitude)) for amplitude in (0.0, highest_v)]
    assert [low, high] == pytest.approx(expected)  # the same lines between the same nodes


@pytest.mark.parametrize("is_armed", [True, False])
def test_a_driver_that_was_unplugged_is_opened_again_by_itself(tmp_path, flat, is_armed):
    def plugged(port=0):
        return DriverServer(MockDriver(pace="real", serial="A"), port=port)

    with plugged() as driver:
        port = driver.port
        engine = Watched(driver.address, tmp_path)
        assert not engine.opened["is_real"]
        threads = threading.active_count()
    try:
        files = len([*Path("/proc/self/fd").iterdir()])
        for number in range(1, 4):
            wait_for(lambda: engine.states[-1:] == ["gone"])
            with pytest.raises(DeviceError, match="gone"):
                engine.server._do_arm(1)
            with plugged(port):
                wait_for(lambda: engine.states[-1] == "back")
                if is_armed:
                    engine.server._do_arm(1)
                    wait_for(lambda: engine.server._renderer.stats.samples_played > 0)
            if is_armed:
                wait_for(lambda: engine.states[-1] == "gone")
            assert engine.states.count("back") == number
            assert engine.states.count("failed") >= is_armed * number
            assert not is_armed or engine.server._renderer is None
        assert threading.active_count() <= threads
        assert len([*Path("/proc/self/fd").iterdir()]) <= files + 1
    finally:
        engine.end()


def test_who_arms_twice_is_armed_anew(tmp_path, flat):
    engine = Watched("mock:pace=real", tmp_path)
    engine.server._do_arm(1)
    first = engine.server._renderer
    engine.server._do_arm(1)
    assert engine.server._renderer is not first
    assert engine.server._device.is_armed
    engine.end()


def test_another_driver_in_its_place_is_not_taken(tmp_path, flat):
    with DriverServer(MockDriver(pace="real", serial="A")) as driver:
        port = driver.port
        engine = Watched(driver.address, tmp_path)
    try:
        other = MockDriver(pace="real", serial="A", ceiling_v=120.0)
        with DriverServer(other, port=port):
            wait_for(lambda: any("another driver" in one["reason"] for one in told(engine.output)))
            with pytest.raises(DeviceError, match="gone"):
                engine.server._do_arm(1)
        assert "back" not in engine.states
    finally:
        engine.end()


@pytest.mark.parametrize(
    ("address", "tried"),
    [
        ("usb:bus=1,address=7", ["usb:bus=1,address=7", "usb:"]),
        (
            "hid:path=/dev/hidraw3,mode=envelope",
            ["hid:path=/dev/hidraw3,mode=envelope", "hid:mode=envelope"],
        ),
        ("serial:port=/dev/ttyUSB0", ["serial:port=/dev/ttyUSB0", "serial:"]),
        ("usb:serial=A", ["usb:serial=A"]),
        ("tcp:localhost:7420", ["tcp:localhost:7420"]),
    ],
)
def test_a_driver_is_found_at_another_place_of_its_bus(monkeypatch, address, tried):
    """A replugged driver may have another number; it is taken if it is the same one."""
    opened = []

    def open_device(where):
        opened.append(where)
        if where == address:
            raise DeviceError("it is not there")
        return SimpleNamespace(capabilities="those of A", close=lambda: None)

    monkeypatch.setattr(devices, "open_device", open_device)
    if len(tried) == 1:
        with pytest.raises(DeviceError, match="not there"):
            devices.open_again(address, "those of A")
    else:
        again: Any = devices.open_again(address, "those of A")
        assert again.capabilities == "those of A"
    assert opened == tried


def test_a_device_that_a_job_gives_back_is_sensed_again(tmp_path, flat):
    engine = Watched("mock:pace=real,mode=envelope,sense_rate_hz=250", tmp_path)
    try:
        before = engine.server._live_current
        engine.server._do_lend()
        with pytest.raises(InputError, match="a job has the device"):
            engine.server._do_arm(1)
        engine.server._do_take_back()
        assert engine.server._live_current is not before is not None
        assert engine.states == []
    finally:
        engine.end()


def test_who_arms_after_a_silent_holder_is_felt(monkeypatch):
    renderer = FakeRenderer()
    monkeypatch.setattr(EngineServer, "_works", lambda self, work: None)
    monkeypatch.setattr("haptix.service.engine.process.Telemetry.tell", lambda *what: None)
    monkeypatch.setattr("haptix.play.render.LiveRenderer", lambda *_, **__: renderer)
    monkeypatch.setattr("haptix.play.render.samples.carrier_hz", lambda surface: 4000.0)
    server = EngineServer(io.BytesIO())
    server._device = SimpleNamespace(close=lambda: None, progress=lambda **_: None)
    server._layouts[2] = SimpleNamespace(layout=None)
    server._renderer = before = FakeRenderer()

    def batches():
        yield said({"do": "sleep"})
        assert before.is_muted
        yield said({"do": "stop", "reason": "the lease is free"})
        server._do_arm(2)
        assert not renderer.is_muted

    server.run(Input(batches()))
