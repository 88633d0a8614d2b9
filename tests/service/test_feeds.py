"""Streams of one session: rates, and the newest frames for a client that does not read."""

import asyncio

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptix.play.render.played import COLUMNS as PLAYED
from haptix.service.front.client_session import ServiceSession
from haptix.service.protocol.batches import COLUMNS, TelemetryFrame, read_frame

STEP_S = 0.001


def session(**rates):
    made = ServiceSession(1, None, lambda: 0.0)
    made.streams.update(rates)
    return made


def frame(stream, touch_id, first, count):
    """Rows that tell their own number, from a time in seconds on."""
    rows = np.arange(first, first + count, dtype=float)[:, None]
    return TelemetryFrame(stream, touch_id, 0, 0, first * STEP_S, STEP_S, rows)


def drained(session):
    found = []
    while (data := session.next_frame()) is not None:
        found.append(read_frame(data))
    return found


def test_the_columns_are_those_of_the_record():
    assert COLUMNS["friction"] == PLAYED


@given(
    st.sampled_from([1000.0, 999.0, 500.0, 333.0, 60.0, 7.0, 0.5]),
    st.lists(st.integers(1, 60), min_size=5, max_size=40),
)
def test_rows_come_evenly_and_never_faster_than_asked(rate_hz, counts):
    asked, first, found = session(friction=rate_hz), 0, []
    for count in counts:
        asked.send_frame(frame("friction", 3, first, count))
        first += count
        found += drained(asked)
    every = int(np.ceil(1000 / rate_hz - 1e-9))
    rows = np.concatenate([one.rows[:, 0] for one in found])
    assert rows.tolist() == list(range(0, first, every))
    for one in found:
        assert one.step_s == pytest.approx(every * STEP_S)
        assert one.t0_s == pytest.approx(one.rows[0, 0] * STEP_S)
    assert [one.number for one in found] == list(range(len(found)))


def test_the_newest_four_of_each_finger_wait_and_the_others_are_counted():
    asked = session(friction=1000.0, felt=1000.0)
    for k in range(10):
        asked.send_frame(frame("friction", 3, 20 * k, 20))
        if k < 2:
            asked.send_frame(frame("felt", 3, 20 * k, 20))
            asked.send_frame(frame("friction", 8, 20 * k, 20))
    found = {}
    for one in drained(asked):
        found.setdefault((one.stream, one.touch_id), []).append((one.number, one.dropped))
    assert found == {
        ("friction", 3): [(6, 3), (7, 4), (8, 5), (9, 6)],
        ("felt", 3): [(0, 0), (1, 0)],
        ("friction", 8): [(0, 0), (1, 0)],
    }
    # The next frame says how many were lost in all.
    asked.send_frame(frame("friction", 3, 200, 20))
    assert [(one.number, one.dropped) for one in drained(asked)] == [(10, 6)]


def test_who_asked_for_nothing_gets_nothing():
    asked = session(friction=0.0)
    asked.send_frame(frame("friction", 3, 0, 20))
    asked.send_frame(frame("felt", 3, 0, 20))
    assert drained(asked) == []
    assert isinstance(asked.has_more, asyncio.Event) and not asked.has_more.is_set()
