"""The gate in front of the renderer: what passes, in which order, and how often."""

import threading
import time
from types import SimpleNamespace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from haptix.play.touch.events import TouchEvent
from haptix.service.engine import touch_gate
from haptix.service.engine.touch_gate import TouchGate
from tests.hand_clock import HandClock
from tests.waiting import pause, wait_for

REPORTS = st.lists(
    st.tuples(st.integers(0, 2), st.sampled_from(["down", "move", "move", "move", "up"])),
    min_size=1,
    max_size=40,
)


def touch(t_s, touch_id=0, kind="move"):
    return TouchEvent(t_s, touch_id, t_s, 0.0, kind, None, None)


@settings(max_examples=30, deadline=None)
@given(REPORTS, st.integers(1, 5))
def test_every_down_and_up_passes_and_each_finger_in_its_order(reports, size):
    passed = []
    gate = TouchGate(passed.extend, lambda: 0.005)
    touches = [touch(0.001 * number, *report) for number, report in enumerate(reports)]
    for first in range(0, len(touches), size):
        gate.put(touches[first : first + size])
    newest = {each.touch_id: each for each in touches}
    wait_for(lambda: newest == {each.touch_id: each for each in passed})
    for finger in range(3):
        mine = [each for each in passed if each.touch_id == finger]
        sent = [each for each in touches if each.touch_id == finger]
        assert mine == [each for each in sent if each in mine]
        assert [e for e in mine if e.kind != "move"] == [e for e in sent if e.kind != "move"]


def test_moves_at_1_khz_pass_at_the_interval_and_slow_ones_all(monkeypatch):
    clock = HandClock()
    monkeypatch.setattr(touch_gate, "time", SimpleNamespace(monotonic=clock))
    passed, interval_s = [], 0.01
    gate = TouchGate(passed.extend, lambda: interval_s)
    stamps = [0.001 * number for number in range(100)]
    for t_s in stamps:
        gate.put([touch(t_s)])  # all at once
    clock.sleep(interval_s)
    wait_for(lambda: passed and passed[-1].t_s == stamps[-1])
    # One each 10 ms of the stamps, and the first two and the newest.
    assert len(passed) <= 100 * 0.001 / interval_s + 3
    gate = TouchGate(passed.extend, lambda: 0.0)
    passed.clear()
    for t_s in stamps:
        gate.put([touch(t_s)])
    assert [each.t_s for each in passed] == stamps


def test_touches_are_taken_by_one_thread_at_a_time_and_what_is_forgotten_is_not(monkeypatch):
    inside, most = 0, 0

    def take(_):
        nonlocal inside, most
        inside += 1
        most = max(most, inside)
        pause(0.001)
        inside -= 1

    gate = TouchGate(take, lambda: 0.002)
    threads = [
        threading.Thread(target=lambda: [gate.put([touch(0.0, n, "down")]) for n in range(20)])
        for _ in range(3)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert most == 1
    passed = []
    monkeypatch.setattr(touch_gate, "MOST_INTERVAL_S", 60.0)
    gate = TouchGate(passed.extend, lambda: 60.0)
    gate.put([touch(0.0)])  # the first passes at once
    gate.put([touch(0.001)])
    gate.forget()
    gate.put([touch(0.002, kind="up")])
    assert [each.t_s for each in passed] == pytest.approx([0.0, 0.002])


def test_a_renderer_that_takes_long_is_given_touches_less_often():
    taken = []

    def take(touches):
        taken.append(len(touches))
        end_s = time.monotonic() + 0.004
        while time.monotonic() < end_s:
            pass

    gate = TouchGate(take, lambda: 0.0)
    began_s = time.monotonic()
    for number in range(100):
        gate.put([touch(0.001 * number)])
        pause(0.001)
    spent_s = time.monotonic() - began_s
    # Once eight were taken, which may come one after the other, 16 ms of rest lie between two.
    assert len(taken) <= 9 + spent_s / 0.016
