"""Samples that a host revises while they wait in the driver."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_io import Device, DeviceError, DeviceFaultError, LimitError, MockDriver, MockLink
from firmware_io.firmware.core import Output
from firmware_io.protocol import volts_to_codes
from firmware_io.revisable import Revisable
from tests.links import stream_of

RATE = 48_000
GUARD = 16


class StandingMock(MockDriver):
    """Its time passes only when told."""

    def _play_out(self):
        pass


def opened(**how):
    driver = StandingMock()
    return Device(MockLink(driver), **how), driver


def played(driver):
    codes, what = driver.output
    return codes[what == Output.STREAM]


def begin(device, driver):
    """Armed, with 20 ms of 0 V queued."""
    device.set_up(lead_s=0.0)
    device.arm(revisable=True)
    device.write(np.zeros(RATE // 50))


def know(device):
    """Read how far the driver is."""
    return device.progress(is_fresh=True)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("mode", ["waveform", "envelope"])
def test_what_is_played_is_what_the_host_holds_true(seed, mode):
    """Whatever is late, appended or revised again: the host's record is the driver's output."""
    rng = np.random.default_rng(seed)
    device, driver = opened(mode=mode)
    begin(device, driver)
    rate = device.capabilities.sample_rate_hz
    undone = 0
    for _ in range(150):
        queued = stream_of(device).provisional.queue
        kind, size = rng.integers(4), int(rng.integers(1, 200))
        # Alternating, so that no mean builds up; in steps below the slew limit's 97 V.
        volts = np.full(size, 40.0 * rng.random())
        volts[::2] *= 1 if mode == "envelope" else -1
        if kind == 0 and queued.values.size < 3000:
            device.write(volts)
        elif kind < 3 and queued.values.size > 300:
            first = queued.first + 1 + int(0.8e-3 * rng.random() * rate)
            volts = volts[: queued.end - first - 1]
            device.revise(first, volts)
        else:
            driver.advance(rng.choice([0.0, 0.0003, 0.002]))
        if rng.random() < 0.3:
            undone = know(device).revisions_undone
    before = know(device)
    assert before.revisions > 5
    assert undone > 5
    believed = stream_of(device).provisional.queue.values.copy()
    driver.advance(believed.size / rate)
    ticks = round(RATE / rate)
    codes = driver.output[0][-believed.size * ticks :]
    if mode == "waveform":
        assert np.array_equal(codes, volts_to_codes(believed, 250.0))
    else:  # 3 codes: those of amplitude, line and sine, rounded one after the other
        stream = stream_of(device)
        driven = stream.checks.driven(
            believed, stream.provisional.queue.first, stream.provisional.before_v
        )
        # The line to the oldest sample has begun before the report.
        assert np.abs(codes - driven * 32767 / 250)[ticks:].max() <= 3
    assert driver.faults == 0


def test_late_revisions_are_taken_back_and_the_next_one_counts():
    device, driver = opened()
    begin(device, driver)
    driver.advance(0.005)  # unknown to the host
    device.revise(200, np.full(10, 5.0))  # late
    device.revise(300, np.full(10, 6.0))  # refused with it
    assert know(device).revisions_undone == 2
    device.revise(300, np.full(10, 7.0))
    progress = know(device)
    assert (progress.revisions, progress.revisions_undone) == (1, 2)
    assert progress.margin_samples == 300 - 240
    driver.advance(0.015)
    out = played(driver)
    assert np.flatnonzero(out).tolist() == list(range(300, 310))


def test_two_refusals_under_way_are_told_apart():
    """A report may come between those that a refusal takes with it."""
    device, driver = opened()
    begin(device, driver)
    driver.advance(0.005)
    device.revise(100, np.full(10, 5.0))
    assert know(device).revisions_undone == 1
    device.revise(400, np.full(10, 6.0))
    device.revise(240 + GUARD - 1, np.full(10, 5.0))
    device.revise(500, np.full(10, 6.0))
    assert know(device).revisions_undone == 3
    device.revise(240 + GUARD, np.full(10, 8.0))
    assert know(device).revisions == 2
    assert driver.faults == 0


def test_limits_hold_over_both_seams():
    device, driver = opened()
    for first, volts in ((300, [200.1]), (300, [98.0]), (300, [90.0, 98.0])):
        begin(device, driver)  # 97 V a sample
        with pytest.raises(LimitError):
            device.revise(first, np.array(volts))
        assert not device.is_armed
    begin(device, driver)
    device.write(np.full(100, 90.0))
    with pytest.raises(LimitError, match=r"98.0* V|-8"):
        device.revise(951, np.full(9, -8.0))


def test_the_mean_counts_what_will_be_played():
    """A queue that would break the mean is revised to one that does not, and the other way."""
    device, driver = opened()
    begin(device, driver)
    with pytest.raises(LimitError, match="mean"):
        for _ in range(4):
            device.write(np.full(2000, 90.0))
            device.write(np.full(500, 90.0))
            driver.advance(0.03)
            know(device)
    device, driver = opened()
    begin(device, driver)
    device.write(np.full(500, 1.0))
    device.write(np.full(2000, 90.0))
    for first in (1500, 2400):
        device.revise(first, np.full(900, 0.5))
    device.write(np.full(2000, 90.0))
    assert driver.faults == 0


def test_what_cannot_be_revised_is_refused():
    device, driver = opened()
    with pytest.raises(DeviceError, match="armed"):
        device.revise(0, np.zeros(1))
    device.arm()
    with pytest.raises(DeviceError, match="revisable=True"):
        device.revise(0, np.zeros(1))
    for first, count in ((0, 5), (955, 5), (2000, 1), (10, 1025), (10, 0)):
        begin(device, driver)
        with pytest.raises(DeviceError, match="came"):
            device.revise(first, np.zeros(count))


def test_a_fault_while_revising_is_raised_once():
    device, driver = opened()
    begin(device, driver)
    driver.advance(0.3)  # starved
    with pytest.raises(DeviceFaultError):
        for _ in range(3):
            device.revise(900, np.zeros(10))
            know(device)
    assert not device.is_armed


changes = st.lists(
    st.tuples(st.sampled_from("adrux"), st.integers(0, 30), st.integers(1, 10)), max_size=40
)


@settings(deadline=None, max_examples=200)
@given(changes)
def test_undone_replacements_leave_what_was_there(steps):
    """Against a queue that keeps the whole history of each index."""
    queue, histories, pending, first, value = Revisable(), [], [], 0, 0.0
    for kind, where, count in steps:
        value += 1.0
        if kind == "a":
            queue.append(np.full(count, value))
            histories += [[value] for _ in range(count)]
        elif kind == "r" and len(histories) - first >= count:
            start = first + where % (len(histories) - first - count + 1)
            queue.replace(start, np.full(count, value))
            pending.append((start, count))
            for index in range(start, start + count):
                histories[index].append(value)
        elif kind == "d":
            gone = queue.drop_before(first + count).tolist()
            end = min(first + count, len(histories))
            late = [sum(i in range(s, s + n) for s, n in pending) for i in range(first, end)]
            assert gone == [histories[first + k][-1 - late[k]] for k in range(len(late))]
            first = end
        elif kind == "u":
            assert queue.undo() == len(pending)
            for start, size in pending:
                for index in range(start, start + size):
                    histories[index].pop()
            pending = []
        elif kind == "x" and pending:
            # The oldest becomes final: what it covered is gone.
            queue.accept(1)
            start, size = pending.pop(0)
            for index in range(start, start + size):
                del histories[index][-1 - sum(index in range(s, s + n) for s, n in pending) - 1]
        assert queue.first == first
        assert queue.values.tolist() == [history[-1] for history in histories[first:]]
