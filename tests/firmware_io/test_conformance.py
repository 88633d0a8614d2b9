"""One suite for the firmware in C and its reference in Python: what PROTOCOL.md promises."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import firmware_io
from firmware_io import DeviceError
from firmware_io.firmware.core import Core, Sensor
from firmware_io.protocol import (
    Arm,
    CapabilitiesReport,
    Frame,
    FrameParser,
    Hello,
    Mark,
    Ping,
    Rate,
    StatusReport,
    Stop,
    StreamMode,
    StreamSamples,
    TouchPhase,
    TouchReport,
    encode,
    to_reports,
)
from tests.firmware_io import golden_sessions
from tests.firmware_io.core_rig import (
    BOARD,
    BOTH,
    CARRIED,
    CODE,
    ENVELOPE,
    PLAIN,
    RAMP,
    STATE,
    Rig,
    resealed,
)
from tests.firmware_io.oracle.device import Oracle
from tests.links import memory_of

# The session


def test_hello_is_answered_by_what_the_board_can_do(rig):
    assert rig.say(Hello()) == [BOARD]
    assert rig.say(Hello(2, 9)) == [BOARD]


@pytest.mark.parametrize(("oldest", "newest", "got"), [(5, 6, 5), (0, 1, 1), (3, 3, 3)])
def test_a_host_of_another_version_is_refused_by_name(rig, oldest, newest, got):
    (fault,) = rig.say(Hello(oldest, newest))
    assert (fault.code, fault.expected, fault.got) == (CODE.VERSION, 4, got)
    assert rig.say(Hello()) == [BOARD]


@pytest.mark.parametrize(("message", "version"), [(Hello(), 2), (Hello(), 5), (Ping(1), 3)])
def test_a_frame_of_another_version_is_refused_by_name(rig, message, version):
    rig.core.receive(encode(Frame(message, 0), version))
    (fault,) = rig.poll()
    assert (fault.code, fault.expected, fault.got) == (CODE.VERSION, 4, version)


def test_a_host_that_also_speaks_the_version_before_begins_in_it(rig):
    rig.core.receive(encode(Frame(Hello(3, 4), 0), 3))
    assert rig.poll() == [BOARD]


def test_a_session_step_by_step(rig):
    status = rig.core.status()
    assert status == StatusReport(STATE.IDLE, CODE.NONE, 0, 0, 0, 2000, 0, 0, 0, 0)
    rig.say(Hello())
    assert rig.say(PLAIN) == [replace(status, next_sequence=2)]
    assert rig.say(Arm()) == [replace(status, state=STATE.ARMED, next_sequence=3)]
    assert rig.stream([5, 6, 7]) == []
    assert rig.play(2) == [5, 6]
    playing = StatusReport(STATE.PLAYING, CODE.NONE, 5, 99, 1, 1999, 2, 0, 0, 2)
    assert rig.say(Ping(99)) == [playing]
    (stopped,) = rig.say(Stop())
    assert stopped == replace(
        playing, state=STATE.RAMPING, next_sequence=6, queued_samples=0, free_samples=2000
    )
    rig.play(RAMP)
    assert rig.poll() == [replace(stopped, state=STATE.IDLE, clock_ticks=242)]
    assert rig.play(3) == [0, 0, 0]
    assert rig.poll() == []


def test_arm_needs_a_setup(rig):
    (fault,) = rig.say(Arm())
    assert fault.code is CODE.NOT_SET_UP


def test_hello_ends_everything(rig):
    rig.ready().stream([20_000] * 100)
    rig.play(50)
    assert rig.say(Hello()) == [BOARD]
    assert rig.play(RAMP)[-1] == 0
    assert rig.core.status().fault is CODE.NONE
    assert rig.say(Arm())[0].code is CODE.NOT_SET_UP


# SETUP


@pytest.mark.parametrize(
    ("field", "value", "offset", "bound"),
    [
        ("watchdog_ms", 9, 2, 10),
        ("watchdog_ms", 161, 2, 160),
        ("sample_rate_hz", 44_100, 4, 48_000),
        ("full_scale_mv", 24_999, 8, 25_000),
        ("ceiling_mv", 20_001, 12, 20_000),
        ("ceiling_mv", 0, 12, 1),
        ("max_slew_v_per_s", 2_638_938, 16, 2_638_937),
        # The ramp from code 26213 takes 240 steps of 110 codes at most: 110 48000 25 / 32767 V/s.
        ("max_slew_v_per_s", 4_028, 16, 4_029),
        ("max_slew_v_per_s", 0, 16, 4_029),
        ("carrier_mhz", 1, 20, 0),
        ("lead_us", 160_001, 24, 160_000),
    ],
)
def test_an_impossible_setup_is_named(rig, field, value, offset, bound):
    rig.say(Hello(), PLAIN)
    (fault,) = rig.say(replace(PLAIN, **{field: value}))
    assert (fault.code, fault.field_offset) == (CODE.SETUP, offset)
    assert (fault.expected, fault.got) == (bound, value)
    assert [a.code for a in rig.say(Arm())] == [CODE.SETUP]  # the first cause stands
    assert rig.core.status().state is STATE.IDLE
    assert [type(a) for a in rig.say(PLAIN, Arm())] == [StatusReport]


@pytest.mark.parametrize("carrier_mhz", [0, 999_999, 24_000_001])
def test_an_impossible_carrier_is_named(rig, carrier_mhz):
    (fault,) = rig.say(Hello(), replace(CARRIED, carrier_mhz=carrier_mhz))[1:]
    assert (fault.code, fault.field_offset, fault.got) == (CODE.SETUP, 20, carrier_mhz)


def test_a_rate_is_bound_to_its_modes(rig):
    (fault,) = rig.say(Hello(), replace(CARRIED, sample_rate_hz=6_000))[1:]
    assert (fault.code, fault.field_offset, fault.got) == (CODE.SETUP, 4, 6_000)


def test_an_unknown_mode_is_named(rig):
    data = bytearray(rig.frame(PLAIN))
    data[12] = 2
    rig.core.receive(resealed(bytes(data)))
    (fault,) = rig.poll()
    assert (fault.code, fault.field_offset, fault.got) == (CODE.SETUP, 0, 2)


def test_limits_are_lowered_only_until_the_next_hello(rig):
    rig.say(Hello(), replace(PLAIN, ceiling_mv=10_000, max_slew_v_per_s=900_000))
    (fault,) = rig.say(replace(PLAIN, ceiling_mv=10_001, max_slew_v_per_s=900_000))
    assert (fault.field_offset, fault.expected) == (12, 10_000)
    (fault,) = rig.say(replace(PLAIN, ceiling_mv=10_000, max_slew_v_per_s=900_001))
    assert fault.code is CODE.SETUP
    rig.ready(PLAIN)


# Answers


def test_status_comes_unasked_in_its_interval(rig):
    rig.ready(replace(PLAIN, status_ms=5))
    seen = []
    for _ in range(100):
        rig.stream([1] * 24)
        rig.play(24)
        seen += [a.clock_ticks for a in rig.poll()]
    assert seen == [240 * k for k in range(1, 11)]
    rig.play(100)
    rig.say(Stop())
    rig.play(RAMP)
    rig.say(Arm())
    rig.play(239)
    assert rig.poll() == []
    rig.play(1)
    assert [a.state for a in rig.poll()] == [STATE.ARMED]  # an interval after ARM


def test_answers_are_numbered(rig):
    rig.say(Hello())
    sent = []
    for token in range(5):
        rig.core.receive(rig.frame(Ping(token)))
        sent += FrameParser().feed(rig.core.transmit())
    assert [frame.sequence for frame in sent] == [1, 2, 3, 4, 5]
    assert [frame.message.token for frame in sent] == [0, 1, 2, 3, 4]


def test_touches_wait_for_the_host_and_are_stamped(rig):
    rig.play(100)
    touch = TouchReport(0, 60_000, 20_000, 500, 1, TouchPhase.DOWN)
    assert [rig.core.touch(touch) for _ in range(9)] == [True] * 8 + [False]
    assert rig.poll() == [replace(touch, clock_ticks=100)] * 8
    assert rig.core.touch(touch)


def test_reports_carry_a_session(rig):
    answers = FrameParser()

    def say(message):
        for report in to_reports(rig.frame(message)):
            rig.core.receive_report(report)
        heard = b""
        while report := rig.core.transmit_report():
            assert len(report) == 64
            assert report[0] == 1
            heard += report[2 : 2 + (report[1] & 0x7F)]
        return [frame.message for frame in answers.feed(heard)]

    assert say(Hello()) == [BOARD]
    assert [a.state for a in say(PLAIN)] == [STATE.IDLE]
    assert [a.state for a in say(Arm())] == [STATE.ARMED]
    codes = np.arange(200, dtype=np.int16)
    assert say(StreamSamples(0, codes)) == []
    assert rig.play(200) == codes.tolist()


def test_a_lost_report_costs_its_own_frame_only(rig):
    rig.say(Hello(), PLAIN)
    reports = to_reports(encode(Frame(StreamSamples(0, np.zeros(100, np.int16)), 9)))
    for report in reports[:2]:  # not the third and fourth
        rig.core.receive_report(report)
    for report in to_reports(encode(Frame(Ping(5), 10))):
        rig.core.receive_report(report)
    assert [a.token for a in rig.poll()] == [5]


def test_a_board_without_reports_sends_none():
    board = Rig(replace(BOARD, report_bytes=0))
    board.core.receive(board.frame(Hello()))
    assert board.core.transmit_report() == b""
    assert board.core.transmit() != b""


def test_when_the_host_goes_away_the_board_forgets_it(rig):
    rig.ready().stream([9000] * 50)
    rig.play(50)
    rig.core.receive(b"HX\x02")
    rig.core.touch(TouchReport(0, 0, 0, 0, 0, TouchPhase.UP))
    rig.core.release()
    assert rig.core.transmit() == b""
    assert rig.play(RAMP)[-1] == 0
    rig.poll()
    assert [a.code for a in rig.say(Arm())] == [CODE.NOT_SET_UP]


def test_half_an_answer_is_not_kept_for_the_next_host(rig):
    rig.say()
    rig.core.receive(rig.frame(Hello()))
    assert rig.core.transmit_report()[1] & 0x80
    rig.core.release()
    assert rig.core.transmit_report() == b""


def test_pending_ticks_are_those_until_rest(rig):
    rig.ready(replace(CARRIED, lead_us=1000))
    assert rig.core.pending_ticks == 0
    rig.stream([100] * 7, ENVELOPE)
    assert rig.core.pending_ticks == 48 + 21
    rig.play(50)
    assert rig.core.pending_ticks == 19
    rig.play(19)
    assert rig.core.pending_ticks == 0
    rig.say(Stop())
    assert rig.core.pending_ticks == RAMP


# Boards that cannot be


@pytest.mark.parametrize(
    "impossible",
    [
        {"output_rate_hz": 999},
        {"output_rate_hz": 1_000_001},
        {"full_scale_mv": 0},
        {"ceiling_mv": 200_001},
        {"ceiling_mv": 0},
        {"max_slew_v_per_s": 4_028},
        {"max_slew_v_per_s": 4_666_667},
        {"queue_samples": 999},
        {"queue_samples": 2**17 + 1},
        {"guard_ticks": 0},
        {"guard_ticks": 65_536},
        {"max_frame_samples": 0},
        {"max_watchdog_ms": 9},
        {"max_watchdog_ms": 161},
        {"report_bytes": 7},
        {"report_bytes": 65},
        {"rates": ()},
        {"rates": (Rate(44_100, BOTH),)},
        {"rates": (Rate(0, BOTH),)},
        {"rates": (Rate(48_000, frozenset()),)},
        {"rates": (Rate(48_000, BOTH),) * 9},
        {"output_rate_hz": -1},
        {"output_rate_hz": 2**40},
        {"name": "seventeen letters"},
        {"serial": "ü"},
    ],
    ids=str,
)
@pytest.mark.parametrize("kind", [Core, Oracle])
def test_impossible_boards(kind, impossible):
    with pytest.raises(DeviceError):
        kind(replace(BOARD, **impossible))


@pytest.mark.parametrize(
    ("rate_hz", "full_scale_na", "panel_pf"),
    [
        *((rate_hz, 20_000_000, 2000) for rate_hz in (125, 300, 750, 8000)),
        *((250, full_scale_na, 2000) for full_scale_na in (99_999, 50_000_001)),
        *((250, 20_000_000, panel_pf) for panel_pf in (99, 100_001)),
    ],
)
@pytest.mark.parametrize("kind", [Core, Oracle])
def test_impossible_converters(kind, rate_hz, full_scale_na, panel_pf):
    kind(replace(BOARD, sense_rate_hz=250), Sensor(20e-3, 2e-9))
    with pytest.raises(DeviceError):
        sensor = Sensor(full_scale_na * 1e-9, panel_pf * 1e-12)
        kind(replace(BOARD, sense_rate_hz=rate_hz), sensor)


# A whole session, for boards that are not in this house


SESSIONS = sorted((Path(firmware_io.__file__).parent / "golden").glob("session-*.json"))


@pytest.mark.parametrize("path", SESSIONS, ids=lambda path: path.stem)
@pytest.mark.parametrize("kind", [Core, Oracle])
def test_golden_sessions(kind, path):
    session = json.loads(path.read_text())
    board = dict(session["board"])
    board["rates"] = tuple(Rate(r, frozenset(map(StreamMode, m))) for r, m in board["rates"])
    told = session.get("sensor", {"full_scale_na": 0, "panel_pf": 0})
    sensor = Sensor(told["full_scale_na"] * 1e-9, told["panel_pf"] * 1e-12)
    core = kind(CapabilitiesReport(**board), sensor)
    codes = np.empty(0, np.int16)
    for number, step in enumerate(session["steps"]):
        if "receive" in step:
            core.receive(bytes.fromhex(step["receive"]))
        elif "report" in step:
            core.receive_report(bytes.fromhex(step["report"]))
        elif "transmit" in step:
            assert core.transmit().hex(" ") == step["transmit"], f"step {number}"
        elif "sense" in step:
            core.sense(codes, np.array(step["sense"], np.int16))
        else:
            codes = core.play(len(step["play"]))[0]
            assert codes.tolist() == step["play"], f"step {number}"


@pytest.mark.parametrize("name", golden_sessions.SESSIONS)
def test_golden_sessions_are_those_of_an_independent_calculation(name):
    path = golden_sessions.FOLDER / f"{name}.json"
    assert path.read_text() == golden_sessions.SESSIONS[name]()


@pytest.mark.parametrize(
    ("ceiling_mv", "slew", "expected"),
    [
        (20_000, 2_638_937, [26_213, -26_213, 26_213, -26_213]),
        (10_000, 2_638_937, [13_106, -13_106, 13_106, -13_106]),
        (20_000, 48_000, [1310, 0, 1310, 0]),
    ],
)
@pytest.mark.parametrize("marks", [0, 1], ids=["in a run", "one by one"])
def test_codes_that_went_bad_in_memory_are_limited(ceiling_mv, slew, expected, marks):
    """What was checked as it came is changed in the queue: the output keeps ceiling and slew."""
    core = Core(replace(BOARD, takes_marks=True))
    setup = replace(PLAIN, ceiling_mv=ceiling_mv, max_slew_v_per_s=slew)
    for number, message in enumerate((Hello(), setup, Arm())):
        core.receive(encode(Frame(message, number)))
    sent = np.array([111, 222, 333, 444], np.int16)
    core.receive(encode(Frame(StreamSamples(0, sent, PLAIN.mode), 3)))
    for number in range(marks):  # one that is not due: each sample is looked at by itself
        core.receive(encode(Frame(Mark(1000, 0), 4 + number)))
    memory = memory_of(core)
    damaged = np.array([32767, -32767, 30000, -30000], np.int16).tobytes()
    memory[:] = bytes(memory).replace(sent.tobytes(), damaged)
    played, _ = core.play(4)
    assert played.tolist() == expected
    # The ramp begins at what stands on the output, and not at what should have stood there.
    core.receive(encode(Frame(Stop(), 4 + marks)))
    ramp = core.play(RAMP)[0].astype(int)
    assert np.array_equal(ramp, np.trunc(expected[-1] * np.arange(RAMP - 1, -1, -1) / RAMP))


@pytest.mark.parametrize("waits", [False, True], ids=["at once", "when the host has spoken"])
def test_a_word_that_went_bad_in_memory_ends_the_output(waits):
    """A changed count of the watchdog, as any other word, is noticed before a sample leaves."""
    rig = Rig()
    rig.ready(replace(PLAIN, sample_rate_hz=6_000, max_slew_v_per_s=48_000))  # 1310 codes a sample
    rig.play(1000)
    rig.stream([5000] * 100)
    rig.play(20)
    memory = np.frombuffer(memory_of(rig.core), np.uint32)
    before = memory.copy()
    assert rig.play(1)[0] == 5000
    (place,) = np.flatnonzero((before == 20) & (memory == 21))  # counted from the stream
    memory[place] = 48_000
    if waits:
        rig.core.receive(encode(Frame(Stop(), 4)))
        rig.core.release()
    assert rig.core.pending_ticks == 4
    assert rig.core.play(6)[0].tolist() == [3690, 2380, 1070, 0, 0, 0]
    assert rig.core.transmit() == rig.core.transmit_report() == b""
    assert not rig.core.play(48_000)[0].any()


def test_there_are_golden_sessions():
    assert [path.stem for path in SESSIONS] == sorted(golden_sessions.SESSIONS.keys() - {"frames"})
