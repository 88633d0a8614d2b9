"""Stamps that cannot be, and an app's clock on the renderer's."""

import math
import time
from itertools import count

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptix import InputError
from haptix.play.touch import AppClock, PanelClock, TouchCounts, Touches, TouchEvent, TouchSettings

NOW_S = 5000.0


def event(t_s, kind="move"):
    return TouchEvent(t_s, 0, 1.0, 2.0, kind)


@given(st.floats(-1, 1), st.floats(0, 0.5), st.booleans())
def test_one_rule_for_what_a_stamp_may_be(late_s, uncertainty_s, strict):
    settings = TouchSettings(clock_uncertainty_s=uncertainty_s)
    touches = Touches(settings, strict)
    margin_s = 0.02 + uncertainty_s
    if min(abs(late_s + margin_s), abs(late_s - settings.lost_after_s - margin_s)) < 1e-9:
        return  # rounding decides
    future = late_s < -margin_s
    stale = late_s > settings.lost_after_s + margin_s
    if strict and (future or stale):
        with pytest.raises(InputError, match=r"t_s.*renderer.s clock"):
            touches.push(event(NOW_S - late_s), NOW_S)
    else:
        assert touches.push(event(NOW_S - late_s), NOW_S) == (not future and not stale)
    taken = TouchCounts(taken=1, without_down=1)
    dropped = TouchCounts(from_the_future=int(future), stale=int(stale))
    assert touches.counts == (dropped if future or stale else taken)


@pytest.mark.parametrize(
    "stamp, words",
    [
        (NOW_S * 1e3, r"time\.monotonic\(\) in milliseconds"),
        (NOW_S * 1e6, r"time\.monotonic\(\) in microseconds"),
        (NOW_S * 1e9, r"time\.monotonic\(\) in nanoseconds"),
        (time.time, r"time\.time\(\) in seconds"),
        (lambda: time.time() * 1e3, r"time\.time\(\) in milliseconds"),
        (time.time_ns, r"time\.time\(\) in nanoseconds"),
        (NOW_S - 0.5, "0.5 s old.*strict=False"),
        (NOW_S + 0.5, "0.5 s ahead"),
    ],
)
def test_the_error_names_clock_and_unit(stamp, words):
    with pytest.raises(InputError, match=words) as caught:
        Touches(strict=True).push(event(stamp() if callable(stamp) else stamp), NOW_S)
    assert "\n" not in str(caught.value)


def test_a_finger_goes_up_by_any_clock():
    touches = Touches(strict=True)
    for t_s in (time.time(), math.nan, 0.0):
        assert touches.push(event(NOW_S, "down"), NOW_S)
        assert touches.push(event(t_s, "up"), NOW_S)
        assert touches.active == ()


class Clocks:
    """Two clocks that run together; each look takes some microseconds."""

    def __init__(self, offset_s, unit_s, tick_s):
        self.offset_s, self.unit_s, self.tick_s = offset_s, unit_s, tick_s
        self.steps = count()

    def now(self):
        return 1e-5 * next(self.steps)

    def read(self):
        t_s = self.now() - self.offset_s
        if self.tick_s:
            t_s = math.floor(t_s / self.tick_s) * self.tick_s
        return t_s / self.unit_s


@given(st.floats(-1e4, 1e4), st.sampled_from([1.0, 1e-3, 1e-6]), st.sampled_from([0, 1e-3, 0.0156]))
def test_an_apps_clock_is_mapped_within_its_uncertainty(offset_s, unit_s, tick_s):
    clocks = Clocks(offset_s, unit_s, tick_s)
    mapped = AppClock.measure(clocks.read, unit_s, clocks.now)
    # A tick in the worst case, and a reading takes 10 to 20 us.
    assert mapped.uncertainty_s <= tick_s + 3e-5
    for _ in range(200):
        stamp = clocks.read()
        late_s = clocks.now() - mapped.t_s(stamp)
        # A round of three looks, 10 us each, sees the end of a tick up to 30 us late.
        assert abs(late_s) <= mapped.uncertainty_s + 5e-5


def test_a_wrong_unit_is_found():
    clocks = Clocks(3.0, 1e-3, 0)
    with pytest.raises(InputError, match="unit_s"):
        AppClock.measure(clocks.read, 1.0, clocks.now)
    with pytest.raises(InputError, match="unit_s"):
        AppClock.measure(lambda: 5.0)
    with pytest.raises(InputError, match="read"):
        AppClock.measure(lambda: math.nan)


def stamps(kernel_s, panel_us):
    clock = PanelClock()
    found = [clock.stamp(t, int(us) % 2**32) for t, us in zip(kernel_s, panel_us, strict=True)]
    assert (np.diff(found) >= 0).all()
    return np.array(found), clock.holds


UNEVEN_S = 100 + np.cumsum(np.tile([0.013, 0.005], 150))  # 9 ms on average, as USB polls


def test_a_panel_that_is_polled_unevenly_is_read_by_its_own_clock():
    found, holds = stamps(UNEVEN_S, 9000.0 * np.arange(300))
    assert holds
    assert np.diff(found[40:]) == pytest.approx(0.009, abs=3e-4)
    # As late as before: what was measured of the panel's latency holds.
    assert np.mean(found - UNEVEN_S) == pytest.approx(0.0, abs=1e-4)


@pytest.mark.parametrize(
    "panel_us",
    [
        np.full(300, 7),  # stands
        900.0 * np.arange(300),  # counts tenths
        8000.0 * np.arange(300),  # 11 % slow
        np.random.default_rng(1).integers(0, 2**32, 300),
    ],
    ids=["stands", "tenths", "slow", "random"],
)
def test_a_panel_whose_clock_is_wrong_is_read_by_the_kernels(panel_us):
    found, holds = stamps(UNEVEN_S, panel_us)
    assert not holds
    assert found == pytest.approx(UNEVEN_S, abs=1e-12)


def test_the_panels_clock_may_wrap_and_start_anew():
    begin_us = 2**32 - 1_000_000
    kernel_s = np.concatenate([UNEVEN_S, UNEVEN_S + 5])
    panel_us = np.concatenate([begin_us + 9000.0 * np.arange(300), 9000.0 * np.arange(300)])
    found, _ = stamps(kernel_s, panel_us)
    for first in (40, 340):
        assert np.diff(found[first : first + 250]) == pytest.approx(0.009, abs=3e-4)
    assert abs(found - kernel_s).max() < 0.01
