"""A thread that plays without the interpreter: its source, and what ends it."""

import ctypes
import os
import re
import shutil
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import numpy as np
import pytest

import haptix
from firmware_io import Device, DriveLimits, Playback
from firmware_io.link import Bulk, Link
from firmware_io.links.mock import MockDriver
from firmware_io.links.serial import SerialLink
from firmware_io.links.tcp import TcpLink
from firmware_io.own_thread import QUIET_S, OwnThread, finger_report
from firmware_io.reviser import PlaybackStats
from firmware_io.serve import DriverServer
from haptix.base.native import ffi, library
from haptix.feel.layout import Layout
from haptix.feel.materials import (
    Button,
    FrictionField,
    Grating,
    Moving,
    Slider,
    Texture,
    Transient,
    WebEffect,
)
from haptix.play import LiveSettings, compile_touch
from haptix.play.render.engine import EngineSource
from haptix.play.render.fingers import PredictedFingers
from haptix.play.render.live import RenderSource
from haptix.play.render.master import Master
from haptix.play.render.played import PlayedRecord
from haptix.play.render.program import compile_core
from haptix.play.render.samples import RenderCore
from haptix.play.touch import OneEuroFilter, TouchEvent, TouchSettings
from tests.live_strokes import Ruler
from tests.waiting import pause, wait_for

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="the interpreter plays there")

CLICK = {"kind": "pulse", "height": 0.8, "width_s": 0.05, "length_s": 0.1}
CODE_V = 200.0 / 2**15
LEVEL = np.random.default_rng(9).random((12, 20)).astype(np.float32).astype(float)


def ribs():
    layout = haptix.Layout()
    layout.add(Grating(period_mm=2.0), width_mm=60, height_mm=40)
    return layout


def mixed():
    """A layout of places, of what a finger did, and of regions that multiply."""
    layout = haptix.Layout()
    layout.add(Texture(LEVEL, 30.0))
    layout.add(Button(width_mm=12.0, height_mm=12.0), x_mm=10, y_mm=4)
    layout.add(
        Grating(period_mm=3.0, target="contrast", low=0.0, high=0.2), x_mm=5, y_mm=5,
        width_mm=20, height_mm=10,
    )  # fmt: skip
    return layout


def scene():
    """A layout that changes in time, and with what a finger did."""
    layout = mixed()
    layout.add(
        Moving(of=Texture(LEVEL, 30.0), velocity_mm_s=(20.0, 5.0)), width_mm=20, height_mm=20
    )
    layout.add(Transient(curve=CLICK, begins="detent"), width_mm=12, height_mm=12)
    return layout


def effect(random):
    """An effect, of shares or of contrasts."""
    begins = str(random.choice(["start", "down", "detent"]))
    height, length_s = float(random.uniform(0.1, 0.9)), float(random.uniform(0.02, 0.3))
    if random.random() < 0.4:
        name = str(random.choice(["edge", "align", "error"]))
        return WebEffect(name=name, intensity=height, begins=begins)
    curve = {"kind": "pulse", "height": height, "width_s": 0.02, "rest": 0.1}
    if random.random() < 0.5:
        curve = {"kind": "chirp", "amplitude": height, "start_hz": 20.0, "end_hz": 90.0}
    return Transient(curve={**curve, "length_s": length_s}, begins=begins)


def no_effects(effect):
    """Compile none: none is played."""
    raise AssertionError(effect)


def turn(master, random, now_s):
    """Turn a knob."""
    if master.is_muted:
        master.turn(now_s, is_muted=False)
    elif master.is_paused:
        master.resume(now_s)
    else:
        changes = {"intensity": float(random.random())}, {"is_muted": True}
        choice = random.integers(3)
        master.pause(now_s) if choice == 2 else master.turn(now_s, **changes[choice])


def alter(layout, random):
    """Change a region of a layout, add one or remove one."""
    there = [region for region in layout.regions.values() if region.is_there]
    x_mm, y_mm = random.uniform(0, 15, 2)
    if len(there) < 2:
        turned = {
            "rotation_deg": float(random.uniform(0, 90)),
            "scale": float(random.uniform(1, 2)),
        }
        material = Grating(period_mm=float(random.uniform(1, 4)))
        layout.add(material, x_mm, y_mm, width_mm=20, height_mm=15, **turned)
        return
    region = there[random.integers(len(there))]
    choice = random.integers(5)
    if choice == 0:
        over_s = float(random.choice([0.0, 0.01, 0.1]))
        region.move(x_mm, y_mm, over_s=over_s, rotation_deg=float(random.uniform(0, 90)))
    elif choice == 1:
        region.move(scale=float(random.uniform(0.5, 2)), over_s=0.05)
    elif choice == 2:
        region.change(opacity=float(random.uniform(0.2, 1)), priority=int(random.integers(3)))
    elif choice == 3:
        region.remove()
    elif isinstance(region.material, Slider):
        region.set_value(float(random.random()))
    else:
        region.change(material=Slider(travel_mm=20, detents=5), width_mm=20, height_mm=15)


@pytest.mark.parametrize("make", [ribs, mixed, scene])
@pytest.mark.parametrize("seed", range(6))
def test_the_source_in_c_makes_the_windows_of_the_one_in_python(surface, make, seed):
    random = np.random.default_rng(seed)
    settings = LiveSettings(strict=False)
    with haptix.open_device("mock:") as device:
        core = RenderCore(surface, make(), device, settings=settings)
    compiled = EngineSource(
        compile_core(core, settings, moving=True), settings.reaction_s,
        lambda effect: compile_core(core, settings, felt=effect.evaluator),
    )  # fmt: skip
    fingers = PredictedFingers(settings)
    react = core.texture.evaluator.react
    master = Master(lambda: None)
    amplitudes = []
    python = RenderSource(
        core, fingers, master, lambda block, *_: amplitudes.append(block.amplitude_v.max())
    )
    rate, step, began_s = core.sample_rate_hz, core.step, 1000.25
    played = 0
    layout = core.texture
    assert isinstance(layout, Layout)
    layout.attach(lambda: master.scene_s(played / rate + settings.reaction_s))
    sent, pending, is_down = 0, 0, [False, False]
    ends = []

    def scene_s():
        return master.scene_s(played / rate + settings.reaction_s)

    places = random.uniform(5, 15, (2, 2))

    def window(first, count, is_revision):
        at_s = began_s + first / rate
        before = [playing.felt.copy() for playing in master.effects]
        one = python.window(first, count, at_s, is_revision)
        after = [playing.felt.copy() for playing in master.effects]
        for playing, felt in zip(master.effects, before, strict=True):
            playing.felt[:] = felt
        other = np.empty(count)
        library.hx_live_window(
            compiled.at, first, count, at_s, is_revision, ffi.from_buffer("double[]", other)
        )
        np.testing.assert_allclose(other, one, atol=CODE_V, err_msg=f"{first} {is_revision}")
        for playing, felt in zip(master.effects, after, strict=True):
            np.testing.assert_array_equal(playing.felt, felt)
        return np.abs(one).max()

    largest, rendered = 0.0, 0
    for round_ in range(60):
        while sent - played < 0.15 * rate:
            largest = max(largest, window(sent, 480 * step, False))
            sent += 480 * step
            rendered += 480 * step
        played += int(random.integers(1, 4)) * 120 * step
        now_s = began_s + played / rate
        finger = int(random.integers(2))
        places[finger] += random.normal(0, 1.0, 2)
        kind = "up" if is_down[finger] and random.random() < 0.1 else "move"
        is_down[finger] = kind != "up"
        force = None if random.random() < 0.3 else float(random.uniform(0.2, 1.0))
        t_s = now_s - float(random.uniform(0.0, 0.02))
        x_mm, y_mm = places[finger].tolist()
        fingers.take(TouchEvent(t_s, finger, x_mm, y_mm, kind, force), now_s, react)
        library.hx_live_report(
            compiled.at, finger, kind != "up", now_s, t_s, x_mm, y_mm, force or 0.0
        )
        if random.random() < 0.3:
            turn(master, random, played / rate + settings.reaction_s)
            compiled.mix(master.compiled, master.effects)
        if random.random() < 0.3:
            alter(layout, random)
            program = compile_core(core, settings, moving=True, kept=compiled.maps)
            compiled.adopt(program, master.compiled, master.effects)
        if random.random() < 0.3:
            began = master.play(effect(random), scene_s, int(random.integers(3)), ends.append)
            if random.random() < 0.3:
                began.stop()
            compiled.mix(master.compiled, master.effects)
        first = (played // step + 40) * step
        largest = max(largest, window(first, 240 * step, True))
        rendered += 240 * step
        pending += 1
        if random.random() < 0.6:
            obeyed = int(random.integers(pending + 1))
            undone = random.random() < 0.3
            python.settle(obeyed, undone)
            library.hx_live_settle(compiled.at, obeyed, undone)
            pending = 0 if undone else pending - obeyed
        python.played(played // step * step - 1000 * step if played > 1000 * step else 0)
        assert bool(library.hx_live_is_live(compiled.at)) == python.is_live, round_
        if random.random() < 0.3:
            master.ended(scene_s(), rate)
    assert largest > 20.0
    assert 0.0 < max(end.felt_share for end in ends) <= 1.0
    assert compiled.counts.samples == rendered
    assert compiled.counts.most_v == pytest.approx(max(amplitudes), abs=CODE_V)


def test_maps_are_taken_over_from_the_program_before_and_from_no_other(surface):
    settings, layout = LiveSettings(), mixed()
    layout.add(Texture(np.ones((256, 256)), 20.0), width_mm=20, height_mm=20)
    with haptix.open_device("mock:") as device:
        core = RenderCore(surface, layout, device, settings=settings)
    whole = compile_core(core, settings, moving=True)
    engine = EngineSource(whole, settings.reaction_s, no_effects)
    after = compile_core(core, settings, moving=True, kept=engine.maps)
    assert len(after.program) < len(whole.program) - 4 * 256**2  # the map is not in it
    engine.adopt(after, Master(lambda: None).compiled)
    assert engine.maps == after.maps

    def refusal(program, before):
        return library.hx_engine_size_after(program, len(program), before)

    wrong_number = -4
    assert library.hx_engine_size(after.program, len(after.program)) == wrong_number
    assert refusal(after.program, ffi.NULL) == wrong_number
    tick = compile_core(core, settings, felt=WebEffect(name="tick").evaluator)
    without_maps = EngineSource(tick, 0.003, no_effects)
    assert refusal(after.program, without_maps._engines[0].at) == wrong_number
    (first, _), *others = engine.maps
    beyond = compile_core(core, settings, moving=True, kept=[(first, 99), *others])
    assert refusal(beyond.program, engine._engines[0].at) == wrong_number


@pytest.fixture
def served():
    """A mock of another process, over TCP, and the path of its record."""
    process = subprocess.Popen(
        [sys.executable, "-m", "firmware_io.serve", "--port", "0"],
        stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    host, port = process.stdout.readline().strip().split(":")[1:]
    yield TcpLink(host, int(port)), process
    process.kill()
    process.wait()
    process.stdout.close()


@pytest.fixture
def device(served):
    device = Device(served[0])
    yield device
    device.close()


def stroke(renderer, seconds=0.3, report_s=0.01):
    """Stroke the screen, and return what the output did."""
    began_s = time.monotonic()
    while (now_s := time.monotonic()) < began_s + seconds:
        x_mm = 20.0 + 15.0 * np.sin(6.0 * (now_s - began_s))
        renderer.event(TouchEvent(now_s - 0.005, 0, x_mm, 20.0, "move", 0.5))
        pause(report_s)


def hold_the_interpreter(seconds):
    """Let no other thread of Python run, as a long call of a library does."""
    ctypes.PyDLL(None).usleep(int(1e6 * seconds))


LIVE = LiveSettings(strict=False)


def test_it_plays_through_stalls_of_the_interpreter_longer_than_the_queue(surface, device):
    with haptix.LiveRenderer(surface, ribs(), device, settings=LIVE) as renderer:
        assert renderer.plays_by == "engine"
        stroke(renderer)
        for _ in range(2):
            hold_the_interpreter(0.4)  # the queue holds less than 0.2 s, the watchdog waits 0.1 s
            stroke(renderer, 0.1)
        assert device.is_armed
    assert not device.is_armed and not device.stop_is_owed
    assert renderer.stats.revisions > 10
    assert renderer.stats.revisions < len(renderer.stats.block_s)
    assert renderer.stats.p50_block_s > 0.0
    assert len(renderer.stats.reactions_s) > 10
    assert renderer.stats.samples_played > 0.9 * 48_000


def test_another_process_reports_fingers_while_the_interpreter_stands_still(surface, device):
    with haptix.LiveRenderer(surface, ribs(), device, settings=LIVE) as renderer:
        assert renderer.reports is not None
        script = (
            "import sys, time, os\n"
            "from firmware_io.own_thread import finger_report\n"
            "print(flush=True)\n"
            "for i in range(60):\n"
            "    now_s = time.monotonic()\n"
            f"    os.write({renderer.reports}, finger_report(0, now_s, 20 + i / 5, 20.0, 0.5))\n"
            "    time.sleep(0.01)\n"
        )
        child = subprocess.Popen(
            [sys.executable, "-c", script], stdout=subprocess.PIPE, pass_fds=[renderer.reports]
        )
        child.stdout.read(1)
        hold_the_interpreter(0.5)
        wait_for(lambda: child.poll() is not None)
        child.stdout.close()
        wait_for(lambda: len(renderer.stats.reactions_s) > 20)


def test_it_ends_at_0_v_when_the_interpreter_stands_still_for_long(surface, device):
    with haptix.LiveRenderer(surface, ribs(), device, settings=LIVE) as renderer:
        stroke(renderer, 0.1)
        hold_the_interpreter(QUIET_S + 0.4)
        wait_for(lambda: not device.is_armed)
        with pytest.raises(haptix.DeviceError, match="stood still"):
            stroke(renderer)
    assert device.last_v == 0.0 and not device.stop_is_owed


def test_a_lost_link_ends_it(surface, served):
    link, process = served
    device = Device(link)
    with (
        pytest.raises(haptix.DeviceError, match="failed"),
        haptix.LiveRenderer(surface, ribs(), device, settings=LIVE) as renderer,
    ):
        stroke(renderer, 0.1)
        process.kill()
        for _ in range(1000):
            stroke(renderer, 0.1)


def test_a_fault_of_the_driver_ends_it(surface, served, device):
    link, _ = served
    with haptix.LiveRenderer(surface, ribs(), device, settings=LIVE) as renderer:
        stroke(renderer, 0.1)
        os.write(link.descriptor, b"not a frame, and long enough to be looked at as one" * 4)
        wait_for(lambda: not device.is_armed)
        with pytest.raises(haptix.DeviceError, match="fault"):
            stroke(renderer)
    assert device.last_v == 0.0 and not device.stop_is_owed


def test_samples_over_a_limit_are_not_sent(surface, served):
    link, _ = served
    with haptix.open_device("mock:") as strong:
        program = compile_core(RenderCore(surface, ribs(), strong, settings=LIVE), LIVE)
    device = Device(link, DriveLimits(ceiling_v=20.0))
    stats = PlaybackStats()
    own = OwnThread(device, EngineSource(program, 0.003, no_effects).compiled(4), stats)
    with (
        pytest.raises(haptix.LimitError, match="ceiling of 20 V"),
        Playback(device, None, stats=stats, writer=lambda: own) as playback,
    ):
        while True:
            now_s = time.monotonic()
            own.report(finger_report(0, now_s, 20.0 + 40.0 * (now_s % 0.5), 20.0, 0.5))
            playback.raise_once()
            pause(0.01)
    assert device.last_v == 0.0 and not device.stop_is_owed
    device.close()


class Hum(FrictionField):
    """An effect of a kind that is not haptix's own."""

    target = "share"
    outside, length_s = 0.0, 0.05

    def _sample(self, x_mm, y_mm, footprint_mm):
        return np.full(x_mm.shape, 0.1)


@pytest.mark.parametrize(
    "change",
    [
        lambda r: r.texture.add(Ruler(), width_mm=9, height_mm=9),
        lambda r: r.play(Hum()),
        lambda r: setattr(r, "record", PlayedRecord(r)),
    ],
)
def test_a_change_lets_the_interpreter_go_on(surface, device, change):
    with haptix.LiveRenderer(surface, ribs(), device, settings=LIVE) as renderer:
        stroke(renderer, 0.2)
        before_s = renderer.scene_s
        change(renderer)
        assert renderer.plays_by == "interpreter"
        assert before_s < renderer.next_sample_s < before_s + 60.0
        stroke(renderer, 0.2)
        assert device.is_armed
        assert renderer._source.amplitudes.values.any()  # the interpreter's
    assert not device.stop_is_owed


def test_effects_play_and_their_ends_are_told(surface, device):
    ends = []
    with haptix.LiveRenderer(surface, ribs(), device, settings=LIVE) as renderer:
        stroke(renderer, 0.3)
        renderer.play(Transient(curve=CLICK), done=ends.append)
        stroke(renderer, 0.4)
        began = renderer.play(WebEffect(name="error"), done=ends.append)
        stroke(renderer, 0.02)
        began.stop()
        stroke(renderer, 0.2)
        assert [end.outcome for end in ends] == ["played", "cut"]
        assert ends[0].felt_share > 0.5  # of a finger that slides all the time
        for _ in range(50):
            renderer.play(WebEffect(name="tick"), done=ends.append)
            stroke(renderer, 0.01)
        assert renderer.plays_by == "engine"
        assert renderer.stats.underruns == 0
        stroke(renderer, 0.5)
        assert len(ends) == 52
        renderer.intensity(0.5)
        stroke(renderer, 0.1)
        renderer.intensity(1.0)
        assert not any(
            engines for engines, _ in renderer._engine._mixes
        )  # no memory of them is kept
    assert not device.stop_is_owed


def test_marks_come_back_with_their_times(surface, device):
    with haptix.LiveRenderer(surface, ribs(), device, settings=LIVE) as renderer:
        stroke(renderer, 0.3)
        asked_s = []
        for code in range(30):  # more at once than a driver has room for
            asked_s.append(time.monotonic())
            renderer.mark(code)
        stroke(renderer, 1.0)
        seen = device.marked()
        assert [mark.code for mark in seen] == list(range(30))
        assert [mark.sample_index for mark in seen] == sorted(mark.sample_index for mark in seen)
        # The first come with the samples after those that are queued.
        for mark in seen[:8]:
            assert 0.0 < mark.time_s - asked_s[0] < renderer.settings.horizon_s + 0.1
            began_s = renderer._own.began_s
            assert mark.time_s == pytest.approx(began_s + mark.sample_index / 48_000, abs=2e-3)
        assert renderer.plays_by == "engine"
        assert device.marks_waiting == 0
    assert not device.stop_is_owed


def test_frames_that_come_while_the_interpreter_stands_still_are_kept(surface, device):
    with haptix.LiveRenderer(surface, ribs(), device, settings=LIVE) as renderer:
        stroke(renderer, 0.3)
        for code in range(30):
            renderer.mark(code)
        hold_the_interpreter(0.8)  # in which a driver plays most of them, eight at a time
        wait_for(lambda: device.marks_waiting == 0)
        assert [mark.code for mark in device.marked()] == list(range(30))
    assert not device.is_armed and not device.stop_is_owed


def has_touches(device, touches):
    """Take the touches that came, and return whether there are any."""
    touches.extend(device.touches())
    return bool(touches)


def test_touches_of_the_drivers_panel_come_while_the_thread_plays(surface):
    driver = MockDriver(pace="real")
    with DriverServer(driver, port=0) as server, haptix.open_device(server.address) as device:
        device.stop()
        with haptix.LiveRenderer(surface, ribs(), device, settings=LIVE) as renderer:
            assert renderer.plays_by == "engine"
            for x_mm in (12.5, 13.0, 14.0):
                stroke(renderer, 0.05)
                assert driver.touch(x_mm, 3.0, 0.25)
                touches = []
                wait_for(partial(has_touches, device, touches))
                assert [(touch.x_um, touch.normal_force_mn) for touch in touches] == [
                    (1000 * x_mm, 250)
                ]


def test_the_engine_follows_a_layout_that_changes(surface, device):
    with haptix.LiveRenderer(surface, ribs(), device, settings=LIVE) as renderer:
        layout = renderer.texture
        assert isinstance(layout, Layout)
        for x_mm in range(10):
            stroke(renderer, 0.05)
            added = layout.add(Texture(LEVEL, 30.0), x_mm=x_mm, width_mm=20, height_mm=20)
            stroke(renderer, 0.05)
            added.move(x_mm=5.0, over_s=0.02)
            added.change(opacity=0.5)
        with layout.change():
            layout.clear()
            layout.add(Grating(period_mm=1.0), width_mm=60, height_mm=40)
        stroke(renderer, 0.1)
        renderer.texture = mixed()
        renderer.intensity(0.5)
        stroke(renderer, 0.1)
        renderer.texture = Grating(period_mm=2.0)
        stroke(renderer, 0.1)
        assert renderer.plays_by == "engine"
        assert device.is_armed
        assert renderer.stats.underruns == 0
        assert len(renderer._engine._engines) <= 2  # no memory of the others is kept
    assert not device.stop_is_owed


def test_the_engine_follows_intensity_mute_and_pause(surface, device):
    with haptix.LiveRenderer(surface, ribs(), device, settings=LIVE) as renderer:
        stroke(renderer, 0.1)
        renderer.intensity(0.5)
        renderer.mute()
        stroke(renderer, 0.2)
        renderer.mute(on=False)
        renderer.pause()
        at_s = renderer.scene_s
        stroke(renderer, 0.1)
        assert renderer.scene_s == at_s
        renderer.pause(on=False)
        assert renderer.plays_by == "engine"


def test_what_cannot_be_compiled_is_played_by_the_interpreter(surface, device, caplog):
    settings = LiveSettings(touch=TouchSettings(filter=OneEuroFilter()))
    caplog.set_level("INFO", "haptix.play.render")
    with haptix.LiveRenderer(surface, ribs(), device, settings=settings) as renderer:
        stroke(renderer, 0.1)
        assert renderer.plays_by == "interpreter"
    assert "plays by the interpreter" in caplog.text


def test_a_mock_in_the_process_is_played_by_the_interpreter(surface):
    device = haptix.open_device("mock:pace=real")
    with haptix.LiveRenderer(surface, ribs(), device, settings=LIVE) as renderer:
        assert renderer.plays_by == "interpreter"
        assert renderer.reports is None
    device.close()


HERE = Path(__file__).parent
ROOT = HERE.parents[2]


def sanitized(folder, name, *flags):
    """Compile a C program of this folder with player and engine, under sanitizers."""
    if shutil.which("cc") is None:
        pytest.skip("cc is missing")
    engine = ROOT / "haptix" / "base" / "native"
    firmware = [ROOT / "firmware_io" / "firmware" / f"haptix_{part}.c" for part in ("wire", "host")]
    sources = [HERE / f"{name}.c", *sorted(engine.glob("*.c")), *firmware]
    command = ["cc", "-std=gnu99", "-O1", "-g", "-fno-sanitize-recover=all", f"-I{engine}", *flags]
    made = subprocess.run(
        [*command, *map(str, sources), "-lm", "-lpthread", "-o", str(folder / name)],
        capture_output=True, text=True,
    )  # fmt: skip
    if "cannot find" in made.stderr and "san" in made.stderr:
        pytest.skip("the compiler has no sanitizers (on Debian: apt install libasan8 libubsan1)")
    assert made.returncode == 0, made.stderr
    return folder / name


@pytest.fixture
def program(tmp_path, surface):
    """The file of a compiled layout."""
    path = tmp_path / "touch.hxp"
    with haptix.open_device("mock:") as device:
        path.write_bytes(compile_touch(surface, mixed(), device, settings=LIVE))
    return path


def numbers_of(command):
    """Return the numbers that a program prints."""
    done = subprocess.run([*map(str, command)], capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stdout + done.stderr
    return [int(number) for number in re.findall(r"\d+", done.stdout)]


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="its calls of the system are Linux's")
def test_drivers_and_reports_that_say_anything_end_the_thread_as_it_says(tmp_path, program):
    flag = "-fsanitize=address,undefined,float-cast-overflow"
    binary = sanitized(tmp_path, "hostile_driver", flag)
    count = int(os.environ.get("HX_PLAYBACKS", "300"))  # 2000 take a minute
    *ends, revisions, samples, told, marked = numbers_of([binary, program, count, 1])
    assert sum(ends) == count
    stopped, _, _, fault, lost, silent, quiet = ends
    assert min(stopped, fault, lost, silent, quiet) > 3
    assert revisions > 10 * count
    assert samples > 10_000 * count
    assert min(told, marked) > 3 * count


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="its calls of the system are Linux's")
def test_threads_share_no_state_without_order(tmp_path, program):
    player = ROOT / "firmware_io" / "player" / "haptix_player.c"
    binary = sanitized(tmp_path, "shared_state", "-fsanitize=thread", str(player))
    samples, revisions, looks, engines, outcome = numbers_of([binary, program, 1])
    # Each has happened many times, even on a machine that has other work.
    assert samples > 10_000
    assert revisions > 30
    assert looks > 20
    assert engines > 10
    assert outcome == 1  # stopped by its owner


class SerialBoards:
    """Boards at serial ports, in other processes; to unplug one ends it."""

    def __init__(self):
        self.process = None

    def plug(self):
        self.process = subprocess.Popen(
            [sys.executable, "-m", "tests.serial_board"],
            cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        )  # fmt: skip
        return Device(SerialLink(self.process.stdout.readline().strip()))

    def unplug(self):
        if self.process is not None:
            self.process.kill()
            self.process.communicate()
            self.process = None


@pytest.fixture
def boards():
    pytest.importorskip("serial", reason="the extra serial is not installed")
    boards = SerialBoards()
    yield boards
    boards.unplug()


def test_a_serial_port_is_played_through_stalls_and_again_after_a_replug(surface, boards):
    device = boards.plug()
    gone = "failed|reported nothing"  # the latter where its thread waits for a processor
    with (
        pytest.raises(haptix.DeviceDisconnectedError, match=gone),
        haptix.LiveRenderer(surface, ribs(), device, settings=LIVE) as renderer,
    ):
        assert renderer.plays_by == "engine"
        stroke(renderer)
        hold_the_interpreter(0.4)
        stroke(renderer)
        assert device.is_armed
        assert renderer.stats.revisions > 10
        assert renderer.stats.samples_played > 0.9 * 48_000
        boards.unplug()
        for _ in range(1000):
            stroke(renderer, 0.1)
    with pytest.raises(haptix.DeviceDisconnectedError):  # that it was stopped is not known
        device.close()

    device = boards.plug()
    with haptix.LiveRenderer(surface, ribs(), device, settings=LIVE) as renderer:
        assert renderer.plays_by == "engine"
        stroke(renderer)
        assert len(renderer.stats.reactions_s) > 10
    assert not device.is_armed and not device.stop_is_owed
    device.close()


class PretendUsbLink(Link):
    """A link of two bulk endpoints, whose calls of libusb go to the socket of another link."""

    def __init__(self, link, library):
        self.name = "usb:pretended"
        self._link = link
        self._handle = ctypes.c_int(link.descriptor)
        self._transfer = ctypes.cast(library.pretend_bulk_transfer, ctypes.c_void_p).value

    def send(self, data):
        self._link.send(data)

    def receive(self, timeout_s=0.0):
        return self._link.receive(timeout_s)

    def close(self):
        self._link.close()

    @property
    def bulk(self):
        return Bulk(self._transfer, ctypes.addressof(self._handle), 0x02, 0x82)


@pytest.fixture(scope="module")
def pretend_libusb(tmp_path_factory):
    if shutil.which("cc") is None:
        pytest.skip("cc is missing")
    path = tmp_path_factory.mktemp("pretend_libusb") / "pretend_libusb.so"
    source = HERE / "pretend_libusb.c"
    subprocess.run(["cc", "-shared", "-fPIC", str(source), "-o", str(path)], check=True)
    return ctypes.CDLL(str(path))


def test_usb_is_played_through_stalls_until_it_is_unplugged(surface, served, pretend_libusb):
    link, process = served
    device = Device(PretendUsbLink(link, pretend_libusb))
    with (
        pytest.raises(haptix.DeviceError, match="No such device"),
        haptix.LiveRenderer(surface, ribs(), device, settings=LIVE) as renderer,
    ):
        assert renderer.plays_by == "engine"
        stroke(renderer)
        for _ in range(2):
            hold_the_interpreter(0.4)
            stroke(renderer, 0.1)
        assert device.is_armed
        assert renderer.stats.revisions > 10
        assert len(renderer.stats.reactions_s) > 10
        assert renderer.stats.samples_played > 0.9 * 48_000
        process.kill()
        for _ in range(1000):
            stroke(renderer, 0.1)
