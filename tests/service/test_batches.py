"""Bytes of touches and telemetry, against records packed by hand."""

import json
import os
import struct
from math import inf, nan

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptix.play.touch.events import TouchEvent, problem_of
from haptix.service.protocol.batches import (
    TelemetryFrame,
    numbered,
    read_frame,
    read_touches,
    write_frame,
    write_touches,
)
from haptix.service.protocol.messages import Problem, TouchMessage
from haptix.service.protocol.messages.reading import read_client
from haptix.service.protocol.wire import FrameReader, frame

TOUCHES = st.builds(
    TouchMessage,
    t_s=st.floats(-1e6, 1e6),
    touch_id=st.integers(0, 255),
    kind=st.sampled_from(["down", "move", "up"]),
    x_mm=st.floats(-1e4, 1e4, width=32),
    y_mm=st.floats(-1e4, 1e4, width=32),
    normal_force_n=st.none() | st.floats(0.0078125, 64, width=32),
)


def test_the_bytes_of_the_page():
    data = struct.pack("<BBHId", 1, 1, 1, 7, 12.5)
    data += struct.pack("<iBBHffff", -250, 3, 1 | 4 | 8, 0, 100.0, 50.0, 0.5, nan)
    number, (touch,) = read_touches(data)
    assert number == 7
    assert touch == TouchMessage(
        t_s=12.49975, touch_id=3, kind="move", x_px=100.0, y_px=50.0, normal_force_n=0.5
    )


@given(st.lists(TOUCHES, min_size=1, max_size=5))
def test_there_and_back(touches):
    # All within the 35 minutes that a record's time spans.
    touches = [
        touch.model_copy(update={"t_s": touches[0].t_s + i}) for i, touch in enumerate(touches)
    ]
    back = read_touches(write_touches(touches, 3)).touches
    for sent, got in zip(touches, back, strict=True):
        assert got.t_s == pytest.approx(sent.t_s, abs=1e-6)  # a record counts microseconds
        assert got.model_copy(update={"t_s": sent.t_s}) == sent


@given(st.binary(max_size=200))
def test_any_bytes_are_read_or_refused(data):
    try:
        read_touches(data)
    except Problem as problem:
        assert problem.code in ("message", "limit", "clock")


@pytest.mark.parametrize(
    "change",
    [
        {"flags": 3},
        {"flags": 64},
        {"zero": 1},
        {"x": nan},
        {"y": inf},
        {"flags": 9, "force_n": -1.0},
        {"flags": 9, "force_n": nan},
        {"flags": 9, "force_n": 5e-4},
        {"flags": 17, "area_m2": 0.05},
        {"flags": 17, "area_m2": 1e-9},
    ],
)
def test_a_bad_record_is_named_and_the_others_are_kept(change):
    good = {"after": 0, "id": 0, "flags": 1, "zero": 0, "x": 1.0, "y": 1.0}
    good |= {"force_n": 1.0, "area_m2": 1e-4}
    head = struct.pack("<BBHId", 1, 1, 2, 1, 0.0)
    records = [struct.pack("<iBBHffff", *(good | part).values()) for part in ({}, change)]
    assert isinstance(read_touches(head + records[0] * 2).touches[1], TouchMessage)
    kept, bad = read_touches(head + b"".join(records)).touches
    assert isinstance(kept, TouchMessage)
    assert isinstance(bad, Problem) and bad.path.startswith("/touches/1")


def test_telemetry_there_and_back():
    rows = np.array([[1.0, nan], [3.0, 4.0], [5.0, 6.0]], dtype=np.float32)
    sent = TelemetryFrame("stats", 2, 9, 4, 1.5, 0.001, rows)
    got = read_frame(write_frame(sent))
    assert got[:6] == sent[:6]
    np.testing.assert_array_equal(got.rows, rows)
    assert len(write_frame(sent)) == 32 + rows.nbytes
    again = read_frame(numbered(write_frame(sent), 5, 77))
    assert again[:6] == sent._replace(number=5, dropped=77)[:6]
    with pytest.raises(Problem):
        read_frame(write_frame(sent)[:-1])


@given(st.lists(st.tuples(st.integers(0, 3), st.binary(max_size=40)), max_size=8), st.data())
def test_frames_of_the_link_are_read_however_they_are_cut(frames, data):
    sent = b"".join(frame(kind, body) for kind, body in frames)
    cuts = sorted(data.draw(st.lists(st.integers(0, len(sent)), max_size=5)))
    found = []
    reading, writing = os.pipe()
    reader = FrameReader(reading)
    try:
        for first, last in zip([0, *cuts], [*cuts, len(sent)], strict=True):
            whole = len(found)
            os.write(writing, sent[first:last])
            while whole < len(frames) and sum(5 + len(b) for _, b in frames[: whole + 1]) <= last:
                found += reader.read()  # waits for no more than there is
                whole = len(found)
        os.close(writing)
        assert found == frames
        assert reader.read() == []
    finally:
        os.close(reading)


@pytest.mark.parametrize(
    ("fields", "is_felt"),
    [
        ({"normal_force_n": 0.001}, True),
        ({"normal_force_n": 0.0009}, False),
        ({"normal_force_n": 100.0}, True),
        ({"normal_force_n": 101.0}, False),
        ({"contact_area_m2": 0.01}, True),
        ({"contact_area_m2": 0.011}, False),
        ({"contact_area_m2": 2e-8}, True),
        ({"contact_area_m2": 0.9e-8}, False),
        ({"x_mm": nan}, False),
    ],
)
def test_a_touch_has_the_same_limits_at_each_door(fields, is_felt):
    """In bytes, in JSON, and in a program's own events."""
    given = {"t_s": 1.0, "touch_id": 2, "x_mm": 1.0, "y_mm": 1.0} | fields
    event = TouchEvent(**given)
    assert (problem_of(event) is None) == is_felt
    loose = TouchMessage.model_construct(**given, x_px=None, y_px=None, kind="move")
    (touch,) = read_touches(write_touches([loose], 1)).touches
    text = json.dumps({"type": "touch", "touches": [given]})
    try:
        read_client(text)
    except Problem as problem:
        assert not is_felt
        assert problem.path == "/touches/0/" + next(iter(fields))
        assert touch.path == problem.path
        assert touch.sentence.partition(", got")[0] == problem.sentence.partition(", got")[0]
    else:
        assert is_felt and isinstance(touch, TouchMessage)
