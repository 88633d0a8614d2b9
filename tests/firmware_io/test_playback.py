"""Playing far ahead and revising what waits: against a mock whose clock a test moves."""

from collections import deque

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
    ProtocolError,
    WaveSource,
    open_device,
    volts_to_codes,
)
from firmware_io.firmware.core import Output
from firmware_io.progress import OutputClock
from firmware_io.revisable import Revisable
from tests.faulty_link import FaultyLink
from tests.links import stream_of
from tests.steady_clock import steady_driver
from tests.waiting import pause, wait_for

RATE = 48_000
TICK_S = 5e-4


class Levels:
    """A source whose voltage is the level that holds when a sample is made, in steps of 4.

    It keeps what it has made, as a renderer does, so that revisions meet what is queued.
    """

    grid = 4

    def __init__(self, is_live=True):
        self.level = 1.0
        self.is_live = is_live
        self.made = Revisable()
        self.made.append(np.zeros(self.grid))
        self.asked = []
        self.error = None

    def window(self, first, count, at_s, is_revision):
        if self.error is not None:
            raise self.error
        assert first % self.grid == count % self.grid == 0
        self.asked.append((first, count, at_s, is_revision))
        # Alternating, so that no mean builds up.
        volts = self.level * (1 - 2 * (np.arange(first, first + count) % 2))
        if is_revision:
            self.made.replace(first + self.grid, volts)
        else:
            assert first + self.grid == self.made.end
            self.made.append(volts)
        return volts

    def settle(self, obeyed, undone):
        self.made.accept(obeyed)
        if undone:
            self.made.undo()

    def played(self, index):
        self.made.drop_before(index)


@pytest.fixture
def rig(clock):
    return begun(clock)


def begun(clock, horizon_s=0.1):
    driver = MockDriver(pace="real", clock=clock)
    link = FaultyLink(driver, sleep=clock.sleep)
    device = Device(link, clock=clock)
    source = Levels()
    playback = Playback(device, source, horizon_s=horizon_s)
    playback.start()
    return playback, source, driver, link


def run(playback, clock, seconds, step_s=TICK_S):
    end_s = clock() + seconds
    while clock() < end_s - 1e-9:
        wait_s = playback.step()
        clock.sleep(min(max(wait_s, 1e-5), step_s))


def streamed(driver):
    codes, what = driver.output
    return codes[what == Output.STREAM]


def test_a_touch_is_played_after_the_reaction_and_not_after_the_queue(rig, clock):
    playback, source, driver, _ = rig
    run(playback, clock, 0.2)
    for turn in range(2, 20):
        before = driver.samples_played
        source.level = float(turn)
        playback.touch()
        run(playback, clock, 0.0101 if turn % 3 == 0 else 0.0303)
        out = np.abs(streamed(driver)[before:])
        # 3 ms, less a step of the source. A revision without a touch, every 15 ms, may have come
        # 2.5 ms before.
        latest_s = 0.003 if turn % 3 == 1 else 0.0055
        first = int((out == np.abs(volts_to_codes(turn, 250.0))).argmax())
        assert out[first:].max() == out[first:].min()
        assert 0.003 - 5 / RATE <= first / RATE <= latest_s + 1 / RATE
    stats = playback.stats
    assert stats.underruns == stats.refused == 0
    assert stats.late_samples <= 6 * 0.0025 * RATE
    assert stats.reaction_p50_s <= 0.003
    playback.stop()
    assert not driver.is_armed
    assert driver.faults == 0


@pytest.mark.parametrize("stall_s", [0.02, 0.1])
def test_a_stall_up_to_the_horizon_is_no_underrun(rig, clock, stall_s):
    playback, _, driver, _ = rig
    run(playback, clock, 0.3)
    for _ in range(5):
        clock.sleep(stall_s)
        run(playback, clock, 0.1)
    assert driver.underruns == playback.stats.underruns == 0
    # What it would have woken for in between is the stall.
    assert stall_s - 0.021 <= playback.stats.longest_stall_s <= stall_s
    playback.stop()


def test_a_stall_of_the_horizon_may_meet_a_shorter_one(rig, clock):
    """At any time between two pieces that are appended, or two reports."""
    playback, _, driver, _ = rig
    run(playback, clock, 0.3)
    for phase_s in np.arange(0.0, 0.04, 0.003):
        run(playback, clock, phase_s)
        clock.sleep(0.1)
        playback.step()
        clock.sleep(0.02)
        run(playback, clock, 0.06)
    assert driver.underruns == playback.stats.underruns == 0


def test_a_longer_stall_is_counted_and_what_follows_is_in_step(clock):
    """Longer than the horizon and the spare beyond it; the watchdog waits longer still."""
    playback, source, driver, _ = begun(clock, horizon_s=0.02)
    run(playback, clock, 0.3)
    clock.sleep(0.11)
    run(playback, clock, 0.3)
    assert driver.underruns == playback.stats.underruns == 1
    assert "horizon of 20 ms" in playback.stats.advice
    before = driver.samples_played
    source.level = 9.0
    playback.touch()
    run(playback, clock, 0.01)
    first = int((np.abs(streamed(driver)[before:]) > 1000).argmax())
    assert first / RATE <= 0.0035
    playback.stop()


def test_late_revisions_are_made_again_until_one_is_in_time(rig, clock):
    """The link delays each frame by 4 ms: reaction and source's record follow the driver."""
    playback, source, driver, link = rig
    run(playback, clock, 0.3)
    send = link.send

    def late(data):
        clock.sleep(0.004)
        send(data)

    link.send = late
    for turn in range(2, 40):
        source.level = float(turn)
        playback.touch()
        run(playback, clock, 0.02)
    stats = playback.stats
    assert stats.refused >= 1
    assert stats.late_samples > 0
    refused = stats.refused
    for turn in range(2, 20):
        source.level = float(turn)
        playback.touch()
        run(playback, clock, 0.02)
    assert playback.stats.refused - refused <= 3
    assert 0.004 < playback.stats.reaction_p50_s < 0.012
    # What the source believes is what the driver plays.
    link.send = send
    run(playback, clock, 0.02)
    stream = stream_of(playback.device)
    queued = stream.provisional.queue
    first = max(queued.first, source.made.first - 4)
    believed = source.made.values[first + 4 - source.made.first :]
    assert len(believed) > 4800
    assert np.array_equal(believed, queued.values[first - queued.first :])
    played = driver.samples_played
    clock.sleep(0.1)
    assert np.array_equal(
        streamed(driver)[played : played + 4800],
        volts_to_codes(queued.values[played - queued.first :][:4800], 250.0),
    )
    assert driver.faults == 0


def test_a_stall_does_not_slow_the_reactions_after_it(rig, clock):
    """No lead could have waited for it, so the next revision needs no more than the one before."""
    playback, source, _, link = rig
    run(playback, clock, 0.3)
    need_s = playback.writer.reviser.need_s
    for turn in range(2, 8):
        link.inject("stall", 0, 0.02)
        for step in range(12):
            source.level = turn + step / 20
            playback.touch()
            run(playback, clock, 0.01)
    stats = playback.stats
    assert stats.refused >= 6
    assert playback.writer.reviser.need_s == pytest.approx(need_s, abs=1e-4)
    assert stats.reaction_p50_s <= 0.003
    playback.stop()


def test_what_a_write_reads_is_known_before_the_next_revision(rig, clock, monkeypatch):
    """A refusal that is read while samples are appended counts for those sent before it alone."""
    playback, _, driver, link = rig
    playback.stop()
    source = Levels()
    playback = Playback(playback.device, source, horizon_s=0.04)
    playback.start()
    run(playback, clock, 0.3)
    write, receive, held = playback.device.write, link.receive, [True]

    def write_and_read(volts):
        write(volts)
        if held.pop():
            playback.device.progress(is_due=True)
            playback.touch()
        monkeypatch.setattr(playback.device, "write", write)

    link.receive = lambda timeout_s=0.0: b"" if held else receive(timeout_s)
    monkeypatch.setattr(playback.device, "write", write_and_read)
    link.inject("stall", 0, 0.004)
    source.level = 9.0
    playback.touch()
    run(playback, clock, 0.1)
    source.is_live = False
    run(playback, clock, 0.05)
    assert not held
    refused = playback.stats.refused
    assert refused in (1, 2)  # the late one, and one without a touch that was sent behind it
    revised = sum(is_revision for *_, is_revision in source.asked)
    assert playback.stats.revisions == revised - refused
    assert driver.faults == 0
    playback.stop()


def test_without_anything_live_nothing_is_revised(rig, clock):
    playback, source, _, _ = rig
    source.is_live = False
    run(playback, clock, 0.3)
    assert not any(is_revision for *_, is_revision in source.asked)
    source.is_live = True
    run(playback, clock, 0.3)
    assert 19 <= sum(is_revision for *_, is_revision in source.asked) <= 21
    playback.stop()


def test_the_time_of_a_window_is_when_it_is_played(rig, clock):
    playback, source, driver, _ = rig
    run(playback, clock, 0.5)
    origin_s = clock() - driver.samples_played / RATE
    for first, _, at_s, _ in source.asked[10:]:
        assert at_s == pytest.approx(origin_s + first / RATE, abs=2 / RATE)
    playback.stop()


def test_the_time_that_the_first_window_takes_moves_no_later_one(rig, clock, monkeypatch):
    playback, source, driver, _ = rig
    make = source.window

    def slow_at_first(first, count, at_s, is_revision):
        if first == 0:
            clock.sleep(0.004)
        return make(first, count, at_s, is_revision)

    monkeypatch.setattr(source, "window", slow_at_first)
    run(playback, clock, 0.05)  # longer than until the first report, of 20 ms
    source.asked.clear()
    run(playback, clock, 0.1)
    began = int((driver.output[1] == Output.STREAM).argmax())
    origin_s = clock() - len(driver.output[1]) / RATE + began / RATE
    revised = [(first, at_s) for first, _, at_s, is_revision in source.asked if is_revision]
    assert revised
    for first, at_s in revised:  # the driver plays whole samples
        assert at_s == pytest.approx(origin_s + first / RATE, abs=2 / RATE)
    playback.stop()


def test_an_error_of_the_source_ends_at_zero_and_is_raised_once(rig, clock):
    playback, source, driver, _ = rig
    run(playback, clock, 0.2)
    source.error = ValueError("broken")
    with pytest.raises(ValueError, match="broken"):
        run(playback, clock, 0.2)
    clock.sleep(0.01)
    assert not driver.is_armed
    assert driver.output[0][-1] == 0
    with pytest.raises(DeviceError, match="does not run"):
        playback.step()
    playback.stop()


def test_a_revision_above_the_limits_ends_at_zero(rig, clock):
    playback, source, driver, _ = rig
    run(playback, clock, 0.2)
    source.level = 150.0
    with pytest.raises(LimitError, match="slew"):
        run(playback, clock, 0.1)
    clock.sleep(0.01)
    assert driver.output[0][-1] == 0


def test_a_driver_that_starves_is_told(rig, clock):
    playback, _, driver, _ = rig
    run(playback, clock, 0.2)
    clock.sleep(0.5)
    assert driver.output[0][-1] == 0
    with pytest.raises(DeviceFaultError, match="starved"):
        run(playback, clock, 0.1)


@pytest.mark.parametrize("drift_ppm", [-500.0, 0.0, 500.0])
def test_clocks_that_drift_apart_cost_nothing(clock, drift_ppm):
    start_s = clock()
    driver = MockDriver(
        pace="real", clock=lambda: start_s + (clock() - start_s) * (1 + drift_ppm * 1e-6)
    )
    source = Levels()
    playback = Playback(Device(MockLink(driver, sleep=clock.sleep), clock=clock), source)
    playback.start()
    for turn in range(300):
        source.level = 1.0 + turn % 20
        playback.touch()
        run(playback, clock, 0.01)
    # The queue does not grow: as after the first second, less what a piece and a report move it.
    ahead = playback.stats.samples_played - driver.status.samples_played
    assert 0.1 * RATE < ahead < (0.1 + 0.085 + 0.04) * RATE
    # 500 ppm of the second over which reports are kept are 0.5 ms.
    assert playback.stats.reaction_max_s <= 0.003 + 0.0005
    assert playback.stats.underruns == driver.faults == 0
    playback.stop()


@pytest.mark.parametrize("report_bytes", [None, 64], ids=["bytes", "HID reports"])
def test_every_sample_of_a_signal_is_played_once(clock, report_bytes):
    driver = MockDriver(pace="real", clock=clock)
    link = FaultyLink(driver, report_bytes, clock.sleep)
    device = Device(link, clock=clock)
    rate_hz = device.capabilities.sample_rate_hz
    t = np.arange(round(2 * rate_hz)) / rate_hz
    wave = 150.0 * np.sin(2 * np.pi * 1000.0 * t)
    if report_bytes is not None:  # an envelope
        wave = 75.0 * (1.0 - np.cos(2 * np.pi * 10.0 * t))
    with Playback(device, WaveSource(lambda first, count: wave[first : first + count])) as playback:
        for turn in range(20):
            if turn == 10:
                link.inject("stall", 0, 0.010)
            playback.run_until(clock() + 0.05)
        assert playback.stats.underruns == playback.stats.revisions == 0
    assert driver.faults == driver.underruns == 0
    if report_bytes is None:
        played = streamed(driver)[: RATE // 2]
        np.testing.assert_array_equal(played, volts_to_codes(wave, 250.0)[: played.size])
    else:
        # The carrier of 4 kHz has a sample of the output at its crest in every period of 12, and
        # between two amplitudes the envelope moves by 0.3 V.
        assert np.abs(driver.output_v).max() == pytest.approx(150.0, abs=0.5)


def test_stopping_ramps_at_once(rig, clock):
    playback, source, driver, _ = rig
    source.level = 20.0
    run(playback, clock, 0.2)
    playback.stop()
    clock.sleep(0.006)  # the driver's own ramp takes 5 ms
    assert driver.output[0][-1] == 0
    assert driver.status.queued_samples == 0
    assert np.abs(np.diff(driver.output_v[-RATE // 100 :])).max() <= 40.0 + 0.01


def test_an_error_in_the_context_stops_at_once(rig, clock):
    playback, _, driver, _ = rig
    with pytest.raises(KeyError), playback:
        run(playback, clock, 0.1)
        raise KeyError("mine")
    assert not driver.is_armed
    assert not playback.is_running
    assert playback.error is None


def test_only_while_it_runs(rig):
    playback, *_ = rig
    playback.start()
    playback.stop()
    playback.stop()
    for call in (playback.step, playback.touch, lambda: playback.run_until(1e3)):
        with pytest.raises(DeviceError, match="does not run"):
            call()
    playback.start()
    assert playback.is_running
    playback.stop()


def test_a_mock_in_steps_plays_the_same_each_time():
    played = []
    for _ in range(2):
        device, source = open_device("mock:pace=stepped"), Levels()
        with Playback(device, source) as playback:
            for turn in range(30):
                source.level = float(turn)
                playback.touch()
                playback.run_until(turn / 100)
            assert playback.stats.reaction_max_s <= 0.003 + 1e-9
        played.append(device.mock.output)
    for one, other in zip(*played, strict=True):
        np.testing.assert_array_equal(one, other)
    assert played[0][0].any()


def test_a_mock_without_time_is_refused():
    with pytest.raises(DeviceError, match="mock:pace=real"):
        Playback(open_device("mock:"), Levels())


def test_times_out_of_range_and_drivers_that_cannot(clock):
    device = Device(MockLink(MockDriver(pace="real", clock=clock), sleep=clock.sleep), clock=clock)
    for wrong in ({"reaction_s": 0.0}, {"horizon_s": 1.0}, {"horizon_s": "long"}):
        with pytest.raises(DeviceError, match=next(iter(wrong))):
            Playback(device, Levels(), **wrong)
    object.__setattr__(device.capabilities, "guard_s", 0.0)
    with pytest.raises(DeviceError, match="cannot revise"):
        device.arm(revisable=True)


def test_in_reports_revisions_fit_the_bus(clock, monkeypatch):
    """8 kHz: 900 reports a second in all, four in a revision."""
    driver = MockDriver(pace="real", clock=clock)
    link = MockLink(driver, 64, sleep=clock.sleep)
    device = Device(link, sample_rate_hz=8000, clock=clock)
    source = Levels()
    source.level = 0.0
    playback = Playback(device, source, reaction_s=0.009)
    playback.start()
    sent = []
    receive = driver.receive_report

    def noted(report):
        sent.append(clock())
        receive(report)

    monkeypatch.setattr(driver, "receive_report", noted)
    for _ in range(150):
        playback.touch()
        run(playback, clock, 0.01)
    begins = np.array(sent)[len(sent) // 3 :]
    per_s = len(begins) / (begins[-1] - begins[0])
    assert 500 < per_s <= 900
    assert playback.stats.refused == 0
    assert playback.stats.reaction_p99_s <= 0.009
    playback.stop()


def test_reports_that_come_late_do_not_move_the_clock():
    rng = np.random.default_rng(0)
    output = OutputClock(48_000.0)
    host_s = np.cumsum(rng.random(400) * 0.01)
    for now_s in host_s:
        output.observe(now_s, 48_000 * (now_s - rng.exponential(0.003)))
    # Of a hundred reports in a second the best is late by 30 us on average.
    assert 0 <= output.time_of(0.0) < 3e-4
    assert output.time_of(output.played(7.0)) == pytest.approx(7.0)
    output.restart(20.0, 100.0)
    assert output.played(20.0) == pytest.approx(100.0)


@pytest.mark.usefixtures("no_thread_is_left")
def test_a_thread_of_its_own():
    """Real time, and what a caller may count on whatever the machine does."""
    driver = steady_driver()
    source = Levels()
    with Playback(Device(MockLink(driver)), source) as playback:

        def has_revised():
            playback.touch()
            pause(0.01)
            return playback.stats.revisions >= 3

        wait_for(has_revised)
        assert playback.stats.samples_played > 0
    assert not driver.is_armed


@pytest.mark.parametrize(("baud", "rate_hz"), [(3_000_000, 48_000), (921_600, 16_000)])
def test_a_slow_line_gets_a_rate_that_it_carries(monkeypatch, baud, rate_hz):
    monkeypatch.setattr(MockLink, "bytes_per_s", baud / 10)
    device = Device(MockLink(MockDriver()))
    assert device.capabilities.sample_rate_hz == rate_hz
    assert 2 * rate_hz < device.pace.bytes_per_s


def test_a_line_that_carries_no_rate_is_refused(monkeypatch):
    monkeypatch.setattr(MockLink, "bytes_per_s", 11_520.0)
    with pytest.raises(ProtocolError, match=r"waveform .*5184 Hz"):
        Device(MockLink(MockDriver()))


def test_a_clock_that_was_ahead_leads_to_no_revision_of_the_past(rig, clock, monkeypatch):
    """While the output stands, the host's clock of it runs on: revisions then look early."""
    playback, _, driver, _ = rig
    output, observe = playback.writer.reviser.output, OutputClock.observe
    run(playback, clock, 0.1)
    ahead = int(0.02 * RATE)
    monkeypatch.setattr(
        output, "observe", lambda at_s, played: observe(output, at_s, played + ahead)
    )
    for _ in range(60):
        playback.touch()
        run(playback, clock, 0.01)
    monkeypatch.setattr(output, "observe", lambda at_s, played: observe(output, at_s, played))
    output.restart(clock(), driver.samples_played)  # as after an underrun
    for _ in range(5):
        run(playback, clock, 0.004)
        playback.touch()
    assert playback.writer.reviser.need_s >= playback.device.capabilities.guard_s
    playback.stop()


class Line(MockLink):
    """Carries 3 Mbaud: what is sent arrives byte after byte."""

    bytes_per_s = 3e5

    def __init__(self, clock):
        super().__init__(MockDriver(pace="real", clock=clock), sleep=clock.sleep)
        self.hand, self.due, self.free_s = clock, deque(), 0.0

    def send(self, data):
        for at in range(0, len(data), 32):
            piece = data[at : at + 32]
            self.free_s = max(self.free_s, self.hand()) + len(piece) / self.bytes_per_s
            self.due.append((self.free_s, piece))
        self.pass_time()

    def receive(self, timeout_s=0.0):
        end_s = self.hand() + timeout_s
        while True:
            self.pass_time()
            data = super().receive(0.0)
            if data or self.hand() >= end_s:
                return data
            self.hand.sleep(1e-4)

    def pass_time(self):
        while self.due and self.due[0][0] <= self.hand():
            super().send(self.due.popleft()[1])


def test_a_slow_line_reacts_as_soon_as_its_bytes_allow(clock):
    """No touch waits for the budget of the one before, nor for bytes that were not in front."""
    device, source = Device(Line(clock), clock=clock), Levels()
    playback = Playback(device, source)
    playback.start()
    for turn in range(100):
        if turn == 50:  # it has learned what revisions need
            before = playback.stats.refused
        source.level = 1.0 + turn / 4
        playback.touch()
        run(playback, clock, 0.01)
    # A revision of 14 ms takes 4.6 ms, as do two pieces of 2 ms in front of it; 1 ms is of the
    # clock's steps.
    assert max(list(playback.stats.reactions_s)[-45:]) <= 0.0046 + 0.004 + 0.001
    assert playback.stats.refused - before <= 2
    assert playback.stats.underruns == device.mock.faults == 0
    playback.stop()
