"""Touches that waited while the front did not run: the newest count, and none is refused for it."""

import threading
import time

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from haptix.service.front.client_session import ServiceSession
from haptix.service.front.client_touches import (
    OLD_S,
    PAST_S,
    ClientClock,
    Stalls,
    TouchInbox,
    touch_events,
)
from haptix.service.protocol.batches import write_touches
from haptix.service.protocol.messages import Problem, TouchMessage
from tests.service.test_sessions import Client, running, service
from tests.waiting import PATIENCE_S, pause, wait_for

__all__ = ["running", "service"]  # fixtures

NOW_S = 100.0


def touch(t_s, touch_id=0, kind="move", x_mm=1.0):
    return TouchMessage(t_s=t_s, touch_id=touch_id, kind=kind, x_mm=x_mm, y_mm=2.0)


@pytest.fixture(scope="module")
def clock():
    """A client's clock that is the service's."""
    clock = ClientClock()
    for number in range(8):
        clock.add(number, number, number)
    return clock


def test_what_is_in_time_is_passed_on_whole(clock):
    inbox = TouchInbox()
    batches = [[touch(NOW_S - 0.4), touch(NOW_S - 0.3)], [touch(NOW_S - 0.2)]]
    for batch in batches:
        inbox.put(list(batch))
    assert inbox.take(clock, NOW_S, 0.0) == batches
    assert not inbox and not inbox.dropped


@given(
    st.lists(
        st.lists(
            st.tuples(
                st.floats(0.0, 1.0), st.integers(0, 2), st.sampled_from(["move"] * 5 + ["up"])
            ),
            max_size=4,
        ),
        max_size=8,
    )
)
def test_after_a_stall_the_newest_of_each_finger_is_kept(clock, ages):
    late_s, inbox = 0.6, TouchInbox()
    sent = [[touch(NOW_S - age, finger, kind) for age, finger, kind in batch] for batch in ages]
    for batch in sent:
        inbox.put(list(batch))
    passed = inbox.take(clock, NOW_S, late_s)
    assert [len(batch) for batch in passed] == [len(batch) for batch in sent]  # places are told
    flat = [one for batch in sent for one in batch]
    kept = [one for batch in passed for one in batch]
    assert inbox.dropped == kept.count(None)
    for place, (before, after) in enumerate(zip(flat, kept, strict=True)):
        later = [one for one in flat[place + 1 :] if one.touch_id == before.touch_id]
        if after is None:
            assert before.kind == later[0].kind == "move" and before.t_s < NOW_S - OLD_S
        else:
            assert after == before
            is_replaced = bool(later) and later[0].kind == "move"
            assert not (is_replaced and before.kind == "move" and before.t_s < NOW_S - OLD_S)


@given(
    st.lists(st.floats(0.0, 1.05), min_size=1, max_size=8),
    st.floats(1e-3, 1e6),
    st.floats(-1e9, 1e9),
)
def test_what_we_kept_waiting_is_taken_as_if_it_just_were_in_time(ages, now_s, offset_s):
    session = ServiceSession(1, None, lambda: now_s)
    session.clock.add(now_s, now_s, now_s + offset_s)
    touches = [touch(session.clock.client_s(now_s - age)) for age in ages]
    taken = touch_events(session.clock, session.geometry, touches, now_s, 0.6)
    assert not taken.left_out and taken.problem is None
    for report, age in zip(taken.events, ages, strict=True):
        assert report.t_s == pytest.approx(now_s - min(age, PAST_S), abs=1e-6)
    # What it kept waiting for 0.1 s: older ones are not its fault.
    taken = touch_events(session.clock, session.geometry, touches, now_s, 0.1)
    assume(all(abs(age - PAST_S - 0.1) > 1e-5 for age in ages))
    assert taken.left_out == sum(age > PAST_S + 0.1 for age in ages)


def test_a_clock_of_another_unit_is_not_taken_for_a_delay_of_ours(clock):
    wrong = Problem("message", "no touch")
    taken = touch_events(clock, None, [touch(NOW_S - 5.0), wrong], NOW_S, 0.6)
    assert (taken.events, taken.left_out) == ([], 2)
    assert "a stamp 5 s old" in taken.problem.sentence


def test_stalls_add_up_and_are_forgotten():
    stalls = Stalls(0.0)
    assert stalls.late_s(0.02) == 0.0
    assert stalls.late_s(0.62) == pytest.approx(0.6)
    assert stalls.late_s(0.92) == pytest.approx(0.9)
    for number in range(60):
        stalls.look(0.94 + 0.02 * number)
    assert stalls.late_s(2.14) == 0.0


def test_a_front_that_did_not_run_refuses_nothing_for_it(service, monkeypatch):
    stalled, sent, tick = threading.Event(), threading.Event(), service.hub.tick

    def stall():
        monkeypatch.setattr(service.hub, "tick", tick)
        stalled.set()
        assert sent.wait(PATIENCE_S)
        tick()

    with Client(service).holds() as client:
        monkeypatch.setattr(service.hub, "stalls", Stalls(time.monotonic()))
        monkeypatch.setattr(service.hub, "tick", stall)
        assert stalled.wait(PATIENCE_S)
        began_s = client.now_s()
        for number in range(200):
            one = TouchMessage(t_s=client.now_s(), x_mm=float(number), y_mm=1.0)
            client.socket.send(write_touches([one], number))
            pause(0.003)
        wait_for(lambda: client.now_s() > began_s + PAST_S + 0.2)
        sent.set()
        warned = client.until(lambda message: message["type"] == "warning")
        assert not [said for said in client.heard if said["type"] == "error"]
        wait_for(lambda: service.engine.reports[-1].x_mm == 199.0)
        # Those that came in later turns of the loop are kept for the next warning.
        later = service.hub.sessions[client.welcome["session"]].inbox.dropped
        dropped = int(warned["sentence"].split()[4]) + later
        assert dropped + len(service.engine.reports) == 200 and dropped > 50
        monkeypatch.undo()
        # The next batches are as before the stall.
        pause(0.1)
        before = len(service.engine.reports)
        client.socket.send(write_touches([one.model_copy(update={"t_s": client.now_s()})], 1))
        wait_for(lambda: len(service.engine.reports) == before + 1)
