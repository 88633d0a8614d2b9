"""Packets of a TUIO table, written by the rules of OSC 1.0, with the fingers that truly touch."""

import random
import struct

from haptix.play.touch import TuioDecoder


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


def frames(seed, count=10, begin_s=0.0, interval_s=0.01):
    """A random sequence: at each frame the fingers that touch, their touches, and the decoder."""
    chance = random.Random(seed)
    is_new, decoder = chance.random() < 0.5, TuioDecoder(800.0, 400.0)
    fingers, number = {}, 0
    for frame in range(count):
        what = chance.random()
        if what < 0.4 or not fingers:
            number += 1
            fingers[number] = [chance.random(), chance.random(), chance.choice([0.0, 0.2])]
        elif what < 0.6:
            del fingers[chance.choice([*fingers])]
        else:
            finger = fingers[chance.choice([*fingers])]
            finger[0] = min(1.0, finger[0] + 0.004 * chance.random())  # at most 3.2 mm
            finger[2] = chance.choice([0.0, 0.2])
        if is_new:
            places = {n: (x, y) for n, (x, y, _) in fingers.items()}
            pressures = {n: -z for n, (*_, z) in fingers.items()}
            packet = pointers(frame, places, pressures=pressures)
        else:
            packet = cursors(frame, dict(fingers), "/tuio/25Dcur")
        touching = {n for n, (*_, z) in fingers.items() if z == 0.0}
        yield touching, decoder.feed(packet, begin_s + frame * interval_s), decoder
