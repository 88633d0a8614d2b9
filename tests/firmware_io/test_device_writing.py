"""The host's one way to a link."""

import gc
import math
import subprocess
import sys
import weakref

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_io import (
    Device,
    DeviceDisconnectedError,
    DeviceError,
    DeviceFaultError,
    DriveLimits,
    LimitError,
    MockDriver,
    MockLink,
    codes_to_volts,
    volts_to_codes,
)
from firmware_io.protocol import Arm, Frame, FrameKind, Setup, StreamMode, StreamSamples, encode

HALF_STEP_V = 250.0 / 32767 / 2  # the mock's full scale is 250 V


def mock_device(limits=None, **options):
    return Device(MockLink(MockDriver(**options)), limits)


def kind_of(frame):
    return FrameKind(frame[3])


def carrier(amplitude_v, samples=4800, rate=48e3):
    return amplitude_v * np.sin(2 * np.pi * 1700.0 * np.arange(samples) / rate)


def assert_safe(device, ceiling_v=200.0):
    assert not device.is_armed
    assert not device.stop_is_owed
    assert device.last_v == 0.0
    assert device.mock.played_codes[-1] == 0
    assert np.abs(device.mock.played_v).max() <= ceiling_v
    assert not device.mock.is_armed


@settings(deadline=None, max_examples=50)
@given(st.lists(st.integers(0, 700), min_size=1, max_size=6), st.integers(1, 300))
def test_what_is_played_is_what_was_written(lengths, max_frame_samples):
    device = mock_device(max_frame_samples=max_frame_samples)
    volts = carrier(190.0, sum(lengths))
    with device:
        for piece in np.split(volts, np.cumsum(lengths)[:-1]):
            device.write(piece)
        played = device.mock.played_codes
    np.testing.assert_array_equal(played, np.rint(volts / 250.0 * 32767))
    # Half a step is what rounding to the nearest code costs; 1e-9 V is float64 rounding.
    error = np.abs(codes_to_volts(played, 250.0) - volts)
    assert error.max(initial=0.0) <= HALF_STEP_V + 1e-9


def test_at_the_ceiling_the_code_is_rounded_down():
    device = mock_device()
    with device:
        device.write([75.0, 150.0, 200.0, 110.0, 20.0, -70.0, -150.0, -200.0])
    # 200 V is code 26213.6; 26214 would be 3 mV above the ceiling.
    assert device.mock.played_codes[[2, 7]].tolist() == [26213, -26213]
    assert device.mock.faults == 0


def test_frames_and_counters():
    device = mock_device(max_frame_samples=100)
    with device:
        frames, sent = device.frames_sent, device.bytes_sent
        device.write(np.zeros(250))
        assert (device.frames_sent - frames, device.samples_sent) == (3, 250)  # 100, 100, 50
        # PROTOCOL.md: a header of 12, a sample index of 4 and a CRC of 4 bytes in each.
        assert device.bytes_sent - sent == 3 * 20 + 2 * 250
    assert device.bytes_sent == device.mock.bytes_received


@pytest.mark.parametrize(
    "bad_v", [math.nextafter(200.0, 300.0), -201.0, 1e300, np.nan, np.inf, -np.inf]
)
def test_over_limit_is_rejected_at_zero_volts(bad_v):
    device = mock_device()
    device.arm()
    good = carrier(180.0, 1000)
    device.write(good)
    with pytest.raises(LimitError, match="Sample 500"):
        device.write(np.r_[np.full(500, good[-1]), bad_v])
    assert_safe(device)
    # 5 ms of ramp at 48 kHz, and nothing of the rejected write.
    assert device.mock.samples_played == 1000 + 240
    assert device.mock.faults == 0


def test_slew_counts_from_the_last_write():
    # 1 V per sample at 48 kHz, in whole codes 131 of 250 V / 32767: 0.9995 V.
    device = mock_device(DriveLimits(max_slew_v_per_s=48e3))
    device.arm()
    device.write([0.999, 1.998])
    device.write([2.997])
    with pytest.raises(LimitError, match=r"Sample 0 .*3\.997 V"):
        device.write([3.997])
    assert_safe(device)


def test_a_gentle_slew_limit_lowers_the_ceiling_to_what_the_safety_ramp_can_leave():
    # 10 mV per sample, in whole codes one: in 5 ms, 240 samples, from 240 codes or 1.8311 V.
    device = mock_device(DriveLimits(max_slew_v_per_s=480.0))
    assert device.limits.ceiling_v == 1.831
    rise_v = np.arange(1, 241) * (1.831 / 240)
    with device:
        device.write(rise_v)
    assert np.abs(np.diff(device.mock.output[0], prepend=0)).max() == 1
    with device, pytest.raises(LimitError, match=r"Sample 240 .*1\.831 V"):
        device.write([*rise_v, 1.832])
    device.arm()
    device.write(rise_v)
    device.stop_at_once()
    assert np.abs(np.diff(device.mock.output[0])).max() == 1
    assert_safe(device)


def test_an_error_inside_the_context_ends_at_zero():
    device = mock_device()
    with pytest.raises(ZeroDivisionError), device:
        device.write([90.0])
        _ = 1 / 0
    assert_safe(device)


def test_can_be_used_again():
    device = mock_device()
    for _ in range(2):
        with device:
            device.write([90.0])
        assert_safe(device)
    assert device.mock.faults == 0


def test_stop_and_close_are_idempotent():
    device = mock_device()
    device.arm()
    device.arm()
    device.write([50.0])
    device.stop()
    frames = device.frames_sent
    device.stop()
    device.close()
    device.close()
    assert device.frames_sent == frames
    assert_safe(device)
    with pytest.raises(DeviceDisconnectedError, match="open it again"):
        device.arm()


def test_close_while_playing_ends_at_zero():
    device = mock_device()
    device.arm()
    device.write([50.0])
    device.close()
    assert_safe(device)


def test_must_be_armed_to_write():
    device = mock_device()
    frames = device.frames_sent
    with pytest.raises(DeviceError, match=r"call arm\(\) first"):
        device.write([0.0])
    assert device.frames_sent == frames


@pytest.mark.parametrize(
    "volts", [5.0, [[1.0]], [1j], ["1"], [True], [None], [[1.0], [1.0, 2.0]]], ids=str
)
def test_input_that_is_no_row_of_real_numbers(volts):
    device = mock_device()
    device.arm()
    device.write([10.0])
    with pytest.raises(DeviceError, match="1-D"):
        device.write(volts)
    assert_safe(device)


@pytest.mark.parametrize("dtype", [np.float32, np.int16, np.uint8])
def test_other_real_types(dtype):
    device = mock_device()
    with device:
        device.write(np.array([0, 90], dtype))
    assert device.mock.played_codes[1] == 11796


def test_the_tighter_ceiling_is_in_force():
    assert mock_device(DriveLimits(120.0)).limits.ceiling_v == 120.0
    assert mock_device(ceiling_v=90.0).limits.ceiling_v == 90.0
    assert mock_device(full_scale_v=60.0).limits.ceiling_v == 60.0


def test_lower_ceiling():
    device = mock_device()
    device.lower_ceiling(150.0)
    with device, pytest.raises(LimitError, match=r"150\.0 V"):
        device.write([75.0, 150.1])
    for ceiling_v in (150.1, 200.0, 300.0, np.nan, -5.0):
        with pytest.raises(LimitError):
            device.lower_ceiling(ceiling_v)
    assert device.limits.ceiling_v == 150.0


def test_raising_the_capacitance_lowers_the_slew_on_both_sides():
    device = mock_device()
    device.arm()
    device.write([50.0])
    device.raise_capacitance(1e-9)  # 0.7 mA through it are 0.7 MV/s, 14.6 V a sample
    assert_safe(device)
    assert not device.is_armed
    with device:
        device.write([14.5])
    with device, pytest.raises(LimitError, match=r"0\.7 mA.*1000 pF"):
        device.write([14.6])
    for capacitance_f in (0.9e-9, 150e-12, np.nan, np.inf):
        with pytest.raises(LimitError):
            device.raise_capacitance(capacitance_f)
    assert device.limits.capacitance_f == 1e-9
    # A host that forgets its own limit meets the driver's.
    object.__setattr__(device.limits, "max_slew_v_per_s", 4e6)
    with device, pytest.raises(DeviceFaultError, match=r"steep|slew"):
        device.write([20.0])


def test_lowering_the_ceiling_below_the_output_stops():
    device = mock_device()
    device.arm()
    device.write([75.0, 150.0])
    device.lower_ceiling(100.0)
    assert_safe(device)
    device.arm()
    device.write([50.0])
    device.lower_ceiling(80.0)
    assert device.is_armed


def test_a_driver_fault_reaches_the_writer_and_arming_recovers():
    device = mock_device()
    device.arm()
    device.write([90.0])
    # Another host interferes.
    other = StreamSamples(0, np.zeros(1, np.int16), StreamMode.WAVEFORM)
    device.mock.receive(encode(Frame(other, 7777)))
    with pytest.raises(DeviceFaultError, match="7777") as caught:
        device.write([90.0])
    assert not hasattr(caught.value, "__notes__")  # stopping a driver that has stopped succeeds
    assert_safe(device)
    with device:
        device.write([1.0])
    assert device.mock.faults == 1


class CorruptingLink(MockLink):
    """Flips one bit of the STREAM frames whose numbers are listed."""

    def __init__(self, corrupt):
        super().__init__(MockDriver())
        self.corrupt = corrupt
        self.streams = 0

    def send(self, frame):
        if kind_of(frame) is FrameKind.STREAM:
            if self.streams in self.corrupt:
                frame = frame[:-5] + bytes([frame[-5] ^ 1]) + frame[-4:]
            self.streams += 1
        super().send(frame)


def test_damage_on_the_way_ends_at_zero():
    device = Device(CorruptingLink((1,)))
    device.arm()
    device.write([90.0])
    with pytest.raises(DeviceFaultError, match="came damaged"):
        device.write([120.0])
    assert_safe(device)
    assert np.abs(device.mock.played_v).max() < 90.0 + HALF_STEP_V  # 120 V never came


def test_damage_to_the_ramp_is_reported_and_ends_at_zero():
    device = Device(CorruptingLink((1,)))
    device.arm()
    device.write([90.0])
    with pytest.raises(DeviceFaultError, match="came damaged"):
        device.stop()
    assert_safe(device)


class UnpluggedLink(MockLink):
    """Is pulled after ARM."""

    def __init__(self):
        super().__init__(MockDriver())
        self.attempts = []
        self.closed = False

    def send(self, frame):
        if kind_of(frame) is FrameKind.ARM or self.attempts:
            self.attempts.append(kind_of(frame))
            if len(self.attempts) > 1:
                raise DeviceDisconnectedError(f"Attempt {len(self.attempts)} found no device.")
        super().send(frame)

    def close(self):
        self.closed = True


def test_the_first_error_is_the_one_raised():
    link = UnpluggedLink()
    device = Device(link)
    device.arm()
    with pytest.raises(DeviceDisconnectedError, match="Attempt 2") as caught:
        device.write([90.0])
    assert "0 V failed as well" in caught.value.__notes__[0]
    assert link.attempts == [FrameKind.ARM, FrameKind.STREAM, FrameKind.STOP]
    assert not device.is_armed


def test_an_error_in_the_context_outlives_a_failing_stop():
    device = Device(UnpluggedLink())
    with pytest.raises(KeyError, match="mine"), device:
        raise KeyError("mine")
    assert not device.is_armed


def test_close_lets_a_failing_link_go():
    link = UnpluggedLink()
    device = Device(link)
    device.arm()
    with pytest.raises(DeviceDisconnectedError):
        device.close()
    assert link.closed


def test_a_host_that_skips_its_checks_still_meets_the_drivers_ceiling():
    driver = MockDriver(ceiling_v=80.0)
    setup = Setup(StreamMode.WAVEFORM, 160, 48_000, 250_000, 80_000, 1_000_000)
    too_much = StreamSamples(0, volts_to_codes([81.0], 250.0), StreamMode.WAVEFORM)
    for number, message in enumerate([setup, Arm(), too_much]):
        driver.receive(encode(Frame(message, number)))
    assert "80 V" in driver.fault
    assert driver.samples_played == 0


class LooseLink(MockLink):
    """Fails while `failure` is set, before or after the frame has arrived."""

    def __init__(self):
        super().__init__(MockDriver())
        self.failure: BaseException | None = None
        self.fails_at = set(FrameKind)
        self.arrives = False
        self.fails_to_close = False

    def send(self, frame):
        fails = self.failure is not None and kind_of(frame) in self.fails_at
        if not fails or self.arrives:
            super().send(frame)
        if fails and self.failure is not None:
            raise self.failure

    def close(self):
        if self.fails_to_close:
            raise OSError("no such device")
        super().close()


UNPLUGGED = DeviceDisconnectedError("The cable is out.")


def device_with_stop_owed(arrives=False):
    """A device whose driver stands armed at 100 V or more, with the link down."""
    link = LooseLink()
    device = Device(link)
    device.arm()
    device.write([50.0, 100.0])
    link.failure, link.arrives = UNPLUGGED, arrives
    with pytest.raises(DeviceDisconnectedError):
        device.write([110.0])
    link.arrives = False
    return device, link


def test_a_stop_that_was_not_delivered_stays_owed():
    device, _ = device_with_stop_owed()
    assert device.mock.is_armed
    assert device.mock.played_v[-1] == pytest.approx(100.0, abs=HALF_STEP_V)
    assert not device.is_armed
    assert device.stop_is_owed
    assert device.last_v == 110.0  # it may have arrived
    for _ in range(2):  # still owed after another failure
        with pytest.raises(DeviceDisconnectedError, match="cable"):
            device.stop()
        assert device.stop_is_owed
        assert device.last_v == 110.0


def leave_a_context(device):
    device.__exit__(None, None, None)


@pytest.mark.parametrize("retry", [Device.stop, Device.close, leave_a_context])
@pytest.mark.parametrize("arrives", [False, True], ids=["frame lost", "frame arrived"])
def test_an_owed_stop_is_delivered_when_the_link_is_back(retry, arrives):
    device, link = device_with_stop_owed(arrives)
    link.failure = None
    retry(device)
    assert_safe(device)
    # Where nothing was lost but the word of it, the driver sees STOP come twice or out of step.
    assert device.mock.faults <= arrives
    assert np.abs(np.diff(device.mock.played_v)).max() < 51.0  # the ramp begins where it stood


@pytest.mark.parametrize("arrives", [False, True], ids=["frame lost", "frame arrived"])
def test_arming_delivers_the_owed_stop_first(arrives):
    device, link = device_with_stop_owed(arrives)
    with pytest.raises(DeviceDisconnectedError):
        device.arm()
    assert not device.is_armed
    link.failure = None
    with device:
        assert device.last_v == 0.0
        assert device.mock.played_codes[-1] == 0
        device.write([1.0])
    assert_safe(device)


@pytest.mark.parametrize("arrives", [False, True], ids=["frame lost", "frame arrived"])
def test_an_arm_in_doubt_owes_a_stop(arrives):
    link = LooseLink()
    device = Device(link)
    link.failure, link.arrives, link.fails_at = UNPLUGGED, arrives, {FrameKind.ARM}
    with pytest.raises(DeviceDisconnectedError):
        device.arm()
    assert not device.is_armed
    assert device.stop_is_owed
    link.failure = None
    device.stop()
    assert not device.mock.is_armed
    assert not device.stop_is_owed


def test_a_ramp_that_is_lost_does_not_hide_what_stands():
    link = LooseLink()
    device = Device(link)
    device.arm()
    device.write([90.0])
    link.failure = UNPLUGGED
    with pytest.raises(DeviceDisconnectedError):
        device.stop()
    assert (device.is_armed, device.stop_is_owed, device.last_v) == (False, True, 90.0)
    link.failure = None
    device.stop()
    assert_safe(device)
    assert device.mock.faults == 0


def test_closing_with_a_stop_owed_ends_at_zero_and_says_so():
    device, _ = device_with_stop_owed()
    with pytest.raises(DeviceDisconnectedError):
        device.close()
    assert device.mock.played_codes[-1] == 0  # the driver lost its host
    assert device.stop_is_owed  # but nobody heard of it
    with pytest.raises(DeviceDisconnectedError):
        device.close()


def test_an_os_error_is_a_lost_link_and_keeps_the_sequence():
    link = LooseLink()
    device = Device(link)
    device.arm()
    device.write([90.0])
    link.failure = OSError(19, "No such device")
    with pytest.raises(DeviceDisconnectedError, match="No such device") as caught:
        device.write([110.0])
    assert isinstance(caught.value.__cause__, OSError)
    link.failure = None
    device.stop()
    assert_safe(device)
    assert device.mock.faults == 0  # STOP followed on what the driver had received


def test_an_os_error_in_closing_is_a_lost_link():
    link = LooseLink()
    link.fails_to_close = True
    with pytest.raises(DeviceDisconnectedError, match="no such device"):
        Device(link).close()


def test_an_interrupted_send_is_in_doubt_too():
    link = LooseLink()
    device = Device(link)
    device.arm()
    link.failure, link.arrives = KeyboardInterrupt(), True
    with pytest.raises(KeyboardInterrupt):
        device.write([90.0])
    link.failure = None
    device.stop()
    assert_safe(device)


def test_lowering_the_ceiling_holds_even_if_the_stop_fails():
    link = LooseLink()
    device = Device(link)
    device.arm()
    device.write([75.0, 150.0])
    link.failure = UNPLUGGED
    with pytest.raises(DeviceDisconnectedError):
        device.lower_ceiling(100.0)
    assert device.limits.ceiling_v == 100.0
    link.failure = None
    device.stop()
    assert_safe(device, 150.0)


@pytest.mark.parametrize("in_a_cycle", [False, True])
def test_a_forgotten_device_stops(in_a_cycle):
    device = mock_device()
    driver, seen = device.mock, weakref.ref(device)
    device.arm()
    device.write(np.linspace(0.0, 100.0, 500))
    if in_a_cycle:
        device.itself = device
    del device
    gc.collect()
    assert seen() is None
    assert not driver.is_armed
    assert driver.played_codes[-1] == 0
    assert driver.faults == 0


def test_a_forgotten_device_with_a_lost_link_is_silent(capfd):
    link = UnpluggedLink()
    device = Device(link)
    device.arm()
    del device
    gc.collect()
    assert link.attempts == [FrameKind.ARM, FrameKind.STOP]
    assert link.closed
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("end", ["", "raise SystemExit(3)", "1 / 0"])
def test_a_program_that_ends_stops_its_device(end):
    program = f"""
import firmware_io

class Loud(firmware_io.MockLink):
    def send(self, frame):
        super().send(frame)
        if frame[3] == 5:
            print("STOP", self.driver.played_codes[-1:], flush=True)

device = firmware_io.Device(Loud())
device.arm()
device.write([50.0, 100.0])
{end}
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.stdout == "STOP [0]\n"
    assert ("ZeroDivisionError" in done.stderr) == bool(done.stderr)


def test_a_starved_stream_is_told_and_arming_recovers():
    device = mock_device()
    device.arm()
    device.write([50.0, 100.0])
    device.mock.advance(1.0)
    with pytest.raises(DeviceFaultError, match=r"starved.*lead"):
        device.write([90.0])
    assert_safe(device)
    with device:
        device.write([1.0])
    assert_safe(device)
    assert device.mock.faults == 1


def test_stopping_a_starved_stream_tells_so_once():
    device = mock_device()
    device.arm()
    device.write([90.0])
    device.mock.advance(1.0)
    with pytest.raises(DeviceFaultError, match="starved"):
        device.stop()
    assert_safe(device)
    device.stop()


def test_carriers_change_both_ways_under_a_gentle_slew_limit():
    # 10 V at 4 kHz slew at 2 pi 4000 10 = 251 kV/s.
    device = Device(MockLink(), DriveLimits(max_slew_v_per_s=3e5), mode="envelope")
    for carrier_hz in (4000.0, 1000.0, 4500.0):
        device.set_up(carrier_hz=carrier_hz)
        with device:
            device.write(np.linspace(0.0, 10.0, 4800))
    device.set_up(carrier_hz=5000.0)
    with device, pytest.raises(LimitError, match="5000 Hz"):
        device.write(np.linspace(0.0, 10.0, 4800))
    assert device.mock.faults == 0


def test_what_the_driver_is_told():
    device = mock_device(DriveLimits(ceiling_v=150.0))
    device.set_up(lead_s=0.01, watchdog_s=0.1)
    assert device.watchdog_s == 0.1
    device.arm()
    with pytest.raises(DeviceError, match="set-up is fixed"):
        device.set_up(lead_s=0.0)
    # A host that forgets its own ceiling meets the lowered one in the driver.
    object.__setattr__(device.limits, "ceiling_v", 200.0)
    with pytest.raises(DeviceFaultError, match="ceiling of 150 V"):
        device.write([75.0, 151.0])
    assert not device.mock.output[0].any()


def test_touches_come_with_what_else_the_driver_says():
    device = mock_device()
    device.mock.touch(12.0, 34.5, 0.5)
    device.mock.touch(13.0, 34.5)
    with device:
        device.write([1.0])
    first, second = device.touches()
    assert (first.x_um, first.y_um, first.normal_force_mn) == (12_000, 34_500, 500)
    assert (second.x_um, second.normal_force_mn) == (13_000, 65_535)
    assert device.touches() == []


def test_progress(clock):
    device = Device(MockLink(MockDriver(pace="real", clock=clock)), clock=clock)
    device.arm()
    device.write(np.zeros(1000))
    clock.sleep(0.025 + 500 / 48e3)
    progress = device.progress()
    assert (progress.samples_sent, progress.samples_played) == (1000, 0)  # nothing was said yet
    progress = device.progress(is_fresh=True)
    assert progress.samples_played == pytest.approx(500, abs=1)
    assert progress.is_playing


def test_a_driver_that_was_reset_is_set_up_anew():
    device = mock_device(DriveLimits(ceiling_v=120.0))
    with device:
        device.write([1.0])
    device.mock.release()
    with device:
        device.write([2.0])
    assert device.mock.faults == 0


def test_a_driver_whose_clock_stands_is_told(clock):
    device = Device(
        MockLink(MockDriver(pace="real", clock=lambda: 0.0), sleep=clock.sleep), clock=clock
    )
    device.arm()
    with pytest.raises(DeviceError, match="clock has stopped"):
        device.write(np.zeros(48_000))
