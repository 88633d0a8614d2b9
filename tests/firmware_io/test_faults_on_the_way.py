"""What goes wrong between host and driver, kind by kind, and what comes of it."""

import numpy as np
import pytest

from firmware_io import (
    Device,
    DeviceDisconnectedError,
    DeviceError,
    DeviceFaultError,
    LimitError,
    MockDriver,
    MockLink,
    Playback,
    WaveSource,
    volts_to_codes,
)
from firmware_io.firmware.core import Output
from firmware_io.protocol_client import ANSWER_S
from tests.faulty_link import FaultyLink

RATE = 48_000
WATCHDOG_S = 0.16

# Kind of fault, its seconds, what the caller sees (None: nothing, and every sample is played).
FAULTS = {
    "lost frame": ("lose", 0.0, DeviceFaultError),
    "corrupt frame": ("corrupt", 0.0, DeviceFaultError),
    "short packet": ("cut", 0.0, DeviceFaultError),
    "write that fails half-way": ("short-write", 0.0, DeviceError),
    "repeated frame": ("repeat", 0.0, DeviceFaultError),
    "frame that comes with the next": ("delay", 0.0, None),
    "noise on the line": ("noise", 0.0, DeviceFaultError),
    "stall of 10 ms": ("stall", 0.010, None),
    "stall beyond the watchdog": ("stall", 0.300, DeviceFaultError),
    "write that times out": ("time-out", 0.0, DeviceDisconnectedError),
    "unplugged": ("disconnect", 0.0, DeviceDisconnectedError),
    "lost report": ("lose-answer", 0.0, None),
    "corrupt report": ("corrupt-answer", 0.0, None),
    "driver that says nothing more": ("mute", 0.0, DeviceDisconnectedError),
}


def wave(reports, first, count):
    n = np.arange(first, first + count)
    if reports:  # an envelope at 16 kHz
        return 75.0 * (1.0 - np.cos(2 * np.pi * 20.0 * n / 16_000))
    return 150.0 * np.sin(2 * np.pi * 1000.0 * n / RATE)


def open_playback(driver, clock, reports):
    link = FaultyLink(driver, 64 if reports else None, clock.sleep)
    source = WaveSource(lambda first, count: wave(reports, first, count))
    return link, Playback(Device(link, clock=clock), source)


@pytest.mark.parametrize("reports", [False, True], ids=["bytes", "HID reports"])
@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault(clock, fault, reports, no_thread_is_left):
    fault, seconds, expected = FAULTS[fault]
    driver = MockDriver(pace="real", clock=clock)
    link, playback = open_playback(driver, clock, reports)
    playback.start()
    playback.run_until(clock() + 0.1)
    link.inject(fault, 0, seconds)
    began_s = clock()
    if expected is None:
        playback.run_until(began_s + 0.5)
        playback.stop()
        assert playback.stats.underruns == driver.faults == 0
        if not reports:
            codes, what = driver.output
            codes = codes[what == Output.STREAM]
            assert codes.size >= 0.59 * RATE
            wanted = volts_to_codes(wave(reports, 0, codes.size), 250.0)
            np.testing.assert_array_equal(codes, wanted)
    else:
        with pytest.raises(expected):
            playback.run_until(began_s + 2.0)
        told_s = clock() - began_s
        # As soon as the driver's watchdog has ended it at the latest; a question whether it is
        # there, and then STOP, may be waited for in vain.
        assert told_s < WATCHDOG_S + seconds + 2 * ANSWER_S + 0.05
        assert isinstance(playback.error, expected)
        playback.stop()  # told once
        clock.sleep(max(0.0, began_s + seconds + WATCHDOG_S + 0.01 - clock()))
        assert driver.output[0][-1] == 0
    assert np.abs(driver.output_v).max() <= 150.0 + 0.004
    # 0 V now, and for good.
    clock.sleep(0.5)
    assert not driver.output[0][-RATE // 4 :].any()
    link.close()

    # Opened again, it plays as before.
    link, playback = open_playback(driver, clock, reports)
    played = driver.samples_played
    with playback:
        playback.run_until(clock() + 0.11)
        assert playback.stats.underruns == 0
    clock.sleep(0.006)  # of the ramp to 0 V
    assert driver.samples_played > played + 0.1 * RATE
    assert not driver.output[0][-1]
    assert driver.fault is None


def test_at_least_twelve_kinds_are_injected():
    assert len({fault for fault, _, _ in FAULTS.values()}) >= 12


@pytest.mark.parametrize("reports", [False, True], ids=["bytes", "HID reports"])
def test_a_frame_above_the_ceiling_is_rejected_on_both_sides(clock, reports):
    driver = MockDriver(pace="real", clock=clock, ceiling_v=120.0)
    _link, playback = open_playback(driver, clock, reports)
    playback.start()
    with pytest.raises(LimitError, match=r"120\.0 V"):
        playback.run_until(clock() + 0.1)
    clock.sleep(0.01)
    assert driver.faults == 0
    assert np.abs(driver.output_v).max() <= 120.0

    # A host whose own check is broken: the driver has been told, and has its own.
    device = Device(FaultyLink(driver, 64 if reports else None, clock.sleep), clock=clock)
    object.__setattr__(device.limits, "ceiling_v", 200.0)
    device.arm()
    with pytest.raises(DeviceFaultError, match="ceiling of 120 V"):
        device.write(np.minimum(50.0 * np.arange(20), 150.0))
    assert np.abs(driver.output_v).max() <= 120.0
    assert not device.is_armed


def test_a_host_that_stalls_once_it_has_read_does_not_blame_the_cable(clock, monkeypatch):
    device = Device(MockLink(MockDriver(pace="real", clock=clock)), clock=clock)
    device.set_up(lead_s=0.0, status_s=0.02, watchdog_s=WATCHDOG_S)
    device.arm()
    client = device._stream.client
    read = client.poll

    def read_and_stall():
        read()
        clock.sleep(WATCHDOG_S + 0.05)

    with monkeypatch.context() as patch:
        patch.setattr(client, "poll", read_and_stall)
        clock.sleep(0.03)
        assert device.progress().reported_s == clock() - (WATCHDOG_S + 0.05)
    assert device.is_armed
    assert device.progress().reported_s == pytest.approx(clock(), abs=0.02)
