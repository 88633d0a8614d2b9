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

from firmware_io import DriveLimits, LimitError, MockConverter
from firmware_io.drive_check import DriveWindow
from firmware_io.firmware.core import Core, Sensor
from firmware_io.limits import DEFAULT_MAX_RMS_V
from firmware_io.links.mock import Failure
from firmware_io.protocol import (
    Arm,
    FaultCode,
    Frame,
    FrameParser,
    Hello,
    Rate,
    Revise,
    SenseReport,
    SensorProblem,
    Stop,
    StreamSamples,
    TouchPhase,
    TouchReport,
    encode,
)
from tests.firmware_io.core_rig import BOTH, ENVELOPE, WAVEFORM
from tests.firmware_io.oracle.device import Oracle
from tests.firmware_io.test_output_window import BOARD, SETUP, Attacker

TOP = 26213


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


class SensingPair(Pair):
    """Both cores with a converter that at times fails, lies, or measures too much."""

    def __init__(self, seed):
        rng = np.random.default_rng(seed)
        self.rng = rng
        self.rate_hz = int(rng.choice([8000, 16_000, 48_000]))
        self.rates_hz = [self.rate_hz, self.rate_hz // 4]
        self.board = replace(
            BOARD,
            output_rate_hz=self.rate_hz,
            max_frame_samples=1200,
            queue_samples=2400,
            rates=tuple(Rate(rate, BOTH) for rate in self.rates_hz),
            reports_touch=bool(rng.random() < 0.9),
            sense_rate_hz=int(rng.choice([250, 500, 1000, 2000, 4000])),
        )
        farads = float(rng.choice([2e-9, 2e-9, rng.uniform(1e-10, 5e-9)]))
        sensor = Sensor(float(rng.choice([0.02, 0.02, 0.05, 1.3e-4])), farads)
        self.converter = MockConverter(
            farads, full_scale_a=sensor.full_scale_a, noise_a=2e-5, seed=seed, late_samples=2
        )
        self.farads = farads * rng.choice([1.0, 1.02, rng.uniform(0.5, 1.6)])
        self.cores = [Core(self.board, sensor), Oracle(self.board, sensor)]
        self.fails = rng.random() < 0.3  # the converter, rather than the load
        self.parser = FrameParser()
        self.problems = set()
        self.sequence = self.index = self.code = 0
        self.setup = None

    def begin(self):
        rng = self.rng
        # From a quarter of the output rate on sensing is off, as with a waveform.
        carriers = [min(4000, self.rate_hz // 5), rng.uniform(1000, self.rate_hz / 4)]
        carrier_mhz = int(1000 * rng.choice([*carriers, self.rate_hz / 4], p=[0.6, 0.35, 0.05]))
        is_carried = rng.random() < 0.9
        self.setup = replace(
            SETUP,
            mode=ENVELOPE if is_carried else WAVEFORM,
            watchdog_ms=160,
            sample_rate_hz=int(rng.choice(self.rates_hz)),
            carrier_mhz=carrier_mhz if is_carried else 0,
            lead_us=int(rng.integers(0, 2000)),
        )
        self.converter.carrier_hz = carrier_mhz / 1000
        slew = SETUP.max_slew_v_per_s * 32_767 // 250
        carried = slew // (carrier_mhz * 411_775 // 65_536_000) * 9 // 10
        self.most = min(TOP * 9 // 10, carried) if is_carried else 3000
        self.converter.failure, self.converter.farads, self.square_a = None, self.farads, 0.0
        if rng.random() < 0.2:
            for core in self.cores:
                core.release()
        self.index = self.code = 0
        for message in (Hello(), self.setup, Arm()):
            self.say(message)

    def send(self, codes):
        codes = codes[: self.cores[0].status().free_samples].astype(np.int16)
        if codes.size:
            self.say(StreamSamples(self.index, codes, self.setup.mode))
            self.index += codes.size
            self.code = int(codes[-1])

    def stream_ms(self, ms):
        """Play for some time, mostly as it was, at times at another amplitude."""
        rng, n = self.rng, max(1, ms * self.setup.sample_rate_hz // 1000)
        codes = np.full(n, self.code)
        if self.code == 0 or rng.random() < 0.2:
            end = int(rng.choice([0, 5, self.most // 8, self.most, self.most, self.most]))
            codes = np.round(np.linspace(self.code, end, n))
        for part in np.split(codes, range(300, n, 300)):
            self.send(part)
            left = part.size * self.rate_hz // self.setup.sample_rate_hz
            while left > 0:
                # Longer than 5 ms are late.
                ms = 7 if self.fails and rng.random() < 0.01 else int(rng.integers(0, 5))
                ticks = min(ms * self.rate_hz // 1000 + int(rng.integers(0, 2)), left)
                self.play(ticks)
                left -= ticks

    def change(self):
        """Change what is measured, for a part of the time."""
        rng, converter = self.rng, self.converter
        converter.failure, converter.farads, self.square_a = None, self.farads, 0.0
        chance = rng.random()
        if self.fails and chance < 0.5:
            kinds: list[Failure] = ["dead", "stuck", "inverted", "late", "silent"]
            converter.failure = kinds[int(rng.integers(5))]
        elif chance < 0.1:
            converter.failure = "noise" if rng.random() < 0.5 else "saturated"
        elif chance < 0.2:
            self.square_a = rng.uniform(0.4, 0.75) * 1e-3  # all of it is rms
        elif chance < 0.6:
            volts = self.most * 250 / 32_767
            limit = 0.7e-3 / (2 * np.pi * self.converter.carrier_hz * volts)
            more = rng.choice([4e-11, 1e-9, 1e-8, *limit * rng.uniform(0.6, 1.4, 4)])
            converter.farads = self.farads + more * np.exp(-1j * rng.uniform(0, 2))
        if rng.random() < 0.2:
            phase = TouchPhase(int(rng.integers(0, 3)))
            contact = int(rng.integers(0, 3))
            told = [core.touch(TouchReport(0, 1, 2, 3, contact, phase)) for core in self.cores]
            assert told[0] == told[1]

    def step(self):
        rng = self.rng
        if self.setup is None or (self.cores[0].fault() is not None and rng.random() < 0.9):
            self.begin()
            self.stream_ms(int(rng.choice([20, 120, 150])))
        elif rng.random() < 0.05:
            self.say(Stop())
        self.change()
        self.stream_ms(int(rng.choice([1, 5, 20])))
        fault = self.cores[0].fault()
        return "none" if fault is None else fault.code.name

    def play(self, ticks):
        (sent, kinds), (expected, expected_kinds) = (core.play(ticks) for core in self.cores)
        assert np.array_equal(sent, expected) and np.array_equal(kinds, expected_kinds)
        raw = self.converter.measure(sent, self.board) if ticks else None
        if raw is not None and self.rng.random() > 0.01:  # some are lost
            square = round(self.square_a / self.converter.full_scale_a * 32_767)
            raw = np.clip(raw + np.where(sent < 0, -square, square), -32_768, 32_767)
            for core in self.cores:
                core.sense(sent, raw.astype(np.int16))
        assert self.cores[0].pending_ticks == self.cores[1].pending_ticks
        if self.rng.random() < 0.3:
            told, expected = (b"".join(iter(core.transmit, b"")) for core in self.cores)
            assert told == expected
            for frame in self.parser.feed(told):
                if isinstance(frame.message, SenseReport):
                    self.problems |= {one.problem for one in frame.message.readings}


def sensing_session(seed):
    """Play one session with a converter; return the faults and problems that it has met."""
    pair = SensingPair(seed)
    met = {pair.step() for _ in range(int(pair.rng.integers(5, 30)))}
    return met | {problem.name for problem in pair.problems}


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


@pytest.mark.parametrize(
    "seeds",
    [
        (0, 1, 2, 11, 13, 17),  # the fewest of the first 20 that meet all
        pytest.param(range(20, 140), marks=pytest.mark.slow),
    ],
)
def test_both_cores_measure_alike(seeds):
    met = set().union(*map(sensing_session, seeds))
    faults = {"PEAK_CURRENT", "RMS_CURRENT", "NO_CURRENT", "OVERLOAD", "none"}
    assert {*faults, *SensorProblem.__members__} - {"NONE"} <= met


if __name__ == "__main__":
    first, last = map(int, sys.argv[1:3])
    play = sensing_session if "sensing" in sys.argv else session
    counts = collections.Counter(fault for seed in range(first, last) for fault in play(seed))
    sys.stdout.write(f"{last - first} sessions, no difference; with {dict(counts)}\n")
