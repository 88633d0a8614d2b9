"""The driver behind the mock link: it trusts no host."""

import inspect
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import firmware_io
from firmware_io import (
    ABSOLUTE_CEILING_V,
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
from firmware_io.limits import WATCHDOG_S

ARM, STREAM, STOP = FrameKind.ARM, FrameKind.STREAM, FrameKind.STOP


class Clock:
    now_s = 0.0

    def __call__(self):
        return self.now_s


def frame(kind, sequence, index=0, codes=()):
    return encode(Frame(kind, sequence, index, np.array(codes, np.int16)))


def playing_driver(**options):
    """A driver at 1 kHz (its ramps have 5 samples), armed, that has played 1000, 2000.

    Its clock stands, so that its watchdog never bites.
    """
    driver = MockDriver(sample_rate_hz=1000.0, clock=Clock(), **options)
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


def test_underruns_with_a_clock_by_hand():
    # 1024 Hz, frames of 256 samples and a lead of 1/8 s: every time is exact in binary.
    clock = Clock()
    driver = MockDriver(sample_rate_hz=1024.0, lead_s=0.125, watchdog_s=8.0, clock=clock)
    driver.receive(frame(ARM, 0))
    block = [0] * 256
    expected = [
        (10.0, 0),  # playback begins at 10.125, has samples until 10.375
        (10.375, 0),  # just in time; until 10.625
        (10.6875, 1),  # 1/16 s late: slips, until 10.9375
        (10.9375, 1),  # just in time for the slipped clock; until 11.1875
        (10.9375, 1),  # early; until 11.4375
        (13.0, 2),  # one gap is one underrun, however long, while the watchdog bears it
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
        {"watchdog_s": -1.0},
        {"watchdog_s": np.nan},
        {"watchdog_s": np.inf},
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


def test_the_drivers_ceiling_is_the_absolute_one_by_default():
    parameters = inspect.signature(MockDriver).parameters
    assert parameters["ceiling_v"].default is ABSOLUTE_CEILING_V
    assert parameters["watchdog_s"].default is WATCHDOG_S


def test_capabilities_cannot_be_replaced():
    driver = MockDriver()
    with pytest.raises(AttributeError):
        driver.capabilities = replace(driver.capabilities, full_scale_v=1.0)


def test_capabilities_are_frozen():
    with pytest.raises(AttributeError):
        MockLink().capabilities.ceiling_v = 300.0
    assert replace(MockLink().capabilities, name="x").ceiling_v == 200.0


# A watchdog by hand: at 1024 Hz, with a lead of 1/8 s, the 256 samples of `starving_driver` end
# at 10.375 and the watchdog of 1/4 s bears a pause until 10.625; all exact in binary.


def starving_driver():
    clock = Clock()
    driver = MockDriver(sample_rate_hz=1024.0, lead_s=0.125, watchdog_s=0.25, clock=clock)
    driver.receive(frame(ARM, 0))
    clock.now_s = 10.0
    driver.receive(frame(STREAM, 1, 0, [13107] * 256))
    return driver, clock


QUESTIONS = {
    "played_codes": lambda driver: driver.played_codes[-1] == 0,
    "played_v": lambda driver: driver.played_v[-1] == 0.0,
    "is_armed": lambda driver: not driver.is_armed,
    "fault": lambda driver: "starved" in driver.fault,
    "faults": lambda driver: driver.faults == 1,
    "samples_played": lambda driver: driver.samples_played > 256,
}


@pytest.mark.parametrize("name", QUESTIONS)
def test_a_starved_stream_ends_at_zero_whatever_is_asked_first(name):
    driver, clock = starving_driver()
    clock.now_s = 10.6875
    assert QUESTIONS[name](driver)
    assert all(question(driver) for question in QUESTIONS.values())
    assert driver.underruns == 0
    # The usual ramp: 5 ms are 6 samples, and no step of it goes up.
    ramp = driver.played_codes[256:].astype(int)
    assert len(ramp) == 6
    assert (np.diff(ramp, prepend=13107) < 0).all()


def test_a_pause_that_the_watchdog_bears_is_an_underrun():
    driver, clock = starving_driver()
    clock.now_s = 10.625
    assert driver.is_armed
    driver.receive(frame(STREAM, 2, 256, [13107] * 256))
    assert (driver.underruns, driver.faults, driver.samples_played) == (1, 0, 512)
    clock.now_s = 10.625 + 0.25 + 0.25  # what was sent, and the watchdog
    assert driver.is_armed
    clock.now_s += 1 / 1024
    assert not driver.is_armed


def test_the_next_frame_learns_that_the_stream_starved():
    driver, clock = starving_driver()
    clock.now_s = 10.6875
    late = frame(STREAM, 2, 256, [13107])
    with pytest.raises(DeviceFaultError, match=r"starved.*0.25 s.*longer lead.*Arm it again"):
        driver.receive(late)
    assert driver.played_codes[-1] == 0
    assert driver.faults == 1
    driver.receive(frame(ARM, 9))
    driver.receive(frame(STREAM, 10, 0, [5]))
    assert driver.fault is None
    assert driver.is_armed


def test_noise_does_not_hold_the_watchdog_off():
    driver, clock = starving_driver()
    clock.now_s = 10.6875
    with pytest.raises(ProtocolError):
        driver.receive(b"noise")
    assert "starved" in driver.fault
    assert driver.faults == 1


def test_a_full_queue_does_not_starve():
    clock = Clock()
    driver = MockDriver(sample_rate_hz=1024.0, lead_s=0.125, watchdog_s=0.25, clock=clock)
    driver.receive(frame(ARM, 0))
    for number in range(8):
        driver.receive(frame(STREAM, number + 1, 1024 * number, [1000] * 1024))
    clock.now_s = 8.0  # 8 s were sent at once; the host has been silent since
    driver.receive(frame(STREAM, 9, 8192, [1000] * 1024))
    clock.now_s = 9.125 + 0.25
    assert driver.is_armed
    assert (driver.underruns, driver.faults) == (0, 0)
    driver.receive(frame(STOP, 10, 9216))
    clock.now_s = 99.0
    assert (driver.fault, driver.faults) == (None, 0)  # a stopped driver cannot starve


def test_an_armed_driver_that_has_played_nothing_does_not_starve():
    clock = Clock()
    driver = MockDriver(clock=clock)
    driver.receive(frame(ARM, 0))
    clock.now_s = 50.0
    assert driver.is_armed
    driver.receive(frame(STOP, 1))
    driver.receive(frame(ARM, 2))
    clock.now_s = 100.0
    assert driver.is_armed


def test_a_link_closed_after_starving_ends_once():
    driver, clock = starving_driver()
    clock.now_s = 20.0
    MockLink(driver).close()
    assert driver.samples_played == 256 + 6
    assert driver.faults == 1


def test_the_document_states_the_watchdogs_time():
    text = (Path(firmware_io.__file__).parent / "PROTOCOL.md").read_text()
    assert f"within {WATCHDOG_S * 1e3:g} ms after the last sample" in text
