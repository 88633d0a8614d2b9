"""The ring between two threads, and the driver's clock, against plain reckoning."""

from collections import deque

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_io import DeviceError
from firmware_io.device_clock import DeviceClock
from firmware_io.ring import SampleRing


@given(st.integers(1, 20), st.lists(st.tuples(st.booleans(), st.integers(0, 25)), max_size=60))
def test_the_ring_is_a_queue(capacity, moves):
    ring, queue, next_value = SampleRing(capacity), deque(), 0.0
    for puts, count in moves:
        if puts:
            values = np.arange(next_value, next_value + count)
            if count > capacity - len(queue):
                with pytest.raises(DeviceError, match="There is room for"):
                    ring.put(values)
                continue
            ring.put(values)
            queue.extend(values)
            next_value += count
        else:
            count = min(count, len(queue))
            np.testing.assert_array_equal(ring.take(count), [queue.popleft() for _ in range(count)])
        assert (ring.queued, ring.room) == (len(queue), capacity - len(queue))


@pytest.mark.parametrize("drift_ppm", [-300.0, 0.0, 40.0])
def test_late_reports_do_not_spoil_the_rate(drift_ppm):
    # A report every 5 ms for 30 s, each late by 0 to 5 ms, and a tenth of them by up to 50 ms.
    rng = np.random.default_rng(5)
    clock = DeviceClock(48_000.0)
    sent_s = np.arange(0.0, 30.0, 0.005)
    late_s = rng.uniform(0.0, 0.005, sent_s.size)
    late_s += (rng.random(sent_s.size) < 0.1) * rng.uniform(0.0, 0.05, sent_s.size)
    came_s = np.maximum.accumulate(sent_s + late_s)  # one line: none overtakes another
    for host_s, at_s in zip(came_s, sent_s, strict=True):
        clock.observe(host_s, np.floor(at_s * 48_000.0 * (1 + drift_ppm * 1e-6)))
    # The least late of the 100 reports in half a second is late by some 0.05 ms, give or take as
    # much; over 60 of them in 30 s the slope is known to 0.05 ms * sqrt(12 / 60) / 30 s, 0.8 ppm.
    assert clock.drift_ppm == pytest.approx(drift_ppm, abs=5 * 0.8)
    assert clock.rate_hz == pytest.approx(48_000.0 * (1 + clock.drift_ppm * 1e-6))


def test_one_minute_is_remembered():
    clock = DeviceClock(1000.0)
    for second in np.arange(0.0, 200.0, 0.5):
        rate_hz = 1000.0 if second < 100.0 else 1001.0
        clock.observe(second, 100_000.0 + (second - 100.0) * rate_hz)
    assert clock.drift_ppm == pytest.approx(1000.0, abs=1e-3)


def test_a_report_that_is_seen_twice_counts_once():
    clock = DeviceClock(1000.0)
    for _ in range(5):
        clock.observe(1.0, 1000.0)
    clock.observe(0.5, 0.0)
    assert clock.rate_hz is None
