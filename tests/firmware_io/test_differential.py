"""The firmware in C against its reference in sessions at the limits: not a sample may differ.

``python -m tests.firmware_io.test_differential 0 10000`` plays as many as asked for.
"""

import collections
import re
import sys
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from firmware_io import DriveLimits, LimitError
from firmware_io.drive_check import DriveWindow
from firmware_io.firmware.core import Core
from firmware_io.limits import DEFAULT_MAX_RMS_V
from firmware_io.protocol import (
    Arm,
    FaultCode,
    Frame,
    Hello,
    Rate,
    Revise,
    Stop,
    StreamMode,
    StreamSamples,
    encode,
)
from tests.firmware_io.oracle.device import Oracle
from tests.firmware_io.test_output_window import BOARD, BOTH, SETUP, Attacker

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
        self.cores: list[Any] = [Core(board), Oracle(board)]
        self.sequence = self.index = 0
        self.setup = None
        self.last = 0
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
        self.is_tight = not self.is_steady and rng.random() < 0.6
        if self.is_tight:
            slew = int(rng.choice([45_000, rng.integers(45_000, 10**6)]))
            self.setup = replace(self.setup, max_slew_v_per_s=slew)
        if rng.random() < 0.3:
            for core in self.cores:
                core.release()
        self.index = self.last = 0
        for message in (Hello(), self.setup, Arm()):
            self.say(message)

    def stream(self):
        rng = self.rng
        n = 300 if self.is_steady else int(rng.integers(1, 300))
        turns = rng.uniform(0.3, self.rate_hz / 2) * np.arange(n) / self.setup.sample_rate_hz
        tone = np.sin(2 * np.pi * turns + rng.choice([0.0, rng.uniform(0, 6)]))
        if self.is_steady:
            codes = TOP * (2 * (np.arange(n) // 5 % 2) - 1)
        elif self.is_tight and rng.random() < 0.97:
            codes = self.steepest(n)
        else:
            codes = rng.choice([20, TOP, TOP]) * tone + rng.choice([0, 0, 0, 2000, TOP, -TOP])
        codes = np.clip(codes, -TOP, TOP).astype(np.int16)
        codes = np.abs(codes) if self.setup.mode is ENVELOPE else codes
        status = self.cores[0].status()
        if not self.is_steady and rng.random() < (0.05 if self.is_tight else 0.4):
            # Somewhere in the queue, at times too late, too far, or out of turn.
            first = status.samples_played + int(rng.integers(-3, max(4, status.queued_samples)))
            codes = codes[: max(1, self.index - first + int(rng.integers(-20, 2)))]
            revision = (status.revisions + int(rng.random() < 0.1)) % 2**16
            self.say(Revise(first % 2**32, codes, self.setup.mode, revision))
            return
        self.say(StreamSamples(self.index, codes, self.setup.mode))
        self.index += n
        self.last = int(codes[-1])

    def steepest(self, n):
        """Codes at the slew that was stated, or beside it, up and down at random."""
        setup, codes, at = self.setup, [], self.last
        each = self.rate_hz // setup.sample_rate_hz
        codes_per_s = setup.max_slew_v_per_s * 32_767_000 // 250_000 // self.rate_hz * self.rate_hz
        carrier_rad_per_s = -(-setup.carrier_mhz * 411_775 // 65_536_000)
        highest = min(TOP, codes_per_s // carrier_rad_per_s) if carrier_rad_per_s else TOP
        way = int(self.rng.choice([-1, 1]))
        for turns in self.rng.random(n) < 0.05:
            most = codes_per_s // self.rate_hz * each
            if carrier_rad_per_s:
                rise = (codes_per_s - carrier_rad_per_s * at) // (carrier_rad_per_s + self.rate_hz)
                most = min(most, max(rise, 0) * each)
            if turns or not -highest <= at + way * most <= highest:
                way = -way
            at = max(-highest, min(highest, at + way * most))
            codes.append(at)
        return np.array(codes)

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


def first_refused(volts, rate_hz):
    """Samples of a waveform that the host's window passes, and that the device plays."""
    seen, passed = DriveWindow(DriveLimits(), rate_hz), 0
    for block in np.split(volts, range(100, volts.size, 100)):
        try:
            seen.check(block)
        except LimitError as error:
            if "mA" not in str(error):
                passed += int(re.search(r"sample (\d+)", str(error)).group(1))
                break
        seen.take(block)
        passed += block.size
    host = Attacker(replace(BOARD, output_rate_hz=rate_hz, rates=(Rate(rate_hz, BOTH),)))
    host.arm(replace(SETUP, sample_rate_hz=rate_hz))
    for block in np.split(volts, range(100, volts.size, 100)):
        host.write(block)
        host.play(block.size / rate_hz)
    found = host.fault
    assert found in (FaultCode.NONE, FaultCode.ENERGY, FaultCode.MEAN)
    return passed, volts.size if found is FaultCode.NONE else host.first_refused()


@pytest.mark.parametrize("seed", range(20))
def test_the_window_of_the_host_passes_what_that_of_the_device_plays(seed):
    """Two programs that share no function, in volts and in codes, one after the other.

    The device plays whatever the host passes, and of what the host refuses no more than its blocks
    allow: 0.8 % above the limit in rms, which are 1.6 % of the energy.
    """
    rng = np.random.default_rng(seed)
    rate_hz = int(rng.choice([2000, 4000, 8000]))
    t = np.arange(3 * rate_hz) / rate_hz
    if seed % 2:
        volts = 200.0 * np.sign(np.sin(2 * np.pi * rng.uniform(30, 400) * t + 0.1))
    else:
        offset = rng.uniform(0.06, 0.3)
        volts = 150.0 * np.sin(2 * np.pi * rng.uniform(30, 400) * t) + offset * 150.0
    volts *= np.where(rng.random(30) < 0.8, 1.0, 0.3).repeat(rate_hz // 10)
    passed, played = first_refused(volts, rate_hz)
    assert passed <= played
    assert passed < volts.size
    if seed % 2:
        squares = np.cumsum(np.r_[np.zeros(rate_hz), volts[:played]] ** 2)
        most = (squares[rate_hz:] - squares[:-rate_hz]).max() / rate_hz
        assert most < 1.016 * DEFAULT_MAX_RMS_V**2


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
