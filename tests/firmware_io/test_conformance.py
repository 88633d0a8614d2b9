"""One suite for the firmware in C and its reference in Python: what PROTOCOL.md promises."""

import json
import math
import struct
import zlib
from binascii import crc_hqx
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import firmware_io
from firmware_io import DeviceError
from firmware_io.firmware.core import Core, Output, Sensor
from firmware_io.protocol import (
    Arm,
    CapabilitiesReport,
    DeviceState,
    FaultCode,
    Frame,
    FrameParser,
    Hello,
    Mark,
    Ping,
    Rate,
    Setup,
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
from tests.firmware_io.oracle.device import Oracle
from tests.links import memory_of

BOTH = frozenset(StreamMode)
WAVEFORM, ENVELOPE = StreamMode.WAVEFORM, StreamMode.ENVELOPE
STATE, CODE = DeviceState, FaultCode

#: 48 kHz out; 25 V full scale, of which 20 V are allowed: code 26213. So low that the slew admits
#: any step of them.
BOARD = CapabilitiesReport(
    oldest_version=4,
    newest_version=4,
    report_bytes=64,
    output_rate_hz=48_000,
    full_scale_mv=25_000,
    ceiling_mv=20_000,
    max_slew_v_per_s=2_638_937,
    queue_samples=2000,
    max_frame_samples=1000,
    max_watchdog_ms=250,
    name="board",
    serial="B1",
    calibration_id="none yet",
    reports_touch=True,
    rates=(Rate(48_000, BOTH), Rate(16_000, BOTH), Rate(6_000, frozenset({WAVEFORM}))),
)
PLAIN = Setup(WAVEFORM, 250, 48_000, 25_000, 20_000, 2_638_937, lead_us=0)
CARRIED = replace(PLAIN, mode=ENVELOPE, sample_rate_hz=16_000, carrier_mhz=4_000_000)
TOP = 26213
RAMP = 240  # 5 ms


class Rig:
    """A core on the bench, and a host that numbers its frames."""

    def __init__(self, config=BOARD):
        self.core = Core(config)
        self.parser = FrameParser()
        self.sequence = 0
        self.index = 0

    def frame(self, message):
        data = encode(Frame(message, self.sequence % 2**16))
        self.sequence += 1
        return data

    def say(self, *messages):
        """Send messages; return what the device says."""
        for message in messages:
            self.core.receive(self.frame(message))
        return self.poll()

    def poll(self):
        return [frame.message for frame in self.parser.feed(self.core.transmit())]

    def ready(self, setup=PLAIN):
        """Set up and armed."""
        self.say(Hello(), setup, Arm())
        self.index = 0
        assert self.core.status().state is STATE.ARMED
        return self

    def stream(self, codes, mode=WAVEFORM):
        codes = np.array(codes, np.int16)
        answers = self.say(StreamSamples(self.index, codes, mode))
        self.index += codes.size
        return answers

    def play(self, ticks):
        return self.core.play(ticks)[0].tolist()


@pytest.fixture
def rig():
    return Rig()


def resealed(data: bytes, **changes: int) -> bytes:
    """A frame with header bytes changed (`at_3=9`) and both check sums made right again."""
    body = bytearray(data[:-4])
    for where, value in changes.items():
        body[int(where.removeprefix("at_"))] = value
    body[10:12] = struct.pack("<H", crc_hqx(bytes(body[:10]), 0xFFFF))
    return bytes(body) + struct.pack("<I", zlib.crc32(body))


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
        ("watchdog_ms", 251, 2, 250),
        ("sample_rate_hz", 44_100, 4, 48_000),
        ("full_scale_mv", 24_999, 8, 25_000),
        ("ceiling_mv", 20_001, 12, 20_000),
        ("ceiling_mv", 0, 12, 1),
        ("max_slew_v_per_s", 2_638_938, 16, 2_638_937),
        # The ramp from code 26213 takes 240 steps of 110 codes at most: 110 48000 25 / 32767 V/s.
        ("max_slew_v_per_s", 4_028, 16, 4_029),
        ("max_slew_v_per_s", 0, 16, 4_029),
        ("carrier_mhz", 1, 20, 0),
        ("lead_us", 250_001, 24, 250_000),
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


# What is played


def test_a_waveform_at_the_output_rate_is_played_as_it_is(rig):
    rng = np.random.default_rng(1)
    codes = rng.integers(-TOP, TOP + 1, 1000).tolist()
    rig.ready().stream(codes)
    assert rig.play(1000) == codes


@pytest.mark.parametrize("lead_us", [0, 1000, 20_833, 240_000])
def test_playback_begins_a_lead_after_the_first_sample(rig, lead_us):
    rig.ready(replace(PLAIN, lead_us=lead_us))
    assert rig.play(700) == [0] * 700  # waiting is free
    rig.stream([7, 8])
    rig.stream([9])
    lead = lead_us * 48 // 1000
    assert rig.play(lead + 3) == [0] * lead + [7, 8, 9]


@pytest.mark.parametrize("rate_hz", [16_000, 6_000])
def test_slower_samples_are_joined_by_straight_lines(rig, rate_hz):
    rng = np.random.default_rng(2)
    codes = rng.integers(-TOP, TOP + 1, 40)
    rig.ready(replace(PLAIN, sample_rate_hz=rate_hz)).stream(codes)
    each = 48_000 // rate_hz
    played = np.array(rig.play(40 * each))
    expected = np.interp(np.arange(1, 40 * each + 1), np.arange(41) * each, [0, *codes])
    assert np.abs(played - expected).max() < 1.0  # rounded toward the sample before
    assert played[each - 1 :: each].tolist() == codes.tolist()


@pytest.mark.parametrize("carrier_hz", [1000.0, 3999.999, 4000.0, 11_000.0])
def test_an_envelope_is_carried_by_a_sine(rig, carrier_hz):
    rng = np.random.default_rng(3)
    codes = np.abs(np.cumsum(rng.integers(-900, 900, 1000)) % (2 * TOP) - TOP)
    codes[:3] = TOP, 0, -TOP
    rig.ready(replace(CARRIED, carrier_mhz=round(carrier_hz * 1e3))).stream(codes, ENVELOPE)
    played = np.array(rig.play(3000))
    envelope = np.interp(np.arange(1, 3001), np.arange(1001) * 3, [0, *codes])
    expected = envelope * np.sin(2 * np.pi * carrier_hz * np.arange(3000) / 48_000)
    # One code for each of three roundings (line, sine, product), and the sine table's 0.2.
    assert np.abs(played - expected).max() < 3.2
    assert np.abs(played).max() <= TOP


def test_the_carrier_keeps_its_frequency(rig):
    """400 frames of a constant envelope, and the phase at their end."""
    setup = replace(CARRIED, carrier_mhz=3_141_593)
    rig.ready(setup)
    for _ in range(160):
        rig.stream([20_000] * 100, ENVELOPE)
        played = rig.play(300)
    turn = 2 * np.pi * 3141.593 / 48_000 * np.arange(159 * 300, 160 * 300)
    # Rounding of the frequency, below 2**-32 of a turn a sample, is 0.5 codes after a second.
    assert np.abs(played - 20_000 * np.sin(turn)).max() < 3.7


def test_an_empty_queue_holds_the_last_sample_and_counts_once(rig):
    rig.ready().stream([100, 200])
    assert rig.play(6) == [100, 200, 200, 200, 200, 200]
    assert rig.core.status().underruns == 1
    rig.stream([300])
    codes, what = rig.core.play(3)
    assert codes.tolist() == [300, 300, 300]
    assert what.tolist() == [Output.STREAM, Output.HELD, Output.HELD]
    assert rig.core.status().underruns == 2
    assert rig.core.status().samples_played == 3


def test_a_dry_waveform_is_at_zero_10_ms_after_its_last_sample_and_fades_in(rig):
    rig.ready().stream([24_000, -24_000] * 10 + [24_000])
    rig.play(21)
    codes, what = rig.core.play(1000)
    hold = 480 - RAMP
    assert codes[:hold].tolist() == [24_000] * hold
    assert codes[hold : hold + RAMP].tolist() == [100 * (RAMP - k) for k in range(1, RAMP + 1)]
    assert not codes[hold + RAMP :].any()
    expected = [Output.HELD] * hold + [Output.RAMP] * RAMP + [Output.HELD] * 520
    assert what.tolist() == expected
    rig.stream([24_000] * 300)
    codes, what = rig.core.play(300)
    assert codes[:RAMP].tolist() == [100 * k for k in range(1, RAMP + 1)]
    assert codes[RAMP:].tolist() == [24_000] * (300 - RAMP)
    assert set(what.tolist()) == {Output.STREAM}
    assert rig.core.status().underruns == 1


def test_a_dry_waveform_whose_samples_return_amid_the_ramp_goes_on_from_there(rig):
    rig.ready().stream([24_000])
    rig.play(1 + 240 + 100)
    rig.stream([24_000] * 50)
    assert rig.play(50) == [14_000 + 100 * k for k in range(1, 51)]


def test_a_held_envelope_keeps_its_carrier(rig):
    rig.ready(CARRIED).stream([20_000] * 4, ENVELOPE)
    rig.play(12)
    held, what = rig.core.play(24)
    assert set(what.tolist()) == {Output.HELD}
    expected = 20_000 * np.sin(2 * np.pi * 4000 * np.arange(12, 36) / 48_000)
    assert np.abs(held - expected).max() < 3.2  # as above


# The ramp


@pytest.mark.parametrize("last", [1, -239, 26213, -26213])
def test_the_safety_ramp_is_straight_and_takes_5_ms(rig, last):
    rig.ready().stream([last] * 3)
    rig.play(3)
    rig.say(Stop())
    codes, what = rig.core.play(RAMP + 5)
    line = last * (1 - np.arange(1, RAMP + 1) / RAMP)
    assert codes[:RAMP].tolist() == np.trunc(np.round(line, 9)).tolist()
    assert codes[RAMP:].tolist() == [0] * 5
    assert what.tolist() == [Output.RAMP] * RAMP + [Output.IDLE] * 5


def test_the_ramp_of_an_envelope_keeps_its_carrier(rig):
    rig.ready(CARRIED).stream([24_000] * 100, ENVELOPE)
    rig.play(300)
    rig.say(Stop())
    rig.say(replace(PLAIN, mode=WAVEFORM), Arm())  # a set-up must not take the carrier away
    played = np.array(rig.play(RAMP + 1))
    turn = 2 * np.pi * 4000 * np.arange(300, 300 + RAMP) / 48_000
    expected = 24_000 * (1 - np.arange(1, RAMP + 1) / RAMP) * np.sin(turn)
    assert np.abs(played[:RAMP] - expected).max() < 3.2  # as above
    assert played[-1] == 0


def test_a_second_refusal_does_not_prolong_the_ramp(rig):
    rig.ready().stream([24_000] * 10)
    rig.play(10)
    for _ in range(2):
        rig.core.receive(b"noise")
        rig.say(StreamSamples(3, np.zeros(1, np.int16)))
        rig.play(100)
    assert rig.play(RAMP - 200)[-2:] == [100, 0]
    assert rig.play(10) == [0] * 10


def test_what_is_queued_is_thrown_away(rig):
    rig.ready().stream([1000] * 500)
    rig.play(1)
    rig.say(Stop())
    assert rig.play(RAMP + 500)[RAMP:] == [0] * 500


def test_arming_during_a_ramp_begins_behind_it(rig):
    rig.ready().stream([24_000] * 10)
    rig.play(10)
    rig.say(Stop())
    rig.play(100)
    rig.say(Arm())
    rig.index = 0
    rig.stream([-5, -6])
    codes, what = rig.core.play(RAMP - 100 + 2)
    assert codes[-3:].tolist() == [0, -5, -6]
    assert what.tolist() == [Output.RAMP] * (RAMP - 100) + [Output.STREAM] * 2


@pytest.mark.parametrize("lead_us", [1000, 10_000])
def test_the_lead_runs_during_the_ramp(rig, lead_us):
    rig.ready(replace(PLAIN, lead_us=lead_us)).stream([24_000] * 10)
    rig.play(lead_us * 48 // 1000 + 10)
    rig.say(Stop(), Arm())
    rig.index = 0
    rig.stream([-5, -6])
    begin = max(RAMP, lead_us * 48 // 1000)
    assert rig.core.pending_ticks == begin + 2
    assert rig.play(begin + 2)[begin - 1 :] == [0, -5, -6]


# The watchdog


@pytest.mark.parametrize("watchdog_ms", [10, 33, 250])
@pytest.mark.parametrize("queued", [1, 1000])
def test_silence_ends_at_zero_within_the_watchdog_time(rig, watchdog_ms, queued):
    rig.ready(replace(PLAIN, watchdog_ms=watchdog_ms))
    rig.stream([20_000] * queued)
    ticks = watchdog_ms * 48
    played = rig.play(ticks)
    assert played[-1] == 0
    assert rig.play(1000) == [0] * 1000
    fault, status = [*rig.poll(), rig.core.status()][:2]
    assert (fault.code, fault.expected) == (CODE.STARVED, watchdog_ms)
    assert fault.clock_ticks == ticks - RAMP
    assert (status.state, status.fault, status.faults) == (STATE.IDLE, CODE.STARVED, 1)


def test_frames_hold_the_watchdog_off_and_nothing_else_does(rig):
    rig.ready(replace(PLAIN, watchdog_ms=20))
    for _ in range(10):
        rig.stream([100] * 700)
        rig.play(700)
        assert rig.core.status().state is STATE.PLAYING
    for _ in range(3):
        rig.say(Ping(1))
        rig.play(300)
    assert rig.core.status().fault is CODE.STARVED


def test_an_armed_board_that_has_played_nothing_does_not_starve(rig):
    rig.ready()
    rig.play(100_000)
    assert rig.core.status().state is STATE.ARMED


# Refusals

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


@pytest.mark.parametrize("over", [0, 1])
def test_the_highest_code_under_a_lowered_ceiling(rig, over):
    # 10 V of 25 V are code 13106.8.
    rig.ready(replace(PLAIN, ceiling_mv=10_000))
    rig.stream([13106 + over, -13106])
    assert rig.core.status().fault is (CODE.CEILING if over else CODE.NONE)


# 1 V at 48 kHz are 48 kV/s. In codes: 1 / 25 * 32767 = 1310.68.
@pytest.mark.parametrize(
    ("codes", "steep"),
    [
        ([1310, 2620, 1310, 0, -1310], None),
        ([1311], 0),
        ([1310, 2621], 1),
        ([1310, 0, -1311], 2),
        ([1310, 2620, 2620, 1309], 3),
    ],
)
def test_slew_of_a_waveform(rig, codes, steep):
    rig.ready(replace(PLAIN, max_slew_v_per_s=48_000))
    rig.stream(codes)
    fault = rig.core.fault()
    if steep is None:
        assert fault is None
    else:
        assert (fault.code, fault.expected, fault.got) == (CODE.SLEW, 48_000, steep)


def test_slew_counts_across_frames(rig):
    rig.ready(replace(PLAIN, max_slew_v_per_s=48_000))
    rig.stream([1310])
    rig.stream([1310 - 1311])
    assert rig.core.fault().code is CODE.SLEW


def test_slew_begins_at_zero_after_arming(rig):
    rig.ready(replace(PLAIN, max_slew_v_per_s=48_000))
    rig.stream([1310, 2620])
    rig.play(2)
    rig.say(Stop())
    rig.play(RAMP)
    rig.say(Arm())
    rig.index = 0
    rig.stream([1311])
    assert rig.core.fault().code is CODE.SLEW


@pytest.mark.parametrize("share", [1.01, 0.99])
def test_slew_of_an_envelope_counts_the_carrier(rig, share):
    # A rise of 131 codes a sample is 16 kV/s; the carrier at 100 V adds 2 pi f v = 2513 kV/s.
    rise_v_per_s = 131 / 32767 * 25 * 16_000
    carrier_per_code = 2 * math.pi * 4000 * 25 / 32767
    limit = math.floor(share * carrier_per_code * 13100)
    rig.ready(replace(CARRIED, max_slew_v_per_s=limit))
    rig.stream([*(131 * k for k in range(1, 101)), *[13100] * 50], ENVELOPE)
    if share > 1:
        assert rig.core.fault() is None
    else:
        highest = (limit - rise_v_per_s) / carrier_per_code
        assert rig.core.fault().code is CODE.SLEW
        assert rig.core.fault().got == math.floor(highest / 131)


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
        {"max_watchdog_ms": 251},
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
