"""Random, mutated and cut bytes at both ends of the wire: in step again, never above the ceiling.

The same calls go to the firmware in C and to its oracle, which must not differ in a sample or a
byte. `make -C tests/firmware_io/firmware fuzz` goes deeper into the C with libFuzzer.
"""

from typing import Any

import numpy as np
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from firmware_io import ProtocolError
from firmware_io.firmware.core import Core, Output, Sensor
from firmware_io.protocol import (
    Arm,
    CapabilitiesReport,
    DeviceState,
    Frame,
    FrameParser,
    Hello,
    Mark,
    Ping,
    Rate,
    Setup,
    Stop,
    StreamMode,
    StreamSamples,
    TouchPhase,
    TouchReport,
    encode,
    to_reports,
)
from tests.firmware_io.oracle.device import Oracle

BOTH = frozenset(StreamMode)
BOARD = CapabilitiesReport(
    *(2, 2, 64, 16_000, 25_000, 20_000, 2_600_000, 300, 120, 60),
    *("fuzzed", "1", "", True, (Rate(16_000, BOTH), Rate(4_000, BOTH))),
    takes_marks=True,
    sense_rate_hz=4000,
)
SENSOR = Sensor(2e-3, 2e-9)
TOP = 26213
WATCHDOG_TICKS = 60 * 16
LONGEST = 16 + 4 + 2 * 120

setups = st.builds(
    Setup,
    st.sampled_from(StreamMode),
    st.sampled_from([10, 60, 0]),
    st.sampled_from([16_000, 4_000, 3]),
    st.sampled_from([25_000, 25_001]),
    st.sampled_from([20_000, 10_000, 20_001]),
    st.sampled_from([2_600_000, 400_000]),
    st.sampled_from([0, 3_000_000]),
    st.sampled_from([0, 1000]),
    st.sampled_from([0, 3]),
)
good_setups = st.sampled_from(
    [
        Setup(StreamMode.WAVEFORM, 60, 16_000, 25_000, 20_000, 2_600_000, lead_us=500),
        Setup(StreamMode.WAVEFORM, 60, 16_000, 25_000, 20_000, 300_000, lead_us=0),
        Setup(StreamMode.ENVELOPE, 60, 4_000, 25_000, 20_000, 2_600_000, 3_000_000, 0, 2),
        Setup(StreamMode.ENVELOPE, 60, 16_000, 25_000, 20_000, 600_000, 3_000_000, 900),
    ]
)
lengths = st.integers(1, 121)
codes = st.one_of(
    arrays(np.int16, lengths, elements=st.integers(-TOP, TOP), fill=st.integers(-TOP, TOP)),
    arrays(np.int16, lengths, elements=st.integers(-9000, 9000), fill=st.integers(-9000, 9000)),
    arrays(np.int16, lengths),
)
touches = st.builds(
    TouchReport,
    st.just(0),
    st.integers(0, 9),
    st.just(1),
    st.just(2),
    st.just(3),
    st.just(TouchPhase.UP),
)

# Shares of the drive, and of the drive a sample before, in the current; and other codes beside it.
# The panel draws 0.94 mA at the full scale of the drive, which are 0.47 of the converter's.
panel = 0.47 / np.sin(2 * np.pi * 3 / 16)
loads = st.one_of(
    st.just((panel * np.cos(2 * np.pi * 3 / 16), -panel, 0)),
    st.tuples(st.floats(-2, 2), st.floats(-2, 2), st.sampled_from([0, 1, 100, 30_000])),
    st.none(),
)

# What a host may do. A stream is made to continue what the device accepted, as in real life.
talk = st.one_of(
    st.tuples(st.just("say"), good_setups | setups | st.builds(Stop) | st.builds(Ping, st.just(7))),
    st.tuples(st.just("say"), st.builds(Hello, st.sampled_from([2, 3]), st.sampled_from([2, 9]))),
    st.tuples(st.just("say"), st.builds(Arm)),
    st.tuples(st.just("say"), st.builds(Mark, st.integers(0, 300), st.integers(0, 9))),
    st.tuples(st.just("stream"), codes),
    st.tuples(st.just("stream"), codes),
    st.tuples(st.just("play"), st.integers(0, 50) | st.sampled_from([100, 1000, 2000])),
    st.tuples(st.just("begin"), good_setups),
)
noise = st.one_of(
    st.tuples(st.just("bytes"), st.binary(max_size=80)),
    st.tuples(st.just("bytes"), st.binary(max_size=30).map(lambda tail: b"HX\x02" + tail)),
    st.tuples(st.just("report"), st.binary(max_size=64)),
    st.tuples(st.just("report"), st.binary(max_size=62).map(lambda tail: b"\x01\xbe" + tail)),
    st.tuples(st.just("flip"), st.integers(0, 8 * LONGEST)),
    st.tuples(st.just("cut"), st.integers(0, LONGEST)),
    st.tuples(st.just("in reports"), st.booleans()),
    st.tuples(st.just("skip"), st.integers(1, 5)),
    st.tuples(st.just("touch"), touches),
    st.tuples(st.just("release"), st.none()),
    st.tuples(st.just("hear"), st.booleans()),
    st.tuples(st.just("load"), loads),
)
calls = st.lists(st.one_of(talk, talk, noise), max_size=40)
sessions = st.builds(
    lambda setup, first, calls: [("begin", setup), ("stream", first), ("play", 60), *calls],
    good_setups,
    codes,
    calls,
)
programs = sessions | sessions | calls


class Bench:
    """The cores side by side, and a host that damages what it sends when told to."""

    def __init__(self):
        self.cores: list[Any] = [Core(BOARD, SENSOR), Oracle(BOARD, SENSOR)]
        self.index = 0
        self.load = (panel * np.cos(2 * np.pi * 3 / 16), -panel, 0)
        self.noise = np.random.default_rng(1)
        self.mode = StreamMode.WAVEFORM
        self.flip = self.cut = None
        self.in_reports = False
        self.skip = 0

    def run(self, program):
        for call, operand in program:
            getattr(self, call.replace(" ", "_") + "_")(operand)
            self.agree(lambda core: (core.status(), core.fault(), core.pending_ticks))

    def agree(self, ask):
        answers = [ask(core) for core in self.cores]
        assert all(answer == answers[0] for answer in answers)
        return answers[0]

    def say_(self, message):
        status = self.cores[0].status()
        data = encode(Frame(message, (status.next_sequence + self.skip) % 2**16))
        self.skip = 0
        if isinstance(message, Arm):
            self.index = 0
        if isinstance(message, Setup):
            self.mode = message.mode
        if self.flip is not None:
            bit = self.flip % (8 * len(data))
            data = data[: bit // 8] + bytes([data[bit // 8] ^ 1 << bit % 8]) + data[bit // 8 + 1 :]
        data = data[: self.cut]
        self.flip = self.cut = None
        if self.in_reports:
            for report in to_reports(data):
                self.report_(report)
        else:
            self.bytes_(data)

    def stream_(self, samples):
        before = self.cores[0].status().next_sequence
        self.say_(StreamSamples(self.index, samples, self.mode))
        if self.cores[0].status().next_sequence != before:
            self.index = (self.index + samples.size) % 2**32

    def begin_(self, setup):
        for message in (Hello(), setup, Arm()):
            self.say_(message)

    def bytes_(self, data):
        for core in self.cores:
            core.receive(data)

    def report_(self, report):
        for core in self.cores:
            core.receive_report(report)

    def flip_(self, bit):
        self.flip = bit

    def cut_(self, length):
        self.cut = length

    def in_reports_(self, yes):
        self.in_reports = yes

    def skip_(self, count):
        self.skip = count

    def touch_(self, touch):
        self.agree(lambda core: core.touch(touch))

    def release_(self, _):
        for core in self.cores:
            core.release()

    def hear_(self, in_reports):
        self.agree(lambda core: core.transmit_report() if in_reports else core.transmit())

    def load_(self, load):
        self.load = load

    def play_(self, ticks):
        played = [core.play(ticks) for core in self.cores]
        for out, what in played:
            np.testing.assert_array_equal(out, played[0][0])
            np.testing.assert_array_equal(what, played[0][1])
        out, what = played[0]
        assert np.abs(out.astype(int)).max(initial=0) <= TOP
        assert not out[what == Output.IDLE].any()
        if self.load is not None:
            now, before, most = self.load
            current = (
                now * out + before * np.roll(out, 1) + self.noise.integers(-most, most + 1, ticks)
            )
            raw = np.clip(current, -32_768, 32_767).astype(np.int16)
            for core in self.cores:
                core.sense(out, raw)
        return out


# Both cores run a program in some 10 ms, and drawing it takes as long again.
slow = settings(suppress_health_check=[HealthCheck.too_slow], max_examples=150, deadline=None)


@slow
@given(programs)
def test_whatever_comes_both_cores_agree_and_keep_the_ceiling(program):
    Bench().run(program)


@slow
@given(programs)
def test_whatever_came_silence_ends_at_zero(program):
    bench = Bench()
    bench.run(program)
    bench.play_(1600)  # what was left of a frame is given up: 100 ms
    quiet = bench.play_(WATCHDOG_TICKS + 1)
    is_late_frame = bench.cores[0].status().state is DeviceState.PLAYING
    assert is_late_frame or quiet[-1] == 0


@slow
@given(programs)
def test_whatever_came_the_device_is_in_step_when_the_longest_frame_has_passed(program):
    bench = Bench()
    bench.run(program)
    hello = encode(Frame(Hello(), 5))
    for _ in range(LONGEST // len(hello) + 2):
        bench.bytes_(hello)
    while bench.cores[0].transmit():
        pass
    bench.cores[0].receive(encode(Frame(Ping(1234), 6)))
    (answer,) = FrameParser().feed(bench.cores[0].transmit())
    assert answer.message.token == 1234


@slow
@given(st.binary(max_size=300), arrays(np.int16, 120), st.integers(1, LONGEST - 1), st.booleans())
def test_the_device_loses_two_frames_at_most(garbage, samples, length, is_cut):
    """Garbage or a cut frame, then frames of the same size: the second one arrives by itself."""
    core = Core(BOARD, SENSOR)
    frame = encode(Frame(StreamSamples(0, samples), 1))
    core.receive(frame[:length] if is_cut else garbage)
    for token in (1, 2):
        # A frame as long as the broken one: it is refused (not armed), which answers it.
        core.receive(frame)
        core.receive(encode(Frame(Ping(token), 1)))
    assert core.status().token == 2


@slow
@given(st.binary(max_size=300))
def test_the_host_survives_any_bytes(data):
    parser = FrameParser()
    for item in (*parser.feed(data), *parser.give_up()):
        assert isinstance(item, Frame | ProtocolError)


@slow
@given(st.lists(st.binary(max_size=40), max_size=6), st.integers(0, 8 * 52 - 1))
def test_the_host_is_in_step_after_two_frames(garbage, bit):
    answer = encode(Frame(Ping(3), 9))
    damaged = bytearray(answer)
    damaged[bit % (8 * len(answer)) // 8] ^= 1 << bit % 8
    parser = FrameParser()
    for piece in garbage:
        parser.feed(piece)
    found = parser.feed(bytes(damaged)) + parser.feed(answer) + parser.feed(answer)
    assert [item for item in found if isinstance(item, Frame)][-2:] == [Frame(Ping(3), 9)] * 2
