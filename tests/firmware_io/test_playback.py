"""Real-time playback, on a clock that is moved by hand: nothing here waits."""

import numpy as np
import pytest

from firmware_io import (
    Device,
    DeviceError,
    DeviceFaultError,
    LimitError,
    MockDriver,
    MockLink,
    Playback,
    open_device,
    volts_to_codes,
)
from firmware_io.firmware.core import Output

RATE = 48_000
BLOCK = 48  # a millisecond


def device_on(clock, drift_ppm=0.0, report_bytes=None, **setting):
    """A mock whose clock runs faster than the host's by so much."""
    start_s = clock()
    driver = MockDriver(
        pace="real", clock=lambda: start_s + (clock() - start_s) * (1 + drift_ppm * 1e-6)
    )
    return Device(MockLink(driver, report_bytes, clock.sleep), clock=clock, **setting)


def sine(seconds, amplitude_v=150.0, frequency_hz=1000.0):
    return amplitude_v * np.sin(2 * np.pi * frequency_hz * np.arange(round(seconds * RATE)) / RATE)


def play(playback, volts, block=BLOCK):
    for start in range(0, volts.size, block):
        piece = volts[start : start + block]
        assert playback.wait_for_room(piece.size)
        playback.put(piece)


def streamed(driver):
    """What was played as stream, without the silence around it."""
    codes, what = driver.output
    codes = codes[what == Output.STREAM]
    there = np.flatnonzero(codes)
    return codes[there[0] : there[-1] + 1] if there.size else codes[:0]


def pass_time(clock, playback, seconds, step_s=0.0005):
    """Let time pass while the playback does what is due and nothing is put."""
    for _ in range(round(seconds / step_s)):
        clock.sleep(step_s)
        playback.wait_for_room(0)


@pytest.mark.parametrize("lead_s", [0.005, 0.025, 0.2])
@pytest.mark.parametrize("block", [1, 48, 100])
def test_every_sample_is_played_and_none_twice(clock, lead_s, block):
    volts = sine(0.1)
    device = device_on(clock)
    with Playback(device, lead_s, clock=clock) as playback:
        play(playback, volts, block)
        assert playback.stats.underruns == 0
    # The sine begins with one zero, and the ramp that ends it follows.
    wanted = volts_to_codes(volts, 250.0)[1:]
    np.testing.assert_array_equal(streamed(device.mock)[: wanted.size], wanted)
    assert device.mock.played_codes[-1] == 0
    assert not device.is_armed
    assert device.mock.faults == 0


@pytest.mark.parametrize("drift_ppm", [-500.0, 0.0, 500.0])
def test_the_delay_is_the_lead_and_does_not_grow(clock, drift_ppm):
    device = device_on(clock, drift_ppm)
    lead = round(0.025 * RATE)
    with Playback(device, clock=clock) as playback:
        delays = []
        for second in range(3):
            play(playback, sine(1.0), 2 * BLOCK)
            assert playback.queued_samples <= lead
            # Asked of the driver itself, not of the host's reckoning of it.
            delays.append(playback.samples_put - device.mock.status.samples_played)
            assert playback.stats.underruns == 0, second
        # Silence at the start is played as well, so the difference is the lead less a constant;
        # it may move by the block, and by what the driver has played since it reported last.
        assert np.ptp(delays[1:]) <= 3 * BLOCK + 0.005 * RATE
        stats = playback.stats
    # Counts are whole samples: 1 / (3 s * 48 kHz) is 7 ppm.
    assert stats.drift_ppm == pytest.approx(drift_ppm, abs=14.0)
    assert stats.device_rate_hz == pytest.approx(RATE * (1 + drift_ppm * 1e-6), rel=14e-6)


def test_drift_is_unknown_at_first(clock):
    with Playback(device_on(clock), clock=clock) as playback:
        play(playback, sine(0.5))
        assert playback.stats.device_rate_hz is None
        assert playback.stats.drift_ppm is None


def test_starving_ramps_to_zero_and_fades_in(clock):
    device = device_on(clock)
    with Playback(device, clock=clock) as playback:
        play(playback, sine(0.1))
        pass_time(clock, playback, 0.2)
        assert playback.stats.underruns == 1
        assert device.is_armed  # fed with 0 V, so that the watchdog sleeps
        assert device.last_v == 0.0
        play(playback, sine(0.1))
        stats = playback.stats
    assert (stats.underruns, stats.late_blocks) == (1, 1)
    assert stats.samples_played == round(0.2 * RATE)
    assert device.mock.faults == device.mock.underruns == 0
    codes, _what = device.mock.output
    volts = codes * (250.0 / 32767)
    # No step is larger than the signal's own: 150 V * 2 pi / 48.
    assert np.abs(np.diff(volts)).max() <= 150.0 * 2 * np.pi / 48 + 0.02
    silence = np.flatnonzero(volts != 0.0)
    gaps = np.diff(silence)
    assert gaps.max() > 0.15 * RATE  # it was silent meanwhile
    returned = silence[gaps.argmax() + 1]
    first_ms = np.abs(volts[returned : returned + BLOCK]).max()
    assert first_ms < 0.25 * 150.0  # after 1 of the 5 ms of the fade


def test_a_signal_that_has_come_to_rest_does_not_starve(clock):
    device = device_on(clock)
    with Playback(device, clock=clock) as playback:
        play(playback, np.r_[sine(0.1), np.zeros(2)])
        pass_time(clock, playback, 0.3)
        play(playback, sine(0.1))
        stats = playback.stats
    assert (stats.underruns, stats.late_blocks) == (0, 0)
    # And so it is played as it is, without a fade.
    tail = volts_to_codes(sine(0.1), 250.0)[1:]
    played = device.mock.output[0]
    began = np.flatnonzero(played[:-1] == 0)
    start = next(i for i in began if i > 0.2 * RATE and played[i + 1])  # after the pause
    np.testing.assert_array_equal(played[start + 1 :][: tail.size], tail)


def test_a_stall_shorter_than_the_lead_is_not_felt(clock):
    device = device_on(clock)
    volts = sine(0.5)
    with Playback(device, clock=clock) as playback:
        for start in range(0, volts.size, BLOCK):
            if start % (100 * BLOCK) == 50 * BLOCK:
                clock.sleep(0.010)  # neither side of the host does anything
            assert playback.wait_for_room(BLOCK)
            playback.put(volts[start : start + BLOCK])
        assert playback.stats.underruns == 0
    assert device.mock.underruns == 0


@pytest.mark.parametrize("report_bytes", [None, 64], ids=["bytes", "HID reports"])
def test_stalls_of_10_ms_on_both_sides_at_a_lead_of_25_ms(clock, report_bytes):
    device = device_on(clock, report_bytes=report_bytes)
    rate_hz = round(device.capabilities.sample_rate_hz)
    block = device.least_write_samples if report_bytes else BLOCK
    # On one clock the two stalls come one after the other, 20 ms in all at 3.5 s.
    link_every, maker_every = rate_hz // 2 // block, rate_hz * 7 // 10 // block
    with Playback(device, clock=clock) as playback:
        for number in range(5 * rate_hz // block):
            if number % link_every == link_every - 1:
                device._stream.link.inject("stall", 0, 0.010)
            if number % maker_every == maker_every - 1:
                clock.sleep(0.010)
            play(playback, np.full(block, 50.0) if report_bytes else sine(block / rate_hz), block)
        assert playback.stats.underruns == playback.stats.late_blocks == 0
    assert device.mock.underruns == device.mock.faults == 0


def test_a_stall_longer_than_the_lead_is_counted(clock):
    device = device_on(clock)
    with Playback(device, clock=clock) as playback:
        play(playback, sine(0.1))
        clock.sleep(0.04)
        play(playback, sine(0.1))
        assert playback.stats.underruns == 1
    assert device.mock.underruns == 1


def test_stopping_without_draining_ramps_at_once(clock):
    device = device_on(clock)
    playback = Playback(device, clock=clock)
    playback.start()
    play(playback, sine(0.1))
    began_s = clock()
    playback.stop(drain=False)
    clock.sleep(0.006)  # the driver's own ramp takes 5 ms
    assert device.mock.output[0][-1] == 0
    assert clock() - began_s < 0.010
    assert device.mock.status.queued_samples == 0


def test_an_error_in_the_context_stops_at_once(clock):
    device = device_on(clock)
    with pytest.raises(KeyError), Playback(device, clock=clock) as playback:
        play(playback, sine(0.1))
        raise KeyError("mine")
    assert not device.is_armed
    assert not playback.is_running
    assert playback.error is None


def test_a_limit_is_told_once_and_ends_at_zero(clock):
    device = device_on(clock)
    playback = Playback(device, clock=clock)
    playback.start()
    with pytest.raises(LimitError, match="ceiling"):
        play(playback, np.r_[sine(0.05), 201.0, sine(0.1)])
    assert isinstance(playback.error, LimitError)
    assert not playback.is_running
    assert playback.room_samples == 0
    with pytest.raises(DeviceError, match="does not run"):
        playback.put(np.zeros(1))
    playback.stop()
    clock.sleep(0.006)
    assert device.mock.output[0][-1] == 0
    assert np.abs(device.mock.output_v).max() <= 150.0 + 0.004
    playback.start()
    play(playback, sine(0.05))
    playback.stop()
    assert playback.error is None


def test_a_device_fault_is_told_once(clock):
    device = device_on(clock)
    with (
        pytest.raises(DeviceFaultError, match="came damaged"),
        Playback(device, clock=clock) as playback,
    ):
        play(playback, sine(0.05))
        device._stream.link.inject("corrupt")
        play(playback, sine(0.05))
    assert device.mock.output[0][-1] == 0


def test_too_much_is_refused_whole(clock):
    with Playback(device_on(clock), clock=clock) as playback:
        before = playback.room_samples
        with pytest.raises(DeviceError, match=r"There is room for \d+ samples, but 9999 came"):
            playback.put(np.zeros(9999))
        assert playback.room_samples == before
        with pytest.raises(DeviceError, match="lead holds 1200 samples"):
            playback.wait_for_room(1201)


def test_room_runs_out_and_comes_back(clock):
    with Playback(device_on(clock), clock=clock) as playback:
        assert playback.wait_for_room(1000)
        playback.put(sine(1000 / RATE))
        assert not playback.wait_for_room(1000, timeout_s=0.001)
        assert playback.wait_for_room(1000, timeout_s=0.1)


@pytest.mark.parametrize("volts", [5.0, [[1.0]], ["1"], [1j]])
def test_what_is_no_row_of_numbers(clock, volts):
    with (
        Playback(device_on(clock), clock=clock) as playback,
        pytest.raises(DeviceError, match="1-D array of real numbers"),
    ):
        playback.put(volts)


@pytest.mark.parametrize("times", [(0.0,), (2.0,), (np.nan,), (0.025, 0.0), (0.025, 0.01)])
def test_impossible_times(clock, times):
    with pytest.raises(DeviceError, match="_s must"):
        Playback(device_on(clock), *times, clock=clock)


def test_only_while_it_runs(clock):
    device = device_on(clock)
    playback = Playback(device, clock=clock)
    for call in (lambda: playback.put(np.zeros(1)), lambda: playback.wait_for_room(1)):
        with pytest.raises(DeviceError, match="does not run"):
            call()
    assert playback.stats.samples_played == playback.queued_samples == playback.room_samples == 0
    playback.stop()
    playback.start()
    playback.start()
    playback.stop()
    playback.stop()
    assert not device.is_armed


def test_a_mock_without_time_is_refused():
    with pytest.raises(DeviceError, match="mock:pace=real"):
        Playback(open_device("mock:"))


def test_envelopes_through_reports(clock):
    device = device_on(clock, report_bytes=64)
    assert (device.mode, device.capabilities.sample_rate_hz) == ("envelope", 16_000)
    envelope = 75.0 * (1.0 - np.cos(2 * np.pi * 10.0 * np.arange(8000) / 16_000))
    with Playback(device, clock=clock) as playback:
        play(playback, envelope, 83)
        assert playback.stats.underruns == 0
        # Whole frames of three reports, so that less than 15 % of what is sent is no sample.
        assert device.least_write_samples == 83
    assert device.mock.faults == device.mock.underruns == 0
    played = device.mock.output_v
    # The carrier of 4 kHz has a sample of the output at its crest in every period of 12.
    crests = np.abs(played[: played.size // 12 * 12]).reshape(-1, 12).max(axis=1)
    # Between two amplitudes, 62 microseconds apart, the envelope moves by 0.3 V.
    assert crests.max() == pytest.approx(150.0, abs=0.5)
    assert played[-1] == 0.0


def stalling(clock, lead_s, stall_s):
    """Play two seconds whose producer stalls once, when the lead is full."""
    device = device_on(clock)
    volts = sine(2.0)
    with Playback(device, lead_s, clock=clock) as playback:
        for start in range(0, volts.size, 4 * BLOCK):
            if start == 400 * 4 * BLOCK:
                pass_time(clock, playback, stall_s)
            piece = volts[start : start + 4 * BLOCK]
            assert playback.wait_for_room(piece.size)
            playback.put(piece)
        return playback.stats


@pytest.mark.parametrize(
    ("lead_s", "over_s"), [(0.013, 0.004), (0.013, 0.04), (0.025, 0.004), (0.025, 0.4), (0.1, 0.04)]
)
def test_the_lead_that_is_advised_holds_the_same_stall(clock, lead_s, over_s):
    stall_s = lead_s + over_s
    found = stalling(clock, lead_s, stall_s)
    assert (found.underruns, found.late_blocks) == (1, 1)
    # The stall is the time without a put, less up to a block that was there before.
    assert found.stall_s == pytest.approx(stall_s, abs=0.2 * lead_s + 0.006)
    assert stalling(clock, found.holding_lead_s, stall_s).underruns == 0
    # Not longer than needed: what the block and the guard of an eighth take, and little more.
    assert found.holding_lead_s < (stall_s + 0.006) * 8 / 7 * 1.2 + 0.003
    for part in ("1 underruns", "1 late blocks", f"{found.holding_lead_s * 1e3:.0f} ms would"):
        assert part in found.advice


def test_a_lead_that_holds_needs_no_advice(clock):
    found = stalling(clock, 0.05, 0.02)
    assert (found.stall_s, found.holding_lead_s, found.advice) == (0.0, None, "")
    assert str(found).endswith("0 underruns, 0 late blocks") or "drift" in str(found)


def test_no_lead_holds_a_stall_of_seconds(clock):
    assert "no lead up to 1 s" in stalling(clock, 0.025, 2.0).advice


def test_a_thread_that_sleeps_over_its_time_is_seen(clock):
    device = device_on(clock)
    with Playback(device, 0.025, clock=clock) as playback:
        play(playback, sine(0.2))
        clock.sleep(0.1)  # neither side does anything; the driver runs dry by itself
        playback.put(sine(0.004))  # the producer is back first
        pass_time(clock, playback, 0.01)
        play(playback, sine(0.2))
        found = playback.stats
    assert found.underruns >= 1
    assert found.stall_s == pytest.approx(0.1, abs=0.03)
    assert "\n" not in str(found) and len(str(found)) < 400
