"""All touches: ids, lift and re-touch, missing and senseless events, and what strict refuses."""

import math
import threading

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from haptix import InputError
from haptix.play.touch import TouchCounts, Touches, TouchEvent, TouchSettings


def stroke(touch_id=0, count=20, x0=0.0, vx=100.0, t0=0.0):
    places = [(t0 + 0.01 * i, touch_id, x0 + vx * 0.01 * i, 5.0) for i in range(count)]
    kinds = ["down"] + ["move"] * (count - 1)
    return [TouchEvent(*place, kind) for place, kind in zip(places, kinds, strict=True)]


def push_all(events, **how):
    touches = Touches(**how)
    for event in events:
        touches.push(event)
    return touches


def test_fingers_do_not_disturb_each_other():
    a, b = stroke(0), stroke(7, x0=50, vx=-40, t0=0.003)
    both = push_all(sorted(a + b))
    assert [touch_id for touch_id, _ in both.active] == [0, 7]
    assert len(both) == 2 and 7 in both and 1 not in both
    assert both[0].at(0.2) == push_all(a)[0].at(0.2)
    assert both[7].at(0.2) == push_all(b)[7].at(0.2)


def test_a_finger_that_comes_back_starts_from_rest():
    touches = push_all(stroke())
    old = touches[0]
    assert touches.push(TouchEvent(0.2, 0, 20.0, 5.0, "up"))
    assert touches.active == () and not old.is_down
    # Elsewhere, 10 ms later: not a leap of one finger at 6000 mm/s.
    touches.push(TouchEvent(0.21, 0, 80.0, 5.0, "down"))
    state = touches[0].at(0.21)
    assert state[1:5] == (80.0, 5.0, 0.0, 0.0)
    assert not state.is_sliding
    assert touches[0] is not old


def test_a_missing_up_and_a_missing_down():
    touches = push_all([*stroke(), TouchEvent(0.3, 0, 90.0, 0.0, "down")])
    assert touches.counts.without_up == 1
    assert touches[0].at(0.3).x_mm == 90.0
    touches = push_all(stroke()[5:])
    assert touches.counts.without_down == 1
    assert touches[0].at(0.2).is_sliding


def test_a_down_behind_its_first_move_is_no_second_touch():
    down, move, *rest = stroke()
    touches = push_all([move, down, *rest])
    assert touches.counts.without_up == 0
    assert touches.counts.reordered == 1
    assert touches[0].at(0.2) == push_all(stroke())[0].at(0.2)


def test_a_late_move_does_not_bring_a_lifted_finger_back():
    *before, last = stroke()
    touches = push_all([*before, TouchEvent(0.195, 0, 0.0, 0.0, "up"), last])
    assert touches.active == ()
    assert touches.counts.late == 1
    # Nor where the up itself carries no time.
    touches = push_all([*before, TouchEvent(math.nan, 0, math.nan, 0.0, "up"), before[-1]])
    assert touches.active == ()
    assert touches.counts.invalid == 0


def test_an_up_of_nobody():
    touches = push_all([TouchEvent(0.0, 3, 0.0, 0.0, "up")])
    assert touches.counts == TouchCounts(unknown_up=1)


BAD = {
    "NaN place": (TouchEvent(0.2, 0, math.nan, 5.0), r"touch 0: x_mm.*nan"),
    "infinite place": (TouchEvent(0.2, 0, 1.0, -math.inf), r"touch 0: y_mm.*-inf"),
    "huge place": (TouchEvent(0.2, 0, 1e300, 5.0), r"x_mm.*millimetres.*1e\+300"),
    "NaN time": (TouchEvent(math.nan, 0, 1.0, 5.0), r"t_s.*nan"),
    "time in ns": (TouchEvent(1.7e18, 0, 1.0, 5.0), r"t_s.*seconds.*1.7e\+18"),
    "text": (TouchEvent(0.2, 0, "12", 5.0), r"x_mm.*'12'"),
    "nothing": (TouchEvent(0.2, 0, None, 5.0), r"x_mm.*None"),
    "an array": (TouchEvent(0.2, 0, np.zeros(2), 5.0), r"x_mm.*array"),
    "id": (TouchEvent(0.2, "left", 1.0, 5.0), r"touch_id.*'left'"),
    "id of a list": (TouchEvent(0.2, [0], 1.0, 5.0), r"touch_id.*\[0\]"),
    "kind": (TouchEvent(0.2, 0, 1.0, 5.0, "hover"), r'kind.*"down".*hover'),
    "no event": ((0.2, 0), r"expected a TouchEvent"),
    "none": (None, r"expected a TouchEvent"),
}


@pytest.mark.parametrize("name", BAD)
def test_what_cannot_be_used_is_dropped_and_the_touch_goes_on(name):
    event, words = BAD[name]
    touches = push_all(stroke())
    before = touches[0].at(0.2)
    assert not touches.push(event)
    assert touches.counts.invalid == 1
    assert touches[0].at(0.2) == before
    assert touches.push(TouchEvent(0.2, 0, 20.0, 5.0))
    strict = push_all(stroke(), strict=True)
    with pytest.raises(InputError, match=words):
        strict.push(event)
    assert strict[0].at(0.2) == before
    assert strict.push(TouchEvent(0.2, 0, 20.0, 5.0))


@pytest.mark.parametrize(
    ("event", "words"),
    [
        (TouchEvent(0.2, 0, 1.0, 5.0, "move", -0.1), r"normal_force_n.*-0\.1"),
        (TouchEvent(0.2, 0, 1.0, 5.0, "move", math.nan), r"normal_force_n.*nan"),
        (TouchEvent(0.2, 0, 1.0, 5.0, "move", None, 0.0), r"contact_area_m2.*0\.0"),
        (TouchEvent(0.05, 0, 1.0, 5.0), r"time must advance.*0\.05 s follows 0\.19 s"),
        (TouchEvent(0.2, 4, 1.0, 5.0, "up"), "touch 4: went up"),
        (TouchEvent(0.2, 4, 1.0, 5.0, "down"), "at most 1 touches"),
    ],
)
def test_what_else_strict_refuses(event, words):
    touches = push_all(stroke(), strict=True, max_touches=1)
    with pytest.raises(InputError, match=words):
        touches.push(event)


def test_a_crowd():
    touches = Touches(max_touches=3)
    for i in range(5):
        touches.push(TouchEvent(0.01 * i, i, 1.0, 1.0, "down"))
    assert touches.counts.crowded == 2
    assert len(touches) == 3
    # When the first has been silent for long enough, a new one takes its place.
    later = touches.settings.lost_after_s + 0.001
    assert touches.push(TouchEvent(later, 9, 1.0, 1.0, "down"))
    assert [touch_id for touch_id, _ in touches.active] == [1, 2, 9]
    assert touches.counts.without_up == 1


def test_a_flood_of_ids_takes_no_memory():
    touches = Touches()
    for i in range(5000):
        touches.push(TouchEvent(1e-4 * i, i, 1.0, 1.0, "down"))
        touches.push(TouchEvent(1e-4 * i, i - 2, 1.0, 1.0, "up"))
    assert len(touches) == 2
    assert len(touches._ended) <= 32


def test_the_short_way():
    touches = Touches(strict=True)
    for i in range(20):
        touches.touch(0.01 * i, 1.0 * i, 5.0, 0.6)
    state = touches[0].at(0.2)
    assert state.is_sliding and state.force_source == "axis"
    assert touches.counts.without_down == 0
    touches.lift(t_s=0.2)
    assert len(touches) == 0
    with pytest.raises(InputError, match="x_mm"):
        touches.touch(0.3, math.inf, 0.0)
    for i in range(3):
        touches.touch(0.4, 0.0, 0.0, touch_id=i)
    for i in range(3):
        touches.lift(i)
    assert touches.active == ()
    with pytest.raises(InputError, match="touch_id"):
        touches.touch(0.4, 0.0, 0.0, touch_id=[1])


def test_numbers_of_numpy_become_floats():
    touches = Touches()
    touches.touch(np.float64(0.0), np.float32(1.5), np.int64(3))
    touches.touch(np.float64(0.01), np.float32(2.5), np.int64(3))
    assert {type(value) for value in touches[0].at(0.01)[:7]} == {float}


numbers = st.floats(allow_nan=True, allow_infinity=True) | st.floats(-100, 100)


@settings(deadline=None, max_examples=150)
@given(
    st.lists(
        st.builds(
            TouchEvent,
            st.floats(-0.1, 1) | numbers,
            st.integers(0, 3),
            numbers,
            numbers,
            st.sampled_from(["down", "move", "up"]),
            st.none() | numbers,
            st.none() | numbers,
        ),
        max_size=40,
    ),
    st.floats(-1, 2),
)
def test_nothing_that_comes_in_stops_it(events, t):
    touches = Touches(TouchSettings(latency_s=0.03), max_touches=2)
    for event in events:
        touches.push(event)
        for _, tracker in touches.active:
            assert np.isfinite(tracker.at(t)[:9]).all()
    counts = touches.counts
    ups = sum(event.kind == "up" for event in events)
    dropped = counts.late + counts.invalid + counts.crowded + counts.jumps
    # Every event has exactly one fate. An up of a touch that was there is counted by no number.
    assert counts.taken + dropped <= len(events) <= counts.taken + dropped + ups


def test_one_thread_pushes_and_another_asks():
    touches = push_all(stroke(count=2))
    tracker = touches[0]
    end = threading.Event()
    broken = []

    def ask():
        t = 0.0
        while not end.is_set():
            state = tracker.at(t)
            t += 1e-3
            # The finger stays on its line; a state torn between two reports would not.
            if abs(state.y_mm - 5.0) > 1e-9:
                broken.append(state)

    thread = threading.Thread(target=ask)
    thread.start()
    for event in stroke(count=5000)[2:]:
        touches.push(event)
    end.set()
    thread.join()
    assert not broken


def test_two_ids_that_are_exchanged_for_one_report_are_not_followed():
    """Two fingers 25 mm apart slide at 80 mm/s; at 0.3 s each is told the other's place."""
    touches = Touches()
    for i in range(50):
        x = 20 + 0.8 * i
        places = [(x, 20.0), (x, 45.0)]
        if i == 30:
            places.reverse()
        for touch_id, (x_mm, y_mm) in enumerate(places):
            touches.push(TouchEvent(i / 100, touch_id, x_mm, y_mm, "move" if i else "down"))
        off_mm = max(
            abs(tracker.at(i / 100).y_mm - (20.0, 45.0)[touch_id])
            for touch_id, tracker in touches.active
        )
        assert off_mm < 0.1
    assert touches.counts.jumps == 2
