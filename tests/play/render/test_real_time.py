"""Real time: threads, and what is left of them. Short, and nothing asserted of how fast it is."""

import gc
import sys
import threading

import numpy as np
import pytest

from firmware_io import Device, DeviceDisconnectedError, DeviceFaultError, open_device
from firmware_io.clock import ready_interpreter
from firmware_io.limits import WATCHDOG_S
from haptix import InputError, LiveRenderer, Texture
from haptix.base.errors import OverloadWarning
from haptix.feel.materials import Grating, Moving
from haptix.feel.motion import Motion
from haptix.play.render import LiveSettings, RenderStats, Sliding
from haptix.play.render.played import COLUMNS, PlayedRecord
from tests.faulty_link import FaultyLink
from tests.steady_clock import SteadyClock, steady_driver
from tests.waiting import PATIENCE_S

FULL = Texture(np.ones((2, 2)), width_mm=100.0, beyond="hold")
NEVER_STILL = Sliding(is_needed=False)
ALWAYS = LiveSettings(sliding=NEVER_STILL)


@pytest.fixture(autouse=True)
def interpreter_is_left_as_it_was(monkeypatch):
    """Whether objects are frozen is only noted: the tests have a million, which stay frozen."""
    frozen = [0]
    monkeypatch.setattr(gc, "get_freeze_count", lambda: frozen[-1])
    monkeypatch.setattr(gc, "freeze", lambda: frozen.append(1))
    monkeypatch.setattr(gc, "unfreeze", lambda: frozen.append(0))
    before = set(threading.enumerate())
    switch_s, collects = sys.getswitchinterval(), gc.isenabled()
    yield
    assert set(threading.enumerate()) <= before
    assert sys.getswitchinterval() == switch_s
    assert gc.get_freeze_count() == 0
    assert gc.isenabled() == collects


def test_what_a_program_froze_stays_frozen():
    gc.freeze()
    try:
        with ready_interpreter():
            assert gc.get_freeze_count() > 0
        assert gc.get_freeze_count() > 0
    finally:
        gc.unfreeze()


@pytest.fixture
def link():
    return patient_link()


def patient_link():
    """A driver that a machine which stalls does not starve."""
    return FaultyLink(steady_driver())


def opened(link, watchdog_s=WATCHDOG_S):
    device = Device(link)
    device.set_up(watchdog_s=watchdog_s)
    return device


def touching(renderer, seconds, until=lambda: False):
    """Slide a finger until the time is over, or an error ends it."""
    begin_s = now_s = renderer.now_s()
    pause = threading.Event()
    while now_s < begin_s + seconds and not until():
        renderer.touch(now_s, 5 + 100 * (now_s - begin_s), 5.0, 0.5)
        pause.wait(0.005)
        now_s = renderer.now_s()


def until_loud(renderer, link):
    """Slide until it is heard: a machine that stalls only takes longer."""
    before = len(link.driver.output[0])

    def is_loud():
        return np.abs(link.driver.output_v[before:]).max(initial=0.0) > 150.0

    touching(renderer, PATIENCE_S, is_loud)
    assert is_loud()


def assert_at_rest(device, link):
    assert not device.is_armed
    threading.Event().wait(0.01)  # the driver's ramp takes 5 ms of its clock, which is the wall's
    assert not link.driver.is_armed
    assert link.driver.output[0][-1] == 0


def test_a_session(surface, link):
    device = opened(link)
    settings = LiveSettings(reaction_s=0.004, sliding=NEVER_STILL)
    renderer = LiveRenderer(surface, FULL, device, settings=settings)
    switch_s = sys.getswitchinterval()
    with renderer:
        assert gc.get_freeze_count() > 0
        assert sys.getswitchinterval() < switch_s
        until_loud(renderer, link)
        touching(renderer, PATIENCE_S, lambda: renderer.stats.revisions > 5)
    assert_at_rest(device, link)
    stats = renderer.stats
    assert stats.reaction_s == 0.004
    assert stats.revisions > 5
    assert 0.0 < stats.reaction_p50_s <= stats.reaction_p99_s <= stats.reaction_max_s
    assert 0 < stats.p50_block_s <= stats.p99_block_s <= stats.max_block_s
    assert stats.samples > stats.samples_played > 0  # what is revised is rendered again
    assert renderer.touch_counts.taken > 1


def test_an_overload_is_said_once(surface):
    """A computer that stands for 0.11 s, in steps: longer than what is queued, not the watchdog."""
    device = open_device("mock:pace=stepped")
    settings = LiveSettings(sliding=NEVER_STILL, horizon_s=0.02)  # and 0.085 s of spare
    renderer = LiveRenderer(surface, FULL, device, settings=settings)
    with pytest.warns(OverloadWarning) as caught, renderer:
        renderer.touch(0.0, 5.0, 5.0, 0.5)
        renderer.run_until(0.3)
        assert not renderer.stats.advice
        device.clock.sleep(0.11)
        renderer.run_until(0.6)
        assert renderer.stats.advice  # while it plays
    stats = renderer.stats
    assert len(caught) == 1
    assert stats.underruns == 1
    assert 0.09 < stats.longest_stall_s <= 0.11  # less what it would have slept
    assert str(caught[0].message) == f"the renderer {stats.advice}"
    for part in ("horizon of 20 ms", "1 underruns", "longest stall", "Choose a longer horizon_s"):
        assert part in stats.advice
    assert stats.advice in str(stats)


def test_statistics_print_as_a_line(surface, link):
    stats = RenderStats(samples=48_000)
    stats.block_s.extend([1e-3] * 10_000)
    for text in (str(stats), repr(stats)):
        assert "\n" not in text and len(text) < 400
    assert "10000 blocks of 1.00 ms" in str(stats)


def test_an_exception_ends_at_zero(surface, link):
    device = opened(link)
    with (
        pytest.raises(ZeroDivisionError) as caught,
        LiveRenderer(surface, FULL, device, settings=ALWAYS) as renderer,
    ):
        until_loud(renderer, link)
        raise ZeroDivisionError
    assert not getattr(caught.value, "__notes__", [])
    assert_at_rest(device, link)


def test_a_device_that_disappears_in_mid_stroke(surface, link):
    device = opened(link)
    renderer = LiveRenderer(surface, FULL, device, settings=ALWAYS)
    raised = []
    with renderer:
        until_loud(renderer, link)
        link.inject("disconnect")
        for _ in range(1000):
            try:
                touching(renderer, 0.005)
            except DeviceDisconnectedError as error:
                raised.append(error)
                break
        for _ in range(3):  # once it was told, touches are taken and lead nowhere
            renderer.touch(renderer.now_s(), 20.0, 5.0, 0.5)
    assert len(raised) == 1
    assert_at_rest(device, link)

    again = patient_link()
    renderer.device = opened(again)
    with renderer:
        until_loud(renderer, again)
    assert_at_rest(renderer.device, again)


def test_an_error_that_nobody_asked_for_is_told_at_the_end(surface, link):
    device = opened(link)
    renderer = LiveRenderer(surface, FULL, device, settings=ALWAYS)
    with pytest.raises(DeviceDisconnectedError), renderer:
        touching(renderer, 0.03)
        link.inject("disconnect")
        renderer._playback.writer.thread.join(PATIENCE_S)


def test_a_fault_of_the_driver_and_another_session(surface):
    clock = SteadyClock()
    link = FaultyLink(steady_driver(clock=clock))
    device = opened(link, watchdog_s=0.15)
    renderer = LiveRenderer(surface, FULL, device, settings=ALWAYS)
    with pytest.raises(DeviceFaultError), renderer:
        touching(renderer, 0.03)
        clock.longest_s = 0.4
        link.inject("stall", seconds=0.4)  # longer than the watchdog waits
        touching(renderer, PATIENCE_S)
    clock.longest_s = 0.05
    assert_at_rest(device, link)
    with renderer:
        until_loud(renderer, link)
    assert_at_rest(device, link)


def test_a_bad_touch_does_not_end_the_session(surface, link):
    device = opened(link)
    with LiveRenderer(surface, FULL, device) as renderer:
        touching(renderer, 0.02)
        with pytest.raises(InputError, match="x_mm"):
            renderer.touch(renderer.now_s(), np.nan, 5.0, 0.5)
        touching(renderer, 0.02)
    assert_at_rest(device, link)


def test_a_renderer_that_was_not_entered_takes_no_touch(surface, link):
    renderer = LiveRenderer(surface, FULL, opened(link))
    with pytest.raises(InputError, match=r"touch: .*entered"):
        renderer.touch(renderer.now_s(), 20.0, 5.0, 0.5)


def test_touches_from_several_threads_at_once(surface, link):
    device = opened(link)
    with LiveRenderer(surface, FULL, device, settings=LiveSettings(strict=False)) as renderer:
        errors = []

        def one(touch_id):
            try:
                for _ in range(200):
                    renderer.touch(renderer.now_s(), 20.0, 5.0, 0.5, touch_id)
            except Exception as error:
                errors.append(error)

        threads = [threading.Thread(target=one, args=(i,)) for i in range(3)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert not errors
        assert renderer.touch_counts.taken > 100
    assert_at_rest(device, link)


def test_the_time_of_the_scene_is_the_one_that_is_rendered(surface):
    """What a moving material asked for, as it is told, is what it asks for at that time."""
    material = Moving(of=Grating(period_mm=40.0, low=0.2, high=0.8), velocity_mm_s=(-30.0, 0.0))
    renderer = LiveRenderer(surface, material, opened(patient_link()), settings=ALWAYS)
    rows = []
    with renderer:
        renderer.record = PlayedRecord(renderer)

        def has_told():
            part = renderer.record.take(renderer.now_s() - 0.02)
            if part is not None and part.rows:
                rows.append((part.t0_s + part.row_s * np.arange(len(part.rows[0])), part.rows[0]))
            return len(rows) > 20

        touching(renderer, PATIENCE_S, has_told)
        readings = []
        for _ in range(50):  # that in which nothing came between is the one that counts
            before_s, scene_s, after_s = renderer.now_s(), renderer.scene_s, renderer.now_s()
            readings.append((after_s - before_s, scene_s - before_s))
        took_s, ahead_s = min(readings)
        renderer.pause()
        stands_s = renderer.scene_s
        assert renderer.scene_s == stands_s
    t_s, told = (np.concatenate(columns) for columns in zip(*rows, strict=True))
    known = ~np.isnan(told).any(1)
    x_mm, y_mm, wanted = told[known][:, COLUMNS.index("x_mm")], 5.0, told[known][:, 3]
    share = material.evaluator.wanted(Motion.of(x_mm, y_mm, t_s[known] + ahead_s, 100.0))
    # A wrong time moves the stripes by 30 mm/s of it; that of a row is known to a point, 0.5 ms.
    slope_per_s = 0.3 * 2 * np.pi / 40 * 30
    low, high = told[known][:, 5], told[known][:, 6]
    off = np.abs(low + (high - low) * share - wanted) / (high - low)
    assert off.max() < slope_per_s * (took_s + 1.5e-3)
