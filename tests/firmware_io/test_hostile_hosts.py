"""Hosts that look for a way round the limits, found by hypothesis: none breaks one."""

from dataclasses import replace

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_io.firmware.core import Output
from firmware_io.protocol import (
    Arm,
    FaultCode,
    Frame,
    Hello,
    Rate,
    Revise,
    Setup,
    Stop,
    StreamSamples,
    encode,
)
from tests.firmware_io.core_rig import BOTH, ENVELOPE, WAVEFORM
from tests.firmware_io.test_output_window import BOARD, Attacker

RATE_HZ = 8000
RAMP = 40
HOSTILE = replace(
    BOARD, rates=(Rate(8000, BOTH), Rate(2000, BOTH)), queue_samples=2000, max_frame_samples=1000
)


class Host(Attacker):
    """A host that follows a list of tricks, and the limits that hold for what leaves meanwhile."""

    def __init__(self):
        super().__init__(HOSTILE)
        self.most_step, self.ceiling = [], []
        self.step = self.top = self.last = 0
        self.setup = None

    def begin(self, capacitance_nf, ceiling_v, is_envelope, each):
        slew = min(int(0.7e6 / capacitance_nf), 4_666_666)
        ceiling_mv = round(min(ceiling_v, slew * 0.0049) * 1e3)
        self.arm(
            Setup(
                *(ENVELOPE if is_envelope else WAVEFORM, 100, RATE_HZ // each, 250_000),
                *(ceiling_mv, slew, 1_234_567 if is_envelope else 0, 2000),
            )
        )
        assert self.fault is FaultCode.NONE
        self.last = 0
        self.step = slew * 32_767_000 // 250_000 // RATE_HZ
        self.top = ceiling_mv * 32_767 // 250_000

    def steepest(self, n, turns):
        """Samples at the slew and the ceiling, whichever comes first."""
        each = RATE_HZ // self.setup.sample_rate_hz
        most, top, low = self.step * each, self.top, -self.top
        if self.setup.mode is ENVELOPE:
            carrier = -(-self.setup.carrier_mhz * 411_775 // 65_536_000)
            top, low = min(top, self.step * RATE_HZ // (carrier + self.setup.sample_rate_hz)), 0
            most = max(0, self.step * RATE_HZ - carrier * top) // self.setup.sample_rate_hz
        way, codes = 1, []
        for k in range(n):
            if k % turns == turns - 1:
                way = -way
            self.last = max(low, min(top, self.last + way * most))
            codes.append(self.last)
        return codes

    def play(self, seconds):
        # What a set-up states holds from the stream after it on: a ramp may still be that of the
        # one before, so that the looser of the two holds until the output has come to rest.
        if round(seconds * RATE_HZ) == 0:
            return
        super().play(seconds)
        played, what = self.played[-1], self.what[-1]
        step, top = self.steps_in_force(what)
        self.most_step.append(step)
        self.ceiling.append(top)
        assert played.size == step.size

    def steps_in_force(self, what):
        before = (self.most_step[-1][-1], self.ceiling[-1][-1]) if self.most_step else (0, 0)
        rested = np.cumsum((what & 0x7F) == Output.IDLE) > 0
        loosest = max(before[0], self.step), max(before[1], self.top)
        return (np.where(rested, self.step, loosest[0]), np.where(rested, self.top, loosest[1]))

    def judge(self):
        codes = np.concatenate(self.played).astype(np.int64)
        assert (np.abs(np.diff(codes, prepend=0)) <= np.concatenate(self.most_step)).all()
        assert (np.abs(codes) <= np.concatenate(self.ceiling)).all()
        self.check()


seconds = st.sampled_from(
    [0.0, 1 / RATE_HZ, 0.003, 0.0049, 0.005, 0.0051, 0.009, 0.0101, 0.05, 0.2]
)
tricks = st.one_of(
    st.tuples(st.just("steep"), st.integers(1, 300), st.integers(2, 200), seconds),
    st.tuples(st.just("trickle"), st.integers(1, 60), st.integers(1, 100), st.just(0.0)),
    st.tuples(st.just("revise"), st.integers(0, 200), st.integers(1, 100), seconds),
    st.tuples(st.just("stop"), st.booleans(), st.booleans(), seconds),
    st.tuples(
        st.just("begin"),
        st.sampled_from([0.15, 0.5, 1.0, 5.0, 15.0]),
        st.sampled_from([200.0, 120.0, 10.0]),
        st.tuples(st.booleans(), st.sampled_from([1, 4])),
    ),
)


@settings(max_examples=150, deadline=None)
@given(st.lists(tricks, min_size=3, max_size=25))
def test_no_list_of_tricks_breaks_a_limit(script):
    host = Host()
    host.begin(15.0, 200.0, False, 1)
    host.play(0.001)
    for trick, one, two, three in script:
        if trick == "begin":
            host.begin(one, two, *three)
        elif host.fault is not FaultCode.NONE or not host.core.status().state:
            host.begin(5.0, 200.0, False, 1)
        if trick == "stop":
            host.say(Stop()) if one else host.core.release()
            host.play(three)
            if two:
                host.begin(1.0, 200.0, False, 1)
        elif trick == "steep":
            host.write_codes(host.steepest(one, two))
            host.play(three)
        elif trick == "trickle":
            # One sample at a time, each when the last has just run out, or a little later.
            for _ in range(one):
                host.write_codes(host.steepest(1, 10**6))
                host.play(two / RATE_HZ)
        elif trick == "revise":
            status = host.core.status()
            first = (status.samples_played + one) % 2**32
            codes = np.array(host.steepest(two, 7), np.int16)
            host.say(Revise(first, codes, host.setup.mode, status.revisions))
            host.play(three)
        host.play(0.002)
    # Silence: at the latest behind the watchdog the output is at 0 V, and stays there.
    host.play(0.1)
    host.play(0.3)
    assert not host.played[-1].any()
    host.judge()


@settings(max_examples=30, deadline=None)
@given(
    st.lists(st.integers(1, 12), min_size=1, max_size=40), st.integers(1, 200), st.integers(1, 5)
)
def test_reopening_at_any_sample_begins_no_second_anew(lengths, pause, count):
    """The strongest that passes, and a new session whenever the driver ends one."""
    host = Attacker(HOSTILE)
    for turn in range(40):
        length = 30 * lengths[turn % len(lengths)]
        host.arm(replace(Setup(WAVEFORM, 160, RATE_HZ, 250_000, 200_000, 4_666_666), lead_us=0))
        sign = -1 if turn % count else 1
        host.write_codes(np.full(length, sign * 26_213))
        host.play(length / RATE_HZ)
        host.core.release() if turn % 2 else host.say(Hello(), Stop())
        host.play(pause / RATE_HZ)
    host.check()


def test_the_index_of_samples_wraps_without_a_seam():
    """Frames are checked across the wrap of 32 bits; see `make weeks` for the whole way there."""
    host = Attacker(HOSTILE)
    host.arm(replace(Setup(WAVEFORM, 160, RATE_HZ, 250_000, 200_000, 4_666_666), lead_us=0))
    host.say(StreamSamples(2**32 - 1, np.zeros(1, np.int16), WAVEFORM))
    assert host.fault is FaultCode.SAMPLE_INDEX
    assert host.core.fault().expected == 0


def test_arming_again_and_again_is_no_way_to_stay_alive():
    """ARM while armed, SETUP, HELLO, PING: none feeds the watchdog, all end in the ramp."""
    for message in (Arm(), Setup(WAVEFORM, 160, RATE_HZ, 250_000, 200_000, 4_666_666)):
        host = Attacker(HOSTILE)
        host.arm(Setup(WAVEFORM, 160, RATE_HZ, 250_000, 200_000, 4_666_666, lead_us=0))
        host.write_codes(np.full(100, 20_000))
        host.play(50 / RATE_HZ)
        host.core.receive(encode(Frame(message, host.sequence)))
        host.play(RAMP / RATE_HZ)
        assert host.played[-1].tolist() == [500 * (RAMP - k) for k in range(1, RAMP + 1)]
        assert host.fault is FaultCode.ALREADY_ARMED
