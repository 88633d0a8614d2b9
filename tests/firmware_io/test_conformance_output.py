"""What the core plays of what it is sent: samples, ramps, the watchdog, the slew."""

import math
from dataclasses import replace

import numpy as np
import pytest

from firmware_io.firmware.core import Output
from firmware_io.protocol import Arm, Ping, Stop, StreamSamples
from tests.firmware_io.core_rig import CARRIED, CODE, ENVELOPE, PLAIN, RAMP, STATE, TOP, WAVEFORM

# What is played


def test_a_waveform_at_the_output_rate_is_played_as_it_is(rig):
    rng = np.random.default_rng(1)
    codes = rng.integers(-TOP, TOP + 1, 1000).tolist()
    rig.ready().stream(codes)
    assert rig.play(1000) == codes


@pytest.mark.parametrize("lead_us", [0, 1000, 20_833, 150_000])
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


@pytest.mark.parametrize("watchdog_ms", [10, 33, 160])
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


# The slew


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
