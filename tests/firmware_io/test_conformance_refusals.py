"""What the core refuses, what it says of it, and how it comes back."""

import struct
import zlib
from binascii import crc_hqx

import numpy as np
import pytest

from firmware_io.firmware.core import Output
from firmware_io.protocol import (
    Arm,
    Frame,
    Hello,
    Ping,
    StatusReport,
    Stop,
    StreamSamples,
    TouchPhase,
    TouchReport,
    encode,
    to_reports,
)
from tests.firmware_io.core_rig import BOARD, CODE, PLAIN, RAMP, STATE, TOP, resealed

STEP = [1000, 2000]


def refused(rig, name):
    """Send one thing that a playing rig must refuse; return code, expected, got."""
    good = rig.frame(StreamSamples(2, np.array([3000], np.int16)))
    following = rig.sequence - 1

    def now(message, mode=None, sequence=following):
        data = encode(Frame(message, sequence))
        rig.core.receive(data if mode is None else resealed(data, at_8=mode))

    def samples(codes, index=2):
        return StreamSamples(index, np.array(codes, np.int16))

    if name == "sequence gap":
        now(samples([3000]), sequence=following + 1)
        return CODE.SEQUENCE, following, following + 1
    if name == "replayed":
        now(samples(STEP, 0), sequence=following - 1)
        return CODE.SEQUENCE, following, following - 1
    if name == "index gap":
        now(samples([3000], 3))
        return CODE.SAMPLE_INDEX, 2, 3
    if name == "over the ceiling":
        now(samples([0, TOP + 1]))
        return CODE.CEILING, 20_000, 20_001  # 26214 / 32767 * 25 V = 20.00031 V, rounded up
    if name == "over, negative":
        now(samples([-TOP - 1]))
        return CODE.CEILING, 20_000, 20_001
    if name == "lowest int16":
        now(samples([-32768]))
        return CODE.CEILING, 20_000, 25_001  # 32768 / 32767 * 25 V = 25.00076 V
    if name == "too long":
        now(samples([0] * 1001))
        return CODE.LENGTH, 2004, 2006
    if name == "queue full":
        rig.core.receive(good)
        now(samples([0] * 1000, 3), sequence=following + 1)
        now(samples([0] * 1000, 1003), sequence=following + 2)
        return CODE.QUEUE_FULL, 999, 1000
    if name == "other mode":
        now(samples([3000]), mode=1)
        return CODE.MODE, 0, 1
    if name == "ARM while armed":
        now(Arm())
        return CODE.ALREADY_ARMED, 0, 3
    if name == "SETUP while armed":
        now(PLAIN)
        return CODE.ALREADY_ARMED, 0, 2
    if name == "STOP out of step":
        now(Stop(), sequence=following + 5)
        return CODE.SEQUENCE, following, following + 5
    if name == "PING out of step":
        now(Ping(1), sequence=following + 1)
        return CODE.SEQUENCE, following, following + 1
    if name == "a device's kind":
        now(TouchReport(0, 0, 0, 0, 0, TouchPhase.UP))
        return CODE.KIND, 0, 0x84
    if name == "PING with a mode":
        now(Ping(1), mode=1)
        return CODE.MODE, 0, 1
    if name == "odd payload":
        body = good[:6] + struct.pack("<H", 5) + good[8:17]
        rig.core.receive(resealed(body + bytes(4)))
        return CODE.LENGTH, 2004, 5
    if name == "no samples":
        rig.core.receive(resealed(good[:6] + struct.pack("<H", 4) + good[8:16] + bytes(4)))
        return CODE.LENGTH, 2004, 4
    if name == "unbelievable length":
        rig.core.receive(resealed(good[:6] + struct.pack("<H", 2007) + good[8:]))
        return CODE.LENGTH, 2006, 2007
    if name == "future":
        rig.core.receive(resealed(good, at_2=5))
        return CODE.VERSION, 4, 5
    if name == "damaged sample":
        rig.core.receive(good[:16] + b"\xff" + good[17:])
        carried = struct.unpack("<I", good[-4:])[0]
        return CODE.DAMAGED, zlib.crc32(good[:16] + b"\xff" + good[17:-4]), carried
    if name == "damaged header":
        rig.core.receive(good[:4] + b"\xff" + good[5:])
        due = crc_hqx(good[:4] + b"\xff" + good[5:10], 0xFFFF)
        return CODE.DAMAGED, due, struct.unpack("<H", good[10:12])[0]
    if name == "noise":
        rig.core.receive(b"noise")
        return CODE.DAMAGED, 0, 0
    if name == "cut, then silence":
        rig.core.receive(good[:17])
        rig.core.play(4800)  # 100 ms
        return CODE.TRUNCATED, len(good), 17
    if name == "cut, then a report":
        rig.core.receive(good[:9])
        rig.core.receive_report(to_reports(good)[0])
        return CODE.TRUNCATED, 16, 9
    if name == "a report of another device":
        rig.core.receive_report(b"\x02\x80" + bytes(62))
        return CODE.DAMAGED, 0, 0
    raise AssertionError(name)


REFUSALS = [
    "sequence gap",
    "replayed",
    "index gap",
    "over the ceiling",
    "over, negative",
    "lowest int16",
    "too long",
    "queue full",
    "other mode",
    "ARM while armed",
    "SETUP while armed",
    "STOP out of step",
    "PING out of step",
    "a device's kind",
    "PING with a mode",
    "odd payload",
    "no samples",
    "unbelievable length",
    "future",
    "damaged sample",
    "damaged header",
    "noise",
    "cut, then silence",
    "cut, then a report",
    "a report of another device",
]


@pytest.mark.parametrize("name", REFUSALS)
def test_a_refusal_ends_at_zero_and_is_told(rig, name):
    rig.ready(PLAIN).stream(STEP)
    assert rig.play(2) == STEP
    code, expected, got = refused(rig, name)
    fault, *others = rig.poll()
    assert [type(a) for a in others] == [StatusReport] * (name == "STOP out of step")
    assert (fault.code, fault.expected, fault.got) == (code, expected, got)
    assert rig.core.fault() == fault
    ramp, what = rig.core.play(RAMP + 5)
    if name == "cut, then silence":  # which is longer than a dry waveform is held
        assert not ramp.any()
        return
    assert ramp[0] in (1991, 2000 - 2000 // RAMP)
    assert ramp[RAMP - 1 :].tolist() == [0] * 6
    assert set(what[:RAMP].tolist()) == {Output.RAMP}
    status = rig.core.status()
    assert (status.state, status.fault, status.faults) == (STATE.IDLE, code, 1)


@pytest.mark.parametrize("name", REFUSALS)
def test_after_a_refusal_nothing_plays_until_armed_again(rig, name):
    rig.ready(PLAIN).stream(STEP)
    rig.play(2)
    code, _, _ = refused(rig, name)
    rig.play(5000)  # and what is left of a frame is given up
    rig.poll()
    (fault,) = rig.say(StreamSamples(2, np.array([3000], np.int16)))
    assert fault.code is code  # the first cause, not NOT_ARMED
    assert rig.play(10) == [0] * 10
    rig.say(Arm())
    rig.index = 0
    rig.stream([5])
    assert rig.play(1) == [5]
    assert rig.core.status().fault is CODE.NONE
    assert rig.core.status().faults == 1


def test_damage_while_disarmed_is_skipped_without_a_word(rig):
    rig.core.receive(b"noise HX HX\x02" + encode(Frame(Ping(1), 3))[:-1] + b"?")
    assert rig.poll() == []
    assert rig.say(Hello()) == [BOARD]
    assert rig.core.status().faults == 0


def test_frames_behind_a_broken_one_are_found_in_it(rig):
    rig.say(Hello())
    broken = encode(Frame(StreamSamples(0, np.zeros(60, np.int16)), 9))
    rig.core.receive(broken[:30])
    for token in range(6):  # 20 bytes each; the broken frame waits for 110 more
        rig.core.receive(rig.frame(Ping(token)))
        found = token if token == 5 else 0
        assert rig.core.status().token == found
    assert rig.core.status().next_sequence == rig.sequence


def test_bytes_that_trickle_make_a_frame(rig):
    rig.ready()
    data = rig.frame(Ping(5))
    for start in range(0, len(data), 4):
        rig.play(4000)  # 83 ms; a pause of 100 ms would be too long
        rig.core.receive(data[start : start + 4])
    assert rig.core.status().token == 5


def test_a_stop_while_disarmed_is_no_fault(rig):
    rig.say(Hello())
    rig.sequence = 777
    (status,) = rig.say(Stop())
    assert (status.state, status.fault, status.next_sequence) == (STATE.IDLE, CODE.NONE, 778)


def test_sequences_wrap(rig):
    rig.say(Hello(), PLAIN)
    rig.sequence = 2**16 - 1
    rig.say(Arm())
    rig.stream([1])
    rig.stream([2])
    assert rig.play(2) == [1, 2]
    assert rig.core.status().next_sequence == 2
