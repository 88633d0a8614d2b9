"""Touches by TUIO, of packets written by the rules of OSC 1.0."""

import random
import socket
from functools import partial
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptix import InputError
from haptix.base.errors import DeviceError
from haptix.play.touch import Touches, TuioDecoder, TuioSource
from tests.play.touch.tuio_frames import bundle, cursors, frames, message, pointers, text


def told(touches):
    return [(t.touch_id, t.kind, round(t.x_mm, 3), round(t.y_mm, 3)) for t in touches]


def test_cursors_of_tuio_1():
    decoder = TuioDecoder(800.0, 400.0)
    assert told(decoder.feed(cursors(1, {7: (0.5, 0.25)}), 0.0)) == [(1, "down", 400.0, 100.0)]
    both = cursors(2, {7: (0.25, 0.25), 9: (1.0, 1.0)})
    assert told(decoder.feed(both, 0.01)) == [(1, "move", 200.0, 100.0), (2, "down", 800.0, 400.0)]
    # One that is alive and not set rests; one that is not alive is lifted.
    assert told(decoder.feed(cursors(3, {}, alive=[7, 9]), 0.02)) == []
    assert [(t.touch_id, t.kind) for t in decoder.feed(cursors(4, {}, alive=[9]), 0.03)] == [
        (1, "up")
    ]
    # A packet that comes late changes nothing; a source that begins anew does.
    assert decoder.feed(both, 0.04) == [] and decoder.dropped == 1
    assert [t.kind for t in decoder.feed(cursors(500, {9: (0.1, 0.1)}), 0.05)] == ["move"]
    assert [t.kind for t in decoder.feed(cursors(1, {9: (0.1, 0.1)}), 0.06)] == ["move"]


def test_a_cursor_above_the_surface_is_no_touch():
    decoder, address = TuioDecoder(800.0, 400.0), "/tuio/25Dcur"
    kinds = [
        [t.kind for t in decoder.feed(cursors(i, {3: (0.5, 0.5, z)}, address), 0.01 * i)]
        for i, z in enumerate([0.3, 0.1, 0.0, 0.0, 0.2, 0.2])
    ]
    assert kinds == [[], [], ["down"], ["move"], ["up"], []]


def test_pointers_of_tuio_2():
    decoder = TuioDecoder(800.0, 400.0, "turn-180")
    found = decoder.feed(pointers(1, {5: (0.25, 0.25)}), 3.0)
    assert told(found) == [(1, "down", 600.0, 300.0)] and found[0].t_s == 3.0
    above = pointers(2, {5: (0.25, 0.25)}, pressures={5: -0.1})
    assert [t.kind for t in decoder.feed(above, 3.01)] == ["up"]
    assert decoder.feed(pointers(3, {}), 3.02) == []


def test_the_times_of_tuio_2_are_those_of_its_frames():
    decoder = TuioDecoder(800.0, 400.0)
    late_s = random.Random(2)
    found = [
        decoder.feed(
            pointers(i, {1: (0.5, 0.5)}, 1e9 + i / 100), i / 100 + late_s.uniform(0, 0.008)
        )
        for i in range(120)
    ]
    gaps_s = [b[0].t_s - a[0].t_s for a, b in pairwise(found[50:])]
    assert gaps_s == pytest.approx([0.01] * len(gaps_s), abs=6e-4)


@given(st.binary(max_size=200))
def test_what_is_no_tuio_is_dropped(data):
    decoder = TuioDecoder(800.0, 400.0)
    whole = cursors(1, {7: (0.5, 0.25)})
    for packet in (data, whole[: len(data)], whole[:30] + data, b"#bundle\0" + data):
        for touch in decoder.feed(packet, 0.0):
            assert touch.kind in ("down", "move", "up")


def test_no_finger_above_the_surface_is_down():
    for seed in range(300):
        touches = Touches()
        for touching, found, decoder in frames(seed):
            for touch in found:
                touches.push(touch)
            assert {key[1] for key in decoder._ids} == touching, seed
            assert len(touches) == len(touching), seed


def test_two_sources_have_fingers_of_their_own():
    """Each counts its cursors from 0, and two trackers at one port are usual."""

    def frame_of(source, number, x):
        return named(source, number, {1: (x, 0.5)})

    left, right = partial(frame_of, "a@1"), partial(frame_of, "b@2")
    decoder = TuioDecoder(400.0, 200.0)
    found = []
    for frame in range(20):
        found += decoder.feed(left(frame, 0.125), frame / 100)
        found += decoder.feed(right(frame, 0.875), frame / 100)
    assert [(one.touch_id, one.x_mm, one.kind) for one in found[:2]] == [
        *((1, 50.0, "down"), (2, 350.0, "down"))
    ]
    assert {(one.touch_id, one.x_mm) for one in found} == {(1, 50.0), (2, 350.0)}
    assert {one.kind for one in found[2:]} == {"move"} and decoder.dropped == 0
    # One falls silent: its finger goes up, the other's stays.
    silent = [one for i in range(200) for one in decoder.feed(right(20 + i, 0.875), 0.2 + i / 100)]
    assert [one.touch_id for one in silent if one.kind == "up"] == [1]


def named(source, frame, places):
    """A frame of a source that says its name, or with "" does not."""
    return cursors(frame, places).replace(text("table@10.0.0.2"), text(source.ljust(14, "_")))


def test_sources_without_a_name_are_known_by_their_addresses():
    decoder = TuioDecoder(400.0, 200.0)
    packet = bundle(
        *(message("/tuio/2Dcur", *row) for row in (("alive", 1), ("set", 1, 0.5, 0.5), ("fseq", 1)))
    )
    found = [one for port in (5001, 5002) for one in decoder.feed(packet, 0.0, f"10.0.0.2:{port}")]
    assert [one.touch_id for one in found] == [1, 2]


def test_touches_without_end_have_numbers_that_the_service_takes():
    decoder, numbers = TuioDecoder(400.0, 200.0), set()
    for touch in range(600):
        for one in decoder.feed(cursors(touch, {touch: (0.5, 0.5)}), touch / 100):
            numbers.add(one.touch_id)
    assert numbers == {1, 2}  # the next comes down in the frame in which the last goes up


def test_a_source_over_udp_that_falls_silent_lifts_its_fingers(monkeypatch):
    with TuioSource(800.0, 400.0, port=0) as source, socket.socket(type=socket.SOCK_DGRAM) as table:
        assert source.read() == []
        table.sendto(cursors(1, {7: (0.5, 0.25)}), ("127.0.0.1", source.port))
        [touch] = source.read(5.0)
        assert touch[1:5] == (1, 400.0, 100.0, "down")
        monkeypatch.setattr("haptix.play.touch.tuio._ENDS_S", 0.0)
        assert [touch.kind for touch in source.read()] == ["up"]
        with pytest.raises(DeviceError, match=f"port {source.port}"):
            TuioSource(800.0, 400.0, port=source.port)
    with pytest.raises(InputError, match="width_mm"):
        TuioSource(0.0, 400.0)
