"""The mock driver: the firmware in process, its two paces, and what can go wrong on its link."""

import inspect

import numpy as np
import pytest

from firmware_io import (
    ABSOLUTE_CEILING_V,
    DeviceDisconnectedError,
    DeviceError,
    LimitError,
    MockDriver,
    MockLink,
)
from firmware_io.firmware.core import Output
from firmware_io.limits import WATCHDOG_S
from firmware_io.protocol import (
    Arm,
    CapabilitiesReport,
    DeviceState,
    FaultCode,
    FaultReport,
    Frame,
    FrameParser,
    Hello,
    Ping,
    Setup,
    Stop,
    StreamMode,
    StreamSamples,
    TouchPhase,
    TouchReport,
    encode,
)
from tests.faulty_link import FaultyLink, InjectedFault
from tests.hand_clock import HandClock


class Host:
    """The least that can talk to a driver: it numbers frames and reads answers."""

    def __init__(self, link):
        self.link = link
        self.parser = FrameParser()
        self.sequence = 0
        self.index = 0

    def send(self, message):
        self.link.send(encode(Frame(message, self.sequence)))
        self.sequence += 1

    def say(self, *messages):
        for message in messages:
            self.send(message)
        return self.poll()

    def poll(self, timeout_s=0.0):
        items = self.parser.feed(self.link.receive(timeout_s))
        return [item.message if isinstance(item, Frame) else item for item in items]

    def ready(self, **setup):
        about = self.link.driver.about
        plain = {
            "mode": StreamMode.WAVEFORM,
            "watchdog_ms": about.max_watchdog_ms,
            "sample_rate_hz": about.output_rate_hz,
            "full_scale_mv": about.full_scale_mv,
            "ceiling_mv": about.ceiling_mv,
            "max_slew_v_per_s": about.max_slew_v_per_s,
            "lead_us": 0,
        }
        self.say(Hello(), Setup(**{**plain, **setup}), Arm())
        self.index = 0
        return self

    def stream(self, codes):
        codes = np.array(codes, np.int16)
        self.send(StreamSamples(self.index, codes))
        self.index += codes.size


def host_of(report_bytes=None, **options):
    return Host(FaultyLink(MockDriver(**options), report_bytes))


def playing(**options):
    """A driver at 1 kHz (its ramps have 5 samples) that has played 1000, 2000."""
    host = host_of(sample_rate_hz=1000.0, **options).ready()
    host.stream([1000, 2000])
    return host, host.link.driver


# From 2000 in five equal steps.
RAMPED = [1000, 2000, 1600, 1200, 800, 400, 0]


def test_virtual_time_plays_at_once_all_it_was_sent():
    host, driver = playing()
    assert driver.played_codes.tolist() == [1000, 2000]
    assert driver.status.clock_ticks == 2
    host.say(Stop())
    assert driver.played_codes.tolist() == RAMPED
    assert (driver.is_armed, driver.fault, driver.faults, driver.underruns) == (False, None, 0, 0)
    assert driver.samples_played == 7
    assert driver.played_v[1] == pytest.approx(2000 / 32767 * 250)


def test_one_write_may_hold_more_than_the_queue():
    host = host_of(queue_samples=1024).ready()
    frames = [
        encode(Frame(StreamSamples(1024 * k, np.full(1024, k, np.int16)), 3 + k)) for k in range(40)
    ]
    host.link.send(b"".join(frames))
    assert host.link.driver.fault is None
    assert host.link.driver.played_codes.tolist() == [k for k in range(40) for _ in range(1024)]


def test_virtual_time_passes_by_hand():
    _, driver = playing()
    driver.advance(0.15)  # the ramp of 5 ms ends with the watchdog's 160 ms
    assert driver.is_armed
    assert driver.underruns == 1
    driver.advance(0.008)
    assert not driver.is_armed
    driver.advance(0.002)
    assert "starved" in driver.fault
    codes, what = driver.output
    assert codes.size == 2 + 160
    assert codes[-1] == 0
    # The watchdog counts from the frame, which was played in no time: 2 samples, 5 held, 5 down,
    # 143 at 0 V until the watchdog's own ramp would begin, and 7 disarmed.
    assert [int((what == kind).sum()) for kind in Output] == [7, 2, 5 + 143, 5]


def test_a_refused_frame_is_answered_and_kept_as_a_sentence():
    host, driver = playing()
    host.sequence += 1
    fault, *_ = host.say(StreamSamples(2, np.array([3000], np.int16)))
    assert isinstance(fault, FaultReport)
    assert driver.fault == str(fault) == "Expected sequence 4, but 5 came."
    assert driver.played_codes.tolist() == RAMPED
    assert (driver.faults, driver.is_armed) == (1, False)


def test_noise_on_the_wire_ends_at_zero():
    _, driver = playing()
    driver.receive(b"noise on the wire")
    assert driver.played_codes.tolist() == RAMPED
    assert "damaged" in driver.fault


def test_the_drivers_ceiling_holds_against_the_host():
    host = host_of(ceiling_v=100.0).ready()
    host.stream([13107])  # 100.002 V
    assert "100.002 V is above the ceiling of 100 V" in host.link.driver.fault
    assert host.link.driver.samples_played == 0


def test_real_pace_follows_its_clock():
    clock = HandClock(0.0)
    host = host_of(sample_rate_hz=1000, pace="real", clock=clock).ready(lead_us=10_000)
    driver = host.link.driver
    host.stream(range(100, 200))
    assert driver.samples_played == 0
    clock.now_s = 0.030
    assert driver.played_codes.tolist() == list(range(100, 120))
    (status,) = host.say(Ping(1))
    assert (status.queued_samples, status.samples_played, status.clock_ticks) == (80, 20, 30)
    clock.now_s = 0.120
    assert driver.underruns == 1
    host.stream([7])
    clock.now_s = 0.121
    codes, _ = driver.output
    assert codes[10:110].tolist() == list(range(100, 200))
    ramp = [159, 119, 79, 39, 0]  # fifths of 199
    assert codes[110:].tolist() == [199] * 5 + ramp + [1]  # a fifth of 7, fading in
    assert driver.played_codes.tolist() == [*range(100, 200), *ramp, 1]
    with pytest.raises(DeviceError, match="follows its clock"):
        driver.advance(1.0)


def test_real_pace_starves_without_being_asked():
    clock = HandClock(0.0)
    host = host_of(pace="real", clock=clock).ready(watchdog_ms=100)
    host.stream([10_000, *[20_000] * 999])
    clock.now_s = 0.1
    assert host.link.driver.output[0][-1] == 0
    clock.now_s = 50.0
    assert host.link.driver.status.clock_ticks == 50 * 48_000
    assert "within 0.1 s" in host.link.driver.fault


def test_waiting_for_an_answer_ends_when_it_is_there():
    clock = HandClock(0.0)
    waits = []

    def sleep(seconds):
        waits.append(seconds)
        clock.now_s += seconds

    driver = MockDriver(pace="real", clock=clock)
    host = Host(MockLink(driver, sleep=sleep)).ready(watchdog_ms=100)
    host.stream([1000])
    assert host.poll(timeout_s=0.02) == []
    assert clock.now_s == pytest.approx(0.02)
    (starved,) = host.poll(timeout_s=1.0)
    assert starved.code is FaultCode.STARVED
    assert clock.now_s == pytest.approx(0.096, abs=0.002)  # a look each millisecond
    assert max(waits) <= 1e-3


def test_a_clock_that_stands_does_not_hang_the_receiver():
    host = Host(MockLink(MockDriver(pace="real", clock=HandClock(0.0)), sleep=lambda _: None))
    assert host.poll(timeout_s=1e9) == []


@pytest.mark.parametrize("report_bytes", [None, 64])
def test_the_link_carries_a_session(report_bytes):
    host = host_of(report_bytes)
    assert host.link.report_bytes == report_bytes
    assert host.say(Hello()) == [host.link.driver.about]
    assert isinstance(host.link.driver.about, CapabilitiesReport)
    host.ready()
    codes = list(range(-500, 500))
    host.stream(codes)
    assert host.link.driver.played_codes.tolist() == codes
    assert [a.state for a in host.say(Stop())] == [DeviceState.IDLE]


def test_touches_reach_the_host():
    host = host_of().ready()
    assert host.link.driver.touch(12.5, 3.0, normal_force_n=0.25, contact=1, phase=TouchPhase.DOWN)
    assert host.link.driver.touch(12.5, 3.0)
    first, second = host.poll()
    assert first == TouchReport(0, 12_500, 3_000, 250, 1, TouchPhase.DOWN)
    assert second.normal_force_mn == 65535


def test_a_closed_link_leaves_the_output_at_zero():
    host, driver = playing()
    host.link.close()
    host.link.close()
    assert driver.played_codes.tolist() == RAMPED
    with pytest.raises(DeviceDisconnectedError, match="again"):
        host.say(Ping())
    with pytest.raises(DeviceDisconnectedError):
        host.poll()


def test_what_was_played_cannot_be_changed_from_outside():
    _, driver = playing()
    driver.played_codes[:] = 9
    driver.output[0][:] = 9
    assert driver.played_codes.tolist() == [1000, 2000]


def test_a_driver_that_runs_for_days_forgets():
    clock = HandClock(0.0)
    driver = MockDriver(sample_rate_hz=1000, pace="real", clock=clock, kept_s=2.0)
    clock.now_s = 3600.0
    assert driver.status.clock_ticks == 3_600_000
    assert 2000 <= driver.output[0].size <= 3000
    clock.now_s += 0.5
    assert 2000 <= driver.output[0].size <= 3500


def test_bytes_are_counted():
    _, driver = playing()
    assert driver.bytes_received == 18 + 46 + 16 + 24


# FaultInjection: what becomes of an armed driver at 90 V, and what its host sees.

SAFE, PLAYS = "at 0 V", "plays on"
FATES = {
    InjectedFault.LOSE: SAFE,  # told by the frame after it
    InjectedFault.CORRUPT: SAFE,
    InjectedFault.CUT: SAFE,
    InjectedFault.SHORT_WRITE: SAFE,
    InjectedFault.REPEAT: SAFE,
    InjectedFault.DELAY: PLAYS,
    InjectedFault.NOISE: SAFE,
    InjectedFault.STALL: SAFE,
    InjectedFault.TIME_OUT: SAFE,
    InjectedFault.DISCONNECT: SAFE,
    InjectedFault.LOSE_ANSWER: PLAYS,
    InjectedFault.CORRUPT_ANSWER: PLAYS,
    InjectedFault.MUTE: PLAYS,
}


@pytest.mark.parametrize("report_bytes", [None, 64])
@pytest.mark.parametrize("fault", InjectedFault)
def test_after_each_fault_the_output_is_at_zero_within_the_watchdog_time(fault, report_bytes):
    host = host_of(report_bytes).ready()
    driver = host.link.driver
    host.stream([11796] * 20)
    assert driver.played_codes[-1] == 11796
    host.link.inject(fault, seconds=1.0)
    seen = []
    for message in (StreamSamples(20, np.full(20, 11796, np.int16)), Ping(1), Ping(2)):
        try:
            seen += host.say(message)
        except (OSError, DeviceDisconnectedError) as error:
            seen.append(error)
    if FATES[fault] is SAFE:
        driver.advance(WATCHDOG_S)
        assert driver.output[0][-1] == 0
        assert not driver.is_armed
        # The host learns of it: by an error of its own, or by a fault of the driver.
        assert driver.fault is not None or any(isinstance(s, Exception) for s in seen)
    else:
        assert driver.is_armed
        assert driver.samples_played == 40
    if fault is InjectedFault.MUTE:
        assert seen == []
    if fault is InjectedFault.CORRUPT_ANSWER:
        assert "CRC-32" in str(seen[0])
    if fault is InjectedFault.DISCONNECT:
        with pytest.raises(DeviceDisconnectedError, match="cable is unplugged"):
            host.poll()
    # Opened anew, it plays.
    again = Host(MockLink(driver, report_bytes)).ready()
    again.stream([5, 6])
    assert driver.played_codes[-2:].tolist() == [5, 6]


def test_a_fault_waits_for_its_transfer():
    host = host_of().ready()
    host.link.inject("corrupt", after=2)
    for k in range(2):
        host.stream([k])
    assert host.link.driver.fault is None
    host.stream([3])
    assert "damaged" in host.link.driver.fault


def test_an_unknown_fault_is_refused():
    with pytest.raises(ValueError, match="gremlin"):
        FaultyLink().inject("gremlin")


# Drivers that cannot be


@pytest.mark.parametrize(
    "options",
    [
        {"sample_rate_hz": 0.0},
        {"sample_rate_hz": 48_000.5},
        {"sample_rate_hz": np.nan},
        {"full_scale_v": -1.0},
        {"full_scale_v": 250.0004},
        {"max_frame_samples": 0},
        {"max_frame_samples": 32766},
        {"max_watchdog_s": -1.0},
        {"max_watchdog_s": np.nan},
        {"max_watchdog_s": np.inf},
        {"max_watchdog_s": 0.001},
        {"max_watchdog_s": "5"},
        {"sample_rate_hz": None},
        {"queue_samples": 8192.5},
        {"rates_hz": ("8000",)},
        {"pace": "slow"},
    ],
    ids=str,
)
def test_impossible_drivers(options):
    with pytest.raises(DeviceError, match=next(iter(options))):
        MockDriver(**options)


@pytest.mark.parametrize(
    "options",
    [{"rates_hz": (44_100,)}, {"queue_samples": 10}, {"serial": "seventeen letters"}],
    ids=str,
)
def test_drivers_that_the_firmware_refuses(options):
    with pytest.raises(DeviceError, match="Impossible values"):
        MockDriver(**options)


@pytest.mark.parametrize("ceiling_v", [200.5, np.nan, 0.0])
def test_a_driver_cannot_be_built_above_the_absolute_ceiling(ceiling_v):
    with pytest.raises(LimitError, match="ceiling_v must be"):
        MockDriver(ceiling_v=ceiling_v)


def test_limits_are_rounded_down_on_their_way_into_whole_numbers():
    about = MockDriver(ceiling_v=99.9999, max_slew_v_per_s=1e6 + 0.9).about
    assert (about.ceiling_mv, about.max_slew_v_per_s) == (99_999, 1_000_000)


def test_the_drivers_limits_are_the_absolute_ones_by_default():
    parameters = inspect.signature(MockDriver).parameters
    assert parameters["ceiling_v"].default is ABSOLUTE_CEILING_V
    assert parameters["max_watchdog_s"].default is WATCHDOG_S


def test_rates_that_a_driver_takes():
    def rates(**options):
        return [rate.sample_rate_hz for rate in MockDriver(**options).about.rates]

    assert rates() == [48_000, 16_000, 8_000]
    assert rates(sample_rate_hz=16_000) == [16_000, 8_000]
    assert rates(sample_rate_hz=44_100) == [44_100]
    assert rates(rates_hz=(24_000,)) == [24_000]
