"""Touches by TUIO, of packets written by the rules of OSC 1.0."""

import random
import socket
import struct
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptix import InputError
from haptix.base.errors import DeviceError
from haptix.play.touch import Touches, TuioDecoder, TuioSource


def text(value):
    data = value.encode() + b"\0"
    return data + b"\0" * (-len(data) % 4)


def message(address, *arguments):
    kinds = [{int: "i", float: "f", str: "s", Stamp: "t"}[type(each)] for each in arguments]
    data = text(address) + text("," + "".join(kinds))
    for kind, each in zip(kinds, arguments, strict=True):
        data += text(each) if kind == "s" else struct.pack({"t": ">Q"}.get(kind, f">{kind}"), each)
    return data


class Stamp(int):
    """A time of OSC: seconds since 1900, times 2^32."""


def bundle(*messages):
    rows = b"".join(struct.pack(">i", len(each)) + each for each in messages)
    return b"#bundle\0" + struct.pack(">Q", 1) + rows


def cursors(frame, places, address="/tuio/2Dcur", alive=None):
    """A frame of TUIO 1.1: places by id."""
    moves = 4 if address == "/tuio/25Dcur" else 3
    return bundle(
        message(address, "source", "table@10.0.0.2"),
        message(address, "alive", *(places if alive is None else alive)),
        *(message(address, "set", n, *place, *[0.0] * moves) for n, place in places.items()),
        message(address, "fseq", frame),
    )


def pointers(frame, places, t_s=None, pressures=None):
    """A frame of TUIO 2.0."""
    stamp = Stamp(1) if t_s is None else Stamp(round((t_s + 2_208_988_800) * 2**32))
    return bundle(
        message("/tuio2/frm", frame, stamp, 0, "table"),
        *(
            message("/tuio2/ptr", n, 0, 0, x, y, 0.0, 0.0, 0.01, (pressures or {}).get(n, 0.0))
            for n, (x, y) in places.items()
        ),
        message("/tuio2/alv", *places),
    )


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


def sequences(seeds):
    """Compare what is down with what touches, over random sequences of frames."""
    for seed in seeds:
        chance = random.Random(seed)
        is_new, decoder, touches = chance.random() < 0.5, TuioDecoder(800.0, 400.0), Touches()
        fingers, number = {}, 0
        for frame in range(10):
            what = chance.random()
            if what < 0.4 or not fingers:
                number += 1
                fingers[number] = [chance.random(), chance.random(), chance.choice([0.0, 0.2])]
            elif what < 0.6:
                del fingers[chance.choice([*fingers])]
            else:
                finger = fingers[chance.choice([*fingers])]
                finger[0] = chance.random()
                finger[2] = chance.choice([0.0, 0.2])
            if is_new:
                places = {n: (x, y) for n, (x, y, _) in fingers.items()}
                pressures = {n: -z for n, (*_, z) in fingers.items()}
                packet = pointers(frame, places, pressures=pressures)
            else:
                packet = cursors(frame, dict(fingers), "/tuio/25Dcur")
            for touch in decoder.feed(packet, frame / 100):
                touches.push(touch)
            down = {key[1] for key in decoder._ids}
            assert down == {n for n, (*_, z) in fingers.items() if z == 0.0}, seed
            assert len(touches) == len(down), seed


def test_no_finger_above_the_surface_is_down():
    sequences(range(300))


@pytest.mark.slow
def test_no_finger_above_the_surface_is_down_in_many_sequences():
    sequences(range(300, 100_300))


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
