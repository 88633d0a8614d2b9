"""A client's clock is followed within half its round trips, through drift and jumps."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from haptix.service.front.client_touches import ClientClock
from haptix.service.protocol.messages import Problem


def exchanges(clock, offset_s, drift, times, rng, start=1000.0):
    for t_s in times:
        out, back = rng.exponential(0.002, 2) + 1e-4
        client_s = t_s + out + offset_s + drift * (t_s + out - start)
        clock.add(t_s, t_s + out + back, client_s)


@settings(max_examples=30)
@given(st.floats(-1e9, 1e9), st.floats(-150e-6, 150e-6), st.integers(0, 1000))
def test_offset_and_drift_are_found(offset_s, drift, seed):
    clock, rng = ClientClock(), np.random.default_rng(seed)
    exchanges(clock, offset_s, drift, 1000.0 + np.arange(100) * 0.5, rng)
    true = 1049.5 + offset_s + drift * 49.5
    # The quickest quarter of the exchanges is off by less than 1 ms each; 1e9 s costs 1e-7 s.
    assert clock.client_s(1049.5) == pytest.approx(true, abs=1e-3, rel=0)
    assert clock.service_s(true) == pytest.approx(1049.5, abs=1e-3, rel=0)


def test_a_jump_is_followed_after_three_answers():
    clock, rng = ClientClock(), np.random.default_rng(0)
    exchanges(clock, 5.0, 0.0, 1000.0 + np.arange(20) * 0.1, rng)
    for n in range(3):
        assert clock.jumps == 0
        jumped = clock.add(1010.0 + n, 1010.001 + n, 1010.0005 + n + 65.0)
        assert jumped == (n == 2)
    assert clock.jumps == 1
    assert clock.client_s(1012.0) == pytest.approx(1077.0, abs=1e-3)


@pytest.mark.parametrize(
    ("stamp_s", "is_good"),
    [
        (2000.0, True),
        (1999.6, True),
        (2000.004, True),
        (1999.4, False),
        (2000.02, False),
        (2e6, False),
    ],
)
def test_stamps_of_no_clock_are_refused(stamp_s, is_good):
    clock = ClientClock()
    with pytest.raises(Problem, match="not compared"):
        clock.stamp(2000.0, 2000.0)
    for _ in range(8):
        clock.add(1990.0, 1990.002, 1990.001)
    if is_good:
        assert clock.stamp(stamp_s, 2000.0) == pytest.approx(stamp_s, abs=1e-3)
    else:
        with pytest.raises(Problem, match="same clock") as caught:
            clock.stamp(stamp_s, 2000.0)
        assert (caught.value.code, caught.value.path) == ("clock", "/t_s")


def test_a_stamp_of_now_is_taken_however_slow_the_first_answers_were():
    # A client that is being made ready answers late: its clock seems behind by half the delay.
    clock = ClientClock()
    for trip_s in (0.001, 0.06, 0.06, 0.06):
        clock.add(1990.0, 1990.0 + trip_s, 1990.0)
    assert clock.stamp(1991.0, 1991.0) == pytest.approx(1991.0, abs=clock.error_s + 1e-6)


def test_quick_answers_after_slow_ones_are_no_jump():
    """A busy machine answers the first pings late, all of the delay on one way."""
    clock = ClientClock()
    for n in range(8):
        clock.add(1990.0 + n, 1990.2 + n, 1990.0 + n)
    for n in range(20):
        assert not clock.add(2000.0 + n, 2000.001 + n, 2000.0005 + n)
    assert clock.client_s(2020.0) == pytest.approx(2020.0, abs=1e-3)
    for n in range(3):
        clock.add(2030.0 + n, 2030.001 + n, 2031.0 + n)
    assert clock.jumps == 1  # a true one is seen as soon


@pytest.mark.parametrize("off_s", [-0.501, -0.499, 0.0, 0.0049, 0.0071])
def test_the_window_is_that_of_the_stamps(off_s):
    clock = ClientClock()
    for number in range(40):  # 100 ppm fast
        at_s = 1000.0 + number
        clock.add(at_s, at_s + 0.002, 7000.0 + 1.0001 * (at_s + 0.001))
    now_s = 1041.0
    stamp_s = clock.client_s(now_s + off_s)
    oldest_s, newest_s = clock.window(now_s)
    if oldest_s <= stamp_s <= newest_s:
        assert -0.5 <= off_s <= 0.0061
        assert clock.stamp(stamp_s, now_s) == pytest.approx(now_s + off_s, abs=1e-6)
    else:
        assert not -0.5 <= off_s <= 0.0059
        with pytest.raises(Problem):
            clock.stamp(stamp_s, now_s)
