"""Energy and mean of what leaves the driver, whatever the host does: both cores, device time."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from firmware_io.firmware.core import Core, Output
from firmware_io.protocol import (
    Arm,
    FaultCode,
    Frame,
    Hello,
    Rate,
    Setup,
    Stop,
    StreamSamples,
    encode,
)
from tests.firmware_io import core_rig
from tests.firmware_io.core_rig import BOTH, ENVELOPE, WAVEFORM

RATE_HZ = 8000
TOP_V = 200.0
#: The limits over a second and 1 %: 1.01 times the rms of a sine at 200 V, 5 % of 200 V.
MOST_RMS_V = 1.01 * 1.01 * TOP_V / np.sqrt(2)
MOST_MEAN_V = 1.01 * 0.05 * TOP_V
BOARD = replace(
    core_rig.BOARD,
    report_bytes=0,
    output_rate_hz=RATE_HZ,
    full_scale_mv=250_000,
    ceiling_mv=200_000,
    max_slew_v_per_s=4_666_666,
    queue_samples=20_000,
    max_frame_samples=10_000,
    reports_touch=False,
    rates=(Rate(RATE_HZ, BOTH),),
)
SETUP = Setup(WAVEFORM, 160, RATE_HZ, 250_000, 200_000, 4_666_666, lead_us=0)


class Attacker:
    """A host that sends what it likes, and all that the driver has played."""

    def __init__(self, board=BOARD):
        self.core = Core(board)
        self.rate_hz = board.output_rate_hz
        self.sequence = self.index = 0
        self.played = []
        self.what = []

    def say(self, *messages):
        for message in messages:
            self.core.receive(encode(Frame(message, self.sequence % 2**16)))
            self.sequence += 1

    def arm(self, setup=SETUP):
        self.setup = setup
        self.say(Hello(), setup, Arm())
        self.index = 0

    def write(self, volts):
        self.write_codes(np.trunc(np.asarray(volts) / 250 * 32767))

    def write_codes(self, codes):
        samples = np.array(codes, np.int16)
        self.say(StreamSamples(self.index, samples, self.setup.mode))
        self.index += samples.size

    def play(self, seconds):
        codes, what = self.core.play(round(seconds * self.rate_hz))
        self.played.append(codes)
        self.what.append(what)

    def first_refused(self):
        """Index of the first output sample whose place the safety ramp has taken."""
        return int(np.argmax(np.concatenate(self.what) == Output.RAMP))

    @property
    def fault(self):
        fault = self.core.fault()
        return FaultCode.NONE if fault is None else fault.code

    @property
    def volts(self):
        return np.concatenate([np.zeros(self.rate_hz), *self.played]) / 32767 * 250

    def check(self):
        """No second of the output, wherever it begins, is above a limit."""
        size = self.rate_hz
        sums = np.cumsum(np.concatenate([[0.0], self.volts, np.zeros(size)]))
        squares = np.cumsum(np.concatenate([[0.0], self.volts**2, np.zeros(size)]))
        mean = np.abs(sums[size:] - sums[:-size]).max() / size
        rms = np.sqrt((squares[size:] - squares[:-size]).max() / size)
        assert mean <= MOST_MEAN_V
        assert rms <= MOST_RMS_V
        return mean, rms


@pytest.fixture
def host():
    return Attacker()


def test_a_constant_voltage_ends_at_the_mean(host):
    host.arm()
    for _ in range(20):
        host.write(np.full(800, 190.0))
        host.play(0.1)
    assert host.fault is FaultCode.MEAN
    assert host.core.fault().expected == 10_000
    mean, _ = host.check()
    assert mean > 0.97 * 10.0
    assert not host.played[-1].any()


def test_a_square_wave_ends_at_the_energy(host):
    host.arm()
    for _ in range(20):
        host.write(np.resize([200.0, -200.0], 800))
        host.play(0.1)
    assert host.fault is FaultCode.ENERGY
    assert host.core.fault().expected == 142_835
    _, rms = host.check()
    assert rms > 0.99 * 142.8


def test_a_crest_held_by_sleeping(host):
    host.arm()
    for _ in range(100):
        if host.fault is not FaultCode.NONE:
            host.arm()
        host.write([200.0])
        host.play(0.12)
    host.check()


@pytest.mark.parametrize("pause_s", [0.001, 0.004, 0.008, 0.02])
@pytest.mark.parametrize("frequency_hz", [30.0, 111.0, 240.0])
def test_an_honest_sine_in_blocks_with_pauses(host, pause_s, frequency_hz):
    host.arm()
    at = 0
    for _ in range(80):
        if host.fault is not FaultCode.NONE:
            host.arm()
            at = 0
        host.write(200 * np.sin(2 * np.pi * frequency_hz * np.arange(at, at + 90) / RATE_HZ))
        at += 90
        host.play(90 / RATE_HZ + pause_s)
    host.check()


def test_ending_and_beginning_sessions_begins_no_second_anew(host):
    for _ in range(73):
        host.arm()
        host.write(np.full(350, 200.0))
        host.play(350 / RATE_HZ)
        host.core.release()
        host.play(0.01)
    host.check()


def test_an_offset_that_leaves_the_window_uncovers_no_other(host):
    """-10 V s and then +20 V s: the sum is +10 V s, but only for as long as both are in it."""
    host.arm()
    for volts in (-18.0, 36.0):
        for _ in range(5):
            host.write(np.full(800, volts))
            host.play(0.1)
    host.play(1.0)
    host.check()


@pytest.mark.parametrize("carrier_hz", [1000.0, 1333.0, 2000.0, 3999.0])
@pytest.mark.parametrize("share", [0.25, 0.5])
def test_an_envelope_gated_in_step_with_its_carrier(host, carrier_hz, share):
    host.arm(replace(SETUP, mode=ENVELOPE, carrier_mhz=round(carrier_hz * 1e3)))
    for n in range(30):
        if host.fault is not FaultCode.NONE:
            host.arm(host.setup)
        turns = carrier_hz * np.arange(n * 800, (n + 1) * 800) / RATE_HZ % 1
        host.write(np.where(turns < share, 200.0, 0.0))
        host.play(0.1)
    host.check()


def test_the_mean_leaves_room_for_the_half_turn_with_which_a_carrier_ends(host):
    host.arm(replace(SETUP, mode=ENVELOPE, carrier_mhz=1_000_000))
    levels = np.where(np.arange(1600) % 8 < 4, 200.0, 0.0)  # of each turn its positive half
    for begin in (0, 800):
        host.write(levels[begin : begin + 800])
        host.play(0.1)
    assert host.fault is FaultCode.MEAN
    played = np.concatenate(host.played)[: host.first_refused()].astype(int)
    sums = np.cumsum(played)
    ends = sums + 4 * np.trunc(levels[: played.size] / 250 * 32767)  # at its highest throughout
    assert ends.max() <= int(TOP_V / 250 * 32767) * RATE_HZ / 20


@pytest.mark.parametrize("frequency_hz", [6.4, 7.0, 33.0, 250.0, 1000.0])
def test_a_tone_at_the_ceiling_passes_for_ever(host, frequency_hz):
    host.arm()
    for n in range(40):
        t = np.arange(n * 800, (n + 1) * 800) / RATE_HZ
        host.write(200 * np.sin(2 * np.pi * frequency_hz * t))
        host.play(0.1)
        assert host.fault is FaultCode.NONE
    host.check()


def test_a_carrier_at_the_ceiling_passes_for_ever_and_is_held(host):
    host.arm(replace(SETUP, mode=ENVELOPE, carrier_mhz=1_000_000))
    for _ in range(30):
        host.write(np.full(400, 200.0))
        host.play(0.1)
    assert host.fault is FaultCode.NONE
    host.check()
    assert Output.HELD in host.what[-1]


@pytest.mark.parametrize("seed", range(12))
def test_whatever_a_host_does(host, seed):
    """Random tones, offsets, pauses, stops and reconnections, most of them at the ceiling."""
    rng = np.random.default_rng(seed)
    for _ in range(120):
        if host.fault is not FaultCode.NONE or rng.random() < 0.02:
            mode = WAVEFORM if rng.random() < 0.7 else ENVELOPE
            carrier_mhz = int(rng.integers(1_000_000, 4_000_000)) if mode is ENVELOPE else 0
            if rng.random() < 0.3:
                host.core.release()
            host.arm(replace(SETUP, mode=mode, carrier_mhz=carrier_mhz))
            continue
        if not host.index and not hasattr(host, "setup"):
            host.arm()
        n = int(rng.integers(1, 1200))
        tone = np.sin(2 * np.pi * 10 ** rng.uniform(0, 3.6) * np.arange(n) / RATE_HZ)
        volts = np.clip(rng.choice([1, 50, 200]) * tone + rng.choice([0, 5, 100]), -200, 200)
        host.write(np.abs(volts) if host.setup.mode is ENVELOPE else volts)
        if rng.random() < 0.05:
            host.say(Stop())
        host.play(rng.choice([n / RATE_HZ, 0.5 * n / RATE_HZ, n / RATE_HZ + 0.03, 0.2]))
    host.check()


@pytest.mark.parametrize("rate_hz", [1000, 44_100, 96_000])
@pytest.mark.parametrize("full_scale_mv", [100_000, 250_000, 1_000_000])
def test_at_other_rates_and_scales(rate_hz, full_scale_mv):
    board = replace(
        BOARD,
        output_rate_hz=rate_hz,
        full_scale_mv=full_scale_mv,
        ceiling_mv=min(full_scale_mv, 200_000),
        rates=(Rate(rate_hz, BOTH),),
    )
    setup = replace(
        SETUP, sample_rate_hz=rate_hz, full_scale_mv=full_scale_mv, ceiling_mv=board.ceiling_mv
    )
    for square in (False, True):
        other = Attacker(board)
        other.arm(setup)
        highest = min(full_scale_mv / 1e3, 200.0)
        rise = np.arange(1, (edge := int(highest * rate_hz / 4.6e6) + 1) + 1) / edge
        half = np.r_[rise, np.ones(16 * edge), rise[-2::-1], 0]
        wave = np.r_[half, -half] if square else np.ones(2 * half.size)
        wave = np.tile(wave, max(1, rate_hz // 20 // wave.size))
        other.write(np.r_[rise * (not square)] / full_scale_mv * 250e3 * highest)
        for _ in range(30):
            other.write(wave / full_scale_mv * 250e3 * highest)
            other.play(wave.size / rate_hz)
        if full_scale_mv > 100_000 or not square:
            assert other.fault is (FaultCode.ENERGY if square else FaultCode.MEAN)
        codes = np.concatenate(other.played) * (full_scale_mv / 32767e3)
        sums = np.cumsum(np.concatenate([[0.0], codes, np.zeros(rate_hz)]))
        squares = np.cumsum(np.concatenate([[0.0], codes**2, np.zeros(rate_hz)]))
        mean = np.abs(sums[rate_hz:] - sums[:-rate_hz]).max() / rate_hz
        assert mean <= 1.01 * 0.05 * board.ceiling_mv / 1e3
        assert np.sqrt((squares[rate_hz:] - squares[:-rate_hz]).max() / rate_hz) <= MOST_RMS_V


def blocks_of(codes, length):
    """Return whole blocks of a signal, and the one under way."""
    whole = len(codes) // length * length
    return [codes[at : at + length] for at in range(0, whole, length)], codes[whole:]


@cache
def refused_by_hand(codes, kind, begin):
    """Index of the first code from `begin` on that the page's table refuses, at 8 kHz and 250 V."""
    length, ramp = 63, 40  # 8000 / 128 rounded up, 5 ms
    rms = 142_835 * 32_767 * 256 // 250_000
    most_energy = rms * rms // 65_536 * (RATE_HZ + 2 * length)
    most_sum = 26_213 * RATE_HZ // 20
    for n in range(begin, len(codes)):
        level = codes[n]
        whole, rest = blocks_of(codes[: n + 1], length)
        if not rest:  # the block is closed behind this sample
            rest = whole.pop()
        if kind is FaultCode.ENERGY:
            each = [-(-sum(c * c for c in block) // 4096) * 4096 for block in whole[-128:]]
            total = sum(each) + sum(c * c for c in rest)
            if total + level * level * (ramp // 3 + 1) > most_energy:
                return n
        elif sum(map(sum, whole[-128:])) + sum(rest) + level * (ramp - 1) // 2 > most_sum:
            return n
    return None


@pytest.mark.parametrize(
    ("kind", "begin", "signs"),
    [(FaultCode.MEAN, 63 * 129 - 330, [1]), (FaultCode.ENERGY, 63 * 129 - 4100, [1, -1])],
)
def test_the_oldest_block_counts(host, kind, begin, signs):
    """A burst in the first block, silence, and another that ends when the first is the oldest."""
    top = 26_213
    codes = np.zeros(63 * 129, int)
    codes[:63] = np.resize(signs, 63) * top
    codes[begin:] = np.resize(signs, codes.size - begin) * top
    refused = refused_by_hand(tuple(codes.tolist()), kind, begin)
    assert 63 * 128 <= refused < 63 * 129  # the whole of the window is needed
    host.arm()
    for piece in np.split(codes, range(800, codes.size, 800)):
        host.write((piece + 0.5 * np.sign(piece)) / 32767 * 250)
        host.play(piece.size / RATE_HZ)
    assert host.fault is kind
    assert host.first_refused() == refused
    host.check()


def test_energy_is_rounded_up_in_each_block(host):
    """Loud until the limit is near, then so quiet that the rounding of the blocks decides."""
    codes = np.concatenate([np.full(4129, 26_213), np.full(3000, 2000)])
    codes[1::2] *= -1
    refused = refused_by_hand(tuple(codes.tolist()), FaultCode.ENERGY, 6700)
    assert refused == 6832  # were they rounded down, it would be 6833
    host.arm()
    for piece in np.split(codes, range(800, codes.size, 800)):
        host.write((piece + 0.5 * np.sign(piece)) / 32767 * 250)
        host.play(piece.size / RATE_HZ)
    assert host.fault is FaultCode.ENERGY
    assert host.first_refused() == refused


def test_the_mean_is_exact_to_one_code(host):
    """The sum and the ramp's reach 10,485,201, one more than the limit, with the last sample."""
    codes = np.repeat([26_213, 2000, 100, 2], [380, 240, 423, 961])
    assert codes.sum() + 2 * 39 // 2 == 26_213 * RATE_HZ // 20 + 1
    host.arm()
    for piece in np.split(codes, [1000]):
        host.write((piece + 0.5) / 32767 * 250)
        host.play(piece.size / RATE_HZ)
    assert host.fault is FaultCode.MEAN
    assert host.first_refused() == codes.size - 1
