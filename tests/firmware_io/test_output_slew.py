"""The current of what leaves the driver, step by step: no path adds to the slew that was stated."""

import math
from contextlib import suppress
from dataclasses import replace

import numpy as np
import pytest

from firmware_io import Device, DeviceFaultError, DriveLimits, LimitError, MockDriver, MockLink
from firmware_io.protocol import FaultCode, Rate, Setup, Stop
from tests.firmware_io.core_rig import BOTH, ENVELOPE, WAVEFORM
from tests.firmware_io.test_output_window import BOARD, Attacker

CAPACITANCES_NF = [0.15, 0.5, 1.0, 2.0, 5.0, 10.0, 15.0]
MOST_MA = 0.7
TOP = 26_213


def assert_current(host, capacitance_nf):
    """No step of the output makes more than 0.7 mA, from 0 V at the beginning on."""
    codes = np.concatenate(host.played).astype(np.int64)
    steps = np.abs(np.diff(codes, prepend=0))
    most_v_per_s = steps.max() / 32_767 * 250.0 * host.rate_hz
    assert most_v_per_s * capacitance_nf * 1e-6 <= MOST_MA
    return most_v_per_s * capacitance_nf * 1e-6


def slew_of(capacitance_nf):
    """The slew of 0.7 mA in whole V/s, as SETUP carries it."""
    return min(math.floor(MOST_MA * 1e6 / capacitance_nf), 4_666_666)


def steepest(most, n, at, rng):
    """Codes that step by the most that passes, up and down at random, below the ceiling."""
    codes, way = [], 1
    for _ in range(n):
        if rng.random() < 0.02 or abs(at + way * most) > TOP:
            way = -way
        if abs(at + way * most) <= TOP:
            at += way * most
        codes.append(at)
    return codes


def begin_again(host, rng, setup):
    """End the session in one of its ways, and begin another amid the ramp or behind it."""
    if rng.random() < 0.5:
        host.core.release()
    else:
        host.say(Stop())
    host.play(rng.choice([0.0, 0.002, 0.01]))
    host.arm(setup)


@pytest.mark.parametrize("capacitance_nf", CAPACITANCES_NF)
@pytest.mark.parametrize(("rate_hz", "each"), [(8000, 1), (48_000, 3)])
def test_a_waveform_that_runs_dry_at_random(capacitance_nf, rate_hz, each):
    board = replace(BOARD, output_rate_hz=rate_hz, rates=(Rate(rate_hz // each, BOTH),))
    setup = Setup(
        WAVEFORM, 160, rate_hz // each, 250_000, 200_000, slew_of(capacitance_nf), lead_us=0
    )
    # Whole codes in an output sample.
    most = each * (setup.max_slew_v_per_s * 32_767_000 // 250_000 // rate_hz)
    rng = np.random.default_rng(round(100 * capacitance_nf))
    host = Attacker(board)
    host.arm(setup)
    at = 0
    for _ in range(200):
        if host.fault is not FaultCode.NONE or rng.random() < 0.03:
            begin_again(host, rng, setup)
            at = 0
        codes = steepest(most, int(rng.integers(1, 120)), at, rng)
        at = codes[-1]
        host.write_codes(codes)
        host.play(len(codes) * each / rate_hz + rng.choice([0.0, 0.004, 0.007, 0.03]))
        assert host.fault in (FaultCode.NONE, FaultCode.MEAN, FaultCode.ENERGY)
    assert host.core.status().underruns > 50
    assert_current(host, capacitance_nf)
    host.check()


@pytest.mark.parametrize("capacitance_nf", CAPACITANCES_NF)
def test_a_carrier_that_is_held_stopped_and_begun_again_at_random(capacitance_nf):
    """The highest amplitude that passes; the safety ramp comes on top of the carrier's slope."""
    rate_hz = 48_000
    board = replace(BOARD, output_rate_hz=rate_hz, rates=(Rate(16_000, BOTH),))
    rng = np.random.default_rng(round(100 * capacitance_nf))
    host = Attacker(board)
    for carrier_hz in (1000.0, 1357.9, 4000.0, 12_000.0):
        slew = slew_of(capacitance_nf)
        setup = Setup(
            ENVELOPE, 160, 16_000, 250_000, 200_000, slew, round(carrier_hz * 1e3), lead_us=0
        )
        codes_per_s = slew * 32_767_000 // 250_000 // rate_hz * rate_hz
        carrier_rad_per_s = -(-setup.carrier_mhz * 411_775 // 65_536_000)
        highest = min(codes_per_s // (carrier_rad_per_s + 200), TOP)
        host.arm(setup)
        at = 0
        for _ in range(60):
            if host.fault is not FaultCode.NONE or rng.random() < 0.1:
                begin_again(host, rng, setup)
                at = 0
            codes = []
            for _ in range(int(rng.integers(1, 400))):
                room = codes_per_s - carrier_rad_per_s * max(at, 1)
                at = min(at + max(0, room // (16_000 + carrier_rad_per_s)), highest)
                codes.append(at)
            host.write_codes(codes)
            host.play(len(codes) / 16_000 + rng.choice([0.0, 0.004, 0.007, 0.03]))
            assert host.fault is FaultCode.NONE
        host.say(Stop())
        host.play(0.01)
    worst_ma = assert_current(host, capacitance_nf)
    assert worst_ma > 0.9 * MOST_MA or capacitance_nf == 0.15
    host.check()


@pytest.mark.parametrize("capacitance_nf", CAPACITANCES_NF)
@pytest.mark.parametrize("mode", ["waveform", "envelope"])
def test_a_host_at_its_limits_makes_the_driver_find_no_fault(mode, capacitance_nf, clock):
    """The steepest that the host lets pass: what its rounding makes of it keeps the current."""
    driver = MockDriver(pace="real", clock=clock, kept_s=60.0)
    link = MockLink(driver, sleep=clock.sleep)
    limits = DriveLimits(capacitance_f=capacitance_nf * 1e-9)
    device = Device(link, limits, mode=mode, sample_rate_hz=16_000, clock=clock)
    device.set_up(lead_s=0.0)
    rng = np.random.default_rng(round(100 * capacitance_nf))
    slew = device.limits.max_slew_v_per_s
    carrier = 2 * np.pi * (device.carrier_hz or 0.0)
    highest = min(device.limits.ceiling_v, slew / carrier if carrier else 200.0)
    at, way = 0.0, 1.0
    for _ in range(150):
        volts = []
        for turns in rng.random(int(rng.integers(1, 200))) < 0.05:
            if mode == "waveform":
                step = slew / 16_000
            else:  # as high as the carrier leaves room for, up and down
                step = (slew - carrier * at) / (16_000 + carrier * (way > 0))
            if turns or not -highest * (mode == "waveform") <= at + way * step <= highest:
                way = -way
                step = 0.0
            at += way * step
            volts.append(at * (1 - 1e-12))
        try:
            device.arm()
            device.write(volts)
            if rng.random() < 0.05:
                device.stop()
        except LimitError as error:
            assert "slew" not in str(error)  # but the rms of the current, or a mean
        except DeviceFaultError as error:
            # Of pauses that the host knows nothing of.
            assert "slew" not in str(error)
        if not device.is_armed:
            at = 0.0
        clock.sleep(rng.choice([0.0, 0.005, 0.012, 0.02, 0.04]))
    with suppress(DeviceFaultError):  # of the last pause
        device.close()
    clock.sleep(0.01)
    codes = driver.output[0].astype(np.int64)
    most_v_per_s = np.abs(np.diff(codes, prepend=0)).max() / 32_767 * 250.0 * 48_000
    assert most_v_per_s * capacitance_nf * 1e-6 <= MOST_MA
    assert codes[-1] == 0


def test_the_slew_is_that_of_whole_codes_in_an_output_sample():
    """46,666 V/s at 8 kHz are 764.57 codes: in four output samples 3056 pass, 3058 do not."""
    board = replace(BOARD, rates=(Rate(2000, BOTH),))
    setup = Setup(WAVEFORM, 160, 2000, 250_000, 200_000, 46_666, lead_us=0)
    for code, fault in ((3056, FaultCode.NONE), (3057, FaultCode.SLEW)):
        host = Attacker(board)
        host.arm(setup)
        host.write_codes([code])
        assert host.fault is fault


@pytest.mark.parametrize(
    ("codes", "fault"),
    [
        # Rounded up: 43 8000 + 18,850 306 is above 764 8000, and with 18,849.6 would not be.
        ([200, 264, 306], FaultCode.NONE),
        ([200, 263, 306], FaultCode.SLEW),
        # Of the larger amplitude, also where it falls: 58 8000 + 18,850 300 is above.
        ([200, 264, 300, 243], FaultCode.NONE),
        ([200, 264, 300, 242], FaultCode.SLEW),
    ],
)
def test_the_slew_of_a_carrier_at_its_limit(codes, fault):
    """2 pi 3 kHz are 18,849.6 rad/s and count as 18,850; the slew is 764 codes a sample."""
    setup = Setup(ENVELOPE, 160, 8000, 250_000, 200_000, 46_666, 3_000_000, lead_us=0)
    host = Attacker()
    host.arm(setup)
    host.write_codes(codes)
    assert host.fault is fault
