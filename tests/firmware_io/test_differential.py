"""The firmware in C against its reference in sessions at the limits: not a sample may differ.

``python -m tests.firmware_io.test_differential 0 10000`` plays as many as asked for.
"""

import collections
import sys
from dataclasses import replace

import numpy as np
import pytest

from firmware_io.firmware.build import find_compiler
from firmware_io.firmware.opening import open_core
from firmware_io.protocol import (
    Arm,
    Frame,
    Hello,
    Rate,
    Revise,
    Stop,
    StreamMode,
    StreamSamples,
    encode,
)
from tests.firmware_io.test_output_window import BOARD, BOTH, SETUP

TOP = 26213
ENVELOPE, WAVEFORM = StreamMode.ENVELOPE, StreamMode.WAVEFORM


class Pair:
    """Both cores, and a random host that sends them the same."""

    def __init__(self, seed):
        self.rng = rng = np.random.default_rng(seed)
        self.rate_hz = int(rng.choice([1000, 2000, 4000, 8000]))
        self.rates_hz = [self.rate_hz, self.rate_hz // 2, self.rate_hz // 4]
        board = replace(
            BOARD,
            output_rate_hz=self.rate_hz,
            max_frame_samples=300,
            queue_samples=int(rng.choice([300, 2000])),
            rates=tuple(Rate(rate, BOTH) for rate in self.rates_hz),
        )
        self.board = board
        self.cores = [open_core(board, which) for which in ("c", "python")]
        self.sequence = self.index = 0
        self.setup = None
        self.revised = False
        self.is_steady = rng.random() < 0.3  # a square wave without pauses, for the energy

    def receive(self, data):
        for core in self.cores:
            core.receive(data)

    def say(self, message):
        data = encode(Frame(message, self.sequence % 2**16))
        self.sequence += 1
        cut = self.rng.integers(1, len(data)) if self.rng.random() < 0.05 else len(data)
        self.receive(data[:cut])
        self.receive(data[cut:])

    def begin(self):
        rng = self.rng
        is_envelope = rng.random() < 0.35 and self.rate_hz >= 2000
        self.setup = replace(
            SETUP,
            mode=ENVELOPE if is_envelope else WAVEFORM,
            watchdog_ms=int(rng.integers(10, 251)),
            sample_rate_hz=int(rng.choice(self.rates_hz)),
            carrier_mhz=int(rng.integers(10**6, self.rate_hz * 500 + 1)) if is_envelope else 0,
            lead_us=int(rng.integers(0, 9000)),
        )
        if rng.random() < 0.3:
            for core in self.cores:
                core.release()
        self.index = 0
        for message in (Hello(), self.setup, Arm()):
            self.say(message)

    def stream(self):
        rng = self.rng
        n = 300 if self.is_steady else int(rng.integers(1, 300))
        turns = rng.uniform(0.3, self.rate_hz / 2) * np.arange(n) / self.setup.sample_rate_hz
        tone = np.sin(2 * np.pi * turns + rng.choice([0.0, rng.uniform(0, 6)]))
        if self.is_steady:
            codes = TOP * (2 * (np.arange(n) // 5 % 2) - 1)
        else:
            codes = rng.choice([20, TOP, TOP]) * tone + rng.choice([0, 0, 0, 2000, TOP, -TOP])
        codes = np.clip(codes, -TOP, TOP).astype(np.int16)
        codes = np.abs(codes) if self.setup.mode is ENVELOPE else codes
        status = self.cores[0].status()
        if not self.is_steady and rng.random() < 0.4:
            # Somewhere in the queue, at times too late, too far, or out of turn.
            first = status.samples_played + int(rng.integers(-3, max(4, status.queued_samples)))
            codes = codes[: max(1, self.index - first + int(rng.integers(-20, 2)))]
            revision = (status.revisions + int(rng.random() < 0.1)) % 2**16
            self.say(Revise(first % 2**32, codes, self.setup.mode, revision))
            return
        self.say(StreamSamples(self.index, codes, self.setup.mode))
        self.index += n

    def step(self):
        chance = self.rng.random()
        is_faulty = self.cores[0].fault() is not None and chance < 0.7
        if self.setup is None or is_faulty or (chance < 0.06 and not self.is_steady):
            self.begin()
        elif chance < 0.09 and not self.is_steady:
            self.say(Stop())
        elif chance < 0.11 and not self.is_steady:
            self.receive(self.rng.bytes(int(self.rng.integers(1, 30))))
        else:
            self.stream()
        ticks = int(self.rng.choice([1, 7, 40, 300, 600, 1200, 0])) * self.rate_hz // 4000
        if self.is_steady:
            ticks = 300 * self.rate_hz // self.setup.sample_rate_hz
        played, expected = (core.play(ticks) for core in self.cores)
        assert np.array_equal(played, expected)
        assert self.cores[0].transmit() == self.cores[1].transmit()
        fault = self.cores[0].fault()
        if self.cores[0].status().revisions:
            self.revised = True
        return "none" if fault is None else fault.code.name


def session(seed):
    """Play one session; return the faults that it has met."""
    pair = Pair(seed)
    met = {pair.step() for _ in range(int(pair.rng.integers(5, 60)))}
    return met | ({"revised"} if pair.revised else set())


@pytest.mark.skipif(find_compiler() is None, reason="no C compiler")
@pytest.mark.parametrize("seeds", [range(40), pytest.param(range(40, 700), marks=pytest.mark.slow)])
def test_both_cores_agree_at_the_limits(seeds):
    faults = set().union(*map(session, seeds))
    assert {
        "ENERGY",
        "MEAN",
        "STARVED",
        "DAMAGED",
        "SLEW",
        "QUEUE_FULL",
        "SAMPLE_INDEX",
        "revised",
        "none",
    } <= faults


if __name__ == "__main__":
    first, last = map(int, sys.argv[1:])
    counts = collections.Counter(fault for seed in range(first, last) for fault in session(seed))
    sys.stdout.write(f"{last - first} sessions, no difference; with {dict(counts)}\n")
