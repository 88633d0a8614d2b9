"""The driver behind the mock link: it trusts no host."""

from dataclasses import replace

import numpy as np
import pytest

from firmware_io import (
    DeviceDisconnectedError,
    DeviceError,
    DeviceFaultError,
    Frame,
    FrameKind,
    LimitError,
    MockDriver,
    MockLink,
    ProtocolError,
    encode,
)

ARM, STREAM, STOP = FrameKind.ARM, FrameKind.STREAM, FrameKind.STOP


def frame(kind, sequence, index=0, codes=()):
    return encode(Frame(kind, sequence, index, np.array(codes, np.int16)))


def playing_driver(**options):
    """A driver at 1 kHz (its ramps have 5 samples), armed, that has played 1000, 2000."""
    driver = MockDriver(sample_rate_hz=1000.0, **options)
    driver.receive(frame(ARM, 0))
    driver.receive(frame(STREAM, 1, 0, [1000, 2000]))
    return driver


# From 2000 in five equal steps.
RAMPED = [1000, 2000, 1600, 1200, 800, 400, 0]

NEXT = frame(STREAM, 2, 2, [3000])
VIOLATIONS = {
    "sequence gap": (frame(STREAM, 3, 2, [3000]), "Expected sequence 2, but 3 came"),
    "replayed frame": (frame(STREAM, 1, 0, [1000, 2000]), "Expected sequence 2, but 1 came"),
    "sample-index gap": (frame(STREAM, 2, 3, [3000]), "Expected sample index 2, got 3"),
    "over the ceiling": (frame(STREAM, 2, 2, [0, 26214]), "above the ceiling of 200.0 V"),
    "over, negative": (frame(STREAM, 2, 2, [0, -26214]), "above the ceiling of 200.0 V"),
    "lowest int16": (frame(STREAM, 2, 2, [-32768]), "above the ceiling of 200.0 V"),
    "too long": (frame(STREAM, 2, 2, [0] * 1025), "may carry 1024 samples, but 1025 came"),
    "ARM while armed": (frame(ARM, 2), "ARM came while armed"),
    "STOP out of sequence": (frame(STOP, 5, 2), "Expected sequence 2, but 5 came"),
    "damaged": (NEXT[:21] + b"\xff" + NEXT[22:], "CRC-32"),
    "truncated": (NEXT[:-1], "26 bytes, but 25 came"),
    "noise": (bytes(40), "begins with"),
}


@pytest.mark.parametrize("name", VIOLATIONS)
def test_a_violation_ends_at_zero_and_is_remembered(name):
    data, sentence = VIOLATIONS[name]
    driver = playing_driver()
    with pytest.raises((DeviceFaultError, ProtocolError), match=sentence):
        driver.receive(data)
    assert driver.played_codes.tolist() == RAMPED
    assert not driver.is_armed
    assert sentence in driver.fault
    assert driver.faults == 1


@pytest.mark.parametrize("name", VIOLATIONS)
def test_after_a_fault_nothing_plays_until_armed_again(name):
    driver = playing_driver()
    with pytest.raises((DeviceFaultError, ProtocolError)):
        driver.receive(VIOLATIONS[name][0])
    cause = driver.fault
    with pytest.raises(DeviceFaultError, match="Arm it again"):
        driver.receive(NEXT)
    assert (driver.fault, driver.faults, driver.samples_played) == (cause, 1, 7)
    driver.receive(frame(ARM, 90))
    driver.receive(frame(STREAM, 91, 0, [5]))
    assert driver.fault is None
    assert driver.played_codes.tolist() == [*RAMPED, 5]


def test_damage_on_the_wire_is_a_protocol_error():
    with pytest.raises(ProtocolError):
        playing_driver().receive(NEXT[:-1])


def test_must_be_armed():
    driver = MockDriver()
    with pytest.raises(DeviceFaultError, match="not armed"):
        driver.receive(frame(STREAM, 0, 0, [1]))
    assert driver.samples_played == 0


def test_arm_starts_at_sample_zero():
    driver = MockDriver()
    with pytest.raises(DeviceFaultError, match="index 0, but carried 4"):
        driver.receive(frame(ARM, 0, 4))
    assert not driver.is_armed


def test_the_highest_code_under_the_ceiling_plays():
    # 26213 / 32767 * 250 V = 199.995 V; 26214 would be 200.003 V.
    driver = playing_driver()
    driver.receive(frame(STREAM, 2, 2, [26213, -26213]))
    assert driver.faults == 0
    assert driver.played_v[2] == pytest.approx(199.9954, abs=1e-4)  # the literal has 4 decimals


def test_a_lower_ceiling_holds_against_the_host():
    driver = playing_driver(ceiling_v=100.0)
    with pytest.raises(DeviceFaultError, match=r"above the ceiling of 100.0 V"):
        driver.receive(frame(STREAM, 2, 2, [13107]))  # 100.002 V
    assert np.abs(driver.played_v).max() < 100.0


def test_stop_ramps_and_disarms():
    driver = playing_driver()
    driver.receive(frame(STOP, 2, 2))
    driver.receive(frame(STOP, 77, 0))  # has nothing left to do, and is no fault
    assert driver.played_codes.tolist() == RAMPED
    assert (driver.is_armed, driver.fault, driver.faults) == (False, None, 0)


def test_sequence_wraps():
    driver = MockDriver()
    driver.receive(frame(ARM, 2**32 - 1))
    driver.receive(frame(STREAM, 0, 0, [1]))
    assert driver.played_codes.tolist() == [1]


def test_counters():
    driver = playing_driver()
    assert driver.frames_received == 2
    assert driver.bytes_received == 24 + 28
    assert driver.samples_played == 2


def test_played_codes_cannot_be_changed_from_outside():
    driver = playing_driver()
    driver.played_codes[:] = 9
    assert driver.played_codes.tolist() == [1000, 2000]


class Clock:
    now_s = 0.0

    def __call__(self):
        return self.now_s


def test_underruns_with_a_clock_by_hand():
    # 1024 Hz, frames of 256 samples and a lead of 1/8 s: every time is exact in binary.
    clock = Clock()
    driver = MockDriver(sample_rate_hz=1024.0, lead_s=0.125, clock=clock)
    driver.receive(frame(ARM, 0))
    block = [0] * 256
    expected = [
        (10.0, 0),  # playback begins at 10.125, has samples until 10.375
        (10.375, 0),  # just in time; until 10.625
        (10.6875, 1),  # 1/16 s late: slips, until 10.9375
        (10.9375, 1),  # just in time for the slipped clock; until 11.1875
        (10.9375, 1),  # early; until 11.4375
        (13.0, 2),  # one gap is one underrun, however long
    ]
    for number, (now_s, underruns) in enumerate(expected):
        clock.now_s = now_s
        driver.receive(frame(STREAM, number + 1, 256 * number, block))
        assert driver.underruns == underruns, f"frame {number}"
    driver.receive(frame(STOP, 7, 256 * 6))
    clock.now_s = 99.0
    driver.receive(frame(ARM, 8))
    driver.receive(frame(STREAM, 9, 0, block))
    assert driver.underruns == 2  # arming begins a new playback


def test_an_idle_device_before_the_first_frame_is_no_underrun():
    clock = Clock()
    driver = MockDriver(clock=clock)
    driver.receive(frame(ARM, 0))
    clock.now_s = 50.0
    driver.receive(frame(STREAM, 1, 0, [0]))
    assert driver.underruns == 0


@pytest.mark.parametrize(
    "options",
    [
        {"sample_rate_hz": 0.0},
        {"full_scale_v": -1.0},
        {"ceiling_v": np.nan},
        {"max_frame_samples": 0},
        {"max_frame_samples": 65536},
        {"lead_s": -1.0},
        {"lead_s": np.inf},
    ],
)
def test_impossible_drivers(options):
    with pytest.raises(DeviceError, match=next(iter(options))):
        MockDriver(**options)


def test_a_driver_cannot_be_built_above_the_absolute_ceiling():
    with pytest.raises(LimitError, match="at most 200 V"):
        MockDriver(ceiling_v=200.5)


def test_a_closed_link_leaves_the_output_at_zero():
    driver = playing_driver()
    link = MockLink(driver)
    link.close()
    link.close()
    assert driver.played_codes.tolist() == RAMPED
    with pytest.raises(DeviceDisconnectedError, match="open the device again"):
        link.send(NEXT)


def test_capabilities_are_frozen():
    with pytest.raises(AttributeError):
        MockLink().capabilities.ceiling_v = 300.0
    assert replace(MockLink().capabilities, name="x").ceiling_v == 200.0
